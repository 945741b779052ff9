//! The state of the hand's driver, and the data received since the last start.

use std::time::Duration;

use super::assembly::Assembly;
use super::config::HandConfig;
use super::encoder::Encoder;
use super::fault::HandFault;
use super::limits::JOINTS;
use super::messages::{Information, Serial};

/// The state of the driver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum HandState {
    /// Never started.
    #[default]
    Off,
    /// Asking, switching on, waiting for angles.
    Starting,
    /// Torques are sent.
    Ready,
    /// Released on request.
    Stopped,
    /// Released because of this fault, until it is started again.
    Fault(HandFault),
}

/// The result of a frame or of a poll.
#[must_use]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandEvent {
    /// Nothing to act on.
    Nothing,
    /// The positions of a period are complete: time for the joint loop.
    Positions,
}

/// Counts since the driver was created.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HandCounters {
    /// Frames of other devices, of no known kind, or while the driver does not listen.
    pub ignored: u64,
    /// Frames of a known kind with a wrong length or value.
    pub damaged: u64,
    /// Position frames that never came.
    pub lost: u64,
    /// Duplicates of position frames in one period.
    pub duplicates: u64,
    /// Encoder readings that were rejected.
    pub rejected: u64,
    /// Times that the driver sent zero because no torque was requested.
    pub unattended: u64,
}

/// How far the start has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Silence,
    Drain { until: Duration },
    Ask,
    SwitchOn,
    Wait { since: Duration },
}

/// What is known since the last start.
#[derive(Clone, Debug)]
pub(super) struct Known {
    pub assembly: Assembly,
    pub encoders: [Encoder; JOINTS],
    pub finger_at: [Option<Duration>; 4],
    pub positions_at: Option<Duration>,
    pub information: Option<(Duration, Information)>,
    pub serial: Option<Serial>,
    pub celsius: [Option<u8>; JOINTS],
    pub servo_was_on: bool,
    /// The hand's own watchdog may still report the time before the start.
    pub host_timeout_cleared: bool,
}

impl Known {
    pub fn nothing(config: &HandConfig) -> Self {
        Self {
            assembly: Assembly::new(Duration::from_millis(u64::from(config.period_ms))),
            encoders: [Encoder::default(); JOINTS],
            finger_at: [None; 4],
            positions_at: None,
            information: None,
            serial: None,
            celsius: [None; JOINTS],
            servo_was_on: false,
            host_timeout_cleared: false,
        }
    }
}
