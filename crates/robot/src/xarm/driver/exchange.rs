//! The arm's requests and replies: when each is sent, what its answer means, and what happens if
//! none comes.

use std::time::Duration;

use super::distance::largest_turn;
use super::fault::ArmFault;
use super::state::{Arm, Outstanding, Phase, Purpose, Target, Work};
use super::steps::{self, ArmVersion, MANUAL, SERVO, Step, text};
use crate::xarm::codec::{
    FEEDBACK, Frame, KEEP_ALIVE_FROM, PROTOCOL_KEEP_ALIVE, PROTOCOL_PRIVATE, Register, ReplyState, STOPPED,
};
use crate::xarm::kinematics::ARM_JOINTS;

/// Time between two stop commands until the reports show that the arm has stopped.
const STOP_AGAIN: Duration = Duration::from_millis(100);
/// Longest that a change of the set-up may take: enabling the motors releases brakes. The official
/// SDK waits as long.
const CHANGE_TIMEOUT: Duration = Duration::from_secs(5);
/// A target this near the one before moves nothing, rad.
const STILL_RAD: f64 = 1e-6;
/// Time between two requests for the state.
const ASK_AGAIN: Duration = Duration::from_millis(20);
/// Offsets of the box and of its switch in the reply of register 53, which has the order of the
/// report from its byte 495 on (ufactory_docs).
const BOX_AT: usize = 1;
const BOX_ON_AT: usize = 77;

impl Arm {
    /// Bytes from the command port.
    pub fn receive_command(&mut self, now: Duration, mut bytes: &[u8]) {
        while let Some(frame) = self.commands.next(&mut bytes) {
            self.take_frame(now, &frame);
        }
        if self.commands.skipped() > 0 && self.active() {
            self.fail(ArmFault::ProtocolNonsense("its replies are not"));
        }
    }

    /// Sends one request.
    pub(super) fn request(
        &mut self,
        now: Duration,
        purpose: Purpose,
        register: Register,
        params: &[u8],
        out: &mut Vec<u8>,
    ) {
        self.transaction = self.transaction % u16::MAX + 1;
        let (transaction, protocol) = (self.transaction, self.protocol.max(PROTOCOL_PRIVATE));
        if let Some(frame) = Frame::new(transaction, protocol, &[&[register as u8], params]) {
            frame.write(out);
            self.outstanding = Some(Outstanding { transaction, protocol, register, purpose, at: now });
        }
    }

    /// Repeats the stop when due, even if a request is outstanding.
    pub(super) fn send_halt(&mut self, now: Duration, out: &mut Vec<u8>) {
        let Some(halt) = &mut self.halt else { return };
        if now < halt.again {
            return;
        }
        halt.since.get_or_insert(now);
        halt.again = now + STOP_AGAIN;
        self.request(now, Purpose::Stop, Register::SetState, &[STOPPED], out);
    }

    /// Fails if a request was not answered in time, or if reports stopped.
    pub(super) fn check_times(&mut self, now: Duration) {
        if let Some(outstanding) = self.outstanding {
            let question = matches!(outstanding.register, Register::GetState | Register::Errors);
            let allowed = if outstanding.purpose == Purpose::Step && !question {
                CHANGE_TIMEOUT
            } else {
                Duration::from_secs_f64(self.config.reply_timeout_secs)
            };
            if now.saturating_sub(outstanding.at) > allowed {
                self.outstanding = None;
                self.fail(ArmFault::ReplyTimeout { register: outstanding.register.name() });
            }
        }
        let watched = match self.phase {
            Phase::Ready | Phase::Manual => true,
            Phase::Working(work) => work.steps != steps::START,
            _ => false,
        };
        if watched && self.stale(now) {
            self.fail(ArmFault::ReportStale);
        }
    }

    fn stale(&self, now: Duration) -> bool {
        let allowed = Duration::from_secs_f64(self.config.report_stale_after_secs);
        self.report.is_none_or(|(_, at)| now.saturating_sub(at) > allowed)
    }

    /// Whether a tick is due.
    pub(super) fn is_due(&self, now: Duration) -> bool {
        // A caller that polls at this very rate is sometimes early by a little.
        self.next_tick.unwrap_or(now).saturating_sub(now) <= self.link.period() / 8
    }

    /// Sends the newest target if it is due and nothing is outstanding.
    pub(super) fn tick(&mut self, now: Duration, out: &mut Vec<u8>) {
        let period = self.link.period();
        // A target that waits for a reply is sent as soon as that has come.
        if !self.is_due(now) || self.outstanding.is_some() {
            return;
        }
        let due = self.next_tick.unwrap_or(now);
        let missed = now.saturating_sub(due) >= period;
        self.next_tick = Some(if missed { now + period } else { due + period });
        let Some(target) = self.target else { return };
        let next = self.within_reach(Target { at: Some(now), ..target });
        // Joints, and three values that servo mode ignores.
        let mut params = [[0; 4]; ARM_JOINTS + 3];
        params.iter_mut().zip(next.joints).for_each(|(word, angle)| *word = float(angle));
        self.request(now, Purpose::Target, Register::ServoJoints, params.as_flattened(), out);
        if self.sent.is_some_and(|sent| largest_turn(&sent.joints, &next.joints).1 <= STILL_RAD) {
            self.link.choose();
        }
        self.sent = Some(next);
    }

    /// Sends the request of the present step.
    pub(super) fn take_step(&mut self, now: Duration, work: Work, out: &mut Vec<u8>) {
        let Some(&step) = work.steps.get(work.at) else { return };
        let config = &self.config;
        let mut params = Vec::new();
        match step {
            Step::Version => self.protocol = PROTOCOL_PRIVATE,
            Step::Mode(mode) => {
                params.push(mode);
                // The check for self-collisions: only newer firmware has this byte.
                if self.version.as_ref().is_some_and(|version| version.firmware >= (1, 10, 0)) {
                    params.push(0);
                }
            }
            Step::Tell(Register::MotionEnable) => params.extend([8, 1]),
            Step::Tell(Register::SetState) => params.push(0),
            Step::Tell(Register::Payload) => {
                let [x, y, z] = config.payload_centre_mm;
                let values = [config.payload_kg, x, y, z].map(|value| (value as f32).to_le_bytes());
                params.extend(values.as_flattened());
            }
            Step::Tell(Register::CollisionSensitivity) => params.push(config.collision_sensitivity),
            // On the wire in mm.
            Step::Tell(Register::TcpJerk) => params.extend(float(config.tcp_jerk_m_s3 * 1e3)),
            Step::Tell(Register::TcpAcceleration) => params.extend(float(config.tcp_acceleration_m_s2 * 1e3)),
            Step::Tell(Register::JointJerk) => params.extend(float(config.joint_jerk_rad_s3)),
            Step::Tell(Register::JointAcceleration) => params.extend(float(config.joint_acceleration_rad_s2)),
            Step::Tell(Register::SafetyBox) => {
                let Some(safety_box) = config.box_mm else { return };
                // The controller would stop the arm as soon as it runs.
                if let Err(outside) = self.pose().map_or(Ok(()), |pose| safety_box.holds(&pose.position_m)) {
                    return self.fail(ArmFault::OutsideBox(outside));
                }
                params.extend(safety_box.to_wire().map(i32::to_le_bytes).as_flattened());
            }
            Step::Tell(Register::SafetyBoxOn) => params.push(1),
            Step::Tell(Register::TcpOffset) => params.extend([0.0_f32.to_le_bytes(); 6].as_flattened()),
            Step::Tell(_)
            | Step::Serial
            | Step::ReadBox
            | Step::NoError
            | Step::Unstopped
            | Step::Await(_) => {}
        }
        self.request(now, Purpose::Step, step.register(), &params, out);
    }

    fn take_frame(&mut self, now: Duration, frame: &Frame) {
        // A reply to no request, or to one that had timed out, is ignored.
        let answers = |asked: &Outstanding| asked.transaction == frame.transaction;
        let Some(asked) = self.outstanding.filter(answers).filter(|_| frame.register() != FEEDBACK) else {
            return;
        };
        self.outstanding = None;
        if matches!(asked.purpose, Purpose::Target | Purpose::Link) {
            self.link.take(now.saturating_sub(asked.at));
        }
        if asked.purpose == Purpose::Link {
            self.link.choose();
        }
        let Some((state, params)) = frame.reply() else {
            return self.fail(ArmFault::ProtocolNonsense("a reply is too short"));
        };
        if frame.protocol != asked.protocol || frame.register() != asked.register as u8 {
            return self.fail(ArmFault::ProtocolNonsense("a reply is to something else"));
        }
        let moves = asked.purpose == Purpose::Target;
        let ignored = is_queued(asked.register) && state.has(ReplyState::NOT_READY);
        if self.active() && (ignored || state.has(ReplyState::INVALID)) {
            self.fail(ArmFault::CommandRejected { register: asked.register.name() });
        } else if moves && state.has(ReplyState::ERROR) {
            self.fail(ArmFault::Controller { code: None });
        } else if moves && state.has(ReplyState::NOT_READY) {
            self.fail(ArmFault::NotReady);
        } else if asked.purpose == Purpose::WhichError {
            self.set_error_code(params);
        } else if let (Purpose::Step, Phase::Working(work)) = (asked.purpose, self.phase) {
            self.finish_step(now, work, params);
        }
    }

    /// The number of the error behind a fault, unless the fault has a reason of its own.
    fn set_error_code(&mut self, params: &[u8]) {
        let Phase::Fault(fault, true) = &mut self.phase else { return };
        let unexplained = matches!(
            fault,
            ArmFault::Controller { code: None }
                | ArmFault::UnexpectedState { .. }
                | ArmFault::NotReady
                | ArmFault::NotFollowing { .. }
                | ArmFault::CommandRejected { .. }
        );
        if let (true, Some(&code @ 1..)) = (unexplained, params.first()) {
            *fault = ArmFault::Controller { code: Some(code) };
        }
    }

    fn finish_step(&mut self, now: Duration, mut work: Work, params: &[u8]) {
        let Some(&step) = work.steps.get(work.at) else { return };
        let first = params.first().copied();
        let done = match (step, first) {
            (Step::Version, _) => match ArmVersion::read(params) {
                None => return self.fail(ArmFault::ProtocolNonsense("its version cannot be read")),
                Some(version) if usize::from(version.axes) != ARM_JOINTS => {
                    return self.fail(ArmFault::ProtocolNonsense("it has another number of joints"));
                }
                Some(version) => {
                    if version.firmware >= KEEP_ALIVE_FROM {
                        self.protocol = PROTOCOL_KEEP_ALIVE;
                    }
                    self.version = Some(version);
                    true
                }
            },
            (Step::Serial, _) => {
                self.serial = Some(text(params));
                true
            }
            (Step::NoError | Step::Unstopped | Step::Await(_), None) => {
                return self.fail(ArmFault::ProtocolNonsense("a reply is too short"));
            }
            (Step::ReadBox, _) if !self.has_box(params) => {
                return self.fail(ArmFault::CommandRejected { register: Register::SafetyBox.name() });
            }
            (Step::ReadBox, _) => true,
            (Step::NoError, Some(0)) => true,
            (Step::NoError, code) => return self.fail(ArmFault::Controller { code }),
            (Step::Unstopped | Step::Await(_), Some(state)) if work.forbids(state) => {
                return self.fail(ArmFault::UnexpectedState { state, mode: self.mode() });
            }
            (Step::Unstopped, _) => true,
            (Step::Await(mode), Some(state)) => match self.awaited(now, &work, mode, state) {
                Ok(done) => done,
                Err(fault) => return self.fail(fault),
            },
            (Step::Tell(_) | Step::Mode(_), _) => true,
        };
        work.ask_at = if done { now } else { now + ASK_AGAIN };
        if done {
            (work.at, work.since) = (work.at + 1, now);
            let has_box = self.config.box_mm.is_some();
            while !has_box && work.steps.get(work.at).is_some_and(|step| step.is_of_the_box()) {
                work.at += 1;
            }
        }
        self.phase = Phase::Working(work);
        if work.at == work.steps.len() {
            self.finish(step);
        }
    }

    /// Whether the settings of the reduced mode (register 53) have our box, switched on.
    fn has_box(&self, params: &[u8]) -> bool {
        let sides = params.get(BOX_AT..BOX_AT + 12).map(|bytes| bytes.as_chunks::<2>().0);
        let sides = sides.unwrap_or_default().iter().map(|side| i32::from(i16::from_be_bytes(*side)));
        let watched = params.get(BOX_ON_AT).is_some_and(|on| *on == 1);
        watched && self.config.box_mm.is_some_and(|safety_box| sides.eq(safety_box.to_wire()))
    }

    /// Whether the arm is ready in this mode: its reply and a report from after the change both
    /// confirm it.
    fn awaited(&self, now: Duration, work: &Work, mode: u8, state: u8) -> Result<bool, ArmFault> {
        let fresh = self.report.filter(|(_, at)| *at > work.since);
        let ready = fresh.is_some_and(|(report, _)| report.mode == mode && (1..=2).contains(&report.state));
        if ready && (1..=2).contains(&state) {
            return Ok(true);
        }
        if now.saturating_sub(work.since).as_secs_f64() <= self.config.start_timeout_secs {
            return Ok(false);
        }
        Err(match fresh {
            Some((report, _)) => ArmFault::UnexpectedState { state, mode: report.mode },
            None => ArmFault::ReportStale,
        })
    }

    /// The last step of a list is done.
    fn finish(&mut self, last: Step) {
        match last {
            Step::Await(MANUAL) => self.phase = Phase::Manual,
            Step::Await(SERVO) => {
                self.phase = Phase::Ready;
                self.sent = self.joints().map(|joints| Target { joints, at: None });
                self.next_tick = None;
            }
            _ => {}
        }
    }
}

fn float(value: f64) -> [u8; 4] {
    (value as f32).to_le_bytes()
}

/// Whether a setting waits in the queue of planned moves: one that does not run takes nothing in.
fn is_queued(register: Register) -> bool {
    use Register::{JointAcceleration, JointJerk, TcpAcceleration, TcpJerk};
    matches!(register, TcpJerk | TcpAcceleration | JointJerk | JointAcceleration)
}
