//! Lags of the hand behind its targets, measured in a world of their own.
//!
//! The lags depend on filters, limits, gains, masses and the springs of the keys, all of which may
//! vary. So they are measured: one finger strikes one white and one black key and turns once, which
//! takes a few milliseconds of computing. With the default `PhysicalParams` a strike takes 70 ms
//! (black: 80) and a release 55 ms; motors with back-EMF, as in the preset `fast`, are slower.

use etude_music::KeyEvent;
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::JointRow;
use etude_stage::{DRIVEN_JOINTS, PhysicalParams, RAIL, StageConfig, World};

use crate::TaskError;
use crate::fingering::hand_reach::HandReach;
use crate::fingering::rail_model::CONTROL_SECS;

/// The finger that is measured: the middle one, whose root is not splayed.
const FINGER: usize = 1;
/// Middle C and its sharp.
const TRIAL_KEYS: [usize; 2] = [24, 25];
/// Long enough for any move to end, control steps.
const TRIAL_STEPS: usize = 20;
/// Lag that is assumed if the key does not sound in the trial, s.
const UNKNOWN_SECS: f64 = 0.1;
/// How much lower than usual the finger waits between two strikes of one key, m. The usual height
/// is 6 mm over the key.
const LOWERED_M: [f64; 3] = [0.0, 0.002, 0.004];
/// A small turn of the finger, rad.
const TURN_RAD: f64 = 0.1;
/// A key may cross its threshold this much before the end of a control step, s: one physics step.
const MARGIN_SECS: f64 = 0.005;

/// How late the hand is behind its targets, on a white and on a black key. A time is absent if it
/// is longer than a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lags {
    /// From the target that strikes until the key sounds, s: `[white, black]`.
    pub sound_secs: [Option<f64>; 2],
    /// From the target that lifts until it is silent, s.
    pub silence_secs: [Option<f64>; 2],
    /// Mean lag of a finger joint behind a moving target that changes once a control step, s.
    pub follow_secs: f64,
}

impl Lags {
    /// Measures them in the world of `stage` with these physical parameters.
    ///
    /// # Errors
    /// If the world cannot be built.
    pub fn measure(stage: &StageConfig, params: &PhysicalParams) -> Result<Self, TaskError> {
        let mut trial = Trial::new(stage, params)?;
        let mut lags = Self { sound_secs: [None; 2], silence_secs: [None; 2], follow_secs: 0.0 };
        for (kind, key) in TRIAL_KEYS.into_iter().enumerate() {
            let [up, down] = trial.poses(key, 0.0);
            trial.world.reset_to(&up);
            let is_down = |event: &KeyEvent| event.velocity > 0;
            lags.sound_secs[kind] = trial.first(&down, key, is_down);
            lags.silence_secs[kind] = trial.first(&up, key, |event| !is_down(event));
        }
        lags.follow_secs = mean_turn_lag(&mut trial.world);
        Ok(lags)
    }

    /// From the target that strikes to the first step in which the key sounds, in control steps.
    pub(super) fn strike_steps(&self, is_black: bool) -> usize {
        whole_steps(self.sound_secs[usize::from(is_black)])
    }

    /// From the target that lifts to the first step in which it does not, in control steps.
    pub(super) fn release_steps(&self, is_black: bool) -> usize {
        whole_steps(self.silence_secs[usize::from(is_black)])
    }
}

/// The shortest time for which a white and a black key are silent when the hand strikes them again
/// at once, s: `[white, black]`. The finger is lifted for as few control steps, and as little, as
/// it needs for a silence of a control step, which a policy observes and a listener hears. Absent
/// if it cannot within a second.
///
/// # Errors
/// If the world cannot be built.
pub fn shortest_silences(
    stage: &StageConfig,
    params: &PhysicalParams,
) -> Result<[Option<f64>; 2], TaskError> {
    let mut trial = Trial::new(stage, params)?;
    Ok(TRIAL_KEYS.map(|key| {
        LOWERED_M.into_iter().filter_map(|lowered| trial.shortest_silence(key, lowered)).reduce(f64::min)
    }))
}

/// A world in which one finger strikes.
struct Trial {
    world: World,
    reach: HandReach,
}

impl Trial {
    fn new(stage: &StageConfig, params: &PhysicalParams) -> Result<Self, TaskError> {
        // Without encoder biases, since lags do not depend on them.
        let mut params = params.clone();
        (0..DRIVEN_JOINTS).for_each(|joint| params.set_joint(JointRow::EncoderBias, joint, 0.0));
        Ok(Self { world: World::new(stage, &params)?, reach: HandReach::new(stage.side, &params) })
    }

    /// The finger waiting over `key`, so much lower than usual (m), and pressing it.
    fn poses(&self, key: usize, lowered: f64) -> [[f64; DRIVEN_JOINTS]; 2] {
        let [x, y] = self.reach.over(key);
        let [low, high] = self.reach.rail_interval(FINGER, key);
        let rail = (low + high) / 2.0;
        [self.reach.hover_height(key) - lowered, self.reach.pressed_height(key)].map(|z| {
            let mut pose = self.world.start_pose();
            pose[RAIL] = rail;
            let angles = self.reach.joint_angles(FINGER, [x, y, z], rail).unwrap_or_default();
            pose[FINGER * JOINTS_PER_FINGER..][..JOINTS_PER_FINGER].copy_from_slice(&angles);
            pose
        })
    }

    /// Time until the first such event of `key` in a trial, s.
    fn first(
        &mut self,
        pose: &[f64; DRIVEN_JOINTS],
        key: usize,
        is_it: impl Fn(&KeyEvent) -> bool,
    ) -> Option<f64> {
        let begin = self.world.time_secs();
        self.events(pose, key, TRIAL_STEPS).iter().find(|event| is_it(event)).map(|event| event.secs - begin)
    }

    fn shortest_silence(&mut self, key: usize, lowered: f64) -> Option<f64> {
        let [up, down] = self.poses(key, lowered);
        (1..=TRIAL_STEPS).find_map(|rest| {
            self.world.reset_to(&up);
            self.events(&down, key, TRIAL_STEPS);
            if !self.world.pressed().contains(key) {
                return None;
            }
            let mut events = self.events(&up, key, rest);
            events.extend(self.events(&down, key, TRIAL_STEPS));
            let silent = events.iter().find(|event| event.velocity == 0)?.secs;
            let again = events.iter().find(|event| event.secs > silent && event.velocity > 0)?.secs;
            (again - silent > CONTROL_SECS - MARGIN_SECS / 2.0).then_some(again - silent)
        })
    }

    /// The events of `key` in so many control steps.
    fn events(&mut self, pose: &[f64; DRIVEN_JOINTS], key: usize, steps: usize) -> Vec<KeyEvent> {
        let mut events = Vec::new();
        for _ in 0..steps {
            self.world.step(pose);
            events.extend(self.world.events().iter().filter(|event| event.key == key));
        }
        events
    }
}

/// The whole control steps in a lag; the rest lies within the intended step.
fn whole_steps(lag_secs: Option<f64>) -> usize {
    ((lag_secs.unwrap_or(UNKNOWN_SECS) - MARGIN_SECS) / CONTROL_SECS).max(0.0) as usize
}

/// Mean lag of a turn about the finger's axis: the area between target and joint over the size of
/// the step.
fn mean_turn_lag(world: &mut World) -> f64 {
    world.reset();
    let mut pose = world.start_pose();
    let joint = FINGER * JOINTS_PER_FINGER;
    let begin = pose[joint];
    pose[joint] += TURN_RAD;
    // A target that is held for a control step is half a step late on average.
    let mut behind = CONTROL_SECS / 2.0;
    let mut before = 0.0;
    for _ in 0..TRIAL_STEPS {
        world.step(&pose);
        let turned = (world.joints()[joint] - begin) / TURN_RAD;
        behind += (1.0 - (before + turned) / 2.0) * CONTROL_SECS;
        before = turned;
    }
    behind
}

#[cfg(test)]
mod tests {
    use etude_music::KeyScheduleConfig;

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

    #[test]
    fn a_key_can_be_struck_again_within_the_rest_that_is_planned() {
        let silences = shortest_silences(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let rest_secs = KeyScheduleConfig::default().restrike_secs;
        for silence in silences.map(Option::unwrap) {
            assert!(silence > CONTROL_SECS - MARGIN_SECS && silence <= rest_secs, "{silences:?}");
        }
    }

    #[test]
    fn a_slow_hand_needs_a_longer_rest() {
        let measured = |low_pass: f64| {
            let mut params = PhysicalParams::default();
            params.set("joint.fingers.low_pass", low_pass).unwrap();
            shortest_silences(&StageConfig::default(), &params).unwrap()
        };
        let [quick, slow] = [measured(0.005), measured(0.2)];
        assert!((0..2).all(|kind| quick[kind].unwrap() + 0.01 < slow[kind].unwrap()), "{quick:?} {slow:?}");
    }

    #[test]
    fn a_key_that_is_too_heavy_for_the_finger_has_no_times() {
        let mut params = PhysicalParams::default();
        params.set("joint.fingers.torque_limit", 0.01).unwrap();
        params.set("key.preload", 2.0).unwrap();
        let stage = StageConfig::default();
        assert_eq!(shortest_silences(&stage, &params).unwrap(), [None; 2]);
        assert_eq!(Lags::measure(&stage, &params).unwrap().sound_secs, [None; 2]);
    }
}
