//! The keyboard's emulator: the bytes of MIDI, and the time that a line takes.

use std::time::Duration;

use etude_emulators::{KeyboardEmulator, KeyboardEmulatorConfig, Line};
use etude_robot::keyboard::{Keyboard, KeyboardConfig};

fn emulator(config: KeyboardEmulatorConfig) -> KeyboardEmulator {
    KeyboardEmulator::new(&config).unwrap()
}

#[test]
fn the_bytes_of_midi() {
    // MIDI 1.0: 90 3C 64 is note on 60, velocity 100.
    let mut emulator = emulator(KeyboardEmulatorConfig::default());
    let mut wire = Vec::new();
    emulator.press(Duration::ZERO, 60 - 36, 100);
    emulator.release(Duration::ZERO, 60 - 36);
    emulator.poll(Duration::ZERO, &mut wire);
    assert_eq!(wire, [0x90, 0x3C, 0x64, 0x90, 0x3C, 0x00]);
}

#[test]
fn a_five_pin_line_takes_its_time() {
    // MIDI 1.0: 320 µs a byte, 0.96 ms a note; running status saves a third.
    for (running_status, micros, expected) in
        [(false, 959, 2), (false, 960, 3), (false, 1920, 6), (true, 1599, 4), (true, 1600, 5)]
    {
        let config =
            KeyboardEmulatorConfig { line: Line::Din, running_status, ..KeyboardEmulatorConfig::default() };
        let (mut emulator, mut wire) = (emulator(config), Vec::new());
        emulator.press(Duration::ZERO, 0, 1);
        emulator.release(Duration::ZERO, 0);
        emulator.poll(Duration::from_micros(micros), &mut wire);
        assert_eq!(wire.len(), expected, "after {micros} µs, running status {running_status}");
    }
}

#[test]
fn a_clock_interleaves_with_messages_on_a_five_pin_line() {
    let config = KeyboardEmulatorConfig {
        line: Line::Din,
        clock_secs: Some(0.001),
        ..KeyboardEmulatorConfig::default()
    };
    let (mut emulator, mut wire) = (emulator(config), Vec::new());
    for key in 0..4 {
        emulator.press(Duration::ZERO, key, 1);
    }
    emulator.poll(Duration::from_millis(6), &mut wire);
    let inside = wire.windows(3).any(|bytes| bytes[0] < 0x80 && bytes[1] == 0xF8 && bytes[2] < 0x80);
    assert!(inside, "{wire:02X?}");
}

#[test]
fn a_full_queue_drops_whole_messages() {
    let config = KeyboardEmulatorConfig { line: Line::Din, ..KeyboardEmulatorConfig::default() };
    let (mut emulator, mut changes) = (emulator(config), Vec::new());
    let mut keyboard = Keyboard::new(&KeyboardConfig::default()).unwrap();
    keyboard.connected(Duration::ZERO, &mut changes);
    for _ in 0..1000 {
        emulator.press(Duration::ZERO, 7, 1);
        emulator.release(Duration::ZERO, 7);
    }
    let mut wire = Vec::new();
    emulator.poll(Duration::from_secs(5), &mut wire);
    keyboard.receive(Duration::from_millis(1), &wire, &mut changes);
    assert_eq!(keyboard.warnings().count(), 0, "no message is cut short");
    assert!((300..400).contains(&changes.len()), "{}", changes.len());
}
