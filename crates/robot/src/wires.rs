//! The connections between a controller and its devices: received and sent frames and bytes.

use std::time::Instant;

use crate::can::{self, CanError, CanFrame, CanTransport};
use crate::keyboard::{MidiError, MidiPort};
use crate::rig_file::WiresConfig;
use crate::robot::RobotError;
use crate::xarm::{ArmConnection, ArmLinkError};

/// Everything that connects a controller with its devices. No call blocks.
pub trait Wires {
    /// Sends a frame to the hand.
    ///
    /// # Errors
    /// If the bus is gone or off.
    fn send_frame(&mut self, frame: CanFrame) -> Result<(), CanError>;

    /// The next frame from the hand, if there is one.
    ///
    /// # Errors
    /// If the bus is gone or off.
    fn next_frame(&mut self) -> Result<Option<CanFrame>, CanError>;

    /// Sends bytes to the arm's command port.
    ///
    /// # Errors
    /// If the connection is gone.
    fn send_arm(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError>;

    /// Appends what has come from the arm's command port.
    ///
    /// # Errors
    /// If the connection is gone.
    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError>;

    /// Appends what has come from the arm's report port.
    ///
    /// # Errors
    /// If the connection is gone.
    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError>;

    /// Appends what has come from the keyboard.
    ///
    /// # Errors
    /// If the keyboard is gone; it may come back.
    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError>;
}

/// The connections that a rig's file names.
pub struct OpenWires {
    can: Box<dyn CanTransport>,
    arm: ArmConnection,
    midi: MidiPort,
    opened: Instant,
}

impl OpenWires {
    /// Opens all three.
    ///
    /// # Errors
    /// If one of them cannot be opened; the message names the remedy.
    pub fn open(config: &WiresConfig) -> Result<Self, RobotError> {
        Ok(Self {
            can: can::open(&config.can)?,
            arm: ArmConnection::open(&config.arm)?,
            midi: MidiPort::open(&config.midi)?,
            opened: Instant::now(),
        })
    }
}

impl Wires for OpenWires {
    fn send_frame(&mut self, frame: CanFrame) -> Result<(), CanError> {
        self.can.send(frame)
    }

    fn next_frame(&mut self) -> Result<Option<CanFrame>, CanError> {
        self.can.receive()
    }

    fn send_arm(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        self.arm.commands.send(bytes)
    }

    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.arm.commands.receive(bytes)
    }

    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.arm.receive_reports(bytes)
    }

    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError> {
        self.midi.receive(self.opened.elapsed(), bytes)
    }
}
