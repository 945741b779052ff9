//! One classic CAN frame with a standard identifier, and the trait of its transports.

/// A classic CAN frame with an 11-bit identifier: data of at most eight bytes, or a remote request.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct CanFrame {
    id: u16,
    remote: bool,
    len: u8,
    data: [u8; 8],
}

impl CanFrame {
    /// Largest standard identifier.
    pub const MAX_ID: u16 = 0x7FF;

    /// A data frame; `None` if the identifier has more than 11 bits or there are more than eight
    /// bytes.
    pub fn new(id: u16, payload: &[u8]) -> Option<Self> {
        (id <= Self::MAX_ID && payload.len() <= 8).then(|| Self::of(id, payload))
    }

    /// A remote request without data; `None` if the identifier has more than 11 bits.
    pub fn remote(id: u16) -> Option<Self> {
        (id <= Self::MAX_ID).then(|| Self::remote_of(id))
    }

    /// A data frame that is right by construction: more than 11 bits or eight bytes are cut off.
    pub(crate) fn of(id: u16, payload: &[u8]) -> Self {
        let mut data = [0; 8];
        data.iter_mut().zip(payload).for_each(|(to, from)| *to = *from);
        Self { id: id & Self::MAX_ID, remote: false, len: payload.len().min(8) as u8, data }
    }

    /// As [`of`](Self::of), for a remote request.
    pub(crate) fn remote_of(id: u16) -> Self {
        Self { remote: true, ..Self::of(id, &[]) }
    }

    /// The 11-bit identifier.
    pub fn id(&self) -> u16 {
        self.id
    }

    /// Whether this asks for data instead of carrying it.
    pub fn is_remote(&self) -> bool {
        self.remote
    }

    /// The bytes that it carries.
    pub fn payload(&self) -> &[u8] {
        &self.data[..usize::from(self.len)]
    }
}

impl std::fmt::Debug for CanFrame {
    /// As `candump` prints it: `180#77 01`, or `200#R` for a remote request.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:03X}#", self.id)?;
        if self.remote {
            return write!(f, "R");
        }
        let bytes: Vec<String> = self.payload().iter().map(|byte| format!("{byte:02X}")).collect();
        write!(f, "{}", bytes.join(" "))
    }
}

/// The bus cannot be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum CanError {
    /// It cannot be opened.
    #[error("cannot open the CAN bus {bus}: {message}")]
    Open {
        /// Which one.
        bus: String,
        /// Why, and what to do.
        message: String,
    },
    /// Its controller has counted too many errors and has switched itself off: nothing is sent or
    /// received until it is reset.
    #[error(
        "the CAN controller of {bus} is in bus-off, after too many errors: check the hand's supply, the cable, its \
         terminator and the bit rate, then type {reset}, and start again"
    )]
    Off {
        /// Which one.
        bus: String,
        /// What to type.
        reset: String,
    },
    /// It was there and is gone, or refuses frames.
    #[error("the CAN bus {bus} fails: {message}")]
    Broken {
        /// Which one.
        bus: String,
        /// Why.
        message: String,
    },
}

impl CanError {
    /// A bus whose controller is in bus-off; `interface` is what an operator resets.
    pub fn off(bus: &str, interface: &str) -> Self {
        let reset = format!("`ip link set {interface} down` and `{}`", bring_up(interface));
        Self::Off { bus: bus.to_owned(), reset }
    }
}

/// What to type so that an interface is up.
pub(super) fn bring_up(interface: &str) -> String {
    if interface.starts_with("vcan") {
        format!("ip link set {interface} up")
    } else {
        format!("ip link set {interface} up type can bitrate 1000000")
    }
}

/// Carries frames. Neither call blocks.
pub trait CanTransport: Send {
    /// Sends one frame.
    ///
    /// # Errors
    /// If the bus is gone or off.
    fn send(&mut self, frame: CanFrame) -> Result<(), CanError>;

    /// The next frame that has arrived, if any.
    ///
    /// # Errors
    /// If the bus is gone or off.
    fn receive(&mut self) -> Result<Option<CanFrame>, CanError>;
}
