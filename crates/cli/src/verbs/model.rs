//! `etude model`: the simulated world as MJCF, and its physical parameters.

use std::path::PathBuf;

use etude_music::{CONTROL_HZ, PlanConfig, PlanRule};
use etude_stage::{PhysicalParams, mjcf};
use etude_task::{Lags, TaskConfig};
use serde_json::json;

use super::{ConfigArgs, line};
use crate::Ending;

/// What to show of the model.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  etude model params
  etude model lags --config out/identified/identified.toml
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
    /// Measure how late the hand is behind its targets, and how long a key must be up before it can be struck again
    Lags {
        #[command(flatten)]
        config: ConfigArgs,
        /// Print JSON: sound_secs, silence_secs, restrike_secs (white and black key), follow_secs
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
        What::Lags { config, json } => lags(&config.resolve()?.task, json)?,
    }
    Ok(Ending::Done)
}

fn lags(task: &TaskConfig, as_json: bool) -> anyhow::Result<()> {
    let lags = Lags::measure(&task.stage, &task.params()?)?;
    if as_json {
        return super::json(&lags);
    }
    let cell =
        |secs: Option<f64>| secs.map_or_else(|| "not in 1 s".into(), |secs| format!("{:.0} ms", 1e3 * secs));
    line(format!("{:52} {:>10} {:>10}", "", "white key", "black key"))?;
    for (what, [white, black]) in [
        ("from the target that strikes until the key sounds", lags.sound_secs),
        ("from the target that lifts until it is silent", lags.silence_secs),
        ("shortest rest before the key is struck again", lags.restrike_secs),
    ] {
        line(format!("{what:52} {:>10} {:>10}", cell(white), cell(black)))?;
    }
    line(format!("{:52} {:>10}", "a turning finger behind its target", cell(Some(lags.follow_secs))))?;
    line(restrike(&lags, &task.plan))
}

/// Whether a plan leaves the hand the time that it needs to strike a key again.
pub(super) fn restrike(lags: &Lags, plan: &PlanConfig) -> String {
    let planned_secs = match plan.rule {
        PlanRule::Robopianist => 1.0 / CONTROL_HZ,
        PlanRule::Articulated => plan.restrike_secs,
    };
    let planned = format!("The plan has a key up for {:.0} ms before it is struck again", 1e3 * planned_secs);
    match lags.longest_restrike_secs() {
        None => "In this world the hand cannot strike a key again within a second".into(),
        Some(needed) if needed > planned_secs => {
            format!(
                "{planned}: too short. Take --set task.plan.rule=articulated --set task.plan.restrike_secs={needed:.2}"
            )
        }
        Some(_) => format!("{planned}: long enough"),
    }
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
