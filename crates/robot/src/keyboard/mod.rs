//! The MIDI keyboard: what its bytes say about which keys are down, and what carries the bytes.

#[cfg(all(feature = "hardware", target_os = "linux"))]
mod alsa;
mod config;
mod driver;
mod parser;
mod port;
mod shift;
mod source;
mod transport;

pub use config::{KeyboardConfig, check_lowest_pitch, positive_secs};
pub use driver::{KeyChange, Keyboard, KeyboardCounts, KeyboardState, KeyboardWarning, LossReason};
pub use parser::{MidiEvent, MidiParser};
pub use port::MidiPort;
pub use shift::Shift;
pub use source::{MidiError, MidiSource};
pub use transport::open;

/// Keys of the keyboard, four octaves and a C.
///
/// Source: fact sheet hardware §3.
pub const KEYS: usize = 49;
