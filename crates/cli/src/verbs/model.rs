//! `etude model`: the simulated world as MJCF, and its physical parameters.

use std::path::PathBuf;

use etude_stage::{PhysicalParams, mjcf};
use serde_json::json;

use super::{ConfigArgs, line};
use crate::Ending;

/// What to show of the model.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  etude model params
  etude model export -o world.xml
  etude model export --set task.stage.side=right --set task.stage.fences=false -o right.xml")]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Write the world as MJCF, which stock MuJoCo loads
    Export {
        /// The file; standard output if not given
        #[arg(short = 'o', long = "out", value_name = "FILE.xml")]
        out: Option<PathBuf>,
        #[command(flatten)]
        config: ConfigArgs,
    },
    /// List the physical parameters: path, value, range, unit, what it is
    Params {
        #[command(flatten)]
        config: ConfigArgs,
        /// Print JSON: a list of path, value, default, low, high, unit, doc
        #[arg(long)]
        json: bool,
    },
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    match args.what {
        What::Export { out, config } => {
            let task = config.resolve()?.task;
            let text = mjcf(&task.stage, &task.params()?);
            match out {
                Some(path) => {
                    etude_perform::write_file(&path, &text)?;
                    line(format!("The world is in {}; stock MuJoCo loads it", path.display()))?;
                }
                None => line(text)?,
            }
        }
        What::Params { config, json } => params(&config.resolve()?.task.params()?, json)?,
    }
    Ok(Ending::Done)
}

fn params(values: &PhysicalParams, as_json: bool) -> anyhow::Result<()> {
    let mut rows = Vec::new();
    for (path, row, default) in PhysicalParams::rows() {
        let value = values.get(&path)?;
        if as_json {
            rows.push(json!({
                "path": path, "value": value, "default": default, "low": row.range[0], "high": row.range[1],
                "unit": row.unit, "doc": row.doc,
            }));
        } else {
            let range = format!("{} … {}", row.range[0], row.range[1]);
            line(format!("{path:34} {value:>9} {range:>16} {:18} {}", row.unit, row.doc))?;
        }
    }
    if as_json { super::json(&rows) } else { Ok(()) }
}
