//! The reward's terms in the course of a recording.

use std::collections::BTreeMap;

use etude_music::KeySet;
use etude_perform::Recording;
use etude_stage::{DRIVEN_JOINTS, StepOutcome, World};
use etude_task::fingering::Goals;
use etude_task::reward::{FINGERING_TERMS, Reward, StepContext};
use etude_task::{ACTION_LEN, TaskConfig};
use serde::Serialize;

/// One term of the reward in the course of the song, weighted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RewardCurve {
    /// Its name.
    pub name: String,
    /// A value a control step.
    pub values: Vec<f64>,
}

/// Terms that need what no robot measures (power, contacts, the rail's speed within a step, how
/// deep a silent key is). No recording has the goals of a fingering.
const NOT_KNOWN: [&str; 5] = ["energy", "collision", "sliding", "wrong_travel", "tracking"];

fn is_unknown(name: &str) -> bool {
    NOT_KNOWN.contains(&name) || FINGERING_TERMS.contains(&name)
}

/// The terms and a note about them: as a simulation has recorded them, or as the measured joints
/// and keys of a robot would have earned them.
pub(super) fn rewards(
    recording: &Recording,
    task: &TaskConfig,
    world: &mut World,
    due: &[KeySet],
    pressed: &[KeySet],
    positions: &[[f64; DRIVEN_JOINTS]],
) -> (Vec<RewardCurve>, Option<String>) {
    if !recording.rewards.is_empty() {
        return (recorded(recording, positions.len()), None);
    }
    if recording.policy.is_empty() || due.is_empty() {
        return (Vec::new(), None);
    }
    let Ok(reward) = Reward::new(&task.reward) else { return (Vec::new(), None) };
    let left_out: Vec<_> = reward.names().filter(|name| is_unknown(name)).collect();
    let mut note = "What the measured joints and keys would have earned in simulation.".to_string();
    if !left_out.is_empty() {
        note += &format!(" Left out, because the recording lacks what they need: {}.", left_out.join(", "));
    }
    (measured(recording, &reward, world, due, pressed, positions), Some(note))
}

/// Rounds to 1e-5 (rad or m), which is less than a pixel and makes the text three times shorter.
pub(super) fn rounded(value: f64) -> f64 {
    (value * 1e5).round() / 1e5
}

fn recorded(recording: &Recording, steps: usize) -> Vec<RewardCurve> {
    let mut curves: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (step, message) in recording.rewards.iter().take(steps).enumerate() {
        for (name, value) in &message.terms {
            let values = curves.entry(name).or_default();
            values.resize(step, 0.0);
            values.push(rounded(*value));
        }
    }
    let curve = |(name, values): (&str, Vec<f64>)| RewardCurve { name: name.to_string(), values };
    curves.into_iter().map(curve).collect()
}

fn measured(
    recording: &Recording,
    reward: &Reward,
    world: &mut World,
    due: &[KeySet],
    pressed: &[KeySet],
    positions: &[[f64; DRIVEN_JOINTS]],
) -> Vec<RewardCurve> {
    let names: Vec<&str> = reward.names().collect();
    let mut curves: Vec<RewardCurve> =
        names.iter().map(|name| RewardCurve { name: (*name).to_string(), values: Vec::new() }).collect();
    let mut parts = vec![0.0; names.len()];
    // Nothing is recorded of the pose before the first step, so its change of action counts as
    // none.
    let mut previous: Option<[f32; ACTION_LEN]> = None;
    for (step, (pressed, joints)) in pressed.iter().zip(positions).enumerate() {
        let action = recording.policy.get(step).and_then(|message| message.action.as_slice().try_into().ok());
        let action = action.or(previous).unwrap_or([0.0; ACTION_LEN]);
        world.pose(joints, *pressed);
        let due = due.get(step).copied().unwrap_or_default();
        let context = StepContext {
            world,
            due,
            to_hold: due,
            pressed_before: KeySet::EMPTY,
            outcome: StepOutcome::default(),
            targets: joints,
            action: &action,
            previous_action: &previous.unwrap_or(action),
            goals: Goals::default(),
        };
        reward.evaluate(&context, &mut parts);
        for (curve, part) in curves.iter_mut().zip(&parts) {
            curve.values.push(rounded(f64::from(*part)));
        }
        previous = Some(action);
    }
    curves.retain(|curve| !is_unknown(&curve.name));
    curves
}
