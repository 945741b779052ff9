//! Playing a song with a policy and keeping what came of it: scores, MIDI, sound, frames, recording.

use std::cell::RefCell;
use std::path::{Path, PathBuf};

use etude_music::metrics::{FrameScores, NoteScores};
use etude_music::sound::{self, SoundError, SoundFont};
use etude_music::{CONTROL_HZ, Note, Song, SongError};
use etude_perform::{
    FileError, Header, KeyMessage, PerformError, RecordingError, RecordingWriter, RewardMessage, StepMessage,
    write_file, write_frames_csv,
};
use etude_stage::{FINGERS, JOINT_NAMES};
use etude_task::{Performance, Piece, TaskError, rehearse};
use serde::Serialize;
use serde_json::json;

use crate::config::RunConfig;
use crate::player::Player;
use etude_perform::stand::StandError;

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
    Config(#[from] anyhow::Error),
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
    /// The rig cannot be used.
    #[error(transparent)]
    Stand(#[from] StandError),
    /// Nobody knows whether the robot stands still.
    #[error("{0}")]
    NotLetGo(String),
    /// A second run would begin where the first one ended.
    #[error("several runs need --home: each begins where the song begins, and the one before ends elsewhere")]
    RunsWithoutHome,
    /// The robot did not get ready, or would not play.
    #[error(transparent)]
    Perform(#[from] PerformError),
    /// The folder cannot be made.
    #[error("cannot make the folder {path}: {source}; choose another with -o")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
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
    /// What limits the scripted player on this song; absent for a policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limits: Option<String>,
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
    let name = player.name();
    let recorder = folder.map(|folder| recorder(folder, &piece, &name, &config)).transpose()?;
    let recorder = RefCell::new((recorder, Ok(())));
    let (mut act, limits) = player.mind.act(&config.task, &piece)?;
    let performance =
        rehearse(&config.task, &piece, config.trainer.seed, &mut *act, &mut |environment, action, parts| {
            let (writer, outcome) = &mut *recorder.borrow_mut();
            if let (Some(writer), Ok(())) = (writer, &outcome) {
                *outcome = record(writer, environment, action, parts);
            }
        })?;
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
        limits,
        files: None,
    };
    if let Some(folder) = folder {
        report.files = Some(keep(folder, song, &performance, font)?);
        // A report is plain numbers and strings: writing it as JSON cannot fail.
        let text = serde_json::to_string_pretty(&report).unwrap_or_default();
        write_file(&folder.join(REPORT), &(text + "\n"))?;
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
        bar_secs: piece.bars().to_vec(),
        config: json!(config),
        ..Header::default()
    };
    RecordingWriter::create(&folder.join("recording.mcap"), &header)
}

fn record(
    writer: &mut RecordingWriter,
    environment: &etude_task::Environment,
    action: &[f32; etude_task::ACTION_LEN],
    parts: &[f32],
) -> Result<(), RecordingError> {
    let world = environment.world();
    for event in world.events() {
        let pitch = etude_music::LOWEST_PITCH + event.key as u8;
        writer.key(&KeyMessage { secs: event.secs, pitch, velocity: event.velocity })?;
    }
    let message = StepMessage {
        step: environment.position() as u64 - 1,
        targets: environment.range().targets(action).to_vec(),
        positions: world.joints().to_vec(),
        velocities: world.joint_velocities().to_vec(),
        torques: world.torques().to_vec(),
        fingertips: (0..FINGERS).map(|finger| world.fingertip(finger)).collect(),
        pressed: world.pressed().pitches().collect(),
    };
    writer.step(world.time_secs(), &message)?;
    let terms = environment.reward().names().zip(parts);
    let terms = terms.map(|(name, part)| (name.to_string(), f64::from(*part))).collect();
    writer.reward(world.time_secs(), &RewardMessage { step: message.step, terms })
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
    keep_music(&files.midi, &files.wav, song.title(), performance.notes(), secs, font)?;
    write_frames_csv(&files.frames, &performance.due, Some(&performance.pressed))?;
    Ok(files)
}

/// Writes what was played as MIDI and as sound.
pub(crate) fn keep_music(
    midi: &Path,
    wav: &Path,
    title: &str,
    notes: Vec<Note>,
    secs: f64,
    font: Option<&SoundFont>,
) -> Result<(), PlayError> {
    sound::write_wav(wav, &sound::render(&notes, font)?)?;
    Ok(Song::new(title, notes, secs)?.save(midi)?)
}
