//! Corrections of a robot's fingertip targets over the keys, learned from the keys themselves.
//! Where the keyboard is not where it is in the simulation, a finger that follows its path exactly
//! strikes late and lifts early, strikes the key beside it, or both.
//! [`Correction`] brings the joints to their path, and this moves the path.

use etude_music::{LOWEST_PITCH, Note};
use etude_stage::geometry::{WHITE_PITCH, key_lateral};
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::kinematics::fingertip;
use etude_stage::{DRIVEN_JOINTS, FINGERS, RAIL, Side, joint_range};
use serde::{Deserialize, Serialize};

use crate::correction::{Correction, grown, ticks};

#[cfg(test)]
mod tests;

/// The correction for each planned note, in the order of the notes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct KeyCorrections(Vec<KeyCorrection>);

/// How far the path of a fingertip is moved for a note, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct KeyCorrection {
    /// To the side of the higher keys; negative is to that of the lower keys.
    aside: f64,
    /// Downward; negative is upward.
    deeper: f64,
}

/// The notes of a performance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlannedAndPlayed {
    /// Those that were planned, at times of the control steps.
    pub planned: Vec<Note>,
    /// Those that were played.
    pub played: Vec<Note>,
    /// When the performance ended, s. A key that was down then was not let go.
    pub end_secs: f64,
}

/// How much deeper a path is moved for each second by which its note was shorter than planned, m/s:
/// a quarter of the speed of a stroke, since a finger that is not deep enough begins the note late
/// and ends it early.
const DEEPER_M_PER_SEC: f64 = 0.05;
/// Largest change of the depth after one run, and the change for a note that was not played, m.
const DEEPER_M: f64 = 0.002;
/// Change to the side after a stroke of a key beside its own, m.
const ASIDE_M: f64 = 0.001;
/// The largest correction, to the side and downward, m.
const MAX_CORRECTION: [f64; 2] = [0.004, 0.005];
/// A stroke this long before or after its time is not a stroke of the note, s.
const SAME_NOTE_SECS: f64 = 0.15;
/// Time in which a correction grows before a note, and dies away after it, s.
const RAMP_SECS: f64 = 0.1;
/// A tip that moves less than this for each radian by which its finger turns, m, is moved by less
/// than the correction: the angle would be too large.
const MIN_SLOPE: f64 = 0.02;
/// Angle by which a joint is turned to find how far that moves the fingertip, rad.
const TURN_RAD: f64 = 1e-4;

impl KeyCorrections {
    /// The corrections for the next run, after one with these. It should have played its notes
    /// `late_secs` later than planned. If fewer than half of them sounded, the corrections stay:
    /// then something else is wrong than the paths.
    #[must_use]
    pub fn after(&self, strokes: &PlannedAndPlayed, late_secs: f64) -> Self {
        let timed = TimedNotes { strokes, late_secs };
        let matched: Vec<Option<&Note>> = strokes.planned.iter().map(|note| timed.stroke_of(note)).collect();
        if 2 * matched.iter().flatten().count() < strokes.planned.len() {
            return self.clone();
        }
        let mut next: Vec<KeyCorrection> = (strokes.planned.iter().zip(&matched).enumerate())
            .map(|(index, (note, stroke))| {
                let before = self.0.get(index).copied().unwrap_or_default();
                let deeper = match stroke {
                    Some(stroke) => DEEPER_M_PER_SEC * timed.shorter_secs(note, stroke),
                    // Its key did not come up before.
                    None if timed.is_held_before(note) => -DEEPER_M,
                    None => DEEPER_M,
                };
                let deeper = (before.deeper + deeper.clamp(-DEEPER_M, DEEPER_M))
                    .clamp(-MAX_CORRECTION[1], MAX_CORRECTION[1]);
                KeyCorrection { deeper, ..before }
            })
            .collect();
        for wrong in &strokes.played {
            // Of the notes beside which it may be, one that did not sound, and then the nearest.
            let beside = (strokes.planned.iter().zip(&matched).enumerate())
                .filter(|(_, (note, _))| timed.is_beside(note, wrong))
                .min_by(|(_, (a, played_a)), (_, (b, played_b))| {
                    let distances = timed.distance(a, wrong).total_cmp(&timed.distance(b, wrong));
                    played_a.is_some().cmp(&played_b.is_some()).then(distances)
                });
            if let Some((index, (note, _))) = beside
                && !strokes
                    .planned
                    .iter()
                    .any(|other| timed.is_near(other, wrong) && other.pitch == wrong.pitch)
            {
                let away = (f64::from(note.pitch) - f64::from(wrong.pitch)).signum();
                next[index].aside =
                    (next[index].aside + ASIDE_M * away).clamp(-MAX_CORRECTION[0], MAX_CORRECTION[0]);
            }
        }
        Self(next)
    }

    /// What the corrections add to the set-points `asked` of the planned notes (at the end of each
    /// physics step: rad, the rail in m). For a note over whose key there is no finger, nothing.
    pub fn offsets(&self, asked: &[[f64; DRIVEN_JOINTS]], planned: &[Note], side: Side) -> Correction {
        // For each physics step and finger: the sum of the weights, and of the weighted
        // corrections.
        let mut sums = vec![[(0.0, KeyCorrection::default()); FINGERS]; asked.len()];
        for (note, correction) in planned.iter().zip(&self.0) {
            let Some(finger) = pressing(asked, note, side) else { continue };
            let [first, last, ramp] = [note.start_secs, note.end_secs, RAMP_SECS].map(ticks);
            let around = first.saturating_sub(ramp)..(last + ramp).min(asked.len());
            for (tick, sums) in sums.iter_mut().enumerate().take(around.end).skip(around.start) {
                let outside = first.saturating_sub(tick).max(tick.saturating_sub(last));
                let weight = 1.0 - outside as f64 / ramp as f64;
                let (weights, sum) = &mut sums[finger];
                *weights += weight;
                sum.aside += weight * correction.aside;
                sum.deeper += weight * correction.deeper;
            }
        }
        let offsets = asked.iter().zip(sums).enumerate().map(|(tick, (pose, sums))| {
            let mut offsets = [0.0; DRIVEN_JOINTS];
            for (finger, (weights, sum)) in
                sums.into_iter().enumerate().filter(|(_, (weights, _))| *weights > 0.0)
            {
                let weights = f64::max(weights, 1.0);
                let correction = KeyCorrection { aside: sum.aside / weights, deeper: sum.deeper / weights };
                for (joint, turn) in
                    (finger * JOINTS_PER_FINGER..).zip(turned(pose, finger, side, correction))
                {
                    let [low, high] = joint_range(joint);
                    offsets[joint] = (pose[joint] + grown(tick) * turn).clamp(low, high) - pose[joint];
                }
            }
            offsets
        });
        Correction::of(offsets.collect())
    }
}

/// The notes of a run, and how much later than planned they should be.
struct TimedNotes<'a> {
    strokes: &'a PlannedAndPlayed,
    late_secs: f64,
}

impl<'a> TimedNotes<'a> {
    /// How far a stroke is from the time of a note, s.
    fn distance(&self, note: &Note, stroke: &Note) -> f64 {
        (note.start_secs + self.late_secs - stroke.start_secs).abs()
    }

    fn is_near(&self, note: &Note, stroke: &Note) -> bool {
        self.distance(note, stroke) <= SAME_NOTE_SECS
    }

    fn is_beside(&self, note: &Note, stroke: &Note) -> bool {
        self.is_near(note, stroke) && (1..=2).contains(&stroke.pitch.abs_diff(note.pitch))
    }

    /// The stroke that plays this note: of those of its key the nearest, if it is near and no other
    /// note is nearer to it.
    fn stroke_of(&self, note: &Note) -> Option<&'a Note> {
        let of_its_key = self.strokes.played.iter().filter(|stroke| stroke.pitch == note.pitch);
        let stroke = of_its_key
            .filter(|stroke| self.is_near(note, stroke))
            .min_by(|a, b| self.distance(note, a).total_cmp(&self.distance(note, b)))?;
        let mut others = self.strokes.planned.iter().filter(|other| other.pitch == note.pitch);
        others.all(|other| self.distance(other, stroke) >= self.distance(note, stroke)).then_some(stroke)
    }

    /// By how much a stroke was shorter than its note, s. What is planned after the end of the
    /// performance does not count.
    fn shorter_secs(&self, note: &Note, stroke: &Note) -> f64 {
        let end_secs = (note.end_secs + self.late_secs).min(self.strokes.end_secs);
        end_secs - self.late_secs - note.start_secs - stroke.duration_secs()
    }

    /// Whether the key of this note was down already when it should have been struck.
    fn is_held_before(&self, note: &Note) -> bool {
        let due_secs = note.start_secs + self.late_secs;
        self.strokes.played.iter().any(|stroke| {
            stroke.pitch == note.pitch && stroke.start_secs < due_secs && stroke.end_secs > due_secs
        })
    }
}

/// The finger that presses the key of `note` in the middle of it: of those over the key the lowest.
fn pressing(asked: &[[f64; DRIVEN_JOINTS]], note: &Note, side: Side) -> Option<usize> {
    let pose = asked.get(ticks((note.start_secs + note.end_secs) / 2.0))?;
    let key = usize::from(note.pitch.checked_sub(LOWEST_PITCH)?);
    (0..FINGERS)
        .map(|finger| (finger, fingertip(side, finger, &angles(pose, finger), pose[RAIL])))
        .filter(|(_, tip)| (tip[1] - key_lateral(key)).abs() < WHITE_PITCH / 2.0)
        .min_by(|(_, a), (_, b)| a[2].total_cmp(&b[2]))
        .map(|(finger, _)| finger)
}

/// How far the joints of a finger turn to move its tip to this correction: the first aside, the
/// others down with the least motion.
fn turned(
    pose: &[f64; DRIVEN_JOINTS],
    finger: usize,
    side: Side,
    correction: KeyCorrection,
) -> [f64; JOINTS_PER_FINGER] {
    let tip = |angles: &[f64; JOINTS_PER_FINGER]| fingertip(side, finger, angles, pose[RAIL]);
    let here = angles(pose, finger);
    // How far the tip goes for each radian by which a joint turns, along `axis`.
    let slope = |joint: usize, axis: usize| {
        let mut turned = here;
        turned[joint] += TURN_RAD;
        (tip(&turned)[axis] - tip(&here)[axis]) / TURN_RAD
    };
    let lowers: [f64; JOINTS_PER_FINGER] =
        std::array::from_fn(|joint| if joint == 0 { 0.0 } else { -slope(joint, 2) });
    let squares: f64 = lowers.iter().map(|lowers| lowers * lowers).sum();
    let mut turns = lowers.map(|lowers| correction.deeper * lowers / squares.max(MIN_SLOPE.powi(2)));
    // A finger that turns toward the palm's +y goes to the lower keys.
    turns[0] = correction.aside / slope(0, 1).min(-MIN_SLOPE);
    turns
}

fn angles(pose: &[f64; DRIVEN_JOINTS], finger: usize) -> [f64; JOINTS_PER_FINGER] {
    std::array::from_fn(|joint| pose[finger * JOINTS_PER_FINGER + joint])
}
