//! Torques that hold the fingers against gravity. The hand's own driver has none: a straight,
//! horizontal finger would hang 1.4° below its reference, which is 3 mm at its tip.
//!
//! Masses are those of the URDF in simlabrobotics/allegro_hand_ros_v4, each in the middle of its
//! link. The thumb is folded away and has its stop.

use super::fingers::{MEDIAL_M, PROXIMAL_M, bends};
use super::limits::WIRE_JOINTS;

/// Mass, kg, and distance of its centre from the joint before it, m: proximal and medial link.
const PROXIMAL: (f64, f64) = (0.065, PROXIMAL_M / 2.0);
const MEDIAL: (f64, f64) = (0.0355, MEDIAL_M / 2.0);
/// The same of the distal link and of the fingertip, together.
const DISTAL: (f64, f64) = (0.0096 + 0.0168, (0.0096 * 0.008 + 0.0168 * 0.029) / (0.0096 + 0.0168));
const GRAVITY: f64 = 9.81;

/// The torques (N·m) that hold the fingers at `positions` (rad, as on the wire) when the palm faces
/// down. With the palm facing elsewhere they are to be multiplied by the cosine of the angle
/// between its normal and straight down.
pub fn holding_torques(positions: &[f64; WIRE_JOINTS]) -> [f64; WIRE_JOINTS] {
    let mut torques = [0.0; WIRE_JOINTS];
    for (finger, (roll, bends)) in bends(positions).into_iter().enumerate() {
        // Along the straight finger, and toward the keys.
        let along = bends.map(f64::cos);
        let down = bends.map(f64::sin);
        let moment = |lengths: [f64; 3]| {
            let [proximal, medial, distal] = lengths;
            PROXIMAL.0 * PROXIMAL.1 * proximal
                + MEDIAL.0 * (PROXIMAL_M * proximal + MEDIAL.1 * medial)
                + DISTAL.0 * (PROXIMAL_M * proximal + MEDIAL_M * medial + DISTAL.1 * distal)
        };
        let [_, medial, distal] = along;
        let third_moment = DISTAL.0 * DISTAL.1 * distal;
        let second_moment = third_moment + MEDIAL.0 * MEDIAL.1 * medial + DISTAL.0 * MEDIAL_M * medial;
        let pull = GRAVITY * roll.cos();
        torques[4 * finger] = GRAVITY * roll.sin() * moment(down);
        torques[4 * finger + 1] = -pull * moment(along);
        torques[4 * finger + 2] = -pull * second_moment;
        torques[4 * finger + 3] = -pull * third_moment;
    }
    torques
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_finger_is_heaviest_and_a_hanging_one_weighs_nothing() {
        let straight = holding_torques(&[0.0; WIRE_JOINTS]);
        // 0.065 · 0.027 + 0.0355 · 0.0732 + 0.0096 · 0.1004 + 0.0168 · 0.1214, times 9.81.
        assert!((straight[1] + 0.0722).abs() < 1e-4, "{straight:?}");
        assert!(straight[2] > straight[1] && straight[3] > straight[2] && straight[3] < 0.0);
        assert_eq!((straight[0], straight[13]), (0.0, 0.0));
        let mut hanging = [0.0; WIRE_JOINTS];
        hanging[1] = std::f64::consts::FRAC_PI_2;
        assert!(holding_torques(&hanging)[1].abs() < 1e-12);
        // Turned sideways, a hanging finger wants back.
        hanging[0] = 0.3;
        assert!(holding_torques(&hanging)[0] > 0.0);
    }
}
