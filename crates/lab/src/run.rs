//! Training a song: the run folder, its description, and the trainer in it.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use etude_learn::{Outcome, Parts, TrainError, Trainer, TrainerConfig, TrainingObserver, seed};
use etude_music::{Song, SongError};
use etude_perform::{FileError, write_text};
use etude_task::{Piece, ScriptedPlayer, SongEvaluator, TaskError, VectorPiano};
use serde_json::json;

use crate::config::{ConfigError, RunConfig, change_free, resolve as resolve_config};

/// A run could not be started, continued or read.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The trainer stopped with an error.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The task could not be built.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The song cannot be played.
    #[error(transparent)]
    Song(#[from] SongError),
    /// The configuration is not sound.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The folder holds no run.
    #[error("{0} holds no run to continue; `etude train SONG -o {0}` starts one")]
    NoRun(PathBuf),
    /// The folder holds one already.
    #[error(
        "{0} holds a training already: `etude train --resume {0}` continues it, or choose another folder with -o"
    )]
    AlreadyStarted(PathBuf),
    /// Another process is at work in the folder.
    #[error(
        "another `etude train` is at work in {0}: wait for it, stop it, or choose another folder with -o"
    )]
    Busy(PathBuf),
    /// A file of the run cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
    /// The folder or its lock cannot be made.
    #[error("cannot create {path}: {source}; choose another folder with -o")]
    Folder {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Name of the resolved configuration in a run's folder.
const CONFIG: &str = "config.toml";
/// Name of the song in a run's folder: the run needs nothing else to be continued or played.
const SONG: &str = "song.mid";
/// Name of the description of who made the run and how.
const META: &str = "meta.json";
/// Name of the file that a process locks while it works in a run's folder. The system lets go of it at every death.
const LOCK: &str = "run.lock";

/// A training in its folder, which no other process can work in meanwhile.
pub struct Run {
    song: Song,
    config: RunConfig,
    trainer: Trainer,
    _lock: File,
}

impl Run {
    /// Starts a training of `song` in `folder`. `command` is recorded.
    ///
    /// # Errors
    /// If the song or configuration cannot be used, or the folder cannot be written or already holds a run. Nothing is
    /// written before song and configuration are known to be sound.
    pub fn start(song: Song, config: RunConfig, folder: &Path, command: &str) -> Result<Self, RunError> {
        if Trainer::exists(folder) {
            return Err(RunError::AlreadyStarted(folder.to_path_buf()));
        }
        let config = config.complete();
        config.check()?;
        let parts = parts(&song, &config)?;
        let fail = |source| RunError::Folder { path: folder.to_path_buf(), source };
        std::fs::create_dir_all(folder).map_err(fail)?;
        let lock = lock(folder)?;
        write_config(folder, &config)?;
        song.save(folder.join(SONG))?;
        let meta = json!({
            "command": command,
            "song": song.title(),
            "etude": env!("CARGO_PKG_VERSION"),
            "mujoco": etude_stage::mujoco_version(),
            "cores": std::thread::available_parallelism().map_or(0, usize::from),
            "machine": std::env::consts::ARCH,
        });
        write_text(&folder.join(META), &format!("{meta:#}\n"))?;
        let trainer = Trainer::start(folder, &config.droq, &config.trainer, parts)?;
        Ok(Self { song, config, trainer, _lock: lock })
    }

    /// Opens the training in `folder` to continue it from its last checkpoint, bit for bit. `overrides` may change how
    /// long it goes on and how often it is looked at, nothing that has shaped it.
    ///
    /// # Errors
    /// If the folder holds no run or a damaged one, or an override would make another training of it.
    pub fn resume(folder: &Path, overrides: &[String]) -> Result<Self, RunError> {
        if !folder.join(CONFIG).is_file() || !folder.join(SONG).is_file() {
            return Err(RunError::NoRun(folder.to_path_buf()));
        }
        let config = resolve_config("paper", Some(&folder.join(CONFIG)), &[])?;
        let config = change_free(&config, overrides)?;
        config.check()?;
        let song = titled(Song::load(folder.join(SONG))?, folder)?;
        let lock = lock(folder)?;
        let trainer = Trainer::resume(folder, &config.droq, &config.trainer, parts(&song, &config)?)?;
        if !overrides.is_empty() {
            write_config(folder, &config)?;
        }
        Ok(Self { song, config, trainer, _lock: lock })
    }

    /// The song that is learned.
    pub fn song(&self) -> &Song {
        &self.song
    }

    /// The resolved configuration.
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// Environment steps made so far.
    pub fn step(&self) -> u64 {
        self.trainer.step()
    }

    /// The best F1 of the evaluations so far.
    pub fn best_f1(&self) -> Option<f64> {
        self.trainer.best().and_then(|best| best.scores.first()).map(|score| score.value)
    }

    /// Trains to the end, or until the observer stops it; in both cases everything is saved.
    ///
    /// # Errors
    /// If the training fails; the last checkpoint is then intact.
    pub fn run(&mut self, observer: &mut dyn TrainingObserver) -> Result<Outcome, RunError> {
        Ok(self.trainer.run(observer)?)
    }
}

/// The policy file of the run in `folder` that should be played: the best, or the last while none has been evaluated.
pub(crate) fn policy_in(folder: &Path) -> Option<PathBuf> {
    ["policy-best.safetensors", "policy-last.safetensors"]
        .map(|name| folder.join(name))
        .into_iter()
        .find(|path| path.is_file())
}

/// The song of this name or path; that of a run's folder keeps the title that it was learned under.
///
/// # Errors
/// As [`etude_music::resolve`].
pub fn find_song(name_or_path: &str) -> Result<Song, SongError> {
    let song = etude_music::resolve(name_or_path)?;
    match Path::new(name_or_path).parent() {
        Some(folder) if Path::new(name_or_path).ends_with(SONG) => titled(song, folder),
        _ => Ok(song),
    }
}

/// `song` under the title that the description of the run in `folder` gives it, if there is one.
fn titled(song: Song, folder: &Path) -> Result<Song, SongError> {
    let title = std::fs::read(folder.join(META))
        .ok()
        .and_then(|text| serde_json::from_slice::<serde_json::Value>(&text).ok())
        .and_then(|meta| meta["song"].as_str().map(str::to_string));
    let Some(title) = title else { return Ok(song) };
    let beats = song.beats().clone();
    Ok(Song::new(title, song.notes().to_vec(), song.duration_secs())?.with_beats(beats))
}

fn write_config(folder: &Path, config: &RunConfig) -> Result<(), RunError> {
    let text = toml::to_string(config).map_err(|e| ConfigError::Syntax {
        origin: "the resolved configuration".to_string(),
        message: e.to_string(),
    })?;
    Ok(write_text(&folder.join(CONFIG), &text)?)
}

/// Takes the lock of `folder`. Where the file system has no locks, everyone has it.
fn lock(folder: &Path) -> Result<File, RunError> {
    let path = folder.join(LOCK);
    let file = File::create(&path).map_err(|source| RunError::Folder { path, source })?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(RunError::Busy(folder.to_path_buf())),
        _ => Ok(file),
    }
}

fn parts(song: &Song, config: &RunConfig) -> Result<Parts, RunError> {
    let piece = Piece::new(song, config.task.initial_silence_secs)?;
    let root = seed::split(config.trainer.seed, "task");
    let mut environment = VectorPiano::new(&config.task, &piece, config.trainer.num_envs, root)?;
    if config.trainer.demonstration_share > 0.0 {
        environment = environment.with_demonstrator(ScriptedPlayer::new(&config.task, &piece)?);
    }
    let evaluator = SongEvaluator::new(&config.task, &piece)?;
    // How the work is spread over threads shapes nothing, so it is no part of a policy: same seed, same bytes.
    let defaults = TrainerConfig::default();
    let (threads, overlap) = (defaults.threads, defaults.overlap);
    let trainer = TrainerConfig { threads, overlap, ..config.trainer.clone() };
    let notes = json!({ "song": song.title(), "config": RunConfig { trainer, ..config.clone() } });
    Ok(Parts { environment: Box::new(environment), evaluator: Box::new(evaluator), notes })
}
