//! The faults of the whole robot, and the reasons for which a request is refused.

use std::time::Duration;

use super::plausibility::Implausible;
use crate::allegro::{HandFault, StatusBits};
use crate::calibration::CalibrationError;
use crate::can::CanError;
use crate::keyboard::MidiError;
use crate::rig_file::RigError;
use crate::xarm::kinematics::KinematicsError;
use crate::xarm::{ArmError, ArmFault, ArmLinkError, OutsideBox};

/// What to do about an arm whose connection failed; nothing if none was ever there.
fn may_move(error: &ArmLinkError) -> &'static str {
    if error.is_unreached() { "" } else { ". It may still move or hold: use the hardware stop" }
}

/// Why the robot was stopped. It stays until an operator starts the robot again.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// A fault of the hand.
    #[error("hand: {0}")]
    Hand(#[from] HandFault),
    /// A fault of the arm.
    #[error("arm: {0}")]
    Arm(#[from] ArmFault),
    /// The keyboard is gone.
    #[error("keyboard: {0}")]
    Keyboard(String),
    /// The hand's bus failed.
    #[error("hand: {0}. It may still push with its last torque: use the hardware stop")]
    Can(#[from] CanError),
    /// The connection to the arm failed.
    #[error("arm: {0}{remedy}", remedy = may_move(.0))]
    ArmLink(#[from] ArmLinkError),
    /// A joint of the hand is not where it was sent.
    #[error(
        "joint {joint} of the hand is {by_rad:.2} rad from where it was sent: see what blocks it, and whether its motor \
         turns, then start again"
    )]
    NotFollowing {
        /// Which joint, as on the wire.
        joint: usize,
        /// How far it is off, rad.
        by_rad: f64,
    },
    /// A measurement cannot be right, or the robot is not where it was sent.
    #[error(transparent)]
    Implausible(#[from] Implausible),
    /// A joint of the hand begins where it must not be.
    #[error(
        "joint {joint} of the hand is at {rad:.2} rad, outside its range from {low} to {high}: bring it into its range \
         by hand, then start again; if it is there already, its encoder is wrong"
    )]
    OutsideRange {
        /// Which joint, as on the wire.
        joint: usize,
        /// Where it is, rad.
        rad: f64,
        /// Smallest allowed angle, rad.
        low: f64,
        /// Largest allowed angle, rad.
        high: f64,
    },
    /// The arm refused a request.
    #[error("arm: {0}")]
    ArmRefused(#[from] ArmError),
    /// The calibration is another arm's.
    #[error(
        "this is arm {found}, and the calibration was made with arm {expected}; calibrate again with `etude robot calibrate`"
    )]
    OtherArm {
        /// Serial number of the arm at hand.
        found: String,
        /// Serial number in the calibration.
        expected: String,
    },
    /// No command has come for too long.
    #[error(
        "no new command for {} ms: the policy is too slow or has stopped; close other programs on this machine",
        age.as_millis()
    )]
    StaleCommand {
        /// Since the last command ran out.
        age: Duration,
    },
    /// The arm cannot reach the set-point.
    #[error("at {rail_m:+.3} m on the rail: {source}")]
    Reach {
        /// The set-point.
        rail_m: f64,
        /// Why.
        source: KinematicsError,
    },
    /// A fault that comes soon after a stall of this program, and may come of it.
    #[error(
        "this program stood still for {} ms, then: {}; close other programs on this machine, and see the line `real time` of `etude doctor`",
        gap.as_millis(),
        fault.without_remedy()
    )]
    AfterStall {
        /// How long it stood still.
        gap: Duration,
        /// What came then.
        fault: Box<Fault>,
    },
    /// The controller was not polled for too long.
    #[error(
        "the controller did not run for {} ms, and the robot was not watched; close other programs on this machine, and see the line `real time` of `etude doctor`",
        gap.as_millis()
    )]
    Stalled {
        /// How long.
        gap: Duration,
    },
}

impl Fault {
    /// The fault itself, without the stall before it.
    pub fn itself(&self) -> &Self {
        match self {
            Self::AfterStall { fault, .. } => fault,
            other => other,
        }
    }

    /// What has happened, without what to do about it. Who was looked at last, and late, is not the
    /// one to be repaired.
    fn without_remedy(&self) -> String {
        let text = self.to_string();
        text.rsplit_once(": ").map_or_else(|| text.clone(), |(what, _)| what.to_string())
    }

    /// Whether this can come of a time in which the controller did not run: something is late, was
    /// not kept up, or has been stopped for that.
    pub(super) fn may_come_of_a_stall(&self) -> bool {
        match self {
            Self::Hand(fault) => match fault {
                HandFault::NoInformation
                | HandFault::InformationStale { .. }
                | HandFault::PositionsStale { .. }
                | HandFault::FramesLate { .. }
                | HandFault::EncoderJump { .. }
                | HandFault::EncoderUnsteady { .. }
                | HandFault::OtherProgram
                | HandFault::ServoOff => true,
                HandFault::Reported { bits } => *bits == StatusBits::HOST_TIMEOUT,
                _ => false,
            },
            Self::Arm(fault) => matches!(
                fault,
                ArmFault::ReplyTimeout { .. }
                    | ArmFault::ReportStale
                    | ArmFault::ReportsLate { .. }
                    | ArmFault::UnexpectedState { .. }
                    | ArmFault::NotReady
                    | ArmFault::NotFollowing { .. }
                    | ArmFault::LateReplies { .. }
                    | ArmFault::RefusedTarget(_)
            ),
            Self::Implausible(implausible) => {
                matches!(implausible, Implausible::ArmAway { .. } | Implausible::ArmOffPath { .. })
            }
            Self::NotFollowing { .. } | Self::StaleCommand { .. } => true,
            _ => false,
        }
    }
}

/// Why a request was not followed. Nothing has moved.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// The robot is not in a state for it.
    #[error("the robot is {phase}; {remedy}")]
    Phase {
        /// What it is doing.
        phase: &'static str,
        /// What to do first.
        remedy: &'static str,
    },
    /// The keyboard cannot be trusted.
    #[error("{0}; then start the robot again")]
    Keyboard(String),
    /// The goal is no pose.
    #[error("the goal for driven joint {joint} is not a finite number: check how it is computed")]
    NoPose {
        /// Which joint, in the order of the driven joints.
        joint: usize,
    },
    /// The arm's way there leads out of its box.
    #[error(
        "the arm's path home leaves its box: {0}; guide it nearer home with UFACTORY Studio, or enlarge arm.box_mm"
    )]
    OutsideBox(#[from] OutsideBox),
    /// A finger or the thumb is far from where the motion begins.
    #[error(
        "joint {joint} of the hand is at {measured_rad:.2} rad and the motion begins at {asked_rad:.2} rad: \
         `etude robot home` brings it there slowly"
    )]
    FingerFar {
        /// Which joint, as on the wire.
        joint: usize,
        /// Where it is.
        measured_rad: f64,
        /// Where it should be.
        asked_rad: f64,
    },
    /// The hand is far from where the motion begins.
    #[error(
        "the hand is {by_m:.3} m from where the motion begins: `etude robot home` brings it there slowly"
    )]
    RailFar {
        /// How far.
        by_m: f64,
    },
}

/// The robot cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// The rig's file is not sound.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The box of the arm does not hold what it needs.
    #[error("{place}: {source}; enlarge arm.box_mm, or narrow limits.rail_range_m")]
    OutsideBox {
        /// Where it is left.
        place: String,
        /// By how much.
        source: OutsideBox,
    },
    /// The keyboard's place is not known.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// The keyboard cannot be opened.
    #[error(transparent)]
    Midi(#[from] MidiError),
    /// The hand's bus cannot be opened.
    #[error(transparent)]
    Can(#[from] CanError),
    /// The arm cannot be reached.
    #[error(transparent)]
    ArmLink(#[from] ArmLinkError),
}
