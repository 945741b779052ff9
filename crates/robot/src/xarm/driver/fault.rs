//! Faults of the arm, each with what the operator does next.

use std::time::Duration;

use crate::xarm::errors::controller_error;
use crate::xarm::kinematics::KinematicsError;
use crate::xarm::safety_box::OutsideBox;

/// Why a target was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TargetError {
    /// A joint is not a number.
    #[error("it holds a value that is not a number")]
    NotFinite,
    /// A joint is beyond its limit.
    #[error(transparent)]
    BeyondLimit(KinematicsError),
    /// The flange would be outside its box.
    #[error(transparent)]
    OutsideBox(OutsideBox),
    /// A joint would have to be too fast.
    #[error("joint {joint} would need {needed_rad_s:.2} rad/s, allowed are {allowed_rad_s:.2}")]
    JointTooFast {
        /// Which joint, counted from 1.
        joint: usize,
        /// Speed from the target before to this one, rad/s.
        needed_rad_s: f64,
        /// Largest allowed speed, rad/s.
        allowed_rad_s: f64,
    },
    /// The flange would have to be too fast.
    #[error("the flange would need {needed_m_s:.2} m/s, allowed are {allowed_m_s:.2}")]
    FlangeTooFast {
        /// Speed from the target before to this one, m/s.
        needed_m_s: f64,
        /// Largest allowed speed, m/s.
        allowed_m_s: f64,
    },
}

/// Why the arm was stopped. It stays so until it is started again.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ArmFault {
    /// A request was not answered in time.
    #[error(
        "the arm did not answer \"{register}\" in time: check that nothing else uses the network to it, then start again"
    )]
    ReplyTimeout {
        /// What was asked for.
        register: &'static str,
    },
    /// Reports stopped coming.
    #[error(
        "no new report has come from the arm (none, or the same one again): check cable and switch; if they are sound, switch the arm's control box off and on; then connect and start again"
    )]
    ReportStale,
    /// Reports come, but ever later.
    #[error(
        "the arm's reports come {} ms later than before: connect its control box by cable, close other programs, then start again",
        by.as_millis()
    )]
    ReportsLate {
        /// How much.
        by: Duration,
    },
    /// The controller stopped the arm.
    #[error("the arm's controller reports {}", describe(*.code))]
    Controller {
        /// Its error; `None` until it has been asked for.
        code: Option<u8>,
    },
    /// The arm is not in the commanded state or mode.
    #[error(
        "the arm is in state {state}, mode {mode}, which this program did not request: \
         close UFACTORY Studio, check the arm, then start again"
    )]
    UnexpectedState {
        /// State of the arm (ufactory_docs, states and modes).
        state: u8,
        /// Mode of the arm.
        mode: u8,
    },
    /// The arm replied that it is not ready to move.
    #[error(
        "the arm has stopped taking targets, which this program did not request: \
         close UFACTORY Studio, check the arm, then start again"
    )]
    NotReady,
    /// A joint is not where it was sent.
    #[error("joint {joint} is {by_rad:.2} rad from where it was sent: see what blocks it, then start again")]
    NotFollowing {
        /// Which joint, counted from 1.
        joint: usize,
        /// How far it is off, rad.
        by_rad: f64,
    },
    /// The replies come so late that too few targets are on time.
    #[error(
        "{:.0} % of the arm's replies took more than {} ms: connect its control box by cable, close other programs, then start again",
        100.0 * share,
        gap.as_secs_f64() * 1e3
    )]
    LateReplies {
        /// Share of the last replies that came too late.
        share: f64,
        /// How late.
        gap: Duration,
    },
    /// A target was refused, and nothing was sent.
    #[error(
        "a target for the arm was refused: {0}; slow the motion down or correct its path, then start again"
    )]
    RefusedTarget(TargetError),
    /// The arm stands outside its box.
    #[error(
        "the arm cannot start here: {0}; guide it inside with UFACTORY Studio, or correct arm.box_mm, then start again"
    )]
    OutsideBox(OutsideBox),
    /// The controller refused a command.
    #[error(
        "the arm's controller refused \"{register}\": update its firmware, check the config, then start again"
    )]
    CommandRejected {
        /// Which command.
        register: &'static str,
    },
    /// The connection is gone.
    #[error("the connection to the arm is lost: check cable and control box, connect and start again")]
    Disconnected,
    /// The other side does not use the xArm7's protocol.
    #[error(
        "the device at this address does not use the xArm7's protocol ({0}): check the address, connect and start again"
    )]
    ProtocolNonsense(&'static str),
}

fn describe(code: Option<u8>) -> String {
    match code {
        Some(code) => format!("error {}", controller_error(code)),
        None => "an error without its number: read it in UFACTORY Studio, then start again".into(),
    }
}

/// What the arm is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ArmState {
    /// There is no connection.
    Disconnected,
    /// Changing to `Ready` or `Manual`.
    Starting,
    /// Follows targets.
    Ready,
    /// Guided by hand.
    Manual,
    /// Connected; stopped, or not started yet.
    Stopped,
    /// Stopped because of a fault.
    Fault(ArmFault),
}

/// A call came at the wrong time or with the wrong values.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ArmError {
    /// The arm is doing something else.
    #[error("the arm is not ready for this ({0:?}): wait until it is, or start it again")]
    NotNow(ArmState),
    /// The call made the arm stop.
    #[error(transparent)]
    Fault(#[from] ArmFault),
}
