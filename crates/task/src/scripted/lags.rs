//! Lags of the hand behind its targets, measured in a world of their own.
//!
//! The lags depend on filters, limits, gains, masses and the springs of the keys, all of which may vary. So they are measured: one
//! finger strikes one white and one black key, strikes them again and turns once, which takes a few milliseconds of computing. With the
//! default numbers a key sounds 70 ms after the target (black: 80), is silent after 55 ms, and sounds anew if it is left for one control
//! step.

use etude_stage::hand::FINGER_JOINTS;
use etude_stage::params::JointRow;
use etude_stage::{JOINTS, PhysicalParams, RAIL, StageConfig, World};
use serde::Serialize;

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

/// How late the hand is behind its targets, on a white and on a black key. A time is absent if it is longer than a second.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Lags {
    /// From the target that strikes until the key sounds, s: `[white, black]`.
    pub sound_secs: [Option<f64>; 2],
    /// From the target that lifts until it is silent, s.
    pub silence_secs: [Option<f64>; 2],
    /// The shortest time between the target that lifts and the next that strikes after which the key sounds anew, s: a whole number
    /// of control steps.
    pub restrike_secs: [Option<f64>; 2],
    /// Mean lag of a finger joint behind a moving target that changes once a control step, s.
    pub follow_secs: f64,
}

impl Lags {
    /// Measures them in the world of `stage` with these physical numbers.
    ///
    /// # Errors
    /// If the world cannot be built.
    pub fn measure(stage: &StageConfig, params: &PhysicalParams) -> Result<Self, TaskError> {
        // Without encoder biases, since lags do not depend on them.
        let mut params = params.clone();
        (0..JOINTS).for_each(|joint| params.set_joint(JointRow::EncoderBias, joint, 0.0));
        let comb = Comb::new(stage.side, &params);
        let mut world = World::new(stage, &params)?;
        let mut lags = Self {
            sound_secs: [None; 2],
            silence_secs: [None; 2],
            restrike_secs: [None; 2],
            follow_secs: 0.0,
        };
        for (kind, key) in KEYS.into_iter().enumerate() {
            let ([x, y], rail) = (comb.over(key), middle(comb.tube(FINGER, key)));
            let bend = |z: f64| comb.angles(FINGER, [x, y, z], rail).unwrap_or_default();
            let mut pose = world.start_pose();
            pose[RAIL] = rail;
            let up = with(&pose, bend(comb.hover(key)));
            let down = with(&pose, bend(comb.pressed(key)));
            world.reset_to(&up);
            lags.sound_secs[kind] = until_change(&mut world, &down, key, TRIAL_STEPS);
            lags.silence_secs[kind] = until_change(&mut world, &up, key, TRIAL_STEPS);
            let restrikes = |rest: &usize| {
                world.reset_to(&up);
                until_change(&mut world, &down, key, TRIAL_STEPS);
                let lifted = until_change(&mut world, &up, key, *rest);
                // Up to the end of the trial: it may fall silent only after the finger has turned back.
                let changes = changes(&mut world, &down, key, TRIAL_STEPS);
                changes.len() == if lifted.is_some() { 1 } else { 2 }
            };
            let rest = lags.sound_secs[kind].and_then(|_| (1..=TRIAL_STEPS).find(restrikes));
            lags.restrike_secs[kind] = rest.map(|steps| steps as f64 * CONTROL_SECS);
        }
        lags.follow_secs = turning(&mut world);
        Ok(lags)
    }

    /// The longer of the two shortest rests, s; absent if one is.
    pub fn longest_restrike_secs(&self) -> Option<f64> {
        let [white, black] = self.restrike_secs;
        Some(white?.max(black?))
    }

    /// From the target that strikes to the first step in which the key sounds, in control steps.
    pub(super) fn strike_steps(&self, is_black: bool) -> usize {
        lead(self.sound_secs[usize::from(is_black)])
    }

    /// From the target that lifts to the first step in which it does not, in control steps.
    pub(super) fn release_steps(&self, is_black: bool) -> usize {
        lead(self.silence_secs[usize::from(is_black)])
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
fn lead(lag_secs: Option<f64>) -> usize {
    ((lag_secs.unwrap_or(UNKNOWN_SECS) - MARGIN_SECS) / CONTROL_SECS).max(0.0) as usize
}

/// Time until `key` first changes between sounding and not, in so many control steps, s.
fn until_change(world: &mut World, pose: &[f64; RAIL + 1], key: usize, steps: usize) -> Option<f64> {
    changes(world, pose, key, steps).first().copied()
}

/// Times at which `key` changes between sounding and not, s.
fn changes(world: &mut World, pose: &[f64; RAIL + 1], key: usize, steps: usize) -> Vec<f64> {
    let begin = world.time_secs();
    let mut changes = Vec::new();
    for _ in 0..steps {
        world.step(pose);
        changes
            .extend(world.events().iter().filter(|event| event.key == key).map(|event| event.secs - begin));
    }
    changes
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
    use etude_music::PlanConfig;

    use super::*;

    #[test]
    fn slower_joints_lag_more() {
        let stage = StageConfig::default();
        let measured = |low_pass: f64| {
            let mut params = PhysicalParams::default();
            params.set("joint.fingers.low_pass", low_pass).unwrap();
            Lags::measure(&stage, &params).unwrap()
        };
        let (quick, slow) = (measured(0.005), measured(0.15));
        assert!(quick.follow_secs + 0.1 < slow.follow_secs);
        assert!([false, true].into_iter().all(|black| quick.strike_steps(black) < slow.strike_steps(black)));
    }

    #[test]
    fn lags_do_not_depend_on_what_encoders_read() {
        let stage = StageConfig::default();
        let measured = |params: &PhysicalParams| Lags::measure(&stage, params).unwrap();
        let mut params = PhysicalParams::default();
        let straight = measured(&params);
        params.set("joint.fingers.encoder_bias", 0.05).unwrap();
        params.set("joint.rail.encoder_bias", 0.02).unwrap();
        assert_eq!(straight, measured(&params));
    }

    /// The plan's default is what the hand needs in the default world, and a control step more.
    #[test]
    fn a_key_is_struck_again_after_one_control_step() {
        let stage = StageConfig::default();
        let params = PhysicalParams::default();
        let lags = Lags::measure(&stage, &params).unwrap();
        assert_eq!(lags.restrike_secs, [Some(CONTROL_SECS); 2]);
        assert_eq!(PlanConfig::default().restrike_secs, 2.0 * CONTROL_SECS);
    }

    /// A key that falls silent higher up, under a slow hand, has to be left for longer.
    #[test]
    fn a_slow_hand_and_two_contacts_need_a_longer_rest() {
        let stage = StageConfig::default();
        let measured = |low_pass: f64, hysteresis: f64| {
            let mut params = PhysicalParams::default();
            params.set("joint.fingers.low_pass", low_pass).unwrap();
            params.set("key.hysteresis", hysteresis).unwrap();
            Lags::measure(&stage, &params).unwrap()
        };
        let [quick, slow] = [measured(0.005, 0.0), measured(0.15, 0.8)];
        assert!((0..2).all(|kind| quick.silence_secs[kind] < slow.silence_secs[kind]));
        assert!((0..2).all(|kind| quick.restrike_secs[kind] < slow.restrike_secs[kind]), "{slow:?}");
    }
}
