//! What there is to say of a task: what came of it, when and where, how far it is.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::plan::Task;

/// Names of a task's files.
pub const TASK: &str = "task.json";
/// See [`TASK`].
pub const RESULT: &str = "result.json";
/// See [`TASK`].
pub const TIMES: &str = "times.json";
/// Of the file that a process locks while it works on the task. The system lets go of it at every death.
pub(crate) const LOCK: &str = "task.lock";

/// Measures by name: scores between 0 and 1, errors in rad.
pub type Values = BTreeMap<String, f64>;

/// Measures of one thing, and what it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What it is, beside the task's own labels: `mode`, `run`, `round`.
    pub labels: BTreeMap<String, String>,
    /// Its measures.
    pub values: Values,
}

/// What came of a task. The same bytes however it was run, on processors with the same vector instructions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskResult {
    /// Which task.
    pub id: String,
    /// Its measures.
    pub rows: Vec<Row>,
    /// How they came about: `step` and scores of each evaluation, or `replays` and `rms` of a fit.
    pub course: Vec<Values>,
}

/// When, where and how long.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TaskTimes {
    /// Seconds of learning or fitting, over all interruptions; of a rehearsal those since its last start.
    pub secs: f64,
    /// Seconds of learning until each point of the course.
    pub course_secs: Vec<f64>,
    /// Version of Étude.
    pub etude: String,
    /// Version of MuJoCo.
    pub mujoco: String,
    /// Processor of the machine.
    pub machine: String,
    /// Its cores.
    pub cores: usize,
    /// When it was done, s since 1970.
    pub unix_secs: u64,
    /// The command.
    pub command: String,
}

/// How far a task has got.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TaskProgress {
    /// What goes on.
    pub phase: String,
    /// How much of the task is done, 0 to 1, about.
    pub share: f64,
    /// The best F1 so far.
    pub f1: Option<f64>,
}

/// How a task ended that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskEnd {
    /// It is done.
    Done,
    /// It was done before.
    WasDone,
    /// Another process is at work on it.
    Busy,
    /// On request; it goes on from where it was.
    Stopped,
}

/// Where a task stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TaskState {
    /// It is done.
    Done,
    /// A process is at work on it, here or where the file system is shared.
    Running,
    /// It was begun, and nobody is at work on it.
    Begun,
    /// It was not begun.
    Waiting,
}

impl TaskState {
    /// Of a task among `runs`.
    pub fn of(task: &Task, runs: &Path) -> Self {
        let folder = runs.join(&task.id);
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
