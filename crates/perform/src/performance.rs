//! The result of a performance, and its scores.

use etude_music::metrics::{FrameScores, NoteScores, frame_scores, note_scores};
use etude_music::{CONTROL_HZ, KeyEvent, KeySet, Note, keys_at, notes_from_key_events};
use etude_task::Piece;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::correction::Tracking;
use crate::key_correction::PlannedAndPlayed;
use crate::timing::Timing;

/// A piece as it was played, to its end or until the performance ended early.
#[derive(Clone, Debug)]
pub struct Performance {
    /// The piece, with the keys that were due.
    pub piece: Piece,
    /// Keys that sounded at the end of each control step that was played.
    pub pressed: Vec<KeySet>,
    /// The same in the simulation beside a robot; empty without one.
    pub simulated: Vec<KeySet>,
    /// Keys that were down at the beginning.
    pub down_before: KeySet,
    /// Strikes and releases, at times since the beginning. On a robot until [`Piece::late_secs`]
    /// after the last control step.
    pub events: Vec<KeyEvent>,
    /// How it ended.
    pub ending: Ending,
    /// What only a simulation measures.
    pub simulation: Option<SimulationResult>,
    /// What only a robot measures.
    pub robot: Option<RobotResult>,
}

/// One control step as it was played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlayedStep {
    /// Keys that sound at its end.
    pub pressed: KeySet,
    /// Keys that sound at its end in the simulation beside a robot; `None` without one.
    pub simulated: Option<KeySet>,
}

/// How a performance or a recording ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Ending {
    /// After its last control step.
    Complete,
    /// On request.
    Interrupted,
    /// A safety stop, for this reason.
    Fault(String),
}

impl std::fmt::Display for Ending {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Complete => "complete",
            Self::Interrupted => "interrupted",
            Self::Fault(reason) => reason,
        })
    }
}

/// What only a simulation measures.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SimulationResult {
    /// Sum of the rewards.
    pub reward: f64,
    /// Fraction of the piece's control steps without a collision.
    pub collision_free: f64,
}

/// What only a robot measures.
#[derive(Clone, Debug, Default)]
pub struct RobotResult {
    /// Deadlines and periods.
    pub timing: Timing,
    /// Set-points that the limiter changed, counted by joint.
    pub clamped: u64,
    /// Records that are missing in the recording because there were too many at once.
    pub lost_records: u64,
    /// What the operator should know of the keyboard.
    pub warnings: Vec<String>,
    /// How the joints were asked to move and how they moved; empty without a correction, even an
    /// empty one.
    pub tracking: Tracking,
}

/// Every score of a performance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// By control step: `precision`, `recall`, `f1`, `pooled_…`.
    #[serde(flatten)]
    pub frame: FrameScores,
    /// F1 by control step by RoboPianist's rule, which the paper's numbers are by; `f1` is by the
    /// rule that was played.
    pub robopianist_f1: f64,
    /// By note: `onset_…`, `onset_offset_…`, `matched`, `missed`, `wrong`.
    #[serde(flatten)]
    pub note: NoteScores,
}

impl Performance {
    /// Of `piece`, before its first control step.
    pub fn new(piece: &Piece) -> Self {
        Self {
            piece: piece.clone(),
            pressed: Vec::with_capacity(piece.steps()),
            simulated: Vec::new(),
            down_before: KeySet::EMPTY,
            events: Vec::new(),
            ending: Ending::Interrupted,
            simulation: None,
            robot: None,
        }
    }

    /// Adds a control step.
    pub(crate) fn push(&mut self, step: PlayedStep) {
        self.pressed.push(step.pressed);
        self.simulated.extend(step.simulated);
    }

    /// Keys that were heard for each control step of the piece: in a simulation at its end, on a
    /// robot [`Piece::late_secs`] later; silence after an early end.
    pub fn keys_heard(&self) -> Vec<KeySet> {
        let steps = self.piece.steps();
        match self.robot {
            Some(_) => {
                let ends = (1..=self.pressed.len()).map(|step| step as f64 / CONTROL_HZ);
                let times = ends.map(|end_secs| end_secs + self.piece.late_secs());
                padded(&keys_at(self.down_before, &self.events, times), steps)
            }
            None => padded(&self.pressed, steps),
        }
    }

    /// Length of the piece, s.
    pub fn secs(&self) -> f64 {
        self.piece.steps() as f64 / CONTROL_HZ
    }

    /// The notes that were played.
    pub fn notes(&self) -> Vec<Note> {
        notes_from_key_events(&self.events, self.secs())
    }

    /// Its notes, and those that were planned.
    pub fn played_notes(&self) -> PlannedAndPlayed {
        PlannedAndPlayed { planned: self.planned_notes(), played: self.notes(), end_secs: self.secs() }
    }

    /// The notes that the player should play, at times of the control steps: those that are due,
    /// less what the fingering leaves out.
    fn planned_notes(&self) -> Vec<Note> {
        let planned = match self.piece.fingering() {
            Some(_) => self.piece.planned(),
            None => self.piece.frames().to_vec(),
        };
        notes_from_key_events(&changes(&planned, 0.0), self.secs())
    }

    /// Every score. Control steps after an early end count as silence; onsets are read at the times
    /// of the key events.
    pub fn scores(&self) -> Scores {
        let heard = self.keys_heard();
        Scores {
            frame: frame_scores(self.piece.frames(), &heard),
            robopianist_f1: frame_scores(self.piece.robopianist_frames(), &heard).f1,
            note: note_scores(self.piece.notes(), &self.notes()),
        }
    }

    /// F1 by control step of the simulation beside a robot; `None` without one.
    pub fn simulated_f1(&self) -> Option<f64> {
        let played = padded(&self.simulated, self.piece.steps());
        (!self.simulated.is_empty()).then(|| frame_scores(self.piece.frames(), &played).f1)
    }
}

/// Strikes and releases of keys that change at the beginning of control steps, all later by
/// `late_secs`.
fn changes(frames: &[KeySet], late_secs: f64) -> Vec<KeyEvent> {
    let mut before = KeySet::EMPTY;
    let mut events = Vec::new();
    for (step, now) in frames.iter().enumerate() {
        let secs = step as f64 / CONTROL_HZ + late_secs;
        events.extend(before.difference(*now).iter().map(|key| KeyEvent { secs, key, velocity: 0 }));
        events.extend(now.difference(before).iter().map(|key| KeyEvent { secs, key, velocity: 1 }));
        before = *now;
    }
    events
}

fn padded(keys: &[KeySet], steps: usize) -> Vec<KeySet> {
    (0..steps).map(|step| keys.get(step).copied().unwrap_or_default()).collect()
}

/// The gap between simulation and robot: the share of the F1 in simulation that is lost on the
/// robot (paper, "Results": from 0.946 to 0.881 is 6.8 %). 0 where the F1 in simulation is 0.
pub fn gap(sim_f1: f64, robot_f1: f64) -> f64 {
    if sim_f1 == 0.0 { 0.0 } else { 1.0 - robot_f1 / sim_f1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_music::{KeyScheduleConfig, repertoire};
    use etude_task::TaskConfig;

    /// A player that strikes and releases every key at the time of the song is right in every
    /// control step, whatever the latency compensation; 20 ms early or late is still within the
    /// step, 30 ms is not. One below half a step is the simulation's: its keys are read at the end
    /// of the step.
    #[test]
    fn a_robot_is_scored_on_the_songs_own_time() {
        let song = repertoire::get("twinkle").expect("built in");
        for latency_compensation_secs in [0.025, 0.03, 0.049, 0.051, 0.074, 0.076, 0.11, 0.2] {
            let task = TaskConfig {
                key_schedule: KeyScheduleConfig { latency_compensation_secs, ..KeyScheduleConfig::default() },
                ..TaskConfig::default()
            };
            let piece = Piece::for_task(&song, &task).unwrap();
            let f1 = |late_secs: f64| {
                let mut played = Performance::new(&piece);
                played.robot = Some(RobotResult::default());
                played.events = changes(piece.frames(), latency_compensation_secs + late_secs);
                let recorded_secs = played.secs() + piece.late_secs();
                played.events.retain(|event| event.secs <= recorded_secs);
                for _ in 0..piece.steps() {
                    played.push(PlayedStep { pressed: KeySet::EMPTY, simulated: None });
                }
                played.scores().frame.f1
            };
            assert!(
                [-0.02, 0.0, 0.02].iter().all(|late_secs| f1(*late_secs) == 1.0),
                "compensation {latency_compensation_secs}"
            );
            assert!(
                [-0.03, 0.03].iter().all(|late_secs| f1(*late_secs) < 0.95),
                "compensation {latency_compensation_secs}"
            );
        }
        let early = TaskConfig {
            key_schedule: KeyScheduleConfig {
                latency_compensation_secs: 0.01,
                ..KeyScheduleConfig::default()
            },
            ..TaskConfig::default()
        };
        assert_eq!(Piece::for_task(&song, &early).unwrap().late_secs(), 0.0);
    }

    /// The hand cannot strike a key again at once, so the fingering leaves it earlier than the
    /// song. Without a fingering all is planned.
    #[test]
    fn the_notes_of_the_fingering_are_planned_or_those_of_the_song() {
        let song = repertoire::get("twinkle").expect("built in");
        for fingering in [false, true] {
            let task = TaskConfig { fingering, ..TaskConfig::default() };
            let piece = Piece::for_task(&song, &task).unwrap();
            let mut played = Performance::new(&piece);
            let frames = if fingering { piece.planned() } else { piece.frames().to_vec() };
            for pressed in &frames {
                played.push(PlayedStep { pressed: *pressed, simulated: None });
            }
            let strokes = played.played_notes();
            assert_eq!(strokes.planned.len(), 14);
            assert!(strokes.played.is_empty() && strokes.end_secs == played.secs());
            for (note, due) in strokes.planned.iter().zip(piece.notes()) {
                assert_eq!(note.pitch, due.pitch);
                // By RoboPianist's rule a repeated note begins one control step late.
                assert!((note.start_secs - due.start_secs).abs() < 0.051, "{note:?} {due:?}");
                let middle = ((note.start_secs + note.end_secs) / 2.0 * CONTROL_HZ) as usize;
                assert!(frames[middle].pitches().any(|pitch| pitch == note.pitch));
                let end = (note.end_secs * CONTROL_HZ).round() as usize;
                assert!(frames.get(end).is_none_or(|keys| keys.pitches().all(|pitch| pitch != note.pitch)));
            }
        }
    }

    #[test]
    fn the_gap_is_the_papers() {
        assert!((gap(0.946, 0.881) - 0.0687).abs() < 1e-4);
        assert!((gap(0.946, 0.840) - 0.112).abs() < 1e-3);
        assert_eq!(gap(0.0, 0.5), 0.0);
    }
}
