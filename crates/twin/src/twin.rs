//! The twin: emulators of hand, arm and keyboard, moved by a separate world in steps of a
//! millisecond.
//!
//! ```text
//! CAN ◄──► HandEmulator ─ duty ──► Drives ──►┌───────┐─ key travel ─► Keys ─► KeyboardEmulator ──► MIDI
//!                ▲─ counts ─ Encoders ◄──────│ World │
//! TCP ◄──► ArmEmulator ─ place on the rail ─►└───────┘
//! ```
//!
//! What it leaves out: the thumb moves freely; the keys exert no forces on the arm's joints, and
//! the arm gives way along the keyboard only.

use std::time::Duration;

use etude_checks::RangeError;
use etude_emulators::{
    ArmEmulator, ArmEmulatorConfig, Devices, FreeHand, HandEmulator, HandEmulatorConfig, KeyboardEmulator,
};
use etude_music::KEY_COUNT;
use etude_robot::allegro::HandSide;
use etude_robot::calibration::{Calibration, CalibrationError, Point, RailPath, RailPlace};
use etude_robot::joints::{HAND_DRIVEN_JOINTS, RAIL, to_wire};
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_stage::geometry::{HALF_WIDTH, key_lateral};
use etude_stage::{DRIVEN_JOINTS, Side, StageConfig, StageError, World};

use crate::backlash::Backlash;
use crate::drives::{Drives, Encoders};
use crate::error::TwinParamsError;
use crate::hidden_params::STEP;
use crate::keys::{KeyEvent, Keys};
use crate::mount::Mount;
use crate::params::TwinParams;

/// Where the flange stands over the middle key, mm, and how it is turned, degrees: the paper's C3
/// (lasr-lab/learning-to-play-piano).
const MIDDLE_MM: [f64; 3] = [485.0, -2.83, 170.51];
const ORIENTATION_DEG: [f64; 3] = [-90.0, 225.0, -90.0];
/// An arm that is no farther from its path along the keys is at them, m.
const AT_THE_KEYS_M: f64 = 0.005;
/// The keys that a calibration shows: the outer Cs and the middle one.
pub const SHOWN_KEYS: [usize; 3] = [0, 24, KEY_COUNT - 1];

/// A twin could not be made.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// Its parameters are not sound.
    #[error(transparent)]
    TwinParams(#[from] TwinParamsError),
    /// Its world could not be built.
    #[error(transparent)]
    Stage(#[from] StageError),
    /// Its arm does not reach its keyboard: a bug.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// Its keyboard's settings are not valid.
    #[error(transparent)]
    Keyboard(#[from] RangeError),
}

/// An emulated robot.
pub struct Twin {
    pub(crate) twin_params: TwinParams,
    pub(crate) world: World,
    drives: Drives,
    backlash: Backlash,
    mount: Mount,
    encoders: Encoders,
    keys: Keys,
    path: RailPath,
    /// The emulated devices.
    pub devices: Devices,
    thumb: FreeHand,
    rail: f64,
    /// How high the arm holds the hand over its place at the keys, m.
    lift: f64,
    now: Duration,
}

impl Twin {
    /// A twin with this parameter set: everything switched on, the arm in the paper's home.
    ///
    /// # Errors
    /// If the parameter set is not sound.
    pub fn new(twin_params: &TwinParams, side: HandSide) -> Result<Self, TwinError> {
        let hidden = &twin_params.hidden;
        let params = hidden.params().map_err(TwinParamsError::from)?;
        // A real keyboard has no fences: the sides of its keys do what they stand for.
        let stage = StageConfig { side: stage_side(side), fences: false, ..StageConfig::default() };
        let hand = HandEmulatorConfig {
            side,
            noise_counts: hidden.hand.noise_counts,
            clock_skew: hidden.hand.clock_skew,
            torque_timeout_secs: hidden.hand.torque_timeout_secs,
            seed: twin_params.run_seed(),
            ..HandEmulatorConfig::default()
        };
        let arm = ArmEmulator::new(ArmEmulatorConfig {
            delay_secs: hidden.arm.delay_secs,
            bandwidth_hz: hidden.arm.bandwidth_hz,
            damping_ratio: hidden.arm.damping_ratio,
            ..ArmEmulatorConfig::default()
        });
        let path = RailPath::new(
            &calibration("twin"),
            [-HALF_WIDTH, HALF_WIDTH],
            &PAPER_HOME_DEG.map(f64::to_radians),
        )?;
        let mut twin = Self {
            world: World::with_options(&stage, &params, &hidden.options())?,
            drives: Drives::new(&hidden.hand),
            backlash: Backlash::new(&hidden.hand, &params),
            mount: Mount::new(&hidden.arm, hidden.seed),
            encoders: Encoders::new(&hidden.hand),
            keys: Keys::new(&hidden.keys, hidden.second_contacts(&params)),
            rail: path.place(&arm.joints()).rail_m,
            lift: 0.0,
            path,
            devices: Devices {
                hand: HandEmulator::new(&hand),
                arm,
                keyboard: KeyboardEmulator::new(&hidden.keyboard)?,
            },
            thumb: FreeHand::default(),
            twin_params: twin_params.clone(),
            now: Duration::ZERO,
        };
        // Fingers straight, clear of the keys, as a hand is mounted.
        let mut pose = [0.0; DRIVEN_JOINTS];
        pose[RAIL] = twin.rail;
        twin.world.reset_to(&pose);
        twin.show_joints();
        Ok(twin)
    }

    /// Moves on by one [`STEP`].
    pub fn step(&mut self) {
        self.now += STEP;
        self.devices.arm.advance(self.now);
        let torques = self.torques();
        self.drive(&torques);
        self.thumb.step(STEP.as_secs_f64(), &self.devices.hand.pwm());
        let (now, world, keyboard) = (self.now, &self.world, &mut self.devices.keyboard);
        self.keys.update(
            now,
            |key| world.key_travel(key),
            |key, event| match event {
                KeyEvent::Press(velocity) => keyboard.press(now, key, velocity),
                KeyEvent::Release => keyboard.release(now, key),
            },
        );
        self.show_joints();
    }

    /// What the drives do to the world's joints.
    fn torques(&mut self) -> [f64; DRIVEN_JOINTS] {
        let duty = self.devices.hand.pwm();
        let place = self.path.place(&self.devices.arm.joints());
        let rail = place.rail_m;
        let speed = (rail - self.rail) / STEP.as_secs_f64();
        self.rail = rail;
        self.lift = lift(&place);
        let (joints, velocities) = (self.world.joints(), self.world.joint_velocities());
        let arm = &self.twin_params.hidden.arm;
        std::array::from_fn(|joint| {
            if joint == RAIL {
                arm.stiffness * (rail - joints[RAIL]) + arm.damping * (speed - velocities[RAIL])
            } else {
                let motor = |speed| self.drives.torque(joint, &duty, speed);
                self.backlash.pass(joint, motor, velocities[joint])
            }
        })
    }

    /// Moves the world on.
    fn drive(&mut self, torques: &[f64; DRIVEN_JOINTS]) {
        let [toward, along, up] = self.mount.offset(self.world.joints()[RAIL]).unwrap_or_default();
        self.world.set_hand_offset([toward, along, up + self.lift]);
        self.world.drive(torques);
    }

    /// Sets the measured positions of the hand.
    fn show_joints(&mut self) {
        let thumb: [f64; 4] = std::array::from_fn(|joint| self.thumb.positions()[HAND_DRIVEN_JOINTS + joint]);
        self.devices.hand.set_positions(&to_wire(&self.encoders.read(&self.world.joints()), &thumb));
    }

    /// Brings the fingers by hand to these angles, rad, at rest and clear of the keys.
    pub fn place_fingers(&mut self, fingers: &[f64; HAND_DRIVEN_JOINTS]) {
        let mut pose = self.world.joints();
        pose[..HAND_DRIVEN_JOINTS].copy_from_slice(fingers);
        self.world.reset_to(&pose);
        self.show_joints();
    }

    /// Time since it was switched on.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Where the joints are, rad, the rail in m: for observers, not for the controller.
    pub fn joints(&self) -> [f64; DRIVEN_JOINTS] {
        self.world.joints()
    }

    /// How fast they move, rad/s, the rail in m/s.
    pub fn joint_velocities(&self) -> [f64; DRIVEN_JOINTS] {
        self.world.joint_velocities()
    }
}

/// How high a hand is held whose arm is off its path along the keys, m: the world's hand moves
/// along the keys and up only, so any distance counts as height.
fn lift(place: &RailPlace) -> f64 {
    (place.beside_m - AT_THE_KEYS_M).max(0.0)
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
            shown_unix_secs: 0,
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

/// The simulator's name of a hand's side.
pub fn stage_side(side: HandSide) -> Side {
    match side {
        HandSide::Left => Side::Left,
        HandSide::Right => Side::Right,
    }
}

#[cfg(test)]
mod dragging;
#[cfg(test)]
mod keyboard;
#[cfg(test)]
mod tests;
