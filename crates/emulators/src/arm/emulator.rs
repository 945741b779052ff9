//! The emulated arm: its clock, its moves, its clients and its state.

use std::collections::VecDeque;
use std::time::Duration;

use etude_checks::settings;
use serde::{Deserialize, Serialize};

use etude_robot::xarm::SafetyBox;
use etude_robot::xarm::codec::{FEEDBACK, Frame, FrameParser, ReplyState};
use etude_robot::xarm::kinematics::{self, ARM_JOINTS, PAPER_HOME_DEG, Pose};

use super::lines::Lines;
use super::motion::JointMotion;
use super::settings::{Extra, Settings};
use super::state::{Condition, Connection, ConnectionId, Planned, Receipt, ReportKind, Steering};

/// Replies that wait to be taken at most, in bytes.
const MAX_WAITING: usize = 1 << 14;
/// After a longer pause at rest only the last part of it is reported, ms.
const MAX_RESTING_MS: u64 = 1000;
/// Longest leap of the clock while the arm moves, ms.
const MAX_MOVING_MS: u64 = 600_000;
/// Tool speed at which the controller stops the arm in servo mode, m/s (xArm user manual).
const MAX_TOOL_SPEED: f64 = 1.2;
/// Motors, all of them.
pub(super) const ALL: u8 = 0x7F;

settings! {
    /// What the emulated arm is like. Delay and bandwidth are guesses: no figure is published.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct ArmEmulatorConfig {
        /// Version of its firmware, as `v2.4.0`.
        pub firmware: String = "v2.4.0".into();
        /// Time from a servo target's arrival until it takes effect, s.
        pub delay_secs: f64 = 0.02;
        /// How fast the joints close in on a servo target, Hz.
        pub bandwidth_hz: f64 = 8.0;
        /// With it the joints follow servo targets as a mass on a spring, whose own frequency is
        /// the bandwidth, with this damping ratio: below 1 they overshoot. Without it the speed is
        /// proportional to the distance.
        pub damping_ratio: Option<f64> = None;
    }
}

/// The emulator.
#[derive(Debug)]
pub struct ArmEmulator {
    pub(super) config: ArmEmulatorConfig,
    /// Milliseconds that have passed.
    pub(super) clock: u64,
    pub(super) motion: JointMotion,
    pub(super) tool_at: Option<nalgebra::Vector3<f64>>,
    pub(super) queue: VecDeque<Planned>,
    pub(super) current: Option<Receipt>,
    pub(super) condition: Condition,
    pub(super) mode: u8,
    pub(super) settings: Settings,
    pub(super) extra: Extra,
    pub(super) lines: Lines,
    /// Velocities of modes 4 and 5.
    pub(super) steering: Option<Steering>,
    /// The safety boundary, and whether it is watched.
    pub(super) safety_box: SafetyBox,
    pub(super) has_box: bool,
    pub(super) connections: Vec<Connection>,
    pub(super) next_id: u64,
    pub(super) waiting: [Vec<u8>; 4],
    pub(super) silent: bool,
    pub(super) mute: bool,
}

impl ArmEmulator {
    /// An arm that has just been switched on: planned mode, motors off, stopped; the limits of its
    /// moves are those of the xArm user manual, and no box is switched on.
    pub fn new(config: ArmEmulatorConfig) -> Self {
        Self {
            clock: 0,
            motion: JointMotion::new(
                PAPER_HOME_DEG.map(f64::to_radians),
                config.bandwidth_hz,
                config.damping_ratio,
            ),
            tool_at: None,
            queue: VecDeque::new(),
            current: None,
            condition: Condition::Stopped,
            mode: 0,
            settings: Settings::default(),
            extra: Extra::default(),
            lines: Lines::default(),
            steering: None,
            safety_box: SafetyBox::WIDEST,
            has_box: false,
            connections: Vec::new(),
            next_id: 0,
            waiting: [const { Vec::new() }; 4],
            silent: false,
            mute: false,
            config,
        }
    }

    /// A new client of the command port.
    pub fn connect(&mut self) -> ConnectionId {
        let id = ConnectionId(self.next_id);
        self.next_id += 1;
        self.connections.push(Connection { id, parser: FrameParser::default(), out: Vec::new(), wants: 0 });
        id
    }

    /// Removes a client that is gone. The arm keeps its motion: servo mode has no timeout (xArm
    /// user manual).
    pub fn disconnect(&mut self, id: ConnectionId) {
        self.connections.retain(|connection| connection.id != id);
    }

    /// Bytes from a client.
    pub fn receive(&mut self, now: Duration, id: ConnectionId, mut bytes: &[u8]) {
        self.advance(now);
        loop {
            let Some(connection) = self.connection(id) else { return };
            let Some(frame) = connection.parser.next(&mut bytes) else { return };
            self.answer(id, &frame);
        }
    }

    /// Moves what a client is to be sent to the end of `out`.
    pub fn take(&mut self, id: ConnectionId, out: &mut Vec<u8>) {
        if let Some(connection) = self.connection(id) {
            out.append(&mut connection.out);
        }
    }

    /// Moves the reports that have become due since the last call to the end of `out`.
    pub fn take_reports(&mut self, kind: ReportKind, out: &mut Vec<u8>) {
        if let Some(waiting) = self.waiting.get_mut(kind as usize) {
            out.append(waiting);
        }
    }

    /// Lets time pass until `now`.
    pub fn advance(&mut self, now: Duration) {
        let until = u64::try_from(now.as_millis()).unwrap_or(u64::MAX);
        let rests = !self.motion.moving() && self.queue.is_empty() && self.steering.is_none();
        let longest = if rests { MAX_RESTING_MS } else { MAX_MOVING_MS };
        self.clock = self.clock.max(until.saturating_sub(longest));
        while self.clock < until {
            self.clock += 1;
            self.step();
            for kind in ReportKind::ALL {
                let (.., period_ms) = kind.numbers();
                if self.clock.is_multiple_of(period_ms) {
                    self.push_report(kind);
                }
            }
        }
    }

    /// Where the joints are, rad.
    pub fn joints(&self) -> [f64; ARM_JOINTS] {
        self.motion.joints
    }

    /// Guides the joints to another place by hand, rad.
    pub fn place(&mut self, joints_rad: [f64; ARM_JOINTS]) {
        self.motion.place(joints_rad);
        self.tool_at = None;
    }

    /// State as the controller reports it (ufactory_docs).
    pub fn state(&self) -> u8 {
        match self.condition {
            Condition::Running if self.motion.moving() => 1,
            Condition::Running => 2,
            Condition::Paused => 3,
            Condition::Stopped => 4,
            Condition::Reset => 5,
        }
    }

    /// Mode as the controller reports it.
    pub fn mode(&self) -> u8 {
        self.mode
    }

    /// Error of the controller, 0 for none.
    pub fn error(&self) -> u8 {
        self.settings.error
    }

    /// Raises an error. The emergency buttons (1 to 3) stay pressed until error 0 releases them;
    /// others go when cleaned.
    pub fn inject_error(&mut self, code: u8) {
        self.settings.error = code;
        if code != 0 {
            self.halt(Condition::Stopped);
        }
    }

    /// Blocks the joints, or releases them.
    pub fn set_stuck(&mut self, stuck: bool) {
        self.motion.stuck = stuck;
    }

    /// Makes it execute commands without a reply, or ends that.
    pub fn set_silent(&mut self, silent: bool) {
        self.silent = silent;
    }

    /// Stops its reports, or ends that.
    pub fn set_mute(&mut self, mute: bool) {
        self.mute = mute;
    }

    pub(super) fn connection(&mut self, id: ConnectionId) -> Option<&mut Connection> {
        self.connections.iter_mut().find(|connection| connection.id == id)
    }

    /// One millisecond.
    pub(super) fn step(&mut self) {
        self.steer_on();
        let was_planned = self.motion.planned();
        self.motion.step(self.clock, self.condition == Condition::Paused);
        if was_planned && !self.motion.planned() {
            self.receipt(2, 0);
        }
        let free = !self.motion.planned() && self.condition == Condition::Running;
        if let (true, Some(next)) = (free, self.queue.front().copied()) {
            self.queue.pop_front();
            self.motion.plan(next.to, next.speed, next.acceleration);
            self.current = Some(next.receipt);
            self.receipt(1, 0);
        }
        // No error while it is stopped, or it could never be guided inside again.
        if self.has_box
            && self.condition == Condition::Running
            && !self.safety_box.contains(&self.tool().position_m)
        {
            self.inject_error(35);
        }
        if self.mode != 1 || !self.motion.moving() {
            self.tool_at = None;
            return;
        }
        let tool = kinematics::forward(&self.motion.joints).position_m;
        let before = self.tool_at.replace(tool);
        if before.is_some_and(|before| (tool - before).norm() > MAX_TOOL_SPEED * 1e-3)
            && self.condition == Condition::Running
        {
            self.inject_error(60);
        }
    }

    /// Stops the arm and drops everything.
    pub(super) fn halt(&mut self, condition: Condition) {
        self.condition = condition;
        self.steering = None;
        self.motion.brake();
        self.receipt(2, 2);
        while let Some(dropped) = self.queue.pop_front() {
            self.current = Some(dropped.receipt);
            self.receipt(2, 2);
        }
    }

    /// Notifies the client of the current move that it began (1) or ended (2), if the client wants
    /// that.
    pub(super) fn receipt(&mut self, kind: u8, result: u8) {
        let Some(receipt) = self.current else { return };
        if kind == 2 {
            self.current = None;
        }
        self.feedback(&receipt, kind, result);
    }

    pub(super) fn feedback(&mut self, receipt: &Receipt, kind: u8, result: u8) {
        if receipt.wants & kind == 0 {
            return;
        }
        // Kind, register, number of the task and result, then the time at the controller in
        // microseconds.
        let head = [FEEDBACK, self.reply_state().0, kind, receipt.register, 0, 0, result];
        let at_us = (self.clock * 1000).to_be_bytes();
        self.send(receipt.client, Frame::new(receipt.transaction, receipt.protocol, &[&head, &at_us]));
    }

    pub(super) fn send(&mut self, id: ConnectionId, frame: Option<Frame>) {
        let Some(frame) = frame.filter(|_| !self.silent) else { return };
        if let Some(connection) = self.connection(id).filter(|connection| connection.out.len() < MAX_WAITING)
        {
            frame.write(&mut connection.out);
        }
    }

    pub(super) fn reply_state(&self) -> ReplyState {
        let mut bits = 0;
        if !matches!(self.condition, Condition::Running | Condition::Paused) {
            bits |= ReplyState::NOT_READY;
        }
        if self.settings.warning != 0 {
            bits |= ReplyState::WARNING;
        }
        if self.settings.error != 0 {
            bits |= ReplyState::ERROR;
        }
        ReplyState(bits)
    }

    /// Where the tool is.
    pub(super) fn tool(&self) -> Pose {
        self.tool_with(self.motion.joints)
    }
}
