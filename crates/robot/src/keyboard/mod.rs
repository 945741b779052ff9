//! The MIDI keyboard: its byte stream, which keys are down, and the transports of the bytes.

#[cfg(all(feature = "hardware", target_os = "linux"))]
mod alsa;
mod config;
mod driver;
mod parser;
mod port;
mod shift;
mod source;
mod transport;

pub use config::{KeyboardConfig, MAX_LOWEST_PITCH};
pub use driver::{KeyChange, Keyboard, KeyboardState, KeyboardWarning, LossReason};
pub use parser::{MidiEvent, MidiParser};
pub use port::MidiPort;
pub use shift::Shift;
pub use source::{MidiError, MidiSource};
pub use transport::open;

/// Keys of the keyboard, four octaves and a C.
///
/// As on the paper's M-Audio Keystation 49e.
pub const KEY_COUNT: usize = 49;
