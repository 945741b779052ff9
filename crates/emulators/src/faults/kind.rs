//! The kinds of faults that can be ordered, their names, and their effect on the emulated devices.

use std::fmt;
use std::mem::discriminant;
use std::str::FromStr;
use std::time::Duration;

use etude_robot::allegro::{DeviceId, HostMessage, WIRE_JOINTS};
use serde::{Deserialize, Serialize};

use crate::{Devices, HandEmulatorConfig};

/// Codes of the arm's emergency buttons (xArm user manual), which stay pressed until they are
/// released.
const BUTTONS: std::ops::RangeInclusive<u8> = 1..=3;

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum FaultKind {
    /// The hand's bus is in bus-off: its controller reports it, and nothing is sent or received.
    CanBusOff,
    /// The hand's bus carries nothing, and no error is reported.
    CanSilent,
    /// A finger's positions (0 index … 3 thumb) are lost.
    FingerSilent(u8),
    /// The arm's controller raises this error.
    ArmError(u8),
    /// The arm's emergency stop is pressed: error 1.
    Estop,
    /// The arm's connections end.
    ArmDisconnect,
    /// The arm executes commands without a reply.
    ArmSilent,
    /// The arm's reports stop.
    ArmMute,
    /// The arm's joints are blocked.
    ArmStuck,
    /// Another client stops the arm: state 4.
    ArmStopped,
    /// The keyboard's plug is out.
    KeyboardUnplugged,
    /// The keyboard's bytes are lost, and no error is reported.
    KeyboardSilent,
    /// Temperature of a finger's joints (0 index … 3 thumb), °C.
    HandHot(u8, u8),
    /// Temperature of the hand's board, °C.
    BoardHot(u8),
    /// These bits of the hand's status are set.
    HandFault(u8),
    /// The hand's servo is switched off.
    HandOff,
    /// The encoder of this joint of the hand counts in the wrong direction.
    JointReversed(u8),
    /// The motor of this joint of the hand has no torque.
    JointDead(u8),
}

/// A kind: its name, an example of its value if it has one, and what makes the fault of a value.
pub(crate) type Row = (&'static str, &'static str, fn(&str) -> Option<FaultKind>);

fn none(value: &str, kind: FaultKind) -> Option<FaultKind> {
    value.is_empty().then_some(kind)
}

fn finger(value: &str) -> Option<u8> {
    value.parse().ok().filter(|finger| *finger <= 3)
}

fn joint(value: &str) -> Option<u8> {
    value.parse().ok().filter(|joint| usize::from(*joint) < WIRE_JOINTS)
}

/// Every kind, once.
pub(crate) const KINDS: [Row; 18] = [
    ("can-bus-off", "", |value| none(value, FaultKind::CanBusOff)),
    ("can-silent", "", |value| none(value, FaultKind::CanSilent)),
    ("finger-silent", "1", |value| Some(FaultKind::FingerSilent(finger(value)?))),
    ("arm-error", "31", |value| value.parse().ok().filter(|code| *code > 0).map(FaultKind::ArmError)),
    ("estop", "", |value| none(value, FaultKind::Estop)),
    ("arm-disconnect", "", |value| none(value, FaultKind::ArmDisconnect)),
    ("arm-silent", "", |value| none(value, FaultKind::ArmSilent)),
    ("arm-mute", "", |value| none(value, FaultKind::ArmMute)),
    ("arm-stuck", "", |value| none(value, FaultKind::ArmStuck)),
    ("arm-stopped", "", |value| none(value, FaultKind::ArmStopped)),
    ("keyboard-unplugged", "", |value| none(value, FaultKind::KeyboardUnplugged)),
    ("keyboard-silent", "", |value| none(value, FaultKind::KeyboardSilent)),
    ("hand-hot", "2:70", |value| {
        let (number, celsius) = value.split_once(':')?;
        Some(FaultKind::HandHot(finger(number)?, celsius.parse().ok()?))
    }),
    ("board-hot", "80", |value| value.parse().ok().map(FaultKind::BoardHot)),
    ("hand-fault", "4", |value| {
        // Bit 0 is no fault: it says that the servo is on.
        value.parse().ok().filter(|bits: &u8| *bits > 1 && bits.is_multiple_of(2)).map(FaultKind::HandFault)
    }),
    ("hand-off", "", |value| none(value, FaultKind::HandOff)),
    ("joint-reversed", "5", |value| Some(FaultKind::JointReversed(joint(value)?))),
    ("joint-dead", "5", |value| Some(FaultKind::JointDead(joint(value)?))),
];

/// The order of a fault is not valid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultError {
    /// No fault is called so, or it has another value.
    #[error("`{0}` is not a known fault; write one of {kinds}", kinds = kinds())]
    Kind(String),
    /// It is not `KIND[=VALUE]@SECS[+SECS]`.
    #[error(
        "`{0}` does not say when; write KIND[=VALUE]@SECS[+SECS]: seconds (0 to 86400) since the twin was switched \
         on, and for how many, as in can-bus-off@20+2; KIND[=VALUE] is one of {kinds}",
        kinds = kinds()
    )]
    When(String),
    /// It has a length, but faults of this kind are momentary.
    #[error("`{0}` has no duration; leave out +SECS (`for_secs` in a file)")]
    Moment(String),
}

/// Every kind with an example of its value.
fn kinds() -> String {
    let names = KINDS.map(|(name, example, _)| match example {
        "" => name.to_string(),
        example => format!("{name}={example}"),
    });
    names.join(", ")
}

fn set(joints: &mut [bool; WIRE_JOINTS], joint: u8, on: bool) {
    if let Some(is) = joints.get_mut(usize::from(joint)) {
        *is = on;
    }
}

impl FaultKind {
    /// One fault of every kind.
    pub fn examples() -> impl Iterator<Item = Self> {
        KINDS.into_iter().filter_map(|(_, example, read)| read(example))
    }

    /// Whether it lasts: others are over as soon as they have happened.
    pub fn lasts(self) -> bool {
        match self {
            Self::ArmError(code) => BUTTONS.contains(&code),
            Self::ArmStopped | Self::HandOff => false,
            _ => true,
        }
    }

    /// Begins on the devices.
    pub(crate) fn begin(self, devices: &mut Devices, now: Duration) {
        let hand = devices.hand.config_mut();
        match self {
            Self::ArmError(code) => devices.arm.inject_error(code),
            Self::Estop => devices.arm.inject_error(1),
            Self::ArmSilent => devices.arm.set_silent(true),
            Self::ArmMute => devices.arm.set_mute(true),
            Self::ArmStuck => devices.arm.set_stuck(true),
            Self::ArmStopped => {
                let other = devices.arm.connect();
                devices.arm.receive(now, other, &[0, 1, 0, 2, 0, 2, 12, 4]);
                devices.arm.disconnect(other);
            }
            Self::KeyboardUnplugged => devices.keyboard.unplug(),
            Self::HandHot(finger, celsius) => {
                let joints = hand.joint_celsius.iter_mut().skip(4 * usize::from(finger)).take(4);
                joints.for_each(|joint| *joint = celsius);
            }
            Self::BoardHot(celsius) => hand.board_celsius = celsius,
            Self::HandFault(bits) => hand.fault_bits |= bits,
            Self::HandOff => {
                let off = HostMessage::ServoOff.encode(DeviceId::default());
                devices.hand.receive(now, &off, &mut Vec::new());
            }
            Self::JointReversed(joint) => set(&mut hand.reversed, joint, true),
            Self::JointDead(joint) => set(&mut hand.dead, joint, true),
            Self::CanBusOff
            | Self::CanSilent
            | Self::FingerSilent(_)
            | Self::ArmDisconnect
            | Self::KeyboardSilent => {}
        }
    }

    /// Ends on the devices.
    pub(crate) fn end(self, devices: &mut Devices, now: Duration) {
        let cool = HandEmulatorConfig::default();
        let hand = devices.hand.config_mut();
        match self {
            Self::ArmError(_) | Self::Estop if BUTTONS.contains(&devices.arm.error()) => {
                devices.arm.inject_error(0)
            }
            Self::ArmSilent => devices.arm.set_silent(false),
            Self::ArmMute => devices.arm.set_mute(false),
            Self::ArmStuck => devices.arm.set_stuck(false),
            Self::KeyboardUnplugged => devices.keyboard.plug(now),
            Self::HandHot(..) => hand.joint_celsius = cool.joint_celsius,
            Self::BoardHot(_) => hand.board_celsius = cool.board_celsius,
            Self::HandFault(bits) => hand.fault_bits &= !bits,
            Self::JointReversed(joint) => set(&mut hand.reversed, joint, false),
            Self::JointDead(joint) => set(&mut hand.dead, joint, false),
            _ => {}
        }
    }
}

impl FromStr for FaultKind {
    type Err = FaultError;

    /// Reads `KIND[=VALUE]`.
    fn from_str(text: &str) -> Result<Self, FaultError> {
        let (name, value) = text.split_once('=').unwrap_or((text, ""));
        let row = KINDS.iter().find(|(known, ..)| *known == name);
        row.and_then(|(_, _, read)| read(value)).ok_or_else(|| FaultError::Kind(text.to_string()))
    }
}

impl fmt::Display for FaultKind {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_ours = |kind: FaultKind| discriminant(&kind) == discriminant(self);
        let row = KINDS.iter().find(|(_, example, read)| read(example).is_some_and(is_ours));
        out.write_str(row.map_or("", |(name, ..)| name))?;
        match self {
            Self::FingerSilent(value)
            | Self::ArmError(value)
            | Self::BoardHot(value)
            | Self::HandFault(value)
            | Self::JointReversed(value)
            | Self::JointDead(value) => {
                write!(out, "={value}")
            }
            Self::HandHot(finger, celsius) => write!(out, "={finger}:{celsius}"),
            _ => Ok(()),
        }
    }
}

impl TryFrom<String> for FaultKind {
    type Error = FaultError;

    fn try_from(text: String) -> Result<Self, FaultError> {
        text.parse()
    }
}

impl From<FaultKind> for String {
    fn from(kind: FaultKind) -> Self {
        kind.to_string()
    }
}
