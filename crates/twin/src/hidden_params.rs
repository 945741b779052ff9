//! The numbers of a [`TwinParams`](crate::TwinParams): what may stand in its file. They do not
//! leave this crate.

use std::collections::BTreeMap;
use std::time::Duration;

use etude_checks::{check_range, settings};
use etude_emulators::KeyboardEmulatorConfig;
use etude_emulators::faults::{FaultPlan, OrderedFault};
use etude_music::KEY_COUNT;
use etude_stage::geometry::WHITE_PITCH;
use etude_stage::params::WorldRow;
use etude_stage::{Cone, Integrator, KeyFactors, ModelOptions, ParamError, PhysicalParams};
use serde::{Deserialize, Serialize};

use crate::error::TwinParamsError;

/// One step of the twin: a third of the hand's period, a fifth of the simulator's physics step.
pub const STEP: Duration = Duration::from_millis(1);
/// Joints of a finger.
pub(crate) const FINGER: usize = 4;
/// The gap between two white keys, m: RoboPianist's (`models/piano/piano_constants.py`).
pub(crate) const KEY_GAP_M: f64 = 0.001;
/// How far apart the two contacts of a key are at least, and the second from the stop, as a share
/// of its travel.
const CONTACT_GAP: f64 = 0.02;

/// One parameter set, one TOML file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct HiddenParams {
    /// Its name.
    pub(crate) name: String,
    /// Seed of how its keys differ, and with what is added to it for a run, of encoder noise and
    /// faulty links.
    pub(crate) seed: u64,
    /// Physical numbers of its world other than the defaults, by path.
    pub(crate) physics: BTreeMap<String, f64>,
    /// How its world is computed, and how the keyboard stands in it.
    pub(crate) world: WorldParams,
    /// The hand.
    pub(crate) hand: HandParams,
    /// The arm.
    pub(crate) arm: ArmParams,
    /// The keyboard's line.
    pub(crate) keyboard: KeyboardEmulatorConfig,
    /// The keys and their contacts.
    pub(crate) keys: KeyParams,
    /// What happens on the wires.
    pub(crate) links: LinkParams,
    /// What goes wrong, and when.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) faults: Vec<OrderedFault>,
}

settings! {
    /// The parameter set of a world, in addition to its physical numbers.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub(crate) struct WorldParams("world") {
        /// `implicitfast`, or the simulator's `euler`.
        pub(crate) integrator: Integrator = Integrator::ImplicitFast;
        /// Shape of friction: `pyramidal`, or the simulator's `elliptic`.
        pub(crate) cone: Cone = Cone::Pyramidal;
        /// Turn of the keyboard about its middle, counter-clockwise from above, rad. Its place and
        /// height are physical numbers: `keyboard.depth`, `keyboard.lateral`, `keyboard.height`.
        pub(crate) keyboard_yaw_rad: f64 = 0.0, -0.05..=0.05;
        /// Whether the hand has a weight. Without one, the twin's rig has no feed-forward against
        /// it.
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        pub(crate) gravity: bool = false;
    }
}

settings! {
    /// The parameter set of a hand. Encoder readings are in whole counts, as the wire has them.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub(crate) struct HandParams("hand") {
        /// Torque at full duty of the four joints of a finger, N·m.
        pub(crate) full_torque_nm: [f64; FINGER] = [1.0; FINGER], 0.0..=10.0;
        /// Duty that moves nothing, in counts of PWM; more of it counts from there.
        pub(crate) dead_pwm: u16 = 0, 0.0..=100.0;
        /// Speed at full duty of a joint that nothing holds, rad/s: the motor's own voltage takes
        /// the torque away as it turns. Without it the torque does not depend on the speed.
        pub(crate) no_load_rad_per_sec: Option<f64> = None, 2.0..=100.0;
        /// Play between a joint's encoder and its link, rad: so far the link turns back before the
        /// encoder follows.
        pub(crate) encoder_backlash_rad: f64 = 0.0, 0.0..=0.1;
        /// Play between a motor and its joint, rad: so far the motor turns without the joint before
        /// its torque has an effect. The encoder is on the joint's side of it.
        pub(crate) motor_backlash_rad: f64 = 0.0, 0.0..=0.1;
        /// Time constant of the hand's own filter on its positions, s; 0 is none.
        pub(crate) filter_secs: f64 = 0.0, 0.0..=0.1;
        /// Encoder readings are off by up to so many counts, evenly.
        pub(crate) noise_counts: u16 = 1;
        /// The hand's clock runs this much faster than the host's, as a share.
        pub(crate) clock_skew: f64 = 0.0, -0.01..=0.01;
        /// Torque is cut when no torque frame came for so long, s; with none it is held without
        /// limit, as is to be expected.
        pub(crate) torque_timeout_secs: Option<f64> = None, 0.0..=60.0;
    }
}

settings! {
    /// The parameter set of an arm.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub(crate) struct ArmParams("arm") {
        /// Time from a servo target's arrival until it takes effect, s.
        pub(crate) delay_secs: f64 = 0.01, 0.0..=0.5;
        /// How fast the joints close in on a servo target, Hz.
        pub(crate) bandwidth_hz: f64 = 10.0, 0.5..=100.0;
        /// With it the joints follow as a mass on a spring of that frequency with this damping
        /// ratio, and overshoot below 1.
        pub(crate) damping_ratio: Option<f64> = None, 0.2..=2.0;
        /// Stiffness of the hand's place along the keyboard, N/m.
        pub(crate) stiffness: f64 = 40_000.0, 100.0..=1e6;
        /// Damping of it, N·s/m.
        pub(crate) damping: f64 = 1000.0, 1.0..=1e5;
        /// How the hand is turned on the arm, rad: about the axis toward the player, and about the
        /// keyboard's length.
        pub(crate) tilt_rad: [f64; 2] = [0.0; 2], -0.05..=0.05;
        /// How much lower the hand hangs at the ends of the keyboard than in its middle, m: the
        /// farther the arm reaches, the more it bends.
        pub(crate) sag_m: f64 = 0.0, -0.01..=0.01;
        /// Kinematic error: how far the hand is off its place at most in each of three directions,
        /// m.
        pub(crate) error_m: f64 = 0.0, 0.0..=0.005;
        /// The way along the keyboard after which that error repeats, m.
        pub(crate) error_period_m: f64 = 0.2, 0.02..=1.0;
    }
}

settings! {
    /// The parameter set of the keys, in addition to their physical numbers. Each has two contacts:
    /// the second is at the physical `key.threshold`.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub(crate) struct KeyParams("keys") {
        /// Keys' thresholds lie within so much of `key.threshold`, as a share of it, evenly.
        pub(crate) threshold_spread: f64 = 0.0, 0.0..=0.5;
        /// The same of their springs and `key.stiffness`.
        pub(crate) stiffness_spread: f64 = 0.0, 0.0..=0.9;
        /// Travel of every key as a multiple of the simulator's.
        pub(crate) travel: f64 = 1.0, 0.5..=1.5;
        /// Where the first contact closes, as a share of travel.
        pub(crate) first_contact: f64 = 0.3, CONTACT_GAP..;
        /// Time between the contacts of a key that sounds with the greatest velocity, s.
        pub(crate) loudest_secs: f64 = etude_stage::LOUDEST_SECS, 1e-4..=0.1;
        /// The same with the least velocity, s: at least twice as long.
        pub(crate) softest_secs: f64 = etude_stage::SOFTEST_SECS, ..=10.0;
    }
}

/// What happens on the wires, both ways alike.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct LinkParams {
    /// The hand's bus.
    pub(crate) can: FaultPlan,
    /// The arm's connections.
    pub(crate) arm: FaultPlan,
    /// The keyboard's line.
    pub(crate) midi: FaultPlan,
}

impl HiddenParams {
    /// The physical numbers of its world.
    pub(crate) fn params(&self) -> Result<PhysicalParams, ParamError> {
        PhysicalParams::default().with(&self.physics)
    }

    /// How its world is built and computed.
    pub(crate) fn options(&self) -> ModelOptions {
        let stiffness = self.key_factors(Purpose::Stiffness, self.keys.stiffness_spread);
        ModelOptions {
            step_secs: STEP.as_secs_f64(),
            integrator: self.world.integrator,
            cone: self.world.cone,
            firm_stops: true,
            keyboard_yaw_rad: self.world.keyboard_yaw_rad,
            gravity: self.world.gravity,
            hand_tilt_rad: self.arm.tilt_rad,
            keys: stiffness.map(|stiffness| KeyFactors { stiffness, travel: self.keys.travel }),
            white_width_m: WHITE_PITCH - KEY_GAP_M,
        }
    }

    /// Where the second contact of each key closes, as a share of its travel.
    pub(crate) fn second_contacts(&self, params: &PhysicalParams) -> [f64; KEY_COUNT] {
        let threshold = params.world(WorldRow::KeyThreshold);
        self.key_factors(Purpose::Threshold, self.keys.threshold_spread).map(|factor| factor * threshold)
    }

    /// How one number differs from key to key: factors within `spread` of 1.
    fn key_factors(&self, purpose: Purpose, spread: f64) -> [f64; KEY_COUNT] {
        std::array::from_fn(|key| 1.0 + spread * signed_share(self.seed, purpose, key))
    }

    /// Whether a twin can have it; links and keyboard are checked where they are made.
    pub(crate) fn check(&self) -> Result<(), TwinParamsError> {
        let params = self.params()?;
        self.world.check_ranges()?;
        self.hand.check_ranges()?;
        self.arm.check_ranges()?;
        self.keys.check_ranges()?;
        let (keys, threshold) = (&self.keys, params.world(WorldRow::KeyThreshold));
        let highest_spread = (1.0 - CONTACT_GAP) / threshold - 1.0;
        let latest_first = threshold * (1.0 - keys.threshold_spread) - CONTACT_GAP;
        check_range("keys.threshold_spread", keys.threshold_spread, ..=highest_spread)?;
        check_range("keys.first_contact", keys.first_contact, ..=latest_first)?;
        check_range("keys.softest_secs", keys.softest_secs, 2.0 * keys.loudest_secs..)?;
        Ok(self.faults.iter().try_for_each(OrderedFault::check)?)
    }
}

/// What a draw is for, so that draws for different things do not resemble each other.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    Threshold = 1,
    Stiffness = 2,
    KinematicError = 3,
    /// A number of a parameter set that is drawn.
    TwinParams = 4,
}

/// A number in −1 … 1 that depends on nothing else than these three (SplitMix64 and its constants).
pub(crate) fn signed_share(seed: u64, purpose: Purpose, number: usize) -> f64 {
    let counter = ((purpose as u64) << 32) | number as u64;
    let mut bits = seed.wrapping_mul(0xD134_2543_DE82_EF95).wrapping_add(counter);
    bits = bits.wrapping_add(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^= bits >> 31;
    // The upper 53 bits are what a double holds.
    (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(seed: u64) -> HiddenParams {
        let keys = KeyParams { threshold_spread: 0.2, stiffness_spread: 0.3, ..KeyParams::default() };
        HiddenParams { seed, keys, ..HiddenParams::default() }
    }

    #[test]
    fn keys_differ_by_seed_and_within_their_spread() {
        let params = PhysicalParams::default();
        let [one, same, other] = [spread(1), spread(1), spread(2)];
        assert_eq!(one.second_contacts(&params), same.second_contacts(&params));
        assert_eq!(one.options().keys, same.options().keys);
        assert_ne!(one.second_contacts(&params), other.second_contacts(&params));
        assert_ne!(one.options().keys, other.options().keys);
        let contacts = one.second_contacts(&params);
        let (low, high) =
            contacts.iter().fold((1.0, 0.0), |(low, high): (f64, f64), at| (low.min(*at), high.max(*at)));
        // A fifth of a half, and with 49 keys nearly all of it is used.
        assert!((0.4..0.42).contains(&low) && (0.58..=0.6).contains(&high), "{low} … {high}");
        let mean = contacts.iter().sum::<f64>() / KEY_COUNT as f64;
        assert!((mean - 0.5).abs() < 0.02, "{mean}");
        // Thresholds and springs have draws of their own.
        let share = |key: usize| (contacts[key] / 0.5 - 1.0) / 0.2;
        assert!(
            (0..KEY_COUNT)
                .any(|key| (one.options().keys[key].stiffness - 1.0 - 0.3 * share(key)).abs() > 0.1)
        );
    }

    #[test]
    fn without_spread_all_keys_are_alike() {
        let hidden = HiddenParams { seed: 9, ..HiddenParams::default() };
        assert_eq!(hidden.second_contacts(&PhysicalParams::default()), [0.5; KEY_COUNT]);
        assert_eq!(hidden.options().keys, ModelOptions::default().keys);
    }
}
