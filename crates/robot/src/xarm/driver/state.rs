//! The state of the arm's driver: its phase, its targets, and the request whose reply it waits for.

use std::time::Duration;

use etude_checks::RangeError;

use super::config::ArmConfig;
use super::fault::ArmFault;
use super::steps::{self, ArmVersion, Step};
use crate::xarm::codec::{FrameParser, Register, STOPPED};
use crate::xarm::delay_monitor::DelayMonitor;
use crate::xarm::kinematics::ARM_JOINTS;
use crate::xarm::link::Link;
use crate::xarm::report::{REPORT_PERIOD, Report, ReportParser};

/// The arm's driver.
#[derive(Debug)]
pub struct Arm {
    pub(super) config: ArmConfig,
    pub(super) phase: Phase,
    pub(super) protocol: u16,
    pub(super) transaction: u16,
    pub(super) outstanding: Option<Outstanding>,
    pub(super) commands: FrameParser,
    pub(super) reports: ReportParser,
    pub(super) report: Option<(Report, Duration)>,
    pub(super) report_delay: DelayMonitor,
    pub(super) version: Option<ArmVersion>,
    pub(super) serial: Option<String>,
    pub(super) halt: Option<Halt>,
    /// Whether the error number is still to be read.
    pub(super) ask_error: bool,
    /// The newest target.
    pub(super) target: Option<Target>,
    /// What was sent last, or where the arm was when it became ready.
    pub(super) sent: Option<Target>,
    pub(super) next_tick: Option<Duration>,
    pub(super) link: Link,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Target {
    pub joints: [f64; ARM_JOINTS],
    /// When it was given or sent; `None` for where the arm was standing.
    pub at: Option<Duration>,
}

/// The arm was commanded to stop, and its reports do not show it yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Halt {
    /// When the first stop was sent.
    pub since: Option<Duration>,
    /// When to repeat it.
    pub again: Duration,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Phase {
    Disconnected,
    Stopped,
    Working(Work),
    Ready,
    Manual,
    /// The flag says whether there still is a connection.
    Fault(ArmFault, bool),
}

/// A list of steps on the way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Work {
    pub steps: &'static [Step],
    pub at: usize,
    /// When the present step began.
    pub since: Duration,
    /// When its question may be asked again.
    pub ask_at: Duration,
}

impl Work {
    /// Whether the arm must not be in this state: a change of mode leads to state 5, and only a
    /// start begins at a stop.
    pub fn forbids(&self, state: u8) -> bool {
        state == STOPPED && self.steps != steps::START
    }
}

/// The request whose reply is awaited.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outstanding {
    pub transaction: u16,
    pub protocol: u16,
    pub register: Register,
    pub purpose: Purpose,
    pub at: Duration,
}

/// What a request is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Step,
    Target,
    /// Only the time until its reply matters.
    Link,
    Stop,
    WhichError,
}

impl Arm {
    /// A driver without a connection.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(config: ArmConfig) -> Result<Self, RangeError> {
        config.check()?;
        Ok(Self {
            link: Link::new(config.servo_period()),
            config,
            phase: Phase::Disconnected,
            protocol: 0,
            transaction: 0,
            outstanding: None,
            commands: FrameParser::default(),
            reports: ReportParser::default(),
            report: None,
            report_delay: DelayMonitor::new(REPORT_PERIOD),
            version: None,
            serial: None,
            halt: None,
            ask_error: false,
            target: None,
            sent: None,
            next_tick: None,
        })
    }
}
