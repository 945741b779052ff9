//! Playing a song on a robot: the scores there and in simulation, and the gap between them.

mod report;

use std::path::Path;

use anyhow::bail;
use etude_music::Song;
use etude_music::sound::SoundFont;
use etude_perform::session::{RigChoice, Session};
use etude_perform::stats::{deviation, mean};
use etude_perform::{
    Activity, Correction, Ending, Header, Job, Mode, Performance, RecordingWriter, RobotRig, gap, perform,
    prepare, record_release,
};
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, World};
use etude_task::{Piece, TaskError};

use crate::errors::{Interrupted, released, unusable};
use crate::folder::SONG;
use crate::json_files::save_pretty;
use crate::loaded_player::LoadedPlayer;
use crate::play::{
    Files, REFERENCE, REPORT, header, scores_in_simulation, write_performance, write_reference,
};
use crate::results::in_new_result;
use crate::song_planner::SongPlanner;

pub(crate) use report::all_complete;
pub use report::{MeanNotes, RobotReport, RobotRun, RobotScores};

/// What to play on a robot, and how.
#[derive(Clone)]
pub struct RobotPlay<'a> {
    /// The song.
    pub song: &'a Song,
    /// The player.
    pub player: &'a LoadedPlayer,
    /// The robot.
    pub rig: &'a RigChoice,
    /// The execution mode.
    pub mode: Mode,
    /// How many times.
    pub runs: usize,
    /// Whether the robot first moves slowly to the keyboard, from any pose. Otherwise it must be
    /// there already.
    pub home: bool,
    /// Added to the seed of the twin parameters; each run adds one more.
    pub seed: u64,
    /// Whether one run before the others, with other noise of the twin, measures how late the
    /// robot's notes are. The latency compensation of the others is that, and it counts in no
    /// score.
    pub measures_lag: bool,
    /// A correction of the robot's motion that was learned on it, for a mode in which it follows
    /// simulated joints.
    pub correction: Option<Correction>,
    /// The sound of what is written; a built-in piano tone if there is none.
    pub font: Option<&'a SoundFont>,
}

impl<'a> RobotPlay<'a> {
    /// One run from the rest position, with nothing measured before and nothing corrected.
    pub fn new(song: &'a Song, player: &'a LoadedPlayer, rig: &'a RigChoice, mode: Mode) -> Self {
        let (home, measures_lag) = (true, false);
        Self { song, player, rig, mode, runs: 1, home, seed: 0, measures_lag, correction: None, font: None }
    }
}

/// Progress of a performance on a robot.
#[derive(Clone, Debug)]
pub enum RobotStep {
    /// Something that the operator should know before the robot plays.
    Warning(String),
    /// A run before the others has measured how late the notes are.
    LagMeasured {
        /// Its result.
        run: Box<RobotRun>,
        /// The latency compensation from now on, s; none if no note would be right with another
        /// one.
        latency_compensation_secs: Option<f64>,
    },
    /// A run has ended.
    RunEnded {
        /// Which one, from 0.
        index: usize,
        /// Its result.
        run: Box<RobotRun>,
    },
}

/// Kinds of the files of a run.
pub(crate) const RUN_FILES: [&str; 4] = ["mcap", "mid", "wav", "csv"];

/// Name of a file of run `index` of a performance.
pub fn run_file(index: usize, kind: &str) -> String {
    format!("run-{}.{kind}", index + 1)
}

/// Plays on the robot and, if there is a folder of `results`, writes the files into a new numbered
/// folder in it. `job` receives each run when it ends. A run that ends early is the last one, even
/// if it is the one that should measure the lag.
///
/// # Errors
/// If the robot does not get ready, a file cannot be written, or it was interrupted before the
/// first run ended. A fault during a run is in the report.
pub fn play_on_robot(
    play: &RobotPlay<'_>,
    results: Option<&Path>,
    planner: &mut SongPlanner<'_>,
    job: &mut Job<'_, RobotStep>,
) -> anyhow::Result<RobotReport> {
    if (play.runs > 1 || play.measures_lag) && !play.home {
        bail!(
            "several runs need --home: each begins where the song begins, and the one before ends elsewhere"
        );
    }
    let task = &play.player.config.task;
    let rig = play.rig.for_simulator(&task.params().map_err(TaskError::from)?);
    let play = &RobotPlay { rig: &rig, ..play.clone() };
    let piece = planner.plan(play.song, task)?;
    if let Some(correction) = play.correction.as_ref().filter(|correction| !correction.is_empty()) {
        if !play.mode.has_simulation() {
            bail!(
                "a correction is for a robot that follows simulated joints, not for the mode {}; use joint-mirroring or hybrid",
                play.mode
            );
        }
        if correction.len() != piece.steps() * PHYSICS_STEPS {
            bail!(
                "the correction is for {} control steps, and the song has {}: it was learned for another one; learn one for it with \
                 `etude rehearse --adapt`",
                correction.len() / PHYSICS_STEPS,
                piece.steps()
            );
        }
    }
    let mut play = |folder: Option<&Path>| {
        folder.map(|folder| play.song.save(folder.join(SONG))).transpose()?;
        let report = if play.measures_lag {
            play_on_time(play, &piece, folder, planner, job)
        } else {
            play_runs(play, &piece, folder, planner, job)
        }?;
        // A report written earlier would list the run that only measures the lag as a performance.
        if let Some(folder) = folder {
            save_pretty(&folder.join(REPORT), &report)?;
        }
        Ok(report)
    };
    let is_complete = |report: &RobotReport| report.runs[0].ending == Ending::Complete;
    match results {
        Some(results) => in_new_result(results, is_complete, |folder| play(Some(folder))),
        None => play(None),
    }
}

/// Plays `piece` once to measure how late the notes are, and then the runs that count, with that
/// latency compensation.
fn play_on_time(
    play: &RobotPlay<'_>,
    piece: &Piece,
    folder: Option<&Path>,
    planner: &mut SongPlanner<'_>,
    job: &mut Job<'_, RobotStep>,
) -> anyhow::Result<RobotReport> {
    let once = RobotPlay { runs: 1, seed: play.seed.wrapping_add(play.runs as u64), ..play.clone() };
    let interrupt = job.interrupt();
    let mut tell = |step: &RobotStep| {
        if matches!(step, RobotStep::Warning(_)) {
            job.report(step);
        }
    };
    let measured = play_runs(&once, piece, folder, planner, &mut Job::new(&mut tell, interrupt))?;
    let run = &measured.runs[0];
    if run.ending != Ending::Complete {
        job.report(&RobotStep::RunEnded { index: 0, run: Box::new(run.clone()) });
        return Ok(RobotReport { only_measuring: true, ..measured });
    }
    if let Some(folder) = folder {
        for file in RUN_FILES.map(|kind| folder.join(run_file(0, kind))) {
            std::fs::remove_file(&file).map_err(|error| unusable(&file, error))?;
        }
    }
    let latency_compensation_secs = measured.scores.on_time_compensation_secs();
    job.report(&RobotStep::LagMeasured { run: Box::new(run.clone()), latency_compensation_secs });
    let mut player = play.player.clone();
    player.config.task.key_schedule.latency_compensation_secs =
        latency_compensation_secs.unwrap_or(measured.scores.latency_compensation_secs);
    let piece = planner.plan(play.song, &player.config.task)?;
    let report = play_runs(&RobotPlay { player: &player, ..play.clone() }, &piece, folder, planner, job)?;
    Ok(RobotReport { uncompensated: Some(run.scores), ..report })
}

/// Plays the runs, and writes the files into `folder`.
fn play_runs(
    play: &RobotPlay<'_>,
    piece: &Piece,
    folder: Option<&Path>,
    planner: &mut SongPlanner<'_>,
    job: &mut Job<'_, RobotStep>,
) -> anyhow::Result<RobotReport> {
    let RobotPlay { player, rig, font, .. } = *play;
    let task = &player.config.task;
    if let Some(folder) = folder {
        write_reference(&folder.join(REFERENCE), piece, font)?;
    }
    let simulated = scores_in_simulation(player, piece, planner)?;
    let sim_f1 = simulated.frame.f1;
    let start = World::new(&task.stage, &task.params().map_err(TaskError::from)?)
        .map_err(TaskError::from)?
        .start_pose();
    let header = Header {
        activity: Activity::Mode(play.mode),
        corrected: play.correction.as_ref().is_some_and(|correction| !correction.is_empty()),
        ..header(piece, player, &rig.label(), Some(rig.config()))
    };
    let (mut runs, mut not_played): (Vec<RobotRun>, _) = (Vec::new(), None);
    for index in 0..play.runs {
        let run = match play_run(play, index, piece, &header, &start, folder, planner, job) {
            Ok(Some(run)) => run,
            Ok(None) => break,
            Err(error) if runs.is_empty() => return Err(error),
            // The report of the runs before it must not be lost.
            Err(error) => {
                not_played = (!Interrupted::is_cause_of(&error)).then(|| format!("{error:#}"));
                break;
            }
        };
        job.report(&RobotStep::RunEnded { index, run: Box::new(run.clone()) });
        runs.push(run);
        if runs.last().is_some_and(|run| run.ending != Ending::Complete) {
            break;
        }
    }
    let counted: Vec<&RobotRun> = runs.iter().filter(|run| run.ending != Ending::Interrupted).collect();
    if counted.is_empty() {
        let recording = runs.iter().filter_map(|run| Some(&run.files.as_ref()?.recording)).next();
        let kept =
            recording.map_or_else(String::new, |path| format!("; {} holds what was played", path.display()));
        return Err(Interrupted(format!("interrupted before a run was complete{kept}")).into());
    }
    let lags: Vec<f64> = counted.iter().filter_map(|run| run.scores.note.lag_secs).collect();
    let f1: Vec<f64> = counted.iter().map(|run| run.scores.frame.f1).collect();
    let robopianist_f1: Vec<f64> = counted.iter().map(|run| run.scores.robopianist_f1).collect();
    let robot_f1 = mean(&f1);
    Ok(RobotReport {
        song: piece.title().to_string(),
        player: player.name(),
        mode: play.mode,
        robot: rig.name().to_string(),
        twin_params: match rig {
            RigChoice::Twin(twin_params) => Some(twin_params.name().to_string()),
            RigChoice::File { .. } => None,
        },
        scores: RobotScores {
            notes: MeanNotes::of(piece.notes().len(), &counted),
            sim_f1,
            sim_robopianist_f1: simulated.robopianist_f1,
            robot_f1,
            robot_f1_std: deviation(&f1),
            robot_robopianist_f1: mean(&robopianist_f1),
            gap: gap(sim_f1, robot_f1),
            latency_compensation_secs: task.key_schedule.latency_compensation_secs,
            lag_secs: (!lags.is_empty()).then(|| mean(&lags)),
        },
        uncompensated: None,
        only_measuring: false,
        not_played,
        runs,
    })
}

/// Plays run `index` and writes its files; none if it was interrupted before it began.
#[expect(clippy::too_many_arguments, reason = "the state of a performance, and one run of it")]
fn play_run(
    play: &RobotPlay<'_>,
    index: usize,
    piece: &Piece,
    header: &Header,
    start: &[f64; DRIVEN_JOINTS],
    folder: Option<&Path>,
    planner: &mut SongPlanner<'_>,
    job: &mut Job<'_, RobotStep>,
) -> anyhow::Result<Option<RobotRun>> {
    let RobotPlay { player, rig, font, .. } = *play;
    let files = folder.map(|folder| {
        let file = |kind: &str| folder.join(run_file(index, kind));
        let [recording, midi, wav, frames] = RUN_FILES.map(file);
        let reference = folder.join(REFERENCE);
        Files { midi, wav, reference, frames, recording, report: None }
    });
    let mut writer =
        files.as_ref().map(|files| RecordingWriter::create(&files.recording, header)).transpose()?;
    let mut session = rig.open(player.config.task.stage.side, play.seed.wrapping_add(index as u64))?;
    let played = one_run(&mut session, play, piece, start, writer.as_mut(), planner, job);
    let performance = match played {
        // What was played is kept even if the robot does not confirm that it was released.
        Ok(performance) => Ok(Some(after_release(performance, session.let_go()))),
        Err(error) if Interrupted::is_cause_of(&error) => released(&mut session, Ok(None)),
        Err(error) => released(&mut session, Err(error)),
    };
    let Session { robot, pace } = &mut session;
    let recorded = writer.as_mut().map_or(Ok(()), |writer| record_release(robot, pace, writer));
    let Some(performance) = performance? else {
        drop(writer);
        // It holds no music. If it cannot be removed, it does no harm.
        let _ = files.map(|files| std::fs::remove_file(files.recording));
        return Ok(None);
    };
    recorded?;
    // The robot is stopped: its guard is not needed while the files are written.
    drop(session);
    if let Some(writer) = writer {
        writer.finish()?;
    }
    if let Some(files) = &files {
        write_performance(files, &performance, font)?;
    }
    Ok(Some(RobotRun::new(performance, files)))
}

/// The performance with what the release of the robot has added to its ending.
fn after_release(performance: Performance, release: Result<(), String>) -> Performance {
    let ending = match (performance.ending, release) {
        (ending, Ok(())) => ending,
        (Ending::Fault(fault), Err(why)) => Ending::Fault(format!("{fault}; {why}")),
        (Ending::Complete | Ending::Interrupted, Err(why)) => Ending::Fault(why),
    };
    Performance { ending, ..performance }
}

/// Brings the robot to the keyboard and plays once.
fn one_run(
    session: &mut Session,
    play: &RobotPlay<'_>,
    piece: &Piece,
    start: &[f64; DRIVEN_JOINTS],
    mut writer: Option<&mut RecordingWriter>,
    planner: &mut SongPlanner<'_>,
    job: &mut Job<'_, RobotStep>,
) -> anyhow::Result<Performance> {
    let (player, interrupt) = (play.player, job.interrupt());
    let task = &player.config.task;
    // What takes long comes before the robot has power.
    let simulation = play.mode.simulation(task)?;
    let mut piece_player = player.for_piece(task, piece, planner.on_progress())?;
    let Session { robot, pace } = session;
    prepare(robot, pace, play.home.then_some(start), writer.as_deref_mut(), interrupt)?;
    for warning in robot.warnings() {
        job.report(&RobotStep::Warning(warning));
    }
    let mut rig =
        play.mode.rig(simulation, RobotRig::new(robot, pace, start).corrected(play.correction.as_ref()));
    Ok(perform(&mut *rig, &mut piece_player, task, piece, writer, interrupt)?)
}
