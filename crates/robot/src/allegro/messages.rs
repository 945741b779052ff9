//! The messages between hand and host; `codec` has the bytes.

use serde::{Deserialize, Serialize};

/// Which hand on a bus: 0 to 3, kept in the hand's own memory; 0 as delivered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub struct DeviceId(u8);

impl DeviceId {
    /// `None` for numbers above 3.
    pub fn new(id: u8) -> Option<Self> {
        (id <= 3).then_some(Self(id))
    }
}

impl TryFrom<u8> for DeviceId {
    type Error = String;

    fn try_from(id: u8) -> Result<Self, String> {
        Self::new(id).ok_or_else(|| format!("there is no hand number {id} on a bus: 0 to 3, 0 as delivered"))
    }
}

impl From<DeviceId> for u8 {
    fn from(id: DeviceId) -> u8 {
        id.0
    }
}

/// Left or right hand, as byte 4 of the Information reply says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HandSide {
    /// The left hand (1 on the wire).
    #[default]
    Left,
    /// The right hand (0 on the wire).
    Right,
}

impl std::fmt::Display for HandSide {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Left => "left",
            Self::Right => "right",
        })
    }
}

/// A finger, in the order of the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finger {
    /// Finger 0.
    Index,
    /// Finger 1.
    Middle,
    /// Finger 2.
    Ring,
    /// Finger 3.
    Thumb,
}

impl Finger {
    /// All four in the order of the wire.
    pub const ALL: [Self; 4] = [Self::Index, Self::Middle, Self::Ring, Self::Thumb];

    /// 0 to 3, as on the wire. Its joints are the flat joints `4 * number() ..= 4 * number() + 3`.
    pub fn number(self) -> usize {
        self as usize
    }
}

/// What a remote frame can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Versions, side, temperature, status.
    Information,
    /// The serial number.
    Serial,
    /// One finger's joint angles.
    Position(Finger),
    /// One finger's temperatures.
    Temperature(Finger),
}

/// From the host to the hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HostMessage {
    /// Servo on.
    ServoOn,
    /// Servo off. Users report hands that ignore it (fairo's Allegro client), so it is never sent
    /// alone.
    ServoOff,
    /// The torque of a finger's four joints, as PWM.
    Torque {
        /// Which finger.
        finger: Finger,
        /// PWM of its joints 0 to 3, full scale [`FULL_SCALE_PWM`](super::FULL_SCALE_PWM).
        pwm: [i16; 4],
    },
    /// Starts the stream of positions, all four frames back to back, with this period in ms; 0
    /// stops it. The hand's other streams stay off.
    Positions(u16),
    /// Asks for an answer.
    Request(Request),
}

impl HostMessage {
    /// Whether it can make the hand move.
    pub fn drives(&self) -> bool {
        match self {
            Self::ServoOn => true,
            Self::Torque { pwm, .. } => *pwm != [0; 4],
            Self::ServoOff | Self::Positions(_) | Self::Request(_) => false,
        }
    }

    /// Whether it changes what the hand does: anything but a question.
    pub fn commands(&self) -> bool {
        !matches!(self, Self::Request(_))
    }
}

/// The status byte of the Information reply (allegro_hand_ros2, and fairo's Allegro client, which
/// differ).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StatusBits(pub u8);

impl StatusBits {
    /// Bit 0: the servo is on.
    pub const SERVO_ON: u8 = 1;
    /// Bit 1: too hot, in both public readings.
    pub const TEMPERATURE: u8 = 1 << 1;
    /// Bit 2: "internal communication" to its maker, "temperature throttle" to others: bad either
    /// way.
    pub const INTERNAL: u8 = 1 << 2;
    /// Bit 3, in one public reading: the hand misses frames from the host.
    pub const HOST_TIMEOUT: u8 = 1 << 3;
    /// Bit 4, in one public reading: the palm is too hot.
    pub const PALM_TEMPERATURE: u8 = 1 << 4;

    /// Whether the servo is on.
    pub fn servo_on(self) -> bool {
        self.0 & Self::SERVO_ON != 0
    }

    /// Those of `bits` that are set.
    pub fn of(self, bits: u8) -> u8 {
        self.0 & bits
    }
}

/// The Information reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Information {
    /// Hardware version; its upper byte is the generation: 4 is a v4 hand.
    pub hardware: u16,
    /// Firmware version.
    pub firmware: u16,
    /// Left or right.
    pub side: HandSide,
    /// Temperature of the board, °C.
    pub board_celsius: u8,
    /// Servo and faults.
    pub status: StatusBits,
}

impl Information {
    /// The generation of the hand.
    pub fn generation(&self) -> u8 {
        self.hardware.to_be_bytes()[0]
    }
}

/// The eight characters of the Serial reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Serial(pub [u8; 8]);

impl std::fmt::Display for Serial {
    /// As its maker prints it; bytes that are no printable ASCII become `?`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SAH040")?;
        self.0.iter().try_for_each(|&byte| {
            write!(f, "{}", if byte.is_ascii_graphic() { char::from(byte) } else { '?' })
        })
    }
}

/// From the hand to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HandMessage {
    /// Versions, side, temperature, status.
    Information(Information),
    /// The serial number.
    Serial(Serial),
    /// One finger's joint angles.
    Position {
        /// Which finger.
        finger: Finger,
        /// Encoder counts of its joints 0 to 3.
        counts: [i16; 4],
    },
    /// One finger's temperatures.
    Temperature {
        /// Which finger.
        finger: Finger,
        /// Its joints 0 to 3, °C. Older firmware fills only joint 0.
        celsius: [u8; 4],
    },
}
