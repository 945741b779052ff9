//! The rows of the fault matrix: what goes wrong, what must come of it in each phase, and how it is mended.

use etude_robot::calibration::Calibration;
use etude_robot::can::CanFrame;
use etude_twin::{FaultKind, calibration};

use crate::bench::{Bench, Policy, robot};

/// When a fault strikes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    Starting,
    Holding,
    /// While the arm makes a move that it planned itself.
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
use End::{Fault, GoesOn, Never};

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
}

pub struct Row {
    pub name: &'static str,
    /// Starting, holding, homing, moving, following, stopped.
    pub ends: [End; 6],
    /// Part of what the operator reads.
    pub says: &'static str,
    pub lost: Lost,
    /// The cause stays until it is removed, so that a start before that fails.
    pub stays: bool,
    pub strike: fn(&mut Bench),
    pub mend: fn(&mut Bench),
}

fn nothing(_: &mut Bench) {}

/// Positions, state and temperature are told every 3, 100 and 400 ms; a report comes every 10.
pub const ROWS: &[Row] = &[
    Row {
        name: "CAN controller in bus-off; the hand's firmware never times out",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "bus-off",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| b.begin(FaultKind::CanBusOff),
        mend: |b| b.end(FaultKind::CanBusOff),
    },
    Row {
        name: "CAN controller in bus-off; the hand's firmware times out after 100 ms",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "bus-off",
        lost: Lost::HandTimesOut,
        stays: true,
        strike: |b| b.begin(FaultKind::CanBusOff),
        mend: |b| b.end(FaultKind::CanBusOff),
    },
    Row {
        name: "CAN cut, and nobody says so",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "CAN cable",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| b.begin(FaultKind::CanSilent),
        mend: |b| b.end(FaultKind::CanSilent),
    },
    Row {
        name: "CAN loses 10 % of all frames",
        ends: [GoesOn; 6],
        says: "",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.mischief.frame_loss = 0.1,
        mend: |b| b.mischief.frame_loss = 0.0,
    },
    Row {
        name: "CAN loses 30 % of all frames",
        // A matter of chance: within seconds, five frames of one finger in a row.
        ends: [Fault(4000), Fault(4000), Fault(4000), Fault(4000), Fault(4000), GoesOn],
        says: "hand",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.mischief.frame_loss = 0.3,
        mend: |b| b.mischief.frame_loss = 0.0,
    },
    Row {
        name: "no more positions of one finger",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "no angles from finger 1",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::FingerSilent(1)),
        mend: |b| b.end(FaultKind::FingerSilent(1)),
    },
    Row {
        name: "arm's link cut",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "arm",
        lost: Lost::Arm,
        stays: true,
        strike: |b| b.begin(FaultKind::ArmDisconnect),
        mend: |b| b.end(FaultKind::ArmDisconnect),
    },
    Row {
        name: "arm does not reply",
        ends: [Fault(5100), Fault(270), Fault(270), Fault(270), Fault(270), GoesOn],
        says: "did not answer",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::ArmSilent),
        mend: |b| b.end(FaultKind::ArmSilent),
    },
    Row {
        name: "arm's reports stop",
        ends: [Fault(5100), Fault(115), Fault(115), Fault(115), Fault(115), GoesOn],
        says: "reports",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::ArmMute),
        mend: |b| b.end(FaultKind::ArmMute),
    },
    Row {
        name: "arm: collision (error 31)",
        ends: [Fault(30), Fault(15), Fault(30), Fault(15), Fault(15), GoesOn],
        says: "collision",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.begin(FaultKind::ArmError(31)),
        mend: nothing,
    },
    Row {
        name: "arm: emergency stop pressed (error 1)",
        ends: [Fault(30), Fault(15), Fault(30), Fault(15), Fault(15), GoesOn],
        says: "error 1",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::Estop),
        mend: |b| b.end(FaultKind::Estop),
    },
    Row {
        name: "arm's joints are held",
        ends: [GoesOn, GoesOn, GoesOn, Fault(1200), Fault(800), GoesOn],
        says: "see what holds it",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.begin(FaultKind::ArmStuck),
        mend: |b| b.end(FaultKind::ArmStuck),
    },
    Row {
        name: "arm stopped by another client (state 4)",
        // A start that is under way sets the state anew.
        ends: [GoesOn, Fault(15), Fault(30), Fault(15), Fault(15), GoesOn],
        says: "which this program did not request",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.begin(FaultKind::ArmStopped),
        mend: nothing,
    },
    Row {
        name: "keyboard unplugged",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "was unplugged",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::KeyboardUnplugged),
        mend: |b| b.end(FaultKind::KeyboardUnplugged),
    },
    Row {
        name: "keyboard with active sensing falls silent",
        ends: [Fault(305), Fault(305), Fault(305), Fault(305), Fault(305), GoesOn],
        says: "active sensing",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::KeyboardSilent),
        mend: |b| b.end(FaultKind::KeyboardSilent),
    },
    Row {
        name: "hand's board is hot",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "board is at 80",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::BoardHot(80)),
        mend: |b| b.end(FaultKind::BoardHot(80)),
    },
    Row {
        name: "a finger of the hand is hot",
        ends: [Fault(460), Fault(410), Fault(410), Fault(410), Fault(410), GoesOn],
        says: "joint 8 of the hand is at 70",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::HandHot(2, 70)),
        mend: |b| b.end(FaultKind::HandHot(2, 70)),
    },
    Row {
        name: "hand reports an internal fault (status bit 4)",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "status bits",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.begin(FaultKind::HandFault(4)),
        mend: |b| b.end(FaultKind::HandFault(4)),
    },
    Row {
        name: "hand's servo switched off by somebody else",
        ends: [GoesOn, Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "servo is off",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.begin(FaultKind::HandOff),
        mend: nothing,
    },
    Row {
        name: "an encoder jumps by 0.9 rad",
        // From a start on, that is a joint outside its range.
        ends: [Fault(150), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "joint 4",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.mischief.encoder_off = Some((0x084, 10_000)),
        mend: |b| b.mischief.encoder_off = None,
    },
    Row {
        name: "a finger repeats its angles",
        // At rest that is no fault, nor in a short slow move.
        ends: [GoesOn, GoesOn, GoesOn, GoesOn, Fault(1500), GoesOn],
        says: "finger 0 of the hand has reported the same angles",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.mischief.repeated = Some((0x080, None)),
        mend: |b| b.mischief.repeated = None,
    },
    Row {
        name: "the arm's reports repeat",
        // A move that the arm plans itself is over first.
        ends: [GoesOn, GoesOn, Fault(15_000), Fault(1000), Fault(1500), GoesOn],
        says: "arm",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.mischief.repeated_report = Some(Vec::new()),
        mend: |b| b.mischief.repeated_report = None,
    },
    Row {
        name: "another program drives the hand",
        // Until it has asked the hand, a start does not listen.
        ends: [GoesOn, Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "another program drives the hand",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.mischief.frames.push_back(CanFrame::new(0x184, &[0, 0, 100, 0, 0, 0, 0, 0]).unwrap()),
        mend: nothing,
    },
    Row {
        name: "policy falls silent",
        ends: [Never, Never, Never, Never, Fault(205), Never],
        says: "no new command",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.policy = Policy::Silent,
        mend: nothing,
    },
    Row {
        name: "policy asks for NaN and infinity",
        ends: [Never, Never, Never, Never, GoesOn, Never],
        says: "",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.policy = Policy::Nonsense,
        mend: nothing,
    },
    Row {
        name: "policy jumps all over its ranges",
        ends: [Never, Never, Never, Never, GoesOn, Never],
        says: "",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.policy = Policy::Jumps,
        mend: nothing,
    },
    Row {
        name: "controller does not run for 200 ms, while the hand holds its torque",
        ends: [GoesOn, Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "did not run",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| {
            // What is on its way arrives.
            b.stall(2);
            let held = b.lockstep.twin.devices.hand.pwm();
            b.stall(198);
            assert_eq!(b.lockstep.twin.devices.hand.pwm(), held);
        },
        mend: nothing,
    },
    Row {
        name: "another arm than the calibration's",
        ends: [Fault(150), Never, Never, Never, Never, Never],
        says: "calibrate again",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| {
            let other = Calibration { arm_serial: "XS130424A01A09".into(), ..calibration("twin") };
            b.robot = robot(&other);
            b.start();
        },
        mend: |b| b.robot = robot(&calibration("twin")),
    },
    Row {
        name: "operator's stop",
        ends: [End::Stopped; 6],
        says: "",
        lost: Lost::Nothing,
        stays: false,
        strike: Bench::stop,
        mend: nothing,
    },
];
