//! The controller's input and output: receives bytes and frames, computes once, sends bytes and frames.

use std::time::Duration;

use super::axes::RAIL_AXIS;
use super::{Fault, Phase, Record, Robot};
use crate::allegro::HandEvent;
use crate::wires::Wires;
use crate::xarm::ArmState;

/// Time between two releases of a stopped hand: a frame may be lost, and a failed bus may come back.
const RELEASE_AGAIN: Duration = Duration::from_millis(100);

impl Robot {
    /// Receives what has arrived, computes what is due, and sends it. Call it at least every few milliseconds.
    pub fn poll(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.receive_midi(now, wires);
        if let Err(fault) = self.receive(now, wires) {
            self.fail_if_used(now, fault, wires);
        }
        let gap = now.saturating_sub(self.polled.unwrap_or(now));
        self.polled = Some(now);
        let fault = self.watch(now, gap);
        let fault = fault.or_else(|| self.advance(now).err()).or_else(|| self.lead_arm(now).err());
        if let Some(fault) = fault {
            self.fail(now, fault, wires);
        }
        self.update_fault(now);
        self.frames.clear();
        self.bytes.clear();
        let mut frames = std::mem::take(&mut self.frames);
        self.measured |= self.hand.poll(now, &mut frames) == HandEvent::Positions;
        if std::mem::take(&mut self.measured) {
            self.drive(now, &mut frames);
        }
        if self.is_released() && now.saturating_sub(self.released_at) >= RELEASE_AGAIN {
            self.released_at = now;
            if self.is_observed(now) {
                self.hand.release(now, &mut frames);
            } else {
                self.hand.stop(now, &mut frames);
            }
        }
        self.frames = frames;
        self.arm.poll(now, &mut self.bytes);
        if let Err(fault) = self.send(wires) {
            self.fail_if_used(now, fault, wires);
        }
    }

    /// Receives all frames before torques are computed, once and from the newest angles. After a late poll, torques from
    /// older periods would be computed from outdated angles.
    fn receive(&mut self, now: Duration, wires: &mut dyn Wires) -> Result<(), Fault> {
        let arm = self.receive_arm(now, wires);
        while let Some(frame) = wires.next_frame()? {
            self.measured |= self.hand.receive(now, &frame) == HandEvent::Positions;
        }
        arm
    }

    fn receive_midi(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.bytes.clear();
        self.changes.clear();
        let connected = wires.receive_midi(&mut self.bytes).is_ok();
        if connected != self.keyboard_connected {
            self.keyboard_connected = connected;
            if connected {
                self.keyboard.connected(now, &mut self.changes);
            } else {
                self.keyboard.disconnected(now, &mut self.changes);
            }
        }
        if connected {
            self.keyboard.receive(now, &self.bytes, &mut self.changes);
        }
        self.keyboard.poll(now, &mut self.changes);
        for change in &self.changes {
            self.journal.push(Record::Key(*change));
        }
    }

    fn receive_arm(&mut self, now: Duration, wires: &mut dyn Wires) -> Result<(), Fault> {
        self.bytes.clear();
        let connected = wires.receive_arm(&mut self.bytes).and_then(|()| {
            self.arm.receive_command(now, &self.bytes);
            self.bytes.clear();
            wires.receive_report(&mut self.bytes)
        });
        if connected.is_ok() != self.arm_connected {
            self.arm_connected = connected.is_ok();
            if self.arm_connected {
                self.arm.connected(now)
            } else {
                self.arm.disconnected(now)
            }
            if self.arm_connected && self.is_released() {
                // It may not have received the stop, and may still be moving.
                let mut stop = Vec::new();
                self.arm.stop(now, &mut stop);
                wires.send_arm(&stop)?;
            }
        }
        connected?;
        self.arm.receive_report(now, &self.bytes);
        if self.phase == Phase::Starting && !self.arm_told {
            self.arm_told = true;
            self.arm.start(now)?;
        }
        let Some(measured) = self.arm.joints().filter(|_| self.arm.joints_at() != self.arm_seen) else {
            return Ok(());
        };
        self.arm_seen = self.arm.joints_at();
        let place = self.path.place(&measured);
        self.palm_down = self.path.palm_down(&measured);
        let elsewhere = self.arm.sent().or(self.arm_stood);
        if self.is_live() && self.arm_sent.is_some() && self.arm.sent().is_some() {
            self.doubts.arm(now, &measured, &place, self.axes[RAIL_AXIS].position());
        } else if let Some(sent) = elsewhere.filter(|_| self.is_live()) {
            let on_its_way = self.plan.as_ref().is_some_and(|plan| plan.way.is_some());
            self.doubts.arm_elsewhere(now, &measured, &sent, on_its_way);
        }
        let record = Record::Arm { at: now, measured, sent: self.arm.sent(), rail_m: place.rail_m };
        self.journal.push(record);
        Ok(())
    }

    fn send(&mut self, wires: &mut dyn Wires) -> Result<(), Fault> {
        // A failed connection must not keep the other from being used.
        let frames = self.frames.iter().try_for_each(|frame| wires.send_frame(*frame));
        if !self.bytes.is_empty() {
            wires.send_arm(&self.bytes)?;
        }
        Ok(frames?)
    }

    /// A lost connection is a fault only while the robot is in use.
    fn fail_if_used(&mut self, now: Duration, fault: Fault, wires: &mut dyn Wires) {
        if self.is_used() {
            self.fail(now, fault, wires);
        }
    }

    fn fail(&mut self, now: Duration, fault: Fault, wires: &mut dyn Wires) {
        if self.phase == Phase::Fault {
            return;
        }
        self.journal.push(Record::Note { at: now, kind: "fault", text: fault.to_string() });
        self.release(now, wires);
        self.fault = Some(fault);
        self.enter(now, Phase::Fault);
    }

    /// Updates the fault when the arm has reported the number of its error, which is requested after the stop.
    fn update_fault(&mut self, now: Duration) {
        if let (Some(Fault::Arm(told)), ArmState::Fault(known)) = (&mut self.fault, self.arm.state())
            && *told != known
        {
            *told = known;
            self.journal.push(Record::Note { at: now, kind: "fault", text: Fault::Arm(known).to_string() });
        }
    }

    /// Releases the hand once more, and ends its reports: for a program that ends.
    pub fn leave(&mut self, wires: &mut dyn Wires) {
        self.frames.clear();
        self.hand.stop(self.released_at, &mut self.frames);
        for frame in &self.frames {
            let _ = wires.send_frame(*frame);
        }
    }

    /// Zero torque and servo off for the hand, state 4 for the arm; errors of the connections are ignored.
    pub(super) fn release(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.released_at = now;
        self.let_go_at.get_or_insert(now);
        self.frames.clear();
        self.bytes.clear();
        self.hand.release(now, &mut self.frames);
        self.arm.stop(now, &mut self.bytes);
        // A failed connection must not keep the other device from being stopped.
        for frame in &self.frames {
            let _ = wires.send_frame(*frame);
        }
        let _ = wires.send_arm(&self.bytes);
        self.plan = None;
        self.stream = None;
    }
}
