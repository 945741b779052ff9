//! `etude identify`: fit the simulator to a robot's recordings.

use std::path::PathBuf;

use etude_identify::Progress;
use etude_lab::{Identification, IdentifyMethod, identify_robot};
use etude_perform::Job;
use etude_show::replay::recordings;
use etude_task::{TaskConfig, shortest_silences};

use super::model::restrike;
use crate::output::{VerbEnd, line, print_json};
use crate::progress::stop_flag;
use crate::status::{Status, clock};

/// Recordings, fit and output.
#[derive(clap::Args)]
#[command(after_help = "\
First fits each joint and each finger to the recordings without key contact, then the keyboard to those \
with contact and to the excitation `keys`. Recordings of the excitation `held-out` test the fit. The \
folder receives identified.toml (a layer for `etude train --config`), report.md with its figures, and a \
state from which the same command resumes.

Examples:
  etude record --robot twin --excitation open-close -o open-close.mcap
  etude record --robot twin --excitation chirp -o chirp.mcap
  etude record --robot twin --excitation rail -o rail.mcap
  etude record --robot twin --excitation keys -o keys.mcap
  etude record --robot twin --excitation held-out -o held-out.mcap
  etude identify open-close.mcap chirp.mcap rail.mcap keys.mcap held-out.mcap -o out/identified
  etude train twinkle --config out/identified/identified.toml")]
pub struct Args {
    /// Recordings of one robot (`etude record --excitation`, `etude perform`), or folders that hold
    /// some; of numbered results the latest
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// A recording that tests the fit and is not fitted; may be repeated
    #[arg(long, value_name = "RECORDING")]
    held_out: Vec<PathBuf>,
    /// How the simulator is fitted: `lm` (Levenberg-Marquardt) or `bo` (Bayesian optimisation, as
    /// in the paper)
    #[arg(long, default_value = "lm", value_name = "lm|bo")]
    fit: IdentifyMethod,
    /// Maximum number of evaluations per fit of a joint, a finger or the keyboard
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    evaluations: Option<u64>,
    /// Seed of every random draw
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Start from the values of this file, such as another identified.toml
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
    /// Folder of the results
    #[arg(short = 'o', long = "out", default_value = "out/identified", value_name = "DIR")]
    out: PathBuf,
    /// Print nothing but one JSON object at the end: rig, method, fit_errors, held_out_errors,
    /// identified, file, …
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let start = match &args.from {
        Some(path) => etude_lab::stored_config(path)?.task.physics,
        None => TaskConfig::default().physics,
    };
    let all = |paths: Vec<PathBuf>| -> anyhow::Result<Vec<PathBuf>> {
        Ok(paths.iter().map(|path| recordings(path)).collect::<Result<Vec<_>, _>>()?.concat())
    };
    let what = Identification {
        recordings: all(args.recordings)?,
        held_out: all(args.held_out)?,
        method: args.fit,
        evaluations: args.evaluations,
        seed: args.seed,
        start,
    };
    let stop = stop_flag()?;
    let mut status = Status::new(args.json);
    let mut tell = |at: &Progress| {
        let [phase, state] = fit_progress(at);
        status.now(&phase, &state);
    };
    let report = identify_robot(&what, &args.out, &mut Job::new(&mut tell, &stop))?;
    drop(status);
    if args.json {
        print_json(&report)?;
        return Ok(VerbEnd::Done);
    }
    for pass in &report.identified.passes {
        line(format!(
            "{:<18} residuals {:6.1} → {:5.1} times the noise, {}, {:.0} s",
            pass.pass.name(),
            pass.rms[0],
            pass.rms[1],
            replays(pass.replays),
            pass.secs
        ))?;
    }
    for (what, errors) in [("fitted", &report.fit_errors), ("held out", &report.held_out_errors)] {
        let [before, after] = errors.fingers.map(|rad| rad * 1e3);
        if before > 0.0 {
            line(format!(
                "{what:<18} fingers {before:.2} → {after:.2} mrad ({:.1} times less; noise {:.2})",
                before / after,
                errors.fingers_noise * 1e3
            ))?;
        }
    }
    if let Some(weight) = &report.weight {
        line(format!("{:<18} {}", "weight", weight.advice(report.gravity_pwm_per_nm)))?;
    }
    if let Some(keyboard) = &report.keyboard {
        line(format!("{:<18} {keyboard}", "keyboard"))?;
    }
    let task = etude_lab::resolve("fast", Some(&report.file), &[])?.task;
    let silences = shortest_silences(&task.stage, &task.params()?)?;
    line(format!("{:<18} {}", "repeated keys", restrike(silences, &task.key_schedule)))?;
    line(format!("The simulator as identified is {}", report.file.display()))?;
    Ok(VerbEnd::Done)
}

/// The pass of a fit and its progress. It ends when all is settled, so the time left is an upper
/// bound.
pub(super) fn fit_progress(at: &Progress) -> [String; 2] {
    let [ended, all] = at.ended;
    let left = at
        .max_secs_left()
        .map_or_else(String::new, |secs| format!(", at most about {} left in this pass", clock(secs)));
    let state = format!(
        ", {}, residuals {:.2} times the noise, {ended} of {all} settled, {} so far{left}",
        replays(at.replays),
        at.rms,
        clock(at.secs)
    );
    [format!("pass {}, {}", at.number, at.pass.name()), state]
}

fn replays(count: u64) -> String {
    format!("{count} replay{}", if count == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::replays;

    #[test]
    fn one_replay_is_no_plural() {
        assert_eq!([0, 1, 2].map(replays), ["0 replays", "1 replay", "2 replays"]);
    }
}
