//! The wires of a robot, as its controller sees them: frames and bytes that have come, and frames and bytes to send.

use std::time::{Duration, Instant};

use crate::can::{self, CanError, CanFrame, CanTransport};
use crate::keyboard::{self, MidiError, MidiSource};
use crate::rig::WiresConfig;
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

/// Time between two tries to find a keyboard again.
const TRY_AGAIN: Duration = Duration::from_secs(1);

/// The wires that a rig's file names.
pub struct OpenWires {
    can: Box<dyn CanTransport>,
    arm: ArmConnection,
    midi_spec: String,
    midi: Option<Box<dyn MidiSource>>,
    midi_tried: Instant,
}

impl OpenWires {
    /// Opens all three.
    ///
    /// # Errors
    /// If one of them is not there; the message says what to do.
    pub fn open(config: &WiresConfig) -> Result<Self, RobotError> {
        Ok(Self {
            can: can::open(&config.can)?,
            arm: ArmConnection::open(&config.arm)?,
            midi: Some(keyboard::open(&config.midi)?),
            midi_spec: config.midi.clone(),
            midi_tried: Instant::now(),
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
        self.arm.send(bytes)
    }

    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.arm.receive_commands(bytes)
    }

    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.arm.receive_reports(bytes)
    }

    /// A keyboard that is gone is looked for again once a second.
    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError> {
        if self.midi.is_none() && self.midi_tried.elapsed() >= TRY_AGAIN {
            self.midi_tried = Instant::now();
            self.midi = keyboard::open(&self.midi_spec).ok();
        }
        let gone = || MidiError::Gone { spec: self.midi_spec.clone(), message: "not found again yet".into() };
        let source = self.midi.as_mut().ok_or_else(gone)?;
        source.receive(bytes).inspect_err(|_| self.midi = None)
    }
}
