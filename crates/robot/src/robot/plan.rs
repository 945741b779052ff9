//! Slow moves: the stations of the arm's way to the keyboard.

use std::time::Duration;

use super::fault::RobotError;
use super::motion::SlowMove;
use super::way::Way;
use crate::calibration::RailPath;
use crate::joints::DRIVEN;
use crate::xarm::kinematics::{JOINTS, KinematicsError, PAPER_HOME_DEG};
use crate::xarm::{Fence, way};

/// How far above the keyboard the arm comes and goes, m.
pub(super) const CLEAR_M: f64 = 0.08;
/// Time that the fingers may take, after their slow move, to be where it ended.
pub(super) const PATIENCE: Duration = Duration::from_secs(2);

/// The stations of the arm's way from anywhere to the middle of the keyboard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Station {
    /// Straight up, away from the keys.
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
    /// Where the arm goes next.
    pub station: Option<Station>,
    /// Its way there, once it has set out.
    pub way: Option<Way>,
    /// When the fingers must have come to where they do not hinder the arm.
    pub arrived_by: Duration,
    /// Whether it begins at the keys: the arm goes straight up before the fingers move.
    pub from_keys: bool,
    /// The pose of the driven joints at the end.
    pub goal: [f64; DRIVEN],
}

impl Plan {
    pub fn new(slow: SlowMove, station: Option<Station>, goal: [f64; DRIVEN]) -> Self {
        let arrived_by = slow.end().saturating_add(PATIENCE);
        Self { slow, station, way: None, arrived_by, from_keys: false, goal }
    }

    /// Whether the arm goes straight up now with the fingers as they are, because one may be caught.
    pub fn frees_fingers(&self) -> bool {
        self.from_keys && self.station == Some(Station::Up)
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

/// Stations between which every move to the keyboard goes, from the keyboard on.
const WAY: [(Station, &str); 3] = [
    (Station::Middle, "the middle of the keyboard"),
    (Station::Above, "above the keyboard"),
    (Station::Home, "the way between home and the keyboard"),
];
/// Room around the places of the flange in a box that is proposed, mm: where a ringing arm or a lead by hand brings it.
const ROOM_MM: f64 = 60.0;

/// Whether the ways that every move to the keyboard has in common, and the whole `range` of the rail (m), stay in the
/// arm's box.
pub(super) fn check_fence(fence: &Fence, path: &RailPath, range: [f64; 2]) -> Result<(), RobotError> {
    for rail_m in path.bends(range) {
        let held = fence.holds(&path.pose(rail_m).position_m);
        let place = || format!("{rail_m:+.3} m along the keyboard");
        held.map_err(|source| RobotError::OutsideFence { place: place(), source })?;
    }
    let mut standing = *path.middle();
    for (station, place) in WAY {
        // A station that cannot be reached is refused when the arm starts for it.
        let Ok(joints) = station.joints(path, &standing) else { return Ok(()) };
        let held = fence.holds_way(&standing, &joints);
        held.map_err(|source| RobotError::OutsideFence { place: place.to_string(), source })?;
        standing = joints;
    }
    Ok(())
}

/// A box for the arm that holds the `range` of the rail (m), also when the arm goes straight up from there, and the ways to the keyboard.
///
/// # Errors
/// If no box that the controller takes does.
pub fn propose_fence(path: &RailPath, range: [f64; 2]) -> Result<Fence, RobotError> {
    let along = path.bends(range).map(|rail_m| path.pose(rail_m).position_m);
    let above = along.map(|position_m| position_m + nalgebra::Vector3::new(0.0, 0.0, CLEAR_M));
    let mut places = [along, above].concat();
    let mut standing = *path.middle();
    for (station, _) in WAY {
        let Ok(joints) = station.joints(path, &standing) else { break };
        places.extend(way(&standing, &joints));
        standing = joints;
    }
    let fence = Fence::around(places, ROOM_MM);
    check_fence(&fence, path, range)?;
    Ok(fence)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::papers;

    #[test]
    fn what_is_proposed_holds_what_is_needed_and_little_more() {
        let home = PAPER_HOME_DEG.map(f64::to_radians);
        let range = [-0.3, 0.3];
        let path = RailPath::new(&papers(), range, &home).unwrap();
        let fence = propose_fence(&path, range).unwrap();
        let Fence(sides) = fence;
        for axis in 0..3 {
            for side in 0..2 {
                let mut narrow = sides;
                narrow[axis][side] += [70, -70][side];
                assert!(check_fence(&Fence(narrow), &path, range).is_err(), "{fence:?}, {axis} {side}");
            }
        }
    }
}
