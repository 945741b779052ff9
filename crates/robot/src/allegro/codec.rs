//! The hand's messages and their frames, both ways (Wonik's "CAN Protocol v4.0").
//!
//! An identifier is (message << 2) | device. A request is a remote frame; the answer is a data frame with the same identifier.

use super::messages::{
    DeviceId, Finger, HandMessage, HandSide, HostMessage, Information, Periods, Raw, Request, Serial,
    StatusBits,
};
use crate::can::CanFrame;

const SERVO_ON: u16 = 0x40;
const SERVO_OFF: u16 = 0x41;
const TORQUE: u16 = 0x60;
const POSE: u16 = 0xE0;
const PERIODS: u16 = 0x81;
const CONFIG: u16 = 0x68;
const INFORMATION: u16 = 0x80;
const SERIAL: u16 = 0x88;
const POSITION: u16 = 0x20;
const IMU: u16 = 0x30;
const TEMPERATURE: u16 = 0x38;
const STATUS: u16 = 0x10;

/// A frame with a known identifier and something wrong inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// Too few or too many bytes.
    #[error(
        "the frame {id:03X} has {len} bytes, not {wanted}: check that the hand is an Allegro v4 and its cable"
    )]
    Length {
        /// Its identifier.
        id: u16,
        /// Bytes that it has.
        len: usize,
        /// Bytes that it should have.
        wanted: &'static str,
    },
    /// The byte of the side is neither 0 nor 1.
    #[error("the hand reports side {0}, which is neither right (0) nor left (1): is it an Allegro v4?")]
    Side(u8),
}

fn data_frame(device: DeviceId, message: u16, bytes: &[u8]) -> CanFrame {
    let mut data = [0; 8];
    for (to, from) in data.iter_mut().zip(bytes) {
        *to = *from;
    }
    CanFrame::of(identifier(device, message), data, bytes.len().min(8) as u8)
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

fn words_of([a, b, c, d, e, f, g, h]: [u8; 8]) -> [i16; 4] {
    [[a, b], [c, d], [e, f], [g, h]].map(i16::from_le_bytes)
}

fn exactly<const N: usize>(frame: &CanFrame, wanted: &'static str) -> Result<[u8; N], CodecError> {
    frame.payload().try_into().map_err(|_| length(frame, wanted))
}

fn length(frame: &CanFrame, wanted: &'static str) -> CodecError {
    CodecError::Length { id: frame.id(), len: frame.payload().len(), wanted }
}

impl Request {
    fn message(self) -> u16 {
        match self {
            Self::Information => INFORMATION,
            Self::Serial => SERIAL,
            Self::Position(finger) => POSITION + finger as u16,
            Self::Imu => IMU,
            Self::Temperature(finger) => TEMPERATURE + finger as u16,
        }
    }

    fn of(message: u16) -> Option<Self> {
        match message {
            INFORMATION => Some(Self::Information),
            SERIAL => Some(Self::Serial),
            IMU => Some(Self::Imu),
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
            Self::Pose { finger, counts } => data_frame(device, POSE + finger as u16, &bytes_of(counts)),
            Self::Periods(periods) => {
                let [p, i] = [periods.position_ms, periods.imu_ms].map(u16::to_le_bytes);
                let [t, s] = [periods.temperature_ms, periods.status_ms.unwrap_or(0)].map(u16::to_le_bytes);
                let bytes = [p[0], p[1], i[0], i[1], t[0], t[1], s[0], s[1]];
                let len = if periods.status_ms.is_some() { 8 } else { 6 };
                data_frame(device, PERIODS, &bytes[..len])
            }
            Self::Config(bytes) => data_frame(device, CONFIG, &bytes),
            Self::Request(request) => CanFrame::remote_of(identifier(device, request.message())),
        }
    }

    /// The message of a frame to `device`; `None` if it is to another device or none of these messages.
    ///
    /// # Errors
    /// If the identifier is known and the length is not.
    pub fn decode(device: DeviceId, frame: &CanFrame) -> Result<Option<Self>, CodecError> {
        let Some(message) = message_id(device, frame) else { return Ok(None) };
        if frame.is_remote() {
            return Ok(Request::of(message).map(Self::Request));
        }
        Ok(Some(match message {
            SERVO_ON => exactly::<0>(frame, "0").map(|_| Self::ServoOn)?,
            SERVO_OFF => exactly::<0>(frame, "0").map(|_| Self::ServoOff)?,
            CONFIG => Self::Config(exactly(frame, "6")?),
            PERIODS => {
                let (first, status_ms) = match *frame.payload() {
                    [a, b, c, d, e, f] => ([a, b, c, d, e, f], None),
                    [a, b, c, d, e, f, g, h] => ([a, b, c, d, e, f], Some(u16::from_le_bytes([g, h]))),
                    _ => return Err(length(frame, "6 or 8")),
                };
                let [a, b, c, d, e, f] = first;
                let [position_ms, imu_ms, temperature_ms] = [[a, b], [c, d], [e, f]].map(u16::from_le_bytes);
                Self::Periods(Periods { position_ms, imu_ms, temperature_ms, status_ms })
            }
            _ => {
                if let Some(finger) = finger(message, TORQUE) {
                    Self::Torque { finger, pwm: words_of(exactly(frame, "8")?) }
                } else if let Some(finger) = finger(message, POSE) {
                    Self::Pose { finger, counts: words_of(exactly(frame, "8")?) }
                } else {
                    return Ok(None);
                }
            }
        }))
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
            Self::Imu(raw) => data_frame(device, IMU, raw.bytes()),
            Self::Temperature { finger, celsius } => {
                data_frame(device, TEMPERATURE + *finger as u16, celsius)
            }
            Self::Status(raw) => data_frame(device, STATUS, raw.bytes()),
        }
    }

    /// The message of a frame from `device`; `None` if it is from another device, none of these messages, or
    /// a request.
    ///
    /// # Errors
    /// If the identifier is known and the bytes are not what it carries.
    pub fn decode(device: DeviceId, frame: &CanFrame) -> Result<Option<Self>, CodecError> {
        let Some(message) = message_id(device, frame) else { return Ok(None) };
        if frame.is_remote() {
            return Ok(None);
        }
        let raw = Raw::of(frame);
        Ok(Some(match message {
            INFORMATION => {
                let [h0, h1, f0, f1, side, board_celsius, status] = exactly(frame, "7")?;
                Self::Information(Information {
                    hardware: u16::from_le_bytes([h0, h1]),
                    firmware: u16::from_le_bytes([f0, f1]),
                    side: match side {
                        0 => HandSide::Right,
                        1 => HandSide::Left,
                        other => return Err(CodecError::Side(other)),
                    },
                    board_celsius,
                    status: StatusBits(status),
                })
            }
            SERIAL => Self::Serial(Serial(exactly(frame, "8")?)),
            IMU => Self::Imu(raw),
            STATUS => Self::Status(raw),
            _ => {
                if let Some(finger) = finger(message, POSITION) {
                    Self::Position { finger, counts: words_of(exactly(frame, "8")?) }
                } else if let Some(finger) = finger(message, TEMPERATURE) {
                    let celsius = frame.payload().first_chunk().ok_or(length(frame, "4"))?;
                    Self::Temperature { finger, celsius: *celsius }
                } else {
                    return Ok(None);
                }
            }
        }))
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
        let periods = HostMessage::Periods(Periods { position_ms: 3, ..Periods::default() });
        assert_eq!(format!("{:?}", periods.encode(device)), "204#03 00 00 00 00 00");
        let long = Periods { position_ms: 3, status_ms: Some(0x0102), ..Periods::default() };
        assert_eq!(format!("{:?}", HostMessage::Periods(long).encode(device)), "204#03 00 00 00 00 00 02 01");
        let torque = HostMessage::Torque { finger: Finger::Index, pwm: [375, 675, -450, -285] };
        assert_eq!(format!("{:?}", torque.encode(device)), "180#77 01 A3 02 3E FE E3 FE");
        let position = |frame: &CanFrame| HandMessage::decode(device, frame).unwrap().unwrap();
        let bytes = [0x66, 0x04, 0x00, 0x16, 0x01, 0x2c, 0x33, 0xf7];
        let counts = [0.1, 0.5, 1.0, -0.2].map(counts_from_rad);
        let frame = CanFrame::new(0x8C, &bytes).unwrap();
        assert_eq!(position(&frame), HandMessage::Position { finger: Finger::Thumb, counts });

        for (message, shown) in [
            (HostMessage::ServoOn, "100#"),
            (HostMessage::ServoOff, "104#"),
            (HostMessage::Config([1, 2, 3, 4, 5, 6]), "1A0#01 02 03 04 05 06"),
            (
                HostMessage::Pose { finger: Finger::Thumb, counts: [1, 0, 0, -1] },
                "38C#01 00 00 00 00 00 FF FF",
            ),
            (HostMessage::Request(Request::Information), "200#R"),
            (HostMessage::Request(Request::Serial), "220#R"),
            (HostMessage::Request(Request::Position(Finger::Ring)), "088#R"),
            (HostMessage::Request(Request::Imu), "0C0#R"),
            (HostMessage::Request(Request::Temperature(Finger::Middle)), "0E4#R"),
        ] {
            assert_eq!(format!("{:?}", message.encode(device)), shown);
            assert_eq!(HostMessage::decode(device, &message.encode(device)), Ok(Some(message)));
        }
        // Another device on the same bus: the two lowest bits.
        let third = DeviceId::new(3).unwrap();
        assert_eq!(format!("{:?}", torque.encode(third)), "183#77 01 A3 02 3E FE E3 FE");
        assert_eq!(HostMessage::decode(device, &torque.encode(third)), Ok(None));

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
            for (id, good) in [
                (0x100, len == 0),
                (0x104, len == 0),
                (0x180, len == 8),
                (0x38C, len == 8),
                (0x204, len == 6 || len == 8),
                (0x1A0, len == 6),
            ] {
                assert_eq!(HostMessage::decode(device, &frame(id)).is_ok(), good, "{id:03X} {len}");
            }
            for (id, good) in
                [(0x200, len == 7), (0x220, len == 8), (0x80, len == 8), (0xE0, len >= 4), (0xC0, true)]
            {
                assert_eq!(HandMessage::decode(device, &frame(id)).is_ok(), good, "{id:03X} {len}");
            }
        }
        assert!(HandMessage::decode(device, &CanFrame::new(0x200, &[0, 4, 0, 0, 2, 0, 0]).unwrap()).is_err());
    }

    fn any_finger() -> impl Strategy<Value = Finger> {
        (0usize..4).prop_map(|number| Finger::ALL[number])
    }

    fn any_host_message() -> impl Strategy<Value = HostMessage> {
        let request = prop_oneof![
            Just(Request::Information),
            Just(Request::Serial),
            Just(Request::Imu),
            any_finger().prop_map(Request::Position),
            any_finger().prop_map(Request::Temperature),
        ];
        let periods = any::<(u16, u16, u16, Option<u16>)>().prop_map(
            |(position_ms, imu_ms, temperature_ms, status_ms)| {
                HostMessage::Periods(Periods { position_ms, imu_ms, temperature_ms, status_ms })
            },
        );
        prop_oneof![
            Just(HostMessage::ServoOn),
            Just(HostMessage::ServoOff),
            (any_finger(), any::<[i16; 4]>()).prop_map(|(finger, pwm)| HostMessage::Torque { finger, pwm }),
            (any_finger(), any::<[i16; 4]>())
                .prop_map(|(finger, counts)| HostMessage::Pose { finger, counts }),
            periods,
            any::<[u8; 6]>().prop_map(HostMessage::Config),
            request.prop_map(HostMessage::Request),
        ]
    }

    fn any_hand_message() -> impl Strategy<Value = HandMessage> {
        let raw = prop::collection::vec(any::<u8>(), 0..=8).prop_map(|bytes| Raw::new(&bytes).unwrap());
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
            raw.clone().prop_map(HandMessage::Imu),
            (any_finger(), any::<[u8; 4]>())
                .prop_map(|(finger, celsius)| HandMessage::Temperature { finger, celsius }),
            raw.prop_map(HandMessage::Status),
        ]
    }

    proptest! {
        #[test]
        fn messages_come_back(
            host in any_host_message(), hand in any_hand_message(), id in 0u8..4, other in 0u8..4,
        ) {
            let (device, another) = (DeviceId::new(id).unwrap(), DeviceId::new(other).unwrap());
            let (host_frame, hand_frame) = (host.encode(device), hand.encode(device));
            prop_assert_eq!(HostMessage::decode(another, &host_frame), Ok((id == other).then_some(host)));
            prop_assert_eq!(HandMessage::decode(another, &hand_frame), Ok((id == other).then_some(hand)));
        }

        /// Whatever is decoded is what the frame says: encoded again it is the same frame (temperatures but
        /// for spare bytes).
        #[test]
        fn frames_come_back(
            id in 0u16..=CanFrame::MAX_ID, data in prop::collection::vec(any::<u8>(), 0..=8), remote: bool,
        ) {
            let frame = if remote { CanFrame::remote(id) } else { CanFrame::new(id, &data) }.unwrap();
            let device = DeviceId::new((id & 3) as u8).unwrap();
            if let Ok(Some(message)) = HostMessage::decode(device, &frame) {
                prop_assert_eq!(message.encode(device), frame);
            }
            match HandMessage::decode(device, &frame) {
                Ok(Some(HandMessage::Temperature { .. })) | Ok(None) | Err(_) => {}
                Ok(Some(message)) => prop_assert_eq!(message.encode(device), frame),
            }
        }
    }
}
