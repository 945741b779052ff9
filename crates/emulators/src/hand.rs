//! An emulated Allegro v4: answers frames as the real hand does.
//!
//! It streams with its own clock, which may run fast or slow, and holds the last torques. It has no
//! joints: its owner (a physics world, or [`FreeHand`](crate::FreeHand)) moves them by
//! [`pwm`](HandEmulator::pwm) and sets the positions. Where the behaviour of real firmware is not
//! known (does servo off cut the torque, does torque time out), it is a setting.

use std::time::Duration;

use etude_checks::settings;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg32;
use serde::{Deserialize, Serialize};

use etude_robot::allegro::{
    DeviceId, Finger, HandMessage, HandSide, HostMessage, Information, PWM_LIMITS, Request, Serial,
    StatusBits, WIRE_JOINTS, counts_from_rad,
};
use etude_robot::can::CanFrame;

settings! {
    /// Settings of the emulated hand.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct HandEmulatorConfig {
        /// Its number on the bus.
        pub device_id: DeviceId = DeviceId::default();
        /// The side that it reports.
        pub side: HandSide = HandSide::default();
        /// Hardware version; the upper byte is the generation.
        pub hardware: u16 = 0x0400;
        /// Temperature of its board, °C.
        pub board_celsius: u8 = 35;
        /// Temperature of each flat joint, °C.
        pub joint_celsius: [u8; WIRE_JOINTS] = [33; WIRE_JOINTS];
        /// Bits of the status byte that are set besides the servo's.
        pub fault_bits: u8 = 0;
        /// Joints whose encoder counts in the wrong direction.
        pub reversed: [bool; WIRE_JOINTS] = [false; WIRE_JOINTS];
        /// Joints whose motor has no torque.
        pub dead: [bool; WIRE_JOINTS] = [false; WIRE_JOINTS];
        /// Encoder readings are off by up to so many counts, evenly.
        pub noise_counts: u16 = 0;
        /// Seed of that noise.
        pub seed: u64 = 0;
        /// Whether servo OFF cuts the torque and is reported. A hand whose OFF does nothing holds
        /// its torque.
        pub off_cuts: bool = true;
        /// Torque is cut when no torque frame came for so long, s; with none it is held without
        /// limit.
        pub torque_timeout_secs: Option<f64> = None;
        /// The hand's clock runs this much faster than the host's, as a share (0.0001 is 100 ppm).
        pub clock_skew: f64 = 0.0;
    }
}

/// The stream of positions: how often, and when next, by the hand's clock.
#[derive(Clone, Copy, Debug, Default)]
struct Stream {
    period: Duration,
    due: Duration,
}

impl Stream {
    fn set(&mut self, clock: Duration, period_ms: u16) {
        self.period = Duration::from_millis(u64::from(period_ms));
        self.due = clock.saturating_add(self.period);
    }

    /// Whether it is time; periods that were slept through are left out.
    fn is_due(&mut self, clock: Duration) -> bool {
        if self.period.is_zero() || clock < self.due {
            return false;
        }
        let slept = (clock - self.due).as_nanos() / self.period.as_nanos();
        let on = self.period.saturating_mul(u32::try_from(slept + 1).unwrap_or(u32::MAX));
        self.due = self.due.saturating_add(on);
        true
    }
}

/// The emulated hand.
#[derive(Clone, Debug)]
pub struct HandEmulator {
    config: HandEmulatorConfig,
    clock: Duration,
    servo_on: bool,
    pwm: [i16; WIRE_JOINTS],
    torque_at: Duration,
    stream: Stream,
    positions: [f64; WIRE_JOINTS],
    noise: Pcg32,
}

impl HandEmulator {
    /// A hand just powered: servo off, silent, all joints at 0 rad.
    pub fn new(config: &HandEmulatorConfig) -> Self {
        Self {
            noise: Pcg32::seed_from_u64(config.seed),
            config: config.clone(),
            clock: Duration::ZERO,
            servo_on: false,
            pwm: [0; WIRE_JOINTS],
            torque_at: Duration::ZERO,
            stream: Stream::default(),
            positions: [0.0; WIRE_JOINTS],
        }
    }

    /// Takes a frame from the bus at `now` and pushes its answers.
    pub fn receive(&mut self, now: Duration, frame: &CanFrame, out: &mut Vec<CanFrame>) {
        self.set_clock(now);
        let Some(message) = HostMessage::decode(self.config.device_id, frame) else { return };
        match message {
            HostMessage::ServoOn => self.servo_on = true,
            HostMessage::ServoOff if self.config.off_cuts => {
                self.servo_on = false;
                self.pwm = [0; WIRE_JOINTS];
            }
            HostMessage::Torque { finger, pwm } => {
                let first = 4 * finger.number();
                for ((held, limit), pwm) in self.pwm.iter_mut().zip(PWM_LIMITS).skip(first).zip(pwm) {
                    *held = pwm.clamp(-limit, limit);
                }
                self.torque_at = self.clock;
            }
            HostMessage::Positions(period_ms) => self.stream.set(self.clock, period_ms),
            HostMessage::Request(request) => self.answer(request, out),
            HostMessage::ServoOff => {}
        }
    }

    /// Lets time pass until `now` and pushes the frames that are due.
    pub fn tick(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        self.set_clock(now);
        if self.stream.is_due(self.clock) {
            Finger::ALL.iter().for_each(|&finger| self.answer(Request::Position(finger), out));
        }
    }

    /// Where the flat joints are, rad.
    pub fn set_positions(&mut self, positions: &[f64; WIRE_JOINTS]) {
        self.positions = *positions;
    }

    /// The PWM that drives each flat joint now: what was last sent, within the table; 0 when the
    /// servo is off, the torque has timed out, or the motor is dead.
    pub fn pwm(&self) -> [i16; WIRE_JOINTS] {
        let age = self.clock.saturating_sub(self.torque_at).as_secs_f64();
        let timed_out = self.config.torque_timeout_secs.is_some_and(|timeout| age > timeout);
        let on = self.servo_on && !timed_out;
        std::array::from_fn(|joint| if on && !self.config.dead[joint] { self.pwm[joint] } else { 0 })
    }

    /// Whether the servo is on.
    pub fn servo_on(&self) -> bool {
        self.servo_on
    }

    /// What the hand is like, to be changed while it runs: heat, faults, another side.
    pub fn config_mut(&mut self) -> &mut HandEmulatorConfig {
        &mut self.config
    }

    /// Sets the hand's own clock, which never goes back.
    fn set_clock(&mut self, now: Duration) {
        let rate = (1.0 + self.config.clock_skew).clamp(0.5, 2.0);
        let clock = if rate == 1.0 {
            now
        } else {
            Duration::try_from_secs_f64(now.as_secs_f64() * rate).unwrap_or(now)
        };
        self.clock = self.clock.max(clock);
    }

    fn status(&self) -> StatusBits {
        StatusBits(u8::from(self.servo_on) | (self.config.fault_bits & !StatusBits::SERVO_ON))
    }

    fn answer(&mut self, request: Request, out: &mut Vec<CanFrame>) {
        let message = match request {
            Request::Information => HandMessage::Information(Information {
                hardware: self.config.hardware,
                firmware: 0x0101,
                side: self.config.side,
                board_celsius: self.config.board_celsius,
                status: self.status(),
            }),
            Request::Serial => HandMessage::Serial(Serial(*b"A0000001")),
            Request::Position(finger) => HandMessage::Position { finger, counts: self.counts(finger) },
            Request::Temperature(finger) => {
                let (fingers, _) = self.config.joint_celsius.as_chunks::<4>();
                let celsius = fingers.get(finger.number()).copied().unwrap_or_default();
                HandMessage::Temperature { finger, celsius }
            }
        };
        out.push(message.encode(self.config.device_id));
    }

    fn counts(&mut self, finger: Finger) -> [i16; 4] {
        let mut shown = self.positions;
        for (rad, reversed) in shown.iter_mut().zip(self.config.reversed) {
            *rad = if reversed { -*rad } else { *rad };
        }
        let (fingers, _) = shown.as_chunks::<4>();
        let noise = i32::from(self.config.noise_counts);
        fingers.get(finger.number()).copied().unwrap_or_default().map(|rad| {
            let off = if noise == 0 { 0 } else { self.noise.random_range(-noise..=noise) };
            (i32::from(counts_from_rad(rad)) + off).clamp(i16::MIN.into(), i16::MAX.into()) as i16
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    #[test]
    fn the_emulator_as_a_device() {
        let device = DeviceId::new(2).unwrap();
        let config = HandEmulatorConfig {
            device_id: device,
            torque_timeout_secs: Some(0.1),
            ..HandEmulatorConfig::default()
        };
        let mut emulator = HandEmulator::new(&config);
        let say = |emulator: &mut HandEmulator, at, message: HostMessage| {
            let mut out = vec![];
            emulator.receive(at, &message.encode(device), &mut out);
            out
        };
        let torque = HostMessage::Torque { finger: Finger::Thumb, pwm: [i16::MAX, i16::MIN, 7, -7] };
        say(&mut emulator, ms(0), torque);
        assert_eq!(emulator.pwm(), [0; WIRE_JOINTS], "the servo is off");
        say(&mut emulator, ms(0), HostMessage::ServoOn);
        say(&mut emulator, ms(1), torque);
        assert_eq!(emulator.pwm()[12..], [525, -405, 7, -7]);
        emulator.tick(ms(100), &mut vec![]);
        assert_eq!(emulator.pwm()[12], 525);
        emulator.tick(ms(102), &mut vec![]);
        assert_eq!(emulator.pwm(), [0; WIRE_JOINTS], "timed out");
        for request in [
            Request::Information,
            Request::Serial,
            Request::Position(Finger::Ring),
            Request::Temperature(Finger::Ring),
        ] {
            let question = HostMessage::Request(request).encode(device);
            let answers = say(&mut emulator, ms(102), HostMessage::Request(request));
            assert_eq!(answers.len(), 1);
            assert!(!answers[0].is_remote() && answers[0].id() == question.id(), "{request:?}");
        }
        // Periods slept through are left out.
        say(&mut emulator, ms(200), HostMessage::Positions(3));
        let mut out = vec![];
        (200..260).for_each(|at| emulator.tick(ms(at), &mut out));
        let count = |id: u16| out.iter().filter(|frame| frame.id() == id | 2).count();
        assert_eq!([0x080, 0x084, 0x088, 0x08C].map(count), [19; 4]);
        out.clear();
        emulator.tick(ms(1000), &mut out);
        assert_eq!(out.len(), 4);
        let wrong = CanFrame::new(0x182, &[1, 2, 3]).unwrap();
        emulator.receive(ms(1000), &wrong, &mut out);
        assert_eq!(out.len(), 4, "ignored");
    }
}
