//! The tables of physical parameters: paths, units, defaults with their sources, ranges.
//!
//! Sources: *RoboPianist* is github.com/google-research/robopianist;
//! *lasr-lab/learning-to-play-piano* on GitHub is the code that the paper's authors published with
//! its first version (arXiv 2503.15481v1).

use crate::hand::{DRIVEN_JOINTS, JOINT_NAMES, JOINTS_PER_FINGER, RAIL};

/// One row of a table: what is known about a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParamRow {
    /// Last part of the path.
    pub name: &'static str,
    /// Unit; for a joint row that of a finger joint (the rail has N and m where a finger has N·m
    /// and rad).
    pub unit: &'static str,
    /// Default; for a joint row that of a finger joint.
    pub default: f64,
    /// Default for the rail; equal to `default` in rows of the world.
    pub rail_default: f64,
    /// Range that any value must lie in.
    pub range: [f64; 2],
    /// What the number is, and the source of its default.
    pub doc: &'static str,
}

macro_rules! rows {
    ($(#[$doc:meta])* $name:ident, $table:ident { $($(#[$vdoc:meta])* $variant:ident = $row:expr,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum $name { $($(#[$vdoc])* $variant,)* }
        const $table: &[ParamRow] = &[$($row,)*];
        impl $name {
            /// Every row of the table.
            pub const ALL: &'static [$name] = &[$($name::$variant,)*];
            /// Its row.
            pub fn row(self) -> &'static ParamRow { &$table[self as usize] }
        }
    };
}

const fn row(
    name: &'static str,
    unit: &'static str,
    default: f64,
    range: [f64; 2],
    doc: &'static str,
) -> ParamRow {
    ParamRow { name, unit, default, rail_default: default, range, doc }
}

const fn joint(
    name: &'static str,
    unit: &'static str,
    default: f64,
    rail_default: f64,
    range: [f64; 2],
    doc: &'static str,
) -> ParamRow {
    ParamRow { name, unit, default, rail_default, range, doc }
}

rows! {
    /// Parameters of the keyboard and of the hand as a whole.
    WorldRow, WORLD_ROWS {
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
            "fraction of a key's travel at which it counts as pressed; the paper's authors randomise it from 0.1 to 0.9"),
        /// How far a key rises before it is silent.
        KeyHysteresis = row("key.hysteresis", "fraction of the threshold", 0.0, [0.0, 0.95],
            "how far a key that sounds must rise above its threshold until it is silent: real keys are silent when their first contact \
             opens, and the paper's simulator has one threshold"),
        /// Spring of the keys.
        KeyStiffness = row("key.stiffness", "N·m/rad", 1.0, [0.05, 5.0],
            "spring of every key about its hinge; as lasr-lab/learning-to-play-piano without randomisation"),
        /// Force of the keys at rest.
        KeyPreload = row("key.preload", "N", 0.0, [0.0, 2.0],
            "force at the front of every key that moves it from rest: its spring presses it against its upper stop, which then is at \
             rest; the paper's simulator has none"),
        /// Damping of the keys.
        KeyDamping = row("key.damping", "N·m·s/rad", 0.05, [0.001, 0.5],
            "damping of every key about its hinge; as RoboPianist's piano_constants.py"),
        /// Armature of the keys.
        KeyArmature = row("key.armature", "kg·m²", 0.001, [1e-5, 0.01],
            "inertia added to every key's hinge; as RoboPianist's piano_constants.py"),
        /// Sliding friction of keys.
        KeyFriction = row("key.friction", "1", 1.0, [0.05, 3.0],
            "sliding friction between keys and fingertips; as lasr-lab/learning-to-play-piano without randomisation"),
        /// Lateral place of the hand at the start.
        HandStart = row("hand.start", "m", 0.0, [-0.336, 0.336],
            "offset of the hand's starting place along the rail"),
    }
}

rows! {
    /// Parameters of every driven joint.
    JointRow, JOINT_ROWS {
        /// Proportional gain.
        Stiffness = joint("stiffness", "N·m/rad", 3.0, 20_000.0, [0.0, 50_000.0],
            "proportional gain of the joint's controller; fingers: 3600/1200 as HORA deploys on the v4 hand (github.com/HaozhiQi/hora, \
             issue 7); rail: our choice, stiff like a position-controlled arm"),
        /// Derivative gain.
        Damping = joint("damping", "N·m·s/rad", 0.1, 700.0, [0.0, 10_000.0],
            "derivative gain of the joint's controller; fingers: as MuJoCo Menagerie's wonik_allegro and HORA's simulation; rail: our \
             choice"),
        /// Passive damping in the world.
        Viscosity = joint("viscosity", "N·m·s/rad", 0.01, 20.0, [0.0, 10_000.0],
            "viscous friction of the joint itself; our choice until identified"),
        /// Dry friction in the world.
        Friction = joint("friction", "N·m", 0.0, 0.0, [0.0, 50.0],
            "dry friction of the joint itself; zero until identified, since no measurement is published"),
        /// Rotor inertia.
        Armature = joint("armature", "kg·m²", 0.0005, 5.0, [1e-5, 50.0],
            "inertia of the drive as seen at the joint; our estimate for a high gear ratio; rail: that of the arm"),
        /// Torque limit. Defaults differ from joint to joint of a finger: `FINGER_TORQUE_LIMITS`.
        TorqueLimit = joint("torque_limit", "N·m", 0.3125, 110.0, [0.01, 500.0],
            "largest torque; fingers: the clamps of Wonik's driver (simlabrobotics/allegro_hand_ros_v4); rail: our choice"),
        /// Low-pass time constant.
        LowPass = joint("low_pass", "s", 0.01, 0.01, [0.0, 1.0],
            "time constant of the first-order low-pass on the joint's target"),
        /// Velocity limit.
        VelocityLimit = joint("velocity_limit", "rad/s", 12.0, 0.76, [0.01, 50.0],
            "largest velocity of the reference trajectory; fingers: below the highest speed that simlabrobotics/allegro_hand_ros_v4 \
             names, 13 rad/s; rail: below the xArm7's 1 m/s"),
        /// Acceleration limit.
        AccelerationLimit = joint("acceleration_limit", "rad/s²", 1900.0, 7.1, [0.1, 5_000.0],
            "largest acceleration of the reference trajectory; fingers: above what the torque limit allows, which is what bounds \
             them; rail: the xArm7's joint limit of 1145 °/s² (xarm_ros2) over the 2.57 rad that joint 4 turns a metre, with a \
             margin"),
        /// Jerk limit.
        JerkLimit = joint("jerk_limit", "rad/s³", 380_000.0, 1425.0, [1.0, 1e6],
            "largest jerk of the reference trajectory: the acceleration limit within one physics step; our choice until identified"),
        /// Delay.
        Delay = joint("delay", "s", 0.0, 0.0, [0.0, 0.1],
            "time from a target to its effect, in addition to the low-pass"),
        /// Encoder bias.
        EncoderBias = joint("encoder_bias", "rad", 0.0, 0.0, [-0.2, 0.2],
            "encoder reading at the joint's true zero"),
        /// Dry friction at rest.
        FrictionAtRest = joint("friction_at_rest", "of the friction", 1.0, 1.0, [1.0, 5.0],
            "dry friction at rest as a multiple of `friction`, which a joint beyond 0.05 rad/s (rail: m/s) has; 1, none more, until \
             identified"),
        /// Dead band of the motor.
        DeadBand = joint("dead_band", "N·m", 0.0, 0.0, [0.0, 50.0],
            "torque of the controller that moves nothing, and that is missing from a larger one; zero until identified"),
        /// Steady load.
        Load = joint("load", "N·m", 0.0, 0.0, [-0.2, 0.2],
            "torque that acts on the joint all the time, such as the part of a finger's weight that its drive does not hold; zero \
             until identified"),
    }
}

/// Torque limits of the four joints of a finger, N·m: 375, 675, 450 and 285 of 1200 PWM counts, the
/// clamps of simlabrobotics/allegro_hand_ros_v4.
const FINGER_TORQUE_LIMITS: [f64; JOINTS_PER_FINGER] = [0.3125, 0.5625, 0.375, 0.2375];

/// One parameter: a row of the world, or of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParamId {
    /// A parameter of the world.
    World(WorldRow),
    /// A parameter of the joint with this index.
    Joint(JointRow, usize),
}

impl ParamId {
    /// Every parameter, in a fixed order: the world's, then row by row those of all joints.
    pub fn all() -> impl Iterator<Item = ParamId> {
        let joints =
            JointRow::ALL.iter().flat_map(|row| (0..DRIVEN_JOINTS).map(|joint| ParamId::Joint(*row, joint)));
        WorldRow::ALL.iter().map(|row| ParamId::World(*row)).chain(joints)
    }

    /// The parameters that `path` names: one, or several where it is `joint.all.<name>` or
    /// `joint.fingers.<name>`.
    ///
    /// # Errors
    /// If no parameter has this path.
    pub fn named(path: &str) -> Result<Vec<ParamId>, ParamError> {
        let unknown = || ParamError::Unknown(path.to_string());
        if let Some(row) = WorldRow::ALL.iter().find(|row| row.row().name == path) {
            return Ok(vec![ParamId::World(*row)]);
        }
        let (who, name) =
            path.strip_prefix("joint.").and_then(|rest| rest.split_once('.')).ok_or_else(unknown)?;
        let row = JointRow::ALL.iter().find(|row| row.row().name == name).ok_or_else(unknown)?;
        let is_named = |joint: &usize| match who {
            "all" => true,
            "fingers" => *joint != RAIL,
            name => JOINT_NAMES[*joint] == name,
        };
        let slots: Vec<_> =
            (0..DRIVEN_JOINTS).filter(is_named).map(|joint| ParamId::Joint(*row, joint)).collect();
        if slots.is_empty() { Err(unknown()) } else { Ok(slots) }
    }

    /// Its path, such as `key.stiffness` or `joint.index_1.damping`.
    pub fn path(self) -> String {
        match self {
            ParamId::World(row) => row.row().name.to_string(),
            ParamId::Joint(row, joint) => format!("joint.{}.{}", JOINT_NAMES[joint], row.row().name),
        }
    }

    /// Its row.
    pub fn row(self) -> &'static ParamRow {
        match self {
            ParamId::World(row) => row.row(),
            ParamId::Joint(row, _) => row.row(),
        }
    }

    /// Its unit. The table has those of a finger joint.
    pub fn unit(self) -> &'static str {
        match (self, self.row().unit) {
            (ParamId::Joint(_, RAIL), "N·m/rad") => "N/m",
            (ParamId::Joint(_, RAIL), "N·m·s/rad") => "N·s/m",
            (ParamId::Joint(_, RAIL), "N·m") => "N",
            (ParamId::Joint(_, RAIL), "kg·m²") => "kg",
            (ParamId::Joint(_, RAIL), "rad") => "m",
            (ParamId::Joint(_, RAIL), "rad/s") => "m/s",
            (ParamId::Joint(_, RAIL), "rad/s²") => "m/s²",
            (ParamId::Joint(_, RAIL), "rad/s³") => "m/s³",
            (_, unit) => unit,
        }
    }

    /// Its default.
    pub fn default_value(self) -> f64 {
        match self {
            ParamId::Joint(row, RAIL) => row.row().rail_default,
            ParamId::Joint(JointRow::TorqueLimit, joint) => FINGER_TORQUE_LIMITS[joint % JOINTS_PER_FINGER],
            _ => self.row().default,
        }
    }

    /// # Errors
    /// If `value` is not in the row's range; the message names `path`.
    pub(super) fn check(self, value: f64, path: impl FnOnce() -> String) -> Result<(), ParamError> {
        let (ParamRow { range: [low, high], .. }, unit) = (*self.row(), self.unit());
        if (low..=high).contains(&value) {
            return Ok(());
        }
        Err(ParamError::OutOfRange { path: path(), value, low, high, unit })
    }
}

/// A path or a value that [`PhysicalParams`](super::PhysicalParams) refuses.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParamError {
    /// No row has this path.
    #[error("no physical parameter is called `{path}`{near}; `etude model params` lists them", path = .0, near = meant(.0))]
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

/// Rows that a mistyped path may mean.
fn meant(path: &str) -> String {
    let paths: Vec<String> = ParamId::all().map(ParamId::path).collect();
    etude_music::did_you_mean(path, paths.iter().map(String::as_str))
}
