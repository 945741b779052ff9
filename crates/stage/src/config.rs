//! What kind of world is built: which hand, fences or none, which actuation. Numbers that vary are in
//! [`PhysicalParams`](crate::params::PhysicalParams).

use serde::{Deserialize, Serialize};

use crate::controller::Actuation;
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
}

impl Default for StageConfig {
    fn default() -> Self {
        Self { side: Side::default(), fences: true, actuation: Actuation::default() }
    }
}

impl StageConfig {
    /// Length of one physics step, s.
    pub fn physics_step_secs(&self) -> f64 {
        1.0 / (etude_music::CONTROL_HZ * PHYSICS_STEPS as f64)
    }
}
