//! Where the keyboard stands before the arm, and with it the way from the policy's one rail to seven joint angles.
//!
//! An operator guides the hand to three keys and each time the arm's pose is kept: the paper's C1, C3 and C5. Between
//! them the flange moves on straight lines with a fixed orientation (fact sheet "hardware" §0).

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::xarm::kinematics::{JOINTS, KinematicsError, Pose, forward, inverse, logarithm};

/// Version of the file.
const SCHEMA: u32 = 1;
/// Largest relative difference between the distance of two points on the rail and that of their poses.
const LENGTH_TOLERANCE: f64 = 0.02;
/// Largest difference between the orientations of the points and the one that is kept, rad.
const TURN_TOLERANCE: f64 = 0.05;
/// Distance of the places at which a path is tried before it is used, m.
const TRIAL_STEP_M: f64 = 0.01;
const DAY_SECS: u64 = 24 * 60 * 60;

/// One place that the operator showed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Which key the middle finger was over: MIDI number.
    pub pitch: u8,
    /// Where that is on the rail, m: 0 in the middle of the keyboard, positive toward the high notes.
    pub rail_m: f64,
    /// Flange position in the frame of the arm's base, mm, as the arm's own software shows it.
    pub position_mm: [f64; 3],
    /// Flange orientation: roll, pitch, yaw about the fixed axes, degrees.
    pub orientation_deg: [f64; 3],
    /// When it was shown: seconds since 1970.
    pub shown_unix_secs: u64,
}

impl Point {
    /// The point at which the arm's joints (rad) are now.
    pub fn at(pitch: u8, rail_m: f64, joints_rad: &[f64; JOINTS], shown_unix_secs: u64) -> Self {
        let pose = forward(joints_rad);
        Self {
            pitch,
            rail_m,
            position_mm: (pose.position_m * 1e3).into(),
            orientation_deg: pose.rpy_rad().map(f64::to_degrees),
            shown_unix_secs,
        }
    }

    fn pose(&self) -> Pose {
        Pose::from_rpy(
            self.position_mm.map(|millimetres| millimetres * 1e-3),
            self.orientation_deg.map(f64::to_radians),
        )
    }
}

/// The keyboard's place, as it is kept in a file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Version of the file.
    pub schema: u32,
    /// Name of the rig that it belongs to.
    pub rig: String,
    /// Serial number of the arm.
    pub arm_serial: String,
    /// The places, from low to high notes.
    pub points: Vec<Point>,
}

/// The keyboard's place is not known well enough to move.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// There is no file yet.
    #[error("{path} is not there; show the arm where the keyboard is with `etude robot calibrate`")]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// It cannot be read or written.
    #[error("cannot use the calibration {path}: {message}")]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        message: String,
    },
    /// It belongs to another rig.
    #[error(
        "the calibration is of the rig `{found}`, and this is `{expected}`; make one for this rig with `etude robot calibrate`"
    )]
    OtherRig {
        /// Rig in the file.
        found: String,
        /// Rig at hand.
        expected: String,
    },
    /// It is too old to be trusted.
    #[error(
        "the calibration is {days} days old and the rig allows {allowed}; calibrate anew with `etude robot calibrate`"
    )]
    OutOfDate {
        /// Its age.
        days: u64,
        /// What the rig's file allows.
        allowed: u64,
    },
    /// It was made after today.
    #[error(
        "a point of the calibration is dated {days} days after today: set this computer's clock, then calibrate anew \
         with `etude robot calibrate`"
    )]
    FromTheFuture {
        /// How far ahead.
        days: u64,
    },
    /// Points are missing.
    #[error("the calibration has {0} of its three points; show the others with `etude robot calibrate`")]
    Unfinished(usize),
    /// The points do not lie as the keys do.
    #[error("{0}; show the keys again with `etude robot calibrate`")]
    Crooked(String),
    /// The arm does not reach a part of the keyboard.
    #[error("at {rail_m:+.3} m along the keyboard: {source}")]
    OutOfReach {
        /// Where.
        rail_m: f64,
        /// Why.
        source: KinematicsError,
    },
}

impl Calibration {
    /// Reads the file.
    ///
    /// # Errors
    /// If it is not there, not readable, or of another version.
    pub fn load(path: &Path) -> Result<Self, CalibrationError> {
        let file = |message: String| CalibrationError::File { path: path.to_path_buf(), message };
        let text = std::fs::read_to_string(path).map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => CalibrationError::Missing { path: path.to_path_buf() },
            _ => file(error.to_string()),
        })?;
        let calibration: Self = toml::from_str(&text).map_err(|error| file(error.to_string()))?;
        if calibration.schema != SCHEMA {
            return Err(file(format!("it is version {}, and this Étude reads {SCHEMA}", calibration.schema)));
        }
        Ok(calibration)
    }

    /// Writes the file, all of it or nothing.
    ///
    /// # Errors
    /// If the folder is not writable or the disk is full.
    pub fn save(&self, path: &Path) -> Result<(), CalibrationError> {
        let file = |message: String| CalibrationError::File { path: path.to_path_buf(), message };
        let versioned = Self { schema: SCHEMA, ..self.clone() };
        let text = toml::to_string(&versioned).map_err(|error| file(error.to_string()))?;
        let mut scratch = path.as_os_str().to_owned();
        scratch.push(".partial");
        std::fs::write(&scratch, text)
            .and_then(|()| std::fs::rename(&scratch, path))
            .map_err(|error| file(error.to_string()))
    }

    /// Adds a point, in place of one for the same key.
    pub fn show(&mut self, point: Point) {
        self.points.retain(|known| known.pitch != point.pitch);
        self.points.push(point);
        self.points.sort_by_key(|known| known.pitch);
    }

    /// Whether it is this rig's, and all of it fresh.
    ///
    /// # Errors
    /// If it belongs to another rig, or a point is older than `allowed_days` or dated more than a day ahead. Whether the arm
    /// is the one that it was shown to, the controller checks when it starts.
    pub fn check(&self, rig: &str, now_unix_secs: u64, allowed_days: u64) -> Result<(), CalibrationError> {
        if self.rig != rig {
            let [found, expected] = [self.rig.clone(), rig.to_string()];
            return Err(CalibrationError::OtherRig { found, expected });
        }
        for point in &self.points {
            let days = point.shown_unix_secs.saturating_sub(now_unix_secs) / DAY_SECS;
            if days >= 1 {
                return Err(CalibrationError::FromTheFuture { days });
            }
            let days = now_unix_secs.saturating_sub(point.shown_unix_secs) / DAY_SECS;
            if days > allowed_days {
                return Err(CalibrationError::OutOfDate { days, allowed: allowed_days });
            }
        }
        Ok(())
    }
}

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
    middle: [f64; JOINTS],
    arm_serial: String,
}

impl RailPath {
    /// The path through the points of a calibration, tried over the whole `range` (m) of the rail, starting from joints
    /// `near` those of its middle.
    ///
    /// # Errors
    /// If the points do not lie as the keys do, or the arm does not reach everywhere.
    pub fn new(
        calibration: &Calibration,
        range: [f64; 2],
        near: &[f64; JOINTS],
    ) -> Result<Self, CalibrationError> {
        let found = calibration.points.len();
        let points: &[Point; 3] =
            calibration.points.as_slice().try_into().map_err(|_| CalibrationError::Unfinished(found))?;
        let [_, middle, _] = points;
        for pair in points.windows(2) {
            let along = pair[1].rail_m - pair[0].rail_m;
            let apart = (pair[1].pose().position_m - pair[0].pose().position_m).norm();
            let names = (pair[0].pitch, pair[1].pitch);
            if !(along > 0.0 && (apart / along - 1.0).abs() <= LENGTH_TOLERANCE) {
                return Err(CalibrationError::Crooked(format!(
                    "keys {} and {} are {:.1} mm apart, and the arm stood {:.1} mm apart at them",
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
                return Err(CalibrationError::Crooked(format!(
                    "at key {} the hand was turned by {:.1}° against the middle one",
                    point.pitch,
                    turned.to_degrees()
                )));
            }
        }
        let mut path = Self {
            points: points.map(|point| (point.rail_m, point.pose().position_m)),
            orientation: middle.pose(),
            middle: *near,
            arm_serial: calibration.arm_serial.clone(),
        };
        let reach = |rail_m: f64, near: &[f64; JOINTS]| {
            path.joints(rail_m, near).map_err(|source| CalibrationError::OutOfReach { rail_m, source })
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
    pub fn middle(&self) -> &[f64; JOINTS] {
        &self.middle
    }

    /// The pose of the flange at a place on the rail; beyond the outer points straight on.
    pub fn pose(&self, rail_m: f64) -> Pose {
        let [low, middle, high] = &self.points;
        let (from, to) = if rail_m < middle.0 { (low, middle) } else { (middle, high) };
        let share = (rail_m - from.0) / (to.0 - from.0);
        Pose { position_m: from.1 + (to.1 - from.1) * share, ..self.orientation }
    }

    /// Places on the rail (m), ends of `range` included, between which the way along it is straight.
    pub fn bends(&self, [low, high]: [f64; 2]) -> [f64; 3] {
        let [_, (middle, _), _] = self.points;
        [low, middle.max(low).min(high), high]
    }

    /// Joints (rad) that bring the hand to a place on the rail, on the way from joints `near` it.
    ///
    /// # Errors
    /// If the arm does not reach there.
    pub fn joints(&self, rail_m: f64, near: &[f64; JOINTS]) -> Result<[f64; JOINTS], KinematicsError> {
        inverse(&self.pose(rail_m), near)
    }

    /// Joints (rad) `up_m` above the middle of the path: where the arm can come and go without touching the keyboard.
    ///
    /// # Errors
    /// If the arm does not reach there.
    pub fn above_middle(&self, up_m: f64) -> Result<[f64; JOINTS], KinematicsError> {
        let mut pose = self.pose(self.points[1].0);
        pose.position_m.z += up_m;
        inverse(&pose, &self.middle)
    }

    /// Joints (rad) straight above where the arm stands with these, `up_m` above the height of the path there.
    ///
    /// # Errors
    /// If the arm does not reach there.
    pub fn above(&self, joints_rad: &[f64; JOINTS], up_m: f64) -> Result<[f64; JOINTS], KinematicsError> {
        let mut pose = forward(joints_rad);
        pose.position_m.z = self.pose(self.place(joints_rad).rail_m).position_m.z + up_m;
        inverse(&pose, joints_rad)
    }

    /// Where the hand is for these joints of the arm.
    pub fn place(&self, joints_rad: &[f64; JOINTS]) -> RailPlace {
        let pose = forward(joints_rad);
        let [low, middle, high] = &self.points;
        let along = |from: &(f64, Vector3<f64>), to: &(f64, Vector3<f64>)| {
            let way = to.1 - from.1;
            from.0 + (to.0 - from.0) * (pose.position_m - from.1).dot(&way) / way.norm_squared()
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

/// Angle between the orientations of two poses, rad. The arc cosine of the trace would be no number where rounding brings
/// it above 1, which is where the poses agree best.
fn turned_rad(pose: &Pose, other: &Pose) -> f64 {
    logarithm(&(pose.rotation * other.rotation.inverse())).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xarm::kinematics::PAPER_HOME_DEG;

    /// The paper's rig: C1, C3 and C5 (fact sheet §0), at the ends and the middle of 673 mm.
    fn papers() -> Calibration {
        let point = |pitch, rail_m, position_mm| Point {
            pitch,
            rail_m,
            position_mm,
            orientation_deg: [-90.0, 225.0, -90.0],
            shown_unix_secs: 1_000_000,
        };
        Calibration {
            schema: SCHEMA,
            rig: "paper".into(),
            arm_serial: "XS1304".into(),
            points: vec![
                point(36, -0.3393, [485.0, 336.5, 169.0]),
                point(60, 0.0, [485.0, -2.83, 170.51]),
                point(84, 0.3337, [485.0, -336.5, 172.0]),
            ],
        }
    }

    fn home() -> [f64; JOINTS] {
        PAPER_HOME_DEG.map(f64::to_radians)
    }

    #[test]
    fn the_papers_path_has_the_sheets_joints() {
        let path = RailPath::new(&papers(), [-0.3393, 0.3337], &home()).unwrap();
        // Fact sheet §2.12, degrees. What the seventh joint leaves free depends on the way there.
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

    #[test]
    fn it_is_kept_in_a_file_that_names_the_rig() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.toml");
        assert!(matches!(Calibration::load(&path), Err(CalibrationError::Missing { .. })));
        papers().save(&path).unwrap();
        let back = Calibration::load(&path).unwrap();
        assert_eq!(back, papers());
        let now = 1_000_000 + 8 * DAY_SECS;
        // The oldest point counts, and none may be from the future.
        let mut shown = papers();
        shown.points[0].shown_unix_secs = now;
        shown.points[2].shown_unix_secs = now + DAY_SECS - 1;
        assert!(matches!(shown.check("paper", now, 7), Err(CalibrationError::OutOfDate { days: 8, .. })));
        assert!(shown.check("paper", now, 8).is_ok());
        shown.points[2].shown_unix_secs = u64::MAX;
        assert!(matches!(shown.check("paper", now, 8), Err(CalibrationError::FromTheFuture { .. })));
        assert!(back.check("paper", now, 8).is_ok());
        assert!(matches!(back.check("paper", now, 7), Err(CalibrationError::OutOfDate { days: 8, .. })));
        assert!(matches!(back.check("lab", now, 8), Err(CalibrationError::OtherRig { .. })));
        std::fs::write(&path, "schema = 1\nrigg = 2").unwrap();
        assert!(matches!(Calibration::load(&path), Err(CalibrationError::File { .. })));
    }

    #[test]
    fn a_key_shown_again_replaces_its_point() {
        let mut calibration = papers();
        calibration.show(Point { rail_m: 0.01, ..calibration.points[1] });
        assert_eq!((calibration.points.len(), calibration.points[1].rail_m), (3, 0.01));
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
