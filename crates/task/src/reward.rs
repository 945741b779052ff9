//! The reward: a table of named terms, each a function of one control step, summed by weight.
//!
//! To add a term: one function and one row in [`TERMS`]. Config, metrics and docs follow from the row. The paper gives
//! formulas in words and a number only for the collision term; forms and defaults are from the fact sheet "simulation
//! and learning" (§1.5, §2.4, §3.1) unless a row says otherwise.

use std::collections::BTreeMap;

use etude_music::{KEYS, KeySet};
use etude_stage::{FINGERS, RAIL, StepOutcome, World};

use crate::{ACTION_LEN, TaskError, assign};

/// What a term may look at: the world after a control step, and what led to it.
pub struct Moment<'a> {
    /// The world after the step.
    pub world: &'a World,
    /// Keys that were due, as shown to the agent before the step.
    pub due: KeySet,
    /// Power and collisions of the step.
    pub outcome: StepOutcome,
    /// The action of the step.
    pub action: &'a [f32; ACTION_LEN],
    /// The action of the step before; in the first step the one that means the starting pose.
    pub previous_action: &'a [f32; ACTION_LEN],
}

/// One named part of the reward.
pub struct Term {
    /// Name in configs and metrics.
    pub name: &'static str,
    /// Weight in the paper's main reward; zero where the main text has no such term.
    pub main: f64,
    /// Weight in the appendix's reward.
    pub appendix: f64,
    /// What it rewards.
    pub doc: &'static str,
    /// Its value before weighting.
    pub value: fn(&Moment) -> f64,
}

/// Every term there is.
pub const TERMS: &[Term] = &[
    Term {
        name: "energy",
        main: 0.005,
        appendix: 0.005,
        doc: "minus the power of the fingers and, scaled down, of the rail, W",
        value: energy,
    },
    Term {
        name: "action_change",
        main: 0.02,
        appendix: 0.0,
        doc: "minus the mean squared difference to the previous action",
        value: action_change,
    },
    Term {
        name: "key_press",
        main: 1.0,
        appendix: 0.0,
        doc: "half for how far the due keys are down, half if no other key sounds (RoboPianist)",
        value: key_press,
    },
    Term {
        name: "optimal_transport",
        main: 1.0,
        appendix: 0.0,
        doc: "closeness of the fingers that lateral optimal transport assigns to the due keys",
        value: optimal_transport,
    },
    Term {
        name: "collision",
        main: 1.0,
        appendix: 0.0,
        doc: "0.5 if nothing but fingertips on the keyboard touched during the step, else 0",
        value: collision,
    },
    Term {
        name: "hand_position",
        main: 0.0,
        appendix: 1.0,
        doc: "closeness of the palm to the middle of the due keys along the keyboard (appendix)",
        value: hand_position,
    },
    Term {
        name: "graded_key_press",
        main: 0.0,
        appendix: 1.0,
        doc: "the appendix's key press: nothing sounding 0, something wrong from 0.5, all right from 1",
        value: graded_key_press,
    },
    Term {
        name: "sliding",
        main: 0.0,
        appendix: 1.0,
        doc: "one minus a penalty for moving the rail while keys are down (appendix)",
        value: sliding,
    },
];

/// Power of the rail counts this much of a finger's (authors' code, §2.4).
const RAIL_SHARE: f64 = 0.003;

fn energy(moment: &Moment) -> f64 {
    -(moment.outcome.finger_power + RAIL_SHARE * moment.outcome.rail_power)
}

fn action_change(moment: &Moment) -> f64 {
    let squares = moment.action.iter().zip(moment.previous_action).map(|(a, b)| f64::from(a - b).powi(2));
    -squares.sum::<f64>() / ACTION_LEN as f64
}

fn key_press(moment: &Moment) -> f64 {
    let due = moment.due;
    let closeness: f64 =
        due.iter().map(|key| tolerance((1.0 - moment.world.key_travel(key)).max(0.0), 0.05, 0.5)).sum();
    let right = if due.is_empty() { 0.0 } else { closeness / due.len() as f64 };
    let clean = moment.world.pressed().difference(due).is_empty();
    0.5 * right + if clean { 0.5 } else { 0.0 }
}

/// Within this distance of its key a finger earns everything, m (§3.1).
const OT_BOUND: f64 = 0.01;
/// This much further away it earns a tenth, m. The papers print no number; RoboPianist's 0.1 pays 0.96 to a finger that
/// stands on the wrong white key next to the right one, this pays 0.85 (docs/results/learning.md has the curves).
const OT_MARGIN: f64 = 0.05;

fn optimal_transport(moment: &Moment) -> f64 {
    let due = moment.due;
    if due.is_empty() {
        return 1.0;
    }
    let tips: [[f64; 3]; FINGERS] = std::array::from_fn(|finger| moment.world.finger_pad(finger));
    let mut targets = [[0.0; 3]; KEYS];
    let mut lateral = [0.0; KEYS];
    for (slot, key) in due.iter().enumerate() {
        targets[slot] = moment.world.key_target(key);
        lateral[slot] = targets[slot][1];
    }
    let count = due.len();
    let mut chosen = [None; KEYS];
    assign(&lateral[..count], &tips.map(|tip| tip[1]), &mut chosen[..count]);
    let closeness: f64 = (0..count)
        .filter_map(|slot| chosen[slot].map(|finger| distance(&tips[finger], &targets[slot])))
        .map(|distance| tolerance(distance, OT_BOUND, OT_MARGIN))
        .sum();
    closeness / count.min(FINGERS) as f64
}

fn collision(moment: &Moment) -> f64 {
    if moment.outcome.collided { 0.0 } else { 0.5 }
}

fn hand_position(moment: &Moment) -> f64 {
    if moment.due.is_empty() {
        return 1.0;
    }
    let sum: f64 = moment.due.iter().map(|key| moment.world.key_target(key)[1]).sum();
    let middle = sum / moment.due.len() as f64;
    tolerance((moment.world.joints_true()[RAIL] - middle).abs(), 0.03, 0.3)
}

fn graded_key_press(moment: &Moment) -> f64 {
    let (due, pressed) = (moment.due, moment.world.pressed());
    let travel = |key| moment.world.key_travel(key).clamp(0.0, 1.0);
    if due.is_empty() {
        let deepest = (0..KEYS).map(travel).fold(0.0, f64::max);
        return if pressed.is_empty() { 1.5 } else { 2.0 * (1.0 - deepest) };
    }
    let mean = due.iter().map(travel).sum::<f64>() / due.len() as f64;
    match (pressed.is_empty(), pressed.difference(due).is_empty()) {
        (true, _) => 0.0,
        (false, false) => 0.5 + 0.5 * mean,
        (false, true) => 1.0 + 0.5 * mean,
    }
}

fn sliding(moment: &Moment) -> f64 {
    let velocity = moment.world.joint_velocities()[RAIL];
    let down = moment.world.pressed();
    let neighbours = down.0 & (down.0 >> 1) != 0;
    let factor = if down.is_empty() {
        0.0
    } else if neighbours {
        2.0
    } else {
        1.0
    };
    1.0 - 3.0 * factor * velocity * velocity
}

/// Gaussian tolerance: 1 up to `bound`, falling to 0.1 at `bound + margin` (dm_control's, §1.5).
pub fn tolerance(value: f64, bound: f64, margin: f64) -> f64 {
    if value <= bound {
        return 1.0;
    }
    let scaled = (value - bound) / margin;
    // exp(−½ s²) with s chosen so that it is a tenth at one margin.
    0.1f64.powf(scaled * scaled)
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// The reward that a config asks for: terms with a weight other than zero.
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
            if !TERMS.iter().any(|term| term.name == name) {
                let known: Vec<_> = TERMS.iter().map(|term| term.name).collect();
                return Err(TaskError::UnknownTerm { name: name.clone(), known: known.join(", ") });
            }
            if !weight.is_finite() {
                return Err(TaskError::BadWeight(name.clone(), *weight));
            }
        }
        let weight = |term: &Term| overrides.get(term.name).copied().unwrap_or(term.main);
        let terms = TERMS.iter().map(|term| (term, weight(term))).filter(|(_, w)| *w != 0.0).collect();
        Ok(Self { terms })
    }

    /// Names of the terms, in the order of [`Reward::evaluate`].
    pub fn names(&self) -> impl ExactSizeIterator<Item = &'static str> + '_ {
        self.terms.iter().map(|(term, _)| term.name)
    }

    /// Writes each weighted term and returns their sum.
    pub fn evaluate(&self, moment: &Moment, parts: &mut [f32]) -> f64 {
        let mut sum = 0.0;
        for ((term, weight), part) in self.terms.iter().zip(parts) {
            let value = weight * (term.value)(moment);
            *part = value as f32;
            sum += value;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etude_stage::{PhysicalParams, StageConfig};

    #[test]
    fn tolerance_is_the_sheets() {
        let expected = [(0.05, 1.0), (0.10, 0.977), (0.25, 0.692), (0.50, 0.155), (0.75, 0.011)];
        for (value, want) in expected {
            assert!((tolerance(value, 0.05, 0.5) - want).abs() < 1e-3, "{value}");
        }
    }

    #[test]
    fn every_term_is_finite_bounded_and_described() {
        let world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let action = [0.5; ACTION_LEN];
        for due in [KeySet::EMPTY, KeySet::from_pitches([60]), KeySet::from_pitches([60, 64, 67, 72])] {
            let moment = Moment {
                world: &world,
                due,
                outcome: StepOutcome::default(),
                action: &action,
                previous_action: &[0.0; ACTION_LEN],
            };
            for term in TERMS {
                let value = (term.value)(&moment);
                assert!((-10.0..=2.0).contains(&value), "{} = {value}", term.name);
                assert!(!term.doc.is_empty());
            }
        }
    }

    #[test]
    fn a_still_hand_in_silence_earns_the_most() {
        let world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let moment = Moment {
            world: &world,
            due: KeySet::EMPTY,
            outcome: StepOutcome::default(),
            action: &[0.0; ACTION_LEN],
            previous_action: &[0.0; ACTION_LEN],
        };
        let reward = Reward::new(&BTreeMap::new()).unwrap();
        let mut parts = [0.0; 5];
        assert_eq!(reward.evaluate(&moment, &mut parts), 0.5 + 1.0 + 0.5);
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
