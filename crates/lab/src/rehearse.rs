//! Sim2Real2Sim: record, identify, train, perform, and round again (paper, "Sim2Real2Sim").
//!
//! ```text
//! DIR/rehearsal.json          what was asked for
//! DIR/excitation/*.mcap       the robot moving clear of the keyboard
//! DIR/round-0/                played with what was learned in the simulator as it comes
//! DIR/round-N/identified/     the simulator fitted to the excitation (once) and to the performances of the round before
//! DIR/round-N/training/       the policy of the round before, trained on in that simulator
//! DIR/round-N/performance/    played on the robot; recordings, MIDI and sound to listen to
//! DIR/round-N/round.json      what came of the round; written last
//! ```
//!
//! Every part is written under its name only when it is complete, and a part that is there is not made again. So a
//! rehearsal that was stopped anywhere, kill -9 included, goes on with the same command.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use etude_identify::{Motion, MotionError, Progress};
use etude_learn::{EvaluationRow, LogRow, StopReason, TrainingObserver};
use etude_music::Song;
use etude_perform::{Ending, Excitation, FileError, Job, Mode, write_file};
use serde::{Deserialize, Serialize};

use crate::config::{ConfigError, resolve};
use crate::identify::{IDENTIFIED, Identification, IdentificationError, IdentifyMethod, identify_robot};
use crate::play::PlayError;
use crate::player::load_player;
use crate::record::{Motion as RecordedMotion, record_robot};
use crate::robot::{RobotPlay, RobotRun, RunEnded, play_on_robot};
use crate::run::{Run, RunError};
use etude_perform::stand::RigChoice;

/// What is rehearsed, and how.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RehearsalConfig {
    /// The song, as it is named on the command line.
    pub song: String,
    /// The rig.
    pub rig: String,
    /// Name of the twin's truth.
    pub truth: Option<String>,
    /// Rounds after the first performance.
    pub rounds: usize,
    /// Performances a round.
    pub runs: usize,
    /// How they are played.
    pub mode: Mode,
    /// Preset of the trainings.
    pub preset: String,
    /// Values of it that are set otherwise.
    pub overrides: Vec<String>,
    /// The policy to begin with; without one the song is learned first.
    pub policy: Option<PathBuf>,
    /// Method of identification.
    pub method: IdentifyMethod,
    /// Evaluations of each fit at most.
    pub evaluations: Option<u64>,
    /// Seed of identification and performances.
    pub seed: u64,
    /// Threads of the trainings, if not as many as the settings say. They shape nothing, so another number may go on.
    #[serde(skip)]
    pub threads: Option<usize>,
}

/// What came of one round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Round {
    /// Which; 0 is before any identification.
    pub round: usize,
    /// F1 of the policy in the simulator that it was trained in.
    pub sim_f1: f64,
    /// Mean F1 on the robot.
    pub robot_f1: f64,
    /// Its standard deviation.
    pub robot_f1_std: f64,
    /// The share of `sim_f1` that is lost on the robot.
    pub gap: f64,
    /// Errors of the simulator in the held-out excitation, finger joints, rad: before the fit and after.
    pub held_out_rad: Option<[f64; 2]>,
    /// The policy.
    pub policy: PathBuf,
    /// Recordings to listen to.
    pub recordings: Vec<PathBuf>,
    /// The identified numbers, by path.
    pub physics: std::collections::BTreeMap<String, f64>,
}

/// What a rehearsal tells on its way.
#[derive(Clone, Debug)]
pub enum RehearsalStep<'a> {
    /// An excitation was recorded.
    Recorded(Excitation),
    /// A performance is not fitted to, for this reason.
    LeftOut(&'a Path, &'a str),
    /// A fit goes on.
    Identifying(usize, &'a Progress),
    /// A training goes on: round, step, of how many, best F1 so far.
    Training(usize, u64, u64, f64),
    /// A run was played.
    Performed(usize, usize, &'a RobotRun),
    /// A round is over, or was so before.
    Round(&'a Round),
}

/// A rehearsal failed.
#[derive(Debug, thiserror::Error)]
pub enum RehearsalError {
    /// The robot or a player.
    #[error(transparent)]
    Play(#[from] PlayError),
    /// Identification.
    #[error(transparent)]
    Identify(#[from] IdentificationError),
    /// Training.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Settings of the training.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The folder cannot be used.
    #[error("{path}: {why}; choose another folder with -o")]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// The robot stopped itself.
    #[error(
        "round {round}: the robot stopped itself: {fault}; remove the cause, then give the same command again"
    )]
    Fault {
        /// The round.
        round: usize,
        /// Why.
        fault: String,
    },
    /// On request.
    #[error("interrupted; the same command goes on from where it stopped")]
    Interrupted,
}

/// Rehearses `song` on a robot in `folder`, or goes on with it.
///
/// # Errors
/// If any part fails or is interrupted; what was complete is kept.
pub fn rehearse_on_robot(
    song: &Song,
    rig: &RigChoice,
    config: &RehearsalConfig,
    folder: &Path,
    tell: &mut (dyn FnMut(&RehearsalStep<'_>) + Send),
    interrupt: &AtomicBool,
) -> Result<Vec<Round>, RehearsalError> {
    let rehearsal = Rehearsal { song, rig, config, folder, interrupt };
    rehearsal.open()?;
    let mut rounds: Vec<Round> = Vec::new();
    for round in 0..=config.rounds {
        let done = match rehearsal.ended(round)? {
            Some(done) => done,
            None => rehearsal.round(round, rounds.last(), tell)?,
        };
        tell(&RehearsalStep::Round(&done));
        rounds.push(done);
    }
    Ok(rounds)
}

struct Rehearsal<'a> {
    song: &'a Song,
    rig: &'a RigChoice,
    config: &'a RehearsalConfig,
    folder: &'a Path,
    interrupt: &'a AtomicBool,
}

impl Rehearsal<'_> {
    /// Makes the folder, or finds in it a rehearsal of the same.
    fn open(&self) -> Result<(), RehearsalError> {
        let file = self.folder.join("rehearsal.json");
        let fail = |why: String| RehearsalError::Folder { path: self.folder.to_path_buf(), why };
        // Plain numbers and strings: writing them as JSON cannot fail.
        let text = serde_json::to_string_pretty(self.config).unwrap_or_default() + "\n";
        match std::fs::read_to_string(&file) {
            Ok(there) => {
                let there: RehearsalConfig = serde_json::from_str(&there)
                    .map_err(|error| fail(format!("rehearsal.json is damaged: {error}")))?;
                // More rounds may follow.
                let (rounds, threads) = (self.config.rounds, self.config.threads);
                if (RehearsalConfig { rounds, threads, ..there }) != *self.config {
                    return Err(fail("it holds another rehearsal, with other settings".to_string()));
                }
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(fail(error.to_string())),
        }
        std::fs::create_dir_all(self.folder).map_err(|error| fail(error.to_string()))?;
        Ok(write_file(&file, &text)?)
    }

    fn round_folder(&self, round: usize) -> PathBuf {
        self.folder.join(format!("round-{round}"))
    }

    /// What came of a round that is over.
    fn ended(&self, round: usize) -> Result<Option<Round>, RehearsalError> {
        let path = self.round_folder(round).join("round.json");
        match std::fs::read(&path) {
            Err(_) => Ok(None),
            Ok(bytes) => serde_json::from_slice(&bytes).map(Some).map_err(|error| RehearsalError::Folder {
                path,
                why: format!("it is damaged ({error}): remove it, and the round is played again"),
            }),
        }
    }

    fn round(
        &self,
        round: usize,
        before: Option<&Round>,
        tell: &mut (dyn FnMut(&RehearsalStep<'_>) + Send),
    ) -> Result<Round, RehearsalError> {
        let folder = self.round_folder(round);
        let fail =
            |error: std::io::Error| RehearsalError::Folder { path: folder.clone(), why: error.to_string() };
        std::fs::create_dir_all(&folder).map_err(fail)?;
        let (mut held_out_rad, mut physics, mut layer) = (None, Default::default(), None);
        if let Some(before) = before {
            let folder = self.folder.join("excitation");
            let seed = self.config.seed.wrapping_add(500);
            let mut recorded = |excitation| tell(&RehearsalStep::Recorded(excitation));
            let excitations = record_excitations(self.rig, &folder, seed, self.interrupt, &mut recorded)?;
            let mut performances = Vec::new();
            for path in &before.recordings {
                // One that a fit would be misled by: a policy that knows little pushes against its joints' stops.
                match Motion::load(path) {
                    Err(MotionError::Unsuitable { path, why }) => tell(&RehearsalStep::LeftOut(&path, &why)),
                    Err(error) => return Err(IdentificationError::from(error).into()),
                    Ok(_) => performances.push(path.clone()),
                }
            }
            // The excitations tell of the drives, and they are the same in each round: once they are fitted, what is new is
            // in the performances.
            let fitted_before = round > 1 && !performances.is_empty();
            let is_new = |path: &PathBuf| !fitted_before || path.ends_with(excitation_file(Excitation::Held));
            let recordings = excitations.into_iter().filter(is_new).chain(performances).collect();
            let what = Identification {
                recordings,
                held_out: Vec::new(),
                method: self.config.method,
                evaluations: self.config.evaluations,
                seed: self.config.seed,
                start: before.physics.clone(),
            };
            let identified = folder.join("identified");
            let mut progress = |at: &Progress| tell(&RehearsalStep::Identifying(round, at));
            let report = identify_robot(&what, &identified, &mut Job::new(&mut progress, self.interrupt))?;
            held_out_rad =
                (!report.held_out_errors.joints.is_empty()).then_some(report.held_out_errors.fingers);
            physics = report.identified.physics;
            layer = Some(identified.join(IDENTIFIED));
        }
        let policy = match (&self.config.policy, before) {
            (Some(policy), None) => policy.clone(),
            _ => self.train(round, layer.as_deref(), before.map(|before| before.policy.as_path()), tell)?,
        };
        let player = load_player(&self.config.song, "", Some(&policy), Path::new("runs"))?;
        let play = RobotPlay {
            mode: self.config.mode,
            runs: self.config.runs,
            home: true,
            seed: self.config.seed.wrapping_add(1000 * round as u64),
        };
        let mut told = |ended: &RunEnded| tell(&RehearsalStep::Performed(round, ended.index, &ended.run));
        let stage = folder.join("performance");
        let report = play_on_robot(
            self.song,
            &player,
            self.rig,
            &play,
            Some(&stage),
            None,
            &mut Job::new(&mut told, self.interrupt),
        )?;
        if self.interrupt.load(Ordering::Relaxed) {
            return Err(RehearsalError::Interrupted);
        }
        if let Some(run) = report.runs.iter().find(|run| run.steps[0] < run.steps[1]) {
            return Err(RehearsalError::Fault { round, fault: run.ending.to_string() });
        }
        let recordings =
            report.runs.iter().filter_map(|run| run.files.as_ref()).map(|files| files.recording.clone());
        let done = Round {
            round,
            sim_f1: report.sim_f1,
            robot_f1: report.robot_f1,
            robot_f1_std: report.robot_f1_std,
            gap: report.gap,
            held_out_rad,
            policy,
            recordings: recordings.collect(),
            physics,
        };
        // As above.
        let text = serde_json::to_string_pretty(&done).unwrap_or_default() + "\n";
        write_file(&folder.join("round.json"), &text)?;
        Ok(done)
    }

    /// Trains, or goes on training, in the simulator of `layer`, from what `source` has learned.
    fn train(
        &self,
        round: usize,
        layer: Option<&Path>,
        source: Option<&Path>,
        tell: &mut (dyn FnMut(&RehearsalStep<'_>) + Send),
    ) -> Result<PathBuf, RehearsalError> {
        let folder = self.round_folder(round).join("training");
        let mut config = resolve(&self.config.preset, layer, &self.config.overrides)?;
        config.trainer.threads = self.config.threads.unwrap_or(config.trainer.threads);
        let command = format!("etude rehearse, round {round}");
        let mut run = Run::start_or_resume(self.song.clone(), config, &folder, &command, source)?;
        let total = run.config().trainer.total_steps;
        let best = run.best_f1().unwrap_or(0.0);
        let mut watch = Watch { round, total, best, tell, interrupt: self.interrupt };
        let outcome = run.run(&mut watch)?;
        if outcome.stopped == Some(StopReason::Requested) {
            return Err(RehearsalError::Interrupted);
        }
        Ok(folder)
    }
}

/// Records all excitations into `folder`, but those that are there already, and gives their paths. `tell` hears of each.
///
/// # Errors
/// If the robot does not get ready or stops itself, a recording cannot be written, or it is interrupted.
pub fn record_excitations(
    rig: &RigChoice,
    folder: &Path,
    seed: u64,
    interrupt: &AtomicBool,
    tell: &mut dyn FnMut(Excitation),
) -> Result<Vec<PathBuf>, RehearsalError> {
    let fail = |path: &Path, error: std::io::Error| RehearsalError::Folder {
        path: path.to_path_buf(),
        why: error.to_string(),
    };
    std::fs::create_dir_all(folder).map_err(|error| fail(folder, error))?;
    let mut paths = Vec::new();
    for (index, excitation) in Excitation::ALL.into_iter().enumerate() {
        let path = folder.join(excitation_file(excitation));
        if !path.is_file() {
            let partial = path.with_extension("partial");
            let motion = RecordedMotion::Excitation(excitation);
            let seed = seed.wrapping_add(index as u64);
            let recorded = record_robot(rig, motion, true, seed, &partial, interrupt)?;
            match recorded.ending {
                Ending::Complete => {}
                Ending::Interrupted => return Err(RehearsalError::Interrupted),
                Ending::Fault(fault) => return Err(RehearsalError::Fault { round: 0, fault }),
            }
            std::fs::rename(&partial, &path).map_err(|error| fail(&path, error))?;
            tell(excitation);
        }
        paths.push(path);
    }
    Ok(paths)
}

fn excitation_file(excitation: Excitation) -> String {
    format!("{excitation}.mcap")
}

struct Watch<'a> {
    round: usize,
    total: u64,
    best: f64,
    tell: &'a mut (dyn FnMut(&RehearsalStep<'_>) + Send),
    interrupt: &'a AtomicBool,
}

impl TrainingObserver for Watch<'_> {
    fn on_log(&mut self, row: &LogRow) {
        (self.tell)(&RehearsalStep::Training(self.round, row.step, self.total, self.best));
    }

    fn on_evaluation(&mut self, row: &EvaluationRow) {
        self.best = row.scores.first().map_or(self.best, |score| score.value.max(self.best));
        (self.tell)(&RehearsalStep::Training(self.round, row.step, self.total, self.best));
    }

    fn should_stop(&mut self) -> Option<StopReason> {
        self.interrupt.load(Ordering::Relaxed).then_some(StopReason::Requested)
    }
}
