//! Calibration of a rig: the arm is shown three keys, one at a time, and the result is tried.

use etude_music::LOWEST_PITCH;
use etude_robot::calibration::{Calibration, CalibrationError, Point, RailPath};
use etude_robot::hand_guiding::GuidedPose;
use etude_robot::rig_file::RigConfig;
use etude_stage::geometry::key_lateral;
use etude_twin::SHOWN_KEYS;

use super::rig_choice::unix_secs;

/// Stores in the rig's calibration that the middle finger is over `key` when the arm is as `shown`.
/// A calibration of another arm is replaced.
///
/// # Errors
/// If the file cannot be read or written.
pub fn store_point(rig: &RigConfig, key: usize, shown: &GuidedPose) -> Result<Calibration, CalibrationError> {
    let mut calibration = match Calibration::load(&rig.calibration) {
        Ok(known) if known.rig == rig.name && known.arm_serial == shown.serial => known,
        Ok(_) | Err(CalibrationError::Missing { .. }) => {
            Calibration { rig: rig.name.clone(), arm_serial: shown.serial.clone(), ..Calibration::default() }
        }
        Err(error) => return Err(error),
    };
    calibration.show(Point::at(pitch(key), key_lateral(key), &shown.joints_rad, unix_secs()));
    calibration.save(&rig.calibration)?;
    Ok(calibration)
}

/// MIDI numbers of the keys that are still to be shown.
pub fn pitches_to_show(calibration: &Calibration) -> Vec<u8> {
    let is_shown = |pitch: &u8| calibration.points.iter().any(|point| point.pitch == *pitch);
    SHOWN_KEYS.map(pitch).into_iter().filter(|pitch| !is_shown(pitch)).collect()
}

fn pitch(key: usize) -> u8 {
    LOWEST_PITCH + key as u8
}

/// Tries whether the arm reaches the whole keyboard by this calibration, starting from where it is.
///
/// # Errors
/// If it does not, or the points do not lie as the keys do.
pub fn try_path(rig: &RigConfig, place: &Calibration, near: &[f64; 7]) -> Result<(), CalibrationError> {
    RailPath::new(place, rig.limits.rail_range_m, near).map(|_| ())
}
