//! The state of the hand's driver, and the data received since the last start.

use std::time::Duration;

use super::assembly::Assembly;
use super::config::HandConfig;
use super::encoder::Encoder;
use super::fault::HandFault;
use super::frame_rate::FrameRate;
use super::limits::WIRE_JOINTS;
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
#[derive(Clone, Debug, Default)]
pub(super) struct Known {
    pub assembly: Assembly,
    pub encoders: [Encoder; WIRE_JOINTS],
    pub finger_at: [Option<Duration>; 4],
    pub frame_rate: FrameRate,
    pub positions_at: Option<Duration>,
    pub information: Option<(Duration, Information)>,
    pub serial: Option<Serial>,
    /// When the temperature of each finger was asked for, until the reply.
    pub asked: [Option<Duration>; 4],
    /// Replies in a row that came late.
    pub late_replies: u32,
    /// When another program first sent a command that moves nothing.
    pub other_since: Option<Duration>,
    pub servo_was_on: bool,
    /// The hand's own watchdog may still report the time before the start.
    pub host_timeout_cleared: bool,
}

impl Known {
    pub fn nothing(config: &HandConfig) -> Self {
        let period = Duration::from_millis(u64::from(config.period_ms));
        Self { assembly: Assembly::new(period), ..Self::default() }
    }
}
