//! What a robot can be asked to do once it holds still.

use std::time::Duration;

use super::axes::{AXES, RAIL_AXIS, all_axes, driven};
use super::following_error::farthest;
use super::homing_plan::{HomingPlan, ViaPoint};
use super::slow_move::SlowMove;
use super::{Phase, Refused, Robot};
use crate::joints::{DRIVEN, HAND_DRIVEN_JOINTS, RAIL, to_wire};

/// Fingers straight ahead, clear of the keys.
const CLEAR_FINGERS: [f64; HAND_DRIVEN_JOINTS] = [0.0; HAND_DRIVEN_JOINTS];

impl Robot {
    /// Brings the robot slowly to a pose, from wherever it is: fingers straight, the arm over its
    /// home and from above to the middle of the keyboard, then fingers and rail to `goal`, or the
    /// nearest that their ranges allow. If it is at the keyboard and the fingers are near the goal,
    /// only fingers and rail move; if they are far from it, the arm goes straight up before they
    /// move, which frees a finger that is caught. From beside the keys it goes straight up too.
    /// Otherwise it moves only when the fingers are straight.
    ///
    /// # Errors
    /// If the robot does not hold still, the goal is not finite, or the path would leave the arm's
    /// box.
    pub fn home(&mut self, now: Duration, goal: &[f64; DRIVEN]) -> Result<(), Refused> {
        let far = farthest(&self.hand.positions(), &self.within_ranges(goal)).1;
        let is_near = far <= self.config.limits.start_finger_rad;
        let via = (!self.rail_arm.is_on_path() || !is_near).then(|| self.rail_arm.first_via());
        via.map_or(Ok(()), |via| self.rail_arm.check_path(&self.config.arm, via))?;
        self.begin_slow_move(now, via, goal)
    }

    /// Brings fingers and rail slowly to a pose, or the nearest that their ranges allow.
    ///
    /// # Errors
    /// If the robot does not hold still at the keyboard, or the goal holds a number that is not
    /// finite.
    pub fn approach(&mut self, now: Duration, goal: &[f64; DRIVEN]) -> Result<(), Refused> {
        if !self.rail_arm.is_on_path() {
            let remedy = "not at the keyboard: `etude robot home` brings it there";
            return Err(Refused::Phase { phase: self.phase().name(), remedy });
        }
        self.begin_slow_move(now, None, goal)
    }

    /// Turns one joint of the hand (as on the wire) slowly to `to_rad`, or the nearest that its
    /// range allows. The other joints and the arm stay where they are, wherever that is.
    pub(super) fn turn(&mut self, now: Duration, joint: usize, to_rad: f64) -> Result<(), Refused> {
        self.status.require(Phase::Holding)?;
        let mut goal = self.set_points.positions();
        match goal.get_mut(joint).filter(|_| joint < RAIL_AXIS && to_rad.is_finite()) {
            Some(axis) => *axis = to_rad,
            None => return Err(Refused::NoPose { joint }),
        }
        let goal = self.set_points.within_ranges(goal);
        let slow = SlowMove::new(now, self.set_points.positions(), goal, &self.config.axes());
        self.motion.plan = Some(HomingPlan::new(slow, None, driven(&goal)));
        self.status.enter(now, Phase::Moving);
        Ok(())
    }

    fn begin_slow_move(
        &mut self,
        now: Duration,
        via: Option<ViaPoint>,
        goal: &[f64; DRIVEN],
    ) -> Result<(), Refused> {
        self.status.require(Phase::Holding)?;
        if let Some(joint) = goal.iter().position(|value| !value.is_finite()) {
            return Err(Refused::NoPose { joint });
        }
        let goal = driven(&self.within_ranges(goal));
        let from_keys = via.is_some() && self.rail_arm.is_on_path();
        if from_keys && self.rail_arm.axis().velocity() != 0.0 {
            let remedy = "wait until it stands still";
            return Err(Refused::Phase { phase: self.phase().name(), remedy });
        }
        let first = match via {
            None => goal,
            Some(_) if from_keys => {
                self.rail_arm.leave_path();
                self.sent()
            }
            Some(_) => {
                // Away from the keyboard the rail's set-point moves nothing: it stands where the
                // arm will arrive.
                let clear = self.clear_pose();
                self.set_points.move_rail(clear[RAIL]);
                clear
            }
        };
        let plan = HomingPlan::new(self.slow_move(now, &first), via, goal);
        self.motion.plan = Some(HomingPlan { from_keys, ..plan });
        self.status.enter(now, Phase::Moving);
        Ok(())
    }

    /// Fingers straight, and the rail where the arm arrives at the keyboard.
    pub(super) fn clear_pose(&self) -> [f64; DRIVEN] {
        let mut pose = [0.0; DRIVEN];
        pose[..HAND_DRIVEN_JOINTS].copy_from_slice(&CLEAR_FINGERS);
        pose[RAIL] = self.rail_arm.middle_m();
        pose
    }

    /// The pose for all axes, or the nearest that their ranges allow.
    fn within_ranges(&self, pose: &[f64; DRIVEN]) -> [f64; AXES] {
        self.set_points.within_ranges(all_axes(pose, &self.config.limits.thumb_rad))
    }

    pub(super) fn slow_move(&self, now: Duration, goal: &[f64; DRIVEN]) -> SlowMove {
        let to = all_axes(goal, &self.config.limits.thumb_rad);
        SlowMove::new(now, self.set_points.positions(), to, &self.config.axes())
    }

    /// Follows a piece of a trajectory from `begun` on: one waypoint (rad, the rail in m) a
    /// set-point. It replaces what is left of the piece before, and the last waypoint stands when
    /// they have run out.
    ///
    /// # Errors
    /// If the robot is neither holding nor following, or is not near the first waypoint when it
    /// begins, or its keyboard has a warning that no start has acknowledged.
    pub fn follow(&mut self, begun: Duration, waypoints: &[[f64; DRIVEN]]) -> Result<(), Refused> {
        // A beginning in the future would delay the check of the age of commands.
        let ahead = Duration::from_secs_f64(self.config.limits.stale_command_secs);
        let begun = self.stalls.polled().map_or(begun, |polled| begun.min(polled.saturating_add(ahead)));
        if self.phase() != Phase::Following {
            self.status.require(Phase::Holding)?;
            let Some(first) = waypoints.first() else { return Ok(()) };
            self.check_near(first)?;
            if let Some(warning) = self.keyboard().warnings().next() {
                return Err(Refused::Keyboard(warning.to_string()));
            }
            self.set_points.align(begun);
            self.rail_arm.arm.align(begun, self.set_points.stepped());
            self.status.enter(begun, Phase::Following);
        }
        self.motion.follow(begun, waypoints);
        Ok(())
    }

    /// Ends a trajectory or a slow move: brakes and holds. The arm's path to the keyboard continues
    /// to its end: only [`stop`](Self::stop) ends that.
    pub fn hold(&mut self, now: Duration) {
        if self.motion.brings_arm() {
            return;
        }
        if matches!(self.phase(), Phase::Following | Phase::Moving) {
            self.motion.plan = None;
            self.status.enter(now, Phase::Holding);
        }
        self.motion.end_trajectory();
    }

    /// Refuses a trajectory that begins elsewhere than where the robot is.
    fn check_near(&self, pose: &[f64; DRIVEN]) -> Result<(), Refused> {
        let limits = &self.config.limits;
        let asked = to_wire(pose, &limits.thumb_rad);
        for (joint, (measured_rad, asked_rad)) in self.hand.positions().into_iter().zip(asked).enumerate() {
            let far = (measured_rad - asked_rad).abs();
            if far.is_nan() || far > limits.start_finger_rad {
                return Err(Refused::FingerFar { joint, measured_rad, asked_rad });
            }
        }
        let by_m = (self.place().rail_m - pose[RAIL]).abs();
        if by_m.is_nan() || by_m > limits.start_rail_m || !self.rail_arm.is_on_path() {
            return Err(Refused::RailFar { by_m: by_m.max(self.place().beside_m) });
        }
        Ok(())
    }
}
