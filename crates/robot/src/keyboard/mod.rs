//! The MIDI keyboard: what its bytes say about which keys are down, what carries the bytes, and an emulator
//! of it.
//!
//! ```
//! use std::time::Duration;
//! use etude_robot::keyboard::{EmulatorConfig, Keyboard, KeyboardConfig, KeyboardEmulator};
//!
//! let mut keyboard = Keyboard::new(&KeyboardConfig::default())?;
//! let mut emulator = KeyboardEmulator::new(&EmulatorConfig::default())?;
//! let (mut wire, mut changes) = (Vec::new(), Vec::new());
//! let now = Duration::from_millis(10);
//!
//! keyboard.connected(Duration::ZERO, &mut changes);
//! emulator.press(now, 24, 100); // the middle C of the 49 keys
//! emulator.poll(now, &mut wire);
//! keyboard.receive(now, &wire, &mut changes);
//! assert_eq!(keyboard.pressed(), 1 << 24);
//! # Ok::<(), etude_robot::keyboard::KeyboardConfigError>(())
//! ```

#[cfg(all(feature = "hardware", target_os = "linux"))]
mod alsa;
mod config;
mod driver;
mod emulator;
mod parser;
mod port;
mod shift;
mod transport;

pub use config::{KeyboardConfig, KeyboardConfigError};
pub use driver::{KeyChange, Keyboard, KeyboardCounts, KeyboardState, KeyboardWarning, LossReason};
pub use emulator::{EmulatorConfig, KeyboardEmulator, Line, ReleaseCoding};
pub use parser::{MidiEvent, MidiParser};
pub use port::MidiPort;
pub use shift::Shift;
pub use transport::{MidiError, MidiOutlet, MidiSource, open};

/// Keys of the keyboard, four octaves and a C.
///
/// Source: fact sheet hardware §3.
pub const KEYS: usize = 49;
