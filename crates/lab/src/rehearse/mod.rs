//! Sim2Real2Sim: record, identify, train, perform, in iterations (paper, "Sim2Real2Sim").
//!
//! ```text
//! DIR/rehearsal.json              the configuration
//! DIR/excitation/*.mcap           the robot in each excitation
//! DIR/iteration-0/                performance of the policy from the default simulator
//! DIR/iteration-N/identified/     the simulator fitted to the excitations and to the performances
//!                                 of the iteration before
//! DIR/iteration-N/training/       the best policy so far, trained further in that simulator
//! DIR/iteration-N/performance/    numbered performances on the robot; recordings, MIDI and sound
//! DIR/iteration-N/iteration.json  the result of the iteration; written last
//! ```
//!
//! A part gets its final name only when it is complete, and a complete part is not made again. So
//! the same command resumes a rehearsal that was stopped at any point, also by kill -9.

mod iteration;
mod prediction;

use std::path::{Path, PathBuf};

use etude_identify::{MotionError, Progress, RecordedMotion};
use etude_music::Song;
use etude_perform::session::RigChoice;
use etude_perform::{Excitation, Job};
use etude_task::TaskError;

use crate::config::resolve;
use crate::errors::{Interrupted, unusable};
use crate::excitations::record_excitations;
use crate::folder::make_folder;
use crate::identify::{Identification, IdentifyMethod, IdentifyReport, identify_robot};
use crate::json_files::{load, save_pretty};
use crate::loaded_player::load_player;
use crate::robot::{RobotPlay, RobotReport, RobotStep, all_complete, play_on_robot};
use crate::song_planner::SongPlanner;
use crate::training::Training;
use crate::training_progress::TrainingProgress;
use crate::warm_start::beginning_with;

pub use iteration::{Iteration, RehearsalConfig, RehearsalFit, best_iteration, set_latency_compensation};
pub use prediction::Prediction;

/// Name of the result of an iteration in its folder.
const RESULT: &str = "iteration.json";

/// What a rehearsal reports.
#[derive(Clone, Debug)]
pub enum RehearsalStep {
    /// An excitation was recorded: which, its number from 1, and how many there are.
    Recorded(Excitation, [usize; 2]),
    /// The fit leaves out a performance.
    LeftOut {
        /// Its recording.
        recording: PathBuf,
        /// Why.
        why: String,
    },
    /// The fit of an iteration has advanced.
    Identifying(usize, Progress),
    /// The training of an iteration has advanced.
    Training(usize, TrainingProgress),
    /// The playing of an iteration has advanced.
    Playing(usize, RobotStep),
    /// An iteration is complete, now or since an earlier call.
    Iteration(Iteration),
}

/// Rehearses `song` on a robot in `folder`, or resumes there.
///
/// # Errors
/// If any part fails; what is complete is kept. [`Interrupted`] if the job is interrupted.
pub fn rehearse_on_robot(
    song: &Song,
    rig: &RigChoice,
    config: &RehearsalConfig,
    folder: &Path,
    job: &mut Job<'_, RehearsalStep>,
) -> anyhow::Result<Vec<Iteration>> {
    let task = resolve(&config.preset, config.simulator.as_deref(), &config.overrides)?.task;
    let rig = &rig.for_simulator(&task.params().map_err(TaskError::from)?);
    let rehearsal = Rehearsal { song, rig, config, folder };
    rehearsal.open()?;
    let mut iterations: Vec<Iteration> = Vec::new();
    for iteration in 0..=config.iterations {
        // It may be complete since an earlier call.
        let done = match load(&rehearsal.iteration_folder(iteration).join(RESULT))? {
            Some(done) => done,
            None => rehearsal.iterate(iteration, &iterations, job)?,
        };
        job.report(&RehearsalStep::Iteration(done.clone()));
        iterations.push(done);
    }
    Ok(iterations)
}

struct Rehearsal<'a> {
    song: &'a Song,
    rig: &'a RigChoice,
    config: &'a RehearsalConfig,
    folder: &'a Path,
}

impl Rehearsal<'_> {
    /// Makes the folder, or checks that it holds the same rehearsal.
    fn open(&self) -> anyhow::Result<()> {
        let file = self.folder.join("rehearsal.json");
        if let Some(stored) = load::<RehearsalConfig>(&file)? {
            // The number of iterations may change, and threads do not shape the result.
            let RehearsalConfig { iterations, threads, .. } = *self.config;
            if (RehearsalConfig { iterations, threads, ..stored }) != *self.config {
                return Err(unusable(self.folder, "it holds another rehearsal, with other settings"));
            }
        }
        make_folder(self.folder)?;
        save_pretty(&file, self.config)
    }

    fn iteration_folder(&self, iteration: usize) -> PathBuf {
        self.folder.join(format!("iteration-{iteration}"))
    }

    fn iterate(
        &self,
        iteration: usize,
        earlier: &[Iteration],
        job: &mut Job<'_, RehearsalStep>,
    ) -> anyhow::Result<Iteration> {
        let folder = self.iteration_folder(iteration);
        make_folder(&folder)?;
        let (mut held_out_rad, mut prediction) = (None, None);
        let (mut physics, mut layer) = (Default::default(), None);
        if let (Some(before), Some(method)) = (earlier.last(), self.config.fit.method()) {
            let report = self.identify(iteration, before, method, &folder.join("identified"), job)?;
            let errors = report.held_out_errors;
            held_out_rad = (!errors.joints.is_empty()).then_some(errors.fingers);
            physics = report.identified.physics;
            prediction = Some(Prediction::of(self.song, &before.policy, &before.scores, &physics)?);
            layer = Some(report.file);
        }
        let policy = match (&self.config.policy, best_iteration(earlier)) {
            (Some(policy), None) => policy.clone(),
            (_, best) => self.train(iteration, layer.as_deref(), best, job)?,
        };
        let report = self.play(iteration, &policy, &folder.join("performance"), job)?;
        let recordings = report.runs.into_iter().filter_map(|run| run.files).map(|files| files.recording);
        let done = Iteration {
            iteration,
            scores: report.scores,
            held_out_rad,
            prediction,
            policy,
            recordings: recordings.collect(),
            physics,
        };
        save_pretty(&folder.join(RESULT), &done)?;
        // The next iteration begins with the networks. If it cannot be removed, it only takes up
        // space.
        let _ = std::fs::remove_dir_all(folder.join("training/checkpoints/replay"));
        Ok(done)
    }

    /// Fits the simulator to the excitations and to the performances of the iteration before.
    fn identify(
        &self,
        iteration: usize,
        before: &Iteration,
        method: IdentifyMethod,
        folder: &Path,
        job: &mut Job<'_, RehearsalStep>,
    ) -> anyhow::Result<IdentifyReport> {
        // The paper's first fit is to hand opening and closing alone.
        let uses_played = method == IdentifyMethod::Lm || iteration > 1 || self.config.simulator.is_some();
        let mut performances = Vec::new();
        for path in before.recordings.iter().filter(|_| uses_played) {
            // A recording may mislead the fit: a policy at the start of its training pushes against
            // the joints' stops.
            match RecordedMotion::load(path) {
                Err(MotionError::Unsuitable { path, why }) => {
                    job.report(&RehearsalStep::LeftOut { recording: path, why });
                }
                Err(error) => return Err(error.into()),
                Ok(_) => performances.push(path.clone()),
            }
        }
        // The excitations are the same in each iteration. Once our own fit has fitted the drives to
        // them, the keyboard is left: only its own excitation, the held-out one and the new
        // performances are needed. The paper's begins with hand opening and closing alone, and
        // refines the drives by what was played.
        let fitted_before = (iteration > 1 || self.config.simulator.is_some()) && !performances.is_empty();
        let wanted: &[Excitation] = match method {
            IdentifyMethod::Bo => &[Excitation::OpenClose, Excitation::HeldOut],
            IdentifyMethod::Lm if fitted_before => &[Excitation::Keys, Excitation::HeldOut],
            IdentifyMethod::Lm => &Excitation::ALL,
        };
        let excitations = record_excitations(
            self.rig,
            wanted,
            &self.folder.join("excitation"),
            self.config.seed.wrapping_add(500),
            job.interrupt(),
            &mut |excitation, number| job.report(&RehearsalStep::Recorded(excitation, number)),
        )?;
        let start = match &self.config.simulator {
            Some(file) if iteration == 1 => {
                resolve(&self.config.preset, Some(file), &self.config.overrides)?.task.physics
            }
            _ => before.physics.clone(),
        };
        let what = Identification {
            recordings: excitations.into_iter().chain(performances).collect(),
            held_out: Vec::new(),
            method,
            evaluations: self.config.evaluations,
            seed: self.config.seed,
            start,
        };
        job.part(
            |at: &Progress| RehearsalStep::Identifying(iteration, at.clone()),
            |job| identify_robot(&what, folder, job),
        )
    }

    /// Trains in the simulator of `layer`, from what the best iteration so far has learned, for the
    /// steps of the preset; resumes a training that was interrupted.
    fn train(
        &self,
        iteration: usize,
        layer: Option<&Path>,
        best: Option<&Iteration>,
        job: &mut Job<'_, RehearsalStep>,
    ) -> anyhow::Result<PathBuf> {
        let folder = self.iteration_folder(iteration).join("training");
        let mut config = resolve(&self.config.preset, layer, &self.config.overrides)?;
        config.trainer.threads = self.config.threads.unwrap_or(config.trainer.threads);
        let source = best.map(|best| best.policy.as_path());
        if let Some(source) = source {
            config = beginning_with(config, source);
        }
        let command = format!("etude rehearse, iteration {iteration}");
        let song = config.corpus.is_none().then(|| self.song.clone());
        let mut run =
            Training::start_or_resume(song, config, &folder, &command, source, &mut SongPlanner::default())?;
        let to_step = |at: &TrainingProgress| RehearsalStep::Training(iteration, *at);
        if job.part(to_step, |job| run.run_job(job))?.stopped.is_some() {
            return Err(Interrupted::resumable().into());
        }
        Ok(folder)
    }

    /// Plays the song on the robot: once to measure how late its notes are, unless the settings
    /// have the latency compensation, and then the runs of the iteration.
    fn play(
        &self,
        iteration: usize,
        policy: &Path,
        folder: &Path,
        job: &mut Job<'_, RehearsalStep>,
    ) -> anyhow::Result<RobotReport> {
        let player = load_player(policy)?;
        let play = RobotPlay {
            runs: self.config.runs,
            seed: self.config.seed.wrapping_add(1000 * iteration as u64),
            measures_lag: !set_latency_compensation(&self.config.overrides),
            ..RobotPlay::new(self.song, &player, self.rig, self.config.mode)
        };
        let to_step = |step: &RobotStep| RehearsalStep::Playing(iteration, step.clone());
        let played =
            job.part(to_step, |job| play_on_robot(&play, Some(folder), &mut SongPlanner::default(), job));
        all_complete(played, job.is_interrupted(), &format!("iteration {iteration}"))
    }
}
