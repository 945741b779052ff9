//! The report of performances on a robot.

use etude_music::metrics::{NoteScores, note_scores};
use etude_music::{MAX_LATENCY_COMPENSATION_SECS, Note};
use etude_perform::stats::mean;
use etude_perform::{Ending, Mode, Performance, PlannedAndPlayed, Scores, TimingReport, Tracking};
use serde::{Deserialize, Serialize};

use crate::errors::{Interrupted, safety_stop};
use crate::play::Files;

/// The results. Its keys are those of `etude perform --json`. A run that was interrupted is listed,
/// and counts in no mean.
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
    /// Name of the twin parameters; absent for a robot with a rig file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub twin_params: Option<String>,
    /// The scores.
    #[serde(flatten)]
    pub scores: RobotScores,
    /// The run that measured the lag, before the latency compensation: the paper describes none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uncompensated: Option<Scores>,
    /// Whether the only run is the one that should have measured the lag: it ended early, and no
    /// run that counts was played.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub only_measuring: bool,
    /// Why the run after the last one could not be played.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_played: Option<String>,
    /// The runs.
    pub runs: Vec<RobotRun>,
}

/// Scores of one run or of several on a robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RobotScores {
    /// Notes, as means over the runs.
    #[serde(flatten)]
    pub notes: MeanNotes,
    /// F1 by control step of the same player in simulation.
    pub sim_f1: f64,
    /// The same by RoboPianist's rule.
    pub sim_robopianist_f1: f64,
    /// Mean of the runs' F1 by control step.
    pub robot_f1: f64,
    /// Their standard deviation; 0 for one run.
    pub robot_f1_std: f64,
    /// Mean of the runs' F1 by RoboPianist's rule.
    pub robot_robopianist_f1: f64,
    /// The share of `sim_f1` that is lost on the robot.
    pub gap: f64,
    /// The latency compensation that was played with, s (`task.plan.latency_compensation_secs`).
    pub latency_compensation_secs: f64,
    /// Mean over the runs of how late the whole performance was, s; none if no run has a right key
    /// near its time.
    pub lag_secs: Option<f64>,
}

impl RobotScores {
    /// The score by which playing on a robot is compared: the mean of F1 and onset F1.
    pub fn overall(&self) -> f64 {
        (self.robot_f1 + self.notes.onset_f1) / 2.0
    }

    /// The latency compensation with which the notes would have been on time in the median, s, if
    /// they were not.
    pub fn better_latency_compensation_secs(&self) -> Option<f64> {
        self.lag_secs.filter(|late| late.abs() > MAX_GOOD_LAG_SECS)?;
        self.on_time_compensation_secs()
            .filter(|latency_compensation_secs| *latency_compensation_secs != self.latency_compensation_secs)
    }

    /// The latency compensation with which the notes would have been on time in the median, s; none
    /// if no note would then have been right.
    pub fn on_time_compensation_secs(&self) -> Option<f64> {
        self.lag_secs
            .filter(|_| self.notes.onset_f1_without_lag > 0.0)
            .map(|late| (self.latency_compensation_secs + late).clamp(0.0, MAX_LATENCY_COMPENSATION_SECS))
    }
}

/// Notes of several runs, as means over them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeanNotes {
    /// Notes of the song that were played in time.
    pub notes_right: f64,
    /// Notes of the song.
    pub notes_due: usize,
    /// Strokes that play no note of the song.
    pub notes_wrong: f64,
    /// F1 of notes, by their onsets.
    pub onset_f1: f64,
    /// The same if each run had been played earlier by its lag.
    pub onset_f1_without_lag: f64,
}

impl MeanNotes {
    pub(super) fn of(due: usize, runs: &[&RobotRun]) -> Self {
        let of = |score: fn(&NoteScores) -> f64| {
            mean(&runs.iter().map(|run| score(&run.scores.note)).collect::<Vec<_>>())
        };
        Self {
            notes_right: of(|note| note.matched as f64),
            notes_due: due,
            notes_wrong: of(|note| note.wrong as f64),
            onset_f1: of(|note| note.onset_f1),
            onset_f1_without_lag: of(|note| note.onset_f1_without_lag),
        }
    }
}

impl std::fmt::Display for MeanNotes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let count = |mean: f64| match mean.fract() {
            0.0 => format!("{mean:.0}"),
            _ => format!("{mean:.1}"),
        };
        let [right, wrong] = [self.notes_right, self.notes_wrong].map(count);
        write!(f, "{right} of {} notes right, {wrong} wrong", self.notes_due)
    }
}

/// The report of runs that were all complete, for work without an operator: after a safety stop, or
/// if it was not released, a robot is not powered again.
///
/// # Errors
/// That of `played`; [`Interrupted`] if it was interrupted, or the fault of `part`.
pub(crate) fn all_complete(
    played: anyhow::Result<RobotReport>,
    interrupted: bool,
    part: &str,
) -> anyhow::Result<RobotReport> {
    if interrupted && played.as_ref().err().is_none_or(Interrupted::is_cause_of) {
        return Err(Interrupted::resumable().into());
    }
    let report = played?;
    if let Some(why) = &report.not_played {
        anyhow::bail!("{part}: {why}");
    }
    match report.runs.iter().find(|run| run.ending != Ending::Complete) {
        Some(run) => Err(safety_stop(part, &run.ending.to_string())),
        None => Ok(report),
    }
}

/// One run.
#[derive(Clone, Debug, Serialize)]
pub struct RobotRun {
    /// Scores by control step and by note; control steps after an early end count as silent.
    #[serde(flatten)]
    pub scores: Scores,
    /// F1 of the simulation beside the robot; absent in a mode without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alongside_f1: Option<f64>,
    /// Control steps played, of those in the song.
    pub steps: [usize; 2],
    /// How it ended.
    pub ending: Ending,
    /// Set-points that the limiter clamped, counted by joint.
    pub clamped: u64,
    /// Records that are missing in the recording.
    pub lost_records: u64,
    /// What the operator should know of the keyboard, and what to do.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Deadlines and periods.
    pub timing: TimingReport,
    /// How the joints were asked to move and how they moved; empty without a correction, even an
    /// empty one.
    #[serde(skip)]
    pub tracking: Tracking,
    /// Its notes.
    #[serde(skip)]
    pub strokes: PlannedAndPlayed,
    /// The files that were written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub files: Option<Files>,
}

/// Mean lag below which the latency compensation is good enough, s.
const MAX_GOOD_LAG_SECS: f64 = 0.005;

impl RobotRun {
    pub(super) fn new(performance: Performance, files: Option<Files>) -> Self {
        let scores = performance.scores();
        let strokes = performance.played_notes();
        let (alongside_f1, steps) = (performance.simulated_f1(), performance.piece.steps());
        let shifted = shifted(&performance, scores.note.matched);
        let robot = performance.robot.unwrap_or_default();
        let warnings = robot.warnings.into_iter().chain(shifted).collect();
        Self {
            scores,
            alongside_f1,
            steps: [performance.pressed.len(), steps],
            clamped: robot.clamped,
            lost_records: robot.lost_records,
            warnings,
            timing: robot.timing.report(),
            tracking: robot.tracking,
            strokes,
            ending: performance.ending,
            files,
        }
    }
}

/// A shifted keyboard whose notes all lie on its keys shows in the music alone: hardly a note is
/// right, and most are if all are taken that much lower.
fn shifted(performance: &Performance, right: usize) -> Option<String> {
    const SHIFTS: [i32; 8] = [12, -12, 24, -24, 1, -1, 2, -2];
    let due = performance.piece.notes();
    if 4 * right >= due.len() {
        return None;
    }
    let played = performance.notes();
    let lower = |note: &Note, semitones: i32| {
        let pitch = u8::try_from(i32::from(note.pitch) - semitones).ok()?;
        Some(Note { pitch, ..*note })
    };
    let right_if = |semitones: &i32| {
        let played: Vec<Note> = played.iter().filter_map(|note| lower(note, *semitones)).collect();
        note_scores(due, &played).matched
    };
    let semitones = SHIFTS.into_iter().find(|shift| 2 * right_if(shift) > due.len().max(3))?;
    let (too, button) = if semitones > 0 { ("high", '-') } else { ("low", '+') };
    let remedy = match semitones.abs() {
        12 => format!("press its octave {button} button once"),
        24 => format!("press its octave {button} button twice"),
        _ => "set its transpose button back to 0".to_string(),
    };
    Some(format!(
        "the keyboard is shifted: its notes are {} semitones too {too}: {remedy}, then play again",
        semitones.abs()
    ))
}
