//! The files of a trial: its result, when and where it ran; and its progress and state.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::trial::Trial;

/// Names of a trial's files.
pub const TRIAL: &str = "task.json";
/// See [`TRIAL`].
pub const RESULT: &str = "result.json";
/// See [`TRIAL`].
pub const TIMES: &str = "times.json";
/// Name of the file that a process locks while it works on the trial. The system releases the lock
/// when the process ends.
pub(crate) const LOCK: &str = "task.lock";

/// Measures by name: scores between 0 and 1, errors in rad.
pub type Values = BTreeMap<String, f64>;

/// One row of results: labels and measures. In a trial's file the labels are those that the trial
/// has not: `mode`, `run`, `iteration`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ResultRow {
    /// Its labels.
    pub labels: BTreeMap<String, String>,
    /// Its measures.
    pub values: Values,
}

impl ResultRow {
    /// Whether it has all these labels.
    pub fn has(&self, filter: &BTreeMap<String, String>) -> bool {
        filter.iter().all(|(key, value)| self.labels.get(key) == Some(value))
    }
}

/// The result of a trial: the same bytes however it was run, on processors with the same vector
/// instructions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialResult {
    /// Which trial.
    pub id: String,
    /// Its measures.
    pub rows: Vec<ResultRow>,
    /// Its course: `step` and scores of each evaluation, or `replays` and `rms` of a fit.
    pub curve: Vec<Values>,
}

/// When, where and how long.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrialTimes {
    /// Seconds of learning or fitting, over all interruptions; of a rehearsal those since its last
    /// start.
    pub secs: f64,
    /// Seconds of learning until each point of the course.
    pub curve_secs: Vec<f64>,
    /// Version of Étude.
    pub etude: String,
    /// Version of MuJoCo.
    pub mujoco: String,
    /// Processor of the machine.
    pub machine: String,
    /// Its cores.
    pub cores: usize,
}

/// The progress of a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialProgress {
    /// The current phase.
    pub phase: String,
    /// The share of the trial that is done, 0 to 1, estimated.
    pub share: f64,
    /// The best F1 so far.
    pub f1: Option<f64>,
}

/// How a trial ended without failing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialEnd {
    /// It is done, now or since an earlier call.
    Done,
    /// Another process works on it.
    Busy,
    /// It was interrupted; the next call resumes it.
    Stopped,
}

/// The state of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TrialState {
    /// It is done.
    Done,
    /// A process works on it, on this machine or on another one with the same file system.
    Running,
    /// It was begun, and no process works on it.
    Begun,
    /// It was not begun.
    Waiting,
}

impl TrialState {
    /// Of a trial among `runs`.
    pub fn of(trial: &Trial, runs: &Path) -> Self {
        let folder = runs.join(&trial.id);
        if folder.join(RESULT).is_file() {
            return Self::Done;
        }
        match File::open(folder.join(LOCK)).map(|lock| lock.try_lock()) {
            Err(_) => Self::Waiting,
            Ok(Err(TryLockError::WouldBlock)) => Self::Running,
            Ok(_) => Self::Begun,
        }
    }
}

/// The error of a file or folder of a trial.
pub(crate) fn file_error(path: &Path, error: &std::io::Error) -> anyhow::Error {
    anyhow::anyhow!("{}: {error}", path.display())
}
