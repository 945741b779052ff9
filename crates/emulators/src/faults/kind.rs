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

/// Every kind, once: its name, and an example of it.
pub(crate) const KINDS: [(&str, FaultKind); 18] = [
    ("can-bus-off", FaultKind::CanBusOff),
    ("can-silent", FaultKind::CanSilent),
    ("finger-silent", FaultKind::FingerSilent(1)),
    ("arm-error", FaultKind::ArmError(31)),
    ("estop", FaultKind::Estop),
    ("arm-disconnect", FaultKind::ArmDisconnect),
    ("arm-silent", FaultKind::ArmSilent),
    ("arm-mute", FaultKind::ArmMute),
    ("arm-stuck", FaultKind::ArmStuck),
    ("arm-stopped", FaultKind::ArmStopped),
    ("keyboard-unplugged", FaultKind::KeyboardUnplugged),
    ("keyboard-silent", FaultKind::KeyboardSilent),
    ("hand-hot", FaultKind::HandHot(2, 70)),
    ("board-hot", FaultKind::BoardHot(80)),
    ("hand-fault", FaultKind::HandFault(4)),
    ("hand-off", FaultKind::HandOff),
    ("joint-reversed", FaultKind::JointReversed(5)),
    ("joint-dead", FaultKind::JointDead(5)),
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
    KINDS.map(|(_, example)| example.to_string()).join(", ")
}

impl FaultKind {
    /// One fault of every kind.
    pub fn examples() -> impl Iterator<Item = Self> {
        KINDS.into_iter().map(|(_, example)| example)
    }

    /// Whether it lasts: others are over as soon as they have happened.
    pub fn lasts(self) -> bool {
        match self {
            Self::ArmError(code) => BUTTONS.contains(&code),
            Self::ArmStopped | Self::HandOff => false,
            _ => true,
        }
    }

    /// Begins on the devices, or ends.
    pub(crate) fn set(self, on: bool, devices: &mut Devices, now: Duration) {
        let sound = HandEmulatorConfig::default();
        let hand = devices.hand.config_mut();
        match self {
            Self::ArmError(code) if on => devices.arm.inject_error(code),
            Self::Estop if on => devices.arm.inject_error(1),
            Self::ArmError(_) | Self::Estop if BUTTONS.contains(&devices.arm.error()) => {
                devices.arm.inject_error(0);
            }
            Self::ArmSilent => devices.arm.set_silent(on),
            Self::ArmMute => devices.arm.set_mute(on),
            Self::ArmStuck => devices.arm.set_stuck(on),
            Self::ArmStopped if on => {
                let other = devices.arm.connect();
                devices.arm.receive(now, other, &[0, 1, 0, 2, 0, 2, 12, 4]);
                devices.arm.disconnect(other);
            }
            Self::KeyboardUnplugged if on => devices.keyboard.unplug(),
            Self::KeyboardUnplugged => devices.keyboard.plug(now),
            Self::HandHot(finger, celsius) => {
                let joints = hand.joint_celsius.iter_mut().zip(sound.joint_celsius).enumerate();
                let of_finger = joints.filter(|(joint, _)| joint / 4 == usize::from(finger));
                of_finger.for_each(|(_, (is, sound))| *is = if on { celsius } else { sound });
            }
            Self::BoardHot(celsius) => hand.board_celsius = if on { celsius } else { sound.board_celsius },
            Self::HandFault(bits) if on => hand.fault_bits |= bits,
            Self::HandFault(bits) => hand.fault_bits &= !bits,
            Self::HandOff if on => {
                let off = HostMessage::ServoOff.encode(DeviceId::default());
                devices.hand.receive(now, &off, &mut Vec::new());
            }
            Self::JointReversed(joint) => hand.reversed[usize::from(joint)] = on,
            Self::JointDead(joint) => hand.dead[usize::from(joint)] = on,
            // On the wires.
            _ => {}
        }
    }

    /// The fault of the same kind with this value.
    fn with(self, value: &str) -> Option<Self> {
        let number = || value.parse::<u8>().ok();
        let finger = |text: &str| text.parse().ok().filter(|finger| *finger <= 3);
        let joint = || number().filter(|joint| usize::from(*joint) < WIRE_JOINTS);
        match self {
            Self::FingerSilent(_) => finger(value).map(Self::FingerSilent),
            Self::ArmError(_) => number().filter(|code| *code > 0).map(Self::ArmError),
            Self::HandHot(..) => {
                let (number, celsius) = value.split_once(':')?;
                Some(Self::HandHot(finger(number)?, celsius.parse().ok()?))
            }
            Self::BoardHot(_) => number().map(Self::BoardHot),
            // Bit 0 is no fault: it says that the servo is on.
            Self::HandFault(_) => {
                number().filter(|bits| *bits > 1 && bits.is_multiple_of(2)).map(Self::HandFault)
            }
            Self::JointReversed(_) => joint().map(Self::JointReversed),
            Self::JointDead(_) => joint().map(Self::JointDead),
            plain => value.is_empty().then_some(plain),
        }
    }
}

impl FromStr for FaultKind {
    type Err = FaultError;

    /// Reads `KIND[=VALUE]`.
    fn from_str(text: &str) -> Result<Self, FaultError> {
        let (name, value) = text.split_once('=').unwrap_or((text, ""));
        let row = KINDS.iter().find(|(known, _)| *known == name);
        row.and_then(|(_, kind)| kind.with(value)).ok_or_else(|| FaultError::Kind(text.to_string()))
    }
}

impl fmt::Display for FaultKind {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let row = KINDS.iter().find(|(_, example)| discriminant(example) == discriminant(self));
        out.write_str(row.map_or("", |(name, _)| name))?;
        match self {
            Self::FingerSilent(value)
            | Self::ArmError(value)
            | Self::BoardHot(value)
            | Self::HandFault(value)
            | Self::JointReversed(value)
            | Self::JointDead(value) => write!(out, "={value}"),
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
