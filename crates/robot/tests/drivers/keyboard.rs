//! The keyboard's driver against its emulator and against hostile bytes.

use std::time::Duration;

use etude_emulators::faults::{FaultPlan, FaultyBytes};
use etude_emulators::{KeyboardEmulator, KeyboardEmulatorConfig, Line, ReleaseCoding};
use etude_robot::keyboard::{
    KEY_COUNT, KeyChange, Keyboard, KeyboardConfig, KeyboardState, KeyboardWarning, LossReason,
};
use proptest::prelude::*;

const STEP: Duration = Duration::from_millis(1);

fn keyboard() -> Keyboard {
    let mut keyboard = Keyboard::new(&KeyboardConfig::default()).unwrap();
    keyboard.connected(Duration::ZERO, &mut Vec::new());
    keyboard
}

fn emulator(config: KeyboardEmulatorConfig) -> KeyboardEmulator {
    KeyboardEmulator::new(&config).unwrap()
}

/// What the changes say, without their times.
fn played(changes: &[KeyChange]) -> Vec<(usize, u8)> {
    changes.iter().map(|change| (change.key, change.velocity)).collect()
}

/// The set that the changes lead to; fails unless presses and releases of each key alternate.
fn fold(changes: &[KeyChange]) -> u64 {
    changes.iter().fold(0, |set, change| {
        let bit = 1 << change.key;
        assert_eq!(set & bit == 0, change.velocity > 0, "{change:?} does not alternate");
        set ^ bit
    })
}

/// One thing that happens to the keyboard.
#[derive(Clone, Debug)]
enum Action {
    Toggle { key: usize, velocity: u8 },
    Wait { millis: u32 },
}

fn actions() -> impl Strategy<Value = Vec<Action>> {
    let action = prop_oneof![
        3 => (0..KEY_COUNT, 1_u8..=127).prop_map(|(key, velocity)| Action::Toggle { key, velocity }),
        1 => (1_u32..400).prop_map(|millis| Action::Wait { millis }),
    ];
    prop::collection::vec(action, 0..80)
}

fn any_emulator() -> impl Strategy<Value = KeyboardEmulatorConfig> {
    let every = |secs| prop_oneof![Just(None), (0.001..secs).prop_map(Some)];
    (any::<bool>(), any::<bool>(), any::<bool>(), every(0.29), every(0.1)).prop_map(
        |(note_off, running_status, din, sensing_secs, clock_secs)| KeyboardEmulatorConfig {
            release: if note_off { ReleaseCoding::NoteOff } else { ReleaseCoding::ZeroVelocity },
            running_status,
            line: if din { Line::Din } else { Line::Usb },
            sensing_secs,
            clock_secs,
            ..KeyboardEmulatorConfig::default()
        },
    )
}

/// Lets both run a step at a time; what was played, and what the driver made of it.
fn perform(
    config: KeyboardEmulatorConfig,
    actions: &[Action],
) -> (Vec<(usize, u8)>, Vec<KeyChange>, Keyboard) {
    let (mut emulator, mut keyboard) = (emulator(config), keyboard());
    let (mut truth, mut changes, mut wire) = (Vec::new(), Vec::new(), Vec::new());
    let (mut now, mut down) = (Duration::ZERO, 0_u64);
    let wait = Action::Wait { millis: 1200 };
    for action in actions.iter().chain([&wait]) {
        let millis = match *action {
            Action::Toggle { key, velocity } => {
                down ^= 1 << key;
                if down & (1 << key) != 0 {
                    emulator.press(now, key, velocity);
                    truth.push((key, velocity));
                } else {
                    emulator.release(now, key);
                    truth.push((key, 0));
                }
                0
            }
            Action::Wait { millis } => millis,
        };
        for _ in 0..millis {
            now += STEP;
            wire.clear();
            emulator.poll(now, &mut wire);
            keyboard.receive(now, &wire, &mut changes);
            keyboard.poll(now, &mut changes);
        }
    }
    assert_eq!(keyboard.pressed(), down);
    (truth, changes, keyboard)
}

/// Bytes that are more often than not part of a message.
fn hostile_bytes() -> impl Strategy<Value = Vec<u8>> {
    let status = prop::sample::select(vec![0x80, 0x90, 0, 0xF0, 0xFE]);
    let byte = prop_oneof![3 => any::<u8>(), 2 => 30_u8..90, 2 => status];
    prop::collection::vec(byte, 0..600)
}

proptest! {
    #[test]
    fn what_the_emulator_plays_is_what_the_driver_hears(config in any_emulator(), actions in actions()) {
        let (truth, changes, keyboard) = perform(config, &actions);
        prop_assert_eq!(played(&changes), truth);
        prop_assert_eq!(keyboard.state(), KeyboardState::Present);
        let faults: Vec<_> =
            keyboard.warnings().filter(|warning| !matches!(warning, KeyboardWarning::Stuck { .. })).collect();
        prop_assert_eq!(faults, vec![]);
    }

    #[test]
    fn real_time_bytes_anywhere_and_any_split_change_nothing(
        config in any_emulator(),
        keys in prop::collection::vec((0..KEY_COUNT, 1_u8..=127), 0..60),
        inserts in prop::collection::vec((any::<prop::sample::Index>(), 0xF8_u8..=0xFF), 0..60),
        cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..20),
    ) {
        let mut emulator = emulator(config);
        for &(key, velocity) in &keys {
            emulator.press(Duration::ZERO, key, velocity);
            emulator.release(Duration::ZERO, key);
        }
        let mut wire = Vec::new();
        emulator.poll(Duration::from_secs(2), &mut wire);
        let (mut plain, mut expected) = (keyboard(), Vec::new());
        plain.receive(STEP, &wire, &mut expected);
        let truth: Vec<_> = keys.iter().flat_map(|&(key, velocity)| [(key, velocity), (key, 0)]).collect();
        prop_assert_eq!(played(&expected), truth);

        for (place, byte) in inserts {
            wire.insert(place.index(wire.len() + 1), byte);
        }
        let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(wire.len() + 1)).collect();
        ends.push(wire.len());
        ends.sort_unstable();
        let (mut split, mut changes, mut start) = (keyboard(), Vec::new(), 0);
        for end in ends {
            split.receive(STEP, &wire[start..end], &mut changes);
            start = end;
        }
        prop_assert_eq!(changes, expected);
        prop_assert!(split.warnings().eq(plain.warnings()));
    }

    #[test]
    fn no_bytes_break_the_set(
        pieces in prop::collection::vec((hostile_bytes(), 0_u8..12, any::<u16>()), 1..12),
        lowest_pitch in 0_u8..=79,
    ) {
        let config = KeyboardConfig { lowest_pitch, ..KeyboardConfig::default() };
        let mut keyboard = Keyboard::new(&config).unwrap();
        let (mut changes, mut now) = (Vec::new(), Duration::ZERO);
        for (bytes, event, millis) in pieces {
            now += Duration::from_millis(millis.into());
            keyboard.receive(now, &bytes, &mut changes);
            match event {
                0 => keyboard.disconnected(now, &mut changes),
                1 => keyboard.connected(now, &mut changes),
                2 => keyboard.acknowledge(),
                _ => keyboard.poll(now, &mut changes),
            }
            prop_assert!(keyboard.pressed() < 1 << KEY_COUNT);
            prop_assert!(changes.iter().all(|change| change.key < KEY_COUNT && change.velocity < 128));
            prop_assert_eq!(fold(&changes), keyboard.pressed());
            prop_assert!(keyboard.warnings().count() <= KEY_COUNT + 4);
        }
        keyboard.disconnected(now, &mut changes);
        prop_assert_eq!(keyboard.pressed(), 0);
    }

    #[test]
    fn a_hostile_stream_may_be_split_anywhere(bytes in hostile_bytes(), cut in any::<prop::sample::Index>()) {
        let (mut whole, mut expected) = (keyboard(), Vec::new());
        whole.receive(STEP, &bytes, &mut expected);
        let (head, tail) = bytes.split_at(cut.index(bytes.len() + 1));
        let (mut split, mut changes) = (keyboard(), Vec::new());
        split.receive(STEP, head, &mut changes);
        split.receive(STEP, tail, &mut changes);
        prop_assert_eq!(changes, expected);
        prop_assert!(split.warnings().eq(whole.warnings()));
    }

    #[test]
    fn any_times_do_no_harm(
        times in prop::collection::vec((any::<u64>(), 0..KEY_COUNT), 0..20), config in any_emulator(),
    ) {
        let (mut emulator, mut keyboard, mut changes) = (emulator(config), keyboard(), Vec::new());
        for now in times.iter().map(|&(nanos, _)| Duration::from_nanos(nanos)).chain([Duration::MAX]) {
            let mut wire = Vec::new();
            emulator.press(now, times.first().map_or(0, |time| time.1), 1);
            emulator.poll(now, &mut wire);
            prop_assert!(wire.len() < 50_000, "{}", wire.len());
            keyboard.receive(now, &wire, &mut changes);
            keyboard.poll(now, &mut changes);
        }
    }

    #[test]
    fn after_a_bad_line_and_a_replug_the_driver_hears_well_again(
        config in any_emulator(), loss in 0.0..0.5, truncate in 0.0..0.5, seed: u64, first in actions(),
    ) {
        let plan = FaultPlan {
            loss,
            truncate,
            seed,
            disconnect_at_secs: Some(0.4),
            disconnect_for_secs: Some(0.2),
            ..FaultPlan::default()
        };
        let mut line = FaultyBytes::new(&plan).unwrap();
        let (mut emulator, mut keyboard) = (emulator(config), keyboard());
        let (mut changes, mut wire, mut arrived) = (Vec::new(), Vec::new(), Vec::new());
        let mut actions = first.iter();
        for step in 0..2000 {
            let now = STEP * step;
            if let Some(Action::Toggle { key, velocity }) = actions.next() {
                emulator.press(now, *key, *velocity);
                emulator.release(now + STEP, *key);
            }
            // The cable is replaced after a second; a running status whose byte was lost would
            // never come back else.
            let good = step >= 1000;
            if step == 1000 {
                emulator.unplug();
                emulator.plug(now);
            }
            wire.clear();
            emulator.poll(now, &mut wire);
            arrived.clear();
            if good { arrived.extend(&wire) } else { line.push(now, &wire); line.pop(now, &mut arrived) }
            keyboard.receive(now, &arrived, &mut changes);
            keyboard.poll(now, &mut changes);
        }
        // Pressing and releasing every key anew sets all of them right.
        for key in 0..KEY_COUNT {
            emulator.press(Duration::from_secs(2), key, 64);
            emulator.release(Duration::from_secs(2), key);
        }
        for step in 2000..3000 {
            wire.clear();
            emulator.poll(STEP * step, &mut wire);
            keyboard.receive(STEP * step, &wire, &mut changes);
        }
        let heard = played(&changes);
        for key in 0..KEY_COUNT {
            let own: Vec<_> = heard.iter().filter(|(other, _)| *other == key).collect();
            prop_assert!(own.ends_with(&[&(key, 64), &(key, 0)]), "key {key}: {own:?}");
        }
        prop_assert_eq!(keyboard.pressed(), 0);
    }
}

#[test]
fn silence_after_active_sensing_releases_all_keys() {
    let (mut keyboard, mut changes) = (keyboard(), Vec::new());
    let millis = Duration::from_millis;
    keyboard.receive(millis(0), &[0x90, 40, 9, 0xFE], &mut changes);
    keyboard.receive(millis(200), &[0x90, 41, 9], &mut changes);
    keyboard.poll(millis(500), &mut changes);
    assert_eq!(keyboard.state(), KeyboardState::Present, "any byte counts, and 300 ms are allowed");
    keyboard.poll(millis(501), &mut changes);
    assert_eq!(keyboard.state(), KeyboardState::Lost { at: millis(501), reason: LossReason::Silent });
    assert_eq!((keyboard.pressed(), changes.len()), (0, 4));
    keyboard.poll(millis(900), &mut changes);
    assert_eq!(keyboard.state(), KeyboardState::Lost { at: millis(501), reason: LossReason::Silent }, "once");
    assert!(keyboard.state().to_string().contains("check its cable"));

    keyboard.receive(millis(1000), &[0xFE], &mut changes);
    assert_eq!(keyboard.state(), KeyboardState::Present, "back again");
    keyboard.receive(millis(1000), &[41, 9], &mut changes);
    assert_eq!(keyboard.pressed(), 0, "a status from before the loss is no longer in force");
}

#[test]
fn a_keyboard_without_active_sensing_may_be_silent() {
    let (mut keyboard, mut changes) = (keyboard(), Vec::new());
    keyboard.receive(STEP, &[0x90, 40, 9], &mut changes);
    keyboard.poll(Duration::from_secs(3600), &mut changes);
    assert_eq!((keyboard.state(), keyboard.pressed()), (KeyboardState::Present, 1 << 4));
}

#[test]
fn an_emulator_with_active_sensing_is_never_lost_until_it_is_unplugged() {
    let config = KeyboardEmulatorConfig { sensing_secs: Some(0.27), ..KeyboardEmulatorConfig::default() };
    let (mut emulator, mut keyboard, mut changes) = (emulator(config), keyboard(), Vec::new());
    let mut run = |emulator: &mut KeyboardEmulator, from, to| {
        for step in from..to {
            let mut wire = Vec::new();
            emulator.poll(STEP * step, &mut wire);
            keyboard.receive(STEP * step, &wire, &mut changes);
            keyboard.poll(STEP * step, &mut changes);
        }
        keyboard.state()
    };
    emulator.press(Duration::ZERO, 3, 9);
    assert_eq!(run(&mut emulator, 0, 60_000), KeyboardState::Present);
    emulator.unplug();
    assert!(matches!(
        run(&mut emulator, 60_000, 60_400),
        KeyboardState::Lost { reason: LossReason::Silent, .. }
    ));
    emulator.plug(STEP * 60_400);
    assert_eq!(run(&mut emulator, 60_400, 61_000), KeyboardState::Present);
    assert_eq!(played(&changes), [(3, 9), (3, 0)]);
}

#[test]
fn unplugged_and_replugged() {
    let (mut keyboard, mut changes) = (Keyboard::new(&KeyboardConfig::default()).unwrap(), Vec::new());
    keyboard.disconnected(STEP, &mut changes);
    assert_eq!(keyboard.state(), KeyboardState::Absent, "what never was there cannot be lost");
    keyboard.connected(STEP, &mut changes);
    keyboard.receive(STEP, &[0x90, 36, 100, 84, 50, 60], &mut changes);
    assert_eq!(keyboard.pressed(), 1 | 1 << 48);
    keyboard.disconnected(STEP * 2, &mut changes);
    assert_eq!(keyboard.state(), KeyboardState::Lost { at: STEP * 2, reason: LossReason::Disconnected });
    assert_eq!(played(&changes), [(0, 100), (48, 50), (0, 0), (48, 0)]);
    keyboard.connected(STEP * 3, &mut changes);
    keyboard.receive(STEP * 3, &[64, 0x90, 36, 100], &mut changes);
    assert_eq!(
        (keyboard.state(), keyboard.pressed()),
        (KeyboardState::Present, 1),
        "half a message is forgotten"
    );
}

#[test]
fn a_shifted_keyboard_is_noticed_until_it_is_acknowledged() {
    let config = KeyboardEmulatorConfig::default();
    // The octave button transposes every note.
    let mut shifted = emulator(KeyboardEmulatorConfig { lowest_pitch: 48, ..config.clone() });
    let (mut emulator, mut keyboard, mut changes) = (emulator(config), keyboard(), Vec::new());
    let mut press = |emulator: &mut KeyboardEmulator, keyboard: &mut Keyboard, key| {
        let mut wire = Vec::new();
        emulator.press(STEP, key, 64);
        emulator.release(STEP, key);
        emulator.poll(STEP, &mut wire);
        keyboard.receive(STEP, &wire, &mut changes);
    };
    press(&mut shifted, &mut keyboard, 20);
    assert_eq!(keyboard.warnings().count(), 0, "a note of the keyboard gives nothing away");
    press(&mut shifted, &mut keyboard, 48);
    let warnings: Vec<_> = keyboard.warnings().collect();
    let [KeyboardWarning::Shifted(shift)] = warnings[..] else { panic!("{warnings:?}") };
    assert_eq!(shift.likely_semitones(), 12);
    assert!(warnings[0].to_string().contains("octave - button once"), "{}", warnings[0]);
    press(&mut emulator, &mut keyboard, 0);
    assert_eq!(keyboard.warnings().count(), 1, "it stays until it was read");
    keyboard.acknowledge();
    press(&mut emulator, &mut keyboard, 48);
    assert_eq!(keyboard.warnings().count(), 0);
    assert_eq!(keyboard.pressed(), 0);
}

#[test]
fn a_stuck_key_warns_once_a_press() {
    let (mut keyboard, mut changes) = (keyboard(), Vec::new());
    let secs = Duration::from_secs;
    let stuck = |keyboard: &Keyboard| keyboard.warnings().collect::<Vec<_>>();
    keyboard.receive(secs(1), &[0x90, 41, 9], &mut changes);
    keyboard.poll(secs(11), &mut changes);
    assert_eq!(stuck(&keyboard), []);
    keyboard.poll(secs(12), &mut changes);
    assert_eq!(stuck(&keyboard), [KeyboardWarning::Stuck { key: 5 }]);
    keyboard.acknowledge();
    keyboard.poll(secs(13), &mut changes);
    assert_eq!(stuck(&keyboard), [], "the operator knows of this press");
    keyboard.receive(secs(14), &[0x90, 41, 0, 41, 9], &mut changes);
    keyboard.poll(secs(25), &mut changes);
    assert_eq!(stuck(&keyboard), [KeyboardWarning::Stuck { key: 5 }]);
    assert_eq!(keyboard.pressed(), 1 << 5, "a warning changes nothing");
}

#[test]
fn what_does_not_pair_up_is_counted() {
    let (mut keyboard, mut changes) = (keyboard(), Vec::new());
    // The first release is of a key that was down before the connection.
    keyboard.receive(STEP, &[0x90, 41, 0, 41, 9, 41, 8, 41, 0, 41, 0], &mut changes);
    assert_eq!(played(&changes), [(5, 9), (5, 0), (5, 8), (5, 0)], "a lost release is made up for");
    assert_eq!(keyboard.warnings().collect::<Vec<_>>(), [KeyboardWarning::Unpaired { events: 2 }]);
    keyboard.receive(STEP, &[0x90, 0x90], &mut changes);
    keyboard.receive(STEP, &[1, 0x80], &mut changes);
    keyboard.acknowledge();
    assert_eq!(keyboard.warnings().count(), 0);
    keyboard.receive(STEP, &[1, 0x80], &mut changes);
    assert_eq!(keyboard.warnings().collect::<Vec<_>>(), [KeyboardWarning::Damaged { pieces: 1 }]);
}
