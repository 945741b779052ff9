//! Turns each joint of the hand a little and back, one after the other: finds a joint whose encoder
//! counts in the wrong direction, or whose torque has no effect, before anything is played.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::status::Phase;
use super::{Refused, Robot};
use crate::allegro::WIRE_JOINTS;
use crate::joints::HAND_DRIVEN_JOINTS;
use crate::pace::Pace;

/// How many joints are turned: those of the fingers and of the thumb.
pub const JOINTS_CHECKED: usize = WIRE_JOINTS;
/// How far a joint is sent, rad. More than 0.07 is a stuck joint if it stands both ways, and more
/// than 0.15 there and back a frozen finger if it repeats its positions ([`super::stuck_joint`],
/// [`super::plausibility`]).
const SENT_RAD: f64 = 0.065;
/// The smallest share of this that it must turn. Friction and backlash keep the rest.
const MIN_SHARE: f64 = 0.4;
/// A joint that has turned so far in the wrong direction is not waited for, rad.
const WRONG_RAD: f64 = 0.03;
/// Time for the joint to come to rest after its set-point.
const SETTLE: Duration = Duration::from_millis(200);
/// Time between two readings of the joint.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// How far a joint was sent, and how far it turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointCheck {
    /// Which joint, as on the wire.
    pub joint: usize,
    /// How far it was sent, rad.
    pub sent_rad: f64,
    /// How far it turned, rad.
    pub turned_rad: f64,
}

impl JointCheck {
    /// What is wrong with the joint, if anything.
    pub fn problem(&self) -> Option<&'static str> {
        let share = self.turned_rad / self.sent_rad;
        if share >= MIN_SHARE {
            None
        } else if share * SENT_RAD <= -WRONG_RAD {
            Some("turned in the wrong direction: its encoder or its motor is connected the wrong way")
        } else {
            Some("did not turn: see what blocks it, and check its motor, its encoder and their cables")
        }
    }
}

/// Turns each joint of the hand a little and back, slowly. The robot must hold still; the arm stays
/// where it is. The fingers' joints turn away from the keys, their rotations at the palm and the
/// thumb's joints towards the middle of their ranges. A rotation that does not turn there turns the
/// other way too: without power a finger may have sunk beside a black key.
///
/// The check of each joint, in the order of the wire: fewer than [`JOINTS_CHECKED`] if one turned
/// in the wrong direction, in which case the robot is stopped, or if the robot was stopped
/// otherwise or `interrupt` was set.
///
/// # Errors
/// If the robot does not hold still.
pub fn check_joints(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    interrupt: &AtomicBool,
) -> Result<Vec<JointCheck>, Refused> {
    let mut done = Vec::with_capacity(JOINTS_CHECKED);
    for joint in 0..JOINTS_CHECKED {
        let turn_rad = clear_turn(robot, joint);
        let (mut check, mut holds) = there_and_back(robot, pace, interrupt, joint, turn_rad)?;
        if holds && rotates(joint) && check.is_some_and(|check| check.problem().is_some()) {
            (check, holds) = there_and_back(robot, pace, interrupt, joint, -turn_rad)?;
        }
        done.extend(check);
        if !holds {
            break;
        }
    }
    Ok(done)
}

/// Turns a joint by `sent_rad` and back: how far it turned, if it had the time, and whether the
/// robot holds still again.
fn there_and_back(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    interrupt: &AtomicBool,
    joint: usize,
    sent_rad: f64,
) -> Result<(Option<JointCheck>, bool), Refused> {
    let (set_rad, from_rad) = (set_point(robot, joint), measured(robot, joint));
    let mut check = JointCheck { joint, sent_rad, turned_rad: 0.0 };
    robot.turn(pace.now(), joint, set_rad + sent_rad)?;
    let arrived = settle(robot, pace, |robot| {
        check.turned_rad = measured(robot, joint) - from_rad;
        check.turned_rad * sent_rad.signum() > -WRONG_RAD && !interrupt.load(Ordering::Relaxed)
    });
    if interrupt.load(Ordering::Relaxed) {
        return Ok((None, false));
    }
    if !arrived {
        let now = pace.now();
        robot.stop(now, pace.wires());
        return Ok((Some(check), false));
    }
    robot.turn(pace.now(), joint, set_rad)?;
    let is_back = settle(robot, pace, |_| !interrupt.load(Ordering::Relaxed));
    Ok((Some(check), is_back))
}

/// Whether a joint moves a fingertip along the keys.
fn rotates(joint: usize) -> bool {
    joint < HAND_DRIVEN_JOINTS && joint.is_multiple_of(4)
}

/// Lets time pass until a move is over and the joint at rest; `false` if the robot was stopped, or
/// as soon as `looks_right` is `false`.
fn settle(robot: &mut Robot, pace: &mut dyn Pace, mut looks_right: impl FnMut(&Robot) -> bool) -> bool {
    let mut until = pace.now() + SETTLE;
    while pace.now() < until {
        let next = pace.now() + POLL_INTERVAL;
        pace.run_until(robot, next);
        if !looks_right(robot) || !robot.is_live() {
            return false;
        }
        if robot.phase() == Phase::Moving {
            until = pace.now() + SETTLE;
        }
    }
    true
}

fn set_point(robot: &Robot, joint: usize) -> f64 {
    robot.set_points.positions().get(joint).copied().unwrap_or_default()
}

fn measured(robot: &Robot, joint: usize) -> f64 {
    robot.hand.positions().get(joint).copied().unwrap_or_default()
}

/// A small turn of a joint within its range: of a finger away from the keys if there is room,
/// otherwise towards the middle.
fn clear_turn(robot: &Robot, joint: usize) -> f64 {
    let [low, high] = robot.config.axes().get(joint).map_or([0.0; 2], |axis| axis.position);
    let at = set_point(robot, joint);
    let bends = joint < HAND_DRIVEN_JOINTS && !rotates(joint);
    let goes_up = bends && at - SENT_RAD >= low;
    if goes_up || at > (low + high) / 2.0 { -SENT_RAD } else { SENT_RAD }
}
