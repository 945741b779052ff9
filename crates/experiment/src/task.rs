//! One task in its folder: it goes on where it was stopped, ends with one file that appears whole, and is done only once.
//!
//! ```text
//! RUNS/ID/task.json     what is done
//! RUNS/ID/training/     the run, if something is learned
//! RUNS/ID/rehearsal/    the rehearsal, if it is one
//! RUNS/ID/recordings/   excitations of the twin, and RUNS/ID/identified/, if the simulator is fitted
//! RUNS/ID/log.txt       what the launcher's process said
//! RUNS/ID/times.json    when, where and how long: what differs between machines
//! RUNS/ID/result.json   what came of it, the same however it was run; written last
//! ```

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use crate::config::PerformConfig;
use crate::course::{Course, evaluations};
use crate::outcome::{LOCK, RESULT, Row, TASK, TIMES, TaskEnd, TaskProgress, TaskResult, TaskTimes, Values};
use crate::plan::{Task, TrainingConfig, TrainingConfigError, Work};
use etude_identify::{IdentifyError, Progress};
use etude_lab::PlayError;
use etude_lab::bench::processor;
use etude_lab::load_player;
use etude_lab::{Identification, IdentificationError, IdentifyMethod, identify_robot};
use etude_lab::{RehearsalConfig, RehearsalError, RehearsalStep, record_excitations, rehearse_on_robot};
use etude_lab::{RobotPlay, play_on_robot, scores_in_simulation};
use etude_lab::{Run, RunError, find_song};
use etude_learn::{EvaluationRow, LogRow, StopReason, TrainingObserver};
use etude_music::SongError;
use etude_perform::stand::{StandError, TWIN, rig_choice, unix_secs};
use etude_perform::{FileError, Job, Mode, gap, write_file};
use etude_show::RehearsalPage;
use etude_task::{Piece, TaskError};

const COURSE: &str = "course.jsonl";
/// Times that a lock is tried for.
const LOOKS: u32 = 10;
/// Draws of the twin are told apart by this much from one seed to the next.
const SEEDS_OF_RUNS: u64 = 1000;

/// A task failed.
#[derive(Debug, thiserror::Error)]
pub enum TaskFailure {
    /// Settings.
    #[error(transparent)]
    Config(#[from] TrainingConfigError),
    /// A song.
    #[error(transparent)]
    Song(#[from] SongError),
    /// The world.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// Learning.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Playing.
    #[error(transparent)]
    Play(#[from] PlayError),
    /// The twin.
    #[error(transparent)]
    Stand(#[from] StandError),
    /// Rehearsing.
    #[error(transparent)]
    Rehearsal(#[from] RehearsalError),
    /// Fitting.
    #[error(transparent)]
    Identification(#[from] IdentificationError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// A file cannot be made or read.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// On request; it goes on from where it was.
    #[error("stopped on request")]
    Stopped,
}

/// Does a task in its folder among `runs`, or goes on with it. `threads` as in `trainer.threads`; `command` is written down.
///
/// # Errors
/// If it fails; what was complete is kept, and the same call tries again.
pub fn run_task(
    task: &Task,
    runs: &Path,
    threads: usize,
    command: &str,
    tell: &mut (dyn FnMut(&TaskProgress) + Send),
    interrupt: &AtomicBool,
) -> Result<TaskEnd, TaskFailure> {
    // Unfinished fits know their recordings by path: it is the same from wherever the task is gone on with.
    let runs =
        std::path::absolute(runs).map_err(|source| TaskFailure::File { path: runs.to_path_buf(), source })?;
    let folder = runs.join(&task.id);
    if folder.join(RESULT).is_file() {
        return Ok(TaskEnd::WasDone);
    }
    let file_error = |path: &Path, source| TaskFailure::File { path: path.to_path_buf(), source };
    std::fs::create_dir_all(&folder).map_err(|error| file_error(&folder, error))?;
    // The system lets go of it at every death. Where the file system has no locks, everyone has it.
    let path = folder.join(LOCK);
    let lock = File::create(&path).map_err(|error| file_error(&path, error))?;
    // Whoever asks where the task stands has it for a moment.
    let taken = || matches!(lock.try_lock(), Err(TryLockError::WouldBlock));
    for attempt in 1.. {
        if !taken() {
            break;
        }
        if attempt == LOOKS {
            return Ok(TaskEnd::Busy);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    // Who had the lock may have finished.
    if folder.join(RESULT).is_file() {
        return Ok(TaskEnd::WasDone);
    }
    // Plain numbers, strings and maps: writing them as JSON cannot fail, here and below.
    // The same work may be said in other words, and a rehearsal under way knows its words.
    let begun =
        std::fs::read(folder.join(TASK)).ok().and_then(|bytes| serde_json::from_slice::<Task>(&bytes).ok());
    let task = begun.as_ref().filter(|begun| begun.id == task.id).unwrap_or(task);
    let text = serde_json::to_string_pretty(task).unwrap_or_default() + "\n";
    write_file(&folder.join(TASK), &text)?;
    let mut work = Doing { task, folder: &folder, threads, command, tell, interrupt };
    let done = match &task.work {
        Work::Train { training, perform } => work.train_and_perform(training, perform.as_ref()),
        Work::Rehearse { training, mode, rounds, runs, truth, evaluations } => {
            work.rehearse(training, *mode, [*rounds, *runs], truth, *evaluations)
        }
        Work::Identify { truth, method, evaluations, seed } => {
            work.identify(truth, *method, *evaluations, *seed)
        }
    };
    let (result, times) = match done {
        // Also where it stopped on its way to something: a twin that is called back while it goes to the keyboard.
        Err(_) if interrupt.load(Ordering::Relaxed) => return Ok(TaskEnd::Stopped),
        done => done?,
    };
    let text = serde_json::to_string_pretty(&times).unwrap_or_default() + "\n";
    write_file(&folder.join(TIMES), &text)?;
    let text = serde_json::to_string_pretty(&result).unwrap_or_default() + "\n";
    write_file(&folder.join(RESULT), &text)?;
    Ok(TaskEnd::Done)
}

/// A task under way.
struct Doing<'a> {
    task: &'a Task,
    folder: &'a Path,
    threads: usize,
    command: &'a str,
    tell: &'a mut (dyn FnMut(&TaskProgress) + Send),
    interrupt: &'a AtomicBool,
}

/// Share of a task's time that the training takes where a performance follows.
const TRAINING_SHARE: f64 = 0.9;

impl Doing<'_> {
    fn tell(&mut self, phase: &str, share: f64, f1: Option<f64>) {
        (self.tell)(&TaskProgress { phase: phase.to_string(), share, f1 });
    }

    fn go_on(&self) -> Result<(), TaskFailure> {
        if self.interrupt.load(Ordering::Relaxed) { Err(TaskFailure::Stopped) } else { Ok(()) }
    }

    fn result(&self, rows: Vec<Row>, course: Vec<Values>) -> TaskResult {
        TaskResult { id: self.task.id.clone(), rows, course }
    }

    fn times(&self, secs: f64, course_secs: Vec<f64>) -> TaskTimes {
        TaskTimes {
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
    ) -> Result<(TaskResult, TaskTimes), TaskFailure> {
        let song = find_song(&training.song)?;
        let folder = self.folder.join("training");
        let mut config = training.resolve()?;
        config.trainer.threads = self.threads;
        let seed = config.trainer.seed;
        let mut run = Run::start_or_resume(song.clone(), config, &folder, self.command, None)?;
        let total = run.config().trainer.total_steps;
        let share = if perform.is_some() { TRAINING_SHARE } else { 1.0 };
        let best = run.best_f1();
        let mut watch = Watch { doing: self, total, share, best };
        let outcome = run.run(&mut watch)?;
        drop(run);
        if outcome.stopped.is_some() {
            return Err(TaskFailure::Stopped);
        }
        let player = load_player(&training.song, "", Some(&folder), Path::new("runs"))?;
        let piece = Piece::new(&song, player.config.task.initial_silence_secs)?;
        let sim = scores_in_simulation(&player, &piece)?.frame;
        let of_sim = [("sim_f1", sim.f1), ("sim_precision", sim.precision), ("sim_recall", sim.recall)];
        let mut rows = Vec::new();
        match perform {
            None => rows.push(row(&[], &of_sim)),
            Some(perform) => {
                let rig = rig_choice(TWIN, &perform.truth)?;
                for (index, mode) in perform.modes.iter().enumerate() {
                    let at = share + (1.0 - share) * index as f64 / perform.modes.len() as f64;
                    self.tell(&format!("playing, {mode}"), at, Some(sim.f1));
                    let (runs, seed) = (perform.runs, SEEDS_OF_RUNS.wrapping_mul(seed));
                    let play = RobotPlay { mode: *mode, runs, home: true, seed };
                    let report = play_on_robot(
                        &song,
                        &player,
                        &rig,
                        &play,
                        None,
                        None,
                        &mut Job::new(&mut |_| {}, self.interrupt),
                    )?;
                    self.go_on()?;
                    for (run, played) in report.runs.iter().enumerate() {
                        let frame = &played.scores.frame;
                        let whole = if played.steps[0] == played.steps[1] { 1.0 } else { 0.0 };
                        let of_twin = [
                            ("f1", frame.f1),
                            ("precision", frame.precision),
                            ("recall", frame.recall),
                            ("gap", gap(sim.f1, frame.f1)),
                            ("complete", whole),
                        ];
                        let labels = [("mode", mode.name().to_string()), ("run", run.to_string())];
                        rows.push(row(&labels, &[of_sim.as_slice(), &of_twin].concat()));
                    }
                }
            }
        }
        let (course, secs) = evaluations(&folder.join("metrics.jsonl"))?;
        Ok((self.result(rows, course), self.times(outcome.elapsed_secs, secs)))
    }

    fn rehearse(
        &mut self,
        training: &TrainingConfig,
        mode: Mode,
        [rounds, runs]: [usize; 2],
        truth_name: &str,
        evaluations: Option<u64>,
    ) -> Result<(TaskResult, TaskTimes), TaskFailure> {
        let begun = Instant::now();
        let song = find_song(&training.song)?;
        let rig = rig_choice(TWIN, truth_name)?;
        let config = RehearsalConfig {
            song: training.song.clone(),
            rig: rig.name().to_string(),
            truth: Some(truth_name.to_string()),
            rounds,
            runs,
            mode,
            preset: training.preset.clone(),
            overrides: training.set.clone(),
            policy: None,
            method: IdentifyMethod::Lm,
            evaluations,
            seed: training.resolve()?.trainer.seed,
            threads: Some(self.threads),
        };
        let (folder, interrupt) = (self.folder.join("rehearsal"), self.interrupt);
        let parts = (rounds + 1) as f64;
        let mut page = RehearsalPage::new(&config, &folder);
        let mut told = |step: &RehearsalStep<'_>| match step {
            RehearsalStep::Identifying(round, at) => {
                self.tell(&format!("round {round}: {}", at.stage.name()), *round as f64 / parts, None);
            }
            RehearsalStep::Training(round, step, total, f1) => {
                let share = (*round as f64 + *step as f64 / (*total).max(1) as f64) / parts;
                self.tell(&format!("round {round}: training"), share, Some(*f1));
            }
            RehearsalStep::Round(round) => page.add(round),
            _ => {}
        };
        let rounds = match rehearse_on_robot(&song, &rig, &config, &folder, &mut told, interrupt) {
            Err(
                RehearsalError::Interrupted
                | RehearsalError::Identify(IdentificationError::Identify(IdentifyError::Interrupted)),
            ) => return Err(TaskFailure::Stopped),
            rounds => rounds?,
        };
        page.finish()?;
        let rows = rounds.iter().map(|round| {
            let mut values = vec![
                ("sim_f1", round.sim_f1),
                ("f1", round.robot_f1),
                ("gap", gap(round.sim_f1, round.robot_f1)),
            ];
            if let Some([before, after]) = round.held_out_rad {
                values.extend([("held_out_before", before), ("held_out_after", after)]);
            }
            row(&[("round", round.round.to_string())], &values)
        });
        Ok((self.result(rows.collect(), Vec::new()), self.times(begun.elapsed().as_secs_f64(), Vec::new())))
    }

    fn identify(
        &mut self,
        truth: &str,
        method: IdentifyMethod,
        evaluations: Option<u64>,
        seed: u64,
    ) -> Result<(TaskResult, TaskTimes), TaskFailure> {
        let rig = rig_choice(TWIN, truth)?;
        let excitations = self.folder.join("recordings");
        let interrupt = self.interrupt;
        self.tell("recording", 0.0, None);
        let recorded =
            record_excitations(&rig, &excitations, SEEDS_OF_RUNS.wrapping_mul(seed), interrupt, &mut |_| {});
        let recordings = match recorded {
            Err(RehearsalError::Interrupted) => return Err(TaskFailure::Stopped),
            recorded => recorded?,
        };
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
        let mut failed = None;
        let mut told = |at: &Progress| {
            let share = at.ended[0] as f64 / at.ended[1].max(1) as f64;
            self.tell(at.stage.name(), share, None);
            let written = course.add(at);
            failed = failed.take().or(written.err());
        };
        let report = match identify_robot(&what, &folder, &mut Job::new(&mut told, interrupt)) {
            Err(IdentificationError::Identify(IdentifyError::Interrupted)) => {
                return Err(TaskFailure::Stopped);
            }
            report => report?,
        };
        if let Some(error) = failed {
            return Err(error);
        }
        let errors = &report.held_out_errors;
        let replays: u64 = report.identified.stages.iter().map(|end| end.replays).sum();
        let secs: f64 = report.identified.stages.iter().map(|end| end.secs).sum();
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

fn row(labels: &[(&str, String)], values: &[(&str, f64)]) -> Row {
    Row {
        labels: labels.iter().map(|(key, value)| (key.to_string(), value.clone())).collect(),
        // JSON has no infinities: a measure that is none is left out.
        values: values
            .iter()
            .filter(|(_, value)| value.is_finite())
            .map(|(key, value)| (key.to_string(), *value))
            .collect(),
    }
}

/// Watches a training for a task.
struct Watch<'a, 'b> {
    doing: &'a mut Doing<'b>,
    total: u64,
    share: f64,
    best: Option<f64>,
}

impl TrainingObserver for Watch<'_, '_> {
    fn on_log(&mut self, row: &LogRow) {
        let share = self.share * row.step as f64 / self.total.max(1) as f64;
        self.doing.tell("training", share, self.best);
    }

    fn on_evaluation(&mut self, row: &EvaluationRow) {
        let f1 = row.scores.first().map(|score| score.value);
        self.best = self.best.into_iter().chain(f1).reduce(f64::max);
    }

    fn should_stop(&mut self) -> Option<StopReason> {
        self.doing.interrupt.load(Ordering::Relaxed).then_some(StopReason::Requested)
    }
}
