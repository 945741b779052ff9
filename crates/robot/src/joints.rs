//! The order of joints: on the hand's wires, and in observations, actions and recordings. Stated
//! here and nowhere else.
//!
//! | driven joint | 0…3 | 4…7 | 8…11 | 12 |
//! |---|---|---|---|---|
//! | is | index finger | middle finger | ring finger | the rail, which the arm makes |
//! | on the wire (4 · finger + joint) | 0…3 | 4…7 | 8…11 | none |
//!
//! Within a finger: rotation at the palm, proximal, medial, distal. Angles have the same sign for a
//! left and a right hand (URDF in Wonik's `allegro_hand_ros2`). The wire's joints 12…15 are the
//! thumb, which does not play. The simulator lists the joints in the order of the wire.

use crate::allegro;

/// Driven joints: twelve of the fingers, then the rail.
pub const DRIVEN: usize = 13;
/// Index of the rail among the driven joints.
pub const RAIL: usize = DRIVEN - 1;
/// Finger joints among the driven ones; on the wire they come first, in the same order.
pub const HAND_DRIVEN_JOINTS: usize = RAIL;

/// The wire's sixteen angles from the driven joints and the thumb's four angles, rad.
pub fn to_wire(driven: &[f64; DRIVEN], thumb_rad: &[f64; 4]) -> [f64; allegro::WIRE_JOINTS] {
    std::array::from_fn(|joint| match joint.checked_sub(HAND_DRIVEN_JOINTS) {
        None => driven[joint],
        Some(thumb) => thumb_rad[thumb],
    })
}

/// The driven joints from the wire's sixteen angles (rad) and the place on the rail (m).
pub fn from_wire(wire_rad: &[f64; allegro::WIRE_JOINTS], rail_m: f64) -> [f64; DRIVEN] {
    std::array::from_fn(|joint| if joint == RAIL { rail_m } else { wire_rad[joint] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back() {
        let driven = std::array::from_fn(|joint| joint as f64);
        let wire = to_wire(&driven, &[20.0, 21.0, 22.0, 23.0]);
        assert_eq!(wire[..12], driven[..12]);
        assert_eq!(wire[12..], [20.0, 21.0, 22.0, 23.0]);
        assert_eq!(from_wire(&wire, driven[RAIL]), driven);
    }
}
