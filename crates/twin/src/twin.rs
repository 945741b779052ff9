//! The twin: emulators of hand, arm and keyboard, moved by a separate world in steps of a millisecond.
//!
//! ```text
//! CAN ◄──► HandEmulator ─ duty ──► Drives ──►┌───────┐─ key travel ─► Keys ─► KeyboardEmulator ──► MIDI
//!                ▲─ counts ─ Encoders ◄──────│ World │
//! TCP ◄──► ArmEmulator ─ place on the rail ─►└───────┘
//! ```
//!
//! What it leaves out: the hand is mounted on a rail, so height and tilt of the arm have no effect at the keys; the thumb moves
//! freely; the keys exert no forces on the arm's joints.

use std::time::Duration;

use etude_emulators::{
    ArmEmulator, ArmEmulatorConfig, Devices, FreeHand, HandEmulator, HandEmulatorConfig, KeyboardEmulator,
};
use etude_music::KEYS;
use etude_robot::allegro::HandSide;
use etude_robot::calibration::{Calibration, CalibrationError, Point, RailPath};
use etude_robot::joints::{FINGER_JOINTS, RAIL, to_wire};
use etude_robot::setting::SettingError;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_stage::geometry::{HALF_WIDTH, key_lateral};
use etude_stage::{JOINTS, Side, StageConfig, StageError, World};

use crate::drives::{Drives, Encoders};
use crate::error::TruthError;
use crate::keys::{KeyEvent, Keys};
use crate::numbers::STEP;
use crate::truth::Truth;

/// Where the flange stands over the middle key, mm, and how it is turned, degrees: the paper's C3 (lasr-lab/learning-to-play-piano).
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
    /// Its keyboard's settings are not valid.
    #[error(transparent)]
    Keyboard(#[from] SettingError),
}

/// An emulated robot.
pub struct Twin {
    pub(crate) truth: Truth,
    pub(crate) world: World,
    drives: Drives,
    encoders: Encoders,
    keys: Keys,
    path: RailPath,
    /// The emulated devices.
    pub devices: Devices,
    thumb: FreeHand,
    rail: f64,
    now: Duration,
}

impl Twin {
    /// A twin with this truth: everything switched on, the arm in the paper's home.
    ///
    /// # Errors
    /// If the truth is not sound.
    pub fn new(truth: &Truth, side: HandSide) -> Result<Self, TwinError> {
        let numbers = &truth.numbers;
        let params = numbers.params().map_err(TruthError::from)?;
        let stage = StageConfig { side: stage_side(side), ..StageConfig::default() };
        let hand = HandEmulatorConfig {
            side,
            noise_counts: numbers.hand.noise_counts,
            clock_skew: numbers.hand.clock_skew,
            torque_timeout_secs: numbers.hand.torque_timeout_secs,
            seed: truth.run_seed(),
            ..HandEmulatorConfig::default()
        };
        let arm = ArmEmulator::new(ArmEmulatorConfig {
            delay_secs: numbers.arm.delay_secs,
            bandwidth_hz: numbers.arm.bandwidth_hz,
            ..ArmEmulatorConfig::default()
        });
        let path = RailPath::new(
            &calibration("twin"),
            [-HALF_WIDTH, HALF_WIDTH],
            &PAPER_HOME_DEG.map(f64::to_radians),
        )?;
        let mut twin = Self {
            world: World::with_options(&stage, &params, &numbers.options())?,
            drives: Drives::new(&numbers.hand, &params),
            encoders: Encoders::new(&numbers.hand),
            keys: Keys::new(&numbers.keys, numbers.second_contacts(&params)),
            rail: path.place(&arm.joints()).rail_m,
            path,
            devices: Devices {
                hand: HandEmulator::new(&hand),
                arm,
                keyboard: KeyboardEmulator::new(&numbers.keyboard)?,
            },
            thumb: FreeHand::default(),
            truth: truth.clone(),
            now: Duration::ZERO,
        };
        // Fingers straight, clear of the keys, as a hand is mounted.
        let mut pose = [0.0; JOINTS];
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
        self.keys.look(
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
    fn torques(&mut self) -> [f64; JOINTS] {
        let duty = self.devices.hand.pwm();
        let rail = self.path.place(&self.devices.arm.joints()).rail_m;
        let speed = (rail - self.rail) / STEP.as_secs_f64();
        self.rail = rail;
        let (joints, velocities) = (self.world.joints(), self.world.joint_velocities());
        let arm = &self.truth.numbers.arm;
        std::array::from_fn(|joint| {
            if joint == RAIL {
                arm.stiffness * (rail - joints[RAIL]) + arm.damping * (speed - velocities[RAIL])
            } else {
                self.drives.torque(joint, &duty)
            }
        })
    }

    /// Moves the world on.
    fn drive(&mut self, torques: &[f64; JOINTS]) {
        self.world.set_joint_friction(&self.drives.friction(&self.world.joint_velocities()));
        self.world.drive(torques);
    }

    /// Sets the measured positions of the hand.
    fn show_joints(&mut self) {
        let thumb: [f64; 4] = std::array::from_fn(|joint| self.thumb.positions()[FINGER_JOINTS + joint]);
        self.devices.hand.set_positions(&to_wire(&self.encoders.read(&self.world.joints()), &thumb));
    }

    /// Brings the fingers by hand to these angles, rad, at rest and clear of the keys.
    pub fn place_fingers(&mut self, fingers: &[f64; FINGER_JOINTS]) {
        let mut pose = self.world.joints();
        pose[..FINGER_JOINTS].copy_from_slice(fingers);
        self.world.reset_to(&pose);
        self.show_joints();
    }

    /// Time since it was switched on.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Where the joints are, rad, the rail in m: for observers, not for the controller.
    pub fn joints(&self) -> [f64; JOINTS] {
        self.world.joints()
    }

    /// How fast they move, rad/s, the rail in m/s.
    pub fn joint_velocities(&self) -> [f64; JOINTS] {
        self.world.joint_velocities()
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
mod tests {
    use super::*;
    use etude_robot::allegro::{self, DeviceId, Finger, HandMessage, HostMessage, Request};
    use etude_stage::geometry::KeyShape;
    use etude_stage::params::WorldRow;

    fn twin(truth: &str) -> Twin {
        Twin::new(&Truth::parse(truth).unwrap(), HandSide::Left).unwrap()
    }

    /// The middle finger bends at its root under this duty, from above the keys: what the keyboard says in half a
    /// second.
    fn strike(truth: &str, pwm: i16) -> Vec<u8> {
        let mut twin = twin(truth);
        let pose = twin.world.start_pose();
        twin.world.reset_to(&pose);
        let torque = HostMessage::Torque { finger: Finger::Middle, pwm: [0, pwm, 0, 0] };
        for message in [HostMessage::ServoOn, torque] {
            twin.devices.hand.receive(twin.now, &message.encode(DeviceId::default()), &mut Vec::new());
        }
        let mut said = Vec::new();
        for _ in 0..500 {
            twin.step();
            twin.devices.keyboard.poll(twin.now, &mut said);
        }
        said
    }

    #[test]
    fn the_world_is_not_the_simulators() {
        let options = |name: &str| Truth::load(name).unwrap().numbers.options();
        let simulators = etude_stage::ModelOptions::default();
        for name in ["standard", "worn"] {
            let options = options(name);
            assert_ne!(options.integrator, simulators.integrator);
            assert_ne!(options.cone, simulators.cone);
            assert_ne!(options.keys, simulators.keys);
            assert_ne!(options.keyboard_yaw_rad, simulators.keyboard_yaw_rad);
        }
        assert_eq!(options("standard").step_secs, 0.001);
    }

    #[test]
    fn a_turned_keyboard_has_its_ends_elsewhere() {
        let straight = twin("");
        let turned = twin("[world]\nkeyboard_yaw_rad = 0.01");
        for key in SHOWN_KEYS {
            let [x, y, _] = straight.world.key_target(key);
            let [turned_x, turned_y, _] = turned.world.key_target(key);
            let (sine, cosine) = 0.01f64.sin_cos();
            assert!((turned_x - (x * cosine - y * sine)).abs() < 1e-12, "{key}");
            assert!((turned_y - (x * sine + y * cosine)).abs() < 1e-12, "{key}");
            // The body in the world stands where that says, and is turned.
            let data = turned.world.data();
            let body = data.body(&format!("key_{key}")).unwrap().view(data);
            let shape = KeyShape::of(key);
            let target_from_middle = [shape.target()[0] - shape.x, 0.0];
            assert!((body.xpos[0] + target_from_middle[0] * cosine - turned_x).abs() < 1e-12, "{key}");
            assert!((body.xpos[1] + target_from_middle[0] * sine - turned_y).abs() < 1e-12, "{key}");
            assert!((body.xquat[3] - 0.005f64.sin()).abs() < 1e-12, "{key}");
        }
        let ends =
            [0, KEYS - 1].map(|key| turned.world.key_target(key)[0] - straight.world.key_target(key)[0]);
        assert!(ends[0] > 0.003 && ends[1] < -0.003, "{ends:?}");
    }

    #[test]
    fn a_harder_strike_is_louder_on_the_wire() {
        let (soft, hard) = (strike("", 100), strike("", 600));
        assert!(soft.len() >= 3 && hard.len() >= 3, "{soft:?} {hard:?}");
        assert_eq!([soft[0], hard[0]], [0x90, 0x90]);
        assert!(soft[2] > 1 && soft[2] + 10 < hard[2], "{soft:?} {hard:?}");
        for stuck in ["[hand]\ndead_pwm = 100", "[physics]\n\"joint.fingers.friction\" = 0.1"] {
            assert!(strike(stuck, 100).is_empty(), "{stuck}");
        }
    }

    /// A finger joint, alone and under a steady duty for 0.2 s: how far it turned, rad.
    fn turned_under(truth: &str, pwm: i16) -> f64 {
        const JOINT: usize = 5;
        let mut twin = twin(truth);
        let before = twin.world.joints()[JOINT];
        let mut duty = [0; allegro::JOINTS];
        duty[JOINT] = pwm;
        for _ in 0..200 {
            let mut torques = [0.0; JOINTS];
            torques[JOINT] = twin.drives.torque(JOINT, &duty);
            twin.drive(&torques);
        }
        twin.world.joints()[JOINT] - before
    }

    #[test]
    fn a_joint_sticks_until_it_breaks_loose() {
        // 24 of 1200 are 0.02 N·m: more than moves it on its way, less than breaks it loose.
        let sliding = "[physics]\n\"joint.fingers.friction\" = 0.015";
        let sticking = format!("{sliding}\n[hand]\nfriction_at_rest = 1.5");
        let dead = "[hand]\ndead_pwm = 24";
        assert!(turned_under("", 24) > 0.1);
        assert!(turned_under(sliding, 24) > 0.05);
        assert!(turned_under(&sticking, 24).abs() < 1e-3, "{}", turned_under(&sticking, 24));
        assert!(turned_under(&sticking, 40) > 0.1);
        // Friction that holds does hold: without it MuJoCo's joints creep.
        assert!(turned_under(sliding, 14).abs() < 1e-3, "{}", turned_under(sliding, 14));
        assert_eq!(turned_under(dead, 24), 0.0);
        let weak = "[hand]\nfull_torque_nm = [1, 0.5, 1, 1]";
        assert!((turned_under(weak, 48) - turned_under("", 24)).abs() < 1e-9);
    }

    #[test]
    fn a_joint_ends_at_its_stop() {
        const JOINT: usize = 4;
        let mut twin = twin("");
        let mut farthest = 0.0f64;
        for _ in 0..300 {
            twin.drive(&std::array::from_fn(|joint| if joint == JOINT { 0.3 } else { 0.0 }));
            farthest = farthest.max(twin.world.joints()[JOINT]);
        }
        let [_, stop] = etude_stage::joint_range(JOINT);
        assert!((stop..stop + 0.03).contains(&farthest), "{farthest} beyond {stop}");
    }

    #[test]
    fn keys_have_their_own_springs_and_thresholds() {
        let spread = |seed: u64| {
            twin(&format!(
                "seed = {seed}\n[keys]\nstiffness_spread = 0.2\nthreshold_spread = 0.1\ntravel = 1.1"
            ))
        };
        let springs = |twin: &Twin| -> Vec<f64> {
            let model = twin.world.data().model();
            (0..KEYS)
                .map(|key| model.joint(&format!("key_{key}")).unwrap().view(model).stiffness[0])
                .collect()
        };
        let (one, same, other) = (spread(1), spread(1), spread(2));
        assert_eq!(springs(&one), springs(&same));
        assert_ne!(springs(&one), springs(&other));
        assert!(one.truth.numbers.options().keys.iter().all(|key| key.travel == 1.1));
        assert_eq!(one.keys.second, same.keys.second);
        assert_ne!(one.keys.second, other.keys.second);
        let nominal = one.world.params().world(WorldRow::KeyStiffness);
        assert!(springs(&one).iter().all(|spring| (spring / nominal - 1.0).abs() <= 0.2));
        assert!(springs(&one).iter().any(|spring| (spring / nominal - 1.0).abs() > 0.1));
        assert!(springs(&twin("seed = 1")).iter().all(|spring| *spring == nominal));
    }

    #[test]
    fn what_the_hand_sends_is_what_its_encoders_read() {
        let mut loose = twin("[hand]\nbacklash_rad = 0.02\nnoise_counts = 0");
        let mut pose = [0.0; JOINTS];
        pose[5] = 0.5;
        loose.world.reset_to(&pose);
        loose.show_joints();
        let mut answer = Vec::new();
        let device = DeviceId::default();
        let question = HostMessage::Request(Request::Position(Finger::Middle)).encode(device);
        loose.devices.hand.receive(loose.now, &question, &mut answer);
        let Some(HandMessage::Position { counts, .. }) = HandMessage::decode(device, &answer[0]) else {
            panic!("{answer:?}");
        };
        // Half the play short of the link, in whole counts.
        assert_eq!(counts, [0, allegro::counts_from_rad(0.49), 0, 0]);
    }
}
