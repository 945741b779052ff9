//! The calibration's file: the keys that an operator has shown to the arm.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use atomic_write_file::AtomicWriteFile;
use serde::{Deserialize, Serialize};

use crate::xarm::kinematics::{ARM_JOINTS, Pose, forward};

/// Version of the file.
const SCHEMA: u32 = 1;
const DAY_SECS: u64 = 24 * 60 * 60;

/// One place that the operator showed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Which key the middle finger was over: MIDI number.
    pub pitch: u8,
    /// Where that is on the rail, m: 0 in the middle of the keyboard, positive toward the high
    /// notes.
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
    pub fn at(pitch: u8, rail_m: f64, joints_rad: &[f64; ARM_JOINTS], shown_unix_secs: u64) -> Self {
        let pose = forward(joints_rad);
        Self {
            pitch,
            rail_m,
            position_mm: (pose.position_m * 1e3).into(),
            orientation_deg: pose.rpy_rad().map(f64::to_degrees),
            shown_unix_secs,
        }
    }

    pub(super) fn pose(&self) -> Pose {
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
    #[error("{path} does not exist; show the arm where the keyboard is with `etude robot calibrate`")]
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
    /// It is another rig's, too old, unfinished, or does not fit the keys or the arm.
    #[error("{0}")]
    Unfit(String),
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
        let write = || {
            let mut file = AtomicWriteFile::open(path)?;
            file.write_all(text.as_bytes())?;
            file.commit()
        };
        write().map_err(|error: std::io::Error| file(error.to_string()))
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
    /// If it belongs to another rig, or a point is older than `allowed_days` or dated more than a
    /// day ahead. Whether the arm is the one that it was shown to, the controller checks when it
    /// starts.
    pub fn check(&self, rig: &str, now_unix_secs: u64, allowed_days: u64) -> Result<(), CalibrationError> {
        if self.rig != rig {
            return Err(CalibrationError::Unfit(format!(
                "the calibration is of the rig `{}`, and this is `{rig}`; make one for this rig with \
                 `etude robot calibrate`",
                self.rig
            )));
        }
        for point in &self.points {
            let days = point.shown_unix_secs.saturating_sub(now_unix_secs) / DAY_SECS;
            if days >= 1 {
                return Err(CalibrationError::Unfit(format!(
                    "a point of the calibration is dated {days} days after today: set this computer's clock, then calibrate \
                     again with `etude robot calibrate`"
                )));
            }
            let days = now_unix_secs.saturating_sub(point.shown_unix_secs) / DAY_SECS;
            if days > allowed_days {
                return Err(CalibrationError::Unfit(format!(
                    "the calibration is {days} days old and the rig allows {allowed_days}; calibrate again with \
                     `etude robot calibrate`"
                )));
            }
        }
        Ok(())
    }
}

/// A calibration with the points of the paper's rig, for tests: C1, C3 and C5, at the ends and the
/// middle of 673 mm.
#[cfg(test)]
pub(crate) fn papers() -> Calibration {
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

#[cfg(test)]
mod tests {
    use super::*;

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
        let refused = |calibration: &Calibration, rig: &str, days| {
            calibration.check(rig, now, days).unwrap_err().to_string()
        };
        assert!(refused(&shown, "paper", 7).contains("8 days old"));
        assert!(shown.check("paper", now, 8).is_ok());
        shown.points[2].shown_unix_secs = u64::MAX;
        assert!(refused(&shown, "paper", 8).contains("after today"));
        assert!(back.check("paper", now, 8).is_ok());
        assert!(refused(&back, "paper", 7).contains("8 days old"));
        assert!(refused(&back, "lab", 8).contains("of the rig `paper`"));
        std::fs::write(&path, "schema = 1\nrigg = 2").unwrap();
        assert!(matches!(Calibration::load(&path), Err(CalibrationError::File { .. })));
    }

    #[test]
    fn a_key_shown_again_replaces_its_point() {
        let mut calibration = papers();
        calibration.show(Point { rail_m: 0.01, ..calibration.points[1] });
        assert_eq!((calibration.points.len(), calibration.points[1].rail_m), (3, 0.01));
    }
}
