//! The hand's messages and their frames, both ways (Wonik's "CAN Protocol v4.0").
//!
//! An identifier is (message << 2) | device. A request is a remote frame; the answer is a data
//! frame with the same identifier.

use super::messages::{
    DeviceId, Finger, HandMessage, HandSide, HostMessage, Information, Request, Serial, StatusBits,
};
use crate::can::CanFrame;

const SERVO_ON: u16 = 0x40;
const SERVO_OFF: u16 = 0x41;
const TORQUE: u16 = 0x60;
const PERIODS: u16 = 0x81;
const INFORMATION: u16 = 0x80;
const SERIAL: u16 = 0x88;
const POSITION: u16 = 0x20;
const TEMPERATURE: u16 = 0x38;

fn data_frame(device: DeviceId, message: u16, bytes: &[u8]) -> CanFrame {
    CanFrame::of(identifier(device, message), bytes)
}

fn identifier(device: DeviceId, message: u16) -> u16 {
    (message << 2) | u16::from(u8::from(device))
}

/// The message of a frame, unless it belongs to another device.
fn message_id(device: DeviceId, frame: &CanFrame) -> Option<u16> {
    (frame.id() & 3 == u16::from(u8::from(device))).then_some(frame.id() >> 2)
}

/// Which finger a message is about, if it is one of the four that begin at `first`.
fn finger(message: u16, first: u16) -> Option<Finger> {
    Finger::ALL.get(usize::from(message.checked_sub(first)?)).copied()
}

fn bytes_of(words: [i16; 4]) -> [u8; 8] {
    let [a, b, c, d] = words.map(i16::to_le_bytes);
    [a[0], a[1], b[0], b[1], c[0], c[1], d[0], d[1]]
}

/// The four words of a payload, if that is what it is.
fn words_of(payload: &[u8]) -> Option<[i16; 4]> {
    let [a, b, c, d, e, f, g, h] = payload.try_into().ok()?;
    Some([[a, b], [c, d], [e, f], [g, h]].map(i16::from_le_bytes))
}

impl Request {
    fn message(self) -> u16 {
        match self {
            Self::Information => INFORMATION,
            Self::Serial => SERIAL,
            Self::Position(finger) => POSITION + finger as u16,
            Self::Temperature(finger) => TEMPERATURE + finger as u16,
        }
    }

    fn of(message: u16) -> Option<Self> {
        match message {
            INFORMATION => Some(Self::Information),
            SERIAL => Some(Self::Serial),
            _ => finger(message, POSITION)
                .map(Self::Position)
                .or_else(|| finger(message, TEMPERATURE).map(Self::Temperature)),
        }
    }
}

impl HostMessage {
    /// Its frame.
    pub fn encode(&self, device: DeviceId) -> CanFrame {
        match *self {
            Self::ServoOn => data_frame(device, SERVO_ON, &[]),
            Self::ServoOff => data_frame(device, SERVO_OFF, &[]),
            Self::Torque { finger, pwm } => data_frame(device, TORQUE + finger as u16, &bytes_of(pwm)),
            Self::Positions(period_ms) => {
                let [low, high] = period_ms.to_le_bytes();
                // Then the periods of the inertial sensor and of the temperatures.
                data_frame(device, PERIODS, &[low, high, 0, 0, 0, 0])
            }
            Self::Request(request) => CanFrame::remote_of(identifier(device, request.message())),
        }
    }

    /// The message of a frame to `device`; `None` if it is to another device, none of these
    /// messages, or too short or long.
    pub fn decode(device: DeviceId, frame: &CanFrame) -> Option<Self> {
        let message = message_id(device, frame)?;
        if frame.is_remote() {
            return Request::of(message).map(Self::Request);
        }
        Some(match (message, frame.payload()) {
            (SERVO_ON, []) => Self::ServoOn,
            (SERVO_OFF, []) => Self::ServoOff,
            // The longer form has the period of the status frame as well.
            (PERIODS, &[low, high, _, _, _, _] | &[low, high, _, _, _, _, _, _]) => {
                Self::Positions(u16::from_le_bytes([low, high]))
            }
            (_, payload) => Self::Torque { finger: finger(message, TORQUE)?, pwm: words_of(payload)? },
        })
    }
}

impl HandMessage {
    /// Its frame.
    pub fn encode(&self, device: DeviceId) -> CanFrame {
        match self {
            Self::Information(information) => {
                let [h, f] = [information.hardware, information.firmware].map(u16::to_le_bytes);
                let side = u8::from(information.side == HandSide::Left);
                let bytes = [h[0], h[1], f[0], f[1], side, information.board_celsius, information.status.0];
                data_frame(device, INFORMATION, &bytes)
            }
            Self::Serial(serial) => data_frame(device, SERIAL, &serial.0),
            Self::Position { finger, counts } => {
                data_frame(device, POSITION + *finger as u16, &bytes_of(*counts))
            }
            Self::Temperature { finger, celsius } => {
                data_frame(device, TEMPERATURE + *finger as u16, celsius)
            }
        }
    }

    /// The message of a frame from `device`; `None` if it is from another device, none of these
    /// messages, or its bytes are not what it carries.
    pub fn decode(device: DeviceId, frame: &CanFrame) -> Option<Self> {
        let message = message_id(device, frame).filter(|_| !frame.is_remote())?;
        Some(match (message, frame.payload()) {
            // Some firmware sends an eighth byte, whose meaning nobody documents.
            (INFORMATION, &[h0, h1, f0, f1, side, board_celsius, status, ..]) => {
                Self::Information(Information {
                    hardware: u16::from_le_bytes([h0, h1]),
                    firmware: u16::from_le_bytes([f0, f1]),
                    side: match side {
                        0 => HandSide::Right,
                        1 => HandSide::Left,
                        _ => return None,
                    },
                    board_celsius,
                    status: StatusBits(status),
                })
            }
            (SERIAL, payload) => Self::Serial(Serial(payload.try_into().ok()?)),
            (_, payload) => match finger(message, POSITION) {
                Some(finger) => Self::Position { finger, counts: words_of(payload)? },
                None => {
                    let finger = finger(message, TEMPERATURE)?;
                    Self::Temperature { finger, celsius: *payload.first_chunk()? }
                }
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::allegro::counts_from_rad;

    #[test]
    fn frames_have_the_documented_bytes() {
        let device = DeviceId::default();
        let long = CanFrame::new(0x204, &[3, 0, 0, 0, 0, 0, 2, 1]).unwrap();
        assert_eq!(HostMessage::decode(device, &long), Some(HostMessage::Positions(3)));
        let torque = HostMessage::Torque { finger: Finger::Index, pwm: [375, 675, -450, -285] };
        assert_eq!(format!("{:?}", torque.encode(device)), "180#77 01 A3 02 3E FE E3 FE");
        let position = |frame: &CanFrame| HandMessage::decode(device, frame).unwrap();
        let bytes = [0x66, 0x04, 0x00, 0x16, 0x01, 0x2c, 0x33, 0xf7];
        let counts = [0.1, 0.5, 1.0, -0.2].map(counts_from_rad);
        let frame = CanFrame::new(0x8C, &bytes).unwrap();
        assert_eq!(position(&frame), HandMessage::Position { finger: Finger::Thumb, counts });

        for (message, shown) in [
            (HostMessage::ServoOn, "100#"),
            (HostMessage::ServoOff, "104#"),
            (HostMessage::Positions(3), "204#03 00 00 00 00 00"),
            (HostMessage::Request(Request::Information), "200#R"),
            (HostMessage::Request(Request::Serial), "220#R"),
            (HostMessage::Request(Request::Position(Finger::Ring)), "088#R"),
            (HostMessage::Request(Request::Temperature(Finger::Middle)), "0E4#R"),
        ] {
            assert_eq!(format!("{:?}", message.encode(device)), shown);
            assert_eq!(HostMessage::decode(device, &message.encode(device)), Some(message));
        }
        // Another device on the same bus: the two lowest bits.
        let third = DeviceId::new(3).unwrap();
        assert_eq!(format!("{:?}", torque.encode(third)), "183#77 01 A3 02 3E FE E3 FE");
        assert_eq!(HostMessage::decode(device, &torque.encode(third)), None);

        // Information: hardware 4.0, firmware 1.2, left, 35 °C, servo on.
        let frame = CanFrame::new(0x200, &[0, 4, 2, 1, 1, 35, 1]).unwrap();
        let information = Information {
            hardware: 0x0400,
            firmware: 0x0102,
            side: HandSide::Left,
            board_celsius: 35,
            status: StatusBits(1),
        };
        assert_eq!(position(&frame), HandMessage::Information(information));
        assert_eq!((information.generation(), information.status.servo_on()), (4, true));
        assert_eq!(Serial(*b"AB12\0 34").to_string(), "SAH040AB12??34");
        // Temperatures as 2025 drivers read them, and as 2016 ones do.
        for bytes in [&[41, 42, 43, 44][..], &[41, 0, 0, 0], &[41, 0, 0, 0, 0, 0, 0, 0]] {
            let HandMessage::Temperature { finger, celsius } = position(&CanFrame::new(0xE8, bytes).unwrap())
            else {
                panic!("{bytes:?}")
            };
            assert_eq!((finger, celsius[0]), (Finger::Ring, 41));
        }
    }

    #[test]
    fn wrong_lengths_are_refused() {
        let device = DeviceId::default();
        for len in 0..=8 {
            let frame = |id| CanFrame::new(id, &[1; 8][..len]).unwrap();
            for (id, good) in
                [(0x100, len == 0), (0x104, len == 0), (0x180, len == 8), (0x204, len == 6 || len == 8)]
            {
                assert_eq!(HostMessage::decode(device, &frame(id)).is_some(), good, "{id:03X} {len}");
            }
            for (id, good) in [(0x200, len >= 7), (0x220, len == 8), (0x80, len == 8), (0xE0, len >= 4)] {
                assert_eq!(HandMessage::decode(device, &frame(id)).is_some(), good, "{id:03X} {len}");
            }
        }
        assert_eq!(HandMessage::decode(device, &CanFrame::new(0x200, &[0, 4, 0, 0, 2, 0, 0]).unwrap()), None);
    }

    fn any_finger() -> impl Strategy<Value = Finger> {
        (0usize..4).prop_map(|number| Finger::ALL[number])
    }

    fn any_host_message() -> impl Strategy<Value = HostMessage> {
        let request = prop_oneof![
            Just(Request::Information),
            Just(Request::Serial),
            any_finger().prop_map(Request::Position),
            any_finger().prop_map(Request::Temperature),
        ];
        prop_oneof![
            Just(HostMessage::ServoOn),
            Just(HostMessage::ServoOff),
            (any_finger(), any::<[i16; 4]>()).prop_map(|(finger, pwm)| HostMessage::Torque { finger, pwm }),
            any::<u16>().prop_map(HostMessage::Positions),
            request.prop_map(HostMessage::Request),
        ]
    }

    fn any_hand_message() -> impl Strategy<Value = HandMessage> {
        let information = any::<(u16, u16, bool, u8, u8)>().prop_map(
            |(hardware, firmware, left, board_celsius, status)| {
                let side = if left { HandSide::Left } else { HandSide::Right };
                HandMessage::Information(Information {
                    hardware,
                    firmware,
                    side,
                    board_celsius,
                    status: StatusBits(status),
                })
            },
        );
        prop_oneof![
            information,
            any::<[u8; 8]>().prop_map(|bytes| HandMessage::Serial(Serial(bytes))),
            (any_finger(), any::<[i16; 4]>())
                .prop_map(|(finger, counts)| HandMessage::Position { finger, counts }),
            (any_finger(), any::<[u8; 4]>())
                .prop_map(|(finger, celsius)| HandMessage::Temperature { finger, celsius }),
        ]
    }

    proptest! {
        #[test]
        fn messages_come_back(
            host in any_host_message(), hand in any_hand_message(), id in 0u8..4, other in 0u8..4,
        ) {
            let (device, another) = (DeviceId::new(id).unwrap(), DeviceId::new(other).unwrap());
            let (host_frame, hand_frame) = (host.encode(device), hand.encode(device));
            prop_assert_eq!(HostMessage::decode(another, &host_frame), (id == other).then_some(host));
            prop_assert_eq!(HandMessage::decode(another, &hand_frame), (id == other).then_some(hand));
        }

        /// Whatever is decoded is what the frame says: encoded again it is the same frame
        /// (temperatures except for spare bytes, periods except for those of other streams).
        #[test]
        fn frames_come_back(
            id in 0u16..=CanFrame::MAX_ID, data in prop::collection::vec(any::<u8>(), 0..=8), remote: bool,
        ) {
            let frame = if remote { CanFrame::remote(id) } else { CanFrame::new(id, &data) }.unwrap();
            let device = DeviceId::new((id & 3) as u8).unwrap();
            match HostMessage::decode(device, &frame) {
                Some(HostMessage::Positions(_)) | None => {}
                Some(message) => prop_assert_eq!(message.encode(device), frame),
            }
            match HandMessage::decode(device, &frame) {
                Some(HandMessage::Temperature { .. }) | None => {}
                Some(message) => prop_assert_eq!(message.encode(device), frame),
            }
        }
    }
}
