//! Faults of the arm and of its link, alone and together with the hand's. A report comes every 10
//! ms.

use std::collections::VecDeque;

use etude_robot::calibration::Calibration;
use etude_robot::xarm::codec::ReplyState;
use etude_twin::{FaultKind, calibration};

use super::End::{Fault, GoesOn, Never};
use super::{Lost, ROW, Row};
use crate::bench::{Bench, robot};
use crate::mischief::Mischief;

/// Where the status is in a reply: after the header and the register.
const STATUS: usize = 7;
/// Where the joints are in a report.
const ANGLES: usize = 7;

/// What becomes of each reply of the arm.
fn replies(bench: &mut Bench, change: fn(&mut [u8])) {
    bench.mischief.alter_replies = Some(Box::new(move |bytes| {
        let mut rest = &mut bytes[..];
        while let [_, _, _, _, high, low, ..] = rest {
            let length = 6 + usize::from(u16::from_be_bytes([*high, *low]));
            let (reply, others) = rest.split_at_mut(length);
            change(reply);
            rest = others;
        }
    }));
}

/// What becomes of a joint (from 0) in each report of the arm.
pub fn report_joint(bench: &mut Bench, joint: usize, change: impl Fn(f32) -> f32 + 'static) {
    report_joints(bench, move |joints| joints[joint] = change(joints[joint]));
}

/// What becomes of the joints in each report of the arm.
pub fn report_joints(bench: &mut Bench, change: impl Fn(&mut [f32; 7]) + 'static) {
    bench.mischief.alter_reports = Some(Box::new(move |bytes| {
        let angles = &mut bytes[ANGLES..].as_chunks_mut::<4>().0[..7];
        let mut joints: [f32; 7] = std::array::from_fn(|joint| f32::from_le_bytes(angles[joint]));
        change(&mut joints);
        for (angle, joint) in angles.iter_mut().zip(joints) {
            *angle = joint.to_le_bytes();
        }
    }));
}

/// A request of another client: a servo target that is `by_rad` from where joint 1 is now.
pub fn target_beside(bench: &Bench, by_rad: f64) -> Vec<u8> {
    let mut joints = bench.lockstep.twin.devices.arm.joints();
    joints[0] += by_rad;
    let floats = joints.iter().chain(&[0.0; 3]).flat_map(|value| (*value as f32).to_le_bytes());
    [29].into_iter().chain(floats).collect()
}

pub const ROWS: &[Row] = &[
    Row {
        name: "arm's link cut",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "the connection to the arm broke",
        lost: Lost::Arm,
        stays: true,
        strike: |b| b.begin(FaultKind::ArmDisconnect),
        mend: |b| b.end(FaultKind::ArmDisconnect),
        ..ROW
    },
    Row {
        name: "arm does not reply",
        ends: [Fault(5100), Fault(270), Fault(270), Fault(270), Fault(270), GoesOn],
        says: "did not answer",
        stays: true,
        strike: |b| b.begin(FaultKind::ArmSilent),
        mend: |b| b.end(FaultKind::ArmSilent),
        ..ROW
    },
    Row {
        name: "arm's reports stop",
        ends: [Fault(5100), Fault(115), Fault(115), Fault(115), Fault(115), GoesOn],
        says: "report",
        stays: true,
        strike: |b| b.begin(FaultKind::ArmMute),
        mend: |b| b.end(FaultKind::ArmMute),
        ..ROW
    },
    Row {
        name: "arm: collision (error 31)",
        ends: [Fault(30), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "collision",
        strike: |b| b.begin(FaultKind::ArmError(31)),
        ..ROW
    },
    Row {
        name: "arm: emergency stop pressed (error 1)",
        ends: [Fault(30), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "error 1",
        stays: true,
        strike: |b| b.begin(FaultKind::Estop),
        mend: |b| b.end(FaultKind::Estop),
        ..ROW
    },
    Row {
        name: "arm's joints are held",
        ends: [GoesOn, GoesOn, Fault(800), Fault(1200), Fault(800), GoesOn],
        says: "see what holds it",
        strike: |b| b.begin(FaultKind::ArmStuck),
        mend: |b| b.end(FaultKind::ArmStuck),
        ..ROW
    },
    Row {
        name: "arm stopped by another client (state 4)",
        // A start that is under way sets the state anew.
        ends: [GoesOn, Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "which this program did not request",
        strike: |b| b.begin(FaultKind::ArmStopped),
        ..ROW
    },
    Row {
        name: "the arm's reports repeat",
        ends: [GoesOn, GoesOn, Fault(800), Fault(1000), Fault(1500), GoesOn],
        says: "the arm has reported the same angles",
        strike: |b| {
            let mut first = None;
            b.mischief.alter_reports =
                Some(Box::new(move |bytes| bytes.clone_from(first.get_or_insert_with(|| bytes.clone()))));
        },
        ..ROW
    },
    Row {
        name: "the arm's reports repeat, and carry a time (port 30000)",
        ends: [Fault(5100), Fault(115), Fault(115), Fault(115), Fault(115), GoesOn],
        says: "the same one again",
        timed: true,
        stays: true,
        strike: |b| {
            let mut first = None;
            b.mischief.alter_reports =
                Some(Box::new(move |bytes| bytes.clone_from(first.get_or_insert_with(|| bytes.clone()))));
        },
        ..ROW
    },
    Row {
        name: "the arm's reports come later and later",
        ends: [Fault(2500), Fault(2500), Fault(2500), Fault(2500), Fault(2500), GoesOn],
        says: "later than before|from where it was sent",
        strike: |b| {
            // Of ten reports one is not passed on, until 200 ms are waiting.
            let (mut waiting, mut number) = (VecDeque::new(), 0);
            b.mischief.alter_reports = Some(Box::new(move |bytes| {
                waiting.push_back(std::mem::take(bytes));
                number += 1;
                let holds = waiting.len() < 20 && number % 10 == 0;
                if !holds {
                    *bytes = waiting.pop_front().unwrap_or_default();
                }
            }));
        },
        mend: |b| {
            b.mischief = Mischief::default();
            b.reconnect_arm();
        },
        ..ROW
    },
    Row {
        name: "another arm than the calibration's",
        ends: [Fault(150), Never, Never, Never, Never, Never],
        says: "calibrate again",
        stays: true,
        strike: |b| {
            let other = Calibration { arm_serial: "XS130424A01A09".into(), ..calibration("twin") };
            b.robot = robot(&other);
            b.start();
        },
        mend: |b| b.robot = robot(&calibration("twin")),
        ..ROW
    },
    Row {
        name: "arm's controller closes the connection and takes a new one at once",
        ends: [Fault(3), Fault(3), Fault(3), Fault(3), Fault(3), GoesOn],
        says: "the connection to the arm broke",
        strike: Bench::reconnect_arm,
        ..ROW
    },
    Row {
        name: "arm's replies have the number of another request",
        ends: [Fault(5100), Fault(270), Fault(270), Fault(270), Fault(270), GoesOn],
        says: "did not answer",
        stays: true,
        strike: |b| replies(b, |reply| reply[0] ^= 0x80),
        ..ROW
    },
    Row {
        name: "arm's replies say that there is an error, which has no number",
        ends: [Fault(150), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "an error without its number",
        stays: true,
        strike: |b| replies(b, |reply| reply[STATUS] |= ReplyState::ERROR),
        ..ROW
    },
    Row {
        name: "arm's replies say that there is a warning",
        strike: |b| replies(b, |reply| reply[STATUS] |= ReplyState::WARNING),
        ..ROW
    },
    Row {
        name: "arm's controller refuses everything (firmware that has changed)",
        ends: [Fault(100), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "refused",
        stays: true,
        strike: |b| replies(b, |reply| reply[STATUS] |= ReplyState::INVALID),
        ..ROW
    },
    Row {
        name: "bytes of another protocol among the arm's replies",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "its replies are not",
        strike: |b| b.mischief.replies = b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec(),
        mend: |b| {
            b.mischief = Mischief::default();
            b.reconnect_arm();
        },
        ..ROW
    },
    Row {
        name: "a report of the arm is incomplete",
        ends: [Fault(30), Fault(30), Fault(30), Fault(30), Fault(30), GoesOn],
        says: "its reports are not",
        strike: |b| {
            let mut cut = false;
            b.mischief.alter_reports = Some(Box::new(move |bytes| {
                if !std::mem::replace(&mut cut, true) {
                    bytes.truncate(60);
                }
            }));
        },
        mend: |b| {
            b.mischief = Mischief::default();
            b.reconnect_arm();
        },
        ..ROW
    },
    Row {
        name: "a report of the arm has an impossible angle",
        ends: [Fault(30), Fault(30), Fault(30), Fault(30), Fault(30), GoesOn],
        says: "its reports are not",
        stays: true,
        strike: |b| report_joint(b, 2, |_| f32::NAN),
        mend: |b| {
            b.mischief = Mischief::default();
            b.reconnect_arm();
        },
        ..ROW
    },
    Row {
        name: "the arm's reports have one joint 0.3 rad off",
        // A start that is under way finds the arm beside the keyboard.
        ends: [GoesOn, Fault(200), Fault(200), Fault(200), Fault(200), GoesOn],
        says: "turned by 0.30 rad|joint 4 of the arm is 0.30 rad from where it was sent",
        strike: |b| report_joint(b, 3, |rad| rad + 0.3),
        ..ROW
    },
    Row {
        name: "arm paused by another client (state 3)",
        ends: [GoesOn, Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "in state 3",
        strike: |b| b.other_client(&[12, 3]),
        ..ROW
    },
    Row {
        name: "arm set to be guided by hand by another client (mode 2)",
        ends: [GoesOn, Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "which this program did not request",
        strike: |b| b.other_client(&[19, 2]),
        ..ROW
    },
    Row {
        name: "arm set to planned moves by another client (mode 0)",
        ends: [GoesOn, Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "which this program did not request",
        strike: |b| b.other_client(&[19, 0]),
        ..ROW
    },
    Row {
        name: "another client sends the arm targets 0.3 rad away",
        ends: [Fault(700), Fault(500), Fault(500), Fault(500), Fault(500), GoesOn],
        says: "turned by 0.30 rad|another program sends targets|a joint would be too fast|the tool would be too fast",
        strike: |b| b.mischief.other_client = target_beside(b, 0.3),
        ..ROW
    },
    Row {
        name: "another client sends the arm targets 0.02 rad away",
        ends: [Fault(700), Fault(600), Fault(600), Fault(600), Fault(600), GoesOn],
        says: "another program sends targets|another program moves it|another program keeps it there",
        strike: |b| b.mischief.other_client = target_beside(b, 0.02),
        ..ROW
    },
    Row {
        name: "another client sends the arm targets 0.02 rad away, and its reports say so (port 30000)",
        ends: [Fault(700), Fault(100), Fault(100), Fault(100), Fault(100), GoesOn],
        says: "another program sends targets",
        timed: true,
        strike: |b| b.mischief.other_client = target_beside(b, 0.02),
        ..ROW
    },
    Row {
        name: "another client keeps the arm where it is",
        // At rest that is where it was sent.
        ends: [GoesOn, GoesOn, Fault(2500), Fault(2500), Fault(2000), GoesOn],
        says: "another program sends targets|another program moves it|another program keeps it there",
        strike: |b| b.mischief.other_client = target_beside(b, 0.0),
        ..ROW
    },
    Row {
        name: "arm's motors switched off by another client",
        ends: [Fault(150), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "which this program did not request",
        strike: |b| b.other_client(&[11, 8, 0]),
        ..ROW
    },
    Row {
        name: "the CAN bus is cut while the arm does not reply",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "CAN cable",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| {
            b.begin(FaultKind::ArmSilent);
            b.begin(FaultKind::CanSilent);
        },
        mend: |b| {
            b.end(FaultKind::ArmSilent);
            b.end(FaultKind::CanSilent);
        },
        ..ROW
    },
    Row {
        name: "arm's link and the CAN bus are cut at once",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "use the hardware stop",
        lost: Lost::Both,
        stays: true,
        strike: |b| {
            b.begin(FaultKind::ArmDisconnect);
            b.begin(FaultKind::CanBusOff);
        },
        mend: |b| {
            b.end(FaultKind::ArmDisconnect);
            b.end(FaultKind::CanBusOff);
        },
        ..ROW
    },
];
