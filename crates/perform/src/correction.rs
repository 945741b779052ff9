//! A correction of a robot's motion, learned on the robot itself by iterative learning control. A
//! robot that follows simulated joints makes nearly the same motion in every run of a song, so what
//! a joint missed in one run is added to its set-points in the next, earlier by the joint's lag.
//!
//! Method: S. Arimoto, S. Kawamura, F. Miyazaki, "Bettering operation of robots by learning",
//! Journal of Robotic Systems 1(2), 1984. Low-pass without phase: D. A. Bristow, M. Tharayil, A. G.
//! Alleyne, "A survey of iterative learning control", IEEE Control Systems 26(3), 2006.

use etude_robot::rig_file::SETPOINT_HZ;
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, RAIL, joint_range};
use serde::{Deserialize, Serialize};

use crate::shaping::Waypoints;
use crate::stats::{deviation, sorted};

/// How the joints were asked to move in a performance and how they moved, at the end of each
/// physics step: rad, the rail in m.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracking {
    /// Set-points, without a correction.
    pub asked: Vec<[f64; DRIVEN_JOINTS]>,
    /// Joints as the encoders read them.
    pub measured: Vec<[f64; DRIVEN_JOINTS]>,
}

/// What is added to the set-points of a song, at the end of each physics step: rad, the rail in m.
/// Nothing after its last one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Correction {
    offsets: Vec<[f64; DRIVEN_JOINTS]>,
}

/// How much later than its set-points a joint should be and is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Delays {
    /// How late every joint should be, s: its path is that of the set-points, later by this.
    pub common_lag_secs: f64,
    /// How late each joint follows its set-points, s. What it missed is corrected earlier by that.
    pub lag_secs: [f64; DRIVEN_JOINTS],
}

/// The share of what a joint missed that is added after each run. With all of it, the noise of one
/// run would be played in the next.
const GAIN: f64 = 0.5;
/// The share of the offsets that is kept after each run. A finger that is stopped by a key does
/// not push harder from run to run.
const RETENTION: f64 = 0.9;
/// The largest offset of a joint that bends a finger, of one that turns it aside, rad, and of the
/// rail, m. A finger that turns aside has the least range, and where it is that far from its
/// set-point the monitor of the robot stops it (a quarter of the range).
const MAX_BEND_RAD: f64 = 0.4;
const MAX_ASIDE_RAD: f64 = 0.1;
const MAX_RAIL_M: f64 = 0.02;
/// Corner of the low-pass over what is added for a finger joint and for the rail, Hz. A stroke of a
/// finger has higher frequencies than a motion of the rail; an arm that rings at 4 to 6 Hz swings
/// more in each run if the rail's is 8 Hz.
const CORNER_HZ: [f64; 2] = [8.0, 4.0];
/// Time in which the correction grows to its full size, s: a robot begins in the pose in which the
/// song begins.
const RAMP_SECS: f64 = 0.5;
/// A joint whose set-points vary less than this, rad and m (standard deviation), has no lag that
/// could be measured.
const STILL: [f64; 2] = [0.005, 0.001];
/// The longest lag that is searched, s.
const MAX_LAG_SECS: f64 = 0.3;
/// Offsets are rounded to this, rad and m: less than an encoder resolves.
const RESOLUTION: f64 = 1e-6;

impl Tracking {
    /// The same run, if it was asked for this in addition.
    #[must_use]
    pub fn asked_for(mut self, addition: &Correction) -> Self {
        addition.add_to(&mut self.asked);
        self
    }

    /// What a joint missed if it should be late by `common_lag_secs`: root mean square, rad, the
    /// rail in m.
    pub fn error(&self, joint: usize, common_lag_secs: f64) -> f64 {
        let (mean, variance) = self.missed(joint, ticks(common_lag_secs));
        (variance + mean * mean).sqrt()
    }

    /// How late a joint follows its set-points, s: where it misses them by the most constant
    /// distance. None for one that hardly moves.
    pub fn lag_secs(&self, joint: usize) -> Option<f64> {
        let asked: Vec<f64> = self.asked.iter().map(|asked| asked[joint]).collect();
        if deviation(&asked) < STILL[usize::from(joint == RAIL)] {
            return None;
        }
        let spread = |late: usize| self.missed(joint, late).1;
        let best = (0..=ticks(MAX_LAG_SECS)).min_by(|a, b| spread(*a).total_cmp(&spread(*b)));
        best.map(|late| late as f64 / SETPOINT_HZ)
    }

    /// How late the joints follow their set-points. They should all be as late as the finger joints
    /// in the median.
    pub fn delays(&self) -> Delays {
        let lags: [Option<f64>; DRIVEN_JOINTS] = std::array::from_fn(|joint| self.lag_secs(joint));
        let fingers = sorted(lags[..RAIL].iter().flatten().copied());
        let common_lag_secs = fingers.get(fingers.len() / 2).copied().unwrap_or(0.0);
        Delays { common_lag_secs, lag_secs: lags.map(|lag| lag.unwrap_or(common_lag_secs)) }
    }

    /// Mean and variance of what a joint missed if it should be `late` physics steps late.
    fn missed(&self, joint: usize, late: usize) -> (f64, f64) {
        let pairs = || self.asked.iter().zip(self.measured.iter().skip(late));
        let missed = || pairs().map(|(asked, measured)| asked[joint] - measured[joint]);
        let count = pairs().count().max(1) as f64;
        let mean = missed().sum::<f64>() / count;
        (mean, missed().map(|missed| (missed - mean).powi(2)).sum::<f64>() / count)
    }
}

impl Correction {
    pub(crate) fn of(offsets: Vec<[f64; DRIVEN_JOINTS]>) -> Self {
        Self { offsets }
    }

    /// The sum of both, as long as the longer one.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let [mut sum, shorter] = if self.len() >= other.len() {
            [self.clone(), other.clone()]
        } else {
            [other.clone(), self.clone()]
        };
        shorter.add_to(&mut sum.offsets);
        sum
    }

    /// Adds the offsets to what is given for each physics step.
    fn add_to(&self, steps: &mut [[f64; DRIVEN_JOINTS]]) {
        for (step, offsets) in steps.iter_mut().zip(&self.offsets) {
            step.iter_mut().zip(offsets).for_each(|(joint, offset)| *joint += offset);
        }
    }

    #[cfg(test)]
    pub(crate) fn offsets(&self) -> &[[f64; DRIVEN_JOINTS]] {
        &self.offsets
    }

    /// Number of physics steps that it corrects.
    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    /// Whether it corrects nothing.
    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// Whether it adds nothing to any set-point.
    pub fn is_still(&self) -> bool {
        self.offsets.iter().all(|offsets| *offsets == [0.0; DRIVEN_JOINTS])
    }

    /// Adds the offsets of control step `step` to its set-points, within the ranges of the joints.
    /// The limiter of the robot follows.
    pub(crate) fn add(&self, step: usize, waypoints: &mut Waypoints) {
        let offsets = self.offsets.get(step * PHYSICS_STEPS..).unwrap_or_default();
        for (waypoint, offsets) in waypoints.iter_mut().zip(offsets) {
            for (joint, offset) in offsets.iter().enumerate() {
                // A file may hold anything.
                let offset = offset.clamp(-max_offset(joint), max_offset(joint));
                let [low, high] = joint_range(joint);
                waypoint[joint] = (waypoint[joint] + offset).clamp(low, high);
            }
        }
    }

    /// The correction for the next run, after one that was played with this one.
    pub fn after(&self, run: &Tracking, delays: &Delays) -> Self {
        let length = run.asked.len();
        let mut offsets = vec![[0.0; DRIVEN_JOINTS]; length];
        for joint in 0..DRIVEN_JOINTS {
            let (late, lag) = (ticks(delays.common_lag_secs), ticks(delays.lag_secs[joint]));
            let missed = |tick: usize| {
                let tick = (tick + lag).min(length - 1);
                run.asked[tick.saturating_sub(late)][joint] - run.measured[tick][joint]
            };
            let mut added: Vec<f64> = (0..length).map(|tick| GAIN * missed(tick)).collect();
            low_pass(&mut added, CORNER_HZ[usize::from(joint == RAIL)]);
            let (max, [low, high]) = (max_offset(joint), joint_range(joint));
            for (tick, added) in added.into_iter().enumerate() {
                let before = self.offsets.get(tick).map_or(0.0, |offsets| offsets[joint]);
                let asked = run.asked[tick][joint];
                // Nothing is learned beyond the range of the joint: it would have to be unlearned.
                let within = (asked + RETENTION * before + grown(tick) * added).clamp(low, high) - asked;
                let offset = within.clamp(-max, max);
                offsets[tick][joint] = (offset / RESOLUTION).round() * RESOLUTION;
            }
        }
        Self { offsets }
    }
}

/// The largest offset of a joint, rad, of the rail m.
fn max_offset(joint: usize) -> f64 {
    match joint {
        RAIL => MAX_RAIL_M,
        finger if finger % JOINTS_PER_FINGER == 0 => MAX_ASIDE_RAD,
        _ => MAX_BEND_RAD,
    }
}

/// The share of its full size that what is added has at a physics step.
pub(crate) fn grown(tick: usize) -> f64 {
    (tick as f64 / SETPOINT_HZ / RAMP_SECS).min(1.0)
}

/// Number of physics steps in this time; none in a negative one.
pub(crate) fn ticks(secs: f64) -> usize {
    (secs * SETPOINT_HZ).round() as usize
}

/// A first-order low-pass, forward and then backward: without phase.
fn low_pass(values: &mut [f64], corner_hz: f64) {
    let share = 1.0 - (-std::f64::consts::TAU * corner_hz / SETPOINT_HZ).exp();
    let mut state = values.first().copied().unwrap_or(0.0);
    let mut follow = |value: &mut f64| {
        state += share * (*value - state);
        *value = state;
    };
    values.iter_mut().for_each(&mut follow);
    values.iter_mut().rev().for_each(&mut follow);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Control steps of the test's song.
    const STEPS: usize = 80;

    /// A finger joint and the rail that move back and forth, the others at rest.
    fn song() -> Vec<[f64; DRIVEN_JOINTS]> {
        (0..STEPS * PHYSICS_STEPS)
            .map(|tick| {
                let swing = 1.0 - (tick as f64 / SETPOINT_HZ * 3.0).cos();
                let mut joints = [0.1; DRIVEN_JOINTS];
                joints[1] += 0.2 * swing;
                joints[RAIL] = 0.02 * swing;
                joints
            })
            .collect()
    }

    /// A robot whose joints are 60 ms late, lag by a first order, and sag.
    fn play(asked: &[[f64; DRIVEN_JOINTS]], correction: &Correction) -> Tracking {
        let mut sent = Vec::new();
        for step in 0..STEPS {
            let mut waypoints: Waypoints = std::array::from_fn(|tick| asked[step * PHYSICS_STEPS + tick]);
            correction.add(step, &mut waypoints);
            sent.extend(waypoints);
        }
        let mut joints = asked[0];
        let measured = (0..sent.len())
            .map(|tick| {
                for (joint, place) in joints.iter_mut().enumerate() {
                    *place += 0.2 * (sent[tick.saturating_sub(12)][joint] - *place);
                }
                joints.map(|place| place - 0.004)
            })
            .collect();
        Tracking { asked: asked.to_vec(), measured }
    }

    #[test]
    fn a_joint_that_is_late_and_sags_comes_to_its_path_in_a_few_runs() {
        let asked = song();
        let mut correction = Correction::default();
        let first = play(&asked, &correction);
        for joint in [1, RAIL] {
            let lag_secs = first.lag_secs(joint).unwrap();
            assert!((0.07..0.09).contains(&lag_secs), "{joint}: {lag_secs}");
        }
        assert_eq!(first.lag_secs(0), None, "it does not move");
        let delays = first.delays();
        assert_eq!(delays.lag_secs[0], delays.common_lag_secs, "that of the fingers");
        for _ in 0..8 {
            correction = correction.after(&play(&asked, &correction), &delays);
        }
        let last = play(&asked, &correction);
        for joint in 0..DRIVEN_JOINTS {
            let errors = [&first, &last].map(|run| run.error(joint, delays.common_lag_secs));
            assert!(errors[1] < 0.4 * errors[0], "{joint}: {errors:?}");
        }
    }

    #[test]
    fn a_correction_begins_at_rest_and_ends_with_the_song() {
        let asked = song();
        let delays = Delays { common_lag_secs: 0.0, lag_secs: [0.08; DRIVEN_JOINTS] };
        let correction = Correction::default().after(&play(&asked, &Correction::default()), &delays);
        assert_eq!(correction.len(), STEPS * PHYSICS_STEPS);
        assert_eq!(correction.offsets[0], [0.0; DRIVEN_JOINTS]);
        let mut waypoints: Waypoints = [[0.3; DRIVEN_JOINTS]; PHYSICS_STEPS];
        correction.add(STEPS, &mut waypoints);
        assert_eq!(waypoints, [[0.3; DRIVEN_JOINTS]; PHYSICS_STEPS]);
        let text = serde_json::to_string(&correction).unwrap();
        assert_eq!(serde_json::from_str::<Correction>(&text).unwrap(), correction);
    }

    proptest! {
        /// Whatever was measured, offsets are bounded and set-points stay in the ranges of the
        /// joints.
        #[test]
        fn set_points_stay_in_the_ranges_of_the_joints(
            places in prop::collection::vec(prop::array::uniform13(-3.0..3.0f64), PHYSICS_STEPS),
            common_lag_secs in 0.0..0.3f64,
            lag_secs in prop::array::uniform13(0.0..0.3f64),
        ) {
            let asked: Vec<[f64; DRIVEN_JOINTS]> = vec![std::array::from_fn(|joint| joint_range(joint)[1]); PHYSICS_STEPS];
            let run = Tracking { asked, measured: places };
            let mut correction = Correction::default();
            for _ in 0..20 {
                correction = correction.after(&run, &Delays { common_lag_secs, lag_secs });
            }
            let mut waypoints: Waypoints = std::array::from_fn(|tick| run.asked[tick]);
            correction.add(0, &mut waypoints);
            for (waypoint, offsets) in waypoints.iter().zip(&correction.offsets) {
                for joint in 0..DRIVEN_JOINTS {
                    let [low, high] = joint_range(joint);
                    prop_assert!((low..=high).contains(&waypoint[joint]));
                    prop_assert!(offsets[joint].abs() <= max_offset(joint));
                }
            }
        }
    }
}
