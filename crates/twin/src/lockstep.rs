//! A controller and a twin in lockstep: no sockets and no clock, so hours pass in minutes and the
//! same policy, parameter set and seed give the same recording, byte for byte.

use std::time::Duration;

use etude_emulators::faults::{FaultKind, FaultPlan, FaultPlanError, Faults, FaultyBytes, FaultyFrames};
use etude_emulators::{ConnectionId, ReportKind};
use etude_robot::allegro::{DeviceId, HandMessage};
use etude_robot::can::{CanError, CanFrame};
use etude_robot::keyboard::MidiError;
use etude_robot::wires::Wires;
use etude_robot::xarm::ArmLinkError;
use etude_robot::{Pace, Robot};

use crate::error::TwinParamsError;
use crate::hidden_params::{LinkParams, STEP};
use crate::twin::{Twin, TwinError};

/// A twin at the other end of a controller's wires.
pub struct Lockstep {
    /// The twin.
    pub twin: Twin,
    /// Which reports of the arm its controller listens to.
    pub reports: ReportKind,
    wires: Links,
    client: ConnectionId,
    frames: Vec<CanFrame>,
    bytes: Vec<u8>,
}

/// The wires between them, with their faults.
struct Links {
    now: Duration,
    faults: Faults,
    to_hand: FaultyFrames,
    from_hand: FaultyFrames,
    to_arm: FaultyBytes,
    from_arm: FaultyBytes,
    reports: FaultyBytes,
    midi: FaultyBytes,
}

impl Links {
    fn new(links: &LinkParams, faults: Faults, seed: u64) -> Result<Self, FaultPlanError> {
        // Every link has its own random draws.
        let plan = |plan: &FaultPlan, number: u64| FaultPlan {
            seed: plan.seed.wrapping_add(seed).wrapping_mul(8).wrapping_add(number),
            ..plan.clone()
        };
        Ok(Self {
            now: Duration::ZERO,
            faults,
            to_hand: FaultyFrames::new(&plan(&links.can, 0))?,
            from_hand: FaultyFrames::new(&plan(&links.can, 1))?,
            to_arm: FaultyBytes::new(&plan(&links.arm, 2))?,
            from_arm: FaultyBytes::new(&plan(&links.arm, 3))?,
            reports: FaultyBytes::new(&plan(&links.arm, 4))?,
            midi: FaultyBytes::new(&plan(&links.midi, 5))?,
        })
    }
}

impl Lockstep {
    /// Connects a twin by the links of its parameters. Delays of less than a step of the twin, a
    /// millisecond, are one.
    ///
    /// # Errors
    /// If the faults of the links are not valid.
    pub fn new(mut twin: Twin) -> Result<Self, TwinError> {
        let client = twin.devices.arm.connect();
        let hidden = &twin.twin_params.hidden;
        let wires = Links::new(&hidden.links, Faults::new(&hidden.faults), twin.twin_params.run_seed())
            .map_err(TwinParamsError::from)?;
        let reports = ReportKind::Real;
        Ok(Self { twin, reports, wires, client, frames: Vec::new(), bytes: Vec::new() })
    }

    /// Begins a fault now, in addition to those that the parameter set orders.
    pub fn begin(&mut self, fault: FaultKind) {
        let now = self.twin.now();
        self.wires.faults.begin(fault, &mut self.twin.devices, now);
    }

    /// Ends one fault of this kind.
    pub fn end(&mut self, fault: FaultKind) {
        let now = self.twin.now();
        self.wires.faults.end(fault, &mut self.twin.devices, now);
    }

    /// Ends all faults.
    pub fn end_all(&mut self) {
        let now = self.twin.now();
        self.wires.faults.end_all(&mut self.twin.devices, now);
    }

    /// Whether this fault is active now.
    pub(crate) fn has(&self, fault: FaultKind) -> bool {
        self.wires.faults.has(fault)
    }

    /// One step of the twin without its controller: delivers what has arrived to its devices, and
    /// sends their answers.
    pub fn step(&mut self) {
        let now = self.wires.now + STEP;
        self.bytes.clear();
        self.wires.to_arm.pop(now, &mut self.bytes);
        if self.has(FaultKind::ArmDisconnect) {
            self.bytes.clear();
        }
        self.twin.devices.arm.receive(now, self.client, &self.bytes);
        self.step_apart_from_the_arm();
        let (twin, wires, client, reports) = (&mut self.twin, &mut self.wires, self.client, self.reports);
        send(&mut wires.from_arm, now, &mut self.bytes, |out| twin.devices.arm.take(client, out));
        send(&mut wires.reports, now, &mut self.bytes, |out| twin.devices.arm.take_reports(reports, out));
    }

    /// The same without the arm's connections, for the server.
    pub(crate) fn step_apart_from_the_arm(&mut self) {
        let now = self.wires.now + STEP;
        self.wires.now = now;
        let (twin, wires) = (&mut self.twin, &mut self.wires);
        let began = twin.now();
        wires.faults.advance(&mut twin.devices, began);
        let silent = wires.faults.has(FaultKind::CanSilent) || wires.faults.has(FaultKind::CanBusOff);
        self.frames.clear();
        while let Some(frame) = wires.to_hand.pop(now) {
            if !silent {
                twin.devices.hand.receive(now, &frame, &mut self.frames);
            }
        }
        twin.step();
        twin.devices.hand.tick(now, &mut self.frames);
        for frame in &self.frames {
            if !silent && !finger_of(frame).is_some_and(|finger| wires.faults.silences(finger)) {
                wires.from_hand.push(now, *frame);
            }
        }
        send(&mut wires.midi, now, &mut self.bytes, |out| twin.devices.keyboard.poll(now, out));
    }
}

/// The finger whose positions a frame of the hand has.
fn finger_of(frame: &CanFrame) -> Option<usize> {
    match HandMessage::decode(DeviceId::default(), frame) {
        Some(HandMessage::Position { finger, .. }) => Some(finger.number()),
        _ => None,
    }
}

/// Sends what a device has written.
fn send(link: &mut FaultyBytes, now: Duration, bytes: &mut Vec<u8>, say: impl FnOnce(&mut Vec<u8>)) {
    bytes.clear();
    say(bytes);
    if !bytes.is_empty() {
        link.push(now, bytes);
    }
}

impl Pace for Lockstep {
    fn now(&self) -> Duration {
        self.wires.now
    }

    fn run_until(&mut self, robot: &mut Robot, until: Duration) {
        while self.wires.now + STEP <= until {
            self.step();
            robot.poll(self.wires.now, &mut self.wires);
        }
    }

    fn wires(&mut self) -> &mut dyn Wires {
        &mut self.wires
    }
}

impl Links {
    /// Whether the controller's end of the bus works, with the error that SocketCAN would give.
    fn check_can(&self, link: &FaultyFrames) -> Result<(), CanError> {
        if self.faults.has(FaultKind::CanBusOff) {
            return Err(CanError::off("twin", "can0"));
        }
        if link.is_connected(self.now) {
            return Ok(());
        }
        Err(CanError::Broken { bus: "twin".into(), message: "the link is cut".into() })
    }

    fn check_arm(&self, link: &FaultyBytes) -> Result<(), ArmLinkError> {
        if link.is_connected(self.now) && !self.faults.has(FaultKind::ArmDisconnect) {
            return Ok(());
        }
        let source = std::io::Error::new(std::io::ErrorKind::NotConnected, "the link is cut");
        Err(ArmLinkError::Broken { doing: "talking to the twin", source })
    }
}

impl Wires for Links {
    fn send_frame(&mut self, frame: CanFrame) -> Result<(), CanError> {
        self.check_can(&self.to_hand)?;
        self.to_hand.push(self.now, frame);
        Ok(())
    }

    fn next_frame(&mut self) -> Result<Option<CanFrame>, CanError> {
        if self.faults.has(FaultKind::CanSilent) || self.faults.has(FaultKind::CanBusOff) {
            // Bytes on their way are lost.
            while self.from_hand.pop(self.now).is_some() {}
        }
        self.check_can(&self.from_hand)?;
        Ok(self.from_hand.pop(self.now))
    }

    fn send_arm(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        self.check_arm(&self.to_arm)?;
        self.to_arm.push(self.now, bytes);
        Ok(())
    }

    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        let state = self.check_arm(&self.from_arm);
        let had = bytes.len();
        self.from_arm.pop(self.now, bytes);
        if self.faults.has(FaultKind::ArmDisconnect) {
            bytes.truncate(had);
        }
        state
    }

    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        let state = self.check_arm(&self.reports);
        let had = bytes.len();
        self.reports.pop(self.now, bytes);
        if self.faults.has(FaultKind::ArmDisconnect) {
            bytes.truncate(had);
        }
        state
    }

    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError> {
        let had = bytes.len();
        self.midi.pop(self.now, bytes);
        let unplugged = self.faults.has(FaultKind::KeyboardUnplugged);
        if unplugged || self.faults.has(FaultKind::KeyboardSilent) {
            bytes.truncate(had);
        }
        if self.midi.is_connected(self.now) && !unplugged {
            return Ok(());
        }
        Err(MidiError::Lost { spec: "twin".into(), message: "its plug is out".into() })
    }
}
