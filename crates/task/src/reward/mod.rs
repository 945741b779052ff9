//! The reward: a table of named terms, each a function of one control step, summed by weight.
//!
//! To add a term: one function and one row in [`TERMS`]. Configuration and metrics follow from the row.
//!
//! Sources: the paper describes the terms in words, with a number for the collision term only. Key press, energy and tolerance are
//! those of RoboPianist (github.com/google-research/robopianist, `suite/tasks/piano_with_shadow_hands.py`); the assignment of fingers
//! by optimal transport is that of RP1M (arXiv 2408.11048); the appendix's terms are those of lasr-lab/learning-to-play-piano on
//! GitHub (`robopianist/suite/tasks/piano_with_hands.py`). `wrong_travel` and the terms of a fingering are ours (RoboPianist rewards
//! a fingering that people have written down). Other weights are our choice.

mod appendix;

use std::collections::BTreeMap;
use std::ops::Range;

use etude_music::{KEY_COUNT, KeySet};
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::{DRIVEN_JOINTS, FINGERS, RAIL, StepOutcome, World};

use self::appendix::{graded_key_press, hand_position, sliding};
use crate::fingering::comb::beyond_target;
use crate::fingering::{Goal, Goals};
use crate::{ACTION_LEN, TaskError, assign};

/// What the terms are computed from: the world after a control step, the action and the due keys.
pub struct Moment<'a> {
    /// The world after the step.
    pub world: &'a World,
    /// Keys that were due in the step.
    pub due: KeySet,
    /// Those of them to hold: a fingering leaves some keys early, to be on time at the next ones.
    pub held: KeySet,
    /// Keys that sounded before the step.
    pub pressed_before: KeySet,
    /// Power and collisions of the step.
    pub outcome: StepOutcome,
    /// The joints' targets in the step: encoder readings, rad, the rail in m.
    pub targets: &'a [f64; DRIVEN_JOINTS],
    /// The action of the step.
    pub action: &'a [f32; ACTION_LEN],
    /// The action of the previous step; in the first step, the one whose targets are the starting pose, as far
    /// as the range allows.
    pub previous_action: &'a [f32; ACTION_LEN],
    /// The goals of the fingers in the step; none without a fingering.
    pub goals: Goals,
}

/// One named term of the reward.
pub struct Term {
    /// Name in configurations and metrics.
    pub name: &'static str,
    /// Default weight: that of the paper's main text, 0 for a term that it does not have (`configs/presets` sets those).
    pub main: f64,
    /// Its value before weighting.
    pub value: fn(&Moment) -> f64,
}

const fn term(name: &'static str, main: f64, value: fn(&Moment) -> f64) -> Term {
    Term { name, main, value }
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
    // Ours, of the preset `fast`.
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
pub const OF_A_FINGERING: [&str; 4] = ["fingering", "velocity", "dynamics", "holding"];

/// Weight of the rail's power relative to that of the fingers, as in lasr-lab/learning-to-play-piano.
const RAIL_SHARE: f64 = 0.003;

/// Minus the power of the fingers and, scaled down, of the rail, W.
fn energy(moment: &Moment) -> f64 {
    -(moment.outcome.finger_power + RAIL_SHARE * moment.outcome.rail_power)
}

/// Minus the mean squared difference to the previous action.
fn action_change(moment: &Moment) -> f64 {
    let squares = moment.action.iter().zip(moment.previous_action).map(|(a, b)| f64::from(a - b).powi(2));
    -squares.sum::<f64>() / ACTION_LEN as f64
}

/// Minus the squared travel of the keys that are not due, summed. A key that sounded before the step counts at its end, any other
/// where it was deepest: a neighbour that a finger brushes is heard, even if it is up again at the end. `key_press` pays nothing for
/// lifting one of two wrong keys, and nothing for lifting a key half; this does.
fn wrong_travel(moment: &Moment) -> f64 {
    let travel = |key| {
        let lifted = moment.pressed_before.contains(key);
        if lifted { moment.world.key_travel(key) } else { moment.world.deepest_travel(key) }
    };
    let wrong = (0..KEY_COUNT).filter(|key| !moment.due.contains(*key));
    -wrong.map(|key| travel(key).clamp(0.0, 1.0).powi(2)).sum::<f64>()
}

/// Half for how far the keys to hold are down, half if no key sounds that is not due (RoboPianist, where all due keys are to hold).
fn key_press(moment: &Moment) -> f64 {
    let held = moment.held;
    let closeness: f64 =
        held.iter().map(|key| tolerance((1.0 - moment.world.key_travel(key)).max(0.0), 0.05, 0.5)).sum();
    let right = if held.is_empty() { 0.0 } else { closeness / held.len() as f64 };
    let clean = moment.world.pressed().difference(moment.due).is_empty();
    0.5 * right + if clean { 0.5 } else { 0.0 }
}

/// Distance up to which a finger gets the full reward, m; as in RP1M.
const OT_BOUND: f64 = 0.01;
/// Further distance at which it gets a tenth, m. The papers give no number. With RoboPianist's 0.1 a finger on the white key next
/// to the right one gets 0.96, with 0.05 it gets 0.85.
const OT_MARGIN: f64 = 0.05;

/// Mean closeness of fingers to the due keys that lateral optimal transport assigns to them.
fn optimal_transport(moment: &Moment) -> f64 {
    let due = moment.due;
    if due.is_empty() {
        return 1.0;
    }
    let tips: [[f64; 3]; FINGERS] = std::array::from_fn(|finger| moment.world.finger_pad(finger));
    let mut targets = [[0.0; 3]; KEY_COUNT];
    let mut lateral = [0.0; KEY_COUNT];
    for (slot, key) in due.iter().enumerate() {
        targets[slot] = moment.world.key_target(key);
        lateral[slot] = targets[slot][1];
    }
    let count = due.len();
    let mut chosen = [None; KEY_COUNT];
    assign(&lateral[..count], &tips.map(|tip| tip[1]), &mut chosen[..count]);
    let closeness: f64 = (0..count)
        .filter_map(|slot| chosen[slot].map(|finger| distance(&tips[finger], &targets[slot])))
        .map(|distance| tolerance(distance, OT_BOUND, OT_MARGIN))
        .sum();
    closeness / count.min(FINGERS) as f64
}

/// Mean closeness of the fingers that should play to the places on their keys; 1 if none should.
fn fingering(moment: &Moment) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (finger, goal) in moment.goals.iter().enumerate() {
        let Some(goal) = goal.filter(|goal| goal.wait_steps == 0) else { continue };
        let mut place = moment.world.key_target(goal.key);
        place[0] += beyond_target(goal.key);
        let away = distance(&moment.world.finger_pad(finger), &place);
        sum += tolerance(away, OT_BOUND, OT_MARGIN);
        count += 1;
    }
    if count == 0 { 1.0 } else { sum / f64::from(count) }
}

/// Minus the mean distance of the finger joints from their targets at the end of the step, rad.
fn tracking(moment: &Moment) -> f64 {
    -off_target(moment, 0..RAIL) / RAIL as f64
}

/// Summed distance of these joints from their targets, rad.
fn off_target(moment: &Moment, joints: Range<usize>) -> f64 {
    let readings = moment.world.joints();
    joints.map(|joint| (moment.targets[joint] - readings[joint]).abs()).sum()
}

/// What a finger earns while it holds its key, rad of distance.
const HELD: f64 = 0.5;

/// For each finger that holds a key which sounded before: [`HELD`] minus the mean distance of its joints from their targets at the end
/// of the step, rad; the mean over the fingers that should play. A target far beyond where the key stops presses at the limit of the
/// torque, and has to come back all the way before the finger can lift. Without [`HELD`] an untrained policy, whose targets are
/// anywhere, is punished for each key that it finds; with more, for letting go of one that it must strike again.
fn holding(moment: &Moment) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (finger, goal) in moment.goals.iter().enumerate() {
        let Some(goal) = goal.filter(|goal| goal.wait_steps == 0) else { continue };
        if moment.pressed_before.contains(goal.key) {
            let off = off_target(moment, finger * JOINTS_PER_FINGER..(finger + 1) * JOINTS_PER_FINGER);
            sum += HELD - off / JOINTS_PER_FINGER as f64;
        }
        count += 1;
    }
    sum / f64::from(count.max(1))
}

/// Difference between force and velocity, as a share of 127, up to which a strike earns everything, and further that at which it earns
/// a tenth: as a bonus for strikes, and where soft and loud are to be learned.
const VELOCITY_BOUND: f64 = 0.05;
const VELOCITY_MARGIN: f64 = 0.4;
const DYNAMICS_MARGIN: f64 = 0.5;

/// For each note that begins in the step and is struck in it, how near the force is to the note's velocity. It is never negative,
/// so that holding a key through pays less than striking it again.
fn velocity(moment: &Moment) -> f64 {
    strikes(moment, VELOCITY_MARGIN, Goal::begins)
}

/// The same for notes that are struck in the step in which they begin or in the next: a soft strike takes longer than a loud one, so that
/// both can begin at the same time.
fn dynamics(moment: &Moment) -> f64 {
    let late = |goal: &Goal| {
        goal.wait_steps == 0 && goal.age_steps == 1 && !moment.pressed_before.contains(goal.key)
    };
    strikes(moment, DYNAMICS_MARGIN, |goal| goal.begins() || late(goal))
}

/// How near the forces of the strikes of some goals' keys are to their velocities, summed.
fn strikes(moment: &Moment, margin: f64, counts: impl Fn(&Goal) -> bool) -> f64 {
    let struck = moment.goals.iter().flatten().filter(|goal| counts(goal)).filter_map(|goal| {
        let strike = moment.world.strikes().iter().find(|strike| strike.key == goal.key)?;
        Some((strike.force - f64::from(goal.velocity)).abs() / 127.0)
    });
    struck.map(|error| tolerance(error, VELOCITY_BOUND, margin)).sum()
}

/// 0.5 if there was no contact other than fingertips on the keyboard during the step, else 0.
fn collision(moment: &Moment) -> f64 {
    if moment.outcome.collided { 0.0 } else { 0.5 }
}

/// Gaussian tolerance as in dm_control's `rewards.tolerance`: 1 up to `bound`, falling to 0.1 at `bound + margin`.
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
    fn tolerance_is_dm_controls() {
        let expected = [(0.05, 1.0), (0.10, 0.977), (0.25, 0.692), (0.50, 0.155), (0.75, 0.011)];
        for (value, want) in expected {
            assert!((tolerance(value, 0.05, 0.5) - want).abs() < 1e-3, "{value}");
        }
    }

    #[test]
    fn every_term_is_finite_and_bounded() {
        let world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let action = [0.5; ACTION_LEN];
        for due in [KeySet::EMPTY, KeySet::from_pitches([60]), KeySet::from_pitches([60, 64, 67, 72])] {
            let moment = Moment {
                world: &world,
                due,
                held: due,
                pressed_before: KeySet::EMPTY,
                outcome: StepOutcome::default(),
                targets: &[0.0; DRIVEN_JOINTS],
                action: &action,
                previous_action: &[0.0; ACTION_LEN],
                goals: Goals::default(),
            };
            for term in TERMS {
                let value = (term.value)(&moment);
                assert!((-10.0..=2.0).contains(&value), "{} = {value}", term.name);
            }
        }
    }

    #[test]
    fn a_still_hand_in_silence_earns_the_most() {
        let world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
        let moment = Moment {
            world: &world,
            due: KeySet::EMPTY,
            held: KeySet::EMPTY,
            pressed_before: KeySet::EMPTY,
            outcome: StepOutcome::default(),
            targets: &[0.0; DRIVEN_JOINTS],
            action: &[0.0; ACTION_LEN],
            previous_action: &[0.0; ACTION_LEN],
            goals: Goals::default(),
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
