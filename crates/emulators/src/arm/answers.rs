//! The effect of each register of the emulated controller, and its reply (ufactory_docs, registers).

use super::motion::MAX_SPEED;
use super::{ALL, ArmEmulator, Condition, ConnectionId, Planned, Receipt};
use etude_robot::xarm::Fence;
use etude_robot::xarm::codec::{
    Frame, PROTOCOL_KEEP_ALIVE, PROTOCOL_PRIVATE, Register, ReplyState, floats, push_floats,
};
use etude_robot::xarm::kinematics::{JOINTS, WIDEST_LIMITS_RAD};

/// Rounding of a limit to a 32-bit float.
const ROUNDING: f64 = 1e-6;
/// A servo target for which a joint needs longer than this at full speed is an error, s. The manual forbids far
/// targets without saying what happens: this is our guess.
const FAR_SECS: f64 = 0.1;
/// Moves in the queue at most.
const MAX_QUEUE: usize = 256;
/// Room that the version and the serial numbers take.
const TEXT: usize = 40;

/// The outcome of a request.
enum Answer {
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
            None => Answer::Invalid,
        };
        let (more, params) = match answer {
            Answer::Done(params) => (0, params),
            Answer::Invalid => (ReplyState::INVALID, Vec::new()),
            Answer::Idle(params) => (ReplyState::NOT_READY, params),
        };
        let head = [frame.register(), self.reply_state().0 | more];
        self.send(id, Frame::new(frame.transaction, frame.protocol, &[&head, &params]));
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
                if mode > 2 {
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
                return Some(self.plan(joints(params)?, speed, acceleration, receipt));
            }
            Register::ServoJoints => return Some(self.servo(joints(params)?)),
            Register::TcpJerk
            | Register::TcpAcceleration
            | Register::JointJerk
            | Register::JointAcceleration => return self.limit(register, params),
            Register::SafetyBox => {
                let sides: &[[u8; 4]; 6] = params.as_chunks().0.try_into().ok()?;
                self.fence = Fence::from_wire(sides.map(i32::from_le_bytes));
            }
            Register::SafetyBoxOn => self.fenced = byte(0)? != 0,
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
                let mut values = [0.0; 3 * JOINTS];
                values.iter_mut().zip(self.joints()).for_each(|(to, from)| *to = from as f32);
                let sets = usize::from(byte(0).unwrap_or(1) & 3).max(1);
                push_floats(&mut reply, &values[..sets * JOINTS]);
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

    /// A limit of planned moves waits for its turn as they do. `None` beyond the range in the xArm user manual.
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

    /// Settings of the reduced mode, in the order of the report from its byte 495 on (ufactory_docs): off, the
    /// box, speeds, ranges of the joints, whether the box is watched, no rebound.
    fn reduced_mode(&self) -> Vec<u8> {
        let mut reply = vec![0];
        let side = |mm: i32| mm.clamp(i16::MIN.into(), i16::MAX.into()) as i16;
        reply.extend(self.fence.to_wire().map(|mm| side(mm).to_be_bytes()).as_flattened());
        push_floats(&mut reply, &[1000.0, MAX_SPEED as f32]);
        push_floats(
            &mut reply,
            WIDEST_LIMITS_RAD.map(|(low, high)| [low as f32, high as f32]).as_flattened(),
        );
        reply.extend([self.fenced.into(), 0]);
        reply
    }

    /// What changes the set-up leaves the arm waiting for state 0.
    fn reset(&mut self) {
        self.halt(if self.settings.error == 0 { Condition::Reset } else { Condition::Stopped });
    }

    fn queue_length(&self) -> [u8; 2] {
        (self.queue.len() as u16).to_be_bytes()
    }

    fn moves_in(&self, mode: u8) -> bool {
        let runs = matches!(self.condition, Condition::Running | Condition::Paused);
        runs && self.mode == mode && self.settings.enabled & ALL == ALL
    }

    fn servo(&mut self, target: [f64; JOINTS]) -> Answer {
        if !self.moves_in(1) {
            return Answer::Idle(Vec::new());
        }
        let aim = self.motion.aim();
        let farthest = target.iter().zip(aim).map(|(to, from)| (to - from).abs()).fold(0.0, f64::max);
        if beyond(&target) {
            self.inject_error(23);
        } else if farthest > MAX_SPEED * FAR_SECS {
            self.inject_error(24);
        } else {
            let delay_ms = (self.config.delay_secs.max(0.0) * 1e3).round() as u64;
            self.motion.follow(self.clock + delay_ms, target);
        }
        Answer::Done(Vec::new())
    }

    fn plan(&mut self, to: [f64; JOINTS], speed: f64, acceleration: f64, receipt: Receipt) -> Answer {
        if !self.moves_in(0) {
            return Answer::Idle(self.queue_length().into());
        }
        let positive = |value: f64| value.is_finite() && value > 0.0;
        if !(positive(speed) && positive(acceleration)) {
            self.settings.warning = 12;
            return Answer::Invalid;
        }
        if beyond(&to) {
            self.inject_error(23);
        } else if speed > MAX_SPEED + ROUNDING {
            self.inject_error(24);
        } else if self.queue.len() == MAX_QUEUE {
            self.settings.warning = 11;
        } else {
            let most = f64::from(self.settings.joint_limits_rad[2]);
            let acceleration = acceleration.min(most);
            self.queue.push_back(Planned { to, speed, acceleration, receipt });
        }
        Answer::Done(self.queue_length().into())
    }
}

fn joints(params: &[u8]) -> Option<[f64; JOINTS]> {
    Some(floats::<JOINTS>(params)?.map(f64::from))
}

/// Whether a joint is beyond its limits, or not a number.
fn beyond(joints: &[f64; JOINTS]) -> bool {
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

/// A text in the room that it has. It ends with a NUL at the latest there: without one the official SDK
/// fails.
fn padded(text: &str) -> Vec<u8> {
    text.bytes().take(TEXT - 1).chain(std::iter::repeat(0)).take(TEXT).collect()
}
