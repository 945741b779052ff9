//! `PhysicalParams`: the single list of physical numbers that may vary.
//!
//! The model is built from it, randomisation draws from it, identification estimates it, configs and reports name its
//! rows. A row is a path such as `key.stiffness` or `joint.index_1.damping`. To add a number: one row in one of the
//! two tables, and its use where the world is built or stepped.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::hand::{FINGER_JOINTS, JOINT_NAMES, JOINTS, RAIL};

/// What a row says about a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Last part of the path.
    pub name: &'static str,
    /// Unit; for a joint row that of a finger joint (the rail has N and m where a finger has N·m and rad).
    pub unit: &'static str,
    /// Default for the world, or for the finger joints.
    pub default: f64,
    /// Default for the rail (joint rows only; equal to `default` otherwise).
    pub rail_default: f64,
    /// Range that any value must lie in.
    pub range: [f64; 2],
    /// What it is and where the default comes from.
    pub doc: &'static str,
}

macro_rules! rows {
    ($(#[$doc:meta])* $name:ident, $table:ident { $($(#[$vdoc:meta])* $variant:ident = $row:expr,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name { $($(#[$vdoc])* $variant,)* }
        const $table: &[Row] = &[$($row,)*];
        impl $name {
            /// Every row of the table.
            pub const ALL: &'static [$name] = &[$($name::$variant,)*];
            /// What the table says about this one.
            pub fn row(self) -> &'static Row { &$table[self as usize] }
        }
    };
}

const fn row(
    name: &'static str,
    unit: &'static str,
    default: f64,
    range: [f64; 2],
    doc: &'static str,
) -> Row {
    Row { name, unit, default, rail_default: default, range, doc }
}

const fn joint(
    name: &'static str,
    unit: &'static str,
    default: f64,
    rail_default: f64,
    range: [f64; 2],
    doc: &'static str,
) -> Row {
    Row { name, unit, default, rail_default, range, doc }
}

rows! {
    /// Numbers of the keyboard and of the hand as a whole.
    World, WORLD_ROWS {
        /// Height of the keyboard.
        KeyboardHeight = row("keyboard.height", "m", 0.0, [-0.03, 0.03],
            "height of the keyboard relative to its nominal place under the hand"),
        /// Place of the keyboard along the rail.
        KeyboardLateral = row("keyboard.lateral", "m", 0.0, [-0.05, 0.05],
            "offset of the keyboard along its length relative to the middle of the rail"),
        /// Place of the keyboard toward the player.
        KeyboardDepth = row("keyboard.depth", "m", 0.0, [-0.03, 0.03],
            "offset of the keyboard toward the player"),
        /// Fraction of travel at which a key sounds.
        KeyThreshold = row("key.threshold", "fraction of travel", 0.5, [0.05, 0.95],
            "fraction of a key's travel at which it counts as pressed; the authors randomise 0.1 to 0.9"),
        /// Spring of the keys.
        KeyStiffness = row("key.stiffness", "N·m/rad", 1.0, [0.05, 5.0],
            "spring of every key about its hinge; the authors' value without randomisation (sheet §2.5)"),
        /// Damping of the keys.
        KeyDamping = row("key.damping", "N·m·s/rad", 0.05, [0.001, 0.5],
            "damping of every key about its hinge (sheet §1.1)"),
        /// Armature of the keys.
        KeyArmature = row("key.armature", "kg·m²", 0.001, [1e-5, 0.01],
            "inertia added to every key's hinge (sheet §1.1)"),
        /// Sliding friction of keys.
        KeyFriction = row("key.friction", "1", 1.0, [0.05, 3.0],
            "sliding friction between keys and fingertips (sheet §2.5)"),
        /// Lateral place of the hand at the start.
        HandStart = row("hand.start", "m", 0.0, [-0.336, 0.336],
            "offset of the hand's starting place along the rail"),
    }
}

rows! {
    /// Numbers that every driven joint has.
    Joint, JOINT_ROWS {
        /// Proportional gain.
        Stiffness = joint("stiffness", "N·m/rad", 3.0, 20_000.0, [0.0, 50_000.0],
            "proportional gain of the joint's controller; fingers as users of the v4 hand set it (sheet §4.4), \
             the rail stiff as a position-controlled arm"),
        /// Derivative gain.
        Damping = joint("damping", "N·m·s/rad", 0.1, 700.0, [0.0, 10_000.0],
            "derivative gain of the joint's controller (sheet §4.4)"),
        /// Passive damping in the world.
        Viscosity = joint("viscosity", "N·m·s/rad", 0.01, 20.0, [0.0, 10_000.0],
            "viscous friction in the joint itself"),
        /// Dry friction in the world.
        Friction = joint("friction", "N·m", 0.0, 0.0, [0.0, 50.0],
            "dry friction in the joint itself; zero until identified, since the real one is not published"),
        /// Rotor inertia.
        Armature = joint("armature", "kg·m²", 0.0005, 5.0, [1e-5, 50.0],
            "inertia of the drive seen at the joint; our reading of a high gear ratio, for the rail that of the arm"),
        /// Torque limit: the same for all joints here; `default_for` refines it per joint.
        TorqueLimit = joint("torque_limit", "N·m", 0.3125, 110.0, [0.01, 500.0],
            "largest torque; fingers as the v4 driver clamps each joint (sheet §4.4)"),
        /// Low-pass time constant.
        LowPass = joint("low_pass", "s", 0.01, 0.01, [0.0, 1.0],
            "time constant of the first-order low-pass on the joint's target"),
        /// Velocity limit.
        VelocityLimit = joint("velocity_limit", "rad/s", 7.0, 0.8, [0.01, 50.0],
            "largest velocity of the reference trajectory (fingers: v4 description; rail: below the arm's 1 m/s)"),
        /// Acceleration limit.
        AccelerationLimit = joint("acceleration_limit", "rad/s²", 300.0, 14.0, [0.1, 5_000.0],
            "largest acceleration of the reference trajectory; fingers: our choice, well inside what the torque allows; \
             rail: what the arm's joint limit of 1145 °/s² gives 0.7 m from the axis (sheet \"hardware\"); along the \
             keyboard it gives about half (docs/results/robot.md)"),
        /// Jerk limit.
        JerkLimit = joint("jerk_limit", "rad/s³", 60_000.0, 2000.0, [1.0, 1e6],
            "largest jerk of the reference trajectory; our choice until identified (the arm's servo mode has no limit of \
             its own); docs/results/learning.md says what slower joints cost"),
        /// Delay.
        Delay = joint("delay", "s", 0.0, 0.0, [0.0, 0.1],
            "time from a target to its effect"),
        /// Encoder bias.
        EncoderBias = joint("encoder_bias", "rad", 0.0, 0.0, [-0.2, 0.2],
            "what the encoder reads at the joint's true zero"),
    }
}

/// Torque limits of the four joints of a finger, N·m: the v4 driver's clamps (fact sheet §4.4).
const FINGER_TORQUE_LIMITS: [f64; FINGER_JOINTS] = [0.3125, 0.5625, 0.375, 0.2375];

fn default_for(quantity: Joint, index: usize) -> f64 {
    match quantity {
        _ if index == RAIL => quantity.row().rail_default,
        Joint::TorqueLimit => FINGER_TORQUE_LIMITS[index % FINGER_JOINTS],
        _ => quantity.row().default,
    }
}

/// The physical numbers of one world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhysicalParams {
    world: [f64; World::ALL.len()],
    joints: [[f64; JOINTS]; Joint::ALL.len()],
}

impl Default for PhysicalParams {
    fn default() -> Self {
        let mut params = Self { world: [0.0; World::ALL.len()], joints: [[0.0; JOINTS]; Joint::ALL.len()] };
        for quantity in World::ALL {
            params.world[*quantity as usize] = quantity.row().default;
        }
        for quantity in Joint::ALL {
            for index in 0..JOINTS {
                params.joints[*quantity as usize][index] = default_for(*quantity, index);
            }
        }
        params
    }
}

/// A path or a value that [`PhysicalParams`] refuses.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParamError {
    /// No row has this path.
    #[error("no physical parameter is called `{0}`; `etude model params` lists them")]
    Unknown(String),
    /// The value is not finite or outside the row's range.
    #[error("{path} = {value} is outside {low} … {high} {unit}")]
    OutOfRange {
        /// Path of the row.
        path: String,
        /// Refused value.
        value: f64,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
        /// Unit.
        unit: &'static str,
    },
}

impl PhysicalParams {
    /// A number of the world.
    pub fn world(&self, quantity: World) -> f64 {
        self.world[quantity as usize]
    }

    /// A number of one joint.
    pub fn joint(&self, quantity: Joint, index: usize) -> f64 {
        self.joints[quantity as usize][index]
    }

    /// Sets a number of the world, clamped to its range.
    pub fn set_world(&mut self, quantity: World, value: f64) {
        let [low, high] = quantity.row().range;
        self.world[quantity as usize] = value.clamp(low, high);
    }

    /// Sets a number of one joint, clamped to its range.
    pub fn set_joint(&mut self, quantity: Joint, index: usize, value: f64) {
        let [low, high] = quantity.row().range;
        self.joints[quantity as usize][index] = value.clamp(low, high);
    }

    /// Whether every number lies in its row's range, as those from elsewhere than [`PhysicalParams::set`] may not.
    ///
    /// # Errors
    /// Names the first one that does not.
    pub fn check(&self) -> Result<(), ParamError> {
        let world = World::ALL.iter().map(|q| self.world(*q));
        let joints = Joint::ALL.iter().flat_map(|q| (0..JOINTS).map(|index| self.joint(*q, index)));
        for ((path, row, _), value) in Self::rows().zip(world.chain(joints)) {
            let [low, high] = row.range;
            if !(low..=high).contains(&value) {
                return Err(ParamError::OutOfRange { path, value, low, high, unit: row.unit });
            }
        }
        Ok(())
    }

    /// Every path with its row and default, in a fixed order.
    pub fn rows() -> impl Iterator<Item = (String, &'static Row, f64)> {
        let world = World::ALL.iter().map(|q| (q.row().name.to_string(), q.row(), q.row().default));
        let joints = Joint::ALL.iter().flat_map(|q| {
            (0..JOINTS).map(move |j| {
                (format!("joint.{}.{}", JOINT_NAMES[j], q.row().name), q.row(), default_for(*q, j))
            })
        });
        world.chain(joints)
    }

    /// The value at `path`.
    pub fn get(&self, path: &str) -> Result<f64, ParamError> {
        let mut copy = self.clone();
        copy.slots(path).map(|slots| *slots[0].0)
    }

    /// Sets the value at `path`; `joint.all.<name>` and `joint.fingers.<name>` set several joints at once.
    pub fn set(&mut self, path: &str, value: f64) -> Result<(), ParamError> {
        for (slot, row) in self.slots(path)? {
            let [low, high] = row.range;
            if !(low..=high).contains(&value) {
                return Err(ParamError::OutOfRange {
                    path: path.to_string(),
                    value,
                    low,
                    high,
                    unit: row.unit,
                });
            }
            *slot = value;
        }
        Ok(())
    }

    /// The same with other values at these paths, set in the order of the paths: a joint's own row comes after that of all
    /// fingers.
    ///
    /// # Errors
    /// Names the first path or value that is refused.
    pub fn with(mut self, rows: &BTreeMap<String, f64>) -> Result<Self, ParamError> {
        rows.iter().try_for_each(|(path, value)| self.set(path, *value))?;
        Ok(self)
    }

    fn slots(&mut self, path: &str) -> Result<Vec<(&mut f64, &'static Row)>, ParamError> {
        let unknown = || ParamError::Unknown(path.to_string());
        if let Some(quantity) = World::ALL.iter().find(|q| q.row().name == path) {
            return Ok(vec![(&mut self.world[*quantity as usize], quantity.row())]);
        }
        let (who, what) = path.strip_prefix("joint.").and_then(|p| p.split_once('.')).ok_or_else(unknown)?;
        let quantity = Joint::ALL.iter().find(|q| q.row().name == what).ok_or_else(unknown)?;
        let chosen = |index: usize| match who {
            "all" => true,
            "fingers" => index != RAIL,
            name => JOINT_NAMES[index] == name,
        };
        let slots: Vec<_> = self.joints[*quantity as usize]
            .iter_mut()
            .enumerate()
            .filter(|(index, _)| chosen(*index))
            .map(|(_, slot)| (slot, quantity.row()))
            .collect();
        if slots.is_empty() { Err(unknown()) } else { Ok(slots) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_can_be_read_and_set_by_its_path() {
        let mut params = PhysicalParams::default();
        let mut seen = std::collections::BTreeSet::new();
        for (path, row, default) in PhysicalParams::rows() {
            assert!(seen.insert(path.clone()), "{path} twice");
            assert_eq!(params.get(&path), Ok(default));
            assert!((row.range[0]..=row.range[1]).contains(&default), "{path}");
            assert!(!row.doc.is_empty() && !row.unit.is_empty());
            params.set(&path, row.range[1]).unwrap();
            assert_eq!(params.get(&path), Ok(row.range[1]));
            assert!(params.set(&path, row.range[1] * 2.0 + 1.0).is_err());
            assert!(params.set(&path, f64::NAN).is_err());
        }
        assert_eq!(seen.len(), World::ALL.len() + JOINTS * Joint::ALL.len());
    }

    #[test]
    fn groups_set_several_joints() {
        let mut params = PhysicalParams::default();
        params.set("joint.fingers.delay", 0.01).unwrap();
        assert_eq!(params.joint(Joint::Delay, 3), 0.01);
        assert_eq!(params.joint(Joint::Delay, RAIL), 0.0);
        assert_eq!(
            params.set("joint.thumb_0.delay", 0.0),
            Err(ParamError::Unknown("joint.thumb_0.delay".into()))
        );
    }
}
