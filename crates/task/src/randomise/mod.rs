//! Domain randomisation: physical parameters are drawn about their nominal values for each episode,
//! without rebuilding the model.
//!
//! One intensity `C` in [0, 1] scales every width, as in the code of the paper's authors
//! (lasr-lab/learning-to-play-piano): at 0 the world keeps its nominal parameters, at 1 a quantity
//! covers its full range. Ranges shrink toward the nominal value, which is therefore the median of
//! the draws: an identified simulator is randomised about the identified values. [`Widths`] are
//! either those of the paper's seven quantities, or a half-width for each identified parameter.

mod grid;
mod spread;
mod stability;
mod widths;

#[cfg(test)]
mod tests;

use etude_stage::params::{JointRow, ParamId, PhysicalParams, WorldRow};
use etude_stage::{Actuation, DRIVEN_JOINTS, RAIL};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::TaskError;
use spread::{Spread, SpreadKind};
pub use widths::Widths;

/// How much to randomise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RandomisationConfig {
    /// The paper's C_dr: 0 is none, 1 is all.
    pub intensity: f64,
    /// What is randomised, and how far at full intensity.
    pub widths: Widths,
}

/// Full range of a randomised quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FullRange {
    /// One value for the world, anywhere between the two.
    Between(WorldRow, f64, f64),
    /// One value for the world, the nominal one plus or minus this.
    Around(WorldRow, f64),
    /// A factor for each finger joint and the rail, one plus or minus this.
    Scaled(JointRow, f64),
}

/// The paper's seven quantities ("Domain Randomization") with their ranges at full intensity.
pub const RANDOMISED: &[(&str, FullRange)] = &[
    ("height of the piano", FullRange::Around(WorldRow::KeyboardHeight, 0.0085)),
    ("starting position of the hand", FullRange::Around(WorldRow::HandStart, 0.33)),
    ("dampening of the joints", FullRange::Scaled(JointRow::Damping, 0.9)),
    ("applied force of each actuator", FullRange::Scaled(JointRow::Stiffness, 0.9)),
    ("threshold of a key", FullRange::Between(WorldRow::KeyThreshold, 0.1, 0.9)),
    ("stiffness of the springs", FullRange::Between(WorldRow::KeyStiffness, 0.3, 2.3)),
    ("friction of keys and fingertips", FullRange::Between(WorldRow::KeyFriction, 0.2, 2.5)),
];

/// Draws worlds about a nominal one.
#[derive(Clone, Debug)]
pub struct Randomisation {
    nominal: PhysicalParams,
    intensity: f64,
    spreads: Vec<Spread>,
    /// How the joints are driven; `None` if the drawn parameters are not limited to those for which
    /// the physics is stable.
    guarded: Option<Actuation>,
}

impl Randomisation {
    /// Worlds about `nominal`, whose joints are driven by `actuation`.
    ///
    /// # Errors
    /// If a width is negative or not finite, or its path is unknown.
    pub fn new(
        nominal: PhysicalParams,
        config: &RandomisationConfig,
        actuation: Actuation,
    ) -> Result<Self, TaskError> {
        let (spreads, guarded) = match &config.widths {
            // As the authors draw them; tests/task/randomisation.rs checks that the physics stays
            // stable.
            Widths::Paper => (papers(), None),
            Widths::Identified(widths) => (widths::spreads(widths)?, Some(actuation)),
        };
        Ok(Self { nominal, intensity: config.intensity, spreads, guarded })
    }

    /// Whether worlds can differ from the nominal one at all.
    pub fn is_on(&self) -> bool {
        self.intensity > 0.0
    }

    /// Draws the parameters of an episode. At intensity 0 the random stream is not used.
    pub fn draw(&self, random: &mut Pcg64) -> PhysicalParams {
        let mut params = self.nominal.clone();
        if !self.is_on() {
            return params;
        }
        for spread in &self.spreads {
            spread.set(&mut params, self.intensity, spread.draw(random));
        }
        self.guard(params)
    }

    /// Paths of the randomised parameters, in the order in which they are drawn.
    pub fn paths(&self) -> impl Iterator<Item = String> {
        self.spreads.iter().map(|spread| spread.id.path())
    }

    fn guard(&self, mut params: PhysicalParams) -> PhysicalParams {
        if let Some(actuation) = self.guarded {
            stability::keep(&mut params, &self.nominal, actuation);
        }
        params
    }
}

/// The paper's quantities, parameter by parameter.
fn papers() -> Vec<Spread> {
    let world = |quantity, kind| vec![Spread { id: ParamId::World(quantity), kind }];
    let spreads = RANDOMISED.iter().flat_map(|(_, full)| match *full {
        FullRange::Between(quantity, low, high) => world(quantity, SpreadKind::Between(low, high)),
        FullRange::Around(quantity, width) => world(quantity, SpreadKind::Around(width)),
        FullRange::Scaled(quantity, width) => (0..DRIVEN_JOINTS)
            .map(|joint| Spread { id: ParamId::Joint(quantity, joint), kind: SpreadKind::Scaled(width) })
            .collect(),
    });
    spreads.collect()
}

// The rail is scaled with the fingers: it is the last joint.
const _: () = assert!(RAIL + 1 == DRIVEN_JOINTS);
