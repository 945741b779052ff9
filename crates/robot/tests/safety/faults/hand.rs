//! Faults of the hand and of its bus. Positions, state and temperature are told every 3, 100 and
//! 400 ms.

use std::collections::VecDeque;

use etude_emulators::HandEmulator;
use etude_robot::allegro::{DeviceId, HandSide, HostMessage};
use etude_robot::can::CanFrame;
use etude_robot::joints::HAND_DRIVEN_JOINTS;
use etude_twin::FaultKind;

use super::End::{Fault, GoesOn};
use super::{Lost, ROW, Row};
use crate::mischief::{AlterFrame, Mischief};
use crate::policy::Policy;

/// Identifiers of the first finger's positions and torques, and of the hand's state; each finger is
/// 4 on.
const POSITIONS: u16 = 0x080;
const TORQUES: u16 = 0x180;
const INFORMATION: u16 = 0x200;

/// A frame whose word `at` is another.
fn with_word(frame: &CanFrame, at: usize, change: impl FnOnce(i16) -> i16) -> CanFrame {
    let mut bytes: [u8; 8] = frame.payload().try_into().unwrap();
    let word = &mut bytes.as_chunks_mut::<2>().0[at];
    *word = change(i16::from_le_bytes(*word)).to_le_bytes();
    CanFrame::new(frame.id(), &bytes).unwrap()
}

/// What becomes of the counts that the encoder of a joint tells.
fn joint(joint: u16, mut change: impl FnMut(i16) -> i16 + 'static) -> AlterFrame {
    let (id, at) = (POSITIONS + joint / 4 * 4, usize::from(joint % 4));
    Box::new(move |frame| vec![if frame.id() == id { with_word(&frame, at, &mut change) } else { frame }])
}

/// Each frame of positions is followed by one of another hand, whose readings of a finger's second
/// joint are so many counts away.
fn beside_another_hand(counts: i16) -> AlterFrame {
    Box::new(move |frame| {
        let is_position = (POSITIONS..POSITIONS + 16).contains(&frame.id()) && frame.payload().len() == 8;
        let other = is_position.then(|| with_word(&frame, 1, |own| own.saturating_add(counts)));
        std::iter::once(frame).chain(other).collect()
    })
}

/// Of another program: positions every 3 ms, no other stream.
fn periods() -> CanFrame {
    HostMessage::Positions(3).encode(DeviceId::default())
}

pub const ROWS: &[Row] = &[
    Row {
        name: "CAN controller in bus-off; the hand's firmware never times out",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "bus-off",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| b.begin(FaultKind::CanBusOff),
        mend: |b| b.end(FaultKind::CanBusOff),
        ..ROW
    },
    Row {
        name: "CAN controller in bus-off; the hand's firmware times out after 100 ms",
        twin: "[hand]\ntorque_timeout_secs = 0.1",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "bus-off",
        lost: Lost::HandTimesOut,
        stays: true,
        strike: |b| b.begin(FaultKind::CanBusOff),
        mend: |b| b.end(FaultKind::CanBusOff),
        ..ROW
    },
    Row {
        name: "CAN cut, and nobody says so",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "CAN cable",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| b.begin(FaultKind::CanSilent),
        mend: |b| b.end(FaultKind::CanSilent),
        ..ROW
    },
    Row { name: "CAN loses 10 % of all frames", strike: |b| b.mischief.frame_loss = 0.1, ..ROW },
    Row {
        name: "CAN loses 30 % of all frames",
        // A matter of chance: within seconds, five frames of one finger in a row.
        ends: [Fault(4000), Fault(4000), Fault(4000), Fault(4000), Fault(4000), GoesOn],
        says: "no angles from finger",
        strike: |b| b.mischief.frame_loss = 0.3,
        ..ROW
    },
    Row {
        name: "no more positions of one finger",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "no angles from finger 1",
        stays: true,
        strike: |b| b.begin(FaultKind::FingerSilent(1)),
        mend: |b| b.end(FaultKind::FingerSilent(1)),
        ..ROW
    },
    Row {
        name: "hand's board is hot",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "board is at 80",
        stays: true,
        strike: |b| b.begin(FaultKind::BoardHot(80)),
        mend: |b| b.end(FaultKind::BoardHot(80)),
        ..ROW
    },
    Row {
        name: "a finger of the hand is hot",
        ends: [Fault(460), Fault(410), Fault(410), Fault(410), Fault(410), GoesOn],
        says: "joint 8 of the hand is at 70",
        stays: true,
        strike: |b| b.begin(FaultKind::HandHot(2, 70)),
        mend: |b| b.end(FaultKind::HandHot(2, 70)),
        ..ROW
    },
    Row {
        name: "hand reports an internal fault (status bit 4)",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "status bits",
        stays: true,
        strike: |b| b.begin(FaultKind::HandFault(4)),
        mend: |b| b.end(FaultKind::HandFault(4)),
        ..ROW
    },
    Row {
        name: "hand's servo switched off by somebody else",
        ends: [GoesOn, Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "servo is off",
        strike: |b| b.begin(FaultKind::HandOff),
        ..ROW
    },
    Row {
        name: "an encoder jumps by 0.9 rad",
        // From a start on, that is a joint outside its range.
        ends: [Fault(150), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "joint 4 jumped by 0.89 rad|joint 4 of the hand is at 0.89 rad",
        strike: |b| b.mischief.from_hand = Some(joint(4, |counts| counts.saturating_add(10_000))),
        ..ROW
    },
    Row {
        name: "a finger repeats its angles",
        // At rest that is no fault, nor in a short slow move.
        ends: [GoesOn, GoesOn, GoesOn, GoesOn, Fault(1500), GoesOn],
        says: "finger 0 of the hand has reported the same angles",
        strike: |b| {
            let mut first = None;
            b.mischief.from_hand = Some(Box::new(move |frame| {
                vec![if frame.id() == POSITIONS { *first.get_or_insert(frame) } else { frame }]
            }));
        },
        ..ROW
    },
    Row {
        name: "the hand's frames come late, without a gap",
        ends: [Fault(2000), Fault(2000), Fault(2000), Fault(2000), Fault(2000), GoesOn],
        says: "the frames of the hand come",
        strike: |b| {
            // Of 20 frames one is not passed on, until 45 ms are waiting.
            let (mut waiting, mut number) = (VecDeque::new(), 0);
            b.mischief.from_hand = Some(Box::new(move |frame| {
                waiting.push_back(frame);
                number += 1;
                let holds = waiting.len() < 60 && number % 20 == 0;
                if holds { vec![] } else { waiting.pop_front().into_iter().collect() }
            }));
        },
        ..ROW
    },
    Row {
        name: "another program sends zero torques to the hand",
        ends: [Fault(250), Fault(160), Fault(160), Fault(160), Fault(160), GoesOn],
        says: "another program drives the hand",
        strike: |b| b.mischief.flood = vec![CanFrame::new(TORQUES, &[0; 8]).unwrap()],
        ..ROW
    },
    Row {
        name: "another program sets the hand's periods",
        ends: [GoesOn, Fault(160), Fault(160), Fault(160), Fault(160), GoesOn],
        says: "another program drives the hand",
        strike: |b| b.mischief.frames.push_back(periods()),
        ..ROW
    },
    Row {
        name: "another program drives the hand",
        // Until it has asked the hand, a start does not listen.
        ends: [GoesOn, Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "another program drives the hand",
        strike: |b| b.mischief.frames.push_back(CanFrame::new(0x184, &[0, 0, 100, 0, 0, 0, 0, 0]).unwrap()),
        ..ROW
    },
    Row {
        name: "positions of two fingers come under each other's identifier",
        ends: [GoesOn, Fault(6000), Fault(6000), Fault(6000), Fault(6000), GoesOn],
        says: "joint",
        strike: |b| {
            b.mischief.from_hand = Some(Box::new(|frame| {
                let id = match frame.id() {
                    POSITIONS => POSITIONS + 4,
                    id if id == POSITIONS + 4 => POSITIONS,
                    _ => return vec![frame],
                };
                vec![CanFrame::new(id, frame.payload()).unwrap()]
            }));
        },
        mend: |b| {
            b.mischief = Mischief::default();
            b.lockstep.twin.place_fingers(&[0.0; HAND_DRIVEN_JOINTS]);
        },
        ..ROW
    },
    Row {
        name: "position frames of one finger are a byte short",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "no angles from finger 2",
        stays: true,
        strike: |b| {
            b.mischief.from_hand = Some(Box::new(|frame| {
                let short = frame.id() == POSITIONS + 8;
                let payload = &frame.payload()[..frame.payload().len() - usize::from(short)];
                vec![if short { CanFrame::new(frame.id(), payload).unwrap() } else { frame }]
            }));
        },
        ..ROW
    },
    Row {
        name: "two hands answer under one number, in different poses",
        ends: [Fault(300), Fault(60), Fault(60), Fault(60), Fault(60), GoesOn],
        says: "two hands answer on this bus",
        stays: true,
        strike: |b| b.mischief.from_hand = Some(beside_another_hand(5000)),
        ..ROW
    },
    Row {
        name: "two hands answer under one number, in the same pose",
        ends: [Fault(1500), Fault(1000), Fault(1000), Fault(1000), Fault(1000), GoesOn],
        says: "two hands answer on this bus",
        stays: true,
        strike: |b| b.mischief.from_hand = Some(beside_another_hand(7)),
        ..ROW
    },
    Row {
        name: "every fifth reading of an encoder is impossible",
        ends: [Fault(400), Fault(300), Fault(300), Fault(300), Fault(300), GoesOn],
        says: "of the last readings of joint 6 are impossible",
        stays: true,
        strike: |b| {
            let mut number = 0;
            b.mischief.from_hand = Some(joint(6, move |counts| {
                number += 1;
                if number % 5 == 0 { counts.saturating_add(9000) } else { counts }
            }));
        },
        ..ROW
    },
    Row {
        name: "an encoder reads its highest number (0x7FFF)",
        ends: [Fault(150), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "joint 9 reads 2.91 rad",
        stays: true,
        strike: |b| b.mischief.from_hand = Some(joint(9, |_| i16::MAX)),
        ..ROW
    },
    Row {
        name: "an encoder keeps its reading while its joint turns",
        // Where it is sent nowhere, that is no fault.
        ends: [GoesOn, GoesOn, GoesOn, GoesOn, Fault(3000), GoesOn],
        says: "joint 2 of the hand stays",
        strike: |b| {
            let mut first = None;
            b.mischief.from_hand = Some(joint(2, move |counts| *first.get_or_insert(counts)));
        },
        mend: |b| {
            b.mischief = Mischief::default();
            b.lockstep.twin.place_fingers(&[0.0; HAND_DRIVEN_JOINTS]);
        },
        ..ROW
    },
    Row {
        name: "an encoder counts in the wrong direction",
        // Near 0 rad its friction holds it; from there it runs to a stop, and pushes against that.
        ends: [GoesOn, Fault(1000), Fault(1000), Fault(1000), Fault(1000), GoesOn],
        says: "joint 5 of the hand turns against its torque|joint 5 reads",
        strike: |b| b.mischief.from_hand = Some(joint(5, i16::saturating_neg)),
        mend: |b| {
            b.mischief = Mischief::default();
            b.lockstep.twin.place_fingers(&[0.0; HAND_DRIVEN_JOINTS]);
        },
        ..ROW
    },
    Row {
        name: "a joint pushes against its stop (its encoder's zero drifts by 0.4 rad)",
        // Its motor stays warm from one start to the next.
        ends: [GoesOn, Fault(20_000), Fault(8000), Fault(8000), Fault(8000), GoesOn],
        says: "joint 7 of the hand has pushed with",
        strike: |b| {
            if b.policy == Policy::Smooth {
                b.policy = Policy::Still;
            }
            let mut offset = 0;
            b.mischief.from_hand = Some(joint(7, move |counts| {
                offset = (offset + 20).min(4500);
                counts + offset
            }));
        },
        mend: |b| {
            b.mischief = Mischief::default();
            b.lockstep.twin.place_fingers(&[0.0; HAND_DRIVEN_JOINTS]);
        },
        ..ROW
    },
    Row {
        name: "a joint gets no torque (its motor's cable is loose)",
        ends: [GoesOn, GoesOn, GoesOn, GoesOn, Fault(3000), GoesOn],
        says: "joint 5 of the hand stays",
        strike: |b| {
            b.mischief.to_hand = Some(Box::new(|frame| {
                vec![if frame.id() == TORQUES + 4 { with_word(&frame, 1, |_| 0) } else { frame }]
            }));
        },
        ..ROW
    },
    Row {
        name: "no more replies about the hand's state",
        ends: [Fault(2100), Fault(1110), Fault(1110), Fault(1110), Fault(1110), GoesOn],
        says: "the hand does not answer|the hand has not reported its state",
        stays: true,
        strike: |b| {
            b.mischief.from_hand =
                Some(Box::new(|frame| if frame.id() == INFORMATION { vec![] } else { vec![frame] }));
        },
        ..ROW
    },
    Row {
        name: "another device fills the bus with its own frames",
        // Six a millisecond are most of what a bus of 1 Mbit/s carries; another hand (number 1) is
        // among them.
        strike: |b| {
            let ids = [0x081, 0x085, 0x201, 0x181, 0x7FF, 0x000];
            b.mischief.flood = ids.map(|id| CanFrame::new(id, &[0xFF; 8]).unwrap()).to_vec();
        },
        ..ROW
    },
    Row {
        name: "the CAN adapter delivers each frame twice",
        strike: |b| b.mischief.from_hand = Some(Box::new(|frame| vec![frame; 2])),
        ..ROW
    },
    Row {
        name: "the CAN adapter delivers frames only every 20 ms",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "no angles from finger",
        strike: |b| {
            let mut kept = Vec::new();
            b.mischief.from_hand = Some(Box::new(move |frame| {
                kept.push(frame);
                if kept.len() < 28 { vec![] } else { std::mem::take(&mut kept) }
            }));
        },
        ..ROW
    },
    Row {
        name: "the hand restarts: its supply was off for a moment",
        // A start that is under way finds it switched on again.
        ends: [GoesOn, Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "no angles from finger",
        strike: |b| {
            let hand = &mut b.lockstep.twin.devices.hand;
            *hand = HandEmulator::new(&hand.config_mut().clone());
        },
        ..ROW
    },
    Row {
        name: "the hand says that it is the other one (right)",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "this is the right hand",
        stays: true,
        strike: |b| b.lockstep.twin.devices.hand.config_mut().side = HandSide::Right,
        mend: |b| b.lockstep.twin.devices.hand.config_mut().side = HandSide::Left,
        ..ROW
    },
];
