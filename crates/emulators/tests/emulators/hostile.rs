//! Any request is answered.

use std::time::Duration;

use etude_emulators::{ArmEmulator, ArmEmulatorConfig};
use etude_robot::xarm::codec::{FEEDBACK, Frame, FrameParser};
use proptest::prelude::*;

/// Parameters of a request: bytes, or floats of the size of joints and bytes after them.
fn parameters() -> impl Strategy<Value = Vec<u8>> {
    let floats = prop::collection::vec(-2.0..2.0_f32, 0..16);
    let sized = (floats, prop::collection::vec(0..3_u8, 0..6)).prop_map(|(floats, mut tail)| {
        let mut bytes: Vec<u8> = floats.iter().flat_map(|value| value.to_le_bytes()).collect();
        bytes.append(&mut tail);
        bytes
    });
    prop_oneof![prop::collection::vec(any::<u8>(), 0..130), prop::collection::vec(0..12_u8, 0..4), sized]
}

proptest! {
    /// Each request gets one reply, and the joints stay where an arm's can be.
    #[test]
    fn any_register_with_any_parameters_is_answered(
        mode in 0..8_u8,
        requests in prop::collection::vec((any::<u8>(), parameters()), 1..60),
    ) {
        let mut emulator = ArmEmulator::new(ArmEmulatorConfig::default());
        let (id, mut parser, mut now) = (emulator.connect(), FrameParser::default(), Duration::ZERO);
        let begin = [(11, vec![8, 1]), (19, vec![mode]), (12, vec![0])];
        let again = [(16, vec![]), (12, vec![0])];
        let asked = requests.into_iter().flat_map(|request| [request].into_iter().chain(again.clone()));
        for (transaction, (register, params)) in begin.into_iter().chain(asked).enumerate() {
            let mut bytes = Vec::new();
            Frame::new(transaction as u16, 3, &[&[register], &params]).unwrap().write(&mut bytes);
            emulator.receive(now, id, &bytes);
            now += Duration::from_millis(20);
            emulator.advance(now);
            bytes.clear();
            emulator.take(id, &mut bytes);
            let (mut bytes, mut replies) = (bytes.as_slice(), 0);
            while let Some(frame) = parser.next(&mut bytes) {
                if frame.transaction == transaction as u16 && frame.register() == register {
                    replies += 1;
                } else {
                    prop_assert_eq!(frame.register(), FEEDBACK);
                }
            }
            prop_assert!(replies == 1 || register == FEEDBACK, "{} replies of {}", replies, register);
            prop_assert!(emulator.joints().iter().all(|angle| angle.abs() < 7.0), "{:?}", emulator.joints());
        }
    }
}
