//! The controller of a whole robot: hand, arm and keyboard, their limits, and what happens when one of them fails.
//!
//! [`Robot`] is polled with the time and its [`Wires`]; in between, whoever plays asks it to [`follow`](Robot::follow) a
//! stream. Set-points go through the limiter on a grid of [`SETPOINT_HZ`]; from there the rail becomes joint angles of
//! the arm, and the fingers become torques at the hand's own clock. There is no other way to either wire.
//!
//! ```text
//! off ─start─► starting ─► holding ◄──────► following
//!                            │ ▲ └─home, approach─► moving ─┐
//!                            │ └────────────────────────────┘
//!  any of them ──────stop────┴─► stopped      any of them ──fault──► fault (latched until start)
//! ```
//!
//! A fault of any device lets go of the hand and stops the arm in the same poll.

mod fault;
mod motion;
mod record;

use std::time::Duration;

pub use fault::{Fault, Refused, RobotError};
pub use record::Record;

use crate::allegro::{self, Hand, HandEvent, HandState, JointLoop};
use crate::calibration::{RailPath, RailPlace};
use crate::can::CanFrame;
use crate::joints::{DRIVEN, FINGER_JOINTS, RAIL, from_wire, to_wire};
use crate::keyboard::{KeyChange, Keyboard, KeyboardState};
use crate::limiter::{Axis, Clamp};
use crate::rig::{RigConfig, RigError, SETPOINT_HZ};
use crate::wires::Wires;
use crate::xarm::kinematics::{self, PAPER_HOME_DEG};
use crate::xarm::{Arm, ArmState};
use motion::{AXES, SlowMove, Stretch};
use record::Journal;

/// Farthest from its path along the keyboard at which the arm may begin to follow it, m.
const ON_PATH_M: f64 = 0.005;
/// The same for its orientation, rad.
const ON_PATH_RAD: f64 = 0.03;
/// How far above the keyboard the arm comes and goes, m.
const CLEAR_M: f64 = 0.08;
/// Speed of the arm's own planned moves, rad/s: a tenth of what it may do.
const HOMING_SPEED: f64 = 0.3;
/// Longest time between two polls while torques are on. The hand holds the last torque meanwhile.
const LONGEST_GAP: Duration = Duration::from_millis(100);
/// Time between two times that a stopped hand is let go: a frame may be lost, and a bus that failed come back.
const LET_GO_AGAIN: Duration = Duration::from_millis(100);
/// Fingers straight ahead, clear of the keys.
const CLEAR_FINGERS: [f64; FINGER_JOINTS] = [0.0; FINGER_JOINTS];

/// What the robot is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Nothing was asked of it yet.
    Off,
    /// The devices come up.
    Starting,
    /// It stands and holds.
    Holding,
    /// It moves slowly to a pose.
    Moving,
    /// It follows a stream.
    Following,
    /// It was stopped on request.
    Stopped,
    /// It was stopped by a fault.
    Fault,
}

impl Phase {
    /// Its name in messages and recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Starting => "starting",
            Self::Holding => "holding",
            Self::Moving => "moving",
            Self::Following => "following",
            Self::Stopped => "stopped",
            Self::Fault => "stopped by a fault",
        }
    }
}

/// The stations of the arm's way from anywhere to the middle of the keyboard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Station {
    /// The paper's home, high above.
    Home,
    /// Above the middle.
    Above,
    /// The middle.
    Middle,
}

/// What a slow move still has to do.
#[derive(Clone, Debug)]
struct Plan {
    /// The move that is under way.
    slow: SlowMove,
    /// Where the arm goes next by moves of its own, and whether it was told.
    station: Option<(Station, bool)>,
    /// The pose of the driven joints at the end.
    goal: [f64; DRIVEN],
}

/// The controller of a robot.
pub struct Robot {
    config: RigConfig,
    path: RailPath,
    hand: Hand,
    joint_loop: JointLoop,
    arm: Arm,
    keyboard: Keyboard,
    axes: [Axis; AXES],
    phase: Phase,
    fault: Option<Fault>,
    plan: Option<Plan>,
    stream: Option<Stretch>,
    /// Set-points before the last step, for the joint loop in between.
    before: [f64; AXES],
    stepped: Duration,
    polled: Option<Duration>,
    /// When the hand was let go last.
    let_go_at: Duration,
    /// Joints that the arm was last asked for; `None` while the arm is not on its path.
    arm_sent: Option<[f64; kinematics::JOINTS]>,
    arm_seen: Option<Duration>,
    /// Whether the drivers know of their connections, and whether the arm was told to start.
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
    /// If the configuration is not sound.
    pub fn new(config: &RigConfig, path: RailPath) -> Result<Self, RobotError> {
        config.check()?;
        let limits = config.axes();
        Ok(Self {
            path,
            hand: Hand::new(&config.hand).map_err(RigError::from)?,
            joint_loop: JointLoop::new(&config.joint_loop).map_err(RigError::from)?,
            arm: Arm::new(config.arm.clone()).map_err(RigError::from)?,
            keyboard: Keyboard::new(&config.keyboard).map_err(RigError::from)?,
            axes: std::array::from_fn(|axis| Axis::at_rest(limits[axis], 1.0 / SETPOINT_HZ, 0.0)),
            config: config.clone(),
            phase: Phase::Off,
            fault: None,
            plan: None,
            stream: None,
            before: [0.0; AXES],
            stepped: Duration::ZERO,
            polled: None,
            let_go_at: Duration::ZERO,
            arm_sent: None,
            arm_seen: None,
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

    /// Begins to bring the devices up; also the operator's way out of a fault.
    pub fn start(&mut self, now: Duration) {
        self.fault = None;
        self.plan = None;
        self.stream = None;
        self.arm_sent = None;
        self.joint_loop.reset();
        self.keyboard.acknowledge();
        self.hand.start(now);
        self.enter(now, Phase::Starting);
        self.arm_told = false;
    }

    /// Lets go of the hand and stops the arm, at once and in any state.
    pub fn stop(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.let_go(now, wires);
        if self.phase != Phase::Fault {
            self.enter(now, Phase::Stopped);
        }
    }

    /// Brings the robot slowly to a pose, from wherever it is: fingers straight, the arm over its home and from above
    /// to the middle of the keyboard unless it is at the keyboard already, then fingers and rail to `goal`, or the
    /// nearest that their ranges allow.
    ///
    /// # Errors
    /// If the robot does not hold still, or the goal holds what is no number.
    pub fn home(&mut self, now: Duration, goal: &[f64; DRIVEN]) -> Result<(), Refused> {
        let station = if self.arm_sent.is_some() { None } else { Some((Station::Home, false)) };
        self.slow_move(now, station, goal)
    }

    /// Brings fingers and rail slowly to a pose, or the nearest that their ranges allow.
    ///
    /// # Errors
    /// If the robot does not hold still at the keyboard, or the goal holds what is no number.
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
        station: Option<(Station, bool)>,
        goal: &[f64; DRIVEN],
    ) -> Result<(), Refused> {
        self.wants(Phase::Holding)?;
        if let Some(joint) = goal.iter().position(|value| !value.is_finite()) {
            return Err(Refused::NoPose { joint });
        }
        let axes = all_axes(goal, &self.config.limits.thumb_rad);
        let inside = std::array::from_fn(|axis| {
            let [low, high] = self.axes[axis].limits().position;
            axes[axis].clamp(low, high)
        });
        let goal = driven(&inside);
        let mut first = goal;
        if station.is_some() {
            first[..FINGER_JOINTS].copy_from_slice(&CLEAR_FINGERS);
        }
        let slow = self.slowly(now, &first);
        self.plan = Some(Plan { slow, station, goal });
        self.enter(now, Phase::Moving);
        Ok(())
    }

    fn slowly(&self, now: Duration, goal: &[f64; DRIVEN]) -> SlowMove {
        SlowMove::new(now, self.setpoints(), all_axes(goal, &self.config.limits.thumb_rad))
    }

    /// Follows a stretch of a stream from `begun` on: one waypoint (rad, the rail in m) a set-point. It replaces what is
    /// left of the stretch before, and the last waypoint stands when they have run out.
    ///
    /// # Errors
    /// If the robot is neither holding nor following, or is not near the first waypoint when it begins, or its
    /// keyboard has a warning that nobody has acknowledged by a start.
    pub fn follow(&mut self, begun: Duration, waypoints: &[[f64; DRIVEN]]) -> Result<(), Refused> {
        // One that began far ahead would keep the watch on the age of commands quiet.
        let ahead = Duration::from_secs_f64(self.config.limits.stale_command_secs);
        let begun = self.polled.map_or(begun, |polled| begun.min(polled.saturating_add(ahead)));
        if self.phase != Phase::Following {
            self.wants(Phase::Holding)?;
            let Some(first) = waypoints.first() else { return Ok(()) };
            self.near(first)?;
            if let Some(warning) = self.keyboard.warnings().next() {
                return Err(Refused::Keyboard(warning.to_string()));
            }
            // The grid of the set-points begins with the stream.
            self.stepped = self.stepped.max(begun);
            self.enter(begun, Phase::Following);
        }
        let mut kept = self.stream.take().map(|stretch| stretch.waypoints).unwrap_or_default();
        kept.clear();
        kept.extend_from_slice(waypoints);
        self.stream = Some(Stretch { begun, waypoints: kept });
        Ok(())
    }

    /// Ends a stream or a slow move: brakes and holds. A move that the arm makes by itself goes on to its end: only
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
        let measured = self.joints();
        for joint in 0..FINGER_JOINTS {
            let far = (measured[joint] - pose[joint]).abs();
            if far.is_nan() || far > limits.start_finger_rad {
                let (measured_rad, asked_rad) = (measured[joint], pose[joint]);
                return Err(Refused::FingerFar { joint, measured_rad, asked_rad });
            }
        }
        let by_m = (measured[RAIL] - pose[RAIL]).abs();
        if by_m.is_nan() || by_m > limits.start_rail_m || self.arm_sent.is_none() {
            return Err(Refused::RailFar { by_m: by_m.max(self.place().beside_m) });
        }
        Ok(())
    }

    /// Takes in what has come, computes what is due, and sends it. To be called at least every few milliseconds.
    pub fn poll(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.take_in_midi(now, wires);
        if let Err(fault) = self.take_in(now, wires) {
            self.fail_if_used(now, fault, wires);
        }
        let gap = now.saturating_sub(self.polled.unwrap_or(now));
        self.polled = Some(now);
        let fault = self.watch(now, gap);
        let fault = fault.or_else(|| self.advance(now).err());
        if let Some(fault) = fault {
            self.fail(now, fault, wires);
        }
        self.explain(now);
        self.frames.clear();
        self.bytes.clear();
        let mut frames = std::mem::take(&mut self.frames);
        if self.hand.poll(now, &mut frames) == HandEvent::Positions {
            self.drive(now, &mut frames);
        }
        if self.is_let_go() && now.saturating_sub(self.let_go_at) >= LET_GO_AGAIN {
            self.let_go_at = now;
            self.hand.stop(now, &mut frames);
        }
        self.frames = frames;
        self.arm.poll(now, &mut self.bytes);
        if let Err(fault) = self.send(wires) {
            self.fail_if_used(now, fault, wires);
        }
    }

    fn take_in(&mut self, now: Duration, wires: &mut dyn Wires) -> Result<(), Fault> {
        let arm = self.take_in_arm(now, wires);
        while let Some(frame) = wires.next_frame()? {
            if self.hand.receive(now, &frame) == HandEvent::Positions {
                let mut frames = std::mem::take(&mut self.frames);
                frames.clear();
                self.drive(now, &mut frames);
                let sent = frames.iter().try_for_each(|frame| wires.send_frame(*frame));
                self.frames = frames;
                sent?;
            }
        }
        arm
    }

    fn take_in_midi(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.bytes.clear();
        self.changes.clear();
        let connected = wires.receive_midi(&mut self.bytes).is_ok();
        if connected != self.keyboard_connected {
            self.keyboard_connected = connected;
            if connected {
                self.keyboard.connected(now, &mut self.changes);
            } else {
                self.keyboard.disconnected(now, &mut self.changes);
            }
        }
        if connected {
            self.keyboard.receive(now, &self.bytes, &mut self.changes);
        }
        self.keyboard.poll(now, &mut self.changes);
        for change in &self.changes {
            self.journal.push(Record::Key(*change));
        }
    }

    fn take_in_arm(&mut self, now: Duration, wires: &mut dyn Wires) -> Result<(), Fault> {
        self.bytes.clear();
        let connected = wires.receive_arm(&mut self.bytes).and_then(|()| {
            self.arm.receive_command(now, &self.bytes);
            self.bytes.clear();
            wires.receive_report(&mut self.bytes)
        });
        if connected.is_ok() != self.arm_connected {
            self.arm_connected = connected.is_ok();
            if self.arm_connected {
                self.arm.connected(now)
            } else {
                self.arm.disconnected(now)
            }
            if self.arm_connected && self.is_let_go() {
                // It has not heard of the stop, and may be on its way still.
                let mut stop = Vec::new();
                self.arm.stop(now, &mut stop);
                wires.send_arm(&stop)?;
            }
        }
        connected?;
        self.arm.receive_report(now, &self.bytes);
        if self.phase == Phase::Starting && !self.arm_told {
            self.arm_told = true;
            self.arm.start(now)?;
        }
        let Some(measured) = self.arm.joints().filter(|_| self.arm.joints_at() != self.arm_seen) else {
            return Ok(());
        };
        self.arm_seen = self.arm.joints_at();
        let record = Record::Arm {
            at: now,
            measured,
            sent: self.arm.sent().unwrap_or(measured),
            rail_m: self.path.place(&measured).rail_m,
        };
        self.journal.push(record);
        Ok(())
    }

    fn send(&mut self, wires: &mut dyn Wires) -> Result<(), Fault> {
        // A wire that fails must not keep the other from being used.
        let frames = self.frames.iter().try_for_each(|frame| wires.send_frame(*frame));
        if !self.bytes.is_empty() {
            wires.send_arm(&self.bytes)?;
        }
        Ok(frames?)
    }

    /// What has gone wrong, if anything.
    fn watch(&mut self, now: Duration, gap: Duration) -> Option<Fault> {
        if !self.is_used() {
            return None;
        }
        if let HandState::Fault(fault) = self.hand.state() {
            return Some(fault.into());
        }
        if let ArmState::Fault(fault) = self.arm.state() {
            return Some(fault.into());
        }
        if let lost @ KeyboardState::Lost { .. } = self.keyboard.state() {
            return Some(Fault::Keyboard(lost.to_string()));
        }
        if gap > LONGEST_GAP && self.is_live() {
            return Some(Fault::Stalled { gap });
        }
        let stretch = self.stream.as_ref().filter(|_| self.phase == Phase::Following)?;
        let age = now.saturating_sub(stretch.end(period()));
        (age.as_secs_f64() > self.config.limits.stale_command_secs).then_some(Fault::StaleCommand { age })
    }

    /// Whether the devices are to be there.
    fn is_used(&self) -> bool {
        self.is_live() || self.phase == Phase::Starting
    }

    /// Whether hand and arm were told to stop.
    fn is_let_go(&self) -> bool {
        matches!(self.phase, Phase::Stopped | Phase::Fault)
    }

    /// Whether torques are on.
    fn is_live(&self) -> bool {
        matches!(self.phase, Phase::Holding | Phase::Moving | Phase::Following)
    }

    /// Phases that end by themselves, and the set-points that are due.
    fn advance(&mut self, now: Duration) -> Result<(), Fault> {
        if self.phase == Phase::Starting {
            if self.hand.state() == HandState::Ready && self.arm.state() == ArmState::Ready {
                self.check_arm()?;
                let keyboard = self.keyboard.state();
                if keyboard != KeyboardState::Present {
                    return Err(Fault::Keyboard(keyboard.to_string()));
                }
                self.settle(now);
                self.enter(now, Phase::Holding);
            }
            return Ok(());
        }
        if !self.is_live() {
            return Ok(());
        }
        self.advance_plan(now)?;
        // After a gap the grid starts anew: set-points are never made up for.
        if now.saturating_sub(self.stepped) > 4 * period() {
            self.stepped = now.saturating_sub(period());
        }
        while now.saturating_sub(self.stepped) >= period() {
            self.stepped += period();
            self.set_points(self.stepped)?;
        }
        Ok(())
    }

    /// Whether this is the arm that was shown where the keyboard is.
    fn check_arm(&self) -> Result<(), Fault> {
        let (found, expected) = (self.arm.serial().unwrap_or_default(), self.path.arm_serial());
        if found == expected {
            return Ok(());
        }
        Err(Fault::OtherArm { found: found.to_string(), expected: expected.to_string() })
    }

    /// Set-points to rest where the robot is.
    fn settle(&mut self, now: Duration) {
        let place = self.place();
        let wire = self.hand.positions();
        for (axis, position) in self.axes.iter_mut().zip(wire.into_iter().chain([place.rail_m])) {
            axis.rest(position);
        }
        self.before = self.setpoints();
        self.stepped = now;
        let on_path = place.beside_m <= ON_PATH_M && place.turned_rad <= ON_PATH_RAD;
        self.arm_sent = self.arm.joints().filter(|_| on_path);
    }

    fn advance_plan(&mut self, now: Duration) -> Result<(), Fault> {
        let Some(plan) = &mut self.plan else { return Ok(()) };
        if !plan.slow.is_over(now) {
            return Ok(());
        }
        let Some((station, told)) = plan.station else {
            self.plan = None;
            self.enter(now, Phase::Holding);
            return Ok(());
        };
        let reach = |source| Fault::Reach { rail_m: 0.0, source };
        if !told {
            let joints = match station {
                Station::Home => PAPER_HOME_DEG.map(f64::to_radians),
                Station::Above => self.path.above_middle(CLEAR_M).map_err(reach)?,
                Station::Middle => *self.path.middle(),
            };
            plan.station = Some((station, true));
            self.arm.move_home(now, joints, HOMING_SPEED)?;
            return Ok(());
        }
        if self.arm.state() != ArmState::Ready {
            return Ok(());
        }
        plan.station = match station {
            Station::Home => Some((Station::Above, false)),
            Station::Above => Some((Station::Middle, false)),
            Station::Middle => None,
        };
        if plan.station.is_none() {
            let goal = plan.goal;
            self.settle_rail();
            let slow = self.slowly(now, &goal);
            self.plan = Some(Plan { slow, station: None, goal });
        }
        Ok(())
    }

    /// Lets the rail's set-point rest where the arm has come to.
    fn settle_rail(&mut self) {
        let joints = self.arm.joints().unwrap_or(*self.path.middle());
        self.axes[allegro::JOINTS].rest(self.path.place(&joints).rail_m);
        self.before = self.setpoints();
        self.arm_sent = Some(joints);
    }

    fn set_points(&mut self, at: Duration) -> Result<(), Fault> {
        self.before = self.setpoints();
        let asked = match (&self.plan, &self.stream) {
            (Some(plan), _) => Some(plan.slow.at(at)),
            (None, Some(stretch)) => {
                stretch.at(at, period()).map(|joints| all_axes(joints, &self.config.limits.thumb_rad))
            }
            (None, None) => None,
        };
        let mut clamps: Vec<(usize, Clamp)> = Vec::new();
        match &asked {
            None => self.axes.iter_mut().for_each(Axis::brake),
            Some(asked) => {
                for (index, (axis, target)) in self.axes.iter_mut().zip(asked).enumerate() {
                    // Without the arm at the keyboard there is no rail to move.
                    if index == allegro::JOINTS && self.arm_sent.is_none() {
                        continue;
                    }
                    if let Some(clamp) = axis.step(*target) {
                        clamps.push((driven_index(index), clamp));
                    }
                }
            }
        }
        self.clamped += clamps.len() as u64;
        let sent = driven(&self.setpoints());
        if let Some(near) = self.arm_sent {
            let rail_m = sent[RAIL];
            let joints = self.path.joints(rail_m, &near).map_err(|source| Fault::Reach { rail_m, source })?;
            self.arm.servo(at, joints)?;
            self.arm_sent = Some(joints);
        }
        let asked = asked.as_ref().map_or(sent, driven);
        self.journal.push(Record::SetPoint { at, asked, sent, clamps });
        Ok(())
    }

    /// One period of the joint loop.
    fn drive(&mut self, now: Duration, frames: &mut Vec<CanFrame>) {
        if !self.is_live() {
            return;
        }
        let at = self.hand.positions_at().unwrap_or(now);
        let positions = self.hand.positions();
        let since = now.saturating_sub(self.stepped).as_secs_f64();
        let share = (since * SETPOINT_HZ).clamp(0.0, 1.0);
        let reference: [f64; allegro::JOINTS] = std::array::from_fn(|joint| {
            self.before[joint] + (self.axes[joint].position() - self.before[joint]) * share
        });
        let wanted = self.joint_loop.pwm(at, &positions, &reference);
        let pwm = self.hand.torque(now, &wanted, frames);
        self.journal.push(Record::Hand { at, positions, reference, pwm });
    }

    /// A wire that is gone is a fault only of a robot that is in use.
    fn fail_if_used(&mut self, now: Duration, fault: Fault, wires: &mut dyn Wires) {
        if self.is_used() {
            self.fail(now, fault, wires);
        }
    }

    fn fail(&mut self, now: Duration, fault: Fault, wires: &mut dyn Wires) {
        if self.phase == Phase::Fault {
            return;
        }
        self.journal.push(Record::Note { at: now, kind: "fault", text: fault.to_string() });
        self.let_go(now, wires);
        self.fault = Some(fault);
        self.enter(now, Phase::Fault);
    }

    /// The arm is asked for the number of its error only after it was stopped.
    fn explain(&mut self, now: Duration) {
        if let (Some(Fault::Arm(told)), ArmState::Fault(known)) = (&mut self.fault, self.arm.state())
            && *told != known
        {
            *told = known;
            self.journal.push(Record::Note { at: now, kind: "fault", text: Fault::Arm(known).to_string() });
        }
    }

    /// Zero torque and servo off for the hand, state 4 for the arm, whatever the wires say.
    fn let_go(&mut self, now: Duration, wires: &mut dyn Wires) {
        self.let_go_at = now;
        self.frames.clear();
        self.bytes.clear();
        self.hand.stop(now, &mut self.frames);
        self.arm.stop(now, &mut self.bytes);
        // A wire that fails must not keep the other from being told.
        for frame in &self.frames {
            let _ = wires.send_frame(*frame);
        }
        let _ = wires.send_arm(&self.bytes);
        self.plan = None;
        self.stream = None;
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

    /// What it is doing.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Why it was stopped.
    pub fn fault(&self) -> Option<&Fault> {
        self.fault.as_ref()
    }

    /// Measured positions of the driven joints: rad, the rail in m.
    pub fn joints(&self) -> [f64; DRIVEN] {
        from_wire(&self.hand.positions(), self.place().rail_m)
    }

    /// Where the hand is, seen from the rail; in the middle before the arm has reported.
    pub fn place(&self) -> RailPlace {
        self.path.place(&self.arm.joints().unwrap_or(*self.path.middle()))
    }

    /// Keys that are down: bit 0 is the lowest.
    pub fn pressed(&self) -> u64 {
        self.keyboard.pressed()
    }

    /// Set-points that were clamped so far, counted by joint.
    pub fn clamped(&self) -> u64 {
        self.clamped
    }

    /// The hand.
    pub fn hand(&self) -> &Hand {
        &self.hand
    }

    /// The arm.
    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    /// The keyboard.
    pub fn keyboard(&self) -> &Keyboard {
        &self.keyboard
    }

    /// The rig that it controls.
    pub fn config(&self) -> &RigConfig {
        &self.config
    }

    /// Takes the records since the last call.
    pub fn records(&mut self) -> impl Iterator<Item = Record> + '_ {
        self.journal.take()
    }

    /// Records that were lost because nobody took them.
    pub fn lost_records(&self) -> u64 {
        self.journal.lost()
    }
}

/// Time between two set-points.
fn period() -> Duration {
    Duration::from_secs_f64(1.0 / SETPOINT_HZ)
}

fn all_axes(joints: &[f64; DRIVEN], thumb_rad: &[f64; 4]) -> [f64; AXES] {
    let wire = to_wire(joints, thumb_rad);
    std::array::from_fn(|axis| wire.get(axis).copied().unwrap_or(joints[RAIL]))
}

fn driven(axes: &[f64; AXES]) -> [f64; DRIVEN] {
    std::array::from_fn(|joint| if joint == RAIL { axes[allegro::JOINTS] } else { axes[joint] })
}

/// The driven joint of an axis; the thumb's four come after them.
fn driven_index(axis: usize) -> usize {
    match axis {
        allegro::JOINTS => RAIL,
        thumb if thumb >= FINGER_JOINTS => thumb + 1,
        finger => finger,
    }
}
