//! Brings the arm to the keyboard by way of its stations, after the fingers are out of its way.

use std::time::Duration;

use super::axes::RAIL_AXIS;
use super::following::farthest;
use super::plan::{CLEAR_M, PATIENCE, Plan, Station};
use super::way::Way;
use super::{Fault, Phase, Refused, Robot};
use crate::limiter::Axis;
use crate::xarm::kinematics::forward;

/// Within this of the path and below [`CLEAR_M`], a move of all joints could sweep over the keys, m.
const NEAR_M: f64 = 0.15;

impl Robot {
    /// Whether the arm's way from where it stands to a station, and from there home, stays in its box.
    pub(super) fn check_way(&self, station: Station) -> Result<(), Refused> {
        let (Some(fence), Some(mut standing)) = (self.config.arm.fence_mm, self.arm.joints()) else {
            return Ok(());
        };
        for station in [station, Station::Home] {
            let Ok(joints) = station.joints(&self.path, &standing) else { return Ok(()) };
            fence.holds_way(&standing, &joints)?;
            standing = joints;
        }
        Ok(())
    }

    /// Where the arm goes first.
    pub(super) fn first_station(&self) -> Station {
        let Some(joints) = self.arm.joints() else { return Station::Home };
        let place = self.path.place(&joints);
        let above_m = forward(&joints).position_m.z - self.path.pose(place.rail_m).position_m.z;
        if place.beside_m <= NEAR_M && above_m < CLEAR_M { Station::Up } else { Station::Home }
    }

    pub(super) fn advance_plan(&mut self, now: Duration) -> Result<(), Fault> {
        let Some(plan) = &mut self.plan else { return Ok(()) };
        if !plan.slow.is_over(now) {
            return Ok(());
        }
        let Some(station) = plan.station else {
            self.plan = None;
            self.enter(now, Phase::Holding);
            return Ok(());
        };
        let Some(way) = &plan.way else { return self.set_out(now, station) };
        let Some(measured) = self.arm.joints() else { return Ok(()) };
        if !way.has_arrived(now, &measured)? {
            return Ok(());
        }
        plan.arrived_by = now.saturating_add(PATIENCE);
        plan.way = None;
        let frees_fingers = plan.frees_fingers();
        plan.station = match station {
            Station::Up => Some(Station::Home),
            Station::Home => Some(Station::Above),
            Station::Above => Some(Station::Middle),
            Station::Middle => None,
        };
        if plan.station.is_none() {
            let goal = plan.goal;
            self.settle_rail();
            self.plan = Some(Plan::new(self.slowly(now, &goal), None, goal));
        } else if frees_fingers {
            // Now they have room.
            let (station, goal) = (plan.station, plan.goal);
            self.plan = Some(Plan::new(self.slowly(now, &self.clear_pose()), station, goal));
        }
        Ok(())
    }

    /// Sends the arm to a station as soon as the fingers are out of its way; straight up from the keys at once, because a finger may be
    /// caught there.
    fn set_out(&mut self, now: Duration, station: Station) -> Result<(), Fault> {
        let Some(plan) = &mut self.plan else { return Ok(()) };
        let (joint, by_rad) = farthest(&self.hand.positions(), &self.axes.each_ref().map(Axis::position));
        if !plan.frees_fingers() && by_rad > self.config.limits.start_finger_rad {
            let late = now > plan.arrived_by;
            return if late { Err(Fault::NotFollowing { joint, by_rad }) } else { Ok(()) };
        }
        // From where the arm was sent last: an arm that sags a little does not jump.
        let standing = self.arm.sent().or(self.arm.joints()).unwrap_or(*self.path.middle());
        let rail_m = self.path.place(&standing).rail_m;
        let joints =
            station.joints(&self.path, &standing).map_err(|source| Fault::Reach { rail_m, source })?;
        plan.way = Some(Way::new(standing, joints, &self.config.arm));
        Ok(())
    }

    /// Sets the rail's set-point, at rest, to where the arm was sent.
    fn settle_rail(&mut self) {
        let joints = self.arm.sent().unwrap_or(*self.path.middle());
        self.axes[RAIL_AXIS].rest(self.path.place(&joints).rail_m);
        self.arm_axis.rest(self.axes[RAIL_AXIS].position());
        self.doubts.arm_has_arrived();
        self.before = self.setpoints();
        self.arm_sent = Some(joints);
        self.arm_aside = Default::default();
    }
}
