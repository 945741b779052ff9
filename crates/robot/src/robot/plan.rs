//! Slow moves: the way of the arm from anywhere to the keyboard, and the fingers that are out of the way before it.

use std::time::Duration;

use super::axes::RAIL_AXIS;
use super::following::farthest;
use super::motion::SlowMove;
use super::{Fault, Phase, Refused, Robot, RobotError};
use crate::calibration::RailPath;
use crate::joints::DRIVEN;
use crate::limiter::Axis;
use crate::xarm::kinematics::{JOINTS, KinematicsError, PAPER_HOME_DEG, forward};
use crate::xarm::{ArmState, Fence};

/// How far above the keyboard the arm comes and goes, m.
const CLEAR_M: f64 = 0.08;
/// Within this of the path and below [`CLEAR_M`], a move of all joints could sweep over the keys, m.
const NEAR_M: f64 = 0.15;
/// Speed of the arm's own planned moves, rad/s: a tenth of what it may do.
const HOMING_SPEED: f64 = 0.3;
/// Time that the fingers may take, after their slow move, to be where it ended.
const PATIENCE: Duration = Duration::from_secs(2);

/// The stations of the arm's way from anywhere to the middle of the keyboard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Station {
    /// Straight up, from beside the keys.
    Up,
    /// The paper's home, high above.
    Home,
    /// Above the middle.
    Above,
    /// The middle.
    Middle,
}

/// What a slow move still has to do.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// The move that is under way.
    pub slow: SlowMove,
    /// Where the arm goes next by moves of its own, and whether it was told.
    pub station: Option<(Station, bool)>,
    /// When the fingers must have come to where they do not hinder the arm.
    pub arrived_by: Duration,
    /// The pose of the driven joints at the end.
    pub goal: [f64; DRIVEN],
}

impl Plan {
    pub fn new(slow: SlowMove, station: Option<Station>, goal: [f64; DRIVEN]) -> Self {
        let arrived_by = slow.end().saturating_add(PATIENCE);
        Self { slow, station: station.map(|station| (station, false)), arrived_by, goal }
    }
}

impl Station {
    /// The arm's joints there (rad), set out for from where it stands.
    fn joints(self, path: &RailPath, standing: &[f64; JOINTS]) -> Result<[f64; JOINTS], KinematicsError> {
        match self {
            Self::Up => path.above(standing, CLEAR_M),
            Self::Home => Ok(PAPER_HOME_DEG.map(f64::to_radians)),
            Self::Above => path.above_middle(CLEAR_M),
            Self::Middle => Ok(*path.middle()),
        }
    }
}

/// Whether the ways that every move to the keyboard has in common, and the whole `range` of the rail (m), stay in the
/// arm's box.
pub(super) fn check_fence(fence: &Fence, path: &RailPath, range: [f64; 2]) -> Result<(), RobotError> {
    for rail_m in path.bends(range) {
        let held = fence.holds(&path.pose(rail_m).position_m);
        let place = || format!("{rail_m:+.3} m along the keyboard");
        held.map_err(|source| RobotError::OutsideFence { place: place(), source })?;
    }
    let mut standing = *path.middle();
    for (station, place) in [
        (Station::Middle, "the middle of the keyboard"),
        (Station::Above, "above the keyboard"),
        (Station::Home, "the way between home and the keyboard"),
    ] {
        // Nothing is refused here that cannot be reached: setting out for it is.
        let Ok(joints) = station.joints(path, &standing) else { return Ok(()) };
        let held = fence.holds_way(&standing, &joints);
        held.map_err(|source| RobotError::OutsideFence { place: place.to_string(), source })?;
        standing = joints;
    }
    Ok(())
}

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
        let Some((station, told)) = plan.station else {
            self.plan = None;
            self.enter(now, Phase::Holding);
            return Ok(());
        };
        if !told {
            return self.set_out(now, station);
        }
        if self.arm.state() != ArmState::Ready {
            return Ok(());
        }
        plan.arrived_by = now.saturating_add(PATIENCE);
        plan.station = match station {
            Station::Up => Some((Station::Home, false)),
            Station::Home => Some((Station::Above, false)),
            Station::Above => Some((Station::Middle, false)),
            Station::Middle => None,
        };
        if plan.station.is_none() {
            let goal = plan.goal;
            self.settle_rail();
            self.plan = Some(Plan::new(self.slowly(now, &goal), None, goal));
        }
        Ok(())
    }

    /// Sends the arm to a station as soon as the fingers are out of its way.
    fn set_out(&mut self, now: Duration, station: Station) -> Result<(), Fault> {
        let Some(plan) = &mut self.plan else { return Ok(()) };
        let (joint, by_rad) = farthest(&self.hand.positions(), &self.axes.each_ref().map(Axis::position));
        if by_rad > self.config.limits.start_finger_rad {
            let late = now > plan.arrived_by;
            return if late { Err(Fault::NotFollowing { joint, by_rad }) } else { Ok(()) };
        }
        plan.station = Some((station, true));
        let standing = self.arm.joints().unwrap_or(*self.path.middle());
        let rail_m = self.path.place(&standing).rail_m;
        let joints =
            station.joints(&self.path, &standing).map_err(|source| Fault::Reach { rail_m, source })?;
        self.arm.move_home(now, joints, HOMING_SPEED)?;
        Ok(())
    }

    /// Lets the rail's set-point rest where the arm has come to.
    fn settle_rail(&mut self) {
        let joints = self.arm.joints().unwrap_or(*self.path.middle());
        self.axes[RAIL_AXIS].rest(self.path.place(&joints).rail_m);
        self.before = self.setpoints();
        self.arm_sent = Some(joints);
    }
}
