//! The axes of the set-points: the hand's sixteen joints as on the wire, then the rail.

use std::time::Duration;

use crate::allegro::WIRE_JOINTS;
use crate::joints::{DRIVEN, HAND_DRIVEN_JOINTS, RAIL, to_wire};
use crate::rig_file::SETPOINT_HZ;

/// Set-points of all axes.
pub(super) const AXES: usize = WIRE_JOINTS + 1;
/// The rail among them.
pub(super) const RAIL_AXIS: usize = WIRE_JOINTS;
/// Time between two set-points.
pub(super) fn period() -> Duration {
    Duration::from_secs_f64(1.0 / SETPOINT_HZ)
}

/// All axes for the driven joints, with the thumb where it stays.
pub(super) fn all_axes(joints: &[f64; DRIVEN], thumb_rad: &[f64; 4]) -> [f64; AXES] {
    let wire = to_wire(joints, thumb_rad);
    std::array::from_fn(|axis| wire.get(axis).copied().unwrap_or(joints[RAIL]))
}

/// The driven joints among all axes.
pub(super) fn driven(axes: &[f64; AXES]) -> [f64; DRIVEN] {
    std::array::from_fn(|joint| if joint == RAIL { axes[RAIL_AXIS] } else { axes[joint] })
}

/// The driven joint of an axis; the thumb's four come after them.
pub(super) fn driven_index(axis: usize) -> usize {
    match axis {
        RAIL_AXIS => RAIL,
        thumb if thumb >= HAND_DRIVEN_JOINTS => thumb + 1,
        finger => finger,
    }
}
