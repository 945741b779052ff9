//! `etude record`: record a robot at rest or in an excitation.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context as _;
use clap::ValueHint;
use etude_lab::{Motion, record_robot};
use etude_perform::Excitation;
use etude_perform::session::rig_choice;

use crate::args;
use crate::files::check_replaceable;
use crate::output::{Ending, line, note};
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
    /// Twin parameters (the hidden physical numbers of the twin): `standard`, `worn`, `mild`, `ideal`,
    /// `random:SEED`, or a file
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
    /// The recording; a complete one replaces an existing file
    #[arg(short = 'o', long = "out", value_name = "FILE")]
    out: PathBuf,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let rig = rig_choice(&args.robot, &args.twin_params)?;
    let stop = stop_flag()?;
    let motion = match (args.excitation, args.secs) {
        (Some(excitation), _) => Motion::Excitation(excitation),
        (None, None) if rig.is_twin() => {
            anyhow::bail!("a twin in lockstep does not run by the wall clock: give the duration with --secs")
        }
        (None, secs) => Motion::Rest(secs.map(Duration::from_secs_f64)),
    };
    let home = args.home || rig.is_twin();
    check_replaceable(&args.out, "MCAP0")?;
    // Only a complete recording replaces an existing one.
    let is_there = args.out.exists();
    let new = if is_there { args.out.with_extension("new.mcap") } else { args.out.clone() };
    let recorded = record_robot(&rig, motion, home, args.seed, &new, &stop).inspect_err(|_| {
        if is_there {
            // It has no motion, so it does no harm if it cannot be removed.
            let _ = std::fs::remove_file(&new);
        }
    })?;
    let ending = match recorded.ending {
        etude_perform::Ending::Complete => Ok(Ending::Done),
        // Without --secs, Ctrl-C is the normal end of a recording.
        etude_perform::Ending::Interrupted if matches!(motion, Motion::Rest(None)) => Ok(Ending::Done),
        etude_perform::Ending::Interrupted => Ok(Ending::Stopped),
        etude_perform::Ending::Fault(fault) => {
            Err(anyhow::anyhow!("safety stop: {fault}; remove the cause, then repeat the command"))
        }
    };
    let is_complete = matches!(ending, Ok(Ending::Done));
    if is_there && is_complete {
        std::fs::rename(&new, &args.out)
            .with_context(|| format!("cannot rename {} to {}", new.display(), args.out.display()))?;
    }
    let kept = if is_complete { &args.out } else { &new };
    line(format!("{} messages in {}", recorded.messages, kept.display()))?;
    if is_there && !is_complete {
        note(format!("{} is unchanged", args.out.display()));
    }
    ending
}
