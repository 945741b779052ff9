//! From a fingering to joint targets.
//!
//! The rail's predicted path is known, and every finger is turned to compensate it. A finger lifts, moves over its next key, waits,
//! strikes, holds, lifts.

use etude_music::key_is_black;
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::{JointRow, PhysicalParams};
use etude_stage::{DRIVEN_JOINTS, FINGERS, PHYSICS_STEPS, RAIL, joint_range};

use super::lags::Lags;
use crate::fingering::comb::{ASIDE_M, Comb};
use crate::fingering::rail::{CONTROL_SECS, Rail};
use crate::fingering::{Fingering, Played};

/// Control steps in which a finger crosses the edge between white and black keys.
const CROSS_STEPS: usize = 2;
/// Control steps for which a lifted finger stays over its old key, so that it clears the fences before it moves sideways.
const LIFT_STEPS: usize = 1;
/// Height of a finger that has nothing to play, m above its hover.
const IDLE_RISE: f64 = 0.006;
/// Control steps in which a finger rises before it goes from white to black keys or back.
const CLIMB_STEPS: usize = 2;

/// What one finger plays, in order.
struct Part<'a> {
    finger: usize,
    notes: Vec<&'a Played>,
    comb: &'a Comb,
    lags: &'a Lags,
}

impl Part<'_> {
    /// Control step whose target begins the strike of note `index`.
    fn strike(&self, index: usize) -> usize {
        let note = self.notes[index];
        note.start.saturating_sub(self.lags.strike_steps(key_is_black(note.key)))
    }

    /// Control step whose target lifts the finger after note `index`, which is always before the next strike.
    fn release(&self, index: usize) -> usize {
        let note = self.notes[index];
        let release = note.end.saturating_sub(self.lags.release_steps(key_is_black(note.key)));
        let next = (index + 1 < self.notes.len()).then(|| self.strike(index + 1));
        release.min(next.map_or(release, |strike| strike.saturating_sub(1)))
    }

    /// Where the fingertip should be at control step `step`, when the rail will be at `rail`.
    fn tip(&self, step: usize, rail: f64) -> Tip {
        let waiting = |[x, y]: [f64; 2], z: f64| Tip { at: [x, y, z], striking: false };
        let next = (0..self.notes.len()).find(|index| step < self.release(*index));
        if let Some(index) = next
            && step >= self.strike(index)
        {
            let key = self.notes[index].key;
            let [x, y] = self.comb.over(key);
            return Tip { at: [x, y, self.comb.pressed(key)], striking: true };
        }
        let last = next.unwrap_or(self.notes.len()).checked_sub(1);
        // Before its first note a finger waits over the white keys.
        let since = step - last.map_or(0, |index| self.release(index));
        let last = last.map(|index| self.notes[index].key);
        let next = next.map(|index| self.notes[index].key);
        let [front, _] = self.comb.over(0);
        let idle = [front, self.comb.unturned(self.finger, front) + rail];
        let from = last.map_or(idle, |key| self.comb.over(key));
        let to = next.map_or(idle, |key| self.comb.over(key));
        let height = next.map_or(self.comb.hover(0) + IDLE_RISE, |key| self.comb.hover(key));
        let way = to[0] - from[0];
        if way == 0.0 {
            return match last {
                Some(key) if since < LIFT_STEPS => waiting(from, self.comb.hover(key)),
                _ => waiting(to, height),
            };
        }
        // Between white and black: up, then in stages over the edge of the black keys, then down.
        let stages = CROSS_STEPS as f64;
        let stage = (since as f64 - CLIMB_STEPS as f64 + 1.0).clamp(0.0, stages) / stages;
        let landed = since > CLIMB_STEPS + CROSS_STEPS;
        let y = if since < CLIMB_STEPS { from[1] } else { to[1] };
        waiting([from[0] + way * stage, y], if landed { height } else { self.comb.travel() })
    }
}

/// Where a fingertip should be.
struct Tip {
    at: [f64; 3],
    /// Whether it is on a key or on its way down; neighbours must then keep clear.
    striking: bool,
}

/// Keeps waiting fingers clear of neighbours that play.
fn make_room(tips: &mut [Tip; FINGERS], comb: &Comb) {
    for finger in 0..FINGERS {
        for other in (0..FINGERS).filter(|other| other.abs_diff(finger) == 1) {
            if tips[finger].striking || !tips[other].striking {
                continue;
            }
            let [x, y, _] = tips[finger].at;
            let theirs = tips[other].at[1];
            tips[finger].at[1] = comb.beside(finger, [x, y], other, theirs);
        }
    }
}

/// The targets of all joints at each control step: encoder readings in rad, the rail in m.
pub(super) fn targets(
    (comb, rail, lags, params): (&Comb, &Rail, &Lags, &PhysicalParams),
    fingering: &Fingering,
) -> Vec<[f64; DRIVEN_JOINTS]> {
    let path = rail.follow(rail.start, fingering.rail());
    let place_at = |at_secs: f64| {
        let index = (at_secs / CONTROL_SECS * PHYSICS_STEPS as f64).round() as usize;
        path.get(index).or(path.last()).copied().unwrap_or(rail.start)
    };
    let bias = |joint: usize| params.joint(JointRow::EncoderBias, joint);
    let mut table: Vec<[f64; DRIVEN_JOINTS]> = fingering
        .rail()
        .iter()
        .map(|rail| {
            let mut row = [0.0; DRIVEN_JOINTS];
            row[RAIL] = *rail;
            row
        })
        .collect();
    let parts: [Part<'_>; FINGERS] = std::array::from_fn(|finger| {
        let notes = fingering.notes().iter().filter(|note| note.finger == finger).collect();
        Part { finger, notes, comb, lags }
    });
    let mut angles = [[0.0; JOINTS_PER_FINGER]; FINGERS];
    let mut lateral = [None; FINGERS];
    for (step, row) in table.iter_mut().enumerate() {
        let place = place_at(step as f64 * CONTROL_SECS + lags.follow_secs);
        let mut tips: [Tip; FINGERS] = std::array::from_fn(|finger| parts[finger].tip(step, place));
        make_room(&mut tips, comb);
        for (finger, tip) in tips.iter_mut().enumerate() {
            let before = lateral[finger].replace(tip.at[1]).unwrap_or(tip.at[1]);
            if tip.striking && (tip.at[1] - before).abs() > ASIDE_M {
                tip.at[2] += comb.hover(0) - comb.pressed(0);
            }
            // Only a waiting finger can be out of reach: it keeps its angles.
            angles[finger] = comb.angles(finger, tip.at, place).unwrap_or(angles[finger]);
            row[finger * JOINTS_PER_FINGER..][..JOINTS_PER_FINGER].copy_from_slice(&angles[finger]);
        }
    }
    for row in &mut table {
        for (joint, target) in row.iter_mut().enumerate() {
            let [low, high] = joint_range(joint);
            *target = (*target + bias(joint)).clamp(low, high);
        }
    }
    table
}
