//! What a run of an adaptation plays, and what is learned from it for the next one.

use etude_perform::{Correction, Delays, KeyCorrections, PlannedAndPlayed, Tracking};
use etude_stage::Side;
use serde::{Deserialize, Serialize};

/// The two runs before anything is corrected: the first measures how late the notes are, the second
/// how late the joints.
pub(super) const MEASURING: usize = 2;

/// In so many runs the joints come to their path before keys are corrected: a note may be missing
/// for either reason.
const JOINT_RUNS: usize = 6;

/// What a run plays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct RunCorrections {
    /// The latency compensation, s; that of the policy's training if none. It changes when the
    /// notes are due, and not the motion.
    pub latency_compensation_secs: Option<f64>,
    /// How late the joints should be and are, once it is measured.
    pub delays: Option<Delays>,
    /// The correction that brings the joints to their path.
    correction: Correction,
    /// How far the fingers' targets are moved for each key, and what that adds to the path.
    key_corrections: KeyCorrections,
    pub key_offsets: Correction,
}

/// The notes of a run.
pub(super) struct Notes<'a> {
    pub strokes: &'a PlannedAndPlayed,
    /// The latency compensation that was played with, s.
    pub latency_compensation_secs: f64,
    /// The one with which the notes would have been on time, s, if it is known.
    pub on_time_secs: Option<f64>,
}

impl RunCorrections {
    /// What is added to the set-points.
    pub fn added(&self) -> Correction {
        self.correction.plus(&self.key_offsets)
    }

    /// What the next run plays, after run `index` has played this.
    pub fn after(&self, index: usize, tracking: &Tracking, notes: &Notes<'_>, side: Side) -> Self {
        let latency_compensation_secs = notes.on_time_secs.or(self.latency_compensation_secs);
        if index + 1 < MEASURING {
            return Self { latency_compensation_secs, ..self.clone() };
        }
        let delays = self.delays.unwrap_or_else(|| tracking.delays());
        let correction = self.correction.after(&tracking.clone().asked_for(&self.key_offsets), &delays);
        let key_corrections = match index + 1 {
            runs if runs < MEASURING + JOINT_RUNS => KeyCorrections::default(),
            _ => self.key_corrections.after(notes.strokes, notes.latency_compensation_secs),
        };
        let key_offsets = key_corrections.offsets(&tracking.asked, &notes.strokes.planned, side);
        Self { latency_compensation_secs, delays: Some(delays), correction, key_corrections, key_offsets }
    }
}

#[cfg(test)]
mod tests {
    use etude_music::{LOWEST_PITCH, Note};
    use etude_stage::geometry::key_target;
    use etude_stage::kinematics::{fingertip, reach};
    use etude_stage::{DRIVEN_JOINTS, RAIL};

    use super::*;

    const KEY: usize = 24;

    /// A path of 1.5 s that presses a key, with one of the fingers, and lets go twice.
    fn path() -> Vec<[f64; DRIVEN_JOINTS]> {
        let [x, y, z] = key_target(KEY);
        let rail = y - fingertip(Side::Left, 0, &[0.0, 0.5, 0.8, 0.3], 0.0)[1];
        (0..300)
            .map(|tick| {
                let height = 0.012 * (f64::from(tick) / 200.0 * 9.0).cos();
                let mut pose = [0.1; DRIVEN_JOINTS];
                pose[..4]
                    .copy_from_slice(&reach(Side::Left, 0, [x, y, z + height], rail).expect("within reach"));
                pose[RAIL] = rail;
                pose
            })
            .collect()
    }

    #[test]
    fn the_first_run_measures_the_latency_the_second_the_joints_and_later_ones_correct_keys() {
        let asked = path();
        let late = |secs: f64| {
            let ticks = (secs * 200.0) as usize;
            let measured = (0..asked.len()).map(|tick| asked[tick.saturating_sub(ticks)]).collect();
            Tracking { asked: asked.clone(), measured }
        };
        let note = |start_secs, end_secs| Note {
            pitch: LOWEST_PITCH + KEY as u8,
            velocity: 64,
            start_secs,
            end_secs,
        };
        // It sounds 0.1 s later than planned, which is the latency compensation, and 40 ms shorter.
        let strokes =
            PlannedAndPlayed { planned: vec![note(0.3, 0.5)], played: vec![note(0.42, 0.58)], end_secs: 1.5 };
        let after = |played: &RunCorrections, index, tracking: &Tracking| {
            let notes = Notes { strokes: &strokes, latency_compensation_secs: 0.1, on_time_secs: Some(0.12) };
            played.after(index, tracking, &notes, Side::Left)
        };
        let second = after(&RunCorrections::default(), 0, &late(0.06));
        assert_eq!(
            second,
            RunCorrections { latency_compensation_secs: Some(0.12), ..RunCorrections::default() }
        );
        let third = after(&second, 1, &late(0.06));
        assert_eq!(third.delays.unwrap().common_lag_secs, 0.06);
        assert!(third.key_corrections == KeyCorrections::default() && third.key_offsets.is_still());
        assert!(third.correction.is_still(), "the joints are on their path, later by their lag");
        assert!(after(&third, 6, &late(0.06)).key_offsets.is_still());
        let key_offsets = after(&third, 7, &late(0.06));
        assert!(!key_offsets.key_offsets.is_still());
        assert!(key_offsets.correction.is_still());
        // The path moves with the key corrections: joints that follow it are right, and those that
        // do not are corrected.
        let moved = |played: &RunCorrections| {
            let sent = late(0.0).asked_for(&played.added()).asked;
            let measured = (0..asked.len()).map(|tick| sent[tick.saturating_sub(12)]).collect();
            Tracking { asked: asked.clone(), measured }
        };
        assert!(after(&key_offsets, 8, &moved(&key_offsets)).correction.is_still());
        assert!(!after(&key_offsets, 8, &late(0.06)).correction.is_still());
    }
}
