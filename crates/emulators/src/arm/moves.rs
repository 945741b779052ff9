//! Moves of the emulated arm that our driver does not use: of the tool, relative ones, online
//! planning (modes 6 and 7) and velocities (modes 4 and 5).
//!
//! Approximations: a straight line or a circle of the tool is a straight line in joint space to
//! each of its ends, in about the time that the line takes. Moves never blend. In modes 6 and 7
//! each joint turns to its newest target on its own.

use etude_robot::xarm::kinematics::{self, ARM_JOINTS, KinematicsError, Pose, jacobian, logarithm};
use nalgebra::{Matrix6, Rotation3, SVector, Vector3, Vector6};

use super::answers::{Answer, beyond};
use super::emulator::ArmEmulator;
use super::motion::MAX_SPEED;
use super::setting_registers::numbers;
use super::state::{Condition, Planned, Receipt, Steering, Velocity};

/// Acceleration of moves of the tool and of pauses, rad/s²; the tool's own acceleration is not
/// looked at.
const ACCELERATION: f64 = 20.0;
/// Damping of the velocities of the tool, which keeps the joints slow near singular places.
const DAMPING: f64 = 1e-4;
/// Longest pause of a pause order, s.
const MAX_PAUSE_SECS: f64 = 600.0;

/// How the numbers of a pose are meant.
#[derive(Clone, Copy, Debug, Default)]
struct Meaning {
    /// In the tool's frame, from where it is.
    tool: bool,
    /// The turn is an axis times an angle.
    axis_angle: bool,
    /// From where the tool is, along the base's axes.
    relative: bool,
}

impl ArmEmulator {
    /// A move. `None` if the register is none of a move, or its parameters are wrong.
    pub(super) fn move_by(&mut self, register: u8, params: &[u8], receipt: Receipt) -> Option<Answer> {
        let flag = |at: usize| params.get(at).is_some_and(|byte| *byte != 0);
        let pose = |at: usize| numbers::<6>(params.get(4 * at..)?);
        let float = |at: usize| Some(f64::from(numbers::<1>(params.get(4 * at..)?)?[0]));
        match register {
            // Lines: to a pose (with a radius from firmware 1.11.100 on), blended, in the tool's
            // frame, with an axis and an angle.
            21 | 22 | 28 | 92 => {
                let common = params.len() >= 43;
                let meaning = Meaning {
                    tool: register == 28 || if common { flag(40) } else { register == 92 && flag(36) },
                    axis_angle: register == 92 || common && flag(41),
                    relative: register == 92 && flag(37),
                };
                let check = match register {
                    _ if common => flag(42),
                    22 => flag(40),
                    92 => flag(38),
                    _ => flag(36),
                };
                let to = self.meant(pose(0)?, meaning, self.end());
                Some(self.lines(&[to], float(6)?, check, receipt))
            }
            // A joint move with a radius.
            24 => {
                let to: [f32; ARM_JOINTS] = numbers(params)?;
                let answer = self.plan(to.map(f64::from), float(7)?, float(8)?, flag(40), receipt);
                Some(answer)
            }
            25 => Some(self.plan([0.0; ARM_JOINTS], float(0)?, float(1)?, flag(12), receipt)),
            26 => Some(self.pause(float(0)?, receipt)),
            27 => {
                let common = params.len() >= 67;
                let meaning =
                    Meaning { tool: common && flag(64), axis_angle: common && flag(65), relative: false };
                let (from, check) = (self.end(), flag(if common { 66 } else { 64 }));
                let ends = [pose(0)?, pose(6)?].map(|pose| self.meant(pose, meaning, from));
                let back = self.tool_with(from);
                // 100 % is the whole circle, which ends where it began.
                let count = if float(15)? >= 100.0 { 3 } else { 2 };
                Some(self.lines(&[ends[0], ends[1], back][..count], float(12)?, check, receipt))
            }
            30 | 93 => {
                let meaning = match register {
                    30 => Meaning { tool: float(8)? != 0.0, ..Meaning::default() },
                    _ => Meaning { tool: flag(32), axis_angle: true, relative: flag(36) },
                };
                let aim = self.motion.aim();
                let to = self.meant(pose(0)?, meaning, aim);
                if !self.moves_in(1) {
                    return Some(Answer::Idle(Vec::new()));
                }
                match self.joints_for(&to, &aim) {
                    Ok(joints) => Some(self.servo(joints)),
                    Err(error) => {
                        self.inject_error(code(error));
                        Some(Answer::Done(Vec::new()))
                    }
                }
            }
            81 => {
                let speeds: [f32; ARM_JOINTS] = numbers(params)?;
                self.steer(4, Velocity::Joints(speeds.map(f64::from)), params.get(29..))
            }
            82 => {
                let [x, y, z, turn_x, turn_y, turn_z] = pose(0)?.map(f64::from);
                let (linear, angular) = (Vector3::new(x, y, z) * 1e-3, Vector3::new(turn_x, turn_y, turn_z));
                let wanted = Velocity::Tool { linear, angular, own_frame: flag(24) };
                self.steer(5, wanted, params.get(25..))
            }
            // Relative: of the joints, or of the tool.
            83 => {
                let (speed, check) = (float(7)?, flag(46));
                if flag(44) {
                    let by: [f32; ARM_JOINTS] = numbers(params)?;
                    let end = self.end();
                    let to = std::array::from_fn(|joint| end[joint] + f64::from(by[joint]));
                    return Some(self.plan(to, speed, float(8)?, check, receipt));
                }
                let meaning = Meaning { relative: true, axis_angle: flag(45), tool: false };
                let to = self.meant(pose(0)?, meaning, self.end());
                Some(self.lines(&[to], speed, check, receipt))
            }
            // The end of all that waits, as a move of no length.
            253 if self.moves_in(0) && (self.motion.planned() || !self.queue.is_empty()) => {
                let to = self.end();
                self.queue.push_back(Planned { to, speed: MAX_SPEED, acceleration: ACCELERATION, receipt });
                Some(Answer::Done(Vec::new()))
            }
            253 => {
                self.feedback(&receipt, 2, 0);
                Some(Answer::Done(Vec::new()))
            }
            _ => None,
        }
    }

    /// Kinematics of any joints and poses. `None` if the register is none of these, or there is no
    /// answer.
    pub(super) fn calculate(&mut self, register: u8, params: &[u8]) -> Option<Answer> {
        let mut reply = Vec::new();
        let mut floats = |values: &[f32]| etude_robot::xarm::codec::push_floats(&mut reply, values);
        match register {
            43 => {
                let to = Pose::from_wire(numbers(params)?);
                // A reference in place of the joints as they are.
                let near = match params.get(25..) {
                    Some(near) if !near.is_empty() => numbers::<ARM_JOINTS>(near)?.map(f64::from),
                    _ => self.motion.joints,
                };
                let Ok(joints) = self.joints_for(&to, &near) else {
                    self.settings.warning = 14;
                    return None;
                };
                floats(&joints.map(|angle| angle as f32));
            }
            44 => {
                let joints: [f32; ARM_JOINTS] = numbers(params)?;
                floats(&self.tool_with(joints.map(f64::from)).to_wire());
            }
            45 => reply.push(beyond(&numbers::<ARM_JOINTS>(params)?.map(f64::from)).into()),
            46 => {
                let to = Pose::from_wire(numbers(params)?);
                reply.push(self.joints_for(&to, &self.motion.joints).is_err().into());
            }
            76 => {
                let (from, to) = (numbers::<6>(params)?, numbers::<6>(params.get(24..)?)?);
                let (kind_in, kind_out) = (*params.get(48)? != 0, *params.get(49)? != 0);
                let (from, to) = (absolute(from, kind_in), absolute(to, kind_in));
                floats(&wire(&compose(&inverted(&from), &to), kind_out));
            }
            91 => floats(&wire(&self.tool(), true)),
            _ => return None,
        }
        Some(Answer::Done(reply))
    }

    /// The pose of the tool for joints: the flange with the offset that was set, from a base with
    /// the offset that was set.
    pub(super) fn tool_with(&self, joints: [f64; ARM_JOINTS]) -> Pose {
        let flange = kinematics::forward(&joints);
        compose(&compose(&self.world(), &flange), &self.offset())
    }

    fn offset(&self) -> Pose {
        Pose::from_wire(self.settings.tcp_offset_mm_rad)
    }

    fn world(&self) -> Pose {
        Pose::from_wire(self.extra.world_offset_mm_rad)
    }

    /// Where the arm will be when all that waits is done.
    fn end(&self) -> [f64; ARM_JOINTS] {
        self.queue.back().map_or_else(|| self.motion.aim(), |planned| planned.to)
    }

    /// The pose of the tool that numbers mean, for joints from which relative ones count.
    fn meant(&self, values: [f32; 6], meaning: Meaning, from: [f64; ARM_JOINTS]) -> Pose {
        let start = self.tool_with(from);
        let given = absolute(values, meaning.axis_angle);
        if meaning.tool {
            return compose(&start, &given);
        }
        if !meaning.relative {
            return given;
        }
        if meaning.axis_angle {
            let position_m = start.position_m + given.position_m;
            return Pose { position_m, rotation: given.rotation * start.rotation };
        }
        let mut sum = start.to_wire();
        sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        Pose::from_wire(sum)
    }

    /// The joints near others that bring the tool to a pose.
    fn joints_for(
        &self,
        tool: &Pose,
        near: &[f64; ARM_JOINTS],
    ) -> Result<[f64; ARM_JOINTS], KinematicsError> {
        let flange = compose(&compose(&inverted(&self.world()), tool), &inverted(&self.offset()));
        kinematics::inverse(&flange, near)
    }

    /// Moves of the tool to poses one after the other, mm/s; `check` only tells whether they can be
    /// done.
    fn lines(&mut self, poses: &[Pose], speed_mm: f64, check: bool, receipt: Receipt) -> Answer {
        let online = self.moves_in(7);
        if !(online || self.moves_in(0)) {
            return self.idle();
        }
        if speed_mm <= 0.0 {
            self.settings.warning = 12;
            return Answer::Invalid;
        }
        let most = f64::from(if self.extra.reduced { self.extra.reduced_tcp_mm_s } else { 1000.0 });
        let speed_mm = speed_mm.min(most).max(1e-3);
        let (mut from, mut moves) = (self.end(), Vec::new());
        for pose in poses {
            let to = match self.joints_for(pose, &from) {
                Ok(to) => to,
                Err(error) if check => return self.taken(code(error)),
                Err(error) => {
                    self.inject_error(code(error));
                    return self.taken(0);
                }
            };
            let longest = to.iter().zip(from).map(|(to, from)| (to - from).abs()).fold(1e-9, f64::max);
            let distance_mm = (self.tool_with(from).position_m - pose.position_m).norm() * 1e3;
            // A turn on the spot takes a tenth of a second at least.
            let secs = (distance_mm / speed_mm).max(0.1).max(longest / MAX_SPEED);
            moves.push((to, longest / secs));
            from = to;
        }
        for (index, (to, speed)) in moves.iter().copied().enumerate().filter(|_| !check) {
            let wants = if index + 1 == poses.len() { receipt.wants } else { 0 };
            let planned =
                Planned { to, speed, acceleration: ACCELERATION, receipt: Receipt { wants, ..receipt } };
            self.queue_or_seek(planned, online);
        }
        self.taken(0)
    }

    /// Stands for some time between moves.
    fn pause(&mut self, secs: f64, receipt: Receipt) -> Answer {
        if !self.moves_in(0) {
            return self.idle();
        }
        // A way too short to see, as slow as the pause is long.
        let secs = secs.clamp(1e-3, MAX_PAUSE_SECS);
        let to = self.end();
        self.queue_or_seek(Planned { to, speed: 1e-9 / secs, acceleration: 1e-6, receipt }, false);
        self.taken(0)
    }

    /// Takes on velocities. After them come the time in seconds after which they end, or nothing.
    fn steer(&mut self, mode: u8, wanted: Velocity, duration: Option<&[u8]>) -> Option<Answer> {
        let duration = match duration {
            Some(bytes) if !bytes.is_empty() => f64::from(numbers::<1>(bytes)?[0]),
            _ => 0.0,
        };
        if !self.moves_in(mode) {
            return Some(Answer::Idle(Vec::new()));
        }
        let until = (duration > 0.0).then(|| self.clock.saturating_add((duration * 1e3).round() as u64));
        self.steering = Some(Steering { wanted, until });
        Some(Answer::Done(Vec::new()))
    }

    /// One millisecond of the velocities that are wanted. A joint that leaves its range is an
    /// error.
    pub(super) fn steer_on(&mut self) {
        let Some(Steering { wanted, until }) = self.steering else { return };
        // The time of a pause counts as time of the velocities.
        if self.condition == Condition::Paused {
            return;
        }
        let mut speeds = match wanted {
            _ if until.is_some_and(|until| self.clock >= until) => {
                self.steering = None;
                [0.0; ARM_JOINTS]
            }
            Velocity::Joints(speeds) => speeds,
            Velocity::Tool { linear, angular, own_frame } => self.joint_speeds(linear, angular, own_frame),
        };
        // All joints are slowed alike.
        let fastest = speeds.iter().map(|speed| speed.abs()).fold(self.speed_limit(), f64::max);
        speeds.iter_mut().for_each(|speed| *speed *= self.speed_limit() / fastest);
        self.motion.turn_at(speeds);
        if self.outside(&self.motion.joints) {
            self.inject_error(23);
        }
    }

    fn joint_speeds(
        &self,
        linear: Vector3<f64>,
        angular: Vector3<f64>,
        own_frame: bool,
    ) -> [f64; ARM_JOINTS] {
        let (joints, world) = (&self.motion.joints, self.world());
        let flange = kinematics::forward(joints);
        let lever = flange.rotation * self.offset().position_m;
        let frame =
            if own_frame { flange.rotation * self.offset().rotation } else { world.rotation.inverse() };
        let (linear, angular) = (frame * linear, frame * angular);
        let linear = linear - angular.cross(&lever);
        let twist = Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z);
        let jacobian = jacobian(joints);
        let damped = jacobian * jacobian.transpose() + Matrix6::identity() * DAMPING;
        let speeds: SVector<f64, ARM_JOINTS> = damped
            .cholesky()
            .map_or_else(SVector::zeros, |factors| jacobian.transpose() * factors.solve(&twist));
        speeds.into()
    }
}

/// Error of the controller for a pose that it cannot reach.
fn code(error: KinematicsError) -> u8 {
    if matches!(error, KinematicsError::BeyondLimit { .. }) { 23 } else { 21 }
}

/// A pose in the frame of another.
fn compose(outer: &Pose, inner: &Pose) -> Pose {
    Pose {
        position_m: outer.position_m + outer.rotation * inner.position_m,
        rotation: outer.rotation * inner.rotation,
    }
}

fn inverted(pose: &Pose) -> Pose {
    let rotation = pose.rotation.inverse();
    Pose { position_m: -(rotation * pose.position_m), rotation }
}

/// A pose as clients write it: roll, pitch and yaw, or an axis times an angle.
fn absolute(values: [f32; 6], axis_angle: bool) -> Pose {
    let pose = Pose::from_wire(values);
    if !axis_angle {
        return pose;
    }
    let [.., x, y, z] = values.map(f64::from);
    Pose { rotation: Rotation3::from_scaled_axis(Vector3::new(x, y, z)), ..pose }
}

fn wire(pose: &Pose, axis_angle: bool) -> [f32; 6] {
    let mut values = pose.to_wire();
    if axis_angle {
        let turn = logarithm(&pose.rotation);
        values[3..].iter_mut().zip(turn.iter()).for_each(|(to, from)| *to = *from as f32);
    }
    values
}
