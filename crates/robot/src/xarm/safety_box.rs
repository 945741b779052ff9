//! The box that the flange stays in: the controller's "safety boundary" (registers 52 and 59),
//! which stops the arm with error 35 when the flange leaves it.
//!
//! Our own set-points keep a margin from its sides, so that the controller's check is the second
//! one.

use etude_checks::{RangeError, check_range};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::kinematics::{ARM_JOINTS, forward};

/// How far from the sides our own motion stays, mm: a servoed arm rounds its corners.
const MARGIN_MM: f64 = 5.0;
/// Range of the tool in xArm-Python-SDK, mm.
const MAX_SIDES_MM: [[i32; 2]; 3] = [[-750, 750], [-750, 750], [-400, 1000]];
/// Thinnest box, mm: less leaves nothing between its margins.
const MIN_SIDE_MM: i32 = 50;
/// Turn of a joint from one tried position of a path to the next, rad: the flange's arc between two
/// of them leaves its chord by less than a tenth of a millimetre.
const TRIAL_STEP_RAD: f64 = 0.02;
const AXES: [&str; 3] = ["x", "y", "z"];

/// A box in the frame of the arm's base: lowest and highest x, y and z of the flange, mm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SafetyBox(pub [[i32; 2]; 3]);

/// The flange is, or would be, outside the box.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "{axis} of the flange is {at_mm:.0} mm, and arm.box_mm allows {low_mm} to {high_mm}, {margin} mm less at each side",
    margin = MARGIN_MM
)]
pub struct OutsideBox {
    /// Along which axis of the base.
    pub axis: &'static str,
    /// Where the flange is, mm.
    pub at_mm: f64,
    /// Lowest side of the box, mm.
    pub low_mm: i32,
    /// Highest side of the box, mm.
    pub high_mm: i32,
}

impl SafetyBox {
    /// The largest one.
    pub const WIDEST: Self = Self(MAX_SIDES_MM);

    /// The smallest box, in whole centimetres, that has these places of the flange `room_mm` inside
    /// its sides; no larger than [`WIDEST`](Self::WIDEST).
    pub fn around(positions_m: impl IntoIterator<Item = Vector3<f64>>, room_mm: f64) -> Self {
        let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
        for position in positions_m {
            for ([low, high], metres) in ends.iter_mut().zip(position.iter()) {
                (*low, *high) = (low.min(metres * 1e3), high.max(metres * 1e3));
            }
        }
        let mut sides = MAX_SIDES_MM;
        for ([low, high], [lowest, highest]) in ends.iter().zip(&mut sides) {
            let (down, up) =
                (((low - room_mm) / 10.0).floor() * 10.0, ((high + room_mm) / 10.0).ceil() * 10.0);
            (*lowest, *highest) = ((down as i32).max(*lowest), (up as i32).min(*highest));
        }
        Self(sides)
    }

    /// What [`ArmConfig`](super::ArmConfig) checks.
    pub(super) fn check(self) -> Result<(), RangeError> {
        let least = f64::from(MIN_SIDE_MM);
        for ((axis, side), widest) in AXES.into_iter().zip(self.0).zip(MAX_SIDES_MM) {
            let ([low, high], [min, max]) = (side.map(f64::from), widest.map(f64::from));
            check_range(format!("arm.box_mm (lowest {axis})"), low, min..=max - least)?;
            check_range(format!("arm.box_mm (highest {axis})"), high, low + least..=max)?;
        }
        Ok(())
    }

    /// Whether our motion may bring the flange here.
    ///
    /// # Errors
    /// Names the first axis along which it may not.
    pub fn holds(&self, position_m: &Vector3<f64>) -> Result<(), OutsideBox> {
        for ((axis, metres), [low_mm, high_mm]) in AXES.into_iter().zip(position_m.iter()).zip(self.0) {
            let (at_mm, low, high) = (metres * 1e3, f64::from(low_mm), f64::from(high_mm));
            if !(low + MARGIN_MM..=high - MARGIN_MM).contains(&at_mm) {
                return Err(OutsideBox { axis, at_mm, low_mm, high_mm });
            }
        }
        Ok(())
    }

    /// Whether our motion may bring the arm from these joints straight to those (rad): a move that
    /// the arm plans itself.
    ///
    /// # Errors
    /// Names the first axis along which the flange would leave.
    pub fn holds_path(&self, from: &[f64; ARM_JOINTS], to: &[f64; ARM_JOINTS]) -> Result<(), OutsideBox> {
        flange_positions(from, to).try_for_each(|position_m| self.holds(&position_m))
    }

    /// Whether the controller itself leaves the arm alone here: there is no margin.
    pub fn contains(&self, position_m: &Vector3<f64>) -> bool {
        position_m
            .iter()
            .zip(self.0)
            .all(|(metres, [low, high])| (f64::from(low)..=f64::from(high)).contains(&(metres * 1e3)))
    }

    /// As register 52 has it: highest and lowest x, y and z.
    pub fn to_wire(self) -> [i32; 6] {
        let [[x_low, x_high], [y_low, y_high], [z_low, z_high]] = self.0;
        [x_high, x_low, y_high, y_low, z_high, z_low]
    }

    /// Reads what [`to_wire`](Self::to_wire) writes.
    pub fn from_wire(wire: [i32; 6]) -> Self {
        let [x_high, x_low, y_high, y_low, z_high, z_low] = wire;
        Self([[x_low, x_high], [y_low, y_high], [z_low, z_high]])
    }
}

/// Positions of the flange, m, on a straight path in joint space, rad.
pub(crate) fn flange_positions(
    from: &[f64; ARM_JOINTS],
    to: &[f64; ARM_JOINTS],
) -> impl Iterator<Item = Vector3<f64>> {
    let turn = from.iter().zip(to).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
    // No joint turns by more than two full turns either way.
    let steps = (turn / TRIAL_STEP_RAD).ceil().clamp(1.0, 2000.0) as u32;
    let (from, to) = (*from, *to);
    (0..=steps).map(move |step| {
        let share = f64::from(step) / f64::from(steps);
        forward(&std::array::from_fn(|joint| from[joint] + (to[joint] - from[joint]) * share)).position_m
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::xarm::kinematics::PAPER_HOME_DEG;

    #[test]
    fn a_path_may_leave_between_two_places_that_are_inside() {
        // The paper's home, and the same turned by a half: between them the flange goes around the
        // base.
        let from = PAPER_HOME_DEG.map(f64::to_radians);
        let mut to = from;
        (to[0], to[6]) = (std::f64::consts::PI, from[6]);
        let narrow = SafetyBox([[-600, 600], [-100, 100], [500, 650]]);
        narrow.holds(&forward(&from).position_m).unwrap();
        narrow.holds(&forward(&to).position_m).unwrap();
        let outside = narrow.holds_path(&from, &to).unwrap_err();
        assert_eq!((outside.axis, outside.high_mm), ("y", 100));
        assert!(outside.to_string().contains("arm.box_mm allows -100 to 100"), "{outside}");
        SafetyBox([[-600, 600], [-600, 600], [500, 650]]).holds_path(&from, &to).unwrap();
    }

    proptest! {
        #[test]
        fn what_we_allow_the_controller_allows(
            low in prop::array::uniform3(-700..0_i32),
            size in prop::array::uniform3(50..700_i32),
            at_m in prop::array::uniform3(-1.0..1.0_f64),
        ) {
            let safety_box = SafetyBox(std::array::from_fn(|axis| [low[axis], low[axis] + size[axis]]));
            prop_assert_eq!(SafetyBox::from_wire(safety_box.to_wire()), safety_box);
            let at = Vector3::from(at_m);
            prop_assert!(safety_box.holds(&at).is_err() || safety_box.contains(&at));
        }

        #[test]
        fn no_number_is_inside(axis in 0..3_usize, odd in prop::sample::select(&[f64::NAN, f64::INFINITY][..])) {
            let mut at = Vector3::zeros();
            at[axis] = odd;
            prop_assert!(SafetyBox::WIDEST.holds(&at).is_err());
            prop_assert!(SafetyBox::WIDEST.holds_path(&[odd; ARM_JOINTS], &[0.0; ARM_JOINTS]).is_err());
        }
    }
}
