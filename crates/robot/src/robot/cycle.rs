//! The controller's cycle: receives, checks for faults, computes set-points and torques, and sends.

use std::time::Duration;

use super::axes::RAIL_AXIS;
use super::following_error::FollowingError;
use super::interlock::{Interlock, may_press};
use super::{Fault, Phase, Record, Robot};
use crate::allegro::{HandEvent, HandState};
use crate::can::CanFrame;
use crate::limiter::Axis;
use crate::wires::Wires;
use crate::xarm::{ArmState, untried};

/// Time between two releases of a stopped hand: a frame may be lost, and a failed bus may come
/// back.
const RELEASE_INTERVAL: Duration = Duration::from_millis(100);

impl Robot {
    /// Receives what has arrived, computes what is due, and sends it. Call it at least every few
    /// milliseconds.
    pub fn poll(&mut self, now: Duration, wires: &mut dyn Wires) {
        let stalled = self.stalls.poll(now).filter(|_| self.is_live());
        self.keyboard.receive(now, wires, &mut self.bytes, &mut self.status.journal);
        let received = self.receive(now, wires);
        // After a pause, what arrived meanwhile looks like a fault of a device.
        if let Some(fault) = stalled.or(received.err()) {
            self.fail_if_used(now, fault, wires);
        }
        let checked = self.check(now).and_then(|()| self.advance(now)).and_then(|()| self.move_arm(now));
        if let Err(fault) = checked {
            self.fail(now, fault, wires);
        }
        self.update_fault(now);
        self.bytes.clear();
        let mut frames = std::mem::take(&mut self.frames);
        frames.clear();
        self.has_new_angles |= self.hand.poll(now, &mut frames) == HandEvent::Positions;
        if std::mem::take(&mut self.has_new_angles) {
            self.drive(now, &mut frames);
        }
        if self.status.is_released() && now.saturating_sub(self.status.released_at) >= RELEASE_INTERVAL {
            self.status.released_at = now;
            if self.status.is_observed(now) {
                self.hand.release(now, &mut frames);
            } else {
                self.hand.stop(now, &mut frames);
            }
        }
        self.frames = frames;
        if self.phase() == Phase::Holding && !self.rail_arm.arm.has_measured_link() {
            self.rail_arm.arm.measure_link(now, &mut self.bytes);
        }
        self.rail_arm.arm.poll(now, &mut self.bytes);
        self.note_slow_link(now);
        if let Err(fault) = self.send(wires) {
            self.fail_if_used(now, fault, wires);
        }
    }

    /// Receives all frames before torques are computed, once and from the newest angles. After a
    /// late poll, torques from older periods would be computed from outdated angles.
    fn receive(&mut self, now: Duration, wires: &mut dyn Wires) -> Result<(), Fault> {
        let arm = self.receive_arm(now, wires);
        while let Some(frame) = wires.next_frame()? {
            self.has_new_angles |= self.hand.receive(now, &frame) == HandEvent::Positions;
        }
        arm
    }

    fn receive_arm(&mut self, now: Duration, wires: &mut dyn Wires) -> Result<(), Fault> {
        let report = self.rail_arm.receive(now, wires, &self.status, &mut self.bytes)?;
        let Some(report) = report else { return Ok(()) };
        let sent = self.rail_arm.arm.sent();
        if self.status.is_live() {
            if self.rail_arm.is_on_path() && sent.is_some() {
                let rail_m = self.set_points.rail().position();
                self.plausibility.arm(now, &report.joints, &report.place, rail_m);
            } else if let Some(sent) = self.rail_arm.sent_elsewhere() {
                let on_its_path = self.motion.has_arm_path();
                self.plausibility.arm_elsewhere(now, &report.joints, &sent, on_its_path);
            }
            if let Some(sent) = self.rail_arm.sent_elsewhere() {
                self.plausibility.arm_target(now, &report.joints, report.target.as_ref(), &sent);
            }
        }
        let rail_m = report.place.rail_m;
        self.status.journal.push(Record::Arm { at: now, measured: report.joints, sent, rail_m });
        Ok(())
    }

    /// The fault that is present now, if any.
    fn check(&self, now: Duration) -> Result<(), Fault> {
        if !self.status.is_used() {
            return Ok(());
        }
        if let HandState::Fault(fault) = self.hand.state() {
            return Err(fault.into());
        }
        if let ArmState::Fault(fault) = self.rail_arm.arm.state() {
            return Err(fault.into());
        }
        if let Some(lost) = self.keyboard.lost() {
            return Err(lost);
        }
        if !self.status.is_live() {
            return Ok(());
        }
        if let Some((joint, by_rad)) = self.following_error.found() {
            return Err(Fault::NotFollowing { joint, by_rad });
        }
        if let Some(implausible) = self.plausibility.found() {
            let arm = &self.rail_arm.arm;
            return Err(if implausible.is_lag() && arm.has_late_replies() {
                arm.late_replies().into()
            } else {
                implausible.clone().into()
            });
        }
        if self.motion.is_late(now) {
            return Err(self.rail_arm.arm.late_replies().into());
        }
        if self.phase() == Phase::Following {
            self.motion.check_age(now, self.config.limits.stale_command_secs)?;
        }
        Ok(())
    }

    /// Phases that end by themselves, and the set-points that are due.
    fn advance(&mut self, now: Duration) -> Result<(), Fault> {
        if self.phase() == Phase::Starting {
            if self.hand.state() == HandState::Ready && self.rail_arm.arm.state() == ArmState::Ready {
                self.rail_arm.check_serial()?;
                self.keyboard.check_present()?;
                self.settle(now)?;
                if let Some(text) = self.arm().version().and_then(untried) {
                    self.status.note(now, "warning", text);
                }
                self.status.enter(now, Phase::Holding);
            }
            return Ok(());
        }
        if !self.status.is_live() {
            return Ok(());
        }
        self.advance_plan(now)?;
        while let Some(at) = self.set_points.next_due(now) {
            let asked = self.motion.asked(at, &self.config.limits.thumb_rad);
            let rail = self.set_points.rail();
            let asked_m = asked.map_or(rail.position(), |asked| asked[RAIL_AXIS]);
            let held = self.interlock(now).holds_rail(rail, asked_m, &self.rail_arm);
            self.status.journal.push(self.set_points.step(asked, held));
        }
        Ok(())
    }

    /// Begins to hold still where the robot stands.
    fn settle(&mut self, now: Duration) -> Result<(), Fault> {
        let place = self.place();
        let hand = self.hand.positions();
        let measured = std::array::from_fn(|axis| hand.get(axis).copied().unwrap_or(place.rail_m));
        let outside = self.set_points.settle(now, measured)?;
        self.rail_arm.settle(now, &place, outside[RAIL_AXIS], self.set_points.rail().position())?;
        self.following_error = FollowingError::default();
        self.plausibility.begin_anew();
        Ok(())
    }

    /// Records that the arm is sent fewer targets than configured.
    fn note_slow_link(&mut self, now: Duration) {
        let period = self.rail_arm.arm.servo_period();
        let noted = self.noted_period.unwrap_or_else(|| self.config.arm.servo_period());
        if period > noted {
            self.noted_period = Some(period);
            self.status.note(now, "warning", format!("arm: {}", self.rail_arm.arm.link_speed()));
        }
    }

    /// Whether a finger among the keys is dragged along.
    fn interlock(&self, now: Duration) -> Interlock {
        Interlock::new(&self.hand, &self.set_points.reference(now), now)
    }

    /// Gives the arm the next target if it can be sent now.
    fn move_arm(&mut self, now: Duration) -> Result<(), Fault> {
        if !self.status.is_live() || !self.rail_arm.arm.takes_target(now) {
            return Ok(());
        }
        let pause = self.rail_arm.arm.pause(now);
        self.set_target(now, pause)?;
        if pause.is_some() {
            self.rail_arm.arm.resume(now);
        }
        Ok(())
    }

    fn set_target(&mut self, now: Duration, pause: Option<Duration>) -> Result<(), Fault> {
        if let Some(path) = self.motion.arm_path() {
            let joints = path.next(now, pause.is_some(), self.rail_arm.arm.servo_period());
            return Ok(self.rail_arm.arm.servo(now, joints)?);
        }
        let easing = (self.set_points.easing.left(now)[RAIL_AXIS], self.set_points.easing.share(now));
        let interlock = self.interlock(now);
        let (rail_m, at_m) = (self.set_points.rail().position(), self.rail_arm.place().rail_m);
        let brakes = |rail: &Axis| interlock.drags(rail, rail_m, at_m);
        self.rail_arm.follow_rail(now, pause, rail_m, easing, brakes)
    }

    /// One period of the joint loop.
    fn drive(&mut self, now: Duration, frames: &mut Vec<CanFrame>) {
        let at = self.hand.positions_at().unwrap_or(now);
        let positions = self.hand.positions();
        if !self.status.is_live() {
            if self.phase() == Phase::Starting || self.status.is_observed(now) {
                self.status.journal.push(Record::Idle { at, positions });
            }
            return;
        }
        let reference = self.set_points.reference(now);
        self.following_error.take(at, &positions, &reference, &self.config.limits);
        let mut wanted = self.joint_loop.pwm(at, &positions, &reference, self.rail_arm.palm_down());
        self.plausibility.override_with_probe(&mut wanted, &self.config.hand.pwm_limit);
        let pwm = self.hand.send_pwm(now, &wanted, frames);
        let may_press = may_press(&positions, self.rail_arm.is_on_path());
        self.plausibility.hand(at, &positions, &reference, &pwm, &self.config.hand.pwm_limit, may_press);
        self.status.journal.push(Record::Hand { at, positions, reference, wanted, pwm });
    }

    fn send(&self, wires: &mut dyn Wires) -> Result<(), Fault> {
        // A failed connection must not keep the other from being used.
        let frames = self.frames.iter().try_for_each(|frame| wires.send_frame(*frame));
        if !self.bytes.is_empty() {
            wires.send_arm(&self.bytes)?;
        }
        Ok(frames?)
    }

    /// A lost connection is a fault only while the robot is in use.
    fn fail_if_used(&mut self, now: Duration, fault: Fault, wires: &mut dyn Wires) {
        if self.status.is_used() {
            self.fail(now, fault, wires);
        }
    }

    fn fail(&mut self, now: Duration, fault: Fault, wires: &mut dyn Wires) {
        if self.phase() == Phase::Fault {
            return;
        }
        let fault = self.stalls.explain(now, fault);
        self.status.note(now, "fault", fault.to_string());
        self.release(now, wires);
        self.status.fault = Some(fault);
        self.status.enter(now, Phase::Fault);
    }

    /// Updates the fault when the arm has reported the number of its error, which is requested
    /// after the stop.
    fn update_fault(&mut self, now: Duration) {
        if let (Some(Fault::Arm(reported)), ArmState::Fault(known)) =
            (self.status.fault.as_ref().map(Fault::itself), self.rail_arm.arm.state())
            && *reported != known
        {
            let fault = self.stalls.explain(now, known.into());
            self.status.note(now, "fault", fault.to_string());
            self.status.fault = Some(fault);
        }
    }

    /// Zero torque and servo off for the hand, state 4 for the arm; errors of the connections are
    /// ignored.
    pub(super) fn release(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.status.released_at = now;
        self.status.first_released_at.get_or_insert(now);
        self.frames.clear();
        self.bytes.clear();
        self.hand.release(now, &mut self.frames);
        self.rail_arm.arm.stop(now, &mut self.bytes);
        // A failed connection must not keep the other device from being stopped.
        for frame in &self.frames {
            let _ = wires.send_frame(*frame);
        }
        let _ = wires.send_arm(&self.bytes);
        self.motion.clear();
    }
}
