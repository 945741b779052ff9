//! The controller of a whole robot: hand, arm and keyboard, their limits, and what happens when one
//! of them fails.
//!
//! [`Robot`] is polled with the time and its [`Wires`]; between polls the caller gives it a
//! trajectory to [`follow`](Robot::follow). Set-points go through the limiter on a grid of
//! [`SETPOINT_HZ`](crate::rig_file::SETPOINT_HZ); from there the rail becomes joint angles of the
//! arm, and the fingers become torques at the hand's own clock. There is no other path to either
//! device.
//!
//! ```text
//! off ─start─► starting ─► holding ◄──────► following
//!                            │ ▲ └─home, approach─► moving ─┐
//!                            │ └────────────────────────────┘
//!  any of them ──────stop────┴─► stopped      any of them ──fault──► fault (latched until start)
//! ```
//!
//! A fault of any device releases the hand and stops the arm in the same poll.
//!
//! | file | holds |
//! |---|---|
//! | `status` | phase, fault, journal |
//! | `set_points` | the limited axes, and what the hand's joint loop follows between two steps |
//! | `motion` | what moves them: `homing_plan` with its `slow_move` and `arm_path`, or a `trajectory` |
//! | `rail_arm`, `keyboard_input` | the two devices and what is known of them |
//! | `interlock`, `following_error`, `plausibility`, `stall` | what stops or brakes the robot |
//! | `requests`, `homing`, `cycle` | the robot itself: what it can be asked, its path to the keyboard, its cycle |

mod arm_path;
mod axes;
mod cycle;
mod fault;
mod following_error;
mod foreign_targets;
mod homing;
mod homing_plan;
mod interlock;
mod joint_check;
mod keyboard_input;
mod motion;
mod motor_heat;
mod plausibility;
mod rail_arm;
mod record;
mod requests;
mod runaway;
mod set_points;
mod slow_move;
mod stall;
mod status;
mod stuck_joint;
mod trajectory;

use std::time::Duration;

pub use fault::{Fault, Refused, RobotError};
pub use homing_plan::propose_box;
pub use interlock::{MAX_AHEAD_M, ROOTS_OVER_KEYS_M, drag_ways_m};
pub use joint_check::{JOINTS_CHECKED, JointCheck, check_joints};
pub use motor_heat::MotorHeat;
pub use plausibility::Implausible;
pub use record::Record;
pub use status::{OBSERVED, Phase};

use crate::allegro::{Hand, HandFault, JointLoop};
use crate::calibration::{RailPath, RailPlace};
use crate::can::CanFrame;
use crate::joints::{DRIVEN, from_wire};
use crate::keyboard::Keyboard;
use crate::rig_file::{RigConfig, RigError};
use crate::wires::Wires;
use crate::xarm::{Arm, ArmFault, untried};
use axes::driven;
use following_error::{FollowingError, farthest};
use homing_plan::check_box;
use keyboard_input::KeyboardInput;
use motion::MotionSource;
use plausibility::PlausibilityChecks;
use rail_arm::RailArm;
use set_points::SetPoints;
use stall::StallMonitor;
use status::Status;

/// The controller of a robot.
pub struct Robot {
    config: RigConfig,
    status: Status,
    hand: Hand,
    joint_loop: JointLoop,
    /// New angles have arrived, from which no torque was computed yet.
    has_new_angles: bool,
    rail_arm: RailArm,
    keyboard: KeyboardInput,
    set_points: SetPoints,
    motion: MotionSource,
    following_error: FollowingError,
    plausibility: PlausibilityChecks,
    stalls: StallMonitor,
    /// The longest time between two targets for the arm that is in the journal.
    noted_period: Option<Duration>,
    /// To be sent to the hand and to the arm.
    frames: Vec<CanFrame>,
    bytes: Vec<u8>,
}

impl Robot {
    /// A controller for this rig and the place of its keyboard.
    ///
    /// # Errors
    /// If the configuration is not sound, or its box for the arm does not hold the keyboard and the
    /// path there.
    pub fn new(config: &RigConfig, path: RailPath) -> Result<Self, RobotError> {
        config.check()?;
        if let Some(safety_box) = &config.arm.box_mm {
            check_box(safety_box, &path, config.limits.rail_range_m)?;
        }
        Ok(Self {
            status: Status::default(),
            hand: Hand::new(&config.hand).map_err(RigError::from)?,
            joint_loop: JointLoop::new(&config.joint_loop).map_err(RigError::from)?,
            has_new_angles: false,
            rail_arm: RailArm::new(config, path)?,
            keyboard: KeyboardInput::new(config)?,
            set_points: SetPoints::new(&config.axes()),
            motion: MotionSource::default(),
            following_error: FollowingError::default(),
            plausibility: PlausibilityChecks::default(),
            stalls: StallMonitor::default(),
            noted_period: None,
            frames: Vec::new(),
            bytes: Vec::new(),
            config: config.clone(),
        })
    }

    /// Starts the devices. This also clears a fault, and only an operator may ask for it.
    pub fn start(&mut self, now: Duration) {
        self.status.fault = None;
        self.status.first_released_at = None;
        self.motion.clear();
        self.rail_arm.start();
        self.joint_loop.reset();
        self.keyboard.keyboard.acknowledge();
        // A robot at rest need not be polled.
        self.stalls = StallMonitor::default();
        self.hand.start(now);
        self.status.enter(now, Phase::Starting);
    }

    /// Releases the hand and stops the arm, at once and in any phase.
    pub fn stop(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.release(now, wires);
        if self.phase() != Phase::Fault {
            self.status.enter(now, Phase::Stopped);
        }
    }

    /// `etude robot stop` was called, which stops hand and arm itself: that is not the fault that
    /// it looked like.
    pub fn stop_was_requested(&mut self, now: Duration) {
        let is_the_stop = match self.status.fault.as_ref().map(Fault::itself) {
            Some(Fault::Hand(fault)) => matches!(fault, HandFault::ServoOff | HandFault::OtherProgram),
            Some(Fault::Arm(fault)) => matches!(fault, ArmFault::UnexpectedState { .. } | ArmFault::NotReady),
            _ => false,
        };
        if is_the_stop {
            self.status.fault = None;
            self.status.enter(now, Phase::Stopped);
        }
    }

    /// Releases the hand once more, and ends its reports: for a program that ends.
    pub fn leave(&mut self, wires: &mut dyn Wires) {
        self.frames.clear();
        self.hand.stop(self.status.released_at, &mut self.frames);
        for frame in &self.frames {
            let _ = wires.send_frame(*frame);
        }
    }

    /// What it is doing.
    pub fn phase(&self) -> Phase {
        self.status.phase()
    }

    /// Whether torques are on.
    pub(crate) fn is_live(&self) -> bool {
        self.status.is_live()
    }

    /// Why it was stopped.
    pub fn fault(&self) -> Option<&Fault> {
        self.status.fault.as_ref()
    }

    /// Measured positions of the driven joints: rad, the rail in m.
    pub fn joints(&self) -> [f64; DRIVEN] {
        from_wire(&self.hand.positions(), self.place().rail_m)
    }

    /// The last set-points of the driven joints: rad, the rail in m.
    pub fn sent(&self) -> [f64; DRIVEN] {
        driven(&self.set_points.positions())
    }

    /// The rail's set-point, m, and its velocity, m/s.
    pub fn rail_set_point(&self) -> [f64; 2] {
        let rail = self.set_points.rail();
        [rail.position(), rail.velocity()]
    }

    /// The joint of the hand, as on the wire, that is farther from its set-point than
    /// `start_finger_rad`, and how far, rad.
    pub fn astray(&self) -> Option<(usize, f64)> {
        let (joint, by_rad) = farthest(&self.hand.positions(), &self.set_points.positions());
        (by_rad > self.config.limits.start_finger_rad).then_some((joint, by_rad))
    }

    /// Where the hand is, seen from the rail; in the middle before the arm has reported.
    pub fn place(&self) -> RailPlace {
        self.rail_arm.place()
    }

    /// Keys that are down: bit 0 is the lowest.
    pub fn pressed(&self) -> u64 {
        self.keyboard().pressed()
    }

    /// Set-points that were clamped so far, counted by joint.
    pub fn clamped(&self) -> u64 {
        self.set_points.clamped
    }

    /// The hand.
    pub fn hand(&self) -> &Hand {
        &self.hand
    }

    /// The arm.
    pub fn arm(&self) -> &Arm {
        &self.rail_arm.arm
    }

    /// The keyboard.
    pub fn keyboard(&self) -> &Keyboard {
        &self.keyboard.keyboard
    }

    /// What the operator should know of the devices, and what to do.
    pub fn warnings(&self) -> Vec<String> {
        let firmware = self.arm().version().and_then(untried);
        let link = self.noted_period.map(|_| format!("arm: {}", self.arm().link_speed()));
        let keyboard = self.keyboard().warnings().map(|warning| warning.to_string());
        firmware.into_iter().chain(link).chain(keyboard).collect()
    }

    /// The rig that it controls.
    pub fn config(&self) -> &RigConfig {
        &self.config
    }

    /// How hot the motors of the hand are. It counts from one start to the next.
    pub fn motor_heat(&self) -> MotorHeat {
        self.plausibility.motor_heat
    }

    /// Sets how hot the motors of the hand are already.
    pub fn set_motor_heat(&mut self, motor_heat: MotorHeat) {
        self.plausibility.motor_heat = motor_heat;
    }

    /// When the hand was released first since the start.
    pub fn first_released_at(&self) -> Option<Duration> {
        self.status.first_released_at
    }

    /// Takes the records since the last call.
    pub fn records(&mut self) -> impl Iterator<Item = Record> + '_ {
        self.status.journal.take()
    }

    /// Records that were dropped because they were not taken.
    pub fn lost_records(&self) -> u64 {
        self.status.journal.lost()
    }
}
