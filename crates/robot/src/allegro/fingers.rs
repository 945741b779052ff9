//! Measures of the fingers that play, for a palm that faces down.
//!
//! Lengths are those of MuJoCo Menagerie's `wonik_allegro` and of the printed tips
//! (lasr-lab/learning-to-play-piano).

use super::limits::WIRE_JOINTS;

/// Fingers that play, with four joints each. The thumb is folded away.
pub const PLAYING: usize = 3;
/// From the first flexion joint to the second, from there to the third, and from there to the
/// centre of the tip's rounded end, m.
pub(super) const PROXIMAL_M: f64 = 0.054;
pub(super) const MEDIAL_M: f64 = 0.0384;
const DISTAL_M: f64 = 0.029 + 0.016;
/// Radius of a fingertip, m.
pub(crate) const TIP_RADIUS_M: f64 = 0.0085;

/// The playing fingers at `positions` (rad, as on the wire): rotation at the palm, and the angle of
/// each link from straight ahead toward the keys, rad.
pub(super) fn bends(positions: &[f64; WIRE_JOINTS]) -> [(f64, [f64; 3]); PLAYING] {
    std::array::from_fn(|finger| {
        let [roll, first, second, third] = std::array::from_fn(|joint| positions[4 * finger + joint]);
        (roll, [first, first + second, first + second + third])
    })
}

/// How far the lowest point of each playing finger's tip is below the roots of the fingers, m, at
/// `positions` (rad, as on the wire).
pub fn tip_depths(positions: &[f64; WIRE_JOINTS]) -> [f64; PLAYING] {
    bends(positions).map(|(roll, bends)| {
        let [proximal, medial, distal] = bends.map(f64::sin);
        roll.cos() * (PROXIMAL_M * proximal + MEDIAL_M * medial + DISTAL_M * distal) + TIP_RADIUS_M
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn a_hanging_finger_is_as_long_as_its_links() {
        let mut positions = [0.0; WIRE_JOINTS];
        assert_eq!(tip_depths(&positions), [TIP_RADIUS_M; PLAYING]);
        // The ring finger hangs, the middle one is bent at its last joint.
        (positions[9], positions[7]) = (FRAC_PI_2, FRAC_PI_2);
        let [index, middle, ring] = tip_depths(&positions);
        assert_eq!(index, TIP_RADIUS_M);
        assert!((middle - (0.045 + TIP_RADIUS_M)).abs() < 1e-12, "{middle}");
        assert!((ring - (0.054 + 0.0384 + 0.045 + TIP_RADIUS_M)).abs() < 1e-12, "{ring}");
    }
}
