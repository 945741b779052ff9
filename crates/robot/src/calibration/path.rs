//! The path of the flange along the keyboard: from a place on the rail to seven joint angles, and
//! back.

use std::f64::consts::FRAC_1_SQRT_2;

use nalgebra::Vector3;

use super::file::{Calibration, CalibrationError, Point};
use crate::xarm::kinematics::{ARM_JOINTS, KinematicsError, Pose, forward, inverse, logarithm};

/// Largest relative difference between the distance of two points on the rail and that of their
/// poses.
const LENGTH_TOLERANCE: f64 = 0.02;
/// Largest difference between the orientations of the points and the one that is kept, rad.
const TURN_TOLERANCE: f64 = 0.05;
/// Distance of the places at which a path is tried before it is used, m.
const TRIAL_STEP_M: f64 = 0.01;
/// Where the high notes are, in the frame of the flange, with the hand mounted as in the paper.
const TOWARD_HIGH_NOTES: Vector3<f64> = Vector3::new(-FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0);

/// Where the hand is, seen from the rail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RailPlace {
    /// Place on the rail, m.
    pub rail_m: f64,
    /// Distance of the flange from the path, m.
    pub beside_m: f64,
    /// Angle between the flange and the orientation that the path keeps, rad.
    pub turned_rad: f64,
}

/// The path of the flange along the keyboard.
#[derive(Clone, Debug)]
pub struct RailPath {
    points: [(f64, Vector3<f64>); 3],
    orientation: Pose,
    middle: [f64; ARM_JOINTS],
    arm_serial: String,
}

impl RailPath {
    /// The path through the points of a calibration, tried over the whole `range` (m) of the rail,
    /// starting from joints `near` those of its middle.
    ///
    /// # Errors
    /// If the points do not lie as the keys do, or the arm does not reach everywhere.
    pub fn new(
        calibration: &Calibration,
        range: [f64; 2],
        near: &[f64; ARM_JOINTS],
    ) -> Result<Self, CalibrationError> {
        let points: &[Point; 3] = calibration.points.as_slice().try_into().map_err(|_| {
            CalibrationError::Unfit(format!(
                "the calibration has {} of its three points; show the others with `etude robot calibrate`",
                calibration.points.len()
            ))
        })?;
        let [_, middle, _] = points;
        for pair in points.windows(2) {
            let along = pair[1].rail_m - pair[0].rail_m;
            let apart = (pair[1].pose().position_m - pair[0].pose().position_m).norm();
            let names = (pair[0].pitch, pair[1].pitch);
            if !(along > 0.0 && (apart / along - 1.0).abs() <= LENGTH_TOLERANCE) {
                return Err(CalibrationError::Unfit(format!(
                    "keys {} and {} are {:.1} mm apart, and the arm stood {:.1} mm apart at them; show the keys again \
                     with `etude robot calibrate`",
                    names.0,
                    names.1,
                    along * 1e3,
                    apart * 1e3
                )));
            }
        }
        for point in points {
            let turned = turned_rad(&point.pose(), &middle.pose());
            if turned.is_nan() || turned > TURN_TOLERANCE {
                return Err(CalibrationError::Unfit(format!(
                    "at key {} the hand was turned by {:.1}° against the middle one; show the keys again with \
                     `etude robot calibrate`",
                    point.pitch,
                    turned.to_degrees()
                )));
            }
        }
        let along = points[2].pose().position_m - points[0].pose().position_m;
        if (middle.pose().rotation.inverse() * along).dot(&TOWARD_HIGH_NOTES) <= 0.0 {
            return Err(CalibrationError::Unfit(format!(
                "seen from the hand the keys {} to {} were shown from right to left: the lowest and the highest were exchanged, or the hand \
                 is not mounted as in the paper; show the keys again with `etude robot calibrate`",
                points[0].pitch, points[2].pitch
            )));
        }
        let mut path = Self {
            points: points.map(|point| (point.rail_m, point.pose().position_m)),
            orientation: middle.pose(),
            middle: *near,
            arm_serial: calibration.arm_serial.clone(),
        };
        let reach = |rail_m: f64, near: &[f64; ARM_JOINTS]| {
            let unfit = |why| CalibrationError::Unfit(format!("at {rail_m:+.3} m along the keyboard: {why}"));
            path.joints(rail_m, near).map_err(unfit)
        };
        let centre = reach(middle.rail_m, near)?;
        for end in range {
            let mut joints = centre;
            let steps = ((end - middle.rail_m).abs() / TRIAL_STEP_M).ceil();
            for step in 1..=steps as usize {
                joints = reach(middle.rail_m + (end - middle.rail_m) * step as f64 / steps, &joints)?;
            }
        }
        path.middle = centre;
        Ok(path)
    }

    /// Serial number of the arm that it was shown to.
    pub fn arm_serial(&self) -> &str {
        &self.arm_serial
    }

    /// Joints of the arm over the middle point, rad.
    pub fn middle(&self) -> &[f64; ARM_JOINTS] {
        &self.middle
    }

    /// The pose of the flange at a place on the rail; beyond the outer points straight on.
    pub fn pose(&self, rail_m: f64) -> Pose {
        let [low, middle, high] = &self.points;
        let (from, to) = if rail_m < middle.0 { (low, middle) } else { (middle, high) };
        let share = (rail_m - from.0) / (to.0 - from.0);
        Pose { position_m: from.1 + (to.1 - from.1) * share, ..self.orientation }
    }

    /// Places on the rail (m), ends of `range` included, between which the path along it is
    /// straight.
    pub fn bends(&self, [low, high]: [f64; 2]) -> [f64; 3] {
        let [_, (middle, _), _] = self.points;
        [low, middle.max(low).min(high), high]
    }

    /// Joints (rad) that bring the hand to a place on the rail, on the path from joints `near` it.
    ///
    /// # Errors
    /// If the arm does not reach there.
    pub fn joints(
        &self,
        rail_m: f64,
        near: &[f64; ARM_JOINTS],
    ) -> Result<[f64; ARM_JOINTS], KinematicsError> {
        inverse(&self.pose(rail_m), near)
    }

    /// Joints (rad) `up_m` above the middle of the path: where the arm can come and go without
    /// touching the keyboard.
    ///
    /// # Errors
    /// If the arm does not reach there.
    pub fn above_middle(&self, up_m: f64) -> Result<[f64; ARM_JOINTS], KinematicsError> {
        let mut pose = self.pose(self.points[1].0);
        pose.position_m.z += up_m;
        inverse(&pose, &self.middle)
    }

    /// Joints (rad) straight above where the arm stands with these, `up_m` above the height of the
    /// path there.
    ///
    /// # Errors
    /// If the arm does not reach there.
    pub fn above(
        &self,
        joints_rad: &[f64; ARM_JOINTS],
        up_m: f64,
    ) -> Result<[f64; ARM_JOINTS], KinematicsError> {
        let mut pose = forward(joints_rad);
        pose.position_m.z = self.pose(self.place(joints_rad).rail_m).position_m.z + up_m;
        inverse(&pose, joints_rad)
    }

    /// Cosine of the angle between the palm's normal and straight down for these joints of the arm:
    /// on the path the palm faces down.
    pub fn palm_down(&self, joints_rad: &[f64; ARM_JOINTS]) -> f64 {
        let up = |pose: &Pose| pose.rotation.inverse() * Vector3::z();
        up(&forward(joints_rad)).dot(&up(&self.orientation))
    }

    /// Where the hand is for these joints of the arm.
    pub fn place(&self, joints_rad: &[f64; ARM_JOINTS]) -> RailPlace {
        let pose = forward(joints_rad);
        let [low, middle, high] = &self.points;
        let along = |from: &(f64, Vector3<f64>), to: &(f64, Vector3<f64>)| {
            let along = to.1 - from.1;
            from.0 + (to.0 - from.0) * (pose.position_m - from.1).dot(&along) / along.norm_squared()
        };
        let (lower, upper) = (along(low, middle), along(middle, high));
        let rail_m = if lower < middle.0 { lower } else { upper.max(middle.0) };
        RailPlace {
            rail_m,
            beside_m: (pose.position_m - self.pose(rail_m).position_m).norm(),
            turned_rad: turned_rad(&pose, &self.orientation),
        }
    }
}

/// Angle between the orientations of two poses, rad. The arc cosine of the trace would be no number
/// where rounding brings it above 1, which is where the poses agree best.
fn turned_rad(pose: &Pose, other: &Pose) -> f64 {
    logarithm(&(pose.rotation * other.rotation.inverse())).norm()
}

#[cfg(test)]
mod tests {
    use super::super::file::papers;
    use super::*;
    use crate::xarm::kinematics::PAPER_HOME_DEG;

    fn home() -> [f64; ARM_JOINTS] {
        PAPER_HOME_DEG.map(f64::to_radians)
    }

    #[test]
    fn the_papers_path_has_the_joints_of_an_independent_program() {
        let path = RailPath::new(&papers(), [-0.3393, 0.3337], &home()).unwrap();
        // Degrees, from an independent program. The redundant joint depends on the way there.
        let rows = [
            (0.0, [-0.48, 23.04, 0.10, 50.14, 179.56, 62.90, -224.84]),
            (-0.3393, [23.56, 39.75, 16.95, 74.83, 219.55, 67.36, -255.95]),
            (0.3337, [-23.98, 39.28, -16.43, 74.78, 140.13, 66.93, -194.06]),
        ];
        for (rail_m, degrees) in rows {
            let mut joints = *path.middle();
            for step in 1..=40 {
                joints = path.joints(rail_m * f64::from(step) / 40.0, &joints).unwrap();
            }
            for (found, expected) in joints.iter().zip(degrees) {
                assert!((found.to_degrees() - expected).abs() < 0.3, "{joints:?} at {rail_m}");
            }
            let place = path.place(&joints);
            assert!((place.rail_m - rail_m).abs() < 1e-6 && place.beside_m < 1e-6, "{place:?}");
            assert!(place.turned_rad < 1e-6, "{place:?}");
        }
        let above = path.above_middle(0.08).unwrap();
        assert!((path.place(&above).beside_m - 0.08).abs() < 1e-3);
    }

    #[test]
    fn what_does_not_fit_the_keyboard_is_refused() {
        let refused = |change: &dyn Fn(&mut Calibration)| {
            let mut calibration = papers();
            change(&mut calibration);
            RailPath::new(&calibration, [-0.3393, 0.3337], &home()).unwrap_err().to_string()
        };
        assert!(refused(&|c| c.points.truncate(2)).contains("2 of its three"));
        assert!(refused(&|c| c.points[0].position_mm[1] = 300.0).contains("mm apart"));
        assert!(refused(&|c| c.points[2].orientation_deg[0] = -80.0).contains("turned by 10"));
        assert!(refused(&|c| c.points[1].position_mm[0] = f64::NAN).contains("apart"));
        let exchanged = refused(&|c| {
            let low = c.points[0].position_mm;
            c.points[0].position_mm = c.points[2].position_mm;
            c.points[2].position_mm = low;
        });
        assert!(exchanged.contains("exchanged") || exchanged.contains("mm apart"), "{exchanged}");
        // Where the distances are the same they do not show it.
        let mirrored = refused(&|c| c.points.iter_mut().for_each(|p| p.position_mm[1] *= -1.0));
        assert!(mirrored.contains("exchanged"), "{mirrored}");
        let far = refused(&|c| c.points.iter_mut().for_each(|p| p.position_mm[0] = 900.0));
        assert!(far.contains("m along the keyboard"), "{far}");
    }

    #[test]
    fn a_hand_that_is_not_turned_at_all_is_seen_not_to_be() {
        let path = RailPath::new(&papers(), [-0.3393, 0.3337], &home()).unwrap();
        let mut joints = *path.middle();
        for step in -300..=300 {
            joints = path.joints(f64::from(step) * 1e-3, &joints).unwrap();
            let place = path.place(&joints);
            assert!(place.turned_rad < 1e-6 && place.beside_m < 1e-6, "{place:?}");
        }
    }

    /// A joint move of these few centimetres is straight enough beside the keys.
    #[test]
    fn straight_up_is_straight_up() {
        let path = RailPath::new(&papers(), [-0.3393, 0.3337], &home()).unwrap();
        for (rail_m, forward_m, up_m) in
            [(0.0, 0.0, 0.0), (-0.3, -0.1, 0.02), (0.3, 0.1, -0.03), (0.1, -0.14, 0.05)]
        {
            let mut pose = path.pose(rail_m);
            (pose.position_m.x, pose.position_m.z) =
                (pose.position_m.x + forward_m, pose.position_m.z + up_m);
            let mut from = *path.middle();
            for step in 1..=40 {
                from = path.joints(rail_m * f64::from(step) / 40.0, &from).unwrap();
            }
            let from = inverse(&pose, &from).unwrap();
            let to = path.above(&from, 0.08).unwrap();
            let mut lowest = pose.position_m.z;
            for step in 0..=100 {
                let share = f64::from(step) / 100.0;
                let at =
                    forward(&std::array::from_fn(|joint| from[joint] + (to[joint] - from[joint]) * share));
                let aside = (at.position_m - pose.position_m).xy().norm();
                assert!(aside < 0.006, "{aside} m aside from {rail_m}, {forward_m}, {up_m}");
                assert!(at.position_m.z >= lowest - 1e-4, "it goes down from {rail_m}, {forward_m}, {up_m}");
                lowest = at.position_m.z;
            }
            assert!((lowest - path.pose(rail_m).position_m.z - 0.08).abs() < 1e-3);
        }
    }
}
