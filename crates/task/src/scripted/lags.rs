//! Lags of the hand behind its targets, measured in a separate world before the song is planned.
//!
//! The lags depend on filters, limits, gains, masses and the springs of the keys, all of which may vary. So they are measured: one
//! finger strikes one white and one black key and turns once, which takes a few milliseconds of computing. With the default numbers
//! a strike takes 70 ms (black: 85) and a release 55 ms.

use etude_stage::hand::FINGER_JOINTS;
use etude_stage::params::JointRow;
use etude_stage::{JOINTS, PhysicalParams, RAIL, StageConfig, World};

use crate::TaskError;
use crate::fingering::comb::Comb;
use crate::fingering::rail::CONTROL_SECS;

/// The finger that is measured: the middle one, whose root is not splayed.
const FINGER: usize = 1;
/// Middle C and its sharp.
const KEYS: [usize; 2] = [24, 25];
/// Long enough for any move to end, control steps.
const TRIAL_STEPS: usize = 20;
/// Lag that is assumed if the key does not sound in the trial, s.
const UNKNOWN_SECS: f64 = 0.1;
/// A small turn of the finger, rad.
const TURN_RAD: f64 = 0.1;
/// A key may cross its threshold this much before the end of a control step, s: one physics step.
const MARGIN_SECS: f64 = 0.005;

/// Leads of white and of black keys, in control steps, and the lag of a turn.
pub(super) struct Lags {
    /// From the target that strikes to the first step in which the key sounds: `[white, black]`.
    pub strike: [usize; 2],
    /// From the target that lifts to the first step in which it does not.
    pub release: [usize; 2],
    /// Mean lag of a finger joint behind a moving target that changes once a control step, s.
    pub follow_secs: f64,
}

impl Lags {
    /// Measures them for `stage` with these physical numbers.
    pub(super) fn measure(
        stage: &StageConfig,
        params: &PhysicalParams,
        comb: &Comb,
    ) -> Result<Self, TaskError> {
        // Without encoder biases, since lags do not depend on them.
        let mut params = params.clone();
        (0..JOINTS).for_each(|joint| params.set_joint(JointRow::EncoderBias, joint, 0.0));
        let mut world = World::new(stage, &params)?;
        let mut lags = Self { strike: [1; 2], release: [1; 2], follow_secs: 0.0 };
        for (kind, key) in KEYS.into_iter().enumerate() {
            let ([x, y], rail) = (comb.over(key), middle(comb.tube(FINGER, key)));
            let bend = |z: f64| comb.angles(FINGER, [x, y, z], rail).unwrap_or_default();
            let mut pose = world.start_pose();
            pose[RAIL] = rail;
            let up = with(&pose, bend(comb.hover(key)));
            let down = with(&pose, bend(comb.pressed(key)));
            world.reset_to(&up);
            lags.strike[kind] = lead(until_key(&mut world, &down, key));
            lags.release[kind] = lead(until_key(&mut world, &up, key));
        }
        lags.follow_secs = turning(&mut world);
        Ok(lags)
    }
}

fn middle([low, high]: [f64; 2]) -> f64 {
    (low + high) / 2.0
}

fn with(pose: &[f64; RAIL + 1], angles: [f64; FINGER_JOINTS]) -> [f64; RAIL + 1] {
    let mut pose = *pose;
    pose[FINGER * FINGER_JOINTS..][..FINGER_JOINTS].copy_from_slice(&angles);
    pose
}

/// The whole control steps in a lag; the rest lies within the intended step.
fn lead(lag_secs: f64) -> usize {
    ((lag_secs - MARGIN_SECS) / CONTROL_SECS).max(0.0) as usize
}

/// Time until `key` changes between sounding and not, s.
fn until_key(world: &mut World, pose: &[f64; RAIL + 1], key: usize) -> f64 {
    let begin = world.time_secs();
    let mut changed = None;
    for _ in 0..TRIAL_STEPS {
        world.step(pose);
        let event = world.events().iter().find(|event| event.key == key);
        changed = changed.or(event.map(|event| event.secs - begin));
    }
    changed.unwrap_or(UNKNOWN_SECS)
}

/// Mean lag of a turn about the finger's axis: the area between target and joint over the size of the step.
fn turning(world: &mut World) -> f64 {
    world.reset();
    let mut pose = world.start_pose();
    let joint = FINGER * FINGER_JOINTS;
    let begin = pose[joint];
    pose[joint] += TURN_RAD;
    let mut behind = CONTROL_SECS / 2.0; // A target that is held for a control step is half a step late on average.
    let mut before = 0.0;
    for _ in 0..TRIAL_STEPS {
        world.step(&pose);
        let gone = (world.joints()[joint] - begin) / TURN_RAD;
        behind += (1.0 - (before + gone) / 2.0) * CONTROL_SECS;
        before = gone;
    }
    behind
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slower_joints_lag_more() {
        let stage = StageConfig::default();
        let measured = |low_pass: f64| {
            let mut params = PhysicalParams::default();
            params.set("joint.fingers.low_pass", low_pass).unwrap();
            let comb = Comb::new(stage.side, &params);
            Lags::measure(&stage, &params, &comb).unwrap()
        };
        let (quick, slow) = (measured(0.005), measured(0.15));
        assert!(quick.follow_secs + 0.1 < slow.follow_secs);
        assert!((0..2).all(|kind| quick.strike[kind] < slow.strike[kind]));
    }

    #[test]
    fn lags_do_not_depend_on_what_encoders_read() {
        let stage = StageConfig::default();
        let comb = Comb::new(stage.side, &PhysicalParams::default());
        let measured = |params: &PhysicalParams| Lags::measure(&stage, params, &comb).unwrap();
        let mut params = PhysicalParams::default();
        let straight = measured(&params);
        params.set("joint.fingers.encoder_bias", 0.05).unwrap();
        params.set("joint.rail.encoder_bias", 0.02).unwrap();
        let biased = measured(&params);
        assert_eq!((straight.strike, straight.release), (biased.strike, biased.release));
        assert_eq!(straight.follow_secs, biased.follow_secs);
    }
}
