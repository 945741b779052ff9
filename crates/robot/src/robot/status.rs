//! What a robot is doing, why it was stopped, and what it records.

use std::time::Duration;

use super::fault::{Fault, Refused};
use super::record::{Journal, Record};

/// Time after a release in which the hand is still observed, for recordings.
pub const OBSERVED: Duration = Duration::from_secs(1);

/// What the robot is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// It was not started yet.
    #[default]
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

/// The phase, the fault that ended it, and the journal of both.
#[derive(Debug, Default)]
pub(super) struct Status {
    phase: Phase,
    pub fault: Option<Fault>,
    pub journal: Journal,
    /// When the hand was released last, and first since the start.
    pub released_at: Duration,
    pub first_released_at: Option<Duration>,
}

impl Status {
    pub fn phase(&self) -> Phase {
        self.phase
    }

    pub fn enter(&mut self, now: Duration, phase: Phase) {
        if self.phase != phase {
            self.phase = phase;
            self.note(now, "phase", phase.name().to_string());
        }
    }

    pub fn note(&mut self, now: Duration, kind: &'static str, text: String) {
        self.journal.push(Record::Note { at: now, kind, text });
    }

    /// Refuses a request in any other phase.
    pub fn require(&self, phase: Phase) -> Result<(), Refused> {
        let remedy = match self.phase {
            Phase::Off | Phase::Stopped => "start it first",
            Phase::Fault => "remove the cause, then start it again",
            Phase::Starting => "wait until it holds",
            Phase::Holding | Phase::Moving | Phase::Following => "wait until it stands still",
        };
        if self.phase == phase { Ok(()) } else { Err(Refused::Phase { phase: self.phase.name(), remedy }) }
    }

    /// Whether torques are on.
    pub fn is_live(&self) -> bool {
        matches!(self.phase, Phase::Holding | Phase::Moving | Phase::Following)
    }

    /// Whether the devices must be connected.
    pub fn is_used(&self) -> bool {
        self.is_live() || self.phase == Phase::Starting
    }

    /// Whether hand and arm were commanded to stop.
    pub fn is_released(&self) -> bool {
        matches!(self.phase, Phase::Stopped | Phase::Fault)
    }

    /// Whether the hand was released a short time ago, and still reports its angles.
    pub fn is_observed(&self, now: Duration) -> bool {
        self.is_released() && self.first_released_at.is_some_and(|at| now.saturating_sub(at) <= OBSERVED)
    }
}
