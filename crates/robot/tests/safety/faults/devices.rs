//! Devices that are others than they should be, or set or built otherwise.

use etude_emulators::HandEmulatorConfig;
use etude_robot::allegro::DeviceId;
use etude_twin::FaultKind;

use super::End::{Fault, GoesOn};
use super::{Lost, ROW, Row};
use crate::bench::Bench;

/// Settings of the hand's emulator.
fn hand(bench: &mut Bench) -> &mut HandEmulatorConfig {
    bench.lockstep.twin.devices.hand.config_mut()
}

pub const ROWS: &[Row] = &[
    Row {
        name: "the hand is of another generation (3)",
        ends: [Fault(110), Fault(110), Fault(110), Fault(110), Fault(110), GoesOn],
        says: "generation 3",
        stays: true,
        strike: |b| hand(b).hardware = 0x0300,
        mend: |b| hand(b).hardware = HandEmulatorConfig::default().hardware,
        ..ROW
    },
    Row {
        name: "the hand has another number on the bus (1)",
        ends: [Fault(2100), Fault(25), Fault(25), Fault(25), Fault(25), GoesOn],
        says: "the hand does not answer|no angles from finger",
        lost: Lost::HandHolds,
        stays: true,
        strike: |b| hand(b).device_id = DeviceId::new(1).unwrap(),
        mend: |b| hand(b).device_id = DeviceId::default(),
        ..ROW
    },
    Row {
        name: "the hand's encoders have noise of 20 counts",
        strike: |b| hand(b).noise_counts = 20,
        mend: |b| hand(b).noise_counts = 0,
        ..ROW
    },
    Row { name: "the hand's clock is fast by 1 %", twin: "[hand]\nclock_skew = 0.01", ..ROW },
    Row {
        name: "arm: the servo of a joint fails (error 13)",
        ends: [Fault(30), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "the servo of joint 3 fails",
        strike: |b| b.begin(FaultKind::ArmError(13)),
        ..ROW
    },
    Row {
        name: "arm: outside its box (error 35)",
        ends: [Fault(30), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "outside its safety boundary",
        strike: |b| b.begin(FaultKind::ArmError(35)),
        ..ROW
    },
    Row {
        name: "arm: an error that no manual lists (error 99)",
        ends: [Fault(30), Fault(15), Fault(15), Fault(15), Fault(15), GoesOn],
        says: "not listed",
        strike: |b| b.begin(FaultKind::ArmError(99)),
        ..ROW
    },
    Row {
        name: "keyboard's octave button is pressed",
        says: "the keyboard is shifted up",
        strike: |b| b.mischief.midi = vec![0x90, 96, 100, 0x80, 96, 64],
        ..ROW
    },
    Row {
        name: "a stroke of the keyboard is lost, its release arrives",
        says: "do not pair up",
        strike: |b| b.mischief.midi = vec![0x90, 60, 100, 0x80, 60, 64, 0x80, 60, 64],
        ..ROW
    },
    Row {
        name: "keyboard sends a clock",
        strike: |b| b.mischief.midi_flood = Some(Box::new(|bytes| bytes.push(0xF8))),
        ..ROW
    },
    Row {
        name: "a system exclusive message of the keyboard never ends",
        strike: |b| {
            b.mischief.midi = vec![0xF0];
            b.mischief.midi_flood = Some(Box::new(|bytes| bytes.extend([1; 10])));
        },
        ..ROW
    },
];
