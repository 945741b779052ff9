//! The controller of a whole robot: hand, arm and keyboard, their limits, and what happens when one of them fails.
//!
//! [`Robot`] is polled with the time and its [`Wires`]; between polls the caller gives it a stream to
//! [`follow`](Robot::follow). Set-points go through the limiter on a grid of [`SETPOINT_HZ`]; from there the rail becomes joint angles of
//! the arm, and the fingers become torques at the hand's own clock. There is no other way to either device.
//!
//! ```text
//! off ─start─► starting ─► holding ◄──────► following
//!                            │ ▲ └─home, approach─► moving ─┐
//!                            │ └────────────────────────────┘
//!  any of them ──────stop────┴─► stopped      any of them ──fault──► fault (latched until start)
//! ```
//!
//! A fault of any device releases the hand and stops the arm in the same poll.

mod advance;
mod axes;
mod doubt;
mod fault;
mod following;
mod homing;
mod interlock;
mod io;
mod motion;
mod phase;
mod plan;
mod readings;
mod record;
mod turning;
mod warmth;
mod way;
mod wiggle;

use std::time::Duration;

pub use advance::OBSERVED;
pub use doubt::Doubt;
pub use fault::{Fault, Refused, RobotError};
pub use interlock::ROOTS_OVER_KEYS_M;
pub use phase::Phase;
pub use plan::propose_fence;
pub use record::Record;
pub use warmth::Warmth;
pub use wiggle::{WIGGLED, Wiggled, wiggle};

use crate::allegro::{Hand, HandFault, JointLoop};
use crate::calibration::RailPath;
use crate::can::CanFrame;
use crate::joints::{DRIVEN, FINGER_JOINTS, RAIL, to_wire};
use crate::keyboard::{KeyChange, Keyboard};
use crate::limiter::Axis;
use crate::rig::{RigConfig, RigError, SETPOINT_HZ};
use crate::wires::Wires;
use crate::xarm::{Arm, ArmFault, kinematics};
use axes::{AXES, RAIL_AXIS, all_axes, driven, period};
use doubt::Doubts;
use following::{Following, farthest};
use motion::{Easing, SlowMove, Stretch};
use plan::{Plan, Station, check_fence};
use record::Journal;

/// Fingers straight ahead, clear of the keys.
const CLEAR_FINGERS: [f64; FINGER_JOINTS] = [0.0; FINGER_JOINTS];

/// The controller of a robot.
pub struct Robot {
    config: RigConfig,
    path: RailPath,
    hand: Hand,
    joint_loop: JointLoop,
    arm: Arm,
    keyboard: Keyboard,
    axes: [Axis; AXES],
    /// The rail once more, as the arm is sent it: one step for each target.
    arm_axis: Axis,
    phase: Phase,
    fault: Option<Fault>,
    plan: Option<Plan>,
    stream: Option<Stretch>,
    /// Set-points before the last step, for the joint loop in between.
    before: [f64; AXES],
    /// The offsets of joints that started outside their ranges, which fade out.
    easing: Easing,
    following: Following,
    doubts: Doubts,
    /// New angles have arrived, from which no torque was computed yet.
    measured: bool,
    stepped: Duration,
    polled: Option<Duration>,
    /// When the hand was released last, and first since the start.
    released_at: Duration,
    let_go_at: Option<Duration>,
    /// Joints that the arm was last asked for; `None` while the arm is not on its path.
    arm_sent: Option<[f64; kinematics::JOINTS]>,
    /// Where it stood when the robot began to hold still, rad.
    arm_stood: Option<[f64; kinematics::JOINTS]>,
    /// How far from its path that was, rad: eased out, so that the first target is where the arm stands.
    arm_aside: [f64; kinematics::JOINTS],
    arm_seen: Option<Duration>,
    /// Cosine of the angle between the palm's normal and straight down.
    palm_down: f64,
    /// Whether the drivers are connected, and whether the arm was started.
    arm_connected: bool,
    keyboard_connected: bool,
    arm_told: bool,
    journal: Journal,
    clamped: u64,
    frames: Vec<CanFrame>,
    bytes: Vec<u8>,
    changes: Vec<KeyChange>,
}

impl Robot {
    /// A controller for this rig and the place of its keyboard.
    ///
    /// # Errors
    /// If the configuration is not sound, or its box for the arm does not hold the keyboard and the way there.
    pub fn new(config: &RigConfig, path: RailPath) -> Result<Self, RobotError> {
        config.check()?;
        if let Some(fence) = &config.arm.fence_mm {
            check_fence(fence, &path, config.limits.rail_range_m)?;
        }
        let limits = config.axes();
        Ok(Self {
            path,
            hand: Hand::new(&config.hand).map_err(RigError::from)?,
            joint_loop: JointLoop::new(&config.joint_loop).map_err(RigError::from)?,
            arm: Arm::new(config.arm.clone()).map_err(RigError::from)?,
            keyboard: Keyboard::new(&config.keyboard).map_err(RigError::from)?,
            axes: std::array::from_fn(|axis| Axis::at_rest(limits[axis], 1.0 / SETPOINT_HZ, 0.0)),
            arm_axis: Axis::at_rest(limits[RAIL_AXIS], config.arm.servo_period().as_secs_f64(), 0.0),
            config: config.clone(),
            phase: Phase::Off,
            fault: None,
            plan: None,
            stream: None,
            before: [0.0; AXES],
            easing: Easing::new(Duration::ZERO, [0.0; AXES]),
            following: Following::default(),
            doubts: Doubts::default(),
            measured: false,
            stepped: Duration::ZERO,
            polled: None,
            released_at: Duration::ZERO,
            let_go_at: None,
            arm_sent: None,
            arm_stood: None,
            arm_aside: [0.0; kinematics::JOINTS],
            arm_seen: None,
            palm_down: 0.0,
            arm_connected: false,
            keyboard_connected: false,
            arm_told: false,
            journal: Journal::default(),
            clamped: 0,
            frames: Vec::new(),
            bytes: Vec::new(),
            changes: Vec::new(),
        })
    }

    /// Starts the devices. This also clears a fault, and only an operator may ask for it.
    pub fn start(&mut self, now: Duration) {
        self.fault = None;
        self.plan = None;
        self.stream = None;
        self.arm_sent = None;
        self.let_go_at = None;
        self.joint_loop.reset();
        self.keyboard.acknowledge();
        self.hand.start(now);
        self.enter(now, Phase::Starting);
        self.arm_told = false;
    }

    /// Releases the hand and stops the arm, at once and in any state.
    pub fn stop(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.release(now, wires);
        if self.phase != Phase::Fault {
            self.enter(now, Phase::Stopped);
        }
    }

    /// `etude robot stop` was called, which stops hand and arm itself: that is not the fault that it looked like.
    pub fn stop_was_requested(&mut self, now: Duration) {
        let is_the_stop = match &self.fault {
            Some(Fault::Hand(fault)) => matches!(fault, HandFault::ServoOff | HandFault::OtherProgram),
            Some(Fault::Arm(fault)) => matches!(fault, ArmFault::UnexpectedState { .. } | ArmFault::NotReady),
            _ => false,
        };
        if is_the_stop {
            self.fault = None;
            self.enter(now, Phase::Stopped);
        }
    }

    /// Brings the robot slowly to a pose, from wherever it is: fingers straight, the arm over its home and from above
    /// to the middle of the keyboard, then fingers and rail to `goal`, or the nearest that their ranges allow. If it is
    /// at the keyboard and the fingers are near the goal, only fingers and rail move; if they are far from it, the arm
    /// goes straight up before they move, which frees a finger that is caught. From beside the keys it goes straight up
    /// too. Otherwise it moves only when the fingers are straight.
    ///
    /// # Errors
    /// If the robot does not hold still, the goal is not finite, or the way would leave the arm's box.
    pub fn home(&mut self, now: Duration, goal: &[f64; DRIVEN]) -> Result<(), Refused> {
        let far = farthest(&self.hand.positions(), &self.within_ranges(goal)).1;
        let is_near = far <= self.config.limits.start_finger_rad;
        let station = if self.arm_sent.is_some() && is_near { None } else { Some(self.first_station()) };
        station.map_or(Ok(()), |station| self.check_way(station))?;
        self.slow_move(now, station, goal)
    }

    /// Brings fingers and rail slowly to a pose, or the nearest that their ranges allow.
    ///
    /// # Errors
    /// If the robot does not hold still at the keyboard, or the goal holds a number that is not finite.
    pub fn approach(&mut self, now: Duration, goal: &[f64; DRIVEN]) -> Result<(), Refused> {
        if self.arm_sent.is_none() {
            let remedy = "not at the keyboard: `etude robot home` brings it there";
            return Err(Refused::Phase { phase: self.phase.name(), remedy });
        }
        self.slow_move(now, None, goal)
    }

    fn slow_move(
        &mut self,
        now: Duration,
        station: Option<Station>,
        goal: &[f64; DRIVEN],
    ) -> Result<(), Refused> {
        self.wants(Phase::Holding)?;
        if let Some(joint) = goal.iter().position(|value| !value.is_finite()) {
            return Err(Refused::NoPose { joint });
        }
        let goal = driven(&self.within_ranges(goal));
        let from_keys = station.is_some() && self.arm_sent.is_some();
        if from_keys && self.arm_axis.velocity() != 0.0 {
            return Err(Refused::Phase { phase: self.phase.name(), remedy: "wait until it stands still" });
        }
        let first = match station {
            None => goal,
            Some(_) if from_keys => {
                self.arm_sent = None;
                driven(&self.setpoints())
            }
            Some(_) => {
                // Away from the keyboard the rail's set-point moves nothing: it stands where the arm will arrive.
                let clear = self.clear_pose();
                self.axes[RAIL_AXIS].rest(clear[RAIL]);
                clear
            }
        };
        self.plan = Some(Plan { from_keys, ..Plan::new(self.slowly(now, &first), station, goal) });
        self.enter(now, Phase::Moving);
        Ok(())
    }

    /// Fingers straight, and the rail where the arm arrives at the keyboard.
    fn clear_pose(&self) -> [f64; DRIVEN] {
        let mut pose = [0.0; DRIVEN];
        pose[..FINGER_JOINTS].copy_from_slice(&CLEAR_FINGERS);
        pose[RAIL] = self.path.place(self.path.middle()).rail_m;
        pose
    }

    /// The pose for all axes, or the nearest that their ranges allow.
    fn within_ranges(&self, pose: &[f64; DRIVEN]) -> [f64; AXES] {
        let axes = all_axes(pose, &self.config.limits.thumb_rad);
        std::array::from_fn(|axis| {
            let [low, high] = self.axes[axis].limits().position;
            axes[axis].clamp(low, high)
        })
    }

    fn slowly(&self, now: Duration, goal: &[f64; DRIVEN]) -> SlowMove {
        SlowMove::new(
            now,
            self.setpoints(),
            all_axes(goal, &self.config.limits.thumb_rad),
            &self.config.axes(),
        )
    }

    /// Follows a stretch of a stream from `begun` on: one waypoint (rad, the rail in m) a set-point. It replaces what is
    /// left of the stretch before, and the last waypoint stands when they have run out.
    ///
    /// # Errors
    /// If the robot is neither holding nor following, or is not near the first waypoint when it begins, or its
    /// keyboard has a warning that no start has acknowledged.
    pub fn follow(&mut self, begun: Duration, waypoints: &[[f64; DRIVEN]]) -> Result<(), Refused> {
        // A beginning in the future would delay the check of the age of commands.
        let ahead = Duration::from_secs_f64(self.config.limits.stale_command_secs);
        let begun = self.polled.map_or(begun, |polled| begun.min(polled.saturating_add(ahead)));
        if self.phase != Phase::Following {
            self.wants(Phase::Holding)?;
            let Some(first) = waypoints.first() else { return Ok(()) };
            self.near(first)?;
            if let Some(warning) = self.keyboard.warnings().next() {
                return Err(Refused::Keyboard(warning.to_string()));
            }
            // The grid of the set-points is that of the stream: each waypoint is then due a whole period after its stretch begins, also if
            // the first command comes a little late. At rest one shorter period does not matter.
            let periods = self.stepped.saturating_sub(begun).as_nanos() / period().as_nanos();
            self.stepped = begun + period() * periods as u32;
            self.arm.align(begun, self.stepped);
            self.enter(begun, Phase::Following);
        }
        let mut kept = self.stream.take().map(|stretch| stretch.waypoints).unwrap_or_default();
        kept.clear();
        kept.extend_from_slice(waypoints);
        self.stream = Some(Stretch { begun, waypoints: kept });
        Ok(())
    }

    /// Ends a stream or a slow move: brakes and holds. The arm's way to the keyboard continues to its end: only
    /// [`stop`](Self::stop) ends that.
    pub fn hold(&mut self, now: Duration) {
        if self.plan.as_ref().is_some_and(|plan| plan.station.is_some()) {
            return;
        }
        if matches!(self.phase, Phase::Following | Phase::Moving) {
            self.plan = None;
            self.enter(now, Phase::Holding);
        }
        self.stream = None;
    }

    fn wants(&self, phase: Phase) -> Result<(), Refused> {
        let remedy = match self.phase {
            Phase::Off | Phase::Stopped => "start it first",
            Phase::Fault => "remove the cause, then start it again",
            Phase::Starting => "wait until it holds",
            Phase::Holding | Phase::Moving | Phase::Following => "wait until it stands still",
        };
        if self.phase == phase { Ok(()) } else { Err(Refused::Phase { phase: self.phase.name(), remedy }) }
    }

    /// Whether the robot is where this pose is.
    fn near(&self, pose: &[f64; DRIVEN]) -> Result<(), Refused> {
        let limits = &self.config.limits;
        let measured = self.hand.positions();
        let asked = to_wire(pose, &limits.thumb_rad);
        for (joint, (measured_rad, asked_rad)) in measured.into_iter().zip(asked).enumerate() {
            let far = (measured_rad - asked_rad).abs();
            if far.is_nan() || far > limits.start_finger_rad {
                return Err(Refused::FingerFar { joint, measured_rad, asked_rad });
            }
        }
        let by_m = (self.place().rail_m - pose[RAIL]).abs();
        if by_m.is_nan() || by_m > limits.start_rail_m || self.arm_sent.is_none() {
            return Err(Refused::RailFar { by_m: by_m.max(self.place().beside_m) });
        }
        Ok(())
    }

    fn enter(&mut self, now: Duration, phase: Phase) {
        if self.phase != phase {
            self.phase = phase;
            self.journal.push(Record::Note { at: now, kind: "phase", text: phase.name().to_string() });
        }
    }

    fn setpoints(&self) -> [f64; AXES] {
        self.axes.each_ref().map(Axis::position)
    }

    /// Sets how warm the motors of the hand are already.
    pub fn set_warmth(&mut self, warmth: Warmth) {
        self.doubts.warmth = warmth;
    }

    /// Takes the records since the last call.
    pub fn records(&mut self) -> impl Iterator<Item = Record> + '_ {
        self.journal.take()
    }
}
