//! Two keyboards on one port.

use std::time::Duration;

use etude_robot::keyboard::{Keyboard, KeyboardConfig, KeyboardWarning};

const STEP: Duration = Duration::from_millis(1);

#[test]
fn a_second_keyboard_on_the_port_is_named_and_counts() {
    let mut keyboard = Keyboard::new(&KeyboardConfig::default()).unwrap();
    let mut changes = Vec::new();
    keyboard.connected(Duration::ZERO, &mut changes);
    keyboard.receive(STEP, &[0x91, 41, 9, 0x81, 41, 0], &mut changes);
    assert_eq!(keyboard.warnings().count(), 0, "one channel, whichever it is");
    keyboard.receive(STEP, &[0x93, 43, 7, 43, 0, 43, 8, 0x9F, 45, 9, 0x91, 47, 9], &mut changes);
    assert_eq!(
        keyboard.warnings().collect::<Vec<_>>(),
        [KeyboardWarning::OtherChannels { first: 1, others: 1 << 3 | 1 << 15, notes: 3 }]
    );
    let said = keyboard.warnings().next().unwrap().to_string();
    assert!(said.contains("on MIDI channel 2, and 3 on channel 4, 16:"), "{said}");
    assert_eq!(keyboard.pressed(), 1 << 7 | 1 << 9 | 1 << 11, "what is down holds the rail back");
    keyboard.acknowledge();
    assert_eq!(keyboard.warnings().count(), 0);
}
