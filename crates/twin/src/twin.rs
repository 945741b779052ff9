//! The twin: emulators of hand, arm and keyboard, moved by a world of their own in steps of a millisecond.
//!
//! ```text
//! CAN ◄──► HandEmulator ─ duty ─► torques ─► ┌───────┐ ─ key angles ─► KeyboardEmulator ──► MIDI
//!                ▲────────── joint angles ── │ World │
//! TCP ◄──► ArmEmulator ─ place on the rail ─►└───────┘
//! ```
//!
//! What it leaves out: the hand stands on a rail, so height and tilt of the arm are not felt at the keys; the thumb moves
//! freely; the arm's joints do not feel the keys' forces.

use std::time::Duration;

use etude_music::KEYS;
use etude_robot::allegro::{self, FULL_SCALE_PWM, FreeHand, HandEmulator, HandSide};
use etude_robot::calibration::{Calibration, CalibrationError, Point, RailPath};
use etude_robot::joints::{FINGER_JOINTS, RAIL, to_wire};
use etude_robot::keyboard::{KeyboardConfigError, KeyboardEmulator};
use etude_robot::xarm::emulator::{self, ArmEmulator};
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_stage::geometry::{HALF_WIDTH, key_lateral};
use etude_stage::{JOINTS, Side, StageConfig, StageError, World};

use crate::truth::{Truth, TruthError};

/// One step of the twin: a third of the hand's period, a fifth of the simulator's physics step.
pub const STEP: Duration = Duration::from_millis(1);
/// Where the flange stands over the middle key, mm, and how it is turned, degrees: the paper's C3 (fact sheet
/// "hardware" §0).
const MIDDLE_MM: [f64; 3] = [485.0, -2.83, 170.51];
const ORIENTATION_DEG: [f64; 3] = [-90.0, 225.0, -90.0];
/// The keys that a calibration shows: the outer Cs and the middle one.
pub const SHOWN_KEYS: [usize; 3] = [0, 24, KEYS - 1];

/// A twin could not be made.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// Its truth is not sound.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// Its world could not be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// Its arm does not reach its keyboard: a bug.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// Its keyboard's settings make no sense.
    #[error(transparent)]
    Keyboard(#[from] KeyboardConfigError),
}

/// A robot that is not there.
pub struct Twin {
    truth: Truth,
    world: World,
    path: RailPath,
    /// The emulated hand.
    pub hand: HandEmulator,
    /// The emulated arm.
    pub arm: ArmEmulator,
    /// The emulated keyboard.
    pub keyboard: KeyboardEmulator,
    thumb: FreeHand,
    rail: f64,
    now: Duration,
    collisions: u64,
}

impl Twin {
    /// A twin with this truth: everything switched on, the arm in the paper's home.
    ///
    /// # Errors
    /// If the truth is not sound.
    pub fn new(truth: &Truth, side: HandSide) -> Result<Self, TwinError> {
        truth.check()?;
        let params = truth.params().map_err(TruthError::from)?;
        let stage = StageConfig { side: stage_side(side), ..StageConfig::default() };
        let hand = allegro::EmulatorConfig {
            side,
            noise_counts: truth.hand.noise_counts,
            clock_skew: truth.hand.clock_skew,
            torque_timeout_secs: truth.hand.torque_timeout_secs,
            seed: truth.seed,
            ..allegro::EmulatorConfig::default()
        };
        let arm = ArmEmulator::new(emulator::EmulatorConfig {
            delay_secs: truth.arm.delay_secs,
            bandwidth_hz: truth.arm.bandwidth_hz,
            ..emulator::EmulatorConfig::default()
        });
        let path = RailPath::new(
            &calibration("twin"),
            [-HALF_WIDTH, HALF_WIDTH],
            &PAPER_HOME_DEG.map(f64::to_radians),
        )?;
        let mut twin = Self {
            world: World::with_physics_step(&stage, &params, STEP.as_secs_f64())?,
            rail: path.place(&arm.joints()).rail_m,
            path,
            hand: HandEmulator::new(&hand),
            arm,
            keyboard: KeyboardEmulator::new(&truth.keyboard)?,
            thumb: FreeHand::default(),
            truth: truth.clone(),
            now: Duration::ZERO,
            collisions: 0,
        };
        // Fingers straight, clear of the keys, as a hand is left by whoever mounted it.
        let mut pose = [0.0; JOINTS];
        pose[RAIL] = twin.rail;
        twin.world.reset_to(&pose);
        twin.show_joints();
        Ok(twin)
    }

    /// Moves on by one [`STEP`].
    pub fn step(&mut self) {
        self.now += STEP;
        self.arm.advance(self.now);
        let torques = self.torques();
        self.collisions += u64::from(self.world.drive(&torques));
        self.thumb.step(STEP.as_secs_f64(), &self.hand.pwm());
        for event in self.world.events() {
            match event.velocity {
                0 => self.keyboard.release(self.now, event.key),
                velocity => self.keyboard.press(self.now, event.key, velocity),
            }
        }
        self.show_joints();
    }

    /// What the drives do to the world's joints.
    fn torques(&mut self) -> [f64; JOINTS] {
        let duty = self.hand.pwm();
        let rail = self.path.place(&self.arm.joints()).rail_m;
        let speed = (rail - self.rail) / STEP.as_secs_f64();
        self.rail = rail;
        let (joints, velocities) = (self.world.joints(), self.world.joint_velocities());
        let arm = &self.truth.arm;
        std::array::from_fn(|joint| {
            if joint == RAIL {
                arm.stiffness * (rail - joints[RAIL]) + arm.damping * (speed - velocities[RAIL])
            } else {
                f64::from(duty[joint]) / f64::from(FULL_SCALE_PWM) * self.truth.hand.full_torque_nm
            }
        })
    }

    /// Tells the hand where its joints are.
    fn show_joints(&mut self) {
        let thumb: [f64; 4] = std::array::from_fn(|joint| self.thumb.positions()[FINGER_JOINTS + joint]);
        self.hand.set_positions(&to_wire(&self.world.joints(), &thumb));
    }

    /// Time since it was switched on.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Its world: the truth that no controller sees.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Steps in which something else than fingertips on the keyboard touched.
    pub fn collisions(&self) -> u64 {
        self.collisions
    }
}

/// The calibration that a careful operator would make of a twin's keyboard.
pub fn calibration(rig: &str) -> Calibration {
    let points = SHOWN_KEYS.map(|key| {
        let [x, y, z] = MIDDLE_MM;
        let rail_m = key_lateral(key);
        Point {
            pitch: etude_music::LOWEST_PITCH + key as u8,
            rail_m,
            position_mm: [x, y - rail_m * 1e3, z],
            orientation_deg: ORIENTATION_DEG,
        }
    });
    Calibration {
        rig: rig.to_string(),
        arm_serial: ARM_SERIAL.to_string(),
        points: points.to_vec(),
        ..Calibration::default()
    }
}

/// Serial number of the emulated arm.
pub const ARM_SERIAL: &str = "XS130424A01A08";

fn stage_side(side: HandSide) -> Side {
    match side {
        HandSide::Left => Side::Left,
        HandSide::Right => Side::Right,
    }
}
