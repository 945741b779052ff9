//! From a fingering to joint targets.
//!
//! The rail's predicted path is known, and every finger is turned to compensate it. A finger lifts,
//! moves over its next key, waits, strikes, holds, lifts.

use etude_music::key_is_black;
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::{JointRow, PhysicalParams};
use etude_stage::{DRIVEN_JOINTS, FINGERS, PHYSICS_STEPS, RAIL, joint_range};

use super::lags::Lags;
use crate::fingering::hand_reach::{HandReach, TURN_FIRST_M};
use crate::fingering::rail_model::{CONTROL_SECS, RailModel};
use crate::fingering::{Fingering, PlannedNote};

/// Control steps in which a finger crosses the edge between white and black keys.
const CROSS_STEPS: usize = 2;
/// Control steps for which a lifted finger stays over its old key, so that it clears the fences
/// before it moves sideways.
const LIFT_STEPS: usize = 1;
/// Height of a finger that has nothing to play, m above its hover.
const IDLE_RISE_M: f64 = 0.006;
/// Control steps in which a finger rises before it goes from white to black keys or back.
const CLIMB_STEPS: usize = 2;

/// What one finger plays, in order.
struct FingerTrack<'a> {
    finger: usize,
    notes: Vec<&'a PlannedNote>,
    reach: &'a HandReach,
    lags: &'a Lags,
}

impl FingerTrack<'_> {
    /// Control step whose target begins the strike of note `index`.
    fn strike(&self, index: usize) -> usize {
        let note = self.notes[index];
        note.start.saturating_sub(self.lags.strike_steps(key_is_black(note.key)))
    }

    /// Control step whose target lifts the finger after note `index`: always before the next
    /// strike.
    fn release(&self, index: usize) -> usize {
        let note = self.notes[index];
        let release = note.end.saturating_sub(self.lags.release_steps(key_is_black(note.key)));
        let next = (index + 1 < self.notes.len()).then(|| self.strike(index + 1));
        release.min(next.map_or(release, |strike| strike.saturating_sub(1)))
    }

    /// Where the fingertip should be at control step `step`, when the rail will be at `rail`.
    fn tip(&self, step: usize, rail: f64) -> Tip {
        let waiting = |[x, y]: [f64; 2], z: f64| Tip { position: [x, y, z], striking: false };
        let next = (0..self.notes.len()).find(|index| step < self.release(*index));
        if let Some(index) = next
            && step >= self.strike(index)
        {
            let key = self.notes[index].key;
            let [x, y] = self.reach.over(key);
            return Tip { position: [x, y, self.reach.pressed_height(key)], striking: true };
        }
        let last = next.unwrap_or(self.notes.len()).checked_sub(1);
        // Before its first note a finger waits over the white keys.
        let since = step - last.map_or(0, |index| self.release(index));
        let last = last.map(|index| self.notes[index].key);
        let next = next.map(|index| self.notes[index].key);
        let [front, _] = self.reach.over(0);
        let idle = [front, self.reach.unturned(self.finger, front) + rail];
        let from = last.map_or(idle, |key| self.reach.over(key));
        let to = next.map_or(idle, |key| self.reach.over(key));
        let height =
            next.map_or(self.reach.hover_height(0) + IDLE_RISE_M, |key| self.reach.hover_height(key));
        let distance = to[0] - from[0];
        if distance == 0.0 {
            return match last {
                Some(key) if since < LIFT_STEPS => waiting(from, self.reach.hover_height(key)),
                _ => waiting(to, height),
            };
        }
        // Between white and black: up, then in stages over the edge of the black keys, then down.
        let stages = CROSS_STEPS as f64;
        let stage = (since as f64 - CLIMB_STEPS as f64 + 1.0).clamp(0.0, stages) / stages;
        let landed = since > CLIMB_STEPS + CROSS_STEPS;
        let y = if since < CLIMB_STEPS { from[1] } else { to[1] };
        waiting([from[0] + distance * stage, y], if landed { height } else { self.reach.crossing_height() })
    }
}

/// Where a fingertip should be.
struct Tip {
    position: [f64; 3],
    /// Whether it is on a key or on its way down; neighbours must then keep clear.
    striking: bool,
}

/// Keeps waiting fingers clear of neighbours that play.
fn make_room(tips: &mut [Tip; FINGERS], reach: &HandReach) {
    for finger in 0..FINGERS {
        for other in (0..FINGERS).filter(|other| other.abs_diff(finger) == 1) {
            if tips[finger].striking || !tips[other].striking {
                continue;
            }
            let [x, y, _] = tips[finger].position;
            let other_y = tips[other].position[1];
            tips[finger].position[1] = reach.clear_of(finger, [x, y], other, other_y);
        }
    }
}

/// The targets of all joints at each control step: encoder readings in rad, the rail in m.
pub(super) fn targets(
    (reach, rail, lags, params): (&HandReach, &RailModel, &Lags, &PhysicalParams),
    fingering: &Fingering,
) -> Vec<[f64; DRIVEN_JOINTS]> {
    let path = rail.follow(rail.start, fingering.rail());
    let rail_at = |at_secs: f64| {
        let index = (at_secs / CONTROL_SECS * PHYSICS_STEPS as f64).round() as usize;
        path.get(index).or(path.last()).copied().unwrap_or(rail.start)
    };
    let tracks: [FingerTrack<'_>; FINGERS] = std::array::from_fn(|finger| {
        let notes = fingering.notes().iter().filter(|note| note.finger == finger).collect();
        FingerTrack { finger, notes, reach, lags }
    });
    let mut angles = [[0.0; JOINTS_PER_FINGER]; FINGERS];
    let mut lateral = [None; FINGERS];
    let targets = fingering.rail().iter().enumerate().map(|(step, rail_target)| {
        let mut targets = [0.0; DRIVEN_JOINTS];
        targets[RAIL] = *rail_target;
        let rail = rail_at(step as f64 * CONTROL_SECS + lags.follow_secs);
        let mut tips: [Tip; FINGERS] = std::array::from_fn(|finger| tracks[finger].tip(step, rail));
        make_room(&mut tips, reach);
        for (finger, tip) in tips.iter_mut().enumerate() {
            let before = lateral[finger].replace(tip.position[1]).unwrap_or(tip.position[1]);
            if tip.striking && (tip.position[1] - before).abs() > TURN_FIRST_M {
                tip.position[2] += reach.hover_height(0) - reach.pressed_height(0);
            }
            // Only a waiting finger can be out of reach: it keeps its angles.
            angles[finger] = reach.joint_angles(finger, tip.position, rail).unwrap_or(angles[finger]);
            targets[finger * JOINTS_PER_FINGER..][..JOINTS_PER_FINGER].copy_from_slice(&angles[finger]);
        }
        for (joint, target) in targets.iter_mut().enumerate() {
            let [low, high] = joint_range(joint);
            *target = (*target + params.joint(JointRow::EncoderBias, joint)).clamp(low, high);
        }
        targets
    });
    targets.collect()
}
