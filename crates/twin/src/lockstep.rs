//! A controller and a twin in lockstep: no sockets and no clock, so hours pass in minutes and the same policy, truth and
//! seed give the same recording, byte for byte.

use std::time::Duration;

use etude_robot::can::{CanError, CanFrame};
use etude_robot::faults::{FaultPlan, FaultPlanError, FaultyBytes, FaultyFrames};
use etude_robot::keyboard::MidiError;
use etude_robot::wires::Wires;
use etude_robot::xarm::report::ReportKind;
use etude_robot::xarm::{ArmLinkError, ConnectionId};
use etude_robot::{Pace, Robot};

use crate::numbers::LinksTruth;
use crate::truth::TruthError;
use crate::twin::{STEP, Twin, TwinError};

/// A twin at the other end of a controller's wires.
pub struct Lockstep {
    /// The twin.
    pub twin: Twin,
    wires: Links,
    client: ConnectionId,
    frames: Vec<CanFrame>,
    bytes: Vec<u8>,
}

/// The wires between them, with their faults.
struct Links {
    now: Duration,
    to_hand: FaultyFrames,
    from_hand: FaultyFrames,
    to_arm: FaultyBytes,
    from_arm: FaultyBytes,
    reports: FaultyBytes,
    midi: FaultyBytes,
}

impl Links {
    fn new(truth: &LinksTruth, seed: u64) -> Result<Self, FaultPlanError> {
        // Every link throws dice of its own.
        let plan = |plan: &FaultPlan, number: u64| FaultPlan {
            seed: plan.seed.wrapping_add(seed).wrapping_mul(8).wrapping_add(number),
            ..plan.clone()
        };
        Ok(Self {
            now: Duration::ZERO,
            to_hand: FaultyFrames::new(&plan(&truth.can, 0))?,
            from_hand: FaultyFrames::new(&plan(&truth.can, 1))?,
            to_arm: FaultyBytes::new(&plan(&truth.arm, 2))?,
            from_arm: FaultyBytes::new(&plan(&truth.arm, 3))?,
            reports: FaultyBytes::new(&plan(&truth.arm, 4))?,
            midi: FaultyBytes::new(&plan(&truth.midi, 5))?,
        })
    }
}

impl Lockstep {
    /// Connects a twin by the links of its truth. Delays of less than a step of the twin, a millisecond, are one.
    ///
    /// # Errors
    /// If the faults of the links make no sense.
    pub fn new(mut twin: Twin) -> Result<Self, TwinError> {
        let client = twin.arm.connect();
        let wires = Links::new(&twin.truth.numbers.links, twin.truth.run_seed()).map_err(TruthError::from)?;
        Ok(Self { twin, wires, client, frames: Vec::new(), bytes: Vec::new() })
    }

    /// One step of the twin without its controller: what has arrived reaches its devices, and what they say sets out.
    pub fn step(&mut self) {
        let now = self.wires.now + STEP;
        self.bytes.clear();
        self.wires.to_arm.pop(now, &mut self.bytes);
        self.twin.arm.receive(now, self.client, &self.bytes);
        self.step_apart_from_the_arm();
        let (twin, wires, client) = (&mut self.twin, &mut self.wires, self.client);
        send(&mut wires.from_arm, now, &mut self.bytes, |out| twin.arm.take(client, out));
        send(&mut wires.reports, now, &mut self.bytes, |out| twin.arm.take_reports(ReportKind::Real, out));
    }

    /// The same for whoever serves the arm by other means.
    pub(crate) fn step_apart_from_the_arm(&mut self) {
        let now = self.wires.now + STEP;
        self.wires.now = now;
        let (twin, wires) = (&mut self.twin, &mut self.wires);
        self.frames.clear();
        while let Some(frame) = wires.to_hand.pop(now) {
            twin.hand.receive(now, &frame, &mut self.frames);
        }
        twin.step();
        twin.hand.tick(now, &mut self.frames);
        for frame in &self.frames {
            wires.from_hand.push(now, *frame);
        }
        send(&mut wires.midi, now, &mut self.bytes, |out| twin.keyboard.poll(now, out));
    }
}

/// Sends on what a device has to say.
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

impl Wires for Links {
    fn send_frame(&mut self, frame: CanFrame) -> Result<(), CanError> {
        can_holds(&self.to_hand, self.now)?;
        self.to_hand.push(self.now, frame);
        Ok(())
    }

    fn next_frame(&mut self) -> Result<Option<CanFrame>, CanError> {
        can_holds(&self.from_hand, self.now)?;
        Ok(self.from_hand.pop(self.now))
    }

    fn send_arm(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        arm_holds(&self.to_arm, self.now)?;
        self.to_arm.push(self.now, bytes);
        Ok(())
    }

    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.from_arm.pop(self.now, bytes);
        arm_holds(&self.from_arm, self.now)
    }

    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.reports.pop(self.now, bytes);
        arm_holds(&self.reports, self.now)
    }

    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError> {
        self.midi.pop(self.now, bytes);
        if self.midi.is_connected(self.now) {
            return Ok(());
        }
        Err(MidiError::Gone { spec: "twin".into(), message: "the link is cut".into() })
    }
}

fn can_holds(link: &FaultyFrames, now: Duration) -> Result<(), CanError> {
    if link.is_connected(now) {
        return Ok(());
    }
    Err(CanError::Broken { bus: "twin".into(), message: "the link is cut".into() })
}

fn arm_holds(link: &FaultyBytes, now: Duration) -> Result<(), ArmLinkError> {
    if link.is_connected(now) {
        return Ok(());
    }
    let source = std::io::Error::new(std::io::ErrorKind::NotConnected, "the link is cut");
    Err(ArmLinkError::Broken { doing: "talking to the twin", source })
}
