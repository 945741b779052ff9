//! Playing a song on a robot: what it is worth there, what it is worth in simulation, and the gap between the two.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use etude_music::metrics::{FrameScores, NoteScores, frame_scores, note_scores};
use etude_music::sound::SoundFont;
use etude_music::{CONTROL_HZ, KeySet, Song, notes_from_key_events};
use etude_perform::{
    Ending, Header, Mode, Performer, Played, RecordingWriter, TimingReport, prepare, write_file,
    write_frames_csv,
};
use etude_stage::JOINT_NAMES;
use etude_task::{Piece, ScriptedPlayer, rehearse};
use serde::Serialize;
use serde_json::json;

use crate::play::{PlayError, keep_music};
use crate::player::{Mind, Player};
use etude_perform::stand::RigChoice;
use etude_perform::stand::Stand;

/// How to play.
#[derive(Clone, Debug)]
pub struct RobotPlay {
    /// The execution mode.
    pub mode: Mode,
    /// How many times.
    pub runs: usize,
    /// Whether the robot goes slowly to the keyboard first, from wherever it is. Without that it must be there.
    pub home: bool,
    /// Added to the seed of the twin's truth; each run adds one more.
    pub seed: u64,
}

/// What came of it. Its keys are those of `etude perform --json`.
#[derive(Clone, Debug, Serialize)]
pub struct RobotReport {
    /// Title of the song.
    pub song: String,
    /// The policy file, or `scripted`.
    pub player: String,
    /// The execution mode.
    pub mode: Mode,
    /// The rig: `twin`, or the name in its file.
    pub robot: String,
    /// Name of the twin's truth; absent for a rig.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<String>,
    /// F1 by control step of the same player in simulation.
    pub sim_f1: f64,
    /// Mean of the runs' F1 by control step.
    pub robot_f1: f64,
    /// Their standard deviation; 0 for one run.
    pub robot_f1_std: f64,
    /// `sim_f1` − `robot_f1`.
    pub gap: f64,
    /// The runs.
    pub runs: Vec<RobotRun>,
}

/// One run.
#[derive(Clone, Debug, Serialize)]
pub struct RobotRun {
    /// Scores by control step; steps after an early end count as silent.
    #[serde(flatten)]
    pub frame: FrameScores,
    /// Scores by note.
    #[serde(flatten)]
    pub note: NoteScores,
    /// F1 of the simulation that played along; absent in a mode without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alongside_f1: Option<f64>,
    /// Control steps played, of those in the song.
    pub steps: [usize; 2],
    /// `complete`, `interrupted`, or the fault.
    pub ending: String,
    /// Set-points that the limiter clamped, counted by joint.
    pub clamped: u64,
    /// Records that are missing in the recording.
    pub lost_records: u64,
    /// Deadlines and periods.
    pub timing: TimingReport,
    /// The files that were written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub files: Option<RunFiles>,
}

/// Files of one run.
#[derive(Clone, Debug, Serialize)]
pub struct RunFiles {
    /// Everything, as MCAP.
    pub recording: PathBuf,
    /// What was played, as MIDI.
    pub midi: PathBuf,
    /// What was played, as sound.
    pub wav: PathBuf,
    /// Keys due and pressed at each control step.
    pub frames: PathBuf,
}

impl RobotReport {
    /// Whether every run reached the end of the song.
    pub fn is_complete(&self) -> bool {
        self.runs.iter().all(|run| run.ending == COMPLETE)
    }
}

const COMPLETE: &str = "complete";

/// Plays the song on the robot and, if a `folder` is given, writes the files into it. `tell` hears of each run as it
/// ends. After a run that was cut short no other begins.
///
/// # Errors
/// If the robot does not get ready, or a file cannot be written. A fault on the way is told in the report.
#[allow(clippy::too_many_arguments)] // What is played, on what, how, and who hears of it.
pub fn play_on_robot(
    song: &Song,
    player: &mut Player,
    rig: &RigChoice,
    play: &RobotPlay,
    folder: Option<&Path>,
    font: Option<&SoundFont>,
    interrupt: &AtomicBool,
    tell: &mut dyn FnMut(usize, &RobotRun),
) -> Result<RobotReport, PlayError> {
    if play.runs > 1 && !play.home {
        return Err(PlayError::RunsWithoutHome);
    }
    let task = player.config.task.clone();
    let piece = Piece::new(song, task.initial_silence_secs)?;
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder)
            .map_err(|source| PlayError::Folder { path: folder.to_path_buf(), source })?;
    }
    let name = player.name();
    let header = Header {
        song: piece.title().to_string(),
        player: name.clone(),
        rig: rig.name().to_string(),
        control_hz: CONTROL_HZ,
        joints: JOINT_NAMES.map(str::to_string).to_vec(),
        due: piece.frames().iter().map(|keys| keys.pitches().collect()).collect(),
        bar_secs: piece.bars().to_vec(),
        mode: play.mode.name().to_string(),
        config: json!({ "run": player.config, "rig": rig.config() }),
        ..Header::default()
    };
    let mut report = RobotReport {
        song: song.title().to_string(),
        player: name,
        mode: play.mode,
        robot: header.rig.clone(),
        truth: match rig {
            RigChoice::Twin(truth) => Some(truth.name().to_string()),
            RigChoice::File { .. } => None,
        },
        sim_f1: in_simulation(player, &piece)?.f1,
        robot_f1: 0.0,
        robot_f1_std: 0.0,
        gap: 0.0,
        runs: Vec::new(),
    };
    let mut performer = Performer::new(&task, &piece, play.mode)?;
    let script = match &player.mind {
        Mind::Script => Some(ScriptedPlayer::new(&task, &piece)?),
        Mind::Policy(..) => None,
    };
    for run in 0..play.runs {
        let prefix = folder.map(|folder| folder.join(format!("run-{}", run + 1)));
        let recording = prefix.as_ref().map(|prefix| prefix.with_extension("mcap"));
        let mut writer = recording.as_ref().map(|path| RecordingWriter::create(path, &header)).transpose()?;
        let mut stand = rig.open(task.stage.side, play.seed.wrapping_add(run as u64))?;
        let pose = play.home.then(|| performer.start_pose());
        let Stand { robot, pace } = &mut stand;
        prepare(robot, pace, pose.as_ref(), writer.as_mut(), interrupt)?;
        let played = performer.play(
            robot,
            pace,
            &mut |step, observation, action| match (&script, &mut player.mind) {
                (Some(script), _) => *action = script.action(step),
                (None, Mind::Policy(policy, _)) => policy.act(observation, action),
                (None, Mind::Script) => {}
            },
            writer.as_mut(),
            interrupt,
        )?;
        stand.let_go().map_err(PlayError::NotLetGo)?;
        // Nobody needs to watch a robot that was let go while the files are written.
        drop(stand);
        if let Some(writer) = writer {
            writer.finish()?;
        }
        let files = prefix.map(|prefix| keep(&prefix, song, &piece, &played, font)).transpose()?;
        let result = judge(&piece, &played, files);
        tell(run, &result);
        report.runs.push(result);
        if played.ending != Ending::Complete {
            break;
        }
    }
    summarise(&mut report);
    if let Some(folder) = folder {
        // A report is plain numbers and strings: writing it as JSON cannot fail.
        let text = serde_json::to_string_pretty(&report).unwrap_or_default();
        write_file(&folder.join("report.json"), &(text + "\n"))?;
    }
    Ok(report)
}

/// Scores of the player in simulation alone, in the nominal world: one drawn world would flatter it or not.
///
/// # Errors
/// If the world cannot be built.
pub fn in_simulation(player: &mut Player, piece: &Piece) -> Result<FrameScores, PlayError> {
    let mut config = player.config.clone();
    config.task.randomisation.intensity = 0.0;
    let (mut act, _) = player.mind.act(&config.task, piece)?;
    let performance = rehearse(&config.task, piece, config.trainer.seed, &mut *act, &mut |_, _, _| {})?;
    Ok(performance.frame_scores())
}

/// Keys at each control step of the piece, silent where it was not played.
fn all_steps(piece: &Piece, pressed: &[KeySet]) -> Vec<KeySet> {
    (0..piece.steps()).map(|step| pressed.get(step).copied().unwrap_or_default()).collect()
}

fn judge(piece: &Piece, played: &Played, files: Option<RunFiles>) -> RobotRun {
    let pressed = all_steps(piece, &played.pressed);
    let alongside = all_steps(piece, &played.simulated);
    let notes = notes_from_key_events(&played.events, piece.steps() as f64 / CONTROL_HZ);
    RobotRun {
        frame: frame_scores(piece.frames(), &pressed),
        note: note_scores(piece.notes(), &notes),
        alongside_f1: (!played.simulated.is_empty()).then(|| frame_scores(piece.frames(), &alongside).f1),
        steps: [played.pressed.len(), piece.steps()],
        ending: match &played.ending {
            Ending::Complete => COMPLETE.to_string(),
            Ending::Interrupted => "interrupted".to_string(),
            Ending::Fault(fault) => fault.clone(),
        },
        clamped: played.clamped,
        lost_records: played.lost_records,
        timing: played.timing.report(),
        files,
    }
}

fn keep(
    prefix: &Path,
    song: &Song,
    piece: &Piece,
    played: &Played,
    font: Option<&SoundFont>,
) -> Result<RunFiles, PlayError> {
    let files = RunFiles {
        recording: prefix.with_extension("mcap"),
        midi: prefix.with_extension("mid"),
        wav: prefix.with_extension("wav"),
        frames: prefix.with_extension("csv"),
    };
    let secs = piece.steps() as f64 / CONTROL_HZ;
    let notes = notes_from_key_events(&played.events, secs);
    keep_music(&files.midi, &files.wav, song.title(), notes, secs, font)?;
    write_frames_csv(&files.frames, piece.frames(), Some(&all_steps(piece, &played.pressed)))?;
    Ok(files)
}

fn summarise(report: &mut RobotReport) {
    let scores: Vec<f64> = report.runs.iter().map(|run| run.frame.f1).collect();
    let count = scores.len() as f64;
    report.robot_f1 = scores.iter().sum::<f64>() / count.max(1.0);
    if scores.len() > 1 {
        let squares: f64 = scores.iter().map(|f1| (f1 - report.robot_f1).powi(2)).sum();
        report.robot_f1_std = (squares / (count - 1.0)).sqrt();
    }
    report.gap = report.sim_f1 - report.robot_f1;
}
