//! The three ways in which a policy that was trained in simulation plays on a robot (paper,
//! appendix "Execution Modes").

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where the policy's observation comes from, and what the robot follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// The policy observes the simulation, and the robot follows the simulated joints. The robot's
    /// state has no influence, so every run has the same motion.
    JointMirroring,
    /// The policy observes the robot's keys and the simulated joints; the robot follows the
    /// simulated joints.
    Hybrid,
    /// The policy observes the robot, and its targets go to the robot. No simulation runs.
    Real,
}

impl Mode {
    /// Every mode, in the order of the paper.
    pub const ALL: [Self; 3] = [Self::JointMirroring, Self::Hybrid, Self::Real];

    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::JointMirroring => "joint-mirroring",
            Self::Hybrid => "hybrid",
            Self::Real => "real",
        }
    }

    /// Whether a simulation runs beside the robot, which follows its joints.
    pub fn has_simulation(self) -> bool {
        self != Self::Real
    }
}

impl std::fmt::Display for Mode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Mode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        by_name("mode", &Self::ALL, Self::name, text)
    }
}

/// The value that is called `text`; an error lists the names of all.
pub(crate) fn by_name<T: Copy>(
    what: &str,
    all: &[T],
    name: fn(T) -> &'static str,
    text: &str,
) -> Result<T, String> {
    let names = || all.iter().map(|value| name(*value)).collect::<Vec<_>>().join(", ");
    let found = all.iter().copied().find(|value| name(*value) == text);
    found.ok_or_else(|| format!("no {what} is called `{text}`; there are: {}", names()))
}
