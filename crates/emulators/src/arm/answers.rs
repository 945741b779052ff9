//! The effect of each register of the emulated controller, and its reply (ufactory_docs,
//! registers).

use super::emulator::{ALL, ArmEmulator};
use super::motion::MAX_SPEED;
use super::state::{Condition, ConnectionId, Planned, Receipt};
use etude_robot::xarm::SafetyBox;
use etude_robot::xarm::codec::{
    Frame, PROTOCOL_KEEP_ALIVE, PROTOCOL_PRIVATE, Register, ReplyState, floats, push_floats,
};
use etude_robot::xarm::kinematics::{ARM_JOINTS, WIDEST_LIMITS_RAD};

/// Rounding of a limit to a 32-bit float.
const ROUNDING: f64 = 1e-6;
/// A servo target for which a joint needs longer than this at full speed is an error, s. The manual
/// forbids far targets without saying what happens: this is our guess.
const FAR_SECS: f64 = 0.1;
/// Moves in the queue at most.
const MAX_QUEUE: usize = 256;
/// Room that the version and the serial numbers take.
const TEXT: usize = 40;

/// Bytes that the official client takes out of the reply of a register, whether or not it was
/// obeyed: a refusal has as many zeros. What a real controller sends with a refusal is not known.
const READ: [(u8, usize); 20] = [
    (43, 28),
    (44, 24),
    (45, 1),
    (46, 1),
    (65, 1),
    (76, 24),
    (102, 4),
    (104, 4),
    (107, 4),
    (111, 12),
    (112, 12),
    (113, 12),
    (114, 12),
    (115, 4),
    (128, 4),
    (130, 4),
    (150, 24),
    (200, 24),
    (203, 1),
    (204, 40),
];

/// The outcome of a request.
pub(super) enum Answer {
    /// Done; with these parameters.
    Done(Vec<u8>),
    /// Not done: the register or its parameters are wrong.
    Invalid,
    /// Not done: the arm does not move now. Its reply has parameters all the same.
    Idle(Vec<u8>),
}

impl ArmEmulator {
    /// Does what a frame asks for, and replies.
    pub(super) fn answer(&mut self, id: ConnectionId, frame: &Frame) {
        match frame.protocol {
            PROTOCOL_PRIVATE | PROTOCOL_KEEP_ALIVE => {}
            // Modbus TCP: the exception "illegal function", from the unit that was asked.
            0 => return self.refuse_modbus(id, frame),
            // A heartbeat.
            _ => return,
        }
        let wants = self.connection(id).map_or(0, |connection| connection.wants);
        let receipt = Receipt {
            client: id,
            transaction: frame.transaction,
            protocol: frame.protocol,
            register: frame.register(),
            wants,
        };
        let answer = match Register::from_number(frame.register()) {
            Some(register) => self.obey(register, frame.params(), receipt).unwrap_or(Answer::Invalid),
            None => self.obey_other(frame.register(), frame.params(), receipt),
        };
        let zeros = READ.iter().find(|(register, _)| *register == frame.register());
        let (more, params) = match answer {
            Answer::Done(params) => (0, params),
            Answer::Invalid => (ReplyState::INVALID, vec![0; zeros.map_or(0, |(_, count)| *count)]),
            Answer::Idle(params) => (ReplyState::NOT_READY, params),
        };
        let head = [frame.register(), self.reply_state().0 | more];
        self.send(id, Frame::new(frame.transaction, frame.protocol, &[&head, &params]));
    }

    /// Registers that our driver does not use.
    fn obey_other(&mut self, register: u8, params: &[u8], receipt: Receipt) -> Answer {
        if let Some(answer) = self.move_by(register, params, receipt) {
            return answer;
        }
        let answer = self
            .calculate(register, params)
            .or_else(|| self.line(register, params))
            .or_else(|| self.setting(register, params));
        if let (62..=64, Some(_)) = (register, &answer) {
            self.feedback(&receipt, 64, self.trajectory_result());
        }
        answer.unwrap_or(Answer::Invalid)
    }

    fn refuse_modbus(&mut self, id: ConnectionId, frame: &Frame) {
        let (unit, function) = (frame.register(), frame.params().first().copied().unwrap_or(0));
        self.send(id, Frame::new(frame.transaction, 0, &[&[unit, function | 0x80, 1]]));
    }

    /// `None` if there are too few parameters.
    fn obey(&mut self, register: Register, params: &[u8], receipt: Receipt) -> Option<Answer> {
        let byte = |at: usize| params.get(at).copied();
        let mut reply = Vec::new();
        match register {
            Register::Version => reply = padded(&format!("7,7,XS1304,AC1302,{}", self.config.firmware)),
            Register::Serial => reply = padded("XS130424A01A08\0AC130224B02B08"),
            Register::MotionEnable => {
                let bits = joint_bits(byte(0)?)?;
                match byte(1)? {
                    0 => self.settings.enabled &= !bits,
                    _ => self.settings.enabled |= bits,
                }
                self.reset();
            }
            Register::SetState => match byte(0)? {
                0 if self.settings.error == 0 => self.condition = Condition::Running,
                0 => {}
                3 if self.condition == Condition::Running => self.condition = Condition::Paused,
                3 => {}
                4 | 6 => self.halt(Condition::Stopped),
                _ => return Some(Answer::Invalid),
            },
            Register::SetMode => {
                let mode = byte(0)?;
                if !matches!(mode, 0..=2 | 4..=7) {
                    return Some(Answer::Invalid);
                }
                self.mode = mode;
                self.reset();
            }
            Register::GetState => reply.push(self.state()),
            Register::QueueLength => reply.extend(self.queue_length()),
            Register::Errors => reply.extend([self.settings.error, self.settings.warning]),
            Register::CleanError => {
                // A pressed button stays pressed.
                if self.settings.error > 3 {
                    self.settings.error = 0;
                }
                if self.settings.error == 0 {
                    self.reset();
                }
            }
            Register::CleanWarning => self.settings.warning = 0,
            Register::MoveJoints => {
                let values: [f32; 9] = floats(params)?;
                let [speed, acceleration] = [values[7], values[8]].map(f64::from);
                let check = byte(40).is_some_and(|check| check != 0);
                return Some(self.plan(joints(params)?, speed, acceleration, check, receipt));
            }
            Register::ServoJoints => return Some(self.servo(joints(params)?)),
            Register::TcpJerk
            | Register::TcpAcceleration
            | Register::JointJerk
            | Register::JointAcceleration => return self.limit(register, params),
            Register::SafetyBox => {
                let sides: &[[u8; 4]; 6] = params.as_chunks().0.try_into().ok()?;
                self.safety_box = SafetyBox::from_wire(sides.map(i32::from_le_bytes));
            }
            Register::SafetyBoxOn => self.has_box = byte(0)? != 0,
            Register::ReducedMode => reply = self.reduced_mode(),
            Register::TcpOffset => {
                self.settings.tcp_offset_mm_rad = floats(params)?;
                self.reset();
            }
            Register::Payload => self.settings.payload_kg_mm = floats(params)?,
            Register::CollisionSensitivity => {
                self.settings.collision_sensitivity = byte(0).filter(|value| *value <= 5)?;
                self.reset();
            }
            Register::TcpPose => push_floats(&mut reply, &self.tool().to_wire()),
            Register::JointPosition => {
                let mut values = [0.0; 3 * ARM_JOINTS];
                let now = self.joints().into_iter().chain(self.motion.speeds());
                values.iter_mut().zip(now).for_each(|(to, from)| *to = from as f32);
                let sets = usize::from(byte(0).unwrap_or(1) & 3).max(1);
                push_floats(&mut reply, &values[..sets * ARM_JOINTS]);
            }
            Register::FeedbackType => {
                let mask = byte(0)?;
                if let Some(connection) = self.connection(receipt.client) {
                    connection.wants = mask;
                }
            }
        }
        // A client that waits for a command without motion is notified immediately.
        if register != Register::FeedbackType && self.queue.is_empty() && !self.motion.planned() {
            self.feedback(&receipt, 4, 0);
        }
        Some(Answer::Done(reply))
    }

    /// A limit of planned moves waits for its turn as they do. `None` beyond the range in the xArm
    /// user manual.
    fn limit(&mut self, register: Register, params: &[u8]) -> Option<Answer> {
        let [value] = floats::<1>(params)?;
        let (limit, most) = match register {
            Register::TcpJerk => (&mut self.settings.tcp_limits_mm[0], 100_000.0),
            Register::TcpAcceleration => (&mut self.settings.tcp_limits_mm[2], 50_000.0),
            Register::JointJerk => (&mut self.settings.joint_limits_rad[0], 28_647_f32.to_radians()),
            _ => (&mut self.settings.joint_limits_rad[2], 1145_f32.to_radians()),
        };
        if !(0.0..=most).contains(&value) {
            return None;
        }
        // As a move: nothing is taken in unless the arm runs in the mode of planned ones.
        if !matches!((self.condition, self.mode), (Condition::Running, 0)) {
            return Some(Answer::Idle(self.queue_length().into()));
        }
        *limit = value;
        Some(Answer::Done(self.queue_length().into()))
    }

    /// Settings of the reduced mode, in the order of the report from its byte 495 on
    /// (ufactory_docs): whether it is on, the box, speeds, ranges of the joints, whether the box is
    /// watched, and rebound.
    pub(super) fn reduced_mode(&self) -> Vec<u8> {
        let extra = &self.extra;
        let mut reply = vec![extra.reduced.into()];
        let side = |mm: i32| mm.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        reply.extend(self.safety_box.to_wire().map(|mm| side(mm).to_be_bytes()).as_flattened());
        push_floats(&mut reply, &[extra.reduced_tcp_mm_s, extra.reduced_joint_rad_s]);
        push_floats(&mut reply, extra.reduced_ranges_rad.as_flattened());
        reply.extend([self.has_box, extra.rebound].map(u8::from));
        reply
    }

    /// What changes the set-up leaves the arm waiting for state 0.
    pub(super) fn reset(&mut self) {
        self.halt(if self.settings.error == 0 { Condition::Reset } else { Condition::Stopped });
    }

    fn queue_length(&self) -> [u8; 2] {
        (self.queue.len() as u16).to_be_bytes()
    }

    pub(super) fn moves_in(&self, mode: u8) -> bool {
        let runs = matches!(self.condition, Condition::Running | Condition::Paused);
        runs && self.mode == mode && self.settings.enabled & ALL == ALL
    }

    /// The answer to a move while the arm does not take it.
    pub(super) fn idle(&self) -> Answer {
        Answer::Idle(self.queue_length().into())
    }

    /// The answer to a move: moves in the queue, and what a check has found.
    pub(super) fn taken(&self, found: u8) -> Answer {
        let [high, low] = self.queue_length();
        Answer::Done(vec![high, low, found])
    }

    /// Highest speed of a joint, rad/s.
    pub(super) fn speed_limit(&self) -> f64 {
        if self.extra.reduced { f64::from(self.extra.reduced_joint_rad_s).max(1e-3) } else { MAX_SPEED }
    }

    /// Whether a joint is beyond its limits or, in reduced mode, the range that was set.
    pub(super) fn outside(&self, joints: &[f64; ARM_JOINTS]) -> bool {
        let out = |(angle, [low, high]): (&f64, &[f32; 2])| {
            !(f64::from(*low) - ROUNDING..=f64::from(*high) + ROUNDING).contains(angle)
        };
        beyond(joints) || self.extra.reduced && joints.iter().zip(&self.extra.reduced_ranges_rad).any(out)
    }

    /// Begins a move at once (modes 6 and 7), or lets it wait for its turn.
    pub(super) fn queue_or_seek(&mut self, planned: Planned, online: bool) {
        if self.queue.len() == MAX_QUEUE {
            self.settings.warning = 11;
        } else if online {
            self.receipt(2, 2);
            self.motion.seek(planned.to, planned.speed, planned.acceleration);
            self.current = Some(planned.receipt);
            self.receipt(1, 0);
        } else {
            self.queue.push_back(planned);
        }
    }

    pub(super) fn servo(&mut self, target: [f64; ARM_JOINTS]) -> Answer {
        if !self.moves_in(1) {
            return Answer::Idle(Vec::new());
        }
        let aim = self.motion.aim();
        let farthest = target.iter().zip(aim).map(|(to, from)| (to - from).abs()).fold(0.0, f64::max);
        if self.outside(&target) {
            self.inject_error(23);
        } else if farthest > MAX_SPEED * FAR_SECS {
            self.inject_error(24);
        } else {
            let delay_ms = (self.config.delay_secs.max(0.0) * 1e3).round() as u64;
            self.motion.follow(self.clock + delay_ms, target);
        }
        Answer::Done(Vec::new())
    }

    /// A move of the joints (rad/s, rad/s²); `check` only tells whether it can be done.
    pub(super) fn plan(
        &mut self,
        to: [f64; ARM_JOINTS],
        speed: f64,
        acceleration: f64,
        check: bool,
        receipt: Receipt,
    ) -> Answer {
        let online = self.moves_in(6);
        if !(online || self.moves_in(0)) {
            return self.idle();
        }
        let positive = |value: f64| value.is_finite() && value > 0.0;
        if !(positive(speed) && positive(acceleration)) {
            self.settings.warning = 12;
            return Answer::Invalid;
        }
        let error = match () {
            () if self.outside(&to) => 23,
            () if speed > MAX_SPEED + ROUNDING => 24,
            () => 0,
        };
        if check {
            return self.taken(error);
        }
        if error != 0 {
            self.inject_error(error);
        } else {
            let speed = speed.min(self.speed_limit());
            let acceleration = acceleration.min(f64::from(self.settings.joint_limits_rad[2]));
            self.queue_or_seek(Planned { to, speed, acceleration, receipt }, online);
        }
        Answer::Done(self.queue_length().into())
    }
}

fn joints(params: &[u8]) -> Option<[f64; ARM_JOINTS]> {
    Some(floats::<ARM_JOINTS>(params)?.map(f64::from))
}

/// Whether a joint is beyond its limits, or not a number.
pub(super) fn beyond(joints: &[f64; ARM_JOINTS]) -> bool {
    let inside = |(angle, (lowest, highest)): (&f64, (f64, f64))| {
        (lowest - ROUNDING..=highest + ROUNDING).contains(angle)
    };
    !joints.iter().zip(WIDEST_LIMITS_RAD).all(inside)
}

/// The bits of one joint, or of all for 8.
fn joint_bits(number: u8) -> Option<u8> {
    match number {
        1..=7 => Some(1 << (number - 1)),
        8 => Some(ALL),
        _ => None,
    }
}

/// A text in the room that it has. It ends with a NUL at the latest there: without one the official
/// SDK fails.
fn padded(text: &str) -> Vec<u8> {
    text.bytes().take(TEXT - 1).chain(std::iter::repeat(0)).take(TEXT).collect()
}
