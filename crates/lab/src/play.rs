//! Playing a song in simulation, and the files of a performance: scores, MIDI, sound, frames,
//! recording.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::bail;
use etude_music::sound::{self, SoundFont};
use etude_music::{CONTROL_HZ, Note, Song};
use etude_perform::{
    DueNote, Ending, Header, Job, Performance, RecordingWriter, Scores, SimRig, perform, write_frames_csv,
};
use etude_robot::rig_file::RigConfig;
use etude_stage::JOINT_NAMES;
use etude_task::{ACTION_LEN, Piece, Player as _};
use serde::Serialize;

use crate::errors::{Interrupted, unusable};
use crate::folder::SONG;
use crate::json_files::save_pretty;
use crate::loaded_player::LoadedPlayer;
use crate::results::in_new_result;
use crate::song_planner::SongPlanner;

/// The figures of a performance and its files. Its keys are those of `etude play --json`.
#[derive(Clone, Debug, Serialize)]
pub struct PlayReport {
    /// Title of the song.
    pub song: String,
    /// The policy file, or `scripted`.
    pub player: String,
    /// Control steps.
    pub steps: usize,
    /// Scores by control step and by note.
    #[serde(flatten)]
    pub scores: Scores,
    /// Sum of the rewards.
    pub reward: f64,
    /// Fraction of control steps without a collision.
    pub collision_free: f64,
    /// What limits the scripted baseline on this song; absent for a policy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limits: Option<String>,
    /// The files that were written.
    pub files: Files,
}

/// Files of a performance.
#[derive(Clone, Debug, Serialize)]
pub struct Files {
    /// What was played, as MIDI.
    pub midi: PathBuf,
    /// What was played, as sound.
    pub wav: PathBuf,
    /// What should have been played, as sound.
    pub reference: PathBuf,
    /// Keys due and pressed at each control step.
    pub frames: PathBuf,
    /// Every control step, as MCAP.
    pub recording: PathBuf,
    /// The report, as JSON; absent where one report covers several performances.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub report: Option<PathBuf>,
}

/// Plays the whole song and writes the files into a new numbered folder in `results`. `job`
/// receives the share that is played, 0 to 1.
///
/// # Errors
/// If the song does not fit the keyboard, a file cannot be written, or the job is interrupted:
/// nothing is kept then.
pub fn play(
    song: &Song,
    player: &LoadedPlayer,
    results: &Path,
    font: Option<&SoundFont>,
    planner: &mut SongPlanner<'_>,
    job: &mut Job<'_, f64>,
) -> anyhow::Result<PlayReport> {
    in_new_result(results, |_| true, |folder| play_into(folder, song, player, font, planner, job))
}

fn play_into(
    folder: &Path,
    song: &Song,
    player: &LoadedPlayer,
    font: Option<&SoundFont>,
    planner: &mut SongPlanner<'_>,
    job: &mut Job<'_, f64>,
) -> anyhow::Result<PlayReport> {
    let task = &player.config.task;
    let piece = planner.plan(song, task)?;
    let files = Files {
        midi: folder.join("performance.mid"),
        wav: folder.join("performance.wav"),
        reference: folder.join(REFERENCE),
        frames: folder.join("frames.csv"),
        recording: folder.join(RECORDING),
        report: Some(folder.join(REPORT)),
    };
    let header = header(&piece, player, "simulation", None);
    let mut writer = RecordingWriter::create(&files.recording, &header)?;
    let mut piece_player = player.for_piece(task, &piece, planner.on_progress())?;
    // The scores in a drawn world would depend on the draw; `etude evaluate` plays in many.
    let mut rig = SimRig::nominal(task, &piece)?;
    let interrupt = job.interrupt();
    let mut with_progress = |step: usize, observation: &[f32], action: &mut [f32; ACTION_LEN]| {
        job.report(&(step as f64 / piece.steps() as f64));
        piece_player.act(step, observation, action);
    };
    let performance = perform(&mut rig, &mut with_progress, task, &piece, Some(&mut writer), interrupt)?;
    writer.finish()?;
    if performance.ending != Ending::Complete {
        // A simulation can be played again.
        std::fs::remove_file(&files.recording).map_err(|error| unusable(&files.recording, error))?;
    }
    match &performance.ending {
        Ending::Complete => {}
        Ending::Interrupted => return Err(Interrupted("stopped; nothing was written".to_string()).into()),
        Ending::Fault(why) => bail!("the performance was stopped: {why}"),
    }
    let simulated = performance.simulation.unwrap_or_default();
    write_performance(&files, &performance, font)?;
    write_reference(&files.reference, &piece, font)?;
    let report = PlayReport {
        song: song.title().to_string(),
        player: player.name(),
        steps: performance.pressed.len(),
        scores: performance.scores(),
        reward: simulated.reward,
        collision_free: simulated.collision_free,
        limits: piece_player.limits(),
        files,
    };
    song.save(folder.join(SONG))?;
    save_pretty(&folder.join(REPORT), &report)?;
    Ok(report)
}

/// What was played, with its scores.
pub const REPORT: &str = "report.json";
/// The recording of a simulation.
pub const RECORDING: &str = "recording.mcap";
/// The page that `etude replay` makes of a recording.
pub const PAGE: &str = "replay.html";
/// What should have been played, as sound.
pub(crate) const REFERENCE: &str = "reference.wav";

/// Scores of the player in simulation alone, in the nominal world: the scores in a randomised
/// world depend on the draw.
///
/// # Errors
/// If the task of the player is not sound.
pub fn scores_in_simulation(
    player: &LoadedPlayer,
    piece: &Piece,
    planner: &mut SongPlanner<'_>,
) -> anyhow::Result<Scores> {
    let task = &player.config.task;
    let mut rig = SimRig::nominal(task, piece)?;
    let mut piece_player = player.for_piece(task, piece, planner.on_progress())?;
    Ok(perform(&mut rig, &mut piece_player, task, piece, None, &AtomicBool::new(false))?.scores())
}

/// Scores of the player in the worlds that the randomisation of its task draws for the seeds below
/// `worlds`.
///
/// # Errors
/// If the task of the player is not sound.
pub(crate) fn scores_in_worlds(
    player: &LoadedPlayer,
    piece: &Piece,
    planner: &mut SongPlanner<'_>,
    worlds: u64,
) -> anyhow::Result<Vec<Scores>> {
    let task = &player.config.task;
    let mut piece_player = player.for_piece(task, piece, planner.on_progress())?;
    let mut score = |seed| {
        let mut rig = SimRig::new(task, piece, seed)?;
        Ok(perform(&mut rig, &mut piece_player, task, piece, None, &AtomicBool::new(false))?.scores())
    };
    (0..worlds).map(&mut score).collect()
}

/// The header of a recording in which `player` plays `piece` on the rig that is called `rig`.
pub(crate) fn header(piece: &Piece, player: &LoadedPlayer, rig: &str, config: Option<RigConfig>) -> Header {
    Header {
        song: piece.title().to_string(),
        player: player.name(),
        rig: rig.to_string(),
        control_hz: CONTROL_HZ,
        joints: JOINT_NAMES.map(str::to_string).to_vec(),
        due: piece.frames().iter().map(|keys| keys.pitches().collect()).collect(),
        late_secs: config.as_ref().map(|_| piece.late_secs()),
        latency_compensation_secs: piece.latency_compensation_secs(),
        due_notes: piece.notes().iter().map(|note| DueNote::from(piece.as_written(*note))).collect(),
        bar_secs: piece.bars().iter().map(|secs| secs - piece.latency_compensation_secs()).collect(),
        run: Some(serde_json::to_value(&player.config).expect("a configuration is plain data")),
        rig_config: config,
        ..Header::default()
    }
}

/// Writes what should be played as sound.
pub(crate) fn write_reference(path: &Path, piece: &Piece, font: Option<&SoundFont>) -> anyhow::Result<()> {
    let notes: Vec<Note> = piece.notes().iter().map(|note| piece.as_written(*note)).collect();
    Ok(sound::write_wav(path, &sound::render(&notes, font)?)?)
}

/// Writes what was played as MIDI, as sound and as a table of keys.
pub(crate) fn write_performance(
    files: &Files,
    performance: &Performance,
    font: Option<&SoundFont>,
) -> anyhow::Result<()> {
    let piece = &performance.piece;
    let notes: Vec<Note> = performance.notes().into_iter().map(|note| piece.as_written(note)).collect();
    sound::write_wav(&files.wav, &sound::render(&notes, font)?)?;
    Song::new(piece.title(), notes, performance.secs())?.save(&files.midi)?;
    Ok(write_frames_csv(&files.frames, piece.frames(), Some(&performance.keys_heard()))?)
}
