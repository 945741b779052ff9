//! Listens in on all that the controller sends, and fails the test at the first thing that is out
//! of bounds.
//!
//! Decoding and limits are its own, from the published sources: what the crate's codecs and tables
//! had wrong, it would not share.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::time::Duration;

use etude_robot::can::CanFrame;
use etude_robot::limiter::AxisLimits;
use etude_robot::rig_file::RigConfig;
use etude_robot::xarm::kinematics::forward;
use etude_robot::{Phase, Record};
use etude_stage::geometry::WHITE;
use etude_stage::hand::{MOUNT, Side, TIP_RADIUS};
use etude_stage::kinematics::fingertip;
use etude_stage::{DRIVEN_JOINTS, RAIL};

/// Largest PWM of a finger's and the thumb's joints (allegro_hand_ros_v4).
const FINGER_PWM: [i16; 4] = [375, 675, 450, 285];
const THUMB_PWM: [i16; 4] = [525, 405, 270, 270];
/// Ranges of the arm's joints, degrees (xArm user manual).
const ARM_DEG: [[f64; 2]; 7] = [
    [-360.0, 360.0],
    [-118.0, 120.0],
    [-360.0, 360.0],
    [-11.0, 225.0],
    [-360.0, 360.0],
    [-97.0, 180.0],
    [-360.0, 360.0],
];
/// Fastest flange, m/s, and fastest joint, rad/s (xArm user manual).
const FLANGE_M_S: f64 = 1.0;
const JOINT_RAD_S: f64 = PI;
/// Time between two targets: shorter ones would not make the arm any faster (xArm user manual), and
/// longer ones would leap.
const TARGET_SECS: [f64; 2] = [0.005, 0.02];
/// The first target may be so far from the arm: reports are up to 10 ms old, and it may still
/// brake.
const FIRST_RAD: f64 = 0.1;
/// Time after a finger began to be dragged in which the hand may not yet brake: old angles, a poll,
/// a set-point, a target, and the jerk of each.
const REACTION: Duration = Duration::from_millis(40);
/// A fingertip this far below the tops of the white keys is among them, whatever biases and play the
/// encoders have, m.
const AMONG_KEYS_M: f64 = 0.0055;
/// A roll joint this far from where it was sent is dragged, whatever biases and play the encoders
/// have, rad.
const BEHIND_RAD: f64 = 0.15;
/// The stop of a finger's roll joint, rad (Allegro's URDF).
const ROLL_STOP_RAD: f64 = 0.47;
/// Where the flange stands over the middle of the keyboard, m in the arm's frame, whose y points
/// toward the low notes (the paper's C3).
const MIDDLE_M: [f64; 3] = [0.485, -0.00283, 0.17051];
/// Nearer than this to the line along the keyboard through that place, m, the arm follows the rail.
const ON_RAIL_M: f64 = 0.006;
/// Set-points per second.
const SETPOINT_SECS: f64 = 0.005;

/// A set-point as differences tell it: position, and once there were enough of them, speed and
/// acceleration.
#[derive(Clone, Copy, Default)]
struct Past {
    position: Option<f64>,
    speed: Option<f64>,
    acceleration: Option<f64>,
}

/// What was sent so far, as far as it matters for what comes next.
pub struct Judge {
    /// Limits of the driven joints.
    limits: [AxisLimits; 13],
    /// The last torques that each finger was sent.
    torques: [[i16; 4]; 4],
    /// Bytes to the arm that are not a whole request yet.
    partial: Vec<u8>,
    /// Register and first parameter of the last request that changes what the arm does.
    last_order: Option<(u8, u8)>,
    target: Option<(Duration, [f64; 7])>,
    /// Time between two targets that the controller uses now, s.
    pub target_secs: f64,
    /// Speed (m/s) and acceleration (m/s²) along the keyboard between the last targets: one of these,
    /// because after a pause the arm continues as it has braked, or from rest.
    arm_motions: Vec<[f64; 2]>,
    /// The longest step of the flange from target to target, and the greatest acceleration and jerk
    /// along the keyboard.
    pub worst_step_m: f64,
    pub worst_m_s2: f64,
    pub worst_m_s3: f64,
    /// For the last moments, the place on the rail beyond which the hand may not get, m, toward the
    /// low and toward the high notes: there a finger that it drags has its roll joint at its stop.
    ends: VecDeque<(Duration, [f64; 2])>,
    /// Speeds that the hand may have toward either end: it brakes to them.
    allowed_m_s: [f64; 2],
    /// Targets at which a finger was dragged.
    pub dragged: u64,
    past: [Past; 13],
    /// Whether the arm is told where to be by the set-point of the rail.
    rail_moves: bool,
    /// Sent since the last [`settled`](Self::settled).
    drove: bool,
    moved: bool,
    ordered: Option<u8>,
    /// What the controller was then.
    idle: bool,
    starting: bool,
    /// Where the arm really is; without it first targets are not judged.
    pub arm: Option<[f64; 7]>,
    pub frames: u64,
    pub targets: u64,
    pub set_points: u64,
}

impl Judge {
    pub fn new(rig: &RigConfig) -> Self {
        let axes = rig.axes();
        Self {
            limits: std::array::from_fn(|joint| if joint == 12 { axes[16] } else { axes[joint] }),
            torques: [[0; 4]; 4],
            partial: Vec::new(),
            last_order: None,
            target: None,
            target_secs: TARGET_SECS[0],
            arm_motions: vec![[0.0; 2]],
            worst_step_m: 0.0,
            worst_m_s2: 0.0,
            worst_m_s3: 0.0,
            ends: VecDeque::new(),
            allowed_m_s: [rig.limits.rail_velocity; 2],
            dragged: 0,
            past: [Past::default(); 13],
            rail_moves: false,
            drove: false,
            moved: false,
            ordered: None,
            idle: true,
            starting: false,
            arm: None,
            frames: 0,
            targets: 0,
            set_points: 0,
        }
    }

    /// A frame goes to the hand (device 0).
    pub fn frame(&mut self, frame: &CanFrame) {
        self.frames += 1;
        let (id, data) = (frame.id(), frame.payload());
        if frame.is_remote() {
            let asked = [0x200, 0x220, 0x0E0, 0x0E4, 0x0E8, 0x0EC];
            assert!(asked.contains(&id) && data.is_empty(), "asked for {frame:?}");
            return;
        }
        match id {
            0x100 => {
                assert!(data.is_empty(), "{frame:?}");
                self.drove = true;
            }
            0x104 => assert!(data.is_empty(), "{frame:?}"),
            0x204 => assert!(data.len() == 6 || data.len() == 8, "{frame:?}"),
            0x180 | 0x184 | 0x188 | 0x18C => {
                assert_eq!(data.len(), 8, "{frame:?}");
                let finger = usize::from(id - 0x180) / 4;
                let limits = if finger == 3 { THUMB_PWM } else { FINGER_PWM };
                for joint in 0..4 {
                    let pwm = i16::from_le_bytes([data[2 * joint], data[2 * joint + 1]]);
                    assert!(pwm.unsigned_abs() <= limits[joint].unsigned_abs(), "{frame:?}");
                    self.torques[finger][joint] = pwm;
                    self.drove |= pwm != 0;
                }
            }
            _ => panic!("nothing of ours has this identifier: {frame:?}"),
        }
    }

    /// The joints of the hand really are at these angles, and it is at this place on the rail.
    pub fn fingers(&mut self, now: Duration, joints: &[f64; DRIVEN_JOINTS]) {
        let (angles, rail_m) = (joints.as_chunks::<4>().0, joints[RAIL]);
        let mut ends = [f64::NEG_INFINITY, f64::INFINITY];
        for (finger, angles) in angles.iter().enumerate() {
            let height = fingertip(Side::Left, finger, angles, 0.0)[2];
            let Some(sent) = self.past[4 * finger].position else { continue };
            if height - TIP_RADIUS > WHITE.top() - AMONG_KEYS_M {
                continue;
            }
            // A tip that is stuck turns the roll joint up while the hand moves to high notes.
            let way = |stop: f64| (MOUNT[1] - height) * (stop.tan() - angles[0].tan());
            if angles[0] < sent - BEHIND_RAD {
                ends[0] = ends[0].max(rail_m + way(-ROLL_STOP_RAD));
            } else if angles[0] > sent + BEHIND_RAD {
                ends[1] = ends[1].min(rail_m + way(ROLL_STOP_RAD));
            }
        }
        self.ends.push_back((now, ends));
        while self.ends.front().is_some_and(|(at, _)| *at + REACTION < now) {
            self.ends.pop_front();
        }
    }

    /// Bytes go to the arm.
    pub fn arm_bytes(&mut self, now: Duration, bytes: &[u8]) {
        self.partial.extend_from_slice(bytes);
        while self.partial.len() >= 6 {
            let word = |at: usize| u16::from_be_bytes([self.partial[at], self.partial[at + 1]]);
            let (transaction, protocol, length) = (word(0), word(2), usize::from(word(4)));
            assert!(transaction >= 1 && (2..=3).contains(&protocol) && (1..=64).contains(&length));
            if self.partial.len() < 6 + length {
                return;
            }
            let request: Vec<u8> = self.partial.drain(..6 + length).skip(6).collect();
            self.request(now, request[0], &request[1..]);
        }
    }

    fn request(&mut self, now: Duration, register: u8, params: &[u8]) {
        let first = params.first().copied().unwrap_or(0);
        let floats: Vec<f64> =
            params.as_chunks::<4>().0.iter().map(|bytes| f64::from(f32::from_le_bytes(*bytes))).collect();
        match register {
            // Questions: version, serial number, state, errors.
            1 | 2 | 13 | 15 => return assert!(params.is_empty()),
            16 | 17 => assert!(params.is_empty()),
            11 => assert_eq!(params, [8, 1]),
            12 => assert!(params == [0] || params == [4], "{params:?}"),
            19 => assert!(first <= 2 && params.len() <= 2, "{params:?}"),
            // What the arm takes for jerks and accelerations of its own moves, mm and rad (xArm
            // user manual).
            31..=34 => {
                let most = [100_000.0, 50_000.0, 500.0, 20.0][usize::from(register - 31)];
                assert!(params.len() == 4 && (1e-3..=most).contains(&floats[0]), "{register}: {floats:?}");
            }
            37 => assert!((1..=5).contains(&first), "{params:?}"),
            36 => {
                assert!(params.len() == 16 && (0.0..=3.5).contains(&floats[0]), "{floats:?}");
                assert!(floats[1..].iter().all(|centre| centre.abs() <= 500.0), "{floats:?}");
            }
            29 => {
                assert_eq!(params.len(), 40);
                within_range(&floats);
                self.servo(now, std::array::from_fn(|joint| floats[joint]));
            }
            _ => panic!("nothing of ours uses register {register}: {params:?}"),
        }
        if register != 29 {
            self.target = None;
            self.arm_motions = vec![[0.0; 2]];
        }
        // After a change of mode, the set-point of the rail begins anew where the arm then is.
        self.rail_moves = register == 29 || self.rail_moves && register != 19;
        self.last_order = Some((register, first));
        self.moved |= register == 29;
        if (register, first) != (12, 4) {
            self.ordered = Some(register);
        }
    }

    fn servo(&mut self, now: Duration, joints: [f64; 7]) {
        self.targets += 1;
        let far = |other: &[f64; 7]| joints.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if let Some((at, before)) = self.target {
            let period = self.target_secs;
            assert!((TARGET_SECS[0]..=TARGET_SECS[1]).contains(&period), "a target every {period} s");
            let secs = (now - at).as_secs_f64().clamp(period, TARGET_SECS[1]);
            // What a 32-bit float rounds off.
            let rounding = 1e-5;
            assert!(far(&before) <= JOINT_RAD_S * secs + rounding, "{} rad in {secs} s", far(&before));
            let flange_distance_m = (forward(&joints).position_m - forward(&before).position_m).norm();
            assert!(flange_distance_m <= FLANGE_M_S * secs + rounding, "{flange_distance_m} m in {secs} s");
            // The arm takes each target at full speed, however late it comes, and brakes if none
            // comes.
            let along = forward(&joints).position_m[1] - forward(&before).position_m[1];
            let speed = along / period;
            let limits = &self.limits[12];
            if (now - at).as_secs_f64() > 1.75 * period {
                let braked = limits.acceleration * ((now - at).as_secs_f64() - period);
                for motion in &mut self.arm_motions {
                    *motion = [(motion[0].abs() - braked).max(0.0).copysign(motion[0]), 0.0];
                }
                self.arm_motions.push([0.0; 2]);
            }
            // Besides: what a joint that started outside its range is eased by, and what floats
            // round off.
            assert!(speed.abs() <= limits.velocity + 0.03, "{speed} m/s along the keyboard");
            let next = |[before, acceleration_before]: &[f64; 2]| {
                let acceleration = (speed - before) / period;
                let jerk = (acceleration - acceleration_before) / period;
                let is_kept = acceleration.abs() <= limits.acceleration * 1.02 + 0.3
                    && jerk.abs() <= limits.jerk * 1.02 + 30.0;
                (is_kept, acceleration, jerk)
            };
            let all: Vec<_> = self.arm_motions.iter().map(next).collect();
            let kept: Vec<_> = all.iter().filter(|(is_kept, ..)| *is_kept).collect();
            let Some(&&(_, acceleration, jerk)) = kept.first() else {
                panic!("along the keyboard, {speed} m/s, then m/s² and m/s³: {all:?}")
            };
            self.arm_motions = kept.iter().map(|(_, acceleration, _)| [speed, *acceleration]).collect();
            let flange = forward(&joints).position_m;
            if (flange[0] - MIDDLE_M[0]).hypot(flange[2] - MIDDLE_M[2]) < ON_RAIL_M {
                self.judge_dragging(MIDDLE_M[1] - flange[1], -speed, period);
            }
            self.worst_m_s3 = self.worst_m_s3.max(jerk.abs());
            self.worst_step_m = self.worst_step_m.max(flange_distance_m);
            self.worst_m_s2 = self.worst_m_s2.max(acceleration.abs());
        } else if let Some(arm) = &self.arm {
            assert!(far(arm) <= FIRST_RAD, "the first target is {} rad away", far(arm));
        }
        self.target = Some((now, joints));
    }

    /// A target at this place on the rail, m, at this speed: a hand that moves on can still stop
    /// before a finger that it drags gets to the stop of its roll joint, or it brakes.
    fn judge_dragging(&mut self, rail_m: f64, speed: f64, period: f64) {
        let limits = &self.limits[12];
        for (end, sign) in [-1.0, 1.0].into_iter().enumerate() {
            // The farthest of the last moments: what has changed since cannot be known yet.
            let way = self.ends.iter().map(|(_, ends)| (ends[end] - rail_m) * sign).fold(0.0, f64::max);
            let stopping = (2.0 * limits.acceleration * way).sqrt().min(limits.velocity);
            let braking = self.allowed_m_s[end] - limits.acceleration * period;
            self.allowed_m_s[end] = stopping.max(braking);
            // Besides: what one target may add before the hand brakes again.
            let most = self.allowed_m_s[end] + limits.acceleration * period + 0.03;
            assert!(speed * sign <= most, "{speed} m/s, {way} m before a finger's stop");
            self.dragged += u64::from(stopping < limits.velocity);
        }
    }

    /// What the controller says that it did.
    pub fn record(&mut self, record: &Record) {
        match record {
            Record::Note { kind: "phase", text, .. } if text == "starting" => {
                self.past = [Past::default(); 13]
            }
            Record::SetPoint { sent, .. } => self.set_point(sent),
            _ => {}
        }
    }

    fn set_point(&mut self, sent: &[f64; 13]) {
        self.set_points += 1;
        for (joint, ((limits, past), &position)) in
            self.limits.iter().zip(&mut self.past).zip(sent).enumerate()
        {
            let [low, high] = limits.position;
            let slack = 1e-8 * (high - low);
            assert!((low - slack..=high + slack).contains(&position), "joint {joint} at {position}");
            // Differences of rounded numbers, taken three times.
            let holds =
                |value: f64, limit: f64, rounding: f64| value.abs() <= limit * (1.0 + 1e-6) + rounding;
            let change = |now: Option<f64>, before: Option<f64>| Some((now? - before?) / SETPOINT_SECS);
            let speed = change(Some(position), past.position);
            let acceleration = change(speed, past.speed);
            let jerk = change(acceleration, past.acceleration);
            let kept = speed.is_none_or(|speed| holds(speed, limits.velocity, 1e-9))
                && acceleration.is_none_or(|acceleration| holds(acceleration, limits.acceleration, 1e-7))
                && jerk.is_none_or(|jerk| holds(jerk, limits.jerk, 1e-4));
            assert!(kept, "joint {joint}: speed {speed:?}, acceleration {acceleration:?}, jerk {jerk:?}");
            *past = Past { position: Some(position), speed, acceleration };
        }
        if !self.rail_moves {
            self.past[12] = Past::default();
        }
    }

    /// The controller has done what it does at a time, and is in this phase.
    pub fn settled(&mut self, phase: Phase) {
        let idle = matches!(phase, Phase::Off | Phase::Stopped | Phase::Fault);
        if idle {
            assert_eq!(self.torques, [[0; 4]; 4], "the last torque stands while it is {}", phase.name());
            assert!(
                matches!(self.last_order, None | Some((12, 4))),
                "{:?} stands while it is {}",
                self.last_order,
                phase.name()
            );
            if self.idle {
                assert!(!self.drove, "the hand was driven while it was {}", phase.name());
                assert_eq!(self.ordered, None, "the arm was ordered while it was {}", phase.name());
            }
        }
        if phase == Phase::Starting {
            assert_eq!(self.torques, [[0; 4]; 4], "torque while starting");
            assert!(!self.starting || !self.moved, "the arm is moved while starting");
        }
        (self.idle, self.starting) = (idle, phase == Phase::Starting);
        (self.drove, self.moved, self.ordered) = (false, false, None);
    }
}

fn within_range(floats: &[f64]) {
    for (angle, range) in floats.iter().zip(ARM_DEG) {
        let [low, high] = range.map(f64::to_radians);
        assert!((low - 1e-4..=high + 1e-4).contains(angle), "{floats:?}");
    }
}
