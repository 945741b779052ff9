//! A hand that is not there: answers frames like an Allegro v4 (hardware §1.12).
//!
//! It streams by a clock of its own, which may run fast or slow, and holds the torques that it was given. It
//! has no joints: its owner moves some (a physics world, or [`FreeHand`](crate::FreeHand)) by
//! [`pwm`](HandEmulator::pwm) and tells it where they are. What real firmware leaves open (does OFF cut the
//! torque, does torque time out) is a setting.

use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg32;
use serde::{Deserialize, Serialize};

use etude_robot::allegro::{
    DeviceId, Finger, HandMessage, HandSide, HostMessage, Information, JOINTS, PWM_LIMITS, Periods, Raw,
    Request, Serial, StatusBits, counts_from_rad,
};
use etude_robot::can::CanFrame;

/// What the emulated hand is like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandEmulatorConfig {
    /// Its number on the bus.
    pub device_id: DeviceId,
    /// The side that it says it is.
    pub side: HandSide,
    /// Hardware version; the upper byte is the generation.
    pub hardware: u16,
    /// Firmware version.
    pub firmware: u16,
    /// Serial number.
    pub serial: [u8; 8],
    /// Temperature of its board, °C.
    pub board_celsius: u8,
    /// Temperature of each flat joint, °C.
    pub joint_celsius: [u8; JOINTS],
    /// Bits of the status byte that are set besides the servo's.
    pub fault_bits: u8,
    /// Encoder readings are off by up to so many counts, evenly.
    pub noise_counts: u16,
    /// Seed of that noise.
    pub seed: u64,
    /// Whether servo OFF cuts the torque and is reported. A hand whose OFF does nothing holds its torque.
    pub off_cuts: bool,
    /// Torque is cut when no torque frame came for so long, s; none holds it for ever.
    pub torque_timeout_secs: Option<f64>,
    /// The hand's clock runs this much faster than the host's, as a share (0.0001 is 100 ppm).
    pub clock_skew: f64,
}

impl Default for HandEmulatorConfig {
    fn default() -> Self {
        Self {
            device_id: DeviceId::default(),
            side: HandSide::default(),
            hardware: 0x0400,
            firmware: 0x0101,
            serial: *b"A0000001",
            board_celsius: 35,
            joint_celsius: [33; JOINTS],
            fault_bits: 0,
            noise_counts: 0,
            seed: 0,
            off_cuts: true,
            torque_timeout_secs: None,
            clock_skew: 0.0,
        }
    }
}

/// One stream: how often, and when next, by the hand's clock.
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
    pwm: [i16; JOINTS],
    torque_at: Duration,
    /// Position, IMU, temperature, status.
    streams: [Stream; 4],
    positions: [f64; JOINTS],
    noise: Pcg32,
    damaged: u64,
}

impl HandEmulator {
    /// A hand just powered: servo off, silent, all joints at 0 rad.
    pub fn new(config: &HandEmulatorConfig) -> Self {
        Self {
            noise: Pcg32::seed_from_u64(config.seed),
            config: config.clone(),
            clock: Duration::ZERO,
            servo_on: false,
            pwm: [0; JOINTS],
            torque_at: Duration::ZERO,
            streams: [Stream::default(); 4],
            positions: [0.0; JOINTS],
            damaged: 0,
        }
    }

    /// Takes a frame from the bus at `now` and pushes its answers.
    pub fn receive(&mut self, now: Duration, frame: &CanFrame, out: &mut Vec<CanFrame>) {
        self.set_clock(now);
        let message = match HostMessage::decode(self.config.device_id, frame) {
            Ok(Some(message)) => message,
            Ok(None) => return,
            Err(_) => {
                self.damaged += 1;
                return;
            }
        };
        match message {
            HostMessage::ServoOn => self.servo_on = true,
            HostMessage::ServoOff if self.config.off_cuts => {
                self.servo_on = false;
                self.pwm = [0; JOINTS];
            }
            HostMessage::Torque { finger, pwm } => {
                let first = 4 * finger.number();
                for ((held, limit), pwm) in self.pwm.iter_mut().zip(PWM_LIMITS).skip(first).zip(pwm) {
                    *held = pwm.clamp(-limit, limit);
                }
                self.torque_at = self.clock;
            }
            HostMessage::Periods(Periods { position_ms, imu_ms, temperature_ms, status_ms }) => {
                let wanted = [position_ms, imu_ms, temperature_ms, status_ms.unwrap_or(0)];
                for (stream, wanted) in self.streams.iter_mut().zip(wanted) {
                    stream.set(self.clock, wanted);
                }
            }
            HostMessage::Request(request) => self.answer(request, out),
            HostMessage::ServoOff | HostMessage::Pose { .. } | HostMessage::Config(_) => {}
        }
    }

    /// Lets time pass until `now` and pushes the frames that are due.
    pub fn tick(&mut self, now: Duration, out: &mut Vec<CanFrame>) {
        self.set_clock(now);
        let clock = self.clock;
        let [position, imu, temperature, status] = self.streams.each_mut().map(|stream| stream.is_due(clock));
        if position {
            Finger::ALL.iter().for_each(|&finger| self.answer(Request::Position(finger), out));
        }
        if imu {
            self.answer(Request::Imu, out);
        }
        if temperature {
            Finger::ALL.iter().for_each(|&finger| self.answer(Request::Temperature(finger), out));
        }
        if status && let Some(raw) = Raw::new(&[self.status().0]) {
            out.push(HandMessage::Status(raw).encode(self.config.device_id));
        }
    }

    /// Where the flat joints are, rad.
    pub fn set_positions(&mut self, positions: &[f64; JOINTS]) {
        self.positions = *positions;
    }

    /// The PWM that drives each flat joint now: what was last sent, within the table; 0 when the servo is off
    /// or the torque has timed out.
    pub fn pwm(&self) -> [i16; JOINTS] {
        let age = self.clock.saturating_sub(self.torque_at).as_secs_f64();
        let timed_out = self.config.torque_timeout_secs.is_some_and(|timeout| age > timeout);
        if self.servo_on && !timed_out { self.pwm } else { [0; JOINTS] }
    }

    /// Whether the servo is on.
    pub fn servo_on(&self) -> bool {
        self.servo_on
    }

    /// Frames of a known identifier and a wrong length so far.
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    /// What the hand is like, to be changed while it runs: heat, faults, another side.
    pub fn config_mut(&mut self) -> &mut HandEmulatorConfig {
        &mut self.config
    }

    /// The hand's own time. It never goes back, whatever its owner says.
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
                firmware: self.config.firmware,
                side: self.config.side,
                board_celsius: self.config.board_celsius,
                status: self.status(),
            }),
            Request::Serial => HandMessage::Serial(Serial(self.config.serial)),
            Request::Position(finger) => HandMessage::Position { finger, counts: self.counts(finger) },
            Request::Imu => HandMessage::Imu(Raw::default()),
            Request::Temperature(finger) => {
                let (fingers, _) = self.config.joint_celsius.as_chunks::<4>();
                let celsius = fingers.get(finger.number()).copied().unwrap_or_default();
                HandMessage::Temperature { finger, celsius }
            }
        };
        out.push(message.encode(self.config.device_id));
    }

    fn counts(&mut self, finger: Finger) -> [i16; 4] {
        let (fingers, _) = self.positions.as_chunks::<4>();
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
        assert_eq!(emulator.pwm(), [0; JOINTS], "the servo is off");
        say(&mut emulator, ms(0), HostMessage::ServoOn);
        say(&mut emulator, ms(1), torque);
        assert_eq!(emulator.pwm()[12..], [525, -405, 7, -7]);
        emulator.tick(ms(100), &mut vec![]);
        assert_eq!(emulator.pwm()[12], 525);
        emulator.tick(ms(102), &mut vec![]);
        assert_eq!(emulator.pwm(), [0; JOINTS], "timed out");
        for request in [
            Request::Information,
            Request::Serial,
            Request::Imu,
            Request::Position(Finger::Ring),
            Request::Temperature(Finger::Ring),
        ] {
            let question = HostMessage::Request(request).encode(device);
            let answers = say(&mut emulator, ms(102), HostMessage::Request(request));
            assert_eq!(answers.len(), 1);
            assert!(!answers[0].is_remote() && answers[0].id() == question.id(), "{request:?}");
        }
        // Each stream by its own period; periods slept through are left out.
        let periods = Periods { position_ms: 3, imu_ms: 10, temperature_ms: 20, status_ms: Some(5) };
        say(&mut emulator, ms(200), HostMessage::Periods(periods));
        let mut out = vec![];
        (200..260).for_each(|at| emulator.tick(ms(at), &mut out));
        let count = |id: u16| out.iter().filter(|frame| frame.id() == id | 2).count();
        assert_eq!([0x080, 0x08C, 0x0C0, 0x0E0, 0x0EC, 0x040].map(count), [19, 19, 5, 2, 2, 11]);
        out.clear();
        emulator.tick(ms(1000), &mut out);
        assert_eq!(out.len(), 4 + 1 + 4 + 1);
        let wrong = CanFrame::new(0x182, &[1, 2, 3]).unwrap();
        emulator.receive(ms(1000), &wrong, &mut vec![]);
        assert_eq!(emulator.damaged(), 1);
    }
}
