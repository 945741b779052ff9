//! The rows of the fault matrix: what goes wrong, what must come of it in each phase, and how it is mended.

use etude_robot::calibration::Calibration;
use etude_robot::can::CanFrame;
use etude_twin::calibration;

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

fn arm_request(bench: &mut Bench, body: &[u8]) {
    let now = bench.now();
    let arm = &mut bench.lockstep.twin.arm;
    let other = arm.connect();
    let mut request = vec![0, 1, 0, 2, 0, body.len() as u8];
    request.extend_from_slice(body);
    arm.receive(now, other, &request);
    arm.disconnect(other);
}

fn hand_request(bench: &mut Bench, id: u16) {
    let frame = CanFrame::new(id, &[]).unwrap();
    let now = bench.now();
    bench.lockstep.twin.hand.receive(now, &frame, &mut Vec::new());
}

/// Positions, state and temperature are told every 3, 100 and 400 ms; a report comes every 10.
pub const ROWS: &[Row] = &[
    Row {
        name: "CAN cut; the hand's firmware never times out",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "CAN bus",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| b.mischief.can_cut = true,
        mend: |b| b.mischief.can_cut = false,
    },
    Row {
        name: "CAN cut; the hand's firmware times out after 100 ms",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "CAN bus",
        lost: Lost::HandTimesOut,
        stays: true,
        strike: |b| b.mischief.can_cut = true,
        mend: |b| b.mischief.can_cut = false,
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
        strike: |b| b.mischief.lost_id = Some(0x084),
        mend: |b| b.mischief.lost_id = None,
    },
    Row {
        name: "arm's link cut",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "arm",
        lost: Lost::Arm,
        stays: true,
        strike: |b| b.mischief.arm_cut = true,
        mend: |b| b.mischief.arm_cut = false,
    },
    Row {
        name: "arm does not reply",
        ends: [Fault(5100), Fault(270), Fault(270), Fault(270), Fault(270), GoesOn],
        says: "did not answer",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.lockstep.twin.arm.set_silent(true),
        mend: |b| b.lockstep.twin.arm.set_silent(false),
    },
    Row {
        name: "arm's reports stop",
        ends: [Fault(5100), Fault(115), Fault(115), Fault(115), Fault(115), GoesOn],
        says: "reports",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.lockstep.twin.arm.set_mute(true),
        mend: |b| b.lockstep.twin.arm.set_mute(false),
    },
    Row {
        name: "arm: collision (error 31)",
        ends: [Fault(30), Fault(15), Fault(30), Fault(15), Fault(15), GoesOn],
        says: "collision",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.lockstep.twin.arm.inject_error(31),
        mend: nothing,
    },
    Row {
        name: "arm: emergency stop pressed (error 1)",
        ends: [Fault(30), Fault(15), Fault(30), Fault(15), Fault(15), GoesOn],
        says: "error 1",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.lockstep.twin.arm.inject_error(1),
        mend: |b| b.lockstep.twin.arm.inject_error(0),
    },
    Row {
        name: "arm's joints are held",
        ends: [GoesOn, GoesOn, GoesOn, Fault(4000), Fault(2500), GoesOn],
        says: "from where it was sent",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| b.lockstep.twin.arm.set_stuck(true),
        mend: |b| b.lockstep.twin.arm.set_stuck(false),
    },
    Row {
        name: "arm stopped by another client (state 4)",
        // A start that is under way sets the state anew.
        ends: [GoesOn, Fault(15), Fault(30), Fault(15), Fault(15), GoesOn],
        says: "nobody here asked for that",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| arm_request(b, &[12, 4]),
        mend: nothing,
    },
    Row {
        name: "keyboard unplugged",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "was unplugged",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.mischief.midi_cut = true,
        mend: |b| b.mischief.midi_cut = false,
    },
    Row {
        name: "keyboard with active sensing falls silent",
        ends: [Fault(305), Fault(305), Fault(305), Fault(305), Fault(305), GoesOn],
        says: "active sensing",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.mischief.midi_silent = true,
        mend: |b| b.mischief.midi_silent = false,
    },
    Row {
        name: "hand's board is hot",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "board is at 80",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.lockstep.twin.hand.config_mut().board_celsius = 80,
        mend: |b| b.lockstep.twin.hand.config_mut().board_celsius = 35,
    },
    Row {
        name: "a joint of the hand is hot",
        ends: [Fault(460), Fault(410), Fault(410), Fault(410), Fault(410), GoesOn],
        says: "joint 9 of the hand is at 70",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.lockstep.twin.hand.config_mut().joint_celsius[9] = 70,
        mend: |b| b.lockstep.twin.hand.config_mut().joint_celsius[9] = 33,
    },
    Row {
        name: "hand reports an internal fault (status bit 4)",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "status bits",
        lost: Lost::Nothing,
        stays: true,
        strike: |b| b.lockstep.twin.hand.config_mut().fault_bits = 4,
        mend: |b| b.lockstep.twin.hand.config_mut().fault_bits = 0,
    },
    Row {
        name: "hand's servo switched off by somebody else",
        ends: [GoesOn, Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "servo is off",
        lost: Lost::Nothing,
        stays: false,
        strike: |b| hand_request(b, 0x104),
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
            let held = b.lockstep.twin.hand.pwm();
            b.stall(198);
            assert_eq!(b.lockstep.twin.hand.pwm(), held);
        },
        mend: nothing,
    },
    Row {
        name: "another arm than the calibration's",
        ends: [Fault(150), Never, Never, Never, Never, Never],
        says: "calibrate anew",
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
