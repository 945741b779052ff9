//! `etude train`: train a policy for a song, or the sight-reader.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::ValueHint;
use etude_lab::{
    SIGHT_READER, SongPlanner, Training, beginning_with, cannot_be_played, find_song, policy_called,
};
use etude_learn::{Outcome, StopReason};
use etude_music::Song;
use etude_perform::{NoteCounts, shell_line, shell_word};
use serde_json::json;

use crate::args::{self, ConfigArgs, slug};
use crate::output::{Unread, VerbEnd, line, note, print_json};
use crate::progress::{Progress, evaluation_summary, stop_flag};
use crate::status::planner;

/// Song, configuration and limits of a training.
#[derive(clap::Args)]
#[command(after_help = "\
A run's folder holds config.toml, song.mid, metrics.jsonl, TensorBoard events, the best and the last policy, and \
checkpoints. Ctrl-C and SIGTERM save and stop; kill -9 loses at most one checkpoint interval.

Examples:
  etude train twinkle --minutes 10
  etude train my-song.mid --set trainer.seed=3 --set trainer.total_steps=2e6
  etude train twinkle --from runs/twinkle__fast__0 --config identified.toml -o runs/second
  etude train my-song.mid --from sight-reader --minutes 5
  etude train --preset sight-reader
  etude train --resume runs/twinkle__fast__0
  etude train --resume runs/twinkle__fast__0 --set trainer.total_steps=3e6")]
pub struct Args {
    /// A built-in id (see `etude songs`) or a MIDI file; without one, the preset's corpus is
    /// learned (--preset sight-reader)
    #[arg(required_unless_present_any = ["resume", "preset", "config"], conflicts_with = "resume", value_parser = args::song(), value_hint = ValueHint::FilePath, hide_possible_values = true)]
    song: Option<String>,
    /// Play a file's silence before its first note too
    #[arg(long)]
    keep_silence: bool,
    #[command(flatten)]
    config: ConfigArgs,
    /// The run's folder; by default runs/SONG__PRESET__SEED
    #[arg(short = 'o', long = "out", value_name = "DIR", conflicts_with = "resume")]
    out: Option<PathBuf>,
    /// Start from the networks of this run (last policy and critics) or policy file (actor alone).
    /// Replay buffer and optimiser are new; task.rail_range is that of the source. `--from
    /// sight-reader` also takes its observation
    #[arg(long, value_name = "PATH", conflicts_with = "resume")]
    from: Option<PathBuf>,
    /// Continue the run in this folder, bit for bit; --set may change only its steps, intervals and
    /// threads
    #[arg(long, value_name = "DIR", conflicts_with_all = ["preset", "config"])]
    resume: Option<PathBuf>,
    /// Save and stop after this time, counted from this start
    #[arg(long, value_name = "MINUTES", value_parser = args::positive, allow_hyphen_values = true)]
    minutes: Option<f64>,
    /// Print nothing but one JSON object at the end: run, policy, song, notes_right, notes_due,
    /// notes_wrong, f1, onset_f1, best_step, step, updates, secs, stopped
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<VerbEnd> {
    let limit = args.minutes.map(|minutes| Duration::from_secs_f64(minutes * 60.0));
    let stop = stop_flag()?;
    let mut planner = planner(args.json);
    let (folder, mut run) = match (&args.resume, &args.song) {
        (Some(folder), _) => {
            (folder.clone(), Training::resume(folder, &args.config.overrides, &mut planner)?)
        }
        (None, name) => {
            let song = name.as_deref().map(|name| find_song(name, args.keep_silence)).transpose()?;
            let source = args.from.as_deref().map(policy_called).transpose()?;
            let mut config = args.config.resolve()?;
            if let Some(source) = source.as_deref().filter(|_| song.is_some()) {
                config = beginning_with(config, source);
            }
            let seed = config.trainer.seed;
            let folder = args.out.clone().unwrap_or_else(|| match name.as_deref().zip(song.as_ref()) {
                Some((name, song)) => args::folder_of(
                    song,
                    PathBuf::from(format!("runs/{}__{}__{seed}", slug(name), args.config.preset)),
                ),
                None => PathBuf::from(format!("runs/{SIGHT_READER}__{seed}")),
            });
            let command = shell_line(std::env::args());
            let run = Training::start(song, config, &folder, &command, source.as_deref(), &mut planner)?;
            (folder, run)
        }
    };
    if !args.json {
        ignore_unread(announce(&run, &args, &folder, &mut planner))?;
    }
    let mut progress = Progress::new(&run, limit, args.json, stop);
    let outcome = run.run(&mut progress);
    drop(progress);
    let outcome = outcome?;
    ignore_unread(report(&args, &folder, &run, &outcome))?;
    Ok(if outcome.stopped == Some(StopReason::Requested) { VerbEnd::Stopped } else { VerbEnd::Done })
}

/// A closed standard output does not change how a training ends: Ctrl-C in `etude train … | tee
/// log` stops both.
fn ignore_unread(printed: anyhow::Result<()>) -> anyhow::Result<()> {
    printed.or_else(|error| if error.is::<Unread>() { Ok(()) } else { Err(error) })
}

fn announce(run: &Training, args: &Args, folder: &Path, planner: &mut SongPlanner<'_>) -> anyhow::Result<()> {
    if let Some(song) = run.song() {
        let task = &run.config().task;
        let quick = task.key_schedule.quick_repeats(song);
        let hard = cannot_be_played(song, task, planner)?;
        for warning in hard.into_iter().chain(quick) {
            note(format!("warning: {warning}"));
        }
    }
    if let Some(corpus) = &run.config().corpus {
        let left_out = corpus.left_out()?;
        if let Some(first) = left_out.first() {
            note(format!(
                "warning: {} files of the corpus are not used, the first because: {first}",
                left_out.len()
            ));
        }
    }
    let what = run.song().map_or_else(
        || "sight-reading".to_string(),
        |song| format!("{} ({} notes)", song.title(), song.notes().len()),
    );
    let trainer = &run.config().trainer;
    let begun = match run.step() {
        0 => String::new(),
        step => format!(", resumed at step {step}"),
    };
    let begun = args.from.as_ref().map_or(begun, |source| format!(", from {}", source.display()));
    line(format!(
        "Learning {what}: {} steps in {} at a time{begun}, into {}",
        trainer.total_steps,
        trainer.num_envs,
        folder.display()
    ))
}

fn report(args: &Args, folder: &Path, run: &Training, outcome: &Outcome) -> anyhow::Result<()> {
    let best = outcome.best.as_ref();
    let policy =
        folder.join(if best.is_some() { "policy-best.safetensors" } else { "policy-last.safetensors" });
    let value = |name: &str| best?.scores.iter().find(|score| score.name == name).map(|score| score.value);
    if args.json {
        let notes = best.and_then(|best| NoteCounts::of_evaluation(&best.scores));
        return print_json(&json!({
            "run": folder,
            "policy": policy,
            "song": run.song().map(Song::title),
            "notes_right": notes.map(|notes| notes.right),
            "notes_due": notes.map(|notes| notes.due),
            "notes_wrong": notes.map(|notes| notes.wrong),
            "f1": value("f1"),
            "onset_f1": value("onset_f1"),
            "best_step": best.map(|best| best.step),
            "step": outcome.step,
            "updates": outcome.updates,
            "secs": outcome.elapsed_secs,
            "stopped": outcome.stopped.map(|reason| match reason {
                StopReason::Requested => "requested",
                StopReason::OutOfTime => "out-of-time",
            }),
        }));
    }
    line(format!(
        "{} after {} steps, {} updates and {:.0} s",
        if outcome.stopped.is_some() { "Stopped" } else { "Finished" },
        outcome.step,
        outcome.updates,
        outcome.elapsed_secs
    ))?;
    match best.and_then(|best| evaluation_summary(&best.scores)) {
        Some(summary) => line(format!("The best policy: {summary}; {}", policy.display()))?,
        None => line(format!("Not evaluated yet; the policy so far is {}", policy.display()))?,
    }
    let of_run =
        run.song().map_or_else(|| "SONG".to_string(), |_| folder.join("song.mid").display().to_string());
    let song = args.song.clone().unwrap_or(of_run);
    let run = shell_word(folder.display());
    line(format!("Play it with: etude play {} --policy {run}", shell_word(song)))?;
    let resume = format!("etude train --resume {run}");
    if outcome.stopped.is_some() {
        line(format!("Resume with: {resume}"))
    } else {
        line(format!("Train longer with: {resume} --set trainer.total_steps={}", 2 * outcome.step))
    }
}
