//! `etude model`: the simulated world as MJCF, its physical parameters, and the lag of its hand.

use std::path::PathBuf;

use etude_music::{CONTROL_HZ, KeyScheduleConfig, ceil_frame};
use etude_stage::{PhysicalParams, mjcf};
use etude_task::{Lags, TaskConfig, shortest_silences};
use serde_json::json;

use crate::args::ConfigArgs;
use crate::files::check_replaceable;
use crate::output::{VerbEnd, line, print_json};

/// What to print.
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
    /// List the physical parameters: path, value, range, unit, description
    Params {
        #[command(flatten)]
        config: ConfigArgs,
        /// Print JSON: a list of path, value, default, low, high, unit, doc
        #[arg(long)]
        json: bool,
    },
    /// Measure the lag of the hand behind its targets, and the shortest silence of a key between
    /// two strikes
    Lags {
        #[command(flatten)]
        config: ConfigArgs,
        /// Print JSON: sound_secs, silence_secs, shortest_silence_secs (white and black key),
        /// follow_secs
        #[arg(long)]
        json: bool,
    },
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    match args.what {
        What::Export { out, config } => {
            let task = config.resolve()?.task;
            let text = mjcf(&task.stage, &task.params()?);
            match out {
                Some(path) => {
                    check_replaceable(&path, "<mujoco model=\"etude\">")?;
                    etude_perform::write_file(&path, &text)?;
                    line(format!("The world is in {}; stock MuJoCo loads it", path.display()))?;
                }
                None => line(text)?,
            }
        }
        What::Params { config, json } => params(&config.resolve()?.task.params()?, json)?,
        What::Lags { config, json } => lags(&config.resolve()?.task, json)?,
    }
    Ok(VerbEnd::Done)
}

fn lags(task: &TaskConfig, as_json: bool) -> anyhow::Result<()> {
    let params = task.params()?;
    let lags = Lags::measure(&task.stage, &params)?;
    let silences = shortest_silences(&task.stage, &params)?;
    if as_json {
        let Lags { sound_secs, silence_secs, follow_secs } = lags;
        return print_json(&json!({
            "sound_secs": sound_secs, "silence_secs": silence_secs, "shortest_silence_secs": silences, "follow_secs": follow_secs,
        }));
    }
    let cell =
        |secs: Option<f64>| secs.map_or_else(|| "not in 1 s".into(), |secs| format!("{:.0} ms", 1e3 * secs));
    line(format!("{:52} {:>10} {:>10}", "", "white key", "black key"))?;
    for (what, [white, black]) in [
        ("from the target that strikes until the key sounds", lags.sound_secs),
        ("from the target that lifts until it is silent", lags.silence_secs),
        ("shortest silence between two strikes of it", silences),
    ] {
        line(format!("{what:52} {:>10} {:>10}", cell(white), cell(black)))?;
    }
    line(format!("{:52} {:>10}", "lag of a finger joint behind its target", cell(Some(lags.follow_secs))))?;
    line(restrike(silences, &task.key_schedule))
}

/// Whether the key schedule leaves the silence that the hand needs to strike a key again.
pub(super) fn restrike(silences: [Option<f64>; 2], schedule: &KeyScheduleConfig) -> String {
    let [Some(white), Some(black)] = silences else {
        return "In this world the hand cannot strike every key again within a second".into();
    };
    let secs = |frames: usize| frames as f64 / CONTROL_HZ;
    let planned = schedule.rest_frames();
    let needed = ceil_frame(white.max(black) * CONTROL_HZ);
    let silence = format!("A key is silent for {:.0} ms before it is struck again", 1e3 * secs(planned));
    if needed <= planned {
        return format!("{silence}: long enough");
    }
    format!(
        "{silence}: too short. Use --set task.plan.rule=articulated --set task.plan.restrike_secs={:.2}",
        secs(needed)
    )
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
    if as_json { print_json(&rows) } else { Ok(()) }
}
