//! Trainings, of this process or of others: read from the files in their folders while they grow.

mod find;
mod history;

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::anyhow;
use serde::{Deserialize, Serialize};

pub use find::{find_runs, runs_in};
pub use history::{History, Point};

use etude_lab::{CONFIG, META};

const METRICS: &str = "metrics.jsonl";
/// A training is `Silent` when it has logged nothing for this many of its intervals and for this
/// many seconds.
const SILENCE_TIMEOUT_INTERVALS: f64 = 3.0;
const SILENCE_TIMEOUT_SECS: f64 = 120.0;

/// A run that is watched.
pub struct WatchedRun {
    folder: PathBuf,
    name: String,
    song: Option<String>,
    intervals: Intervals,
    /// Length of its metrics and when they were written, as they were read last.
    read: Option<(u64, Option<SystemTime>)>,
    history: History,
}

/// The lengths in a run's configuration, as far as it can be read.
#[derive(Default, Deserialize)]
struct Intervals {
    total_steps: Option<f64>,
    log_every_steps: Option<f64>,
    evaluate_every_steps: Option<f64>,
}

/// The part of a run's configuration that is read.
#[derive(Deserialize)]
struct Config {
    trainer: Intervals,
}

/// The state of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// It has logged nothing yet.
    Waiting,
    /// It logs.
    Running,
    /// It has not logged for longer than it should take: stopped, or very slow.
    Silent,
    /// It has made all its steps.
    Finished,
}

/// The figures of a run at one time. What is not known is `null` in JSON.
#[derive(Clone, Debug, Serialize)]
pub struct RunFigures {
    /// Its folder.
    pub run: PathBuf,
    /// Its name.
    pub name: String,
    /// Title of its song.
    pub song: Option<String>,
    /// How it stands.
    pub state: RunState,
    /// Seconds since it was written to.
    pub secs_since_written: Option<f64>,
    /// Environment steps made.
    pub step: u64,
    /// Environment steps to make.
    pub total_steps: Option<u64>,
    /// Seconds trained.
    pub secs: f64,
    /// Environment steps per second of late.
    pub steps_per_sec: Option<f64>,
    /// Seconds until all steps are made, at that speed; only while it runs.
    pub secs_left: Option<f64>,
    /// Notes right in the last evaluation.
    pub notes_right: Option<u64>,
    /// Notes of the song.
    pub notes_due: Option<u64>,
    /// Strokes that play no note of the song.
    pub notes_wrong: Option<u64>,
    /// Best F1 of its evaluations.
    pub best_f1: Option<f64>,
    /// The step of that evaluation.
    pub best_step: Option<u64>,
    /// F1 of the last evaluation.
    pub last_f1: Option<f64>,
    /// Reward per step in the last row.
    pub reward_per_step: Option<f64>,
    /// Its terms.
    pub reward: BTreeMap<String, f64>,
}

impl WatchedRun {
    /// The run in `folder`; nothing is read yet of what it has logged.
    pub fn open(folder: &Path) -> Self {
        Self {
            folder: folder.to_path_buf(),
            name: name(folder),
            song: title(folder),
            intervals: Intervals::read(folder),
            read: None,
            history: History::default(),
        }
    }

    /// Reads what it has logged, if that has changed.
    ///
    /// # Errors
    /// If the metrics are there and cannot be read.
    pub fn read(&mut self) -> anyhow::Result<()> {
        let path = self.folder.join(METRICS);
        let cannot = |error: std::io::Error| anyhow!("cannot read {}: {error}", path.display());
        let state = match path.metadata() {
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            data => data.map(|data| Some((data.len(), data.modified().ok()))).map_err(cannot)?,
        };
        if state != self.read {
            let text = if state.is_some() { std::fs::read(&path).map_err(cannot)? } else { Vec::new() };
            // A run that is continued may be given more steps, and a folder another song.
            self.intervals = Intervals::read(&self.folder);
            self.song = title(&self.folder);
            self.history = History::of(&text);
            self.read = state;
        }
        Ok(())
    }

    /// The run's folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What it has logged, as far as it has been read.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Environment steps between two evaluations.
    pub fn evaluate_every_steps(&self) -> Option<f64> {
        self.intervals.evaluate_every_steps.filter(|steps| *steps > 0.0)
    }

    /// Its figures, as far as it has been read.
    pub fn figures(&self, now: SystemTime) -> RunFigures {
        let history = &self.history;
        let written = find::written(&self.folder);
        // Clocks of a network's file system may differ from ours.
        let age = written.map(|time| now.duration_since(time).unwrap_or_default().as_secs_f64());
        let steps_per_sec = history.steps_per_sec();
        let state = self.state(age, steps_per_sec);
        let left = self.intervals.total_steps.map(|total| (total - history.step()).max(0.0));
        let secs_left = left.zip(steps_per_sec).map(|(steps, rate)| steps / rate.max(1e-3));
        let last = |points: &[Point]| points.last().map(|point| point.value);
        let best = history.best();
        RunFigures {
            run: self.folder.clone(),
            name: self.name.clone(),
            song: self.song.clone(),
            state,
            secs_since_written: age,
            step: history.step() as u64,
            total_steps: self.intervals.total_steps.map(|steps| steps as u64),
            secs: history.secs(),
            steps_per_sec,
            secs_left: secs_left.filter(|_| state == RunState::Running),
            notes_right: history.notes.map(|[right, _, _]| right as u64),
            notes_due: history.notes.map(|[right, missed, _]| (right + missed) as u64),
            notes_wrong: history.notes.map(|[_, _, wrong]| wrong as u64),
            best_f1: best.map(|best| best.value),
            best_step: best.map(|best| best.step as u64),
            last_f1: last(&history.f1),
            reward_per_step: last(&history.reward),
            reward: history
                .terms
                .iter()
                .filter_map(|(name, term)| Some((name.clone(), last(term)?)))
                .collect(),
        }
    }

    fn state(&self, age_secs: Option<f64>, steps_per_sec: Option<f64>) -> RunState {
        let history = &self.history;
        if history.is_empty() {
            return RunState::Waiting;
        }
        if self.intervals.total_steps.is_some_and(|total| history.step() >= total) {
            return RunState::Finished;
        }
        let interval = self.intervals.log_every_steps.zip(steps_per_sec);
        let interval_secs = interval.map_or(0.0, |(steps, rate)| steps / rate.max(1e-3));
        let timeout = SILENCE_TIMEOUT_SECS.max(SILENCE_TIMEOUT_INTERVALS * interval_secs);
        if age_secs.is_some_and(|age| age > timeout) { RunState::Silent } else { RunState::Running }
    }
}

impl Intervals {
    /// Reads only these keys, so that runs of other versions can be watched too.
    fn read(folder: &Path) -> Self {
        let text = std::fs::read_to_string(folder.join(CONFIG)).unwrap_or_default();
        toml::from_str(&text).map(|config: Config| config.trainer).unwrap_or_default()
    }
}

/// The song's title, from the description of the run.
fn title(folder: &Path) -> Option<String> {
    let meta: serde_json::Value = serde_json::from_slice(&std::fs::read(folder.join(META)).ok()?).ok()?;
    Some(meta["song"].as_str()?.to_string())
}

/// What to call the run in `folder`: the folder's name, without the folders that are called the
/// same in every task and rehearsal.
fn name(folder: &Path) -> String {
    let path = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let mut parts = Vec::new();
    for part in path.iter().rev().map(|part| part.to_string_lossy()) {
        let is_iteration = part.starts_with("iteration-");
        if part == "training" || part == "rehearsal" {
            continue;
        }
        parts.insert(0, part);
        if !is_iteration {
            break;
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_run_goes_from_waiting_to_finished_and_may_go_on() {
        let desk = tempfile::tempdir().unwrap();
        let folder = desk.path().join("task__1/training");
        std::fs::create_dir_all(&folder).unwrap();
        let config =
            |total: u32| format!("[trainer]\ntotal_steps = {total}\nlog_every_steps = 1000\nnew = [1]\n");
        std::fs::write(folder.join(CONFIG), config(3000)).unwrap();
        std::fs::write(folder.join(META), "{\"song\": \"Short\"}").unwrap();
        let rows = |steps: &[u32]| -> String {
            let row = |step| {
                let secs = step / 10;
                format!(
                    "{{\"step\":{step},\"reward/x\":0.5,\"perf/steps_per_sec\":10.0,\"perf/elapsed_secs\":{secs}}}\n"
                )
            };
            steps.iter().map(row).collect()
        };
        let write = |text: String| std::fs::write(folder.join(METRICS), text).unwrap();
        let mut run = WatchedRun::open(&folder);
        let mut figures = |secs: u64| {
            run.read().unwrap();
            run.figures(SystemTime::now() + Duration::from_secs(secs))
        };
        assert_eq!(figures(0).state, RunState::Waiting);
        write(rows(&[1000, 2000]));
        let running = figures(0);
        assert_eq!((running.state, running.step, running.total_steps), (RunState::Running, 2000, Some(3000)));
        assert_eq!((running.steps_per_sec, running.secs_left), (Some(10.0), Some(100.0)));
        assert_eq!((running.name.as_str(), running.song.as_deref()), ("task__1", Some("Short")));
        assert_eq!(running.reward["x"], 0.5);
        // A row comes every 100 seconds.
        assert_eq!(figures(280).state, RunState::Running);
        let silent = figures(320);
        assert_eq!((silent.state, silent.secs_left), (RunState::Silent, None));
        write(rows(&[1000, 2000, 3000]));
        assert_eq!(figures(999).state, RunState::Finished);
        std::fs::write(folder.join(CONFIG), config(9000)).unwrap();
        write(rows(&[1000, 2000, 3000, 4000]));
        assert_eq!(figures(0).state, RunState::Running);
        // Begun anew.
        write(rows(&[1000]));
        assert_eq!(figures(0).step, 1000);
    }

    #[test]
    fn names_say_which_task_and_round() {
        for (folder, expected) in [
            ("/none/runs/twinkle__fast__0", "twinkle__fast__0"),
            ("/none/runs/task/training", "task"),
            ("/none/runs/task/rehearsal/iteration-2/training", "task/iteration-2"),
        ] {
            assert_eq!(name(Path::new(folder)), expected);
        }
    }
}
