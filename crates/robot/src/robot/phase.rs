//! What a robot is doing.

/// What the robot is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It was not started yet.
    Off,
    /// The devices are starting.
    Starting,
    /// It stands still and holds its pose.
    Holding,
    /// It moves slowly to a pose.
    Moving,
    /// It follows a stream.
    Following,
    /// It was stopped on request.
    Stopped,
    /// It was stopped by a fault.
    Fault,
}

impl Phase {
    /// Its name in messages and recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Starting => "starting",
            Self::Holding => "holding",
            Self::Moving => "moving",
            Self::Following => "following",
            Self::Stopped => "stopped",
            Self::Fault => "stopped by a fault",
        }
    }
}
