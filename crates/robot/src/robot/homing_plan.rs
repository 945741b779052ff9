//! Slow moves: the via points of the arm's path to the keyboard.

use std::time::Duration;

use super::arm_path::ArmPath;
use super::fault::RobotError;
use super::slow_move::SlowMove;

use crate::calibration::RailPath;
use crate::joints::DRIVEN;
use crate::xarm::kinematics::{ARM_JOINTS, KinematicsError, PAPER_HOME_DEG};
use crate::xarm::{SafetyBox, flange_positions};

/// How far above the keyboard the arm comes and goes, m.
pub(super) const CLEAR_M: f64 = 0.08;
/// Time that the fingers may take, after their slow move, to be where it ended.
pub(super) const ARRIVAL_TIMEOUT: Duration = Duration::from_secs(2);

/// The via points of the arm's path from anywhere to the middle of the keyboard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ViaPoint {
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
pub(super) struct HomingPlan {
    /// The move that is under way.
    pub slow: SlowMove,
    /// Where the arm goes next.
    pub via: Option<ViaPoint>,
    /// Its path there, once it has set out.
    pub path: Option<ArmPath>,
    /// When the fingers must have come to where they do not hinder the arm.
    pub arrived_by: Duration,
    /// Whether it begins at the keys: the arm goes straight up before the fingers move.
    pub from_keys: bool,
    /// The pose of the driven joints at the end.
    pub goal: [f64; DRIVEN],
}

impl HomingPlan {
    pub fn new(slow: SlowMove, via: Option<ViaPoint>, goal: [f64; DRIVEN]) -> Self {
        let arrived_by = slow.end().saturating_add(ARRIVAL_TIMEOUT);
        Self { slow, via, path: None, arrived_by, from_keys: false, goal }
    }

    /// Whether the arm goes straight up now with the fingers as they are, because one may be
    /// caught.
    pub fn frees_fingers(&self) -> bool {
        self.from_keys && self.via == Some(ViaPoint::Up)
    }
}

impl ViaPoint {
    /// The one after it.
    pub fn next(self) -> Option<Self> {
        match self {
            Self::Up => Some(Self::Home),
            Self::Home => Some(Self::Above),
            Self::Above => Some(Self::Middle),
            Self::Middle => None,
        }
    }

    /// The arm's joints there (rad), set out for from where it stands.
    pub fn joints(
        self,
        path: &RailPath,
        from: &[f64; ARM_JOINTS],
    ) -> Result<[f64; ARM_JOINTS], KinematicsError> {
        match self {
            Self::Up => path.above(from, CLEAR_M),
            Self::Home => Ok(PAPER_HOME_DEG.map(f64::to_radians)),
            Self::Above => path.above_middle(CLEAR_M),
            Self::Middle => Ok(*path.middle()),
        }
    }
}

/// Via points between which every move to the keyboard goes, from the keyboard on.
const VIA_POINTS: [(ViaPoint, &str); 3] = [
    (ViaPoint::Middle, "the middle of the keyboard"),
    (ViaPoint::Above, "above the keyboard"),
    (ViaPoint::Home, "the path between home and the keyboard"),
];
/// Distance of the sides of a proposed box from the flange's positions, mm: where a ringing arm or
/// hand-guiding brings it.
const MARGIN_MM: f64 = 60.0;

/// Whether the paths that every move to the keyboard has in common, and the whole `range` of the
/// rail (m), stay in the arm's box.
pub(super) fn check_box(safety_box: &SafetyBox, path: &RailPath, range: [f64; 2]) -> Result<(), RobotError> {
    for rail_m in path.bends(range) {
        let held = safety_box.holds(&path.pose(rail_m).position_m);
        let place = || format!("{rail_m:+.3} m along the keyboard");
        held.map_err(|source| RobotError::OutsideBox { place: place(), source })?;
    }
    let mut from = *path.middle();
    for (via, place) in VIA_POINTS {
        // One that cannot be reached is refused when the arm starts for it.
        let Ok(joints) = via.joints(path, &from) else { return Ok(()) };
        let held = safety_box.holds_path(&from, &joints);
        held.map_err(|source| RobotError::OutsideBox { place: place.to_string(), source })?;
        from = joints;
    }
    Ok(())
}

/// A box for the arm that holds the `range` of the rail (m), also when the arm goes straight up
/// from there, and the paths to the keyboard.
///
/// # Errors
/// If no box that the controller takes does.
pub fn propose_box(path: &RailPath, range: [f64; 2]) -> Result<SafetyBox, RobotError> {
    let along = path.bends(range).map(|rail_m| path.pose(rail_m).position_m);
    let above = along.map(|position_m| position_m + nalgebra::Vector3::new(0.0, 0.0, CLEAR_M));
    let mut places = [along, above].concat();
    let mut from = *path.middle();
    for (via, _) in VIA_POINTS {
        let Ok(joints) = via.joints(path, &from) else { break };
        places.extend(flange_positions(&from, &joints));
        from = joints;
    }
    let safety_box = SafetyBox::around(places, MARGIN_MM);
    check_box(&safety_box, path, range)?;
    Ok(safety_box)
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
        let safety_box = propose_box(&path, range).unwrap();
        let SafetyBox(sides) = safety_box;
        for axis in 0..3 {
            for side in 0..2 {
                let mut narrow = sides;
                narrow[axis][side] += [70, -70][side];
                assert!(
                    check_box(&SafetyBox(narrow), &path, range).is_err(),
                    "{safety_box:?}, {axis} {side}"
                );
            }
        }
    }
}
