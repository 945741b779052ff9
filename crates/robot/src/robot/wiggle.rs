//! Turns each joint of the hand a little and back, one after the other: finds a joint whose encoder counts in the wrong direction, or
//! whose torque has no effect, before anything is played.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::axes::RAIL_AXIS;
use super::motion::SlowMove;
use super::plan::Plan;
use super::{Phase, Refused, Robot, driven};
use crate::allegro::JOINTS;
use crate::joints::FINGER_JOINTS;
use crate::pace::Pace;

/// How many joints are turned: those of the fingers and of the thumb.
pub const WIGGLED: usize = JOINTS;
/// How far a joint is sent, rad. More than 0.07 is doubted if a joint stands both ways, and more than 0.15 there and back if a finger repeats
/// its positions ([`super::turning`], [`super::doubt`]).
const SENT_RAD: f64 = 0.065;
/// The least share of this that it must turn. Friction and play keep the rest.
const LEAST_SHARE: f64 = 0.4;
/// A joint that has turned so far in the wrong direction is not waited for, rad.
const WRONG_RAD: f64 = 0.03;
/// Time for the joint to come to rest after its set-point.
const SETTLE: Duration = Duration::from_millis(200);
/// Time between two looks at the joint.
const LOOK: Duration = Duration::from_millis(10);

/// What became of a joint that was sent a little way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wiggled {
    /// Which joint, as on the wire.
    pub joint: usize,
    /// How far it was sent, rad.
    pub sent_rad: f64,
    /// How far it turned, rad.
    pub turned_rad: f64,
}

impl Wiggled {
    /// What is wrong with the joint, if anything.
    pub fn problem(&self) -> Option<&'static str> {
        let share = self.turned_rad / self.sent_rad;
        if share >= LEAST_SHARE {
            None
        } else if share * SENT_RAD <= -WRONG_RAD {
            Some("turned in the wrong direction: its encoder or its motor is connected the wrong way")
        } else {
            Some("did not turn: see what blocks it, and check its motor, its encoder and their cables")
        }
    }
}

/// Turns each joint of the hand a little and back, slowly. The robot must hold still; the arm stays where it is. The fingers' joints turn
/// away from the keys, their rotations at the palm and the thumb's joints towards the middle of their ranges. A rotation that does not turn
/// there turns the other way too: without power a finger may have sunk beside a fence.
///
/// What became of each joint, in the order of the wire: fewer than [`WIGGLED`] if one turned in the wrong direction, in which case the robot
/// is stopped, or if the robot was stopped otherwise or `interrupt` was set.
///
/// # Errors
/// If the robot does not hold still.
pub fn wiggle(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    interrupt: &AtomicBool,
) -> Result<Vec<Wiggled>, Refused> {
    let mut done = Vec::with_capacity(WIGGLED);
    for joint in 0..WIGGLED {
        let way = robot.clear_way(joint);
        let (mut wiggled, mut holds) = there_and_back(robot, pace, interrupt, joint, way)?;
        if holds && rotates(joint) && wiggled.is_some_and(|wiggled| wiggled.problem().is_some()) {
            (wiggled, holds) = there_and_back(robot, pace, interrupt, joint, -way)?;
        }
        done.extend(wiggled);
        if !holds {
            break;
        }
    }
    Ok(done)
}

/// Turns a joint by `sent_rad` and back: how far it turned, if it had the time, and whether the robot holds still again.
fn there_and_back(
    robot: &mut Robot,
    pace: &mut dyn Pace,
    interrupt: &AtomicBool,
    joint: usize,
    sent_rad: f64,
) -> Result<(Option<Wiggled>, bool), Refused> {
    let (set_rad, from_rad) = (robot.set_point(joint), robot.measured(joint));
    let mut wiggled = Wiggled { joint, sent_rad, turned_rad: 0.0 };
    robot.turn(pace.now(), joint, set_rad + sent_rad)?;
    let arrived = settle(robot, pace, |robot| {
        wiggled.turned_rad = robot.measured(joint) - from_rad;
        wiggled.turned_rad * sent_rad.signum() > -WRONG_RAD && !interrupt.load(Ordering::Relaxed)
    });
    if interrupt.load(Ordering::Relaxed) {
        return Ok((None, false));
    }
    if !arrived {
        let now = pace.now();
        robot.stop(now, pace.wires());
        return Ok((Some(wiggled), false));
    }
    robot.turn(pace.now(), joint, set_rad)?;
    let is_back = settle(robot, pace, |_| !interrupt.load(Ordering::Relaxed));
    Ok((Some(wiggled), is_back))
}

/// Whether a joint moves a fingertip along the keys.
fn rotates(joint: usize) -> bool {
    joint < FINGER_JOINTS && joint.is_multiple_of(4)
}

/// Lets time pass until a move is over and the joint at rest; `false` if the robot was stopped, or as soon as `looks_right` is `false`.
fn settle(robot: &mut Robot, pace: &mut dyn Pace, mut looks_right: impl FnMut(&Robot) -> bool) -> bool {
    let mut until = pace.now() + SETTLE;
    while pace.now() < until {
        let next = pace.now() + LOOK;
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

impl Robot {
    /// Turns one joint of the hand (as on the wire) slowly to `to_rad`, or the nearest that its range allows. The other joints and the arm
    /// stay where they are, wherever that is.
    ///
    /// # Errors
    /// If the robot does not hold still, there is no such joint, or the angle is not finite.
    fn turn(&mut self, now: Duration, joint: usize, to_rad: f64) -> Result<(), Refused> {
        self.wants(Phase::Holding)?;
        let mut goal = self.setpoints();
        let axis = self.axes.get(joint).filter(|_| joint < RAIL_AXIS && to_rad.is_finite());
        let Some(axis) = axis else { return Err(Refused::NoPose { joint }) };
        let [low, high] = axis.limits().position;
        if let Some(axis) = goal.get_mut(joint) {
            *axis = to_rad.clamp(low, high);
        }
        self.plan = Some(Plan::new(
            SlowMove::new(now, self.setpoints(), goal, &self.config.axes()),
            None,
            driven(&goal),
        ));
        self.enter(now, Phase::Moving);
        Ok(())
    }

    fn set_point(&self, joint: usize) -> f64 {
        self.axes.get(joint).map_or(0.0, crate::limiter::Axis::position)
    }

    fn measured(&self, joint: usize) -> f64 {
        self.hand.positions().get(joint).copied().unwrap_or_default()
    }

    /// A small turn of a joint within its range: of a finger away from the keys if there is room, otherwise towards the middle.
    fn clear_way(&self, joint: usize) -> f64 {
        let [low, high] = self.axes.get(joint).map_or([0.0; 2], |axis| axis.limits().position);
        let at = self.set_point(joint);
        let bends = joint < FINGER_JOINTS && !rotates(joint);
        let up = bends && at - SENT_RAD >= low;
        if up || at > (low + high) / 2.0 { -SENT_RAD } else { SENT_RAD }
    }
}
