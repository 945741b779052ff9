//! The reward: a table of named terms, each a function of one control step, summed by weight.
//!
//! To add a term: one function and one row in [`TERMS`]. Configuration and metrics follow from the
//! row.
//!
//! Sources: the paper describes the terms in words, with a number for the collision term only. Key
//! press, energy and tolerance are those of RoboPianist (github.com/google-research/robopianist,
//! `suite/tasks/piano_with_shadow_hands.py`); the assignment of fingers by optimal transport is
//! that of RP1M (arXiv 2408.11048); the appendix's terms are those of
//! lasr-lab/learning-to-play-piano on GitHub (`robopianist/suite/tasks/piano_with_hands.py`).
//! `wrong_travel` and the terms of a fingering are ours (RoboPianist rewards a fingering that
//! people have written down). Other weights are our choice.

mod appendix;
mod context;
mod of_fingering;
mod terms;

use std::collections::BTreeMap;

use self::appendix::{graded_key_press, hand_position, sliding};
pub use self::context::{StepContext, tolerance};
use self::of_fingering::{dynamics, fingering, holding, velocity};
use self::terms::{action_change, collision, energy, key_press, optimal_transport, tracking, wrong_travel};
use crate::TaskError;

/// One named term of the reward.
pub struct Term {
    /// Name in configurations and metrics.
    pub name: &'static str,
    /// Default weight: that of the paper's main text, 0 for a term that it does not have
    /// (`configs/presets` sets those).
    pub default_weight: f64,
    /// Its value before weighting.
    pub value: fn(&StepContext) -> f64,
}

const fn term(name: &'static str, default_weight: f64, value: fn(&StepContext) -> f64) -> Term {
    Term { name, default_weight, value }
}

/// All terms: name, default weight, function.
pub const TERMS: &[Term] = &[
    term("energy", 0.005, energy),
    term("action_change", 0.02, action_change),
    term("key_press", 1.0, key_press),
    term("optimal_transport", 1.0, optimal_transport),
    term("collision", 1.0, collision),
    // The appendix's.
    term("hand_position", 0.0, hand_position),
    term("graded_key_press", 0.0, graded_key_press),
    term("sliding", 0.0, sliding),
    // Ours.
    term("wrong_travel", 0.0, wrong_travel),
    term("fingering", 0.0, fingering),
    term("velocity", 0.0, velocity),
    term("dynamics", 0.0, dynamics),
    term("holding", 0.0, holding),
    term("tracking", 0.0, tracking),
];

/// Whether there is a term called `name`.
fn is_term(name: &str) -> bool {
    TERMS.iter().any(|term| term.name == name)
}

/// Terms that need [`TaskConfig::fingering`](crate::TaskConfig::fingering).
pub const FINGERING_TERMS: [&str; 4] = ["fingering", "velocity", "dynamics", "holding"];

/// The reward of a configuration: the terms whose weight is not zero.
#[derive(Clone)]
pub struct Reward {
    terms: Vec<(&'static Term, f64)>,
}

impl Reward {
    /// The main text's weights with `overrides` by name.
    ///
    /// # Errors
    /// If a name is unknown or a weight is not finite.
    pub fn new(overrides: &BTreeMap<String, f64>) -> Result<Self, TaskError> {
        for (name, weight) in overrides {
            if !is_term(name) {
                let known: Vec<_> = TERMS.iter().map(|term| term.name).collect();
                let known = known.join(", ");
                return Err(TaskError::Value(format!(
                    "no reward term is called `{name}`; there are: {known}"
                )));
            }
            if !weight.is_finite() {
                return Err(TaskError::Value(format!(
                    "the weight of reward term `{name}` is {weight}; it must be a finite number"
                )));
            }
        }
        let weight = |term: &Term| overrides.get(term.name).copied().unwrap_or(term.default_weight);
        let terms = TERMS.iter().map(|term| (term, weight(term))).filter(|(_, w)| *w != 0.0).collect();
        Ok(Self { terms })
    }

    /// Names of the terms, in the order of [`Reward::evaluate`].
    pub fn names(&self) -> impl ExactSizeIterator<Item = &'static str> + '_ {
        self.terms.iter().map(|(term, _)| term.name)
    }

    /// Writes each weighted term and returns their sum.
    pub fn evaluate(&self, context: &StepContext, parts: &mut [f32]) -> f64 {
        let mut sum = 0.0;
        for ((term, weight), part) in self.terms.iter().zip(parts) {
            let value = weight * (term.value)(context);
            *part = value as f32;
            sum += value;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use etude_music::KeySet;
    use etude_stage::{DRIVEN_JOINTS, PhysicalParams, StageConfig, StepOutcome, World};

    use super::*;
    use crate::ACTION_LEN;
    use crate::fingering::Goals;

    #[test]
    fn every_term_is_finite_and_bounded() {
        let world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let action = [0.5; ACTION_LEN];
        for due in [KeySet::EMPTY, KeySet::from_pitches([60]), KeySet::from_pitches([60, 64, 67, 72])] {
            let context = StepContext {
                world: &world,
                due,
                to_hold: due,
                pressed_before: KeySet::EMPTY,
                outcome: StepOutcome::default(),
                targets: &[0.0; DRIVEN_JOINTS],
                action: &action,
                previous_action: &[0.0; ACTION_LEN],
                goals: Goals::default(),
            };
            for term in TERMS {
                let value = (term.value)(&context);
                assert!((-10.0..=2.0).contains(&value), "{} = {value}", term.name);
            }
        }
    }

    #[test]
    fn a_still_hand_in_silence_earns_the_most() {
        let world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let context = StepContext {
            world: &world,
            due: KeySet::EMPTY,
            to_hold: KeySet::EMPTY,
            pressed_before: KeySet::EMPTY,
            outcome: StepOutcome::default(),
            targets: &[0.0; DRIVEN_JOINTS],
            action: &[0.0; ACTION_LEN],
            previous_action: &[0.0; ACTION_LEN],
            goals: Goals::default(),
        };
        let reward = Reward::new(&BTreeMap::new()).unwrap();
        let mut parts = [0.0; 5];
        assert_eq!(reward.evaluate(&context, &mut parts), 0.5 + 1.0 + 0.5);
        let names: Vec<_> = reward.names().collect();
        assert_eq!(names, ["energy", "action_change", "key_press", "optimal_transport", "collision"]);
    }

    #[test]
    fn the_collision_term_can_be_switched_off_and_typos_are_refused() {
        let off = Reward::new(&BTreeMap::from([("collision".to_string(), 0.0)])).unwrap();
        assert_eq!(off.names().len(), 4);
        assert!(Reward::new(&BTreeMap::from([("colision".to_string(), 0.0)])).is_err());
    }
}
