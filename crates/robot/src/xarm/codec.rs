//! The frames of the command port: requests to the arm's controller and its replies (ufactory_docs,
//! private protocol).
//!
//! A frame has a header of three big-endian words (transaction, protocol, length) and a body that
//! starts with the register. Floats in the body are little-endian, 16-bit counts big-endian.

use super::framing::Framing;

/// Longest body that is understood. The longest one in use is a joint position with velocity and
/// effort (86 bytes).
pub const MAX_BODY: usize = 256;

/// Protocol of the first exchange.
pub const PROTOCOL_PRIVATE: u16 = 2;
/// The same with keep-alive, for firmware from [`KEEP_ALIVE_FROM`].
pub const PROTOCOL_KEEP_ALIVE: u16 = 3;
/// First firmware that understands [`PROTOCOL_KEEP_ALIVE`].
pub const KEEP_ALIVE_FROM: (u16, u16, u16) = (1, 8, 6);
/// The state that stops an arm: it stands still and refuses motions (ufactory_docs).
pub const STOPPED: u8 = 4;
/// Register of a frame that answers no request: it reports that a command has begun or ended
/// (xArm-CPLUS-SDK; register 254 switches these frames on).
pub const FEEDBACK: u8 = 0xFF;

const HEADER: usize = 6;

/// Makes an enum of registers and the table that names them.
macro_rules! registers {
    ($($variant:ident = $number:literal, $name:literal;)*) => {
        /// A register of the controller (ufactory_docs).
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Register { $(#[doc = $name] $variant = $number,)* }

        impl Register {
            /// Every register that is known here.
            pub const ALL: &[Self] = &[$(Self::$variant,)*];

            /// What it is for.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name,)* }
            }

            /// The register with this number, if it is known here.
            pub fn from_number(number: u8) -> Option<Self> {
                match number { $($number => Some(Self::$variant),)* _ => None }
            }
        }
    };
}

registers! {
    Version = 1, "version";
    Serial = 2, "serial number";
    MotionEnable = 11, "motion enable";
    SetState = 12, "set state";
    GetState = 13, "get state";
    QueueLength = 14, "queue length";
    Errors = 15, "error and warning";
    CleanError = 16, "clean error";
    CleanWarning = 17, "clean warning";
    SetMode = 19, "set mode";
    MoveJoints = 23, "joint move";
    ServoJoints = 29, "servo joints";
    TcpJerk = 31, "TCP jerk";
    TcpAcceleration = 32, "TCP acceleration";
    JointJerk = 33, "joint jerk";
    JointAcceleration = 34, "joint acceleration";
    TcpOffset = 35, "TCP offset";
    Payload = 36, "payload";
    CollisionSensitivity = 37, "collision sensitivity";
    TcpPose = 41, "TCP pose";
    JointPosition = 42, "joint position";
    SafetyBox = 52, "safety box";
    ReducedMode = 53, "reduced mode settings";
    SafetyBoxOn = 59, "safety box on or off";
    FeedbackType = 254, "feedback type";
}

/// The state byte of a reply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReplyState(pub u8);

impl ReplyState {
    /// The register or its parameters were refused.
    pub const INVALID: u8 = 0x08;
    /// The arm is not ready to move.
    pub const NOT_READY: u8 = 0x10;
    /// A warning is pending.
    pub const WARNING: u8 = 0x20;
    /// An error is pending.
    pub const ERROR: u8 = 0x40;

    /// Whether one of these bits is set.
    pub fn has(self, bits: u8) -> bool {
        self.0 & bits != 0
    }
}

/// A request or a reply.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Ties a reply to its request.
    pub transaction: u16,
    /// 2 or 3 for what this module is about, 0 for Modbus TCP, 1 for a heartbeat.
    pub protocol: u16,
    len: u16,
    body: [u8; MAX_BODY],
}

impl Frame {
    /// A frame with this body, whose first byte is the register; `None` if the body is empty or too
    /// long.
    pub fn new(transaction: u16, protocol: u16, parts: &[&[u8]]) -> Option<Self> {
        let (mut body, mut len) = ([0; MAX_BODY], 0);
        for part in parts {
            body.get_mut(len..len + part.len())?.copy_from_slice(part);
            len += part.len();
        }
        (len > 0).then_some(Self { transaction, protocol, len: len as u16, body })
    }

    /// The register.
    pub fn register(&self) -> u8 {
        self.body[0]
    }

    /// Everything after the header.
    pub fn body(&self) -> &[u8] {
        &self.body[..usize::from(self.len)]
    }

    /// What follows the register of a request.
    pub fn params(&self) -> &[u8] {
        &self.body()[1..]
    }

    /// State and parameters of a reply; `None` if there is no state.
    pub fn reply(&self) -> Option<(ReplyState, &[u8])> {
        let (state, params) = self.params().split_first()?;
        Some((ReplyState(*state), params))
    }

    /// Appends its bytes.
    pub fn write(&self, out: &mut Vec<u8>) {
        for word in [self.transaction, self.protocol, self.len] {
            out.extend(word.to_be_bytes());
        }
        out.extend(self.body());
    }
}

impl std::fmt::Debug for Frame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{} {:02x?}", self.transaction, self.protocol, self.body())
    }
}

/// Finds the frames in a stream of bytes, however it is cut up.
#[derive(Debug, Default)]
pub struct FrameParser(Framing);

impl FrameParser {
    /// The next frame. Takes bytes off the front of `bytes` as it needs them: call it again until
    /// it returns `None`.
    pub fn next(&mut self, bytes: &mut &[u8]) -> Option<Frame> {
        let size = |header: &[u8]| {
            let length = usize::from(word(header, 4));
            let possible = word(header, 2) <= PROTOCOL_KEEP_ALIVE && (1..=MAX_BODY).contains(&length);
            possible.then_some(HEADER + length)
        };
        let read = |frame: &[u8]| Frame::new(word(frame, 0), word(frame, 2), &[frame.get(HEADER..)?]);
        self.0.next(bytes, HEADER, size, read)
    }

    /// Bytes that belonged to no frame: anything but 0 means that the other side uses another
    /// protocol.
    pub fn skipped(&self) -> u64 {
        self.0.skipped()
    }
}

fn word(bytes: &[u8], at: usize) -> u16 {
    bytes.get(at..at + 2).map_or(0, |pair| u16::from_be_bytes([pair[0], pair[1]]))
}

/// Little-endian floats from the start of `bytes`; `None` if there are fewer.
pub fn floats<const N: usize>(bytes: &[u8]) -> Option<[f32; N]> {
    let mut values = [0.0; N];
    let mut words = bytes.chunks_exact(4);
    for value in &mut values {
        *value = f32::from_le_bytes(words.next()?.try_into().ok()?);
    }
    Some(values)
}

/// Appends little-endian floats.
pub fn push_floats(out: &mut Vec<u8>, values: &[f32]) {
    out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn parse(parser: &mut FrameParser, mut bytes: &[u8]) -> Vec<Frame> {
        let mut frames = Vec::new();
        while let Some(frame) = parser.next(&mut bytes) {
            frames.push(frame);
        }
        assert!(bytes.is_empty());
        frames
    }

    fn bytes(frame: &Frame) -> Vec<u8> {
        let mut out = Vec::new();
        frame.write(&mut out);
        out
    }

    #[test]
    fn samples_by_hand() {
        let version = Frame::new(1, 2, &[&[Register::Version as u8]]).unwrap();
        assert_eq!(bytes(&version), [0, 1, 0, 2, 0, 1, 1]);
        let enable = Frame::new(2, 3, &[&[Register::MotionEnable as u8], &[8, 1]]).unwrap();
        assert_eq!(bytes(&enable), [0, 2, 0, 3, 0, 3, 0x0b, 8, 1]);
        let replies = parse(&mut FrameParser::default(), &[0, 2, 0, 3, 0, 2, 0x0b, 0x10]);
        let (state, params) = replies[0].reply().unwrap();
        assert_eq!((replies[0].transaction, replies[0].protocol, replies[0].register()), (2, 3, 11));
        assert!(state.has(ReplyState::NOT_READY) && !state.has(ReplyState::INVALID | ReplyState::ERROR));
        assert!(params.is_empty());
        // The heartbeat of the SDK is a frame like any other.
        let beat = parse(&mut FrameParser::default(), &[0, 0, 0, 1, 0, 2, 0, 0]);
        assert_eq!((beat.len(), beat[0].protocol), (1, 1));
    }

    #[test]
    fn registers_have_one_number_and_one_name() {
        for &register in Register::ALL {
            assert_eq!(Register::from_number(register as u8), Some(register));
        }
        let mut names: Vec<_> = Register::ALL.iter().map(|register| register.name()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), Register::ALL.len());
        assert_eq!(Register::from_number(FEEDBACK), None);
    }

    fn any_frame() -> impl Strategy<Value = Frame> {
        (any::<u16>(), 0..=3_u16, prop::collection::vec(any::<u8>(), 1..=MAX_BODY))
            .prop_map(|(transaction, protocol, body)| Frame::new(transaction, protocol, &[&body]).unwrap())
    }

    proptest! {
        #[test]
        fn any_cut_gives_the_same_frames(
            frames in prop::collection::vec(any_frame(), 0..5),
            cuts in prop::collection::vec(1..40_usize, 1..20),
        ) {
            let stream: Vec<u8> = frames.iter().flat_map(bytes).collect();
            let (mut parser, mut found, mut rest) = (FrameParser::default(), Vec::new(), stream.as_slice());
            for cut in cuts.iter().cycle() {
                let (piece, later) = rest.split_at((*cut).min(rest.len()));
                found.extend(parse(&mut parser, piece));
                rest = later;
                if rest.is_empty() {
                    break;
                }
            }
            prop_assert_eq!(found, frames);
            prop_assert_eq!(parser.skipped(), 0);
        }

        #[test]
        fn garbage_passes(garbage in prop::collection::vec(any::<u8>(), 0..2000)) {
            let mut parser = FrameParser::default();
            parse(&mut parser, &garbage);
            prop_assert!(parser.0.buffered() <= HEADER + MAX_BODY);
            // Whatever was read as the start of a frame ends, and the next ones are seen again.
            let frame = Frame::new(7, 2, &[&[13, 0, 2]]).unwrap();
            let again: Vec<u8> = std::iter::repeat_n(bytes(&frame), 60).flatten().collect();
            prop_assert!(parse(&mut parser, &again).contains(&frame));
        }
    }
}
