//! How far apart two places of the arm are, and whether it can be at one.

use super::fault::TargetError;
use crate::xarm::kinematics::{self, ARM_JOINTS};

/// The joint (counted from 1) that turns most between two places, and by how much, rad.
pub(crate) fn largest_turn(from: &[f64; ARM_JOINTS], to: &[f64; ARM_JOINTS]) -> (usize, f64) {
    let turns = to.iter().zip(from).map(|(to, from)| (to - from).abs());
    turns
        .enumerate()
        .fold((1, 0.0), |most, (index, turn)| if turn > most.1 { (index + 1, turn) } else { most })
}

/// Distance between the flange's positions at two places, m.
pub(super) fn flange_distance_m(from: &[f64; ARM_JOINTS], to: &[f64; ARM_JOINTS]) -> f64 {
    (kinematics::forward(to).position_m - kinematics::forward(from).position_m).norm()
}

/// Whether the arm can reach these joints.
pub(super) fn possible(joints: &[f64; ARM_JOINTS]) -> Result<(), TargetError> {
    if !joints.iter().all(|angle| angle.is_finite()) {
        return Err(TargetError::NotFinite);
    }
    kinematics::within_limits(joints).map_err(TargetError::BeyondLimit)
}
