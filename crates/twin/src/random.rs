//! Parameter sets that are drawn: `random:SEED` is a rig somewhere between a careful lab's and a
//! worn one, so that nobody tunes to a few files.
//!
//! [`RANGES`] is the one list of what a number may be. The parameter sets `standard` and `worn` lie
//! within it too.

use etude_robot::allegro::FULL_SCALE_PWM;
use etude_stage::params::ParamId;
use etude_stage::{JOINT_NAMES, RAIL};

use crate::error::TwinParamsError;
use crate::hidden_params::{FINGER, HiddenParams, Purpose, signed_share};

/// Begins the name of a parameter set that is drawn.
pub(crate) const RANDOM: &str = "random:";

/// What one number of a parameter set may be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Range {
    /// Where it stands in a file of twin parameters, or the path of a physical number; `J` is each
    /// finger joint on its own.
    pub(crate) path: &'static str,
    /// Its least and its greatest size.
    pub(crate) sizes: [f64; 2],
    /// How many numbers: an array of as many if there are several.
    count: usize,
    /// Whether it may be negative as well.
    either_sign: bool,
}

const fn range(path: &'static str, sizes: [f64; 2]) -> Range {
    Range { path, sizes, count: 1, either_sign: false }
}

const fn either(path: &'static str, sizes: [f64; 2]) -> Range {
    Range { path, sizes, count: 1, either_sign: true }
}

/// The ranges. docs/twin.md has the same rows with units and sources. New rows go to the end: the
/// place in the list is part of a draw.
pub(crate) const RANGES: &[Range] = &[
    range("hand.no_load_rad_per_sec", [7.0, 13.0]),
    Range { count: FINGER, ..range("hand.full_torque_nm", [0.7, 1.0]) },
    range("hand.dead_pwm", [4.0, 15.0]),
    range(FRICTION_AT_REST, [1.3, 1.6]),
    range("hand.motor_backlash_rad", [0.003, 0.012]),
    range("hand.encoder_backlash_rad", [0.001, 0.004]),
    range("hand.filter_secs", [0.001, 0.002]),
    range("hand.noise_counts", [1.0, 3.0]),
    range("joint.fingers.viscosity", [0.01, 0.02]),
    range("joint.fingers.armature", [0.0005, 0.001]),
    either("joint.J.encoder_bias", [0.0, 0.018]),
    range("arm.delay_secs", [0.01, 0.03]),
    range("arm.bandwidth_hz", [4.0, 10.0]),
    range("arm.damping_ratio", [0.5, 0.8]),
    range("arm.stiffness", [25_000.0, 60_000.0]),
    range("arm.damping", [700.0, 1500.0]),
    Range { count: 2, ..either("arm.tilt_rad", [0.002, 0.01]) },
    range("arm.sag_m", [0.0002, 0.001]),
    range("arm.error_m", [0.0001, 0.0005]),
    range("arm.error_period_m", [0.08, 0.25]),
    either("keyboard.lateral", [0.002, 0.003]),
    either("keyboard.depth", [0.002, 0.003]),
    either("keyboard.height", [0.001, 0.002]),
    either("world.keyboard_yaw_rad", [0.002, 0.006]),
    range("key.preload", [0.4, 0.8]),
    range("key.threshold", [0.4, 0.6]),
    range("key.stiffness", [0.7, 1.2]),
    range("key.damping", [0.04, 0.1]),
    range("key.friction", [0.2, 0.5]),
    range("keys.threshold_spread", [0.05, 0.15]),
    range("keys.stiffness_spread", [0.1, 0.25]),
    range("keys.travel", [0.93, 1.07]),
    range("keys.first_contact", [0.24, 0.3]),
    range("keys.loudest_secs", [0.003, 0.006]),
    range("keys.softest_secs", [0.1, 0.2]),
    range("links.can.delay_secs", [0.0003, 0.0005]),
    range("links.can.jitter_secs", [0.0, 0.0007]),
    range("links.can.loss", [0.0, 0.001]),
    range("links.arm.delay_secs", [0.0005, 0.001]),
    range("links.arm.jitter_secs", [0.0005, 0.002]),
    range("links.midi.delay_secs", [0.003, 0.006]),
    range("links.midi.jitter_secs", [0.001, 0.004]),
    DEAD_BAND,
];

/// Dry friction at rest as a multiple of that on the way.
const FRICTION_AT_REST: &str = "joint.fingers.friction_at_rest";
/// Duty below which a joint at rest does not move, in counts of PWM: what its dry friction follows
/// from.
const DEAD_BAND: Range = range("joint.J.dead_band", [20.0, 60.0]);

/// The seed in the name of a parameter set that is drawn; none if it is another name.
///
/// # Errors
/// If it is not a whole number.
pub(crate) fn seed(name: &str) -> Option<Result<u64, TwinParamsError>> {
    let text = name.strip_prefix(RANDOM)?;
    Some(text.parse::<u32>().map(u64::from).map_err(|_| TwinParamsError::Seed(name.to_string())))
}

/// The parameter set that belongs to a seed: the text of its file, and the friction that its dead
/// bands ask for.
pub(crate) fn draw(seed: u64) -> Result<HiddenParams, TwinParamsError> {
    let release =
        if signed_share(seed, Purpose::TwinParams, RELEASE) < 0.0 { "note_off" } else { "zero_velocity" };
    let mut text = format!(
        "name = \"{RANDOM}{seed}\"\nseed = {seed}\nworld.gravity = true\nkeyboard.release = \"{release}\"\n"
    );
    let mut set = |path: &str, value: String| text.extend([path, " = ", &value, "\n"]);
    let mut dead_bands = Vec::new();
    for (row, range) in RANGES.iter().enumerate() {
        let number = |place: usize| range.at(seed, 64 * row + place);
        if range.path == DEAD_BAND.path {
            dead_bands.extend((0..RAIL).map(number));
        } else if range.path.contains(".J.") {
            for (joint, name) in JOINT_NAMES.iter().enumerate().take(RAIL) {
                let path = range.path.replace(".J.", &format!(".{name}."));
                set(&format!("physics.{path:?}"), format!("{:?}", number(joint)));
            }
        } else if ParamId::named(range.path).is_ok() {
            set(&format!("physics.{:?}", range.path), format!("{:?}", number(0)));
        } else if range.count > 1 {
            set(range.path, format!("{:?}", (0..range.count).map(number).collect::<Vec<f64>>()));
        } else if range.path.ends_with("_pwm") || range.path.ends_with("_counts") {
            set(range.path, number(0).round().to_string());
        } else {
            set(range.path, format!("{:?}", number(0)));
        }
    }
    let mut hidden: HiddenParams =
        toml::from_str(&text).map_err(|error| TwinParamsError::Text(error.to_string()))?;
    for (joint, band) in dead_bands.into_iter().enumerate() {
        let friction = hidden.friction_of(joint, band);
        hidden.physics.insert(format!("joint.{}.friction", JOINT_NAMES[joint]), friction);
    }
    hidden.check()?;
    Ok(hidden)
}

/// Number of the draw of how releases are coded.
const RELEASE: usize = usize::MAX >> 32;

impl Range {
    /// A number of the range.
    fn at(&self, seed: u64, number: usize) -> f64 {
        let [low, high] = self.sizes;
        let share = signed_share(seed, Purpose::TwinParams, number);
        if self.either_sign {
            return (low + (high - low) * share.abs()).copysign(share);
        }
        low + (high - low) * (share + 1.0) / 2.0
    }
}

impl HiddenParams {
    /// Dry friction of a finger joint that stands still below a duty of `dead_band`, N·m.
    fn friction_of(&self, joint: usize, dead_band: f64) -> f64 {
        let hand = &self.hand;
        let share = (dead_band - f64::from(hand.dead_pwm)) / f64::from(FULL_SCALE_PWM);
        share * hand.full_torque_nm[joint % FINGER] / self.physics[FRICTION_AT_REST]
    }
}

#[cfg(test)]
impl HiddenParams {
    /// Duty below which a finger joint at rest does not move, in counts of PWM.
    pub(crate) fn dead_band(&self, params: &etude_stage::PhysicalParams, joint: usize) -> f64 {
        let hand = &self.hand;
        use etude_stage::params::JointRow;
        let row = |row| params.joint(row, joint);
        let held = row(JointRow::Friction) * row(JointRow::FrictionAtRest);
        f64::from(hand.dead_pwm) + held / hand.full_torque_nm[joint % FINGER] * f64::from(FULL_SCALE_PWM)
    }
}

#[cfg(test)]
mod tests {
    use toml::Value;

    use super::*;
    use crate::TwinParams;

    /// What a parameter set has in the place of a range.
    fn sizes(numbers: &HiddenParams, range: &Range) -> Vec<f64> {
        let params = numbers.params().unwrap();
        if range.path == DEAD_BAND.path {
            return (0..RAIL).map(|joint| numbers.dead_band(&params, joint)).collect();
        }
        if range.path.contains(".J.") {
            let paths =
                JOINT_NAMES.iter().take(RAIL).map(|name| range.path.replace(".J.", &format!(".{name}.")));
            return paths.map(|path| params.get(&path).unwrap().abs()).collect();
        }
        if let Ok(value) = params.get(range.path) {
            return vec![value.abs()];
        }
        let table = Value::try_from(numbers).unwrap();
        let value = range.path.split('.').fold(&table, |table, key| &table[key]);
        let float =
            |value: &Value| value.as_float().or(value.as_integer().map(|whole| whole as f64)).unwrap();
        match value {
            Value::Array(all) => all.iter().map(|value| float(value).abs()).collect(),
            value => vec![float(value).abs()],
        }
    }

    #[test]
    fn the_standard_the_worn_and_every_drawn_parameter_set_lie_within_the_ranges() {
        let drawn = (0..50).chain([u32::MAX.into()]).map(|seed| draw(seed).unwrap());
        let built_in = ["standard", "worn"].map(|name| TwinParams::load(name).unwrap().hidden);
        for numbers in built_in.into_iter().chain(drawn) {
            assert!(numbers.world.gravity);
            for range in RANGES {
                let [low, high] = range.sizes;
                let sizes = sizes(&numbers, range);
                assert_eq!(sizes.len(), if range.path.contains(".J.") { RAIL } else { range.count });
                let within = |size: &f64| (low - 1e-9..=high + 1e-9).contains(size);
                assert!(sizes.iter().all(within), "{} {}: {sizes:?}", numbers.name, range.path);
            }
            // The lag on a ramp, and how far a motor turns at full duty: what the ranges are for.
            let arm = &numbers.arm;
            let lag = arm.delay_secs + arm.damping_ratio.unwrap() / (std::f64::consts::PI * arm.bandwidth_hz);
            assert!((0.02..=0.1).contains(&lag), "{}: {lag} s", numbers.name);
            let midi = &numbers.links.midi;
            assert!(midi.delay_secs + midi.jitter_secs <= 0.01, "{}", numbers.name);
        }
    }

    #[test]
    fn draws_fill_their_ranges_and_are_their_own() {
        let all: Vec<HiddenParams> = (1..=40).map(|seed| draw(seed).unwrap()).collect();
        for range in RANGES {
            let [low, high] = range.sizes;
            let shares: Vec<f64> =
                all.iter().map(|numbers| (sizes(numbers, range)[0] - low) / (high - low)).collect();
            let mean = shares.iter().sum::<f64>() / shares.len() as f64;
            let spread = shares.iter().fold(0.0, |most: f64, share| most.max((share - mean).abs()));
            assert!((0.3..0.7).contains(&mean) && spread > 0.3, "{}: {shares:?}", range.path);
        }
        let negative = all.iter().filter(|numbers| numbers.world.keyboard_yaw_rad < 0.0).count();
        assert!((10..=30).contains(&negative), "{negative}");
        assert_eq!(draw(7).unwrap(), draw(7).unwrap());
        assert_ne!(all[0].hand.full_torque_nm[0], all[0].hand.full_torque_nm[1]);
    }

    #[test]
    fn a_parameter_set_is_drawn_by_name() {
        let twin_params = TwinParams::load("random:7").unwrap();
        assert_eq!((twin_params.name(), &twin_params.hidden), ("random:7", &draw(7).unwrap()));
        assert_eq!(twin_params.fingerprint(), TwinParams::load("random:7").unwrap().fingerprint());
        assert_ne!(twin_params.fingerprint(), TwinParams::load("random:8").unwrap().fingerprint());
        assert!(TwinParams::load(&format!("random:{}", u32::MAX)).is_ok());
        for name in ["random:", "random:x", "random:-1", "random:1.5", "random:4294967296"] {
            let message = TwinParams::load(name).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("random:7"), "{message}");
        }
        assert!(TwinParams::load("nowhere").unwrap_err().to_string().contains("random:SEED"));
    }

    /// The table in the documents is this list.
    #[test]
    fn the_documented_ranges_are_these() {
        let text = include_str!("../../../docs/twin.md");
        for range in RANGES {
            let [low, high] = range.sizes;
            let row =
                format!("| `{}` | {}{low} … {high} |", range.path, if range.either_sign { "± " } else { "" });
            assert!(text.contains(&row), "docs/twin.md has no `{row}`");
        }
        let rows = text.lines().skip_while(|line| !line.starts_with("| number | range |")).skip(2);
        assert_eq!(rows.take_while(|line| line.starts_with('|')).count(), RANGES.len());
    }
}
