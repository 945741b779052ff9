//! `etude train`: learn a song.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use anyhow::Context as _;
use etude_learn::Outcome;
use etude_music::resolve;
use serde_json::json;

use super::{ConfigArgs, line, slug};
use crate::Ending;
use crate::progress::{Progress, stop_flag};

/// What to learn, how and for how long.
#[derive(clap::Args)]
#[command(after_help = "\
A run's folder holds config.toml, song.mid, metrics.jsonl, TensorBoard events, the best and the last policy, and
checkpoints. Ctrl-C and SIGTERM save before they stop; after a kill -9 at most one checkpoint interval is lost.

Examples:
  etude train twinkle --minutes 10
  etude train my-song.mid --set trainer.seed=3 --set trainer.total_steps=2e6
  etude train --resume runs/twinkle__quick__0")]
pub struct Args {
    /// A built-in id (see `etude songs`) or a MIDI file
    #[arg(required_unless_present = "resume", conflicts_with = "resume")]
    song: Option<String>,
    #[command(flatten)]
    config: ConfigArgs,
    /// The run's folder; runs/SONG__PRESET__SEED if not given
    #[arg(short = 'o', long = "out", value_name = "DIR", conflicts_with = "resume")]
    out: Option<PathBuf>,
    /// Continue the run in this folder, bit for bit
    #[arg(long, value_name = "DIR")]
    resume: Option<PathBuf>,
    /// Stop after this much time, saving everything
    #[arg(long, value_name = "MINUTES")]
    minutes: Option<f64>,
    /// Print nothing but one JSON object at the end: run, policy, song, f1, step, updates, secs, stopped
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
pub fn run(args: Args) -> anyhow::Result<Ending> {
    let limit = args
        .minutes
        .map(|minutes| Duration::try_from_secs_f64(minutes * 60.0))
        .transpose()
        .context("--minutes must be a time, for example 10")?;
    let stop = stop_flag()?;
    let (folder, title, mut progress, outcome) = match (&args.resume, &args.song) {
        (Some(folder), _) => {
            let (song, config) = etude_lab::open_run(folder)?;
            let mut progress = Progress::new(config.trainer.total_steps, limit, args.json, stop.clone());
            let outcome = etude_lab::resume(folder, &mut progress);
            (folder.clone(), song.title().to_string(), progress, outcome)
        }
        (None, song) => {
            let name = song.as_deref().unwrap_or_default();
            let song = resolve(name)?;
            let config = args.config.resolve(&[])?;
            let folder = args.out.clone().unwrap_or_else(|| {
                PathBuf::from(format!("runs/{}__{}__{}", slug(name), args.config.preset, config.trainer.seed))
            });
            if !args.json {
                announce(&song, &folder, &config)?;
            }
            let command = std::env::args().collect::<Vec<_>>().join(" ");
            let mut progress = Progress::new(config.trainer.total_steps, limit, args.json, stop.clone());
            let outcome = etude_lab::train(&song, &config, &folder, &command, &mut progress);
            (folder, song.title().to_string(), progress, outcome)
        }
    };
    progress.finish();
    let outcome = outcome?;
    report(&args, &folder, &title, &outcome)?;
    let _ = &mut progress;
    Ok(if stop.load(Ordering::Relaxed) { Ending::Stopped } else { Ending::Done })
}

fn announce(
    song: &etude_music::Song,
    folder: &std::path::Path,
    config: &etude_lab::RunConfig,
) -> anyhow::Result<()> {
    for warning in song.warnings() {
        eprintln!("warning: {warning}");
    }
    line(format!(
        "Learning {} ({} notes): {} steps in {} at a time, into {}",
        song.title(),
        song.notes().len(),
        config.trainer.total_steps,
        config.trainer.num_envs,
        folder.display()
    ))
}

fn report(args: &Args, folder: &std::path::Path, title: &str, outcome: &Outcome) -> anyhow::Result<()> {
    let policy = folder.join("policy-best.safetensors");
    let best = outcome.best.as_ref();
    let f1 = best.and_then(|best| best.scores.first()).map(|score| score.value);
    if args.json {
        return super::json(&json!({
            "run": folder,
            "policy": policy,
            "song": title,
            "f1": f1,
            "best_step": best.map(|best| best.step),
            "step": outcome.step,
            "updates": outcome.updates,
            "secs": outcome.elapsed_secs,
            "stopped": outcome.stopped.map(|reason| format!("{reason:?}").to_lowercase()),
        }));
    }
    line(format!(
        "{} after {} steps, {} updates and {:.0} s",
        if outcome.stopped.is_some() { "Stopped" } else { "Finished" },
        outcome.step,
        outcome.updates,
        outcome.elapsed_secs
    ))?;
    match f1 {
        Some(f1) => line(format!("Best F1 {f1:.3}; the policy is {}", policy.display()))?,
        None => line("Not evaluated yet: no policy to play")?,
    }
    if outcome.stopped.is_some() {
        line(format!("Continue with: etude train --resume {}", folder.display()))?;
    }
    if f1.is_some() {
        let song = args.song.clone().unwrap_or_else(|| folder.join("song.mid").display().to_string());
        line(format!("Play it with:  etude play {song} --policy {}", folder.display()))?;
    }
    Ok(())
}
