//! Emulators of the robot's devices, which answer with the same bytes as the real ones; the servers
//! that offer them to other processes; and the injection of faults. For tests and for the twin: no
//! driver depends on this crate.
//!
//! An emulator is a state machine, like the drivers of `etude-robot`: it receives bytes or frames
//! and the time, and returns bytes or frames.
//!
//! | device | emulator | its other end |
//! |---|---|---|
//! | Allegro hand | [`HandEmulator`], with [`FreeHand`] for joints without a physics engine | [`VirtualBus`] |
//! | xArm7 | [`ArmEmulator`] | [`ArmServer`] |
//! | keyboard | [`KeyboardEmulator`] | [`MidiServer`] |
//!
//! [`faults`] holds the faults of links and devices.
//!
//! ```
//! use std::time::Duration;
//! use etude_emulators::{KeyboardEmulator, KeyboardEmulatorConfig};
//! use etude_robot::keyboard::{Keyboard, KeyboardConfig};
//!
//! let mut keyboard = Keyboard::new(&KeyboardConfig::default())?;
//! let mut emulator = KeyboardEmulator::new(&KeyboardEmulatorConfig::default())?;
//! let (mut wire, mut changes) = (Vec::new(), Vec::new());
//! let now = Duration::from_millis(10);
//!
//! keyboard.connected(Duration::ZERO, &mut changes);
//! emulator.press(now, 24, 100); // the middle C of the 49 keys
//! emulator.poll(now, &mut wire);
//! keyboard.receive(now, &wire, &mut changes);
//! assert_eq!(keyboard.pressed(), 1 << 24);
//! # Ok::<(), etude_checks::RangeError>(())
//! ```

mod arm;
pub mod faults;
mod free_hand;
mod hand;
mod keyboard;
mod midi_server;
mod socket;
mod virtual_bus;

pub use arm::{ArmEmulator, ArmEmulatorConfig, ArmPorts, ArmServer, ConnectionId, ReportKind};
pub use free_hand::FreeHand;
pub use hand::{HandEmulator, HandEmulatorConfig};
pub use keyboard::{KeyboardEmulator, KeyboardEmulatorConfig, Line, ReleaseCoding};
pub use midi_server::MidiServer;
pub use virtual_bus::VirtualBus;

/// The three emulated devices of a robot.
#[derive(Debug)]
pub struct Devices {
    /// The hand.
    pub hand: HandEmulator,
    /// The arm.
    pub arm: ArmEmulator,
    /// The keyboard.
    pub keyboard: KeyboardEmulator,
}
