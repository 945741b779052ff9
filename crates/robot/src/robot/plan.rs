//! Slow moves: the way of the arm from anywhere to the keyboard, and the fingers that are out of the way before it.

use std::time::Duration;

use super::fault::RobotError;
use super::motion::SlowMove;
use crate::calibration::RailPath;
use crate::joints::DRIVEN;
use crate::xarm::Fence;
use crate::xarm::kinematics::{JOINTS, KinematicsError, PAPER_HOME_DEG};

/// How far above the keyboard the arm comes and goes, m.
pub(super) const CLEAR_M: f64 = 0.08;
/// Time that the fingers may take, after their slow move, to be where it ended.
pub(super) const PATIENCE: Duration = Duration::from_secs(2);

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
    pub fn joints(self, path: &RailPath, standing: &[f64; JOINTS]) -> Result<[f64; JOINTS], KinematicsError> {
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
