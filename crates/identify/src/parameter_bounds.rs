//! Which parameters a fit estimates, and their bounds.
//!
//! A finger's joint is driven by Étude's own joint loop, whose gains and limits of the duty are
//! known. The torque of a duty is not known: one scale, estimated as the stiffness; damping and
//! torque limit follow it ([`follow_stiffness`]). What slows a joint down beyond that, its
//! viscosity and its motor's back-EMF, acts also when the duty is at its limit.
//!
//! Not estimated: limits of velocity and acceleration, which Étude itself applies to a robot's
//! commands; the rail's armature, which scales with its gains, and its viscosity, which has the
//! same effect as its damping.

use etude_perform::shaping_params;
use etude_robot::allegro::{FULL_SCALE_PWM, JointLoopConfig};
use etude_robot::rig_file::RigConfig;
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::{JointRow, WorldRow};
use etude_stage::{JOINT_NAMES, PhysicalParams, RAIL, StageConfig};

use crate::space::{Parameter, Scale};

/// How a row's bounds and start follow from its value before the fit.
enum Bounds {
    /// The value divided and multiplied by this; on a logarithmic scale.
    Factor(f64),
    /// Between these two, starting at the third where the value is the least.
    Between(f64, f64, f64),
    /// The value plus and minus this.
    Around(f64),
}

use Bounds::{Around, Between, Factor};

/// Parameters of a finger joint. Dry friction: up to a tenth of the joint's torque.
const FINGER: &[(JointRow, Bounds)] = &[
    // The scale of torque, of which motion in the air shows little. Sources for the v4's full
    // torque say 0.7 to 1 N·m.
    (JointRow::Stiffness, Factor(1.5)),
    // A motor of 1 N·m that turns at 4 rad/s without load has 0.25.
    (JointRow::Viscosity, Between(0.0, 0.4, VISCOSITY)),
    (JointRow::Friction, Between(0.0, 0.08, 0.005)),
    // Lubricated metal has up to twice the friction at rest (our estimate).
    (JointRow::FrictionAtRest, Between(1.0, 2.5, 1.4)),
    // Up to 36 of 1200 of a motor of 1 N·m (our estimate).
    (JointRow::DeadBand, Between(0.0, 0.03, 0.005)),
    // A straight finger weighs 0.07 N·m at its root (`etude_robot::allegro::holding_torques`).
    (JointRow::Load, Around(0.05)),
    (JointRow::Armature, Factor(8.0)),
    // Étude's own shaping has it. With wide bounds a fit takes it for what slows the joint down.
    (JointRow::LowPass, Factor(2.5)),
    (JointRow::Delay, Between(0.0, 0.05, 0.0025)),
    // About `JERK_SHARE`.
    (JointRow::JerkLimit, Factor(8.0)),
];

/// Where a finger's jerk limit starts at most, as a share of the jerk that reaches the acceleration
/// limit within one physics step. A fit that began there would not see a slower drive; its bounds
/// reach beyond it.
const JERK_SHARE: f64 = 50.0 / 380.0;

/// Viscosity of a finger joint at the start of a fit, N·m·s/rad: a motor of 1 N·m at full duty that
/// turns at 10 rad/s without load. A fit that begins far below takes the low-pass for what slows
/// the joint down, and stays there.
const VISCOSITY: f64 = 0.1;

/// Parameters of the rail.
const RAIL_ROWS: &[(JointRow, Bounds)] = &[
    (JointRow::Stiffness, Factor(10.0)),
    (JointRow::Damping, Factor(8.0)),
    (JointRow::Friction, Between(0.0, 30.0, 1.0)),
    (JointRow::LowPass, Factor(8.0)),
    (JointRow::Delay, Between(0.0, 0.06, 0.0025)),
    (JointRow::JerkLimit, Factor(8.0)),
];

/// Parameters that only motions with key contact identify, of which slow presses measure most. The
/// bounds of the keyboard's height are errors of its calibration. Its lateral position is not
/// fitted: what is played does not show it. There a finger's encoder biases show only in the height
/// of its tip, so only that of its first bending joint is estimated.
const CONTACT: &[(WorldRow, Bounds)] = &[
    (WorldRow::KeyboardHeight, Around(0.006)),
    (WorldRow::KeyThreshold, Around(0.3)),
    (WorldRow::KeyStiffness, Factor(3.0)),
    (WorldRow::KeyDamping, Factor(4.0)),
];

/// Largest encoder bias, rad.
const MAX_ENCODER_BIAS: f64 = 0.05;
/// Joint of a finger that bends first.
pub const FIRST_BEND: usize = 1;
/// Standard deviation of the prior about a parameter's start, as a share of its range. It decides
/// only what the keys do not identify: height and biases together are one height of a fingertip.
const PRIOR_SHARE: f64 = 0.15;

fn parameter(path: String, range: [f64; 2], before: f64, bounds: &Bounds) -> Parameter {
    let [low, high] = range;
    let within = |value: f64| value.clamp(low, high);
    let factored = |factor: f64, start: f64| {
        Parameter::new(&path, within(start / factor), within(start * factor), start).logarithmic()
    };
    match *bounds {
        Factor(factor) => factored(factor, before),
        Between(least, most, start) => {
            Parameter::new(&path, least, most, if before > least { before.min(most) } else { start })
        }
        Around(width) => Parameter::new(&path, within(before - width), within(before + width), before),
    }
}

/// Parameters of a joint's drive.
pub fn joint_parameters(joint: usize, before: &PhysicalParams) -> Vec<Parameter> {
    let rows = if joint == RAIL { RAIL_ROWS } else { FINGER };
    rows.iter()
        .map(|(quantity, bounds)| {
            let row = quantity.row();
            let path = format!("joint.{}.{}", JOINT_NAMES[joint], row.name);
            let value = before.joint(*quantity, joint);
            let start = match quantity {
                JointRow::JerkLimit if joint != RAIL => value.min(JERK_SHARE * jerk_of_a_step(before, joint)),
                _ => value,
            };
            parameter(path, row.range, start, bounds)
        })
        .collect()
}

/// The jerk with which a joint's reference reaches its acceleration limit within a physics step:
/// higher limits are the same.
fn jerk_of_a_step(params: &PhysicalParams, joint: usize) -> f64 {
    params.joint(JointRow::AccelerationLimit, joint) / StageConfig::default().physics_step_secs()
}

/// Parameters of the keyboard, and the encoder biases of the fingers.
pub fn contact_parameters(before: &PhysicalParams) -> Vec<Parameter> {
    let keyboard = CONTACT.iter().map(|(quantity, bounds)| {
        let row = quantity.row();
        parameter(row.name.to_string(), row.range, before.world(*quantity), bounds)
    });
    let bends = (0..RAIL).filter(|joint| joint % JOINTS_PER_FINGER == FIRST_BEND);
    let biases = bends.map(|joint| {
        let row = JointRow::EncoderBias.row();
        let path = format!("joint.{}.{}", JOINT_NAMES[joint], row.name);
        parameter(path, row.range, before.joint(JointRow::EncoderBias, joint), &Around(MAX_ENCODER_BIAS))
    });
    keyboard.chain(biases).collect()
}

/// Distances of the contact parameters of `params` from their prior about `before`, in standard
/// deviations, one a parameter.
pub fn contact_prior<'a>(
    before: &'a PhysicalParams,
    params: &'a PhysicalParams,
) -> impl Iterator<Item = f64> + 'a {
    contact_parameters(before).into_iter().map(move |parameter| {
        let value = params.get(&parameter.path).unwrap_or(parameter.start);
        let (range, distance) = match parameter.scale {
            Scale::Linear => (parameter.high - parameter.low, value - parameter.start),
            Scale::Logarithmic => ((parameter.high / parameter.low).ln(), (value / parameter.start).ln()),
        };
        distance / (PRIOR_SHARE * range)
    })
}

/// Scales damping and torque limit of the finger joints by the change of their stiffness: all three
/// are duties of Étude's joint loop times the torque at full duty.
pub fn follow_stiffness(before: &PhysicalParams, params: &mut PhysicalParams) {
    for joint in 0..RAIL {
        let share = params.joint(JointRow::Stiffness, joint) / before.joint(JointRow::Stiffness, joint);
        for row in [JointRow::Damping, JointRow::TorqueLimit] {
            params.set_joint(row, joint, before.joint(row, joint) * share);
        }
    }
}

/// The parameters in which a fit to this rig begins: its shaping, and the gains of its joint loop
/// for a motor of 1 N·m at full duty.
pub fn start(rig: &RigConfig) -> PhysicalParams {
    let mut params = shaping_params(&rig.limits);
    let JointLoopConfig { kp, kd, .. } = &rig.joint_loop;
    for joint in 0..RAIL {
        let of_finger = joint % JOINTS_PER_FINGER;
        let duties = [
            (JointRow::Stiffness, kp[of_finger]),
            (JointRow::Damping, kd[of_finger]),
            (JointRow::TorqueLimit, rig.hand.pwm_limit[joint].into()),
        ];
        for (row, duty) in duties {
            params.set_joint(row, joint, duty / f64::from(FULL_SCALE_PWM));
        }
        params.set_joint(JointRow::Viscosity, joint, VISCOSITY);
    }
    params
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Space;

    /// A rig with its own gains and limits of the duty; and the twin's parameter sets are within
    /// the bounds of the scale (docs/twin.md).
    #[test]
    fn a_fit_begins_with_the_rigs_joint_loop() {
        let mut rig = RigConfig::default();
        rig.joint_loop.kp[1] = 1800.0;
        rig.joint_loop.kd[1] = 60.0;
        rig.hand.pwm_limit[5] = 300;
        let params = start(&rig);
        let rows = [JointRow::Stiffness, JointRow::Damping, JointRow::TorqueLimit];
        assert_eq!(rows.map(|row| params.joint(row, 5)), [1.5, 0.05, 0.25]);
        assert_eq!(rows.map(|row| params.joint(row, 4)), [3.0, 0.1, 0.3125]);
        let scale = joint_parameters(4, &params).swap_remove(0);
        assert!(scale.path.ends_with("stiffness") && scale.low <= 0.7 * 3.0 && scale.high >= 3.0);
        let mut stronger = params.clone();
        stronger.set_joint(JointRow::Stiffness, 4, 2.4);
        follow_stiffness(&params, &mut stronger);
        let followed = rows.map(|row| stronger.joint(row, 4) / params.joint(row, 4));
        assert!(followed.iter().all(|share| (share - 0.8).abs() < 1e-12), "{followed:?}");
    }

    /// Else the fit of a quick rig could not find how it shapes commands itself.
    #[test]
    fn the_jerk_limit_of_any_rig_is_within_its_bounds() {
        let mut quick = PhysicalParams::default();
        for (row, most) in [(JointRow::AccelerationLimit, 5000.0), (JointRow::JerkLimit, 1e6)] {
            quick.set_joint(row, 1, most);
        }
        for params in [quick, PhysicalParams::default()] {
            let jerk = joint_parameters(1, &params).pop().unwrap();
            let own = params.joint(JointRow::JerkLimit, 1);
            assert!(jerk.path.ends_with("jerk_limit") && jerk.low < own / 2.0 && jerk.high >= own, "{own}");
        }
    }

    #[test]
    fn every_parameter_is_a_row_with_bounds_around_its_value() {
        let before = PhysicalParams::default();
        let mut all: Vec<Parameter> = (0..=RAIL).flat_map(|joint| joint_parameters(joint, &before)).collect();
        all.extend(contact_parameters(&before));
        let space = Space::new(all).unwrap();
        assert_eq!(space.len(), 12 * FINGER.len() + RAIL_ROWS.len() + CONTACT.len() + 3);
        for (parameter, value) in space.parameters().iter().zip(space.to_physical(&space.start())) {
            let mut params = before.clone();
            for value in [parameter.low, value, parameter.high] {
                params.set(&parameter.path, value).unwrap();
            }
        }
    }
}
