//! `etude doctor`: what this machine has, and what each missing item prevents.

use etude_lab::examine;

use crate::output::{VerbEnd, line, print_json};

/// How to print.
#[derive(clap::Args)]
#[command(after_help = "Learning and playing in simulation need none of the missing items.")]
pub struct Args {
    /// Print JSON: a list of name, ok, found, cost
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let findings = examine();
    if args.json {
        print_json(&findings)?;
        return Ok(VerbEnd::Done);
    }
    for finding in &findings {
        let mark = if finding.ok { "ok     " } else { "missing" };
        line(format!("{mark}  {:14} {}", finding.name, finding.found))?;
        if !finding.ok {
            line(format!("         {:14} {}", "", finding.cost))?;
        }
    }
    Ok(VerbEnd::Done)
}
