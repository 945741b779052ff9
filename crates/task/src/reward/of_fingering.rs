//! The terms that need a fingering.

use etude_stage::hand::JOINTS_PER_FINGER;

use super::context::{StepContext, distance, tolerance};
use super::terms::{OT_BOUND, OT_MARGIN, target_error};
use crate::fingering::Goal;
use crate::fingering::hand_reach::beyond_target;

/// Mean closeness of the fingers that should play to the positions on their keys; 1 if none should.
pub(super) fn fingering(context: &StepContext) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (finger, goal) in context.goals.iter().enumerate() {
        let Some(goal) = goal.filter(Goal::sounds) else { continue };
        let mut target = context.world.key_target(goal.key);
        target[0] += beyond_target(goal.key);
        let away = distance(&context.world.finger_pad(finger), &target);
        sum += tolerance(away, OT_BOUND, OT_MARGIN);
        count += 1;
    }
    if count == 0 { 1.0 } else { sum / f64::from(count) }
}

/// Reward of a finger that holds its key exactly on its targets, rad of distance.
const HELD: f64 = 0.5;

/// For each finger that holds a key which sounded before: [`HELD`] minus the mean distance of its
/// joints from their targets at the end of the step, rad; the mean over the fingers that should
/// play. A target far beyond where the key stops presses at the limit of the torque, and has to
/// come back all the way before the finger can lift. Without [`HELD`] an untrained policy, whose
/// targets are anywhere, is penalised for each key that it finds; with more, for letting go of one
/// that it must strike again.
pub(super) fn holding(context: &StepContext) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (finger, goal) in context.goals.iter().enumerate() {
        let Some(goal) = goal.filter(Goal::sounds) else { continue };
        if context.pressed_before.contains(goal.key) {
            let joints = finger * JOINTS_PER_FINGER..(finger + 1) * JOINTS_PER_FINGER;
            sum += HELD - target_error(context, joints) / JOINTS_PER_FINGER as f64;
        }
        count += 1;
    }
    sum / f64::from(count.max(1))
}

/// Difference between the velocity that was played and the written one, as a share of 127, up
/// to which a strike has the full reward, and further that at which it has a tenth: as a bonus for
/// strikes, and where soft and loud are to be learned.
const VELOCITY_BOUND: f64 = 0.05;
const VELOCITY_MARGIN: f64 = 0.4;
const DYNAMICS_MARGIN: f64 = 0.5;

/// For each note that begins in the step and is struck in it, how near the strike's velocity is to
/// the note's. It is never negative, so that holding a key through is rewarded less than striking
/// it again.
pub(super) fn velocity(context: &StepContext) -> f64 {
    strikes(context, VELOCITY_MARGIN, Goal::begins)
}

/// The same for notes that are struck in the step in which they begin or in the next: a soft strike
/// takes longer than a loud one, so that both can begin at the same time.
pub(super) fn dynamics(context: &StepContext) -> f64 {
    let late =
        |goal: &Goal| goal.sounds() && goal.age_steps == 1 && !context.pressed_before.contains(goal.key);
    strikes(context, DYNAMICS_MARGIN, |goal| goal.begins() || late(goal))
}

/// How near the velocities of the strikes of some goals' keys are to those written, summed.
fn strikes(context: &StepContext, margin: f64, counts: impl Fn(&Goal) -> bool) -> f64 {
    let struck = context.goals.iter().flatten().filter(|goal| counts(goal)).filter_map(|goal| {
        let strike = context.world.strikes().iter().find(|strike| strike.key == goal.key)?;
        Some((strike.unrounded_velocity - f64::from(goal.velocity)).abs() / 127.0)
    });
    struck.map(|error| tolerance(error, VELOCITY_BOUND, margin)).sum()
}
