//! Watches the devices of a rig without changing anything: sends only requests that are always
//! allowed.

use std::fmt::Display;
use std::time::Duration;

use etude_checks::RangeError;

use crate::allegro::{Finger, HandMessage, HostMessage, Information, Request, WIRE_JOINTS, rad_from_counts};
use crate::can::{self, CanTransport};
use crate::keyboard::{self, KeyChange, Keyboard, MidiSource};
use crate::rig_file::RigConfig;
use crate::xarm::ArmConnection;
use crate::xarm::report::{Report, ReportParser};

/// The last data of each device. `Err` holds the reason why a device is not connected.
#[derive(Debug)]
pub struct Seen {
    /// Angles of the hand's joints as on the wire, rad, and its Information reply.
    pub hand: Result<(Option<[f64; WIRE_JOINTS]>, Option<Information>), String>,
    /// The newest report of the arm.
    pub arm: Result<Option<Report>, String>,
    /// Keys that are down: bit 0 is the lowest.
    pub keyboard: Result<u64, String>,
}

/// Watches the devices of a rig. It never sends a command that moves or switches one.
pub struct Monitor {
    config: RigConfig,
    bus: Result<Box<dyn CanTransport>, String>,
    counts: [Option<[i16; 4]>; 4],
    information: Option<Information>,
    arm: Result<ArmConnection, String>,
    reports: ReportParser,
    report: Option<Report>,
    midi: Result<Box<dyn MidiSource>, String>,
    keyboard: Keyboard,
    bytes: Vec<u8>,
    changes: Vec<KeyChange>,
}

impl Monitor {
    /// Opens the devices that are connected. Most keyboards have one reader: without `keyboard_too`
    /// the keyboard is left to a controller.
    ///
    /// # Errors
    /// If the keyboard's settings are not sound.
    pub fn open(config: &RigConfig, keyboard_too: bool) -> Result<Self, RangeError> {
        let wires = &config.wires;
        let mut keyboard = Keyboard::new(&config.keyboard)?;
        let mut changes = Vec::new();
        let midi = if keyboard_too {
            keyboard::open(&wires.midi).map_err(|error| error.to_string())
        } else {
            Err("left to the controller that uses the rig".to_string())
        };
        if midi.is_ok() {
            keyboard.connected(Duration::ZERO, &mut changes);
        }
        Ok(Self {
            bus: can::open(&wires.can).map_err(|error| error.to_string()),
            counts: [None; 4],
            information: None,
            arm: ArmConnection::open(&wires.arm).map_err(|error| error.to_string()),
            reports: ReportParser::default(),
            report: None,
            midi,
            keyboard,
            config: config.clone(),
            bytes: Vec::new(),
            changes,
        })
    }

    /// Requests the hand's positions and its Information.
    pub fn ask(&mut self) {
        for request in Finger::ALL.map(Request::Position).into_iter().chain([Request::Information]) {
            let frame = HostMessage::Request(request).encode(self.config.hand.device_id);
            used(&mut self.bus, |bus| bus.send(frame));
        }
    }

    /// Receives what has arrived by `now`.
    pub fn poll(&mut self, now: Duration) {
        while let Some(Some(frame)) = used(&mut self.bus, |bus| bus.receive()) {
            match HandMessage::decode(self.config.hand.device_id, &frame) {
                Some(HandMessage::Position { finger, counts }) => {
                    self.counts[finger.number()] = Some(counts);
                }
                Some(HandMessage::Information(information)) => self.information = Some(information),
                _ => {}
            }
        }
        let (replies, bytes) = (&mut Vec::new(), &mut self.bytes);
        bytes.clear();
        used(&mut self.arm, |arm| arm.commands.receive(replies).and_then(|()| arm.receive_reports(bytes)));
        let mut reports = bytes.as_slice();
        while let Some(report) = self.reports.next(&mut reports) {
            self.report = Some(report);
        }
        bytes.clear();
        self.changes.clear();
        used(&mut self.midi, |midi| midi.receive(bytes));
        self.keyboard.receive(now, bytes, &mut self.changes);
        self.keyboard.poll(now, &mut self.changes);
    }

    /// The last data of each device.
    pub fn seen(&self) -> Seen {
        let angles = || {
            let mut angles = [0.0; WIRE_JOINTS];
            for (four, counts) in angles.chunks_exact_mut(4).zip(&self.counts) {
                let counts = (*counts)?;
                for (angle, count) in four.iter_mut().zip(counts) {
                    *angle = rad_from_counts(count);
                }
            }
            Some(angles)
        };
        Seen {
            hand: self.bus.as_ref().map(|_| (angles(), self.information)).map_err(Clone::clone),
            arm: self.arm.as_ref().map(|_| self.report).map_err(Clone::clone),
            keyboard: self.midi.as_ref().map(|_| self.keyboard.pressed()).map_err(Clone::clone),
        }
    }
}

/// What a device that is connected gives. One that fails is not connected from then on.
fn used<T, V, E: Display>(
    device: &mut Result<T, String>,
    use_it: impl FnOnce(&mut T) -> Result<V, E>,
) -> Option<V> {
    match use_it(device.as_mut().ok()?) {
        Ok(value) => Some(value),
        Err(error) => {
            *device = Err(error.to_string());
            None
        }
    }
}
