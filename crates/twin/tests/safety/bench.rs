//! A controller and a twin with somebody at the wires between them: listens to what is sent, and drops, damages and
//! invents what comes back. Whole faults of devices and wires are the twin's own ([`FaultKind`]).

use std::collections::VecDeque;
use std::sync::OnceLock;
use std::time::Duration;

use etude_emulators::faults::FaultPlan;
use etude_robot::calibration::{Calibration, RailPath};
use etude_robot::can::{CanError, CanFrame};
use etude_robot::joints::{DRIVEN, RAIL};
use etude_robot::keyboard::MidiError;
use etude_robot::rig::RigConfig;
use etude_robot::wires::Wires;
use etude_robot::xarm::ArmLinkError;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Pace as _, Phase, Record, Refused, Robot};
use etude_stage::{PhysicalParams, StageConfig, World};
use etude_twin::{FaultKind, Lockstep, Truth, Twin, calibration};

use crate::dice::Dice;
use crate::judge::Judge;

/// Time between two stretches of a policy.
const CONTROL: u32 = 50;

pub fn rig() -> RigConfig {
    Truth::load("mild").unwrap().rig()
}

pub fn path(calibration: &Calibration) -> RailPath {
    let home = PAPER_HOME_DEG.map(f64::to_radians);
    RailPath::new(calibration, rig().limits.rail_range_m, &home).unwrap()
}

pub fn robot(calibration: &Calibration) -> Robot {
    robot_of(&rig(), calibration)
}

fn robot_of(rig: &RigConfig, calibration: &Calibration) -> Robot {
    Robot::new(rig, path(calibration)).unwrap()
}

/// The mild truth with these faults on its links.
pub fn with_links(can: &FaultPlan, arm: &FaultPlan, midi: &FaultPlan) -> Truth {
    let plan = |name: &str, plan: &FaultPlan| format!("[links.{name}]\n{}", toml::to_string(plan).unwrap());
    let links = [plan("can", can), plan("arm", arm), plan("midi", midi)];
    Truth::load("mild").unwrap().with(&links.concat()).unwrap()
}

/// Where a song begins.
pub fn start_pose() -> [f64; DRIVEN] {
    static POSE: OnceLock<[f64; DRIVEN]> = OnceLock::new();
    *POSE
        .get_or_init(|| World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap().start_pose())
}

/// What the policy asks for while it is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Nothing any more.
    Silent,
    /// To stand where it began.
    Still,
    /// Waves within the limits, over a third of the keyboard.
    Smooth,
    /// From one end of the keyboard to the other, as fast as the limits allow.
    Sweeps,
    /// Something else at every set-point.
    Jumps,
    /// Numbers that are none.
    Nonsense,
}

impl Policy {
    fn waypoint(self, from: &[f64; DRIVEN], secs: f64, dice: &mut Dice) -> [f64; DRIVEN] {
        let rise = |amplitude: f64, speed: f64| amplitude * (1.0 - (speed * secs).cos());
        std::array::from_fn(|joint| match self {
            Self::Silent | Self::Still => from[joint],
            Self::Smooth if joint == RAIL => from[RAIL] + rise(0.12, 1.5),
            Self::Smooth if joint % 4 == 0 => from[joint],
            Self::Smooth => from[joint] + rise(0.1, 6.0 + joint as f64 * 0.1),
            Self::Sweeps if joint == RAIL => 0.3f64.copysign((3.0 * secs).sin()),
            Self::Sweeps => from[joint],
            Self::Jumps if joint == RAIL => dice.signed(),
            Self::Jumps => dice.signed() * 3.0,
            Self::Nonsense => match dice.below(5) {
                0 => f64::INFINITY,
                1 => f64::NEG_INFINITY,
                2 => dice.signed() * 1e300,
                _ => f64::NAN,
            },
        })
    }
}

/// What becomes of a frame on its way: nothing, itself, or others.
pub type AlterFrame = Box<dyn FnMut(CanFrame) -> Vec<CanFrame>>;
/// What becomes of bytes on their way.
pub type AlterBytes = Box<dyn FnMut(&mut Vec<u8>)>;

/// What is done at the wires.
pub struct Mischief {
    /// Share of frames that is lost, both ways.
    pub frame_loss: f64,
    /// What becomes of the frames from and to the hand.
    pub from_hand: Option<AlterFrame>,
    pub to_hand: Option<AlterFrame>,
    /// What becomes of the bytes that come from the arm in one poll.
    pub alter_replies: Option<AlterBytes>,
    pub alter_reports: Option<AlterBytes>,
    /// What arrives besides what the twin says.
    pub frames: VecDeque<CanFrame>,
    pub replies: Vec<u8>,
    pub reports: Vec<u8>,
    pub midi: Vec<u8>,
    /// The same, in each poll.
    pub flood: Vec<CanFrame>,
    pub midi_flood: Option<AlterBytes>,
    /// A request (register, parameters) of another client of the arm, in each poll.
    pub other_client: Vec<u8>,
    dice: Dice,
}

impl Default for Mischief {
    fn default() -> Self {
        Self {
            frame_loss: 0.0,
            from_hand: None,
            to_hand: None,
            alter_replies: None,
            alter_reports: None,
            frames: VecDeque::new(),
            replies: Vec::new(),
            reports: Vec::new(),
            midi: Vec::new(),
            flood: Vec::new(),
            midi_flood: None,
            other_client: Vec::new(),
            dice: Dice::new(1),
        }
    }
}

/// The wires with somebody at them.
struct Tap<'a> {
    now: Duration,
    inner: &'a mut dyn Wires,
    mischief: &'a mut Mischief,
    judge: &'a mut Judge,
}

impl Wires for Tap<'_> {
    fn send_frame(&mut self, frame: CanFrame) -> Result<(), CanError> {
        self.judge.frame(&frame);
        if self.mischief.dice.chance(self.mischief.frame_loss) {
            return Ok(());
        }
        match &mut self.mischief.to_hand {
            None => self.inner.send_frame(frame),
            Some(alter) => alter(frame).into_iter().try_for_each(|frame| self.inner.send_frame(frame)),
        }
    }

    fn next_frame(&mut self) -> Result<Option<CanFrame>, CanError> {
        while let Some(frame) = self.inner.next_frame()? {
            let mischief = &mut *self.mischief;
            if mischief.dice.chance(mischief.frame_loss) {
                continue;
            }
            match &mut mischief.from_hand {
                None => return Ok(Some(frame)),
                Some(alter) => mischief.frames.extend(alter(frame)),
            }
        }
        Ok(self.mischief.frames.pop_front())
    }

    fn send_arm(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        self.judge.arm_bytes(self.now, bytes);
        self.inner.send_arm(bytes)
    }

    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        bytes.append(&mut self.mischief.replies);
        receive(bytes, &mut self.mischief.alter_replies, |bytes| self.inner.receive_arm(bytes))
    }

    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        bytes.append(&mut self.mischief.reports);
        receive(bytes, &mut self.mischief.alter_reports, |bytes| self.inner.receive_report(bytes))
    }

    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError> {
        self.inner.receive_midi(bytes).inspect_err(|_| self.judge.midi_lost())?;
        bytes.append(&mut self.mischief.midi);
        if let Some(flood) = &mut self.mischief.midi_flood {
            flood(bytes);
        }
        self.judge.midi_bytes(self.now, bytes);
        Ok(())
    }
}

/// Receives bytes, and does to them what is to be done.
fn receive(
    bytes: &mut Vec<u8>,
    alter: &mut Option<AlterBytes>,
    from: impl FnOnce(&mut Vec<u8>) -> Result<(), ArmLinkError>,
) -> Result<(), ArmLinkError> {
    let mut new = Vec::new();
    from(&mut new)?;
    if let Some(alter) = alter.as_mut().filter(|_| !new.is_empty()) {
        alter(&mut new);
    }
    bytes.append(&mut new);
    Ok(())
}

/// A controller and a twin, and what is done to them.
pub struct Bench {
    pub robot: Robot,
    pub lockstep: Lockstep,
    pub judge: Judge,
    pub mischief: Mischief,
    pub policy: Policy,
    /// How far the times of the policy's commands are ahead of the robot's clock, or behind it.
    pub ahead: Duration,
    pub behind: Duration,
    /// Where the policy began, and how many milliseconds it has run.
    from: [f64; DRIVEN],
    played: u32,
    dice: Dice,
    /// What the controller had to say to an operator.
    pub notes: Vec<String>,
}

impl Bench {
    /// A bench whose twin has the arm at the keyboard, fingers straight.
    pub fn at_the_keyboard(truth: &Truth) -> Self {
        let mut bench = Self::new(truth, &calibration("twin"));
        bench.place_arm_at_the_keyboard();
        bench
    }

    pub fn new(truth: &Truth, calibration: &Calibration) -> Self {
        Self::with_rig(&rig(), truth, calibration)
    }

    /// A bench whose controller has the settings of this rig.
    pub fn with_rig(rig: &RigConfig, truth: &Truth, calibration: &Calibration) -> Self {
        let twin = Twin::new(truth, rig.hand.side).unwrap();
        Self {
            robot: robot_of(rig, calibration),
            lockstep: Lockstep::new(twin).unwrap(),
            judge: Judge::new(rig),
            mischief: Mischief::default(),
            policy: Policy::Silent,
            ahead: Duration::ZERO,
            behind: Duration::ZERO,
            from: [0.0; DRIVEN],
            played: 0,
            dice: Dice::new(1),
            notes: Vec::new(),
        }
    }

    /// Leads the arm to the middle of the keyboard by hand.
    pub fn place_arm_at_the_keyboard(&mut self) {
        self.lockstep.twin.devices.arm.place(*path(&calibration("twin")).middle());
        self.run(200);
    }

    /// Leads the arm home by hand.
    pub fn place_arm_at_home(&mut self) {
        self.lockstep.twin.devices.arm.place(PAPER_HOME_DEG.map(f64::to_radians));
        self.run(200);
    }

    pub fn now(&self) -> Duration {
        self.lockstep.now()
    }

    /// Something goes wrong.
    pub fn begin(&mut self, fault: FaultKind) {
        self.lockstep.begin(fault);
    }

    /// It is over.
    pub fn end(&mut self, fault: FaultKind) {
        self.lockstep.end(fault);
    }

    /// A request (register, parameters) of another client of the arm.
    pub fn other_client(&mut self, request: &[u8]) {
        let (now, arm) = (self.lockstep.twin.now(), &mut self.lockstep.twin.devices.arm);
        let other = arm.connect();
        arm.receive(now, other, &[&[0, 1, 0, 2, 0, request.len() as u8], request].concat());
        arm.disconnect(other);
    }

    /// One millisecond.
    pub fn step(&mut self) {
        self.lockstep.step();
        if self.robot.phase() == Phase::Following && self.policy != Policy::Silent {
            if self.played.is_multiple_of(CONTROL) {
                let (policy, from) = (self.policy, self.from);
                let secs = f64::from(self.played) * 1e-3;
                let waypoints: Vec<_> = (0..10)
                    .map(|n| policy.waypoint(&from, secs + f64::from(n) * 5e-3, &mut self.dice))
                    .collect();
                let begun = (self.now() + self.ahead).saturating_sub(self.behind);
                self.robot.follow(begun, &waypoints).unwrap();
            }
            self.played += 1;
        }
        self.poll();
    }

    /// Lets the controller do what is due now.
    pub fn poll(&mut self) {
        self.mischief.frames.extend(&self.mischief.flood);
        if !self.mischief.other_client.is_empty() {
            let request = self.mischief.other_client.clone();
            self.other_client(&request);
        }
        self.judge.arm = Some(self.lockstep.twin.devices.arm.joints());
        self.judge.fingers(self.lockstep.now(), &self.lockstep.twin.joints());
        self.at_the_wires(|robot, now, wires| robot.poll(now, wires));
        self.judge.settled(self.robot.phase());
        let (judge, notes) = (&mut self.judge, &mut self.notes);
        for record in self.robot.records() {
            judge.record(&record);
            if let Record::Note { kind, text, .. } = record {
                notes.push(format!("{kind}: {text}"));
            }
        }
    }

    fn at_the_wires(&mut self, act: impl FnOnce(&mut Robot, Duration, &mut dyn Wires)) {
        let now = self.lockstep.now();
        let (mischief, judge) = (&mut self.mischief, &mut self.judge);
        let mut tap = Tap { now, inner: self.lockstep.wires(), mischief, judge };
        act(&mut self.robot, now, &mut tap);
    }

    pub fn run(&mut self, millis: u32) {
        (0..millis).for_each(|_| self.step());
    }

    /// The controller does not run; the twin does.
    pub fn stall(&mut self, millis: u32) {
        (0..millis).for_each(|_| self.lockstep.step());
    }

    /// Milliseconds until something is so, if it comes within the limit.
    pub fn until(&mut self, limit: u32, so: impl Fn(&Self) -> bool) -> Option<u32> {
        for passed in 0..=limit {
            if so(self) {
                return Some(passed);
            }
            self.step();
        }
        None
    }

    /// Lets the robot run until it is in a phase; any fault on the way fails the test.
    pub fn until_phase(&mut self, phase: Phase, limit: u32) {
        let so = self.until(limit, |bench| {
            assert!(
                phase == Phase::Fault || bench.robot.phase() != Phase::Fault,
                "{} on the way to {}",
                bench.robot.fault().unwrap(),
                phase.name()
            );
            bench.robot.phase() == phase
        });
        assert!(so.is_some(), "not {} but {} after {limit} ms", phase.name(), self.robot.phase().name());
    }

    pub fn start(&mut self) {
        self.robot.start(self.now());
    }

    pub fn stop(&mut self) {
        self.at_the_wires(|robot, now, wires| robot.stop(now, wires));
        self.judge.settled(self.robot.phase());
    }

    pub fn start_and_hold(&mut self) {
        self.start();
        self.until_phase(Phase::Holding, 3000);
    }

    /// Follows a policy from where the robot stands.
    pub fn follow(&mut self, policy: Policy) {
        self.try_follow(policy).unwrap();
    }

    /// The same, unless it is refused.
    pub fn try_follow(&mut self, policy: Policy) -> Result<(), Refused> {
        let from = self.robot.joints();
        self.robot.follow(self.lockstep.now(), &[from; 10])?;
        (self.policy, self.from, self.played) = (policy, from, 0);
        Ok(())
    }

    /// The hand's emulator feels no torque.
    pub fn hand_is_free(&self) -> bool {
        self.lockstep.twin.devices.hand.pwm() == [0; 16]
    }

    /// The hand's emulator feels no torque and its servo is off.
    pub fn hand_is_off(&self) -> bool {
        self.hand_is_free() && !self.lockstep.twin.devices.hand.servo_on()
    }

    /// The arm's emulator is stopped, and takes no orders to move.
    pub fn arm_is_stopped(&self) -> bool {
        self.lockstep.twin.devices.arm.state() == 4
    }

    /// The arm's emulator is stopped, or waits for its state to be set after another client's change: it does not move either way.
    pub fn arm_stands(&self) -> bool {
        matches!(self.lockstep.twin.devices.arm.state(), 4 | 5)
    }

    /// Closes the arm's connections, and opens them anew.
    pub fn reconnect_arm(&mut self) {
        self.begin(FaultKind::ArmDisconnect);
        self.step();
        self.end(FaultKind::ArmDisconnect);
    }

    /// Largest speed of a joint of the world: rad/s, the rail in m/s.
    pub fn fastest(&self) -> f64 {
        self.lockstep.twin.joint_velocities().iter().fold(0.0, |most, speed| most.max(speed.abs()))
    }
}
