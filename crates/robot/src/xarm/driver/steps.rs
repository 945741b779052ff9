//! What is sent, one request after the other, to bring the arm from one condition to the next.
//!
//! A reply does not prove that a command was carried out, so each list ends by reading back state
//! and mode.

use crate::xarm::codec::Register;

/// One request, and how its reply is judged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Sends what the register needs; a reply that is not a refusal is enough.
    Tell(Register),
    /// Sets the mode.
    Mode(u8),
    /// Reads the version, and chooses the protocol.
    Version,
    /// Reads the serial number.
    Serial,
    /// Reads back the box: it must be the one that was set, and watched.
    ReadBox,
    /// Reads the error: there must be none.
    NoError,
    /// Reads the state: another client may have stopped the arm, and setting the state would undo
    /// that.
    Unstopped,
    /// Reads the state until it and a fresh report confirm that the arm is ready in this mode.
    Await(u8),
}

/// From any condition to following targets. Limits pass through the queue of planned moves, which
/// runs in its own mode only (ufactory_docs); the box is set last, when a report has shown where
/// the arm stands. A stored offset of the tool would move the box against the flange.
pub(super) const START: &[Step] = &[
    Step::Version,
    Step::Serial,
    Step::Tell(Register::CleanError),
    Step::Tell(Register::CleanWarning),
    Step::Tell(Register::MotionEnable),
    Step::Tell(Register::Payload),
    Step::Tell(Register::CollisionSensitivity),
    Step::Mode(PLANNED),
    Step::Tell(Register::SetState),
    Step::NoError,
    Step::Await(PLANNED),
    Step::Tell(Register::TcpJerk),
    Step::Tell(Register::TcpAcceleration),
    Step::Tell(Register::JointJerk),
    Step::Tell(Register::JointAcceleration),
    Step::Tell(Register::TcpOffset),
    Step::Tell(Register::SafetyBox),
    Step::Tell(Register::SafetyBoxOn),
    Step::ReadBox,
    Step::Mode(SERVO),
    Step::Tell(Register::SetState),
    Step::NoError,
    Step::Await(SERVO),
];
/// To being guided by hand.
pub(super) const BY_HAND: &[Step] =
    &[Step::Mode(MANUAL), Step::Unstopped, Step::Tell(Register::SetState), Step::Await(MANUAL)];
/// From being guided by hand to following targets.
pub(super) const BACK: &[Step] =
    &[Step::Mode(SERVO), Step::Unstopped, Step::Tell(Register::SetState), Step::Await(SERVO)];

/// Mode of planned moves.
pub(super) const PLANNED: u8 = 0;
/// Mode that follows targets.
pub(super) const SERVO: u8 = 1;
/// Mode in which the arm is guided by hand.
pub(super) const MANUAL: u8 = 2;

impl Step {
    /// Whether only an arm with a box needs it.
    pub(super) fn is_of_the_box(self) -> bool {
        use Register::{ReducedMode, SafetyBox, SafetyBoxOn, TcpOffset};
        matches!(self.register(), SafetyBox | SafetyBoxOn | TcpOffset | ReducedMode)
    }

    /// The register that it uses.
    pub(super) fn register(self) -> Register {
        match self {
            Self::Tell(register) => register,
            Self::Mode(_) => Register::SetMode,
            Self::Version => Register::Version,
            Self::Serial => Register::Serial,
            Self::ReadBox => Register::ReducedMode,
            Self::NoError => Register::Errors,
            Self::Unstopped | Self::Await(_) => Register::GetState,
        }
    }
}

/// The version that the arm reports: axes, type, prefixes of two serial numbers, firmware (register
/// 1).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ArmVersion {
    /// Number of joints.
    pub axes: u8,
    /// As the controller wrote it.
    pub text: String,
    /// Version of the firmware.
    pub firmware: (u16, u16, u16),
}

impl ArmVersion {
    /// Reads the reply of the version register.
    pub(super) fn read(params: &[u8]) -> Option<Self> {
        let text = text(params);
        let axes = text.split(',').next()?.parse().ok()?;
        let mut numbers = text.rsplit(',').next()?.strip_prefix('v')?.split('.').map(str::parse);
        let mut number = || numbers.next()?.ok();
        let firmware = (number()?, number()?, number()?);
        Some(Self { axes, text, firmware })
    }
}

/// Text up to the first NUL.
pub(super) fn text(params: &[u8]) -> String {
    let end = params.iter().position(|&byte| byte == 0).unwrap_or(params.len());
    String::from_utf8_lossy(params.get(..end).unwrap_or_default()).trim().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read() {
        let mut params = [0; 40];
        params[..24].copy_from_slice(b"7,7,XS1304,AC1302,v2.4.0");
        let version = ArmVersion::read(&params).unwrap();
        assert_eq!((version.axes, version.firmware), (7, (2, 4, 0)));
        for odd in [&b"7,7,XS1304,AC1302,2.4.0"[..], b"v1.2", b"", b"seven,v1.2.3"] {
            assert_eq!(ArmVersion::read(odd), None);
        }
    }
}
