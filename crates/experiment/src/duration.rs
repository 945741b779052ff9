//! How long the open trials of a plan take.

use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use etude_lab::{RehearsalFit, RunConfig, SongPlanner, Training, TrainingProgress};
use etude_learn::TrainerConfig;
use etude_perform::Job;

use crate::playing::find_piece;
use crate::slurm::open_trials;
use crate::trial::{TrainingConfig, Trial, TrialWork, json};

/// How long a training is timed to learn how fast it is.
const SAMPLE_TIME: Duration = Duration::from_secs(4);
/// Environment steps that a machine cannot do in this time.
const MAX_SAMPLE_STEPS: u64 = 100_000;
/// Time of one core for a fit, what is then played and what is predicted, s. Measured with the
/// preset `paper` on two cores with AVX-512, both fits of a rehearsal.
const FIT_SECS: f64 = 300.0;

/// What the open trials of a plan ask of a machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WorkEstimate {
    /// The trials.
    pub trials: usize,
    /// Environment steps of all trainings, with those of rehearsals.
    pub steps: u64,
    /// Fits of the simulator.
    pub fits: u64,
    /// Time of one core, s.
    pub core_secs: f64,
}

impl WorkEstimate {
    /// Of the trials that are not done among `runs`. Each kind of training is timed for some
    /// seconds.
    ///
    /// # Errors
    /// If a configuration or a song cannot be used.
    pub fn of(trials: &[Trial], runs: &Path) -> anyhow::Result<Self> {
        Self::by(trials, runs, secs_a_step)
    }

    fn by(
        trials: &[Trial],
        runs: &Path,
        secs_a_step: impl Fn(&TrainingConfig, RunConfig) -> anyhow::Result<f64>,
    ) -> anyhow::Result<Self> {
        let open = open_trials(trials, runs);
        let mut estimate = Self { trials: open.len(), ..Self::default() };
        let mut rates = HashMap::new();
        for trial in open.into_iter().map(|index| &trials[index]) {
            let (steps, fits) = steps_and_fits(trial)?;
            estimate.steps += steps;
            estimate.fits += fits;
            estimate.core_secs += FIT_SECS * fits as f64;
            let TrialWork::Train { training, .. } = &trial.work else { continue };
            let config = training.resolve()?;
            let TrainerConfig { num_envs, updates_per_vector_step, .. } = config.trainer;
            let schedule = (num_envs, updates_per_vector_step, json(&config.droq));
            let rate = match rates.get(&schedule) {
                Some(rate) => *rate,
                None => *rates.entry(schedule).or_insert(secs_a_step(training, config)?),
            };
            estimate.core_secs += rate * steps as f64;
        }
        Ok(estimate)
    }
}

/// Environment steps of a trial, with those of its rehearsals, and fits of the simulator.
fn steps_and_fits(trial: &Trial) -> anyhow::Result<(u64, u64)> {
    let (training, rehearse) = match &trial.work {
        TrialWork::Train { training, rehearse, .. } => (training, rehearse),
        TrialWork::Identify { .. } => return Ok((0, 1)),
        TrialWork::Play { .. } => return Ok((0, 0)),
    };
    let steps = training.resolve()?.trainer.total_steps;
    let Some(rehearse) = rehearse else { return Ok((steps, 0)) };
    let sets = &rehearse.twin_params;
    let rehearsals = (sets.len() * rehearse.modes.len() * rehearse.iterations) as u64;
    let fitted = rehearse.fits.iter().filter(|fit| **fit != RehearsalFit::None).count() as u64;
    let trainings = rehearsals * rehearse.fits.len() as u64;
    Ok((steps + trainings * rehearse.steps.unwrap_or(steps), rehearsals * fitted))
}

/// Time of one core for an environment step of a training after its warm-up, s, by running it.
fn secs_a_step(training: &TrainingConfig, mut config: RunConfig) -> anyhow::Result<f64> {
    let vector_step = config.trainer.num_envs as u64;
    // Enough for a batch.
    let warmup = (2 * config.droq.batch as u64).max(vector_step);
    config.trainer = TrainerConfig {
        threads: 1,
        warmup_steps: warmup,
        total_steps: warmup + MAX_SAMPLE_STEPS,
        log_every_steps: vector_step,
        evaluate_every_steps: 0,
        checkpoint_every_steps: 2 * (warmup + MAX_SAMPLE_STEPS),
        ..config.trainer
    };
    let folder = tempfile::tempdir().context("no folder for temporary files")?;
    let song = training.song.as_deref().map(find_piece).transpose()?;
    let at = folder.path().join("training");
    let mut run =
        Training::start(song, config, &at, "etude experiment run", None, &mut SongPlanner::default())?;
    let stop = AtomicBool::new(false);
    let mut begun: Option<(u64, Instant)> = None;
    let mut timed = None;
    let mut on_progress = |at: &TrainingProgress| {
        if at.step <= warmup {
            return;
        }
        let (step, since) = *begun.get_or_insert_with(|| (at.step, Instant::now()));
        if at.step > step {
            timed = Some(since.elapsed().as_secs_f64() / (at.step - step) as f64);
        }
        if since.elapsed() > SAMPLE_TIME {
            stop.store(true, Ordering::Relaxed);
        }
    };
    run.run_job(&mut Job::new(&mut on_progress, &stop))?;
    timed.context("a training was too short to be timed")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Experiment, ExperimentConfig};

    /// Three trainings of two variants, of which one goes through two iterations with three fits.
    #[test]
    fn an_estimate_counts_trainings_rehearsals_and_fits_of_open_trials() {
        let runs = tempfile::tempdir().unwrap();
        let file = runs.path().join("small.toml");
        std::fs::write(&file, SMALL).unwrap();
        let experiment = Experiment::load(&file.display().to_string()).unwrap();
        let trials = experiment.plan(&ExperimentConfig::default()).unwrap();
        let timed = std::sync::Mutex::new(Vec::new());
        let estimate = || {
            WorkEstimate::by(&trials, runs.path(), |_, config| {
                timed.lock().unwrap().push(config.trainer.num_envs);
                Ok(0.01)
            })
            .unwrap()
        };
        let whole = estimate();
        // A training has 1,000 steps, and each of 2 sets × 3 fits × 2 iterations 500 more.
        let (steps, fits) = (3 * (1_000 + 12 * 500) + 3 * 1_000, 3 * 2 * 2 * 2);
        let core_secs = 0.01 * steps as f64 + FIT_SECS * fits as f64;
        assert_eq!(whole, WorkEstimate { trials: 6, steps, fits, core_secs });
        assert_eq!(*timed.lock().unwrap(), [2], "trainings of one kind are timed once");
        let done = runs.path().join(&trials[0].id);
        std::fs::create_dir_all(&done).unwrap();
        std::fs::write(done.join(crate::outcome::RESULT), "{}").unwrap();
        assert_eq!(estimate().trials, 5);
    }

    const SMALL: &str = r#"
        title = "Small"
        source = "a test"
        finding = "none"
        songs = ["twinkle"]
        seeds = 3
        preset = "paper"
        set = ["trainer.num_envs=2", "trainer.total_steps=1000"]
        [[variants]]
        name = "rehearsed"
        [[variants]]
        name = "trained"
        set = ["task.reward.collision=0"]
        twin_params = []
        [rehearse]
        modes = ["real"]
        fits = ["bo", "lm", "none"]
        iterations = 2
        runs = 1
        steps = 500
        twin_params = ["standard", "worn"]
    "#;
}
