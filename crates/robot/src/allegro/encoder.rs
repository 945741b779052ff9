//! Rejects encoder readings that are impossible.
//!
//! Frames carry a checksum, so an impossible reading means a failing encoder and not a damaged
//! frame. The mechanical stops lie a little outside the limits in the URDF (the paper's code clips
//! up to 0.13 rad outside), and zeros differ from hand to hand: half a radian outside is
//! impossible. The highest speed in any source is 13 rad/s (allegro_hand_ros_v4); more than twice
//! that is impossible too, except where an adapter delivers two periods at once. A single
//! impossible reading is dropped and the last valid angle stays; several in a row are a fault.

use std::time::Duration;

use super::fault::HandFault;
use super::limits::{JOINT_LIMITS_RAD, rad_from_counts};

/// Beyond the limits of the URDF, rad.
const MARGIN_RAD: f64 = 0.5;
/// Fastest possible motion, rad/s.
const MAX_SPEED: f64 = 30.0;
/// Valid at any speed, rad: one period at 13 rad/s, delivered together with the one before.
const MAX_STEP_RAD: f64 = 0.05;
/// Impossible readings in a row that make a fault.
const MAX_REJECTED: u8 = 3;

/// One joint's encoder.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Encoder {
    valid: Option<(Duration, f64)>,
    rejected: u8,
}

impl Encoder {
    /// The last valid angle, rad.
    pub fn rad(&self) -> Option<f64> {
        self.valid.map(|(_, rad)| rad)
    }

    /// Takes a reading of the flat joint `joint`; one that is impossible is dropped.
    ///
    /// # Errors
    /// If the last readings were all impossible.
    pub fn take(&mut self, now: Duration, joint: usize, counts: i16) -> Result<(), HandFault> {
        let rad = rad_from_counts(counts);
        let [lower, upper] = JOINT_LIMITS_RAD.get(joint).copied().unwrap_or_default();
        let fault = if rad < lower - MARGIN_RAD || rad > upper + MARGIN_RAD {
            Some(HandFault::EncoderRange { joint, rad })
        } else if let Some((at, last)) = self.valid {
            let within = now.saturating_sub(at);
            let possible = MAX_STEP_RAD + MAX_SPEED * within.as_secs_f64();
            ((rad - last).abs() > possible).then_some(HandFault::EncoderJump {
                joint,
                jump_rad: rad - last,
                within,
            })
        } else {
            None
        };
        let Some(fault) = fault else {
            *self = Self { valid: Some((now, rad)), rejected: 0 };
            return Ok(());
        };
        self.rejected = self.rejected.saturating_add(1);
        if self.rejected >= MAX_REJECTED { Err(fault) } else { Ok(()) }
    }
}
