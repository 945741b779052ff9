//! The driver of the hand: starts it, watches it, and is the only path for torques.
//!
//! One turn of its owner's loop: give every frame that has arrived to [`Hand::receive`], call [`Hand::poll`],
//! and if either said [`HandEvent::Positions`], compute once and call [`Hand::torque`]. The hand's position
//! frames are thus the clock. How lost, doubled and late ones are treated is told in `assembly`, which
//! readings are believed in `encoder`.
//!
//! What a hand does when torques stop coming is not known (hardware §1.7), so the driver assumes the worst:
//! the last torque is held. When its owner stops asking for torques it sends zeros, and in a fault it sends
//! zeros and OFF again and again, because the link that failed may come back.

use std::time::Duration;

use super::assembly::Taken;
use super::commands::Commands;
use super::config::HandConfig;
use super::fault::HandFault;
use super::limits::{JOINTS, PWM_LIMITS, clamp_pwm};
use super::messages::{Finger, HandMessage, HostMessage, Information, Request, Serial, StatusBits};
use super::state::{HandCounters, HandEvent, HandState, Known, Step};
use crate::can::CanFrame;
use crate::setting::SettingError;

/// A hand that streamed before has fallen silent by then, and its last frames are read away.
const DRAIN: Duration = Duration::from_millis(50);
/// Between two questions for state and temperature, and between two repeats of zero torque in a fault.
const HEARTBEAT: Duration = Duration::from_millis(100);
/// Ten questions without an answer.
const INFORMATION_STALE: Duration = Duration::from_secs(1);
/// A torque that nobody renews is replaced by zero after this.
const TORQUE_HELD: Duration = Duration::from_millis(50);
/// Zero torque is said this often when the hand is let go: a frame may be lost.
const REPEATS: usize = 3;
const GENERATION: u8 = 4;

/// The driver of one hand.
#[derive(Clone, Debug)]
pub struct Hand {
    config: HandConfig,
    commands: Commands,
    state: HandState,
    step: Step,
    started: Duration,
    known: Known,
    counters: HandCounters,
    next_heartbeat: Duration,
    heartbeats: usize,
    released: bool,
    /// When the last torque other than zero was sent.
    driven: Option<Duration>,
}

impl Hand {
    /// A driver that sends nothing until it is started.
    ///
    /// # Errors
    /// If a setting is out of its range.
    pub fn new(config: &HandConfig) -> Result<Self, SettingError> {
        config.check()?;
        Ok(Self {
            known: Known::nothing(config),
            config: config.clone(),
            commands: Commands { device: config.device_id, period_ms: config.period_ms },
            state: HandState::Off,
            step: Step::Silence,
            started: Duration::ZERO,
            counters: HandCounters::default(),
            next_heartbeat: Duration::ZERO,
            heartbeats: 0,
            released: false,
            driven: None,
        })
    }

    /// Starts, or starts again after a stop or a fault: an operator's act. [`poll`](Self::poll) does the
    /// rest.
    pub fn start(&mut self, now: Duration) {
        self.known = Known::nothing(&self.config);
        self.state = HandState::Starting;
        self.step = Step::Silence;
        self.started = now;
        self.next_heartbeat = now;
        self.released = false;
        self.driven = None;
    }

    /// Takes a frame that arrived at `now`. Frames of other devices and damaged ones are counted, no more.
    pub fn receive(&mut self, now: Duration, frame: &CanFrame) -> HandEvent {
        let message = match HandMessage::decode(self.config.device_id, frame) {
            Ok(Some(message)) if self.listens() => message,
            Ok(_) => {
                self.counters.ignored += 1;
                return HandEvent::Nothing;
            }
            Err(_) => {
                self.counters.damaged += 1;
                return HandEvent::Nothing;
            }
        };
        match message {
            HandMessage::Position { finger, counts } => return self.take_position(now, finger, counts),
            HandMessage::Information(information) => self.take_information(now, information),
            HandMessage::Temperature { finger, celsius } => self.take_temperature(finger, celsius),
            HandMessage::Serial(serial) => self.known.serial = Some(serial),
            HandMessage::Imu(_) | HandMessage::Status(_) => self.counters.ignored += 1,
        }
        HandEvent::Nothing
    }

    /// Lets time pass: goes on with the start, asks for state and temperature, watches all ages, and lets the
    /// hand go in a fault. Call it at least each millisecond, after all frames that have arrived were
    /// received.
    pub fn poll(&mut self, now: Duration, out: &mut Vec<CanFrame>) -> HandEvent {
        let event = if self.listens() {
            let taken = self.known.assembly.expire(now);
            self.count(taken)
        } else {
            HandEvent::Nothing
        };
        self.watch(now);
        match self.state {
            HandState::Off | HandState::Stopped => {}
            HandState::Starting => self.go_on(now, out),
            HandState::Ready => {
                self.ask(now, out);
                if self.driven.is_some_and(|at| now.saturating_sub(at) > TORQUE_HELD) {
                    self.driven = None;
                    self.counters.unattended += 1;
                    self.commands.zero(out);
                }
            }
            HandState::Fault(_) => {
                if !self.released {
                    self.commands.release(REPEATS, out);
                    self.released = true;
                    self.next_heartbeat = now.saturating_add(HEARTBEAT);
                } else if now >= self.next_heartbeat {
                    self.commands.release(1, out);
                    self.next_heartbeat = now.saturating_add(HEARTBEAT);
                }
            }
        }
        event
    }

    /// Sends torques: `wanted` PWM of each flat joint, cut to the configured limit and, last of all, to the
    /// table of hardware §1.4; what is not a finite number is 0. Returns what was really sent: all zeros, and
    /// nothing sent, unless the hand is [`HandState::Ready`].
    pub fn torque(
        &mut self,
        now: Duration,
        wanted: &[f64; JOINTS],
        out: &mut Vec<CanFrame>,
    ) -> [i16; JOINTS] {
        self.watch(now);
        let mut sent = [0; JOINTS];
        if self.state != HandState::Ready {
            return sent;
        }
        let limits = self.config.pwm_limit.iter().zip(PWM_LIMITS);
        for ((pwm, &wanted), (&configured, limit)) in sent.iter_mut().zip(wanted).zip(limits) {
            *pwm = clamp_pwm(wanted, configured.min(limit));
        }
        self.driven = sent.iter().any(|&pwm| pwm != 0).then_some(now);
        self.commands.torque(&sent, out);
        sent
    }

    /// Lets the hand go: zero torque three times, OFF, streams off. Allowed at any time, as often as wanted;
    /// a fault stays a fault.
    pub fn stop(&mut self, _now: Duration, out: &mut Vec<CanFrame>) {
        self.commands.release(REPEATS, out);
        self.commands.silence(out);
        self.driven = None;
        if !matches!(self.state, HandState::Fault(_)) {
            self.state = HandState::Stopped;
        }
    }

    /// Where the driver stands.
    pub fn state(&self) -> HandState {
        self.state
    }

    /// Last believed angle of each flat joint, rad; 0 before the first.
    pub fn positions(&self) -> [f64; JOINTS] {
        self.known.encoders.each_ref().map(|encoder| encoder.rad().unwrap_or(0.0))
    }

    /// When the newest angles of the last ended period arrived: the time to give to the joint loop.
    pub fn positions_at(&self) -> Option<Duration> {
        self.known.positions_at
    }

    /// The last Information reply since the start.
    pub fn information(&self) -> Option<Information> {
        self.known.information.map(|(_, information)| information)
    }

    /// The serial number, once it was told since the start.
    pub fn serial(&self) -> Option<Serial> {
        self.known.serial
    }

    /// Temperature of each flat joint, °C, once told since the start. Older firmware tells joint 0 of each
    /// finger only and 0 for the others.
    pub fn joint_celsius(&self) -> [Option<u8>; JOINTS] {
        self.known.celsius
    }

    /// What went by or was left out.
    pub fn counters(&self) -> HandCounters {
        self.counters
    }

    /// Before the drain is over, frames are those of the time before the start.
    fn listens(&self) -> bool {
        match self.state {
            HandState::Off | HandState::Stopped => false,
            HandState::Starting => !matches!(self.step, Step::Silence | Step::Drain { .. }),
            HandState::Ready | HandState::Fault(_) => true,
        }
    }

    fn take_position(&mut self, now: Duration, finger: Finger, counts: [i16; 4]) -> HandEvent {
        if let Some(at) = self.known.finger_at.get_mut(finger.number()) {
            *at = Some(now);
        }
        let taken = self.known.assembly.take(now, finger.number(), counts);
        let event = self.count(taken);
        if event == HandEvent::Positions {
            // This frame's angles count already, whether or not it ended the period itself.
            self.known.positions_at = Some(now);
        }
        // The same again is no second opinion of a reading that was not believed.
        if taken.duplicate {
            return event;
        }
        let first = 4 * finger.number();
        for (joint, counts) in (first..).zip(counts) {
            match self.known.encoders.get_mut(joint).map(|encoder| encoder.take(now, joint, counts)) {
                Some(Ok(true)) | None => {}
                Some(Ok(false)) => self.counters.disbelieved += 1,
                Some(Err(fault)) => {
                    self.counters.disbelieved += 1;
                    self.fail(fault);
                }
            }
        }
        event
    }

    fn count(&mut self, taken: Taken) -> HandEvent {
        self.counters.duplicates += u64::from(taken.duplicate);
        self.counters.lost += u64::from(taken.lost);
        let Some(at) = taken.tick else { return HandEvent::Nothing };
        self.known.positions_at = Some(at);
        HandEvent::Positions
    }

    fn take_information(&mut self, now: Duration, information: Information) {
        self.known.information = Some((now, information));
        let status = information.status;
        if status.of(StatusBits::HOST_TIMEOUT) == 0 {
            self.known.host_timeout_cleared = true;
        }
        let mut faults = StatusBits::TEMPERATURE | StatusBits::INTERNAL | StatusBits::PALM_TEMPERATURE;
        if self.known.host_timeout_cleared {
            faults |= StatusBits::HOST_TIMEOUT;
        }
        let (celsius, limit) = (information.board_celsius, self.config.max_board_celsius);
        if information.generation() != GENERATION {
            self.fail(HandFault::WrongVersion { generation: information.generation() });
        } else if information.side != self.config.side {
            self.fail(HandFault::WrongSide { found: information.side });
        } else if status.of(faults) != 0 {
            self.fail(HandFault::Reported { bits: status.of(faults) });
        } else if celsius > limit {
            self.fail(HandFault::BoardHot { celsius, limit });
        } else if self.state == HandState::Ready && !status.servo_on() {
            self.fail(HandFault::ServoOff);
        } else if self.state == HandState::Starting {
            match self.step {
                Step::Ask => self.step = Step::SwitchOn,
                Step::Wait { .. } => self.known.servo_was_on |= status.servo_on(),
                _ => {}
            }
        }
    }

    fn take_temperature(&mut self, finger: Finger, celsius: [u8; 4]) {
        let limit = self.config.max_joint_celsius;
        for (joint, celsius) in (4 * finger.number()..).zip(celsius) {
            if let Some(known) = self.known.celsius.get_mut(joint) {
                *known = Some(celsius);
            }
            if celsius > limit {
                self.fail(HandFault::JointHot { joint, celsius, limit });
            }
        }
    }

    /// The next step of the start.
    fn go_on(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        match self.step {
            Step::Silence => {
                self.commands.release(1, out);
                self.commands.silence(out);
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
                self.commands.periods(out);
                self.commands.on(out);
                self.step = Step::Wait { since: now };
                self.next_heartbeat = now;
                self.ask(now, out);
            }
            Step::Wait { .. } => {
                let moving = self.known.positions_at.is_some();
                let believed = self.known.encoders.iter().all(|encoder| encoder.rad().is_some());
                if moving && believed && self.known.servo_was_on && self.stale_finger(now).is_none() {
                    self.state = HandState::Ready;
                } else if now >= self.next_heartbeat {
                    // Frames may be lost, and saying it again does nothing to a hand that has heard (hardware §1.12).
                    if !moving {
                        self.commands.periods(out);
                    }
                    if !self.known.servo_was_on {
                        self.commands.on(out);
                    }
                }
                self.ask(now, out);
            }
        }
    }

    /// Asks for state and temperature when it is time.
    fn ask(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        if now < self.next_heartbeat {
            return;
        }
        self.next_heartbeat = now.saturating_add(HEARTBEAT);
        self.commands.message(HostMessage::Request(Request::Information), out);
        if self.known.serial.is_none() {
            self.commands.message(HostMessage::Request(Request::Serial), out);
        }
        self.heartbeats = (self.heartbeats + 1) % Finger::ALL.len();
        if let Some(&finger) = Finger::ALL.get(self.heartbeats) {
            self.commands.message(HostMessage::Request(Request::Temperature(finger)), out);
        }
    }

    /// Looks at all ages.
    fn watch(&mut self, now: Duration) {
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
                let told = self.known.information.map_or(Duration::ZERO, |(at, _)| at);
                let age = now.saturating_sub(told);
                if let Some((finger, Some(age))) = self.stale_finger(now) {
                    self.fail(HandFault::PositionsStale { finger, age });
                } else if age > INFORMATION_STALE {
                    self.fail(HandFault::InformationStale { age });
                }
            }
            HandState::Off | HandState::Stopped | HandState::Fault(_) => {}
        }
    }

    /// The finger that is silent for longest, if for too long, and its age; no age if it never spoke.
    fn stale_finger(&self, now: Duration) -> Option<(usize, Option<Duration>)> {
        let ages = self.known.finger_at.iter().map(|at| at.map(|at| now.saturating_sub(at)));
        let (finger, age) = ages.enumerate().max_by_key(|(_, age)| age.unwrap_or(Duration::MAX))?;
        let fresh = age.is_some_and(|age| age.as_secs_f64() <= self.config.stale_after_secs);
        (!fresh).then_some((finger, age))
    }

    /// The first fault stays; frames in flight may show others.
    fn fail(&mut self, fault: HandFault) {
        if !matches!(self.state, HandState::Fault(_)) {
            self.state = HandState::Fault(fault);
            self.released = false;
            self.driven = None;
        }
    }
}
