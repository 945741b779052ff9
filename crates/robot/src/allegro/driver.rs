//! The driver of the hand: starts it, watches it, and is the only path for torques.
//!
//! In each cycle, pass every frame that has arrived to [`Hand::receive`] and call [`Hand::poll`].
//! If either returns [`HandEvent::Positions`], compute torques once and call [`Hand::send_pwm`].
//! The hand's position frames are thus the clock. `assembly` handles lost, duplicate and late
//! frames; `encoder` rejects implausible readings.
//!
//! No public source says what a hand does when torque frames stop, so the driver assumes the worst:
//! the hand holds the last torque. When no torque is requested any more, the driver sends zeros. In
//! a fault it repeats zeros and servo off, because the link may come back.

mod received;

use std::time::Duration;

use etude_checks::RangeError;

use super::config::HandConfig;
use super::fault::HandFault;
use super::limits::{PWM_LIMITS, WIRE_JOINTS, clamp_pwm};
use super::messages::{Finger, HandMessage, HostMessage, Information, Request, Serial};
use super::state::{HandEvent, HandState, Known, Step};
use crate::can::CanFrame;

/// After this time a hand that was streaming is silent, and its last frames have been discarded.
const DRAIN: Duration = Duration::from_millis(50);
/// Time between two requests for state and temperature, and between two repeats of zero torque in a
/// fault.
const HEARTBEAT: Duration = Duration::from_millis(100);
/// Ten requests without an answer.
const INFORMATION_TIMEOUT: Duration = Duration::from_secs(1);
/// A torque that is not renewed is replaced by zero after this time.
const TORQUE_TIMEOUT: Duration = Duration::from_millis(50);
/// Time for which commands of another program that move nothing are borne: `etude robot stop` sends
/// them, and its request ends this program meanwhile.
const OTHER_PROGRAM_TIMEOUT: Duration = Duration::from_millis(150);
/// Number of zero-torque commands when the hand is released: a frame may be lost.
const REPEATS: usize = 3;

/// The driver of one hand.
#[derive(Clone, Debug)]
pub struct Hand {
    config: HandConfig,
    state: HandState,
    step: Step,
    started: Duration,
    known: Known,
    next_heartbeat: Duration,
    heartbeats: usize,
    /// Whether it was released in the present fault.
    released: bool,
    /// Whether it has reported since its last release that its servo is off.
    confirmed: bool,
    /// When the last torque other than zero was sent.
    driven: Option<Duration>,
    /// Whether it has ever answered. Its servo is switched on only after that.
    reached: bool,
}

impl Hand {
    /// A driver that sends nothing until it is started.
    ///
    /// # Errors
    /// If a setting is out of its range.
    pub fn new(config: &HandConfig) -> Result<Self, RangeError> {
        config.check()?;
        Ok(Self {
            known: Known::nothing(config),
            config: config.clone(),
            state: HandState::Off,
            step: Step::Silence,
            started: Duration::ZERO,
            next_heartbeat: Duration::ZERO,
            heartbeats: 0,
            released: false,
            confirmed: false,
            driven: None,
            reached: false,
        })
    }

    /// Starts, or restarts after a stop or a fault. Only an operator may ask for this.
    /// [`poll`](Self::poll) does the rest.
    pub fn start(&mut self, now: Duration) {
        self.known = Known::nothing(&self.config);
        self.state = HandState::Starting;
        self.step = Step::Silence;
        self.started = now;
        self.next_heartbeat = now;
        self.released = false;
        self.confirmed = false;
        self.driven = None;
    }

    /// Takes a frame that arrived at `now`. Frames of other devices and damaged frames are ignored.
    pub fn receive(&mut self, now: Duration, frame: &CanFrame) -> HandEvent {
        let message = HandMessage::decode(self.config.device_id, frame);
        self.reached |= message.is_some();
        if let Some(HandMessage::Information(information)) = message {
            let is_released = self.released || self.state == HandState::Stopped;
            self.confirmed |= is_released && !information.status.servo_on();
        }
        let other = HostMessage::decode(self.config.device_id, frame).filter(|_| self.listens());
        if let Some(other) = other.filter(HostMessage::commands) {
            self.known.other_since.get_or_insert(now);
            if other.drives() {
                self.fail(HandFault::OtherProgram);
            }
        }
        let Some(message) = message.filter(|_| self.listens()) else { return HandEvent::Nothing };
        match message {
            HandMessage::Position { finger, counts } => return self.take_position(now, finger, counts),
            HandMessage::Information(information) => self.take_information(now, information),
            HandMessage::Temperature { finger, celsius } => self.take_temperature(now, finger, celsius),
            HandMessage::Serial(serial) => {
                if *self.known.serial.get_or_insert(serial) != serial {
                    self.fail(HandFault::TwoHands);
                }
            }
        }
        HandEvent::Nothing
    }

    /// Advances to `now`: continues the start, requests state and temperature, checks timeouts, and
    /// releases the hand in a fault. Call it at least each millisecond, after all frames that have
    /// arrived were received.
    pub fn poll(&mut self, now: Duration, out: &mut Vec<CanFrame>) -> HandEvent {
        let event = if self.listens() {
            let taken = self.known.assembly.expire(now);
            self.tick(taken)
        } else {
            HandEvent::Nothing
        };
        self.watch(now);
        match self.state {
            HandState::Off => {}
            HandState::Starting => self.continue_start(now, out),
            HandState::Ready => {
                self.ask(now, out);
                if self.driven.is_some_and(|at| now.saturating_sub(at) > TORQUE_TIMEOUT) {
                    self.driven = None;
                    self.say_pwm(&[0; WIRE_JOINTS], out);
                }
            }
            HandState::Fault(_) if !std::mem::replace(&mut self.released, true) => {
                self.send_release(now, REPEATS, out);
            }
            // A frame may be lost.
            HandState::Stopped if self.confirmed => {}
            HandState::Stopped | HandState::Fault(_) if now < self.next_heartbeat => {}
            HandState::Stopped | HandState::Fault(_) => self.send_release(now, 1, out),
        }
        event
    }

    /// Sends torques: the `wanted` PWM of each flat joint, limited before the wire by [`clamp_pwm`]
    /// to what is configured and to [`PWM_LIMITS`]; a number that is not finite becomes 0. Returns
    /// what was sent. Unless the hand is [`HandState::Ready`], sends nothing and returns zeros.
    pub fn send_pwm(
        &mut self,
        now: Duration,
        wanted: &[f64; WIRE_JOINTS],
        out: &mut Vec<CanFrame>,
    ) -> [i16; WIRE_JOINTS] {
        self.watch(now);
        let mut sent = [0; WIRE_JOINTS];
        if self.state != HandState::Ready {
            return sent;
        }
        let limits = self.config.pwm_limit.iter().zip(PWM_LIMITS);
        for ((pwm, &wanted), (&configured, limit)) in sent.iter_mut().zip(wanted).zip(limits) {
            *pwm = clamp_pwm(wanted, configured.min(limit));
        }
        self.driven = sent.iter().any(|&pwm| pwm != 0).then_some(now);
        self.say_pwm(&sent, out);
        sent
    }

    /// Releases the hand: zero torque three times, servo off, streams off. Allowed at any time; a
    /// fault stays a fault. Until the hand has confirmed it, [`poll`](Self::poll) repeats zero
    /// torque and servo off.
    pub fn stop(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        self.release(now, out);
        self.say(HostMessage::Positions(0), out);
    }

    /// The same, but the streams continue, so that the reaction is recorded.
    pub fn release(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        self.confirmed = false;
        self.send_release(now, REPEATS, out);
        self.driven = None;
        if !matches!(self.state, HandState::Fault(_)) {
            self.state = HandState::Stopped;
        }
    }

    /// Sends zero torque and servo off, and asks for the state.
    fn send_release(&mut self, now: Duration, times: usize, out: &mut Vec<CanFrame>) {
        self.say_release(times, out);
        self.say(HostMessage::Request(Request::Information), out);
        self.next_heartbeat = now.saturating_add(HEARTBEAT);
    }

    /// Whether the hand has reported, since it was released last, that its servo is off.
    pub fn has_confirmed_release(&self) -> bool {
        self.confirmed
    }

    /// Whether it has ever answered. One that has not was never switched on by this driver.
    pub fn was_reached(&self) -> bool {
        self.reached
    }

    /// The state of the driver.
    pub fn state(&self) -> HandState {
        self.state
    }

    /// Last valid angle of each flat joint, rad; 0 before the first.
    pub fn positions(&self) -> [f64; WIRE_JOINTS] {
        self.known.encoders.each_ref().map(|encoder| encoder.rad().unwrap_or(0.0))
    }

    /// When the newest angles of the last complete period arrived: the time to pass to the joint
    /// loop.
    pub fn positions_at(&self) -> Option<Duration> {
        self.known.positions_at
    }

    /// The last Information reply since the start.
    pub fn information(&self) -> Option<Information> {
        self.known.information.map(|(_, information)| information)
    }

    /// The serial number, if received since the start.
    pub fn serial(&self) -> Option<Serial> {
        self.known.serial
    }

    /// Until the drain is over, frames may be from before the start.
    fn listens(&self) -> bool {
        match self.state {
            HandState::Off => false,
            HandState::Starting => !matches!(self.step, Step::Silence | Step::Drain { .. }),
            HandState::Ready | HandState::Stopped | HandState::Fault(_) => true,
        }
    }

    /// The next step of the start.
    fn continue_start(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        match self.step {
            Step::Silence => {
                self.say_release(1, out);
                self.say(HostMessage::Positions(0), out);
                self.step = Step::Drain { until: now.saturating_add(DRAIN) };
            }
            Step::Drain { until } if now < until => {}
            Step::Drain { .. } => {
                self.step = Step::Ask;
                self.next_heartbeat = now;
                self.ask(now, out);
            }
            Step::Ask => self.ask(now, out),
            Step::SwitchOn => {
                self.say(HostMessage::Positions(self.config.period_ms), out);
                self.say_on(out);
                self.step = Step::Wait { since: now };
                self.next_heartbeat = now;
                self.ask(now, out);
            }
            Step::Wait { .. } => {
                let moving = self.known.positions_at.is_some();
                let valid = self.known.encoders.iter().all(|encoder| encoder.rad().is_some());
                if moving && valid && self.known.servo_was_on && self.stale_finger(now).is_none() {
                    self.state = HandState::Ready;
                } else if now >= self.next_heartbeat {
                    // Frames may be lost; repeating the command does no harm.
                    if !moving {
                        self.say(HostMessage::Positions(self.config.period_ms), out);
                    }
                    if !self.known.servo_was_on {
                        self.say_on(out);
                    }
                }
                self.ask(now, out);
            }
        }
    }

    /// Requests state and temperature when due.
    fn ask(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        if now < self.next_heartbeat {
            return;
        }
        self.next_heartbeat = now.saturating_add(HEARTBEAT);
        self.say(HostMessage::Request(Request::Information), out);
        if self.known.serial.is_none() {
            self.say(HostMessage::Request(Request::Serial), out);
        }
        self.heartbeats = (self.heartbeats + 1) % Finger::ALL.len();
        if let Some(&finger) = Finger::ALL.get(self.heartbeats) {
            self.say(HostMessage::Request(Request::Temperature(finger)), out);
            if let Some(asked) = self.known.asked.get_mut(finger.number()) {
                *asked = Some(now);
            }
        }
    }

    /// Checks all timeouts.
    fn watch(&mut self, now: Duration) {
        if self.known.other_since.is_some_and(|since| now.saturating_sub(since) > OTHER_PROGRAM_TIMEOUT) {
            self.fail(HandFault::OtherProgram);
        }
        match self.state {
            HandState::Starting => {
                let since_start = now.saturating_sub(self.started);
                if since_start.as_secs_f64() <= self.config.start_timeout_secs {
                    return;
                }
                let Step::Wait { since } = self.step else { return self.fail(HandFault::NoInformation) };
                match self.stale_finger(now) {
                    Some((finger, age)) => {
                        let age = age.unwrap_or(now.saturating_sub(since));
                        self.fail(HandFault::PositionsStale { finger, age });
                    }
                    None => self.fail(HandFault::ServoOff),
                }
            }
            HandState::Ready => {
                let reported_at = self.known.information.map_or(Duration::ZERO, |(at, _)| at);
                let age = now.saturating_sub(reported_at);
                if let Some((finger, Some(age))) = self.stale_finger(now) {
                    self.fail(HandFault::PositionsStale { finger, age });
                } else if age > INFORMATION_TIMEOUT {
                    self.fail(HandFault::InformationStale { age });
                }
            }
            HandState::Off | HandState::Stopped | HandState::Fault(_) => {}
        }
    }

    /// The finger whose positions are oldest, if too old, and their age; no age if none ever came.
    fn stale_finger(&self, now: Duration) -> Option<(usize, Option<Duration>)> {
        let ages = self.known.finger_at.iter().map(|at| at.map(|at| now.saturating_sub(at)));
        let (finger, age) = ages.enumerate().max_by_key(|(_, age)| age.unwrap_or(Duration::MAX))?;
        let fresh = age.is_some_and(|age| age.as_secs_f64() <= self.config.stale_after_secs);
        (!fresh).then_some((finger, age))
    }

    /// Zero torque `times` times, then servo off.
    fn say_release(&self, times: usize, out: &mut Vec<CanFrame>) {
        (0..times).for_each(|_| self.say_pwm(&[0; WIRE_JOINTS], out));
        self.say(HostMessage::ServoOff, out);
    }

    /// Servo on, after a zero torque: the hand may still hold an older one.
    fn say_on(&self, out: &mut Vec<CanFrame>) {
        self.say_pwm(&[0; WIRE_JOINTS], out);
        self.say(HostMessage::ServoOn, out);
    }

    fn say_pwm(&self, pwm: &[i16; WIRE_JOINTS], out: &mut Vec<CanFrame>) {
        let (fingers, _) = pwm.as_chunks::<4>();
        for (&finger, &pwm) in Finger::ALL.iter().zip(fingers) {
            self.say(HostMessage::Torque { finger, pwm }, out);
        }
    }

    fn say(&self, message: HostMessage, out: &mut Vec<CanFrame>) {
        out.push(message.encode(self.config.device_id));
    }

    /// Latches the first fault; frames that are still on their way may show others. A hand that was
    /// stopped stays so.
    fn fail(&mut self, fault: HandFault) {
        if matches!(self.state, HandState::Starting | HandState::Ready) {
            self.state = HandState::Fault(fault);
            self.released = false;
            self.confirmed = false;
            self.driven = None;
        }
    }
}
