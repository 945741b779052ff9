//! Playing a song with a policy and keeping what came of it: scores, MIDI, sound, frames, recording.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use etude_learn::Policy;
use etude_music::metrics::{FrameScores, NoteScores};
use etude_music::sound::{self, SoundError, SoundFont};
use etude_music::{CONTROL_HZ, Song, SongError};
use etude_perform::{
    FileError, Header, KeyMessage, RecordingError, RecordingWriter, StepMessage, write_frames_csv, write_text,
};
use etude_stage::{FINGERS, JOINT_NAMES};
use etude_task::{Performance, Piece, TaskError, layout, rehearse, targets};
use serde::Serialize;
use serde_json::json;

use crate::config::{ConfigError, RunConfig, change};
use crate::run::policy_in;

/// A song could not be played.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// Nobody has learned it.
    #[error(
        "there is no policy for `{song}` yet: `etude train {song}` makes one, or name one with --policy \
         (looked in {places})"
    )]
    NoPolicy {
        /// The song.
        song: String,
        /// Folders that were searched.
        places: String,
    },
    /// The folder holds none.
    #[error("{0} holds no policy; name the folder of a run, or a policy file")]
    NoPolicyIn(PathBuf),
    /// The policy file cannot be read.
    #[error(transparent)]
    PolicyFile(#[from] etude_learn::FileError),
    /// An override is not sound.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The policy file cannot be used.
    #[error("cannot use the policy {path}: {message}")]
    Policy {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// The task could not be built.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The song cannot be played.
    #[error(transparent)]
    Song(#[from] SongError),
    /// The sound could not be made or written.
    #[error(transparent)]
    Sound(#[from] SoundError),
    /// The recording could not be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A file could not be written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The folder cannot be made.
    #[error("cannot make the folder {path}: {source}; choose another with -o")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Who plays: a policy and the task that it learned.
pub struct Player {
    policy: Policy,
    /// The file that the policy came from.
    pub path: PathBuf,
    /// The configuration that it was trained with.
    pub config: RunConfig,
    /// Title of the song that it learned, if the file says.
    pub song: Option<String>,
    /// F1 that the file claims, if it says.
    pub claimed_f1: Option<f64>,
}

/// Where shipped policies are looked for: the working folder, beside an installed binary, the source tree.
fn policy_folders() -> Vec<PathBuf> {
    let mut folders = vec![PathBuf::from("policies")];
    if let Some(prefix) =
        std::env::current_exe().ok().as_deref().and_then(Path::parent).and_then(Path::parent)
    {
        folders.push(prefix.join("share/etude/policies"));
    }
    folders.push(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../policies"));
    folders
}

/// The policies that come with Étude for `slug`, and those of the runs in `runs` that learned it.
pub fn shipped_policies(slug: &str, runs: &Path) -> Vec<PathBuf> {
    let shipped = policy_folders().into_iter().map(|folder| folder.join(format!("{slug}.safetensors")));
    let mut found: Vec<PathBuf> = shipped.filter(|path| path.is_file()).take(1).collect();
    let mut own: Vec<PathBuf> = std::fs::read_dir(runs)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| {
            let name = entry.file_name();
            name.to_string_lossy()
                .strip_prefix(slug)
                .is_some_and(|rest| rest.is_empty() || rest.starts_with("__"))
        })
        .filter_map(|entry| policy_in(&entry.path()))
        .collect();
    own.sort();
    found.extend(own);
    found
}

/// Loads the policy at `path` (a policy file or a run's folder), or else the best usable one that there is for `slug`,
/// the short form of the song that was `asked` for.
///
/// # Errors
/// If there is none, or it cannot be used.
pub fn load_player(asked: &str, slug: &str, path: Option<&Path>, runs: &Path) -> Result<Player, PlayError> {
    if let Some(path) = path {
        if !path.is_dir() {
            return open(path);
        }
        return open(&policy_in(path).ok_or_else(|| PlayError::NoPolicyIn(path.to_path_buf()))?);
    }
    // One damaged file must not keep the others from playing.
    let (mut players, mut errors) = (Vec::new(), Vec::new());
    for path in shipped_policies(slug, runs) {
        match open(&path) {
            Ok(player) => players.push(player),
            Err(error) => errors.push(error),
        }
    }
    players.sort_by(|a, b| b.claimed_f1.unwrap_or(0.0).total_cmp(&a.claimed_f1.unwrap_or(0.0)));
    let none = || PlayError::NoPolicy {
        song: asked.to_string(),
        places: format!("policies/ and {}", runs.display()),
    };
    players.into_iter().next().ok_or_else(|| errors.into_iter().next().unwrap_or_else(none))
}

fn open(path: &Path) -> Result<Player, PlayError> {
    let fail = |message: String| PlayError::Policy { path: path.to_path_buf(), message };
    let policy = Policy::load(path)?;
    let notes = &policy.header().notes;
    let training = &notes["training"];
    let config: RunConfig = serde_json::from_value(training["config"].clone())
        .map_err(|e| fail(format!("its training configuration cannot be read: {e}")))?;
    if layout(&config.task) != policy.header().layout || policy.header().action_len != etude_task::ACTION_LEN
    {
        return Err(fail("it was trained for another observation or action".to_string()));
    }
    let song = training["song"].as_str().map(str::to_string);
    let claimed_f1 = notes["scores"]["f1"].as_f64();
    Ok(Player { policy, path: path.to_path_buf(), config, song, claimed_f1 })
}

impl Player {
    /// Changes the world that the policy is played in, by overrides of the form `a.b=value`.
    ///
    /// # Errors
    /// If an override is not sound, or would change what the policy sees.
    pub fn reconfigure(&mut self, overrides: &[String]) -> Result<(), PlayError> {
        let changed = change(&self.config, overrides)?;
        if layout(&changed.task) != self.policy.header().layout {
            let message = "it was trained for another observation than these overrides make".to_string();
            return Err(PlayError::Policy { path: self.path.clone(), message });
        }
        self.config = changed;
        Ok(())
    }
}

/// What came of a performance: every figure and where the files are. Its keys are those of `etude play --json`.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Title of the song.
    pub song: String,
    /// The policy file, or `scripted`.
    pub player: String,
    /// Control steps.
    pub steps: usize,
    /// Scores by control step: `precision`, `recall`, `f1`, `pooled_…`.
    #[serde(flatten)]
    pub frame: FrameScores,
    /// Scores by note: `onset_…`, `onset_offset_…`, `matched`, `missed`, `wrong`.
    #[serde(flatten)]
    pub note: NoteScores,
    /// Sum of the rewards.
    pub reward: f64,
    /// Fraction of control steps without a collision.
    pub collision_free: f64,
    /// The files that were written.
    pub files: Option<Files>,
}

/// Files of a performance.
#[derive(Clone, Debug, Serialize)]
pub struct Files {
    /// What was played, as MIDI.
    pub midi: PathBuf,
    /// What was played, as sound.
    pub wav: PathBuf,
    /// Keys due and pressed at each control step.
    pub frames: PathBuf,
    /// Every control step, as MCAP.
    pub recording: PathBuf,
    /// This report, as JSON.
    pub report: PathBuf,
}

/// Plays the whole song and, if a `folder` is given, writes the files into it.
///
/// # Errors
/// If the song does not fit the keyboard, or a file cannot be written.
pub fn perform(
    song: &Song,
    player: &mut Player,
    folder: Option<&Path>,
    font: Option<&SoundFont>,
) -> Result<Report, PlayError> {
    let config = player.config.clone();
    let piece = Piece::new(song, config.task.initial_silence_secs)?;
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder)
            .map_err(|source| PlayError::Folder { path: folder.to_path_buf(), source })?;
    }
    let name = player.path.display().to_string();
    let recorder = folder.map(|folder| recorder(folder, &piece, &name, &config)).transpose()?;
    let recorder = RefCell::new((recorder, Ok(())));
    let policy = &mut player.policy;
    let performance = rehearse(
        &config.task,
        &piece,
        config.trainer.seed,
        &mut |_, observation, action| policy.act(observation, action),
        &mut |environment, action| {
            let (writer, outcome) = &mut *recorder.borrow_mut();
            if let (Some(writer), Ok(())) = (writer, &outcome) {
                *outcome = record(writer, environment, action);
            }
        },
    )?;
    let (writer, outcome) = recorder.into_inner();
    outcome?;
    if let Some(writer) = writer {
        writer.finish()?;
    }
    let mut report = Report {
        song: song.title().to_string(),
        player: name,
        steps: performance.pressed.len(),
        frame: performance.frame_scores(),
        note: performance.note_scores(),
        reward: performance.reward,
        collision_free: performance.collision_free,
        files: None,
    };
    if let Some(folder) = folder {
        report.files = Some(keep(folder, song, &performance, font)?);
        // A report is plain numbers and strings: writing it as JSON cannot fail.
        let text = serde_json::to_string_pretty(&report).unwrap_or_default();
        write_text(&folder.join(REPORT), &(text + "\n"))?;
    }
    Ok(report)
}

const REPORT: &str = "report.json";

fn recorder(
    folder: &Path,
    piece: &Piece,
    player: &str,
    config: &RunConfig,
) -> Result<RecordingWriter, RecordingError> {
    let header = Header {
        song: piece.title().to_string(),
        player: player.to_string(),
        rig: "simulation".to_string(),
        control_hz: CONTROL_HZ,
        joints: JOINT_NAMES.map(str::to_string).to_vec(),
        due: piece.frames().iter().map(|keys| keys.pitches().collect()).collect(),
        config: json!(config),
        ..Header::default()
    };
    RecordingWriter::create(&folder.join("recording.mcap"), &header)
}

fn record(
    writer: &mut RecordingWriter,
    environment: &etude_task::Environment,
    action: &[f32; etude_task::ACTION_LEN],
) -> Result<(), RecordingError> {
    let world = environment.world();
    for event in world.events() {
        let pitch = etude_music::LOWEST_PITCH + event.key as u8;
        writer.key(&KeyMessage { secs: event.secs, pitch, velocity: event.velocity })?;
    }
    let message = StepMessage {
        step: environment.position() as u64 - 1,
        targets: targets(action).to_vec(),
        positions: world.joints().to_vec(),
        velocities: world.joint_velocities().to_vec(),
        torques: world.torques().to_vec(),
        fingertips: (0..FINGERS).map(|finger| world.fingertip(finger)).collect(),
        pressed: world.pressed().pitches().collect(),
    };
    writer.step(world.time_secs(), &message)
}

fn keep(
    folder: &Path,
    song: &Song,
    performance: &Performance,
    font: Option<&SoundFont>,
) -> Result<Files, PlayError> {
    let files = Files {
        midi: folder.join("performance.mid"),
        wav: folder.join("performance.wav"),
        frames: folder.join("frames.csv"),
        recording: folder.join("recording.mcap"),
        report: folder.join(REPORT),
    };
    let secs = performance.pressed.len() as f64 / CONTROL_HZ;
    Song::new(song.title(), performance.notes(), secs)?.save(&files.midi)?;
    sound::write_wav(&files.wav, &sound::render(&performance.notes(), font)?)?;
    write_frames_csv(&files.frames, &performance.due, Some(&performance.pressed))?;
    Ok(files)
}
