//! The faults of the hand. A fault stays until an operator starts the hand again.

use std::time::Duration;

use super::messages::HandSide;

/// Why the driver released the hand.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum HandFault {
    /// No answer while starting.
    #[error("the hand does not answer: check its 12 V supply, the CAN cable, its terminator, and device_id")]
    NoInformation,
    /// No more answers while running.
    #[error(
        "the hand has not reported its state for {} ms and may still push with its last torque: use the hardware stop, \
         check the CAN cable, then start the hand again",
        age.as_millis()
    )]
    InformationStale {
        /// Since the last answer.
        age: Duration,
    },
    /// Another generation of the hand, whose torques and frames differ.
    #[error("this is an Allegro Hand of generation {generation}; this driver is for v4: connect a v4 hand")]
    WrongVersion {
        /// The reported generation.
        generation: u8,
    },
    /// The other hand.
    #[error("this is the {found} hand: connect the other one, or set hand.side = \"{found}\"")]
    WrongSide {
        /// The reported side.
        found: HandSide,
    },
    /// No positions, or too old ones.
    #[error(
        "no angles from finger {finger} for {} ms, and the hand may still push with its last torque: use the hardware \
         stop, check the CAN cable and the load of the bus, then restart",
        age.as_millis()
    )]
    PositionsStale {
        /// The finger that is silent for longest, as on the wire (0 index, 3 thumb).
        finger: usize,
        /// Since its last frame, or since the stream was asked for.
        age: Duration,
    },
    /// Torques, a servo command or other periods on the bus that this program has not sent.
    #[error("another program drives the hand: end it, then start again")]
    OtherProgram,
    /// The hand's replies, and so its positions, come late and without gaps.
    #[error(
        "the frames of the hand come {} ms late: connect its CAN adapter without a hub, end other programs on its bus, then start again",
        by.as_millis()
    )]
    FramesLate {
        /// From a question to its reply.
        by: Duration,
    },
    /// The board is too hot.
    #[error("the hand's board is at {celsius} °C, above {limit} °C: let it cool, then start again")]
    BoardHot {
        /// Its temperature.
        celsius: u8,
        /// The configured limit.
        limit: u8,
    },
    /// A joint is too hot.
    #[error("joint {joint} of the hand is at {celsius} °C, above {limit} °C: let it cool, then start again")]
    JointHot {
        /// The flat joint.
        joint: usize,
        /// Its temperature.
        celsius: u8,
        /// The configured limit.
        limit: u8,
    },
    /// The hand reports a fault of its own.
    #[error(
        "the hand reports a fault (status bits {bits:#04x}; 2 is heat, 4 internal, 8 no frames from us, \
         0x10 a hot palm): switch its supply off and on, then start again"
    )]
    Reported {
        /// Those bits of the status byte that are faults.
        bits: u8,
    },
    /// The servo is off although it was switched on.
    #[error(
        "the hand's servo is off although it was switched on: check the emergency stop and the 12 V supply"
    )]
    ServoOff,
    /// An angle that the mechanics cannot have.
    #[error(
        "joint {joint} reads {rad:.2} rad, far outside its stops: its encoder is wrong; do not run this hand"
    )]
    EncoderRange {
        /// The flat joint.
        joint: usize,
        /// What it reads.
        rad: f64,
    },
    /// Impossible angles among possible ones.
    #[error(
        "{percent} % of the last readings of joint {joint} are impossible, as {rad:.2} rad: its encoder or cable is loose, or a second hand answers under this number; look at it first"
    )]
    EncoderUnsteady {
        /// The flat joint.
        joint: usize,
        /// The last of them.
        rad: f64,
        /// Their share.
        percent: u8,
    },
    /// Two hands of the same number.
    #[error(
        "two hands answer on this bus under one number (device_id), and their angles are mixed: disconnect the other one, or give it another \
         number, then start again"
    )]
    TwoHands,
    /// An angle that the joint cannot have reached.
    #[error(
        "joint {joint} jumped by {jump_rad:.2} rad in {} ms: its encoder or cable is loose; look at it first",
        within.as_millis()
    )]
    EncoderJump {
        /// The flat joint.
        joint: usize,
        /// From the last valid angle.
        jump_rad: f64,
        /// Since the last valid angle.
        within: Duration,
    },
}
