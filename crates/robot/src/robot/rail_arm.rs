//! The arm as the rail: it carries the hand along the keyboard, and to it.

use std::time::Duration;

use super::arm_path::ArmPath;
use super::axes::RAIL_AXIS;
use super::fault::{Fault, Refused};
use super::homing_plan::{CLEAR_M, ViaPoint};

use super::status::{Phase, Status};
use crate::calibration::{RailPath, RailPlace};
use crate::limiter::Axis;
use crate::rig_file::{RigConfig, RigError};
use crate::wires::Wires;
use crate::xarm::kinematics::{ARM_JOINTS, forward};
use crate::xarm::{Arm, ArmConfig};

/// Largest distance from its path along the keyboard at which the arm may begin to follow it, m.
const ON_PATH_M: f64 = 0.005;
/// The same for its orientation, rad.
const ON_PATH_RAD: f64 = 0.03;
/// Within this of the path and below [`CLEAR_M`], a move of all joints could sweep over the keys,
/// m.
const NEAR_KEYS_M: f64 = 0.15;

/// A report of the arm.
pub(super) struct ArmReport {
    pub joints: [f64; ARM_JOINTS],
    /// The target that it follows, if it reports that.
    pub target: Option<[f64; ARM_JOINTS]>,
    pub place: RailPlace,
}

/// The arm, its path along the keyboard, and where it was sent on it.
pub(super) struct RailArm {
    pub arm: Arm,
    path: RailPath,
    /// The rail once more, as the arm is sent it: one step for each target.
    axis: Axis,
    /// Joints that it was last asked for; `None` while it is not on its path.
    sent: Option<[f64; ARM_JOINTS]>,
    /// Where it stood when the robot began to hold still, rad.
    stood: Option<[f64; ARM_JOINTS]>,
    /// How far from its path that was, rad: eased out, so that the first target is where the arm
    /// stands.
    offset: [f64; ARM_JOINTS],
    /// When it reported last.
    reported_at: Option<Duration>,
    /// Cosine of the angle between the palm's normal and straight down.
    palm_down: f64,
    is_connected: bool,
    is_started: bool,
}

impl RailArm {
    pub fn new(config: &RigConfig, path: RailPath) -> Result<Self, RigError> {
        let period = config.arm.servo_period().as_secs_f64();
        Ok(Self {
            arm: Arm::new(config.arm.clone())?,
            path,
            axis: Axis::at_rest(config.axes()[RAIL_AXIS], period, 0.0),
            sent: None,
            stood: None,
            offset: [0.0; ARM_JOINTS],
            reported_at: None,
            palm_down: 0.0,
            is_connected: false,
            is_started: false,
        })
    }

    /// To be started when it is connected.
    pub fn start(&mut self) {
        self.sent = None;
        self.is_started = false;
    }

    /// Where the hand is, seen from the rail; in the middle before the arm has reported.
    pub fn place(&self) -> RailPlace {
        self.path.place(&self.arm.joints().unwrap_or(*self.path.middle()))
    }

    /// Where the arm arrives at the keyboard, m.
    pub fn middle_m(&self) -> f64 {
        self.path.place(self.path.middle()).rail_m
    }

    /// Whether it is on its path along the keyboard.
    pub fn is_on_path(&self) -> bool {
        self.sent.is_some()
    }

    pub fn palm_down(&self) -> f64 {
        self.palm_down
    }

    /// The rail's set-point as it was sent, m, and its speed.
    pub fn axis(&self) -> &Axis {
        &self.axis
    }

    /// Where it was sent last away from its path, or where it stood, rad.
    pub fn sent_elsewhere(&self) -> Option<[f64; ARM_JOINTS]> {
        self.arm.sent().or(self.stood)
    }

    /// Receives what has arrived, starts the arm when it is connected, and stops it if it comes
    /// back after a stop.
    pub fn receive(
        &mut self,
        now: Duration,
        wires: &mut dyn Wires,
        status: &Status,
        bytes: &mut Vec<u8>,
    ) -> Result<Option<ArmReport>, Fault> {
        bytes.clear();
        let connected = wires.receive_arm(bytes).and_then(|()| {
            self.arm.receive_command(now, bytes);
            bytes.clear();
            wires.receive_report(bytes)
        });
        if connected.is_ok() != self.is_connected {
            self.is_connected = connected.is_ok();
            if self.is_connected {
                self.arm.connected(now);
            } else {
                self.arm.disconnected(now);
            }
            if self.is_connected && status.is_released() {
                // It may not have received the stop, and may still be moving.
                let mut stop = Vec::new();
                self.arm.stop(now, &mut stop);
                wires.send_arm(&stop)?;
            }
        }
        connected?;
        self.arm.receive_report(now, bytes);
        if status.phase() == Phase::Starting && !self.is_started {
            self.is_started = true;
            self.arm.start(now)?;
        }
        let Some(joints) = self.arm.joints().filter(|_| self.arm.joints_at() != self.reported_at) else {
            return Ok(None);
        };
        self.reported_at = self.arm.joints_at();
        self.palm_down = self.path.palm_down(&joints);
        let target = self.arm.report().and_then(|report| report.target_rad).map(|rad| rad.map(f64::from));
        Ok(Some(ArmReport { joints, target, place: self.path.place(&joints) }))
    }

    /// Whether this is the arm of the calibration.
    pub fn check_serial(&self) -> Result<(), Fault> {
        let (found, expected) = (self.arm.serial().unwrap_or_default(), self.path.arm_serial());
        if found == expected {
            return Ok(());
        }
        Err(Fault::OtherArm { found: found.to_string(), expected: expected.to_string() })
    }

    /// Begins to hold still at `place`, which is `outside_m` outside the rail's range: on its path
    /// if it is near enough.
    pub fn settle(
        &mut self,
        now: Duration,
        place: &RailPlace,
        outside_m: f64,
        rail_m: f64,
    ) -> Result<(), Fault> {
        let is_on_path =
            place.beside_m <= ON_PATH_M && place.turned_rad <= ON_PATH_RAD && outside_m.abs() <= ON_PATH_M;
        self.stood = self.arm.joints();
        self.sent = self.stood.filter(|_| is_on_path);
        self.offset = match &self.sent {
            Some(stood) => {
                let on_path = self.path_joints(place.rail_m, stood)?;
                std::array::from_fn(|joint| stood[joint] - on_path[joint])
            }
            None => Default::default(),
        };
        self.axis.rest(rail_m);
        self.arm.align(now, now);
        Ok(())
    }

    /// Leaves its path along the keyboard.
    pub fn leave_path(&mut self) {
        self.sent = None;
    }

    /// Where it was sent last, and where that is on the rail, m.
    pub fn sent_place(&self) -> ([f64; ARM_JOINTS], f64) {
        let joints = self.arm.sent().unwrap_or(*self.path.middle());
        (joints, self.path.place(&joints).rail_m)
    }

    /// Has arrived on its path along the keyboard, at these joints.
    pub fn arrive(&mut self, joints: [f64; ARM_JOINTS], rail_m: f64) {
        self.axis.rest(rail_m);
        self.sent = Some(joints);
        self.offset = Default::default();
    }

    /// Sends the next target along the keyboard. After late replies the rail's set-point is far
    /// ahead: the arm catches up with it within the same limits. In a `pause` it has braked. `left`
    /// is the share of the offset that is left, `eased_m` what the easing adds to the rail.
    pub fn follow_rail(
        &mut self,
        now: Duration,
        pause: Option<Duration>,
        rail_m: f64,
        (eased_m, left): (f64, f64),
        brakes: impl Fn(&Axis) -> bool,
    ) -> Result<(), Fault> {
        let Some(near) = self.sent else { return Ok(()) };
        let period = self.arm.servo_period();
        let stood_secs = match pause {
            Some(_) if self.arm.slows_down(now) => f64::INFINITY,
            pause => pause.unwrap_or_default().saturating_sub(period).as_secs_f64(),
        };
        self.axis.pause(stood_secs, period.as_secs_f64());
        if brakes(&self.axis) {
            self.axis.brake();
        } else {
            self.axis.step(rail_m);
        }
        let mut joints = self.path_joints(self.axis.position() + eased_m, &near)?;
        for (joint, offset) in joints.iter_mut().zip(self.offset) {
            *joint += offset * left;
        }
        self.arm.servo(now, joints)?;
        self.sent = Some(joints);
        Ok(())
    }

    /// The first via point of its path to the keyboard.
    pub fn first_via(&self) -> ViaPoint {
        let Some(joints) = self.arm.joints() else { return ViaPoint::Home };
        let place = self.path.place(&joints);
        let above_m = forward(&joints).position_m.z - self.path.pose(place.rail_m).position_m.z;
        if place.beside_m <= NEAR_KEYS_M && above_m < CLEAR_M { ViaPoint::Up } else { ViaPoint::Home }
    }

    /// Whether the arm's path from where it stands to a via point, and from there home, stays in
    /// its box.
    pub fn check_path(&self, config: &ArmConfig, via: ViaPoint) -> Result<(), Refused> {
        let (Some(safety_box), Some(mut from)) = (config.box_mm, self.arm.joints()) else { return Ok(()) };
        for via in [via, ViaPoint::Home] {
            let Ok(joints) = via.joints(&self.path, &from) else { return Ok(()) };
            safety_box.holds_path(&from, &joints)?;
            from = joints;
        }
        Ok(())
    }

    /// The path to a via point, from where the arm was sent last: an arm that sags a little does
    /// not jump.
    pub fn path_to(&self, via: ViaPoint, config: &ArmConfig) -> Result<ArmPath, Fault> {
        let from = self.arm.sent().or(self.arm.joints()).unwrap_or(*self.path.middle());
        let rail_m = self.path.place(&from).rail_m;
        let to = via.joints(&self.path, &from).map_err(|source| Fault::Reach { rail_m, source })?;
        Ok(ArmPath::new(from, to, config, self.arm.servo_period()))
    }

    fn path_joints(&self, rail_m: f64, near: &[f64; ARM_JOINTS]) -> Result<[f64; ARM_JOINTS], Fault> {
        self.path.joints(rail_m, near).map_err(|source| Fault::Reach { rail_m, source })
    }
}
