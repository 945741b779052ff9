//! Two limits within which the physics of a world with drawn parameters is stable.
//!
//! A wide draw of inertias, torques or springs can lead to motion too fast for physics steps of 5
//! ms; MuJoCo then diverges and resets itself in the middle of an episode. The limits are those of
//! `crates/stage/tests/stage/extremes.rs`, whose tests find every combination within them stable: a
//! key's spring well below the stability limit of its integration, and a drive that crosses its
//! joint's range no faster than 0.4 ranges in a step.

use etude_music::CONTROL_HZ;
use etude_stage::geometry::BLACK;
use etude_stage::hand::{FINGERS, LINK_MASSES, PALM_MASS, THUMB_MASS};
use etude_stage::params::{JointRow, PhysicalParams, WorldRow};
use etude_stage::{Actuation, DRIVEN_JOINTS, PHYSICS_STEPS, RAIL, joint_range};

/// Length of a physics step, s.
const STEP_SECS: f64 = 1.0 / (CONTROL_HZ * PHYSICS_STEPS as f64);
/// Share of the stiffness at which the lightest key loses stability. Half, since fingers touch
/// keys.
const KEY_SHARE: f64 = 0.5;
/// Largest speed that a drive alone may reach over its joint's range, ranges per second.
const MAX_SPEED: f64 = 0.4 / STEP_SECS;

/// Clamps drawn parameters to the limits. One whose nominal value is already beyond its limit is
/// not clamped: the configuration asks for it.
pub(super) fn keep(params: &mut PhysicalParams, nominal: &PhysicalParams, actuation: Actuation) {
    if nominal.world(WorldRow::KeyStiffness) <= max_key_stiffness(nominal) {
        let stiffness = params.world(WorldRow::KeyStiffness).min(max_key_stiffness(params));
        params.set_world(WorldRow::KeyStiffness, stiffness);
    }
    let drive = match actuation {
        Actuation::Controlled => JointRow::TorqueLimit,
        Actuation::Position => JointRow::Stiffness,
    };
    for joint in 0..DRIVEN_JOINTS {
        if nominal.joint(drive, joint) <= max_drive_strength(nominal, joint, actuation) {
            let strength = params.joint(drive, joint).min(max_drive_strength(params, joint, actuation));
            params.set_joint(drive, joint, strength);
        }
    }
}

/// Largest stiffness of the keys, N·m/rad: an explicitly integrated spring k on a hinge of inertia
/// I and implicit damping d is stable while dt²·k < 2·(2·I + dt·d), and black keys have the least
/// inertia.
fn max_key_stiffness(params: &PhysicalParams) -> f64 {
    let [length, _, height] = BLACK.size;
    let box_about_its_rear = BLACK.mass * (length * length / 3.0 + height * height / 12.0);
    let inertia = box_about_its_rear + params.world(WorldRow::KeyArmature);
    let unstable =
        2.0 * (2.0 * inertia + STEP_SECS * params.world(WorldRow::KeyDamping)) / (STEP_SECS * STEP_SECS);
    KEY_SHARE * unstable
}

/// Largest torque, or stiffness of a position actuator: over the whole range a constant torque
/// reaches v² = 2·range·torque/inertia, and a spring v² = range²·stiffness/inertia.
fn max_drive_strength(params: &PhysicalParams, joint: usize, actuation: Actuation) -> f64 {
    let [low, high] = joint_range(joint);
    let hand = PALM_MASS + THUMB_MASS + FINGERS as f64 * LINK_MASSES.iter().sum::<f64>();
    let inertia = params.joint(JointRow::Armature, joint) + if joint == RAIL { hand } else { 0.0 };
    match actuation {
        Actuation::Controlled => inertia * MAX_SPEED.powi(2) * (high - low) / 2.0,
        Actuation::Position => inertia * MAX_SPEED.powi(2),
    }
}
