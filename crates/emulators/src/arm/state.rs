//! What the emulated controller keeps: clients, moves that wait, velocities, its state, and its
//! report ports.

use etude_robot::xarm::codec::FrameParser;
use etude_robot::xarm::kinematics::ARM_JOINTS;
use nalgebra::Vector3;

/// One client of the command port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionId(pub(super) u64);

#[derive(Debug)]
pub(super) struct Connection {
    pub id: ConnectionId,
    pub parser: FrameParser,
    pub out: Vec<u8>,
    /// Mask of the feedback that it wants (register 254).
    pub wants: u8,
}

/// The client that is notified when a command is over.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receipt {
    pub client: ConnectionId,
    pub transaction: u16,
    pub protocol: u16,
    pub register: u8,
    pub wants: u8,
}

/// A planned move that waits for its turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Planned {
    pub to: [f64; ARM_JOINTS],
    pub speed: f64,
    pub acceleration: f64,
    pub receipt: Receipt,
}

/// The states of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Condition {
    /// 1 or 2 in feedback.
    Running,
    /// 3
    Paused,
    /// 4
    Stopped,
    /// 5
    Reset,
}

/// Velocities that a client has asked for in mode 4 or 5.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steering {
    pub wanted: Velocity,
    /// Millisecond of the clock at which they end by themselves.
    pub until: Option<u64>,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Velocity {
    /// rad/s
    Joints([f64; ARM_JOINTS]),
    /// Of the tool, m/s and rad/s, in the frame of the base or its own.
    Tool { linear: Vector3<f64>, angular: Vector3<f64>, own_frame: bool },
}

/// Which of the report ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReportKind {
    /// Port 30003: state, joints, pose and torque at 100 Hz.
    Real,
    /// Port 30001: the same with brakes, errors and payload, at 5 Hz.
    Normal,
    /// Port 30002: the same with limits, servos, inputs and all other settings, at 5 Hz.
    Rich,
    /// Port 30000: targets, joints, speeds, currents and pose at 250 Hz, with the time at the
    /// controller.
    Control,
}

impl ReportKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Real, Self::Normal, Self::Rich, Self::Control];

    /// Its TCP port, its bytes, and the time from one to the next, ms.
    pub(super) fn numbers(self) -> (u16, usize, u64) {
        match self {
            Self::Real => (30003, 87, 10),
            Self::Normal => (30001, 145, 200),
            Self::Rich => (30002, 587, 200),
            Self::Control => (30000, 784, 4),
        }
    }
}
