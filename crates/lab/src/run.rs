//! Training a song: the run folder, its description, and the trainer in it.

use std::path::{Path, PathBuf};

use etude_learn::{Outcome, Parts, TrainError, Trainer, TrainingObserver, seed};
use etude_music::{Song, SongError};
use etude_task::{Piece, SongEvaluator, TaskError, VectorPiano};
use serde_json::json;

use crate::config::{ConfigError, RunConfig, resolve as resolve_config};

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
    #[error("{0} holds no run to continue; `etude train SONG` starts one")]
    NoRun(PathBuf),
    /// A file of the run cannot be read or written.
    #[error("cannot {verb} {path}: {source}")]
    File {
        /// `read` or `write`.
        verb: &'static str,
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

/// Starts a training of `song` in `folder` and runs it to its end or until the observer stops it. `command` is recorded.
///
/// # Errors
/// If the song or configuration cannot be used, the folder already holds a run, or the training fails.
pub fn train(
    song: &Song,
    config: &RunConfig,
    folder: &Path,
    command: &str,
    observer: &mut dyn TrainingObserver,
) -> Result<Outcome, RunError> {
    let parts = parts(song, config)?;
    std::fs::create_dir_all(folder).map_err(|source| file("create", folder, source))?;
    if Trainer::exists(folder) {
        return Err(TrainError::AlreadyStarted { folder: folder.to_owned() }.into());
    }
    let text = toml::to_string(config).map_err(|e| ConfigError::Syntax {
        origin: "the resolved configuration".to_string(),
        message: e.to_string(),
    })?;
    write(&folder.join(CONFIG), text.as_bytes())?;
    song.save(folder.join(SONG))?;
    let meta = json!({
        "command": command,
        "song": song.title(),
        "etude": env!("CARGO_PKG_VERSION"),
        "mujoco": etude_stage::mujoco_version(),
        "cores": std::thread::available_parallelism().map_or(0, usize::from),
        "machine": std::env::consts::ARCH,
    });
    write(&folder.join(META), format!("{meta:#}\n").as_bytes())?;
    Ok(Trainer::start(folder, &config.droq, &config.trainer, parts)?.run(observer)?)
}

/// Continues the training in `folder` from its last checkpoint, bit for bit.
///
/// # Errors
/// If the folder holds no run, or the training fails.
pub fn resume(folder: &Path, observer: &mut dyn TrainingObserver) -> Result<Outcome, RunError> {
    let (song, config) = open_run(folder)?;
    let parts = parts(&song, &config)?;
    Ok(Trainer::resume(folder, &config.droq, &config.trainer, parts)?.run(observer)?)
}

/// The song and the configuration of the run in `folder`.
///
/// # Errors
/// If the folder holds no run or its files are damaged.
pub fn open_run(folder: &Path) -> Result<(Song, RunConfig), RunError> {
    if !folder.join(CONFIG).is_file() || !folder.join(SONG).is_file() {
        return Err(RunError::NoRun(folder.to_path_buf()));
    }
    let config = resolve_config("paper", Some(&folder.join(CONFIG)), &[])?;
    let song = Song::load(folder.join(SONG))?;
    let title = std::fs::read(folder.join(META))
        .ok()
        .and_then(|text| serde_json::from_slice::<serde_json::Value>(&text).ok())
        .and_then(|meta| meta["song"].as_str().map(str::to_string))
        .unwrap_or_else(|| song.title().to_string());
    let beats = song.beats().clone();
    let song = Song::new(title, song.notes().to_vec(), song.duration_secs())?.with_beats(beats);
    Ok((song, config))
}

fn parts(song: &Song, config: &RunConfig) -> Result<Parts, RunError> {
    let piece = Piece::new(song, config.task.initial_silence_secs)?;
    let root = seed::split(config.trainer.seed, "task");
    let environment = VectorPiano::new(&config.task, &piece, config.trainer.num_envs, root)?;
    let evaluator = SongEvaluator::new(&config.task, &piece)?;
    let notes = json!({ "song": song.title(), "config": config });
    Ok(Parts { environment: Box::new(environment), evaluator: Box::new(evaluator), notes })
}

fn file(verb: &'static str, path: &Path, source: std::io::Error) -> RunError {
    RunError::File { verb, path: path.to_path_buf(), source }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), RunError> {
    std::fs::write(path, bytes).map_err(|source| file("write", path, source))
}
