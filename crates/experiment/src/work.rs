//! Doing a trial in its folder. It resumes where it was stopped, ends with one file that appears complete, and is done only once.
//!
//! ```text
//! RUNS/ID/task.json     the trial
//! RUNS/ID/training/     the run, if something is learned
//! RUNS/ID/rehearsal/    the rehearsal, if it is one
//! RUNS/ID/recordings/   excitations of the twin, and RUNS/ID/identified/, if the simulator is fitted
//! RUNS/ID/log.txt       messages of the trial's process
//! RUNS/ID/times.json    when, where and how long: this differs between machines
//! RUNS/ID/result.json   the result, the same however the trial was run; written last
//! ```

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use etude_identify::Progress;
use etude_lab::machine::processor;
use etude_lab::{
    Identification, IdentifyMethod, Pianist, Planner, RehearsalConfig, RehearsalStep, RobotPlay, Run,
    TrainingProgress, find_song, identify_robot, load_pianist, play_on_robot, record_excitations,
    rehearse_on_robot, scores_in_simulation,
};
use etude_learn::Score;
use etude_music::Song;
use etude_perform::session::{TWIN, rig_choice, unix_secs};
use etude_perform::{Excitation, Job, Mode, Scores, gap, write_file};
use etude_show::RehearsalPage;
use serde::Serialize;

use crate::config::PerformConfig;
use crate::course::{Course, evaluations};
use crate::outcome::{
    LOCK, RESULT, Row, TIMES, TRIAL, TrialEnd, TrialProgress, TrialResult, TrialTimes, Values, file_error,
};
use crate::pieces::{piece_called, player_called};
use crate::trial::{TrainingConfig, Trial, Work};

const COURSE: &str = "course.jsonl";
/// Attempts to take the lock of a trial.
const ATTEMPTS: u32 = 10;
/// Message of a trial that was interrupted; [`run_trial`] makes an outcome of it.
const STOPPED: &str = "stopped on request";
/// Distance between the seeds of the twin's noise from one trial seed to the next.
const SEEDS_OF_RUNS: u64 = 1000;
/// Share of a trial's time that the training takes where a performance follows.
const TRAINING_SHARE: f64 = 0.9;

/// Does a trial in its folder among `runs`, or resumes it. `threads` as in `trainer.threads`; `command` is stored with the times.
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
    // `TrialState::of` holds the lock for a moment. Where the file system has no locks, every process gets it.
    let mut attempts = 1;
    while matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
        if attempts == ATTEMPTS {
            return Ok(TrialEnd::Busy);
        }
        attempts += 1;
        std::thread::sleep(Duration::from_millis(100));
    }
    // The process that held the lock may have finished the trial.
    if is_done() {
        return Ok(TrialEnd::Done);
    }
    // The same work may be written in other words. A rehearsal that was begun keeps its words.
    let begun: Option<Trial> =
        std::fs::read(folder.join(TRIAL)).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let trial = begun.as_ref().filter(|begun| begun.id == trial.id).unwrap_or(trial);
    write_json(&folder.join(TRIAL), trial)?;
    let mut doing = Doing { trial, folder: &folder, threads, command, job };
    let done = match &trial.work {
        Work::Train { training, perform } => doing.train_and_perform(training, perform.as_ref()),
        Work::Play { song, player, perform, seed } => doing.play(song, player, perform.as_ref(), *seed),
        Work::Rehearse { training, mode, rounds, runs, truth, evaluations } => {
            doing.rehearse(training, *mode, [*rounds, *runs], truth, *evaluations)
        }
        Work::Identify { truth, method, evaluations, seed } => {
            doing.identify(truth, *method, *evaluations, *seed)
        }
    };
    let (result, times) = match done {
        // An interruption may also show as an error, for example while the twin moves to the keyboard.
        Err(_) if doing.job.is_interrupted() => return Ok(TrialEnd::Stopped),
        done => done?,
    };
    write_json(&folder.join(TIMES), &times)?;
    write_json(&folder.join(RESULT), &result)?;
    Ok(TrialEnd::Done)
}

fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    Ok(write_file(path, &(serde_json::to_string_pretty(value)? + "\n"))?)
}

/// A trial under way.
struct Doing<'a, 'b> {
    trial: &'a Trial,
    folder: &'a Path,
    threads: usize,
    command: &'a str,
    job: &'a mut Job<'b, TrialProgress>,
}

impl Doing<'_, '_> {
    fn tell(&mut self, phase: &str, share: f64, f1: Option<f64>) {
        self.job.report(&TrialProgress { phase: phase.to_string(), share, f1 });
    }

    fn result(&self, rows: Vec<Row>, course: Vec<Values>) -> TrialResult {
        TrialResult { id: self.trial.id.clone(), rows, course }
    }

    fn times(&self, secs: f64, course_secs: Vec<f64>) -> TrialTimes {
        TrialTimes {
            secs,
            course_secs,
            etude: env!("CARGO_PKG_VERSION").to_string(),
            mujoco: etude_stage::mujoco_version().to_string(),
            machine: processor(),
            cores: std::thread::available_parallelism().map_or(0, usize::from),
            unix_secs: unix_secs(),
            command: self.command.to_string(),
        }
    }

    fn train_and_perform(
        &mut self,
        training: &TrainingConfig,
        perform: Option<&PerformConfig>,
    ) -> anyhow::Result<(TrialResult, TrialTimes)> {
        let song = training.song.as_deref().map(piece_called).transpose()?;
        let folder = self.folder.join("training");
        let mut config = training.resolve()?;
        config.trainer.threads = self.threads;
        let seed = config.trainer.seed;
        let source = training.source()?;
        let mut run = Run::start_or_resume(
            song.clone(),
            config,
            &folder,
            self.command,
            source.as_deref(),
            &mut Planner::default(),
        )?;
        let share = if perform.is_some() { TRAINING_SHARE } else { 1.0 };
        let told = |at: &TrainingProgress| TrialProgress {
            phase: "training".to_string(),
            share: share * at.share(),
            f1: at.best_f1,
        };
        let outcome = self.job.part(told, |job| run.run_job(job))?;
        let best = run.best_scores().to_vec();
        drop(run);
        if outcome.stopped.is_some() {
            bail!(STOPPED);
        }
        let rows = match &song {
            Some(song) => self.scores(song, &load_pianist(&folder)?, perform, seed, share)?,
            None => vec![row(&[], &of_validation(&best))],
        };
        let (course, secs) = evaluations(&folder.join("metrics.jsonl"))?;
        Ok((self.result(rows, course), self.times(outcome.elapsed_secs, secs)))
    }

    fn play(
        &mut self,
        song: &str,
        player: &str,
        perform: Option<&PerformConfig>,
        seed: u64,
    ) -> anyhow::Result<(TrialResult, TrialTimes)> {
        let begun = Instant::now();
        let rows = self.scores(&piece_called(song)?, &player_called(player)?, perform, seed, 0.0)?;
        Ok((self.result(rows, Vec::new()), self.times(begun.elapsed().as_secs_f64(), Vec::new())))
    }

    /// Scores of a player in simulation and, with `perform`, of each of its runs on the twin. `share` of the trial is done before.
    fn scores(
        &mut self,
        song: &Song,
        pianist: &Pianist,
        perform: Option<&PerformConfig>,
        seed: u64,
        share: f64,
    ) -> anyhow::Result<Vec<Row>> {
        let mut planner = Planner::default();
        let piece = planner.plan(song, &pianist.config.task)?;
        let Scores { frame: sim, note: sim_note } = scores_in_simulation(pianist, &piece, &mut planner)?;
        let of_sim = [
            ("sim_f1", sim.f1),
            ("sim_precision", sim.precision),
            ("sim_recall", sim.recall),
            ("sim_onset_f1", sim_note.onset_f1),
        ];
        let mut rows = Vec::new();
        match perform {
            None => rows.push(row(&[], &of_sim)),
            Some(perform) => {
                let modes = |truth| perform.modes.iter().map(move |mode| (truth, mode));
                let all: Vec<(&String, &Mode)> = perform.truths.iter().flat_map(modes).collect();
                for (index, (truth, mode)) in all.iter().enumerate() {
                    let at = share + (1.0 - share) * index as f64 / all.len() as f64;
                    self.tell(&format!("playing, {mode}, {truth}"), at, Some(sim.f1));
                    let rig = rig_choice(TWIN, truth)?;
                    let seed = SEEDS_OF_RUNS.wrapping_mul(seed);
                    let play = RobotPlay {
                        song,
                        pianist,
                        rig: &rig,
                        mode: **mode,
                        runs: perform.runs,
                        home: true,
                        seed,
                        measures_lag: !self.trial.sets_the_lead(),
                        correction: None,
                        font: None,
                    };
                    let report = play_on_robot(
                        &play,
                        None,
                        &mut planner,
                        &mut Job::new(&mut |_| {}, self.job.interrupt()),
                    )?;
                    if self.job.is_interrupted() {
                        bail!(STOPPED);
                    }
                    for (run, played) in report.runs.iter().enumerate() {
                        let frame = &played.scores.frame;
                        let whole = if played.steps[0] == played.steps[1] { 1.0 } else { 0.0 };
                        let lag = played.scores.note.lag_secs.map(|lag| ("lag_secs", lag));
                        let of_twin = [
                            ("latency_compensation_secs", report.latency_compensation_secs),
                            ("f1", frame.f1),
                            ("precision", frame.precision),
                            ("recall", frame.recall),
                            ("onset_f1", played.scores.note.onset_f1),
                            ("onset_f1_without_lag", played.scores.note.onset_f1_without_lag),
                            ("gap", gap(sim.f1, frame.f1)),
                            ("complete", whole),
                        ];
                        let labels = [
                            ("truth", (*truth).clone()),
                            ("mode", mode.name().to_string()),
                            ("run", run.to_string()),
                        ];
                        rows.push(row(&labels, &[of_sim.as_slice(), &of_twin, lag.as_slice()].concat()));
                    }
                }
            }
        }
        Ok(rows)
    }

    fn rehearse(
        &mut self,
        training: &TrainingConfig,
        mode: Mode,
        [rounds, runs]: [usize; 2],
        truth_name: &str,
        evaluations: Option<u64>,
    ) -> anyhow::Result<(TrialResult, TrialTimes)> {
        let begun = Instant::now();
        let name = training.song.clone().context("a rehearsal needs a song")?;
        let song = find_song(&name)?;
        let rig = rig_choice(TWIN, truth_name)?;
        let config = RehearsalConfig {
            song: name,
            rig: rig.name().to_string(),
            twin_params: Some(truth_name.to_string()),
            iterations: rounds,
            runs,
            mode,
            preset: training.preset.clone(),
            overrides: training.set.clone(),
            policy: None,
            simulator: None,
            method: IdentifyMethod::Lm,
            evaluations,
            seed: training.resolve()?.trainer.seed,
            threads: Some(self.threads),
            keep_replay: false,
        };
        let (folder, interrupt) = (self.folder.join("rehearsal"), self.job.interrupt());
        let parts = (rounds + 1) as f64;
        let mut page = RehearsalPage::new(&config, &folder);
        let mut tell = |step: &RehearsalStep| match step {
            RehearsalStep::Identifying(round, at) => {
                self.tell(&format!("round {round}: {}", at.pass.name()), *round as f64 / parts, None);
            }
            RehearsalStep::Training(round, at) => {
                let share = (*round as f64 + at.share()) / parts;
                self.tell(&format!("round {round}: training"), share, at.best_f1);
            }
            RehearsalStep::Iteration(iteration) => page.add(iteration),
            _ => {}
        };
        let rounds = rehearse_on_robot(&song, &rig, &config, &folder, &mut Job::new(&mut tell, interrupt))?;
        page.checked()?;
        let rows = rounds.iter().map(|round| {
            let mut values = vec![
                ("sim_f1", round.sim_f1),
                ("f1", round.robot_f1),
                ("onset_f1", round.notes.onset_f1),
                ("onset_f1_without_lag", round.notes.onset_f1_without_lag),
                ("gap", gap(round.sim_f1, round.robot_f1)),
            ];
            if let Some([before, after]) = round.held_out_rad {
                values.extend([("held_out_before", before), ("held_out_after", after)]);
            }
            row(&[("round", round.iteration.to_string())], &values)
        });
        Ok((self.result(rows.collect(), Vec::new()), self.times(begun.elapsed().as_secs_f64(), Vec::new())))
    }

    fn identify(
        &mut self,
        truth: &str,
        method: IdentifyMethod,
        evaluations: Option<u64>,
        seed: u64,
    ) -> anyhow::Result<(TrialResult, TrialTimes)> {
        let rig = rig_choice(TWIN, truth)?;
        let excitations = self.folder.join("recordings");
        let interrupt = self.job.interrupt();
        self.tell("recording", 0.0, None);
        let seed_of_runs = SEEDS_OF_RUNS.wrapping_mul(seed);
        let recordings = record_excitations(
            &rig,
            &Excitation::ALL,
            &excitations,
            seed_of_runs,
            interrupt,
            &mut |_, _| {},
        )?;
        let what = Identification {
            recordings,
            held_out: Vec::new(),
            method,
            evaluations,
            seed,
            start: BTreeMap::new(),
        };
        let folder = self.folder.join("identified");
        let mut course = Course::open(&self.folder.join(COURSE))?;
        let mut written = Ok(());
        let mut tell = |at: &Progress| {
            let share = at.ended[0] as f64 / at.ended[1].max(1) as f64;
            self.tell(at.pass.name(), share, None);
            if written.is_ok() {
                written = course.add(at);
            }
        };
        let report = identify_robot(&what, &folder, &mut Job::new(&mut tell, interrupt))?;
        written?;
        let errors = &report.held_out_errors;
        let replays: u64 = report.identified.passes.iter().map(|end| end.replays).sum();
        let secs: f64 = report.identified.passes.iter().map(|end| end.secs).sum();
        let values = [
            ("held_out_before", errors.fingers[0]),
            ("held_out_after", errors.fingers[1]),
            ("noise", errors.fingers_noise),
            ("times_less", errors.fingers[0] / errors.fingers[1]),
            ("replays", replays as f64),
        ];
        Ok((self.result(vec![row(&[], &values)], course.points), self.times(secs, Vec::new())))
    }
}

/// Names of a score on the pieces of a corpus, in a training's evaluations and among the measures.
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

fn row(labels: &[(&str, String)], values: &[(&str, f64)]) -> Row {
    Row {
        labels: labels.iter().map(|(key, value)| (key.to_string(), value.clone())).collect(),
        // JSON has no infinities: a measure that is not finite is left out.
        values: values
            .iter()
            .filter(|(_, value)| value.is_finite())
            .map(|(key, value)| (key.to_string(), *value))
            .collect(),
    }
}
