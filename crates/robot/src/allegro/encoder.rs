//! Rejects encoder readings that are impossible.
//!
//! Frames carry a checksum, so an impossible reading means a failing encoder and not a damaged
//! frame. The mechanical stops lie a little outside the limits in the URDF (the paper's code clips
//! up to 0.13 rad outside), and zeros differ from hand to hand: half a radian outside is
//! impossible. The highest speed in any source is 13 rad/s (allegro_hand_ros_v4); more than twice
//! that is impossible too, except where an adapter delivers two periods at once. A single
//! impossible reading is dropped and the last valid angle stays; several in a row are a fault, and
//! so are many among good ones.

use std::time::Duration;

use super::fault::HandFault;
use super::limits::{JOINT_LIMITS_RAD, rad_from_counts};

/// Beyond the limits of the URDF, rad.
const MARGIN_RAD: f64 = 0.5;
/// Fastest possible motion, rad/s.
const MAX_SPEED: f64 = 30.0;
/// Valid at any speed, rad: one period at 13 rad/s, delivered together with the one before.
const MAX_STEP_RAD: f64 = 0.05;
/// Readings that have waited and are read at once were taken a period after each other.
const PERIOD_SECS: f64 = 0.003;
/// Impossible readings in a row that make a fault.
const MAX_REJECTED: u8 = 3;
/// Share of them among the last readings, of which each counts less than the next one by one part
/// in [`READINGS`], that is a fault too.
const MAX_SHARE: f64 = 0.1;
/// The readings of a third of a second.
const READINGS: f64 = 100.0;

/// One joint's encoder.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Encoder {
    valid: Option<(Duration, f64)>,
    rejected: u8,
    share: f64,
}

impl Encoder {
    /// The last valid angle, rad.
    pub fn rad(&self) -> Option<f64> {
        self.valid.map(|(_, rad)| rad)
    }

    /// The share of impossible readings among the last ones.
    pub fn impossible_share(&self) -> f64 {
        self.share
    }

    /// Takes a reading of the flat joint `joint`; one that is impossible is dropped.
    ///
    /// # Errors
    /// If the last readings were all impossible, or many of them.
    pub fn take(&mut self, now: Duration, joint: usize, counts: i16) -> Result<(), HandFault> {
        let rad = rad_from_counts(counts);
        let [lower, upper] = JOINT_LIMITS_RAD.get(joint).copied().unwrap_or_default();
        let fault = if rad < lower - MARGIN_RAD || rad > upper + MARGIN_RAD {
            Some(HandFault::EncoderRange { joint, rad })
        } else if let Some((at, last)) = self.valid {
            let within = now.saturating_sub(at);
            let possible = MAX_STEP_RAD + MAX_SPEED * within.as_secs_f64().max(PERIOD_SECS);
            ((rad - last).abs() > possible).then_some(HandFault::EncoderJump {
                joint,
                jump_rad: rad - last,
                within,
            })
        } else {
            None
        };
        self.share += (f64::from(u8::from(fault.is_some())) - self.share) / READINGS;
        let Some(fault) = fault else {
            (self.valid, self.rejected) = (Some((now, rad)), 0);
            return Ok(());
        };
        self.rejected = self.rejected.saturating_add(1);
        if self.rejected >= MAX_REJECTED {
            Err(fault)
        } else if self.share > MAX_SHARE {
            Err(HandFault::EncoderUnsteady { joint, rad, percent: (self.share * 100.0).round() as u8 })
        } else {
            Ok(())
        }
    }
}
