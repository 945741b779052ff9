//! `etude doctor`: what this machine has, and what cannot be done without each missing item.

use etude_lab::examine;

use super::{json, line};
use crate::Ending;

/// How to print.
#[derive(clap::Args)]
#[command(after_help = "Learning and playing in simulation need none of the missing items.")]
pub struct Args {
    /// Print JSON: a list of name, ok, found, cost
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let findings = examine();
    if args.json {
        json(&findings)?;
        return Ok(Ending::Done);
    }
    for finding in &findings {
        let mark = if finding.ok { "ok     " } else { "missing" };
        line(format!("{mark}  {:14} {}", finding.name, finding.found))?;
        if !finding.ok {
            line(format!("         {:14} {}", "", finding.cost))?;
        }
    }
    Ok(Ending::Done)
}
