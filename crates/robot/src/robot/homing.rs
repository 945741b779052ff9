//! Brings the arm to the keyboard by its via points, after the fingers are out of its way.

use std::time::Duration;

use super::following_error::farthest;
use super::homing_plan::{ARRIVAL_TIMEOUT, HomingPlan, ViaPoint};
use super::{Fault, Phase, Robot};

impl Robot {
    pub(super) fn advance_plan(&mut self, now: Duration) -> Result<(), Fault> {
        let Some(plan) = &mut self.motion.plan else { return Ok(()) };
        if !plan.slow.is_over(now) {
            return Ok(());
        }
        let Some(via) = plan.via else {
            self.motion.plan = None;
            self.status.enter(now, Phase::Holding);
            return Ok(());
        };
        let Some(path) = &plan.path else { return self.set_out(now, via) };
        let Some(measured) = self.rail_arm.arm.joints() else { return Ok(()) };
        if !path.has_arrived(now, &measured)? {
            return Ok(());
        }
        let (goal, frees_fingers) = (plan.goal, plan.frees_fingers());
        plan.arrived_by = now.saturating_add(ARRIVAL_TIMEOUT);
        plan.path = None;
        plan.via = via.next();
        if plan.via.is_none() {
            self.settle_rail();
            self.motion.plan = Some(HomingPlan::new(self.slow_move(now, &goal), None, goal));
        } else if frees_fingers {
            // Now they have room.
            let via = plan.via;
            self.motion.plan = Some(HomingPlan::new(self.slow_move(now, &self.clear_pose()), via, goal));
        }
        Ok(())
    }

    /// Sends the arm to a via point as soon as the fingers are out of its way; straight up from the
    /// keys at once, because a finger may be caught there.
    fn set_out(&mut self, now: Duration, via: ViaPoint) -> Result<(), Fault> {
        let Some(plan) = &mut self.motion.plan else { return Ok(()) };
        let (joint, by_rad) = farthest(&self.hand.positions(), &self.set_points.positions());
        if !plan.frees_fingers() && by_rad > self.config.limits.start_finger_rad {
            let is_late = now > plan.arrived_by;
            return if is_late { Err(Fault::NotFollowing { joint, by_rad }) } else { Ok(()) };
        }
        plan.path = Some(self.rail_arm.path_to(via, &self.config.arm)?);
        Ok(())
    }

    /// Sets the rail's set-point, at rest, to where the arm was sent.
    fn settle_rail(&mut self) {
        let (joints, rail_m) = self.rail_arm.sent_place();
        self.set_points.settle_rail(rail_m);
        self.rail_arm.arrive(joints, self.set_points.rail().position());
        self.plausibility.arm_has_arrived();
    }
}
