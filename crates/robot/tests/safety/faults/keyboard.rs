//! Faults of the keyboard.

use etude_twin::FaultKind;

use super::End::{Fault, GoesOn};
use super::{ROW, Row};
use crate::dice::Dice;

pub const ROWS: &[Row] = &[
    Row {
        name: "keyboard unplugged",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "was unplugged",
        stays: true,
        strike: |b| b.begin(FaultKind::KeyboardUnplugged),
        mend: |b| b.end(FaultKind::KeyboardUnplugged),
        ..ROW
    },
    Row {
        name: "keyboard with active sensing falls silent",
        ends: [Fault(305), Fault(305), Fault(305), Fault(305), Fault(305), GoesOn],
        says: "active sensing",
        stays: true,
        strike: |b| b.begin(FaultKind::KeyboardSilent),
        mend: |b| b.end(FaultKind::KeyboardSilent),
        ..ROW
    },
    Row {
        name: "keyboard's plug is out for a millisecond",
        ends: [Fault(2), Fault(2), Fault(2), Fault(2), Fault(2), GoesOn],
        says: "was unplugged",
        strike: |b| {
            b.begin(FaultKind::KeyboardUnplugged);
            b.step();
            b.end(FaultKind::KeyboardUnplugged);
        },
        ..ROW
    },
    Row {
        name: "a note of the keyboard never ends",
        says: "stays down",
        strike: |b| b.mischief.midi = vec![0x90, 36, 100],
        ..ROW
    },
    Row {
        name: "keyboard sends bytes at random, 30 a millisecond",
        says: "were damaged",
        strike: |b| {
            let mut dice = Dice::new(3);
            b.mischief.midi_flood = Some(Box::new(move |bytes| bytes.extend(dice.bytes(30))));
        },
        ..ROW
    },
    Row {
        name: "keyboard's running status is cut in the middle",
        says: "were damaged",
        strike: |b| b.mischief.midi = vec![0x90, 60, 100, 62, 0x80, 60, 64],
        ..ROW
    },
];
