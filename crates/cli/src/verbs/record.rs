//! `etude record`: record what a robot does without playing a song.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use etude_lab::{record_robot, rig_choice};

use super::line;
use crate::Ending;
use crate::progress::stop_flag;

/// What to record, and where to.
#[derive(clap::Args)]
#[command(after_help = "\
The robot is brought up and holds still; everything that it measures and sends, and every key that is played, is
recorded.

Examples:
  etude record --robot lab.toml --secs 60 -o keys.mcap
  etude record --robot twin --secs 5 -o rest.mcap")]
pub struct Args {
    /// `twin`, or the file of a rig
    #[arg(long, value_name = "RIG")]
    robot: String,
    /// What is true of the twin: `standard`, `ideal`, `worn`, or a file
    #[arg(long, default_value = "standard", value_name = "NAME|FILE")]
    truth: String,
    /// Bring the robot slowly to the keyboard first. Stand clear
    #[arg(long)]
    home: bool,
    /// How long, s; until Ctrl-C if not given
    #[arg(long, value_parser = super::positive)]
    secs: Option<f64>,
    /// The recording
    #[arg(short = 'o', long = "out", value_name = "FILE")]
    out: PathBuf,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let rig = rig_choice(&args.robot, &args.truth)?;
    let stop = stop_flag()?;
    if args.secs.is_none() && rig.is_twin() {
        anyhow::bail!("a twin in lockstep knows no time of day: say how long with --secs");
    }
    let longest = args.secs.map(Duration::from_secs_f64);
    let records = record_robot(&rig, args.home, longest, &args.out, &stop)?;
    line(format!("{records} messages in {}", args.out.display()))?;
    let cut_short = args.secs.is_some() && stop.load(Ordering::Relaxed);
    Ok(if cut_short { Ending::Stopped } else { Ending::Done })
}
