//! Which world is built. [`StageConfig`] is the choice of hand, fences and actuation; numbers that
//! vary are in [`PhysicalParams`](crate::params::PhysicalParams). With [`ModelOptions`] the twin
//! makes its world different from the simulator's.

use etude_music::KEY_COUNT;
use serde::{Deserialize, Serialize};

use crate::controller::Actuation;
use crate::geometry::WHITE;
use crate::hand::Side;

/// Physics steps per control step (design: physics at 200 Hz under control at 20 Hz).
pub const PHYSICS_STEPS: usize = 10;

/// Which world to build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StageConfig {
    /// Which hand plays.
    pub side: Side,
    /// Whether fences stand between the white keys (paper, "Is it beneficial to use fences").
    pub fences: bool,
    /// How the joints are driven.
    pub actuation: Actuation,
    /// Whether the rail brakes where the interlock of a rig would hold it
    /// ([`drag_ways_m`](crate::drag_ways_m)). With controllers only.
    pub interlock: bool,
}

impl Default for StageConfig {
    fn default() -> Self {
        Self { side: Side::default(), fences: true, actuation: Actuation::default(), interlock: false }
    }
}

impl StageConfig {
    /// Length of one physics step, s.
    pub fn physics_step_secs(&self) -> f64 {
        1.0 / (etude_music::CONTROL_HZ * PHYSICS_STEPS as f64)
    }
}

/// How MuJoCo integrates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Integrator {
    /// Semi-implicit Euler, implicit in the joints' damping: the simulator's.
    Euler,
    /// Implicit in velocities.
    ImplicitFast,
}

/// How MuJoCo shapes the friction of contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cone {
    /// The cone itself: the simulator's.
    Elliptic,
    /// A pyramid inside the cone.
    Pyramidal,
}

/// Differences between keys: factors on the numbers of all keys; 1 in the simulator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyFactors {
    /// On the spring.
    pub stiffness: f64,
    /// On the angle of the lower stop.
    pub travel: f64,
}

/// How MuJoCo computes a world, and deviations of its geometry. The default is the simulator's.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelOptions {
    /// Length of one physics step, s.
    pub step_secs: f64,
    /// The integrator.
    pub integrator: Integrator,
    /// The friction cone.
    pub cone: Cone,
    /// Whether the joints' stops are stiff. By default MuJoCo's joints yield at their limits.
    pub firm_stops: bool,
    /// Rotation of the keyboard about its middle, counter-clockwise seen from above, rad.
    pub keyboard_yaw_rad: f64,
    /// Whether the hand has a weight. The keys' springs are at rest where gravity leaves them.
    pub gravity: bool,
    /// How the hand is turned on the arm about its mount, rad: about the axis toward the player
    /// (positive raises the high notes' side), and about the keyboard's length (positive raises the
    /// fingertips).
    pub hand_tilt_rad: [f64; 2],
    /// The keys.
    pub keys: [KeyFactors; KEY_COUNT],
    /// Width of a white key, m; the distance of two keys stays, so that the rest of it is the gap
    /// between them.
    pub white_width_m: f64,
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            step_secs: StageConfig::default().physics_step_secs(),
            integrator: Integrator::Euler,
            cone: Cone::Elliptic,
            firm_stops: false,
            keyboard_yaw_rad: 0.0,
            gravity: false,
            hand_tilt_rad: [0.0; 2],
            keys: [KeyFactors { stiffness: 1.0, travel: 1.0 }; KEY_COUNT],
            white_width_m: WHITE.size[1],
        }
    }
}
