//! Domain randomisation: the paper's seven quantities, drawn anew for each episode without rebuilding the model.
//!
//! One intensity `C` in [0, 1] scales every width: at 0 the world keeps its nominal numbers, at 1 a quantity covers
//! its full range (authors' code, fact sheet "simulation and learning" §2.5). Ranges are centred on the nominal value
//! in the sense that they shrink toward it, so an identified simulator is randomised about what was identified.

use etude_stage::params::{Joint, PhysicalParams, World};
use etude_stage::{JOINTS, RAIL};
use rand::RngExt as _;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// How much to randomise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RandomisationConfig {
    /// The paper's C_dr: 0 is none, 1 is all.
    pub intensity: f64,
}

/// Full range of a randomised quantity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Full {
    /// One value for the world, anywhere between the two.
    Between(World, f64, f64),
    /// One value for the world, the nominal one plus or minus this.
    Around(World, f64),
    /// A factor for each finger joint and the rail, one plus or minus this.
    Scaled(Joint, f64),
}

/// The paper's seven quantities ("Domain Randomization") with their ranges at full intensity.
pub const RANDOMISED: &[(&str, Full)] = &[
    ("height of the piano", Full::Around(World::KeyboardHeight, 0.0085)),
    ("starting position of the hand", Full::Around(World::HandStart, 0.33)),
    ("dampening of the joints", Full::Scaled(Joint::Damping, 0.9)),
    ("applied force of each actuator", Full::Scaled(Joint::Stiffness, 0.9)),
    ("threshold of a key", Full::Between(World::KeyThreshold, 0.1, 0.9)),
    ("stiffness of the springs", Full::Between(World::KeyStiffness, 0.3, 2.3)),
    ("friction of keys and fingertips", Full::Between(World::KeyFriction, 0.2, 2.5)),
];

/// Draws worlds about a nominal one.
#[derive(Clone, Debug)]
pub struct Randomisation {
    nominal: PhysicalParams,
    intensity: f64,
}

impl Randomisation {
    /// Worlds about `nominal`.
    pub fn new(nominal: PhysicalParams, config: &RandomisationConfig) -> Self {
        Self { nominal, intensity: config.intensity }
    }

    /// The next world.
    pub fn draw(&self, random: &mut Pcg64) -> PhysicalParams {
        let mut params = self.nominal.clone();
        if self.intensity == 0.0 {
            return params;
        }
        for (_, full) in RANDOMISED {
            match *full {
                Full::Between(quantity, low, high) => {
                    let nominal = params.world(quantity);
                    let end = if random.random_bool(0.5) { low.min(nominal) } else { high.max(nominal) };
                    let share = self.intensity * random.random::<f64>();
                    params.set_world(quantity, nominal + share * (end - nominal));
                }
                Full::Around(quantity, width) => {
                    let share = self.intensity * random.random_range(-1.0..=1.0);
                    params.set_world(quantity, params.world(quantity) + share * width);
                }
                Full::Scaled(quantity, width) => {
                    for joint in 0..JOINTS {
                        let factor = 1.0 + self.intensity * random.random_range(-width..=width);
                        params.set_joint(quantity, joint, params.joint(quantity, joint) * factor);
                    }
                }
            }
        }
        params
    }
}

// The rail is scaled with the fingers: it is the last joint.
const _: () = assert!(RAIL + 1 == JOINTS);

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng as _;

    fn draws(intensity: f64) -> Vec<PhysicalParams> {
        let randomisation = Randomisation::new(PhysicalParams::default(), &RandomisationConfig { intensity });
        let mut random = Pcg64::seed_from_u64(3);
        (0..500).map(|_| randomisation.draw(&mut random)).collect()
    }

    #[test]
    fn no_intensity_is_the_nominal_world() {
        assert!(draws(0.0).iter().all(|p| *p == PhysicalParams::default()));
    }

    #[test]
    fn full_intensity_fills_the_ranges_and_half_stays_inside() {
        for (intensity, low, high) in [(1.0, 0.1, 0.9), (0.5, 0.3, 0.7)] {
            let values: Vec<f64> = draws(intensity).iter().map(|p| p.world(World::KeyThreshold)).collect();
            assert!(values.iter().all(|v| (low..=high).contains(v)));
            let (least, most) = values.iter().fold((1.0f64, 0.0f64), |(l, m), v| (l.min(*v), m.max(*v)));
            assert!(least < low + 0.03 && most > high - 0.03);
        }
    }

    #[test]
    fn exactly_the_papers_seven_quantities_vary() {
        assert_eq!(RANDOMISED.len(), 7);
        let nominal = PhysicalParams::default();
        let changed = |q: &Joint| draws(1.0).iter().any(|p| p.joint(*q, 0) != nominal.joint(*q, 0));
        let joints: Vec<_> = Joint::ALL.iter().filter(|q| changed(q)).collect();
        assert_eq!(joints, [&Joint::Stiffness, &Joint::Damping]);
        let world =
            World::ALL.iter().filter(|q| draws(1.0).iter().any(|p| p.world(**q) != nominal.world(**q)));
        assert_eq!(world.count(), 5);
    }
}
