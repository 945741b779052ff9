//! Doing a trial in its folder. It resumes where it was stopped, ends with one file that appears
//! complete, and is done only once.
//!
//! ```text
//! RUNS/ID/task.json     the trial
//! RUNS/ID/training/     the run, if something is learned
//! RUNS/ID/rehearsal/    the rehearsals, if there are any, by twin, mode and fit
//! RUNS/ID/recordings/   excitations of the twin, and RUNS/ID/identified/, of a fit
//! RUNS/ID/log.txt       messages of the trial's process
//! RUNS/ID/times.json    when, where and how long: this differs between machines
//! RUNS/ID/result.json   the result, the same however the trial was run; written last
//! ```

mod sim2real2sim;

use std::fs::{File, TryLockError};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::bail;
use etude_lab::{
    LoadedPlayer, RobotPlay, SongPlanner, Training, TrainingProgress, load_player, play_on_robot,
    scores_in_simulation,
};
use etude_learn::Score;
use etude_music::Song;
use etude_perform::session::{TWIN, rig_choice};
use etude_perform::{Job, Mode, Scores, gap, write_file};
use serde::Serialize;

use crate::config::{PerformConfig, RehearseConfig};
use crate::curves::evaluations;
use crate::outcome::{
    LOCK, RESULT, ResultRow, TIMES, TRIAL, TrialEnd, TrialProgress, TrialResult, TrialTimes, Values,
    file_error,
};
use crate::playing::{find_piece, find_player};
use crate::trial::{TrainingConfig, Trial, TrialWork};

/// Attempts to take the lock of a trial.
const MAX_ATTEMPTS: u32 = 10;
/// Time between two of them.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Message of a trial that was interrupted; [`run_trial`] makes an outcome of it.
const STOPPED: &str = "stopped on request";
/// Distance between the seeds of the twin's noise from one trial seed to the next.
const SEED_STRIDE: u64 = 1000;
/// Share of a trial's time that the training takes where a performance follows.
const TRAINING_SHARE: f64 = 0.9;
/// The same where rehearsals follow.
const TRAINING_AND_REHEARSALS_SHARE: f64 = 0.3;

/// Does a trial in its folder among `runs`, or resumes it. `threads` as in `trainer.threads`;
/// `command` is stored with the times.
///
/// # Errors
/// If it fails; what is complete is kept, and the same call tries again.
pub fn run_trial(
    trial: &Trial,
    runs: &Path,
    threads: usize,
    command: &str,
    job: &mut Job<'_, TrialProgress>,
) -> anyhow::Result<TrialEnd> {
    // An interrupted fit finds its recordings by path, which must not depend on the working folder.
    let runs = std::path::absolute(runs).map_err(|error| file_error(runs, &error))?;
    let folder = runs.join(&trial.id);
    let is_done = || folder.join(RESULT).is_file();
    if is_done() {
        return Ok(TrialEnd::Done);
    }
    std::fs::create_dir_all(&folder).map_err(|error| file_error(&folder, &error))?;
    let path = folder.join(LOCK);
    let lock = File::create(&path).map_err(|error| file_error(&path, &error))?;
    // `TrialState::of` holds the lock for a moment. Where the file system has no locks, every
    // process gets it.
    let mut attempts = 1;
    while matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
        if attempts == MAX_ATTEMPTS {
            return Ok(TrialEnd::Busy);
        }
        attempts += 1;
        std::thread::sleep(POLL_INTERVAL);
    }
    // The process that held the lock may have finished the trial.
    if is_done() {
        return Ok(TrialEnd::Done);
    }
    // The same work may be written in other words. A rehearsal that was begun keeps its own.
    let begun: Option<Trial> =
        std::fs::read(folder.join(TRIAL)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let trial = begun.as_ref().filter(|begun| begun.id == trial.id).unwrap_or(trial);
    write_json(&folder.join(TRIAL), trial)?;
    let mut running = RunningTrial { trial, folder: &folder, threads, command, job };
    let done = match &trial.work {
        TrialWork::Train { training, perform, rehearse } => {
            running.train(training, perform.as_ref(), rehearse.as_ref())
        }
        TrialWork::Play { song, player, perform, seed } => {
            running.play(song, player, perform.as_ref(), *seed)
        }
        TrialWork::Identify { twin_params, method, evaluations, seed } => {
            running.identify(twin_params, *method, *evaluations, *seed)
        }
    };
    let (result, times) = match done {
        // An interruption may also show as an error, for example while the twin moves to the
        // keyboard.
        Err(_) if running.job.is_interrupted() => return Ok(TrialEnd::Stopped),
        done => done?,
    };
    write_json(&folder.join(TIMES), &times)?;
    write_json(&folder.join(RESULT), &result)?;
    Ok(TrialEnd::Done)
}

/// Name of the processor, or its architecture where the system does not report it.
fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let mut fields = text.lines().filter_map(|line| line.split_once(':'));
    let name = fields.find(|(key, _)| key.trim() == "model name");
    name.map_or_else(|| std::env::consts::ARCH.to_string(), |(_, name)| name.trim().to_string())
}

fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    Ok(write_file(path, &(serde_json::to_string_pretty(value)? + "\n"))?)
}

/// A trial under way.
struct RunningTrial<'a, 'b> {
    trial: &'a Trial,
    folder: &'a Path,
    threads: usize,
    command: &'a str,
    job: &'a mut Job<'b, TrialProgress>,
}

impl RunningTrial<'_, '_> {
    fn report(&mut self, phase: &str, share: f64, f1: Option<f64>) {
        self.job.report(&TrialProgress { phase: phase.to_string(), share, f1 });
    }

    fn result(&self, rows: Vec<ResultRow>, curve: Vec<Values>) -> TrialResult {
        TrialResult { id: self.trial.id.clone(), rows, curve }
    }

    fn times(&self, secs: f64, curve_secs: Vec<f64>) -> TrialTimes {
        TrialTimes {
            secs,
            curve_secs,
            etude: env!("CARGO_PKG_VERSION").to_string(),
            mujoco: etude_stage::mujoco_version().to_string(),
            machine: processor(),
            cores: std::thread::available_parallelism().map_or(0, usize::from),
        }
    }

    fn train(
        &mut self,
        training: &TrainingConfig,
        perform: Option<&PerformConfig>,
        rehearse: Option<&RehearseConfig>,
    ) -> anyhow::Result<(TrialResult, TrialTimes)> {
        let song = training.song.as_deref().map(find_piece).transpose()?;
        let folder = self.folder.join("training");
        let mut config = training.resolve()?;
        config.trainer.threads = self.threads;
        let seed = config.trainer.seed;
        let source = training.source()?;
        let mut run = Training::start_or_resume(
            song.clone(),
            config,
            &folder,
            self.command,
            source.as_deref(),
            &mut SongPlanner::default(),
        )?;
        let share = match (perform, rehearse) {
            (_, Some(_)) => TRAINING_AND_REHEARSALS_SHARE,
            (Some(_), None) => TRAINING_SHARE,
            (None, None) => 1.0,
        };
        let on_progress = |at: &TrainingProgress| TrialProgress {
            phase: "training".to_string(),
            share: share * at.share(),
            f1: at.best_f1,
        };
        let outcome = self.job.part(on_progress, |job| run.run_job(job))?;
        let best = run.best_scores().to_vec();
        drop(run);
        if outcome.stopped.is_some() {
            bail!(STOPPED);
        }
        let rows = match (&song, rehearse) {
            (Some(_), Some(rehearse)) => self.rehearse_on_twins(training, rehearse, seed)?,
            (Some(song), _) => self.scores(song, &load_player(&folder)?, perform, seed, share)?,
            (None, _) => vec![result_row(&[], &of_validation(&best))],
        };
        let (curve, secs) = evaluations(&folder.join("metrics.jsonl"))?;
        Ok((self.result(rows, curve), self.times(outcome.elapsed_secs, secs)))
    }

    fn play(
        &mut self,
        song: &str,
        player: &str,
        perform: Option<&PerformConfig>,
        seed: u64,
    ) -> anyhow::Result<(TrialResult, TrialTimes)> {
        let begun = Instant::now();
        let rows = self.scores(&find_piece(song)?, &find_player(player)?, perform, seed, 0.0)?;
        Ok((self.result(rows, Vec::new()), self.times(begun.elapsed().as_secs_f64(), Vec::new())))
    }

    /// Scores of a player in simulation and, with `perform`, of each of its runs on the twin.
    /// Before that this `share` of the trial is done.
    fn scores(
        &mut self,
        song: &Song,
        player: &LoadedPlayer,
        perform: Option<&PerformConfig>,
        seed: u64,
        share: f64,
    ) -> anyhow::Result<Vec<ResultRow>> {
        let mut planner = SongPlanner::default();
        let piece = planner.plan(song, &player.config.task)?;
        let Scores { frame: sim, note: sim_note, .. } = scores_in_simulation(player, &piece, &mut planner)?;
        let of_sim = [
            ("sim_f1", sim.f1),
            ("sim_precision", sim.precision),
            ("sim_recall", sim.recall),
            ("sim_onset_f1", sim_note.onset_f1),
        ];
        let Some(perform) = perform else { return Ok(vec![result_row(&[], &of_sim)]) };
        let mut rows = Vec::new();
        let modes = |twin_params| perform.modes.iter().map(move |mode| (twin_params, mode));
        let all: Vec<(&String, &Mode)> = perform.twin_params.iter().flat_map(modes).collect();
        for (index, (twin_params, mode)) in all.iter().enumerate() {
            let at = share + (1.0 - share) * index as f64 / all.len() as f64;
            self.report(&format!("playing, {mode}, {twin_params}"), at, Some(sim.f1));
            let rig = rig_choice(TWIN, twin_params)?;
            let play = RobotPlay {
                runs: perform.runs,
                seed: SEED_STRIDE.wrapping_mul(seed),
                measures_lag: !self.trial.sets_latency_compensation(),
                ..RobotPlay::new(song, player, &rig, **mode)
            };
            let on_progress = &mut |_: &_| {};
            let mut job = Job::new(on_progress, self.job.interrupt());
            let report = play_on_robot(&play, None, &mut planner, &mut job)?;
            if self.job.is_interrupted() {
                bail!(STOPPED);
            }
            if let Some(why) = &report.not_played {
                bail!("{why}");
            }
            for (run, played) in report.runs.iter().enumerate() {
                let Scores { frame, note, .. } = &played.scores;
                let is_complete = played.steps[0] == played.steps[1];
                let lag = note.lag_secs.map(|lag| ("lag_secs", lag));
                let before = report.uncompensated.map(|scores| ("uncompensated_f1", scores.frame.f1));
                let of_twin = [
                    ("latency_compensation_secs", report.scores.latency_compensation_secs),
                    ("f1", frame.f1),
                    ("precision", frame.precision),
                    ("recall", frame.recall),
                    ("onset_f1", note.onset_f1),
                    ("onset_f1_without_lag", note.onset_f1_without_lag),
                    ("notes_right", note.matched as f64),
                    ("notes_wrong", note.wrong as f64),
                    ("gap", gap(sim.f1, frame.f1)),
                    ("complete", f64::from(u8::from(is_complete))),
                ];
                let labels = [
                    ("twin_params", twin_params.to_string()),
                    ("mode", mode.name().to_string()),
                    ("run", run.to_string()),
                ];
                rows.push(result_row(
                    &labels,
                    &[of_sim.as_slice(), &of_twin, lag.as_slice(), before.as_slice()].concat(),
                ));
            }
        }
        Ok(rows)
    }
}

/// Names of a score on the pieces of a corpus: in a training's evaluations, and among the measures.
const OF_VALIDATION: [(&str, &str); 4] = [
    ("f1", "sim_f1"),
    ("precision", "sim_precision"),
    ("recall", "sim_recall"),
    ("onset_f1", "sim_onset_f1"),
];

/// The measures of the best policy of a corpus' training, on the validation pieces.
fn of_validation(best: &[Score]) -> Vec<(&'static str, f64)> {
    let score = |(name, measure)| Some((measure, best.iter().find(|score| score.name == name)?.value));
    OF_VALIDATION.into_iter().filter_map(score).collect()
}

fn result_row(labels: &[(&str, String)], values: &[(&str, f64)]) -> ResultRow {
    ResultRow {
        labels: labels.iter().map(|(key, value)| (key.to_string(), value.clone())).collect(),
        // JSON has no infinities: a measure that is not finite is left out.
        values: values
            .iter()
            .filter(|(_, value)| value.is_finite())
            .map(|(key, value)| (key.to_string(), *value))
            .collect(),
    }
}
