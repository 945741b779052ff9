//! What an experiment comes to: a list of tasks, each with an id that says what is done and not for whom.
//!
//! Two experiments that need the same training share its task, and a plan that is made again has the same ids, as long as
//! the configurations that its presets and settings resolve to are the same.

use std::collections::{BTreeMap, BTreeSet};
use std::io::BufRead as _;
use std::path::{Path, PathBuf};

use etude_learn::TrainerConfig;
use etude_music::SongError;
use etude_perform::{FileError, Mode, write_file};
use etude_task::TaskError;
use serde::{Deserialize, Serialize};

use crate::config::{Experiment, ExperimentError, FitConfig, PerformConfig, RehearseConfig};
use etude_lab::IdentifyMethod;
use etude_lab::find_song;
use etude_lab::{ConfigError, RunConfig, resolve};
use etude_perform::stand::{TWIN, rig_choice};

/// How much is done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Budget {
    /// What the file says.
    #[default]
    Full,
    /// Everything once and as little as possible: to see that it works.
    Smoke,
}

impl std::str::FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "full" => Ok(Self::Full),
            "smoke" => Ok(Self::Smoke),
            _ => Err(format!("no budget is called `{text}`; there are: full, smoke")),
        }
    }
}

/// What is changed in an experiment from outside its file.
#[derive(Clone, Debug, Default)]
pub struct PlanConfig {
    /// Seeds, if not as many as the file says.
    pub seeds: Option<u64>,
    /// How much is done.
    pub budget: Budget,
    /// Values of the trainings that are set otherwise, after all others.
    pub set: Vec<String>,
}

/// What a training costs in a smoke test: two rounds of evaluation and a few updates between them.
const SMOKE: [&str; 4] = [
    "trainer.total_steps=480",
    "trainer.evaluate_every_steps=240",
    "trainer.warmup_steps=160",
    "trainer.checkpoint_every_steps=240",
];
/// Letters of a plan's name: all experiments at once have a long one.
const LONGEST_NAME: usize = 64;
/// Evaluations of a fit in a smoke test.
const SMOKE_EVALUATIONS: u64 = 2;

/// One piece of work, by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// The name of its folder among the runs: the same work has the same id.
    pub id: String,
    /// What it is in its experiment: `song`, `variant`, `seed`, the keys of the grid, `mode`, `truth`, `method`.
    pub labels: BTreeMap<String, String>,
    /// What is done.
    pub work: Work,
}

/// What is done in a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Work {
    /// A song is learned and, if so asked, played on the twin.
    Train {
        /// How it is learned.
        training: TrainingConfig,
        /// How it is played.
        perform: Option<PerformConfig>,
    },
    /// Sim2Real2Sim.
    Rehearse {
        /// How it is learned.
        training: TrainingConfig,
        /// The mode of the performances.
        mode: Mode,
        /// Rounds after the first performance.
        rounds: usize,
        /// Performances a round.
        runs: usize,
        /// What is true of the twin.
        truth: String,
        /// Evaluations of each fit at most.
        evaluations: Option<u64>,
    },
    /// The simulator is fitted to the twin's excitations.
    Identify {
        /// What is true of the twin.
        truth: String,
        /// The method.
        method: IdentifyMethod,
        /// Evaluations of each fit at most.
        evaluations: Option<u64>,
        /// Owns every random draw.
        seed: u64,
    },
}

/// A training, by the layers of its configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingConfig {
    /// A built-in id or a MIDI file.
    pub song: String,
    /// The preset.
    pub preset: String,
    /// What is set otherwise, the seed included.
    pub set: Vec<String>,
}

/// The settings of a training cannot work.
#[derive(Debug, thiserror::Error)]
pub enum TrainingConfigError {
    /// A layer.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The world or the task.
    #[error(transparent)]
    Task(#[from] TaskError),
}

/// A plan cannot be made or read.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// A song.
    #[error(transparent)]
    Song(#[from] SongError),
    /// A setting.
    #[error("experiment {name}: {source}")]
    Config {
        /// The experiment.
        name: String,
        /// What is wrong.
        source: TrainingConfigError,
    },
    /// A seed that is set by hand.
    #[error("`--set {0}` would make every training the same: --seeds says how many there are")]
    Seed(String),
    /// A truth of the twin.
    #[error("experiment {name}: {message}")]
    Truth {
        /// The experiment.
        name: String,
        /// What is wrong.
        message: String,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The file cannot be read.
    #[error("cannot read the plan {path}: {why}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
}

impl TrainingConfig {
    /// The configuration that its layers come to.
    ///
    /// # Errors
    /// As [`resolve`](fn@resolve), and if a setting cannot work.
    pub fn resolve(&self) -> Result<RunConfig, TrainingConfigError> {
        let config = resolve(&self.preset, None, &self.set)?.complete();
        config.check()?;
        config.task.check()?;
        config.task.params().map_err(TaskError::from)?;
        etude_task::reward::Reward::new(&config.task.reward)?;
        Ok(config)
    }
}

impl PlanConfig {
    /// What it is on the command line.
    pub fn flags(&self) -> String {
        let seeds = self.seeds.map(|seeds| format!(" --seeds {seeds}"));
        let budget = (self.budget == Budget::Smoke).then(|| " --budget smoke".to_string());
        let set = self.set.iter().map(|set| format!(" --set {set}"));
        seeds.into_iter().chain(budget).chain(set).collect()
    }
}

impl Experiment {
    /// Its tasks, in order: seeds change slowest, so that whatever is ready early is ready for every variant.
    ///
    /// # Errors
    /// If a song, setting or truth is not sound.
    pub fn plan(&self, config: &PlanConfig) -> Result<Vec<Task>, PlanError> {
        if let Some(set) = config.set.iter().find(|set| crate::config::sets_the_seed(set)) {
            return Err(PlanError::Seed(set.clone()));
        }
        let smoke = config.budget == Budget::Smoke;
        let seeds = if smoke { 1 } else { config.seeds.unwrap_or(self.seeds) };
        let songs = if smoke { &self.songs[..self.songs.len().min(1)] } else { &self.songs };
        let mut tasks = Vec::new();
        for seed in 0..seeds {
            match &self.identify {
                Some(fit) => tasks.extend(self.fits(fit, seed, smoke)?),
                None => {
                    for song in songs {
                        tasks.extend(self.trainings(song, seed, config)?);
                    }
                }
            }
        }
        // Two variants may come to the same.
        let mut seen = BTreeSet::new();
        tasks.retain(|task: &Task| seen.insert((task.id.clone(), task.labels.clone())));
        Ok(tasks)
    }

    fn fits(&self, fit: &FitConfig, seed: u64, smoke: bool) -> Result<Vec<Task>, PlanError> {
        let evaluations = if smoke { Some(SMOKE_EVALUATIONS) } else { fit.evaluations };
        let mut tasks = Vec::new();
        for name in if smoke { &fit.truths[..fit.truths.len().min(1)] } else { &fit.truths } {
            let all = self.text_of_truth(name)?;
            for method in &fit.methods {
                let work = Work::Identify { truth: name.clone(), method: *method, evaluations, seed };
                let labels = [("truth", name.clone()), ("method", method.name().to_string())];
                let labels = labels.into_iter().chain([("seed", seed.to_string())]);
                tasks.push(Task {
                    id: id(
                        "identify",
                        name,
                        seed,
                        &(all.clone() + &serde_json::to_string(&work).unwrap_or_default()),
                    ),
                    labels: labels.map(|(key, value)| (key.to_string(), value)).collect(),
                    work,
                });
            }
        }
        Ok(tasks)
    }

    fn trainings(&self, song: &str, seed: u64, config: &PlanConfig) -> Result<Vec<Task>, PlanError> {
        let smoke = config.budget == Budget::Smoke;
        let found = find_song(song)?;
        let notes = format!("{} {:?}", found.duration_secs(), found.notes());
        let mut tasks = Vec::new();
        let alone = [crate::config::Variant { name: String::new(), set: Vec::new(), modes: None }];
        let variants = if self.variants.is_empty() { &alone[..] } else { &self.variants };
        for variant in variants {
            for point in self.grid_points(smoke) {
                let mut labels = BTreeMap::from([("seed".to_string(), seed.to_string())]);
                labels.insert("song".to_string(), song.to_string());
                if !variant.name.is_empty() {
                    labels.insert("variant".to_string(), variant.name.clone());
                }
                let mut set: Vec<String> = [self.set.as_slice(), &variant.set].concat();
                for (path, value) in &point {
                    set.push(format!("{path}={value}"));
                    let label = path.rsplit('.').next().unwrap_or(path);
                    labels.insert(label.to_string(), value.trim_matches('"').to_string());
                }
                set.push(format!("trainer.seed={seed}"));
                if smoke {
                    set.extend(SMOKE.map(str::to_string));
                }
                set.extend(config.set.iter().cloned());
                let training = TrainingConfig { song: song.to_string(), preset: self.preset.clone(), set };
                let wrong = |source| PlanError::Config { name: self.name.clone(), source };
                let resolved = training.resolve().map_err(wrong)?;
                let what = fingerprint(&notes, &resolved);
                match &self.rehearse {
                    Some(rehearse) => {
                        let what = what + &self.text_of_truth(&rehearse.truth)?;
                        tasks.extend(rehearsals(rehearse, &training, &labels, smoke, seed, &what));
                    }
                    None => {
                        let perform = self.performance(variant.modes.as_deref(), smoke);
                        let truth = perform
                            .as_ref()
                            .map_or(Ok(String::new()), |perform| self.text_of_truth(&perform.truth))?;
                        let all =
                            format!("{what}{}{truth}", serde_json::to_string(&perform).unwrap_or_default());
                        let id = id("train", song, seed, &all);
                        tasks.push(Task { id, labels, work: Work::Train { training, perform } });
                    }
                }
            }
        }
        Ok(tasks)
    }

    fn performance(&self, modes: Option<&[Mode]>, smoke: bool) -> Option<PerformConfig> {
        let perform = self.perform.clone()?;
        let modes = modes.map_or_else(|| perform.modes.clone(), <[Mode]>::to_vec);
        let runs = if smoke { 1 } else { perform.runs };
        Some(PerformConfig { modes, runs, ..perform })
    }

    /// Every combination of the grid's values; in a smoke test, of the first and the last of each.
    fn grid_points(&self, smoke: bool) -> Vec<Vec<(String, String)>> {
        let mut points = vec![Vec::new()];
        for (path, values) in &self.grid {
            let tried: Vec<&toml::Value> = match (smoke, values.as_slice()) {
                (true, [first, .., last]) => vec![first, last],
                _ => values.iter().collect(),
            };
            points = points
                .iter()
                .flat_map(|point| {
                    tried.iter().map(move |value| {
                        let mut point = point.clone();
                        point.push((path.clone(), value.to_string()));
                        point
                    })
                })
                .collect();
        }
        points
    }

    /// All that a truth says: another text under the same name is other work.
    fn text_of_truth(&self, truth: &str) -> Result<String, PlanError> {
        let wrong = |message| PlanError::Truth { name: self.name.clone(), message };
        rig_choice(TWIN, truth).map_err(|error| wrong(error.to_string()))?;
        // The shipped ones have no file, and change with Étude alone.
        Ok(std::fs::read_to_string(truth).unwrap_or_default())
    }
}

fn rehearsals(
    rehearse: &RehearseConfig,
    training: &TrainingConfig,
    labels: &BTreeMap<String, String>,
    smoke: bool,
    seed: u64,
    what: &str,
) -> Vec<Task> {
    let task = |mode: &Mode| {
        let (rounds, runs) = if smoke { (1, 1) } else { (rehearse.rounds, rehearse.runs) };
        let evaluations = if smoke { Some(SMOKE_EVALUATIONS) } else { rehearse.evaluations };
        let RehearseConfig { truth, .. } = rehearse.clone();
        let all = format!("{what}{mode}{rounds} {runs} {truth} {evaluations:?}");
        let mut labels = labels.clone();
        labels.insert("mode".to_string(), mode.name().to_string());
        let work =
            Work::Rehearse { training: training.clone(), mode: *mode, rounds, runs, truth, evaluations };
        Task { id: id("rehearse", &training.song, seed, &all), labels, work }
    };
    // Fits are what a smoke test would spend its time on.
    let modes = if smoke { &rehearse.modes[..rehearse.modes.len().min(1)] } else { &rehearse.modes };
    modes.iter().map(task).collect()
}

/// What tells one training from another: notes and resolved configuration. How it is spread over threads, logged and saved
/// shapes nothing.
fn fingerprint(notes: &str, config: &RunConfig) -> String {
    let defaults = TrainerConfig::default();
    let trainer = TrainerConfig {
        threads: defaults.threads,
        overlap: defaults.overlap,
        log_every_steps: defaults.log_every_steps,
        checkpoint_every_steps: defaults.checkpoint_every_steps,
        ..config.trainer.clone()
    };
    let config = RunConfig { trainer, ..config.clone() };
    // Plain numbers, strings and maps: writing them as JSON cannot fail.
    notes.to_string() + &serde_json::to_string(&config).unwrap_or_default()
}

fn id(kind: &str, what: &str, seed: u64, all: &str) -> String {
    let stem =
        Path::new(what).file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    format!("{kind}__{}__{seed}__{:016x}", slug(&stem), fnv(all.as_bytes()))
}

/// A name as part of a file's.
pub(crate) fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}

/// Where a plan lies: its name ends with a fingerprint, so that another plan of the experiment never takes the place of one whose
/// lines are being worked on.
pub fn plan_file(runs: &Path, name: &str, tasks: &[Task]) -> PathBuf {
    let name: String = slug(name).chars().take(LONGEST_NAME).collect();
    runs.join(format!("{name}-{:08x}.plan.jsonl", fnv(plan_text(tasks).as_bytes()) as u32))
}

/// FNV-1a: the same on every machine and in every version, which the standard library's hashes do not promise.
fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// The plan as JSON, one task a line.
pub fn plan_text(tasks: &[Task]) -> String {
    // As above.
    tasks.iter().map(|task| serde_json::to_string(task).unwrap_or_default() + "\n").collect()
}

/// Writes a plan.
///
/// # Errors
/// If the file cannot be written.
pub fn write_plan(path: &Path, tasks: &[Task]) -> Result<(), PlanError> {
    Ok(write_file(path, &plan_text(tasks))?)
}

/// Reads a plan.
///
/// # Errors
/// If the file is missing or no plan.
pub fn read_plan(path: &Path) -> Result<Vec<Task>, PlanError> {
    let fail = |why: String| PlanError::Read { path: path.to_path_buf(), why };
    let file = std::fs::File::open(path).map_err(|error| fail(error.to_string()))?;
    let mut tasks = Vec::new();
    for (index, line) in std::io::BufReader::new(file).lines().enumerate() {
        let line = line.map_err(|error| fail(error.to_string()))?;
        let task = serde_json::from_str(&line);
        tasks.push(task.map_err(|error| fail(format!("line {}: {error}", index + 1)))?);
    }
    Ok(tasks)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str, config: &PlanConfig) -> Vec<Task> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        std::fs::write(&path, text).unwrap();
        Experiment::load(path.to_str().unwrap()).unwrap().plan(config).unwrap()
    }

    const MINE: &str = r#"
title = "T"
source = "S"
songs = ["twinkle", "c-major-scale"]
seeds = 2
[[variants]]
name = "fences"
[[variants]]
name = "none"
set = ["task.stage.fences=false"]
[grid]
"task.randomisation.intensity" = [0.0, 0.5, 1.0]
[perform]
modes = ["real"]
runs = 3
"#;

    #[test]
    fn a_plan_is_the_product_of_songs_variants_grid_and_seeds() {
        let tasks = plan(MINE, &PlanConfig::default());
        assert_eq!(tasks.len(), 2 * 2 * 3 * 2);
        let ids: BTreeSet<&str> = tasks.iter().map(|task| task.id.as_str()).collect();
        assert_eq!(ids.len(), tasks.len());
        let labels = &tasks[1].labels;
        assert_eq!(labels["song"], "twinkle");
        assert_eq!(labels["variant"], "fences");
        assert_eq!(labels["intensity"], "0.5");
        assert_eq!(plan(MINE, &PlanConfig { seeds: Some(1), ..PlanConfig::default() }).len(), 12);
    }

    #[test]
    fn ids_are_those_of_the_work_whoever_asks_for_it() {
        let tasks = plan(MINE, &PlanConfig::default());
        assert_eq!(plan(MINE, &PlanConfig::default()), tasks);
        // Said in other words, it is the same work.
        let other = MINE
            .replace("name = \"none\"", "name = \"without\"")
            .replace("seeds = 2", "seeds = 2\nset = [\"task.stage.fences=true\"]");
        let others = plan(&other, &PlanConfig::default());
        let ids = |tasks: &[Task]| tasks.iter().map(|task| task.id.clone()).collect::<Vec<_>>();
        assert_eq!(ids(&others), ids(&tasks));
        let threads = PlanConfig { set: vec!["trainer.threads=1".to_string()], ..PlanConfig::default() };
        assert_eq!(ids(&plan(MINE, &threads)), ids(&tasks));
        let steps = PlanConfig { set: vec!["trainer.total_steps=1000".to_string()], ..PlanConfig::default() };
        assert!(ids(&plan(MINE, &steps)).iter().all(|id| !ids(&tasks).contains(id)));
    }

    #[test]
    fn another_plan_has_another_file() {
        let tasks = plan(MINE, &PlanConfig::default());
        let file = |tasks: &[Task]| plan_file(Path::new("runs"), "my plan", tasks);
        assert_eq!(file(&tasks), file(&tasks));
        assert_ne!(file(&tasks), file(&tasks[1..]));
        assert!(file(&tasks).display().to_string().starts_with("runs/my-plan-"));
    }

    #[test]
    fn a_smoke_test_does_everything_once() {
        let tasks = plan(MINE, &PlanConfig { budget: Budget::Smoke, ..PlanConfig::default() });
        assert_eq!(tasks.len(), 2 * 2);
        let Work::Train { training, perform } = &tasks[0].work else { panic!("{tasks:?}") };
        assert_eq!(training.resolve().unwrap().trainer.total_steps, 480);
        assert_eq!(perform.as_ref().unwrap().runs, 1);
    }

    #[test]
    fn a_plan_comes_back_from_its_file_and_a_damaged_one_says_where() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plan.jsonl");
        let tasks = plan(MINE, &PlanConfig::default());
        write_plan(&path, &tasks).unwrap();
        assert_eq!(read_plan(&path).unwrap(), tasks);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replacen("labels", "lables", 2)).unwrap();
        assert!(read_plan(&path).unwrap_err().to_string().contains("line 1"));
    }

    #[test]
    fn every_experiment_that_comes_with_us_can_be_planned() {
        for name in crate::config::names() {
            for budget in [Budget::Full, Budget::Smoke] {
                let config = PlanConfig { budget, ..PlanConfig::default() };
                assert!(!Experiment::load(name).unwrap().plan(&config).unwrap().is_empty(), "{name}");
            }
        }
    }
}
