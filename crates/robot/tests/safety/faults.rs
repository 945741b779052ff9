//! The rows of the fault matrix: what goes wrong, what must come of it in each phase, and how it is
//! mended.

pub mod arm;
mod controller;
mod devices;
mod hand;
mod keyboard;
mod links;

use crate::bench::Bench;
use crate::mischief::Mischief;

/// When a fault strikes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    Starting,
    Holding,
    /// While the arm is on its way to the keyboard.
    Homing,
    Moving,
    Following,
    Stopped,
}

pub const WHENS: [When; 6] =
    [When::Starting, When::Holding, When::Homing, When::Moving, When::Following, When::Stopped];

/// What must become of the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// A latched fault, hand and arm let go within so many milliseconds.
    Fault(u32),
    /// Stopped as it was asked to, within a millisecond or two.
    Stopped,
    /// What it did before.
    GoesOn,
    /// It cannot happen then.
    Never,
}

/// What the wire leaves of a stop that it does not carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lost {
    Nothing,
    /// The hand is not told: it holds its last torque.
    HandHolds,
    /// The hand is not told, and lets go by itself after its firmware's timeout.
    HandTimesOut,
    /// The arm is not told: it goes where it was sent last, and stands.
    Arm,
    /// Neither is told.
    Both,
}

impl Lost {
    /// Whether the hand is not told.
    pub fn hand(self) -> bool {
        !matches!(self, Self::Nothing | Self::Arm)
    }

    /// Whether the arm is not told.
    pub fn arm(self) -> bool {
        matches!(self, Self::Arm | Self::Both)
    }
}

pub struct Row {
    pub name: &'static str,
    /// Starting, holding, homing, moving, following, stopped.
    pub ends: [End; 6],
    /// Part of what the operator reads: of the fault, or of the keyboard's warnings if there is
    /// none. Alternatives have a bar between them.
    pub says: &'static str,
    pub lost: Lost,
    /// The cause stays until it is removed, so that a start before that fails.
    pub stays: bool,
    /// Parameters of the twin from the start on, as TOML.
    pub twin: &'static str,
    /// The arm's reports are those of port 30000, which carry a time.
    pub timed: bool,
    pub strike: fn(&mut Bench),
    pub mend: fn(&mut Bench),
}

impl Row {
    /// Whether this is what the operator should read.
    pub fn is_said(&self, text: &str) -> bool {
        self.says.split('|').any(|part| text.contains(part))
    }
}

/// What most rows have: nothing happens, and what is done at the wires ends.
const ROW: Row = Row {
    name: "",
    ends: [End::GoesOn; 6],
    says: "",
    lost: Lost::Nothing,
    stays: false,
    twin: "",
    timed: false,
    strike: |_| {},
    mend: |b| b.mischief = Mischief::default(),
};

/// Every row.
pub fn rows() -> impl Iterator<Item = &'static Row> {
    [hand::ROWS, arm::ROWS, keyboard::ROWS, controller::ROWS, links::ROWS, devices::ROWS]
        .into_iter()
        .flatten()
}
