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

use etude_stage::Actuation;
use etude_stage::params::{ParamId, PhysicalParams};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use crate::TaskError;
use spread::{Spread, SpreadKind};
pub use widths::{NamedWidths, Widths};

/// How much to randomise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RandomisationConfig {
    /// The paper's C_dr: 0 is none, 1 is all.
    pub intensity: f64,
    /// What is randomised, and how far at full intensity.
    pub widths: Widths,
}

/// The paper's seven quantities ("Domain Randomization"), the parameters that each stands for, and
/// their ranges at full intensity.
const RANDOMISED: &[(&str, SpreadKind)] = &[
    // Height of the piano.
    ("keyboard.height", SpreadKind::Around(0.0085)),
    // Starting position of the hand.
    ("hand.start", SpreadKind::Around(0.33)),
    // Dampening of the joints.
    ("joint.all.damping", SpreadKind::Scaled(0.9)),
    // Applied force of each actuator.
    ("joint.all.stiffness", SpreadKind::Force(0.9)),
    // Threshold of a key.
    ("key.threshold", SpreadKind::Between(0.1, 0.9)),
    // Stiffness of the springs.
    ("key.stiffness", SpreadKind::Between(0.3, 2.3)),
    // Friction of keys and fingertips.
    ("key.friction", SpreadKind::Between(0.2, 2.5)),
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
            Widths::Named(NamedWidths::Paper) => (papers(), None),
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
    let spreads = RANDOMISED.iter().flat_map(|(path, kind)| {
        let ids = ParamId::named(path).expect("each path is one of a row");
        ids.into_iter().map(|id| Spread { id, kind: *kind })
    });
    spreads.collect()
}
