//! `etude record`: record a robot at rest or in an excitation.

use std::path::PathBuf;
use std::time::Duration;

use clap::ValueHint;
use etude_lab::{RobotMotion, record_robot};
use etude_perform::Excitation;
use etude_perform::session::rig_choice;

use crate::args;
use crate::output::{VerbEnd, line};
use crate::progress::stop_flag;

/// Robot, motion and output.
#[derive(clap::Args)]
#[command(after_help = "\
The robot is brought up and holds still, or moves through an excitation. All excitations stay clear of \
the keyboard except `keys`: slow presses of nine white keys, presses beside the gaps between keys, and \
pushes against black keys. The recording has every measurement, command and key. `etude identify` fits \
the simulator to recordings of excitations.

Examples:
  etude record --robot lab.toml --secs 60 -o still.mcap
  etude record --robot lab.toml --home --excitation open-close -o open-close.mcap
  etude record --robot twin --twin-params worn --excitation chirp -o chirp.mcap")]
pub struct Args {
    /// `twin`, or the file of a rig
    #[arg(long, value_name = "RIG", value_hint = ValueHint::FilePath)]
    robot: String,
    /// Twin parameters (the hidden physical numbers of the twin): `standard`, `worn`, `mild`,
    /// `ideal`, `random:SEED`, or a file
    #[arg(long, default_value = "standard", value_name = "NAME|random:SEED|FILE", value_parser = args::twin_params(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    twin_params: String,
    /// The motion: `open-close`, `chirp`, `rail` or `keys` to fit the simulator, `held-out` to test
    /// a fit
    #[arg(long, value_name = "NAME", conflicts_with = "secs")]
    excitation: Option<Excitation>,
    /// Added to the seed of the twin parameters
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// First move the robot slowly to the keyboard (a twin always does this). Stand clear
    #[arg(long)]
    home: bool,
    /// Duration, s; by default until Ctrl-C
    #[arg(long, value_parser = args::positive)]
    secs: Option<f64>,
    /// The recording, a file that does not exist yet
    #[arg(short = 'o', long = "out", value_name = "FILE")]
    out: PathBuf,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let rig = rig_choice(&args.robot, &args.twin_params)?;
    let stop = stop_flag()?;
    let motion = match (args.excitation, args.secs) {
        (Some(excitation), _) => RobotMotion::Excitation(excitation),
        (None, None) if rig.is_twin() => {
            anyhow::bail!("a twin in lockstep does not run by the wall clock: give the duration with --secs")
        }
        (None, secs) => RobotMotion::Rest(secs.map(Duration::from_secs_f64)),
    };
    let home = args.home || rig.is_twin();
    // A device or a pipe has no content to lose.
    if args.out.is_file() {
        anyhow::bail!("{} exists: choose another name, or remove the file", args.out.display());
    }
    let recorded = record_robot(&rig, motion, home, args.seed, &args.out, &stop)?;
    let ending = match recorded.ending {
        etude_perform::Ending::Complete => Ok(VerbEnd::Done),
        // Without --secs, Ctrl-C is the normal end of a recording.
        etude_perform::Ending::Interrupted if matches!(motion, RobotMotion::Rest(None)) => Ok(VerbEnd::Done),
        etude_perform::Ending::Interrupted => Ok(VerbEnd::Stopped),
        etude_perform::Ending::Fault(fault) => Err(anyhow::anyhow!(
            "safety stop: {fault}; remove the cause, then record again, under another name"
        )),
    };
    line(format!("{} messages in {}", recorded.messages, args.out.display()))?;
    ending
}
