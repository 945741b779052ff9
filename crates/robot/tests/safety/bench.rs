//! A controller and a twin with somebody at the wires between them. Whole faults of devices and
//! wires are the twin's own ([`FaultKind`]).

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::OnceLock;
use std::time::Duration;

use etude_emulators::faults::FaultPlan;
use etude_robot::calibration::{Calibration, RailPath};
use etude_robot::joints::DRIVEN;
use etude_robot::rig_file::RigConfig;
use etude_robot::wires::Wires;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Pace as _, Phase, Record, Refused, Robot};
use etude_stage::{PhysicalParams, StageConfig, World};
use etude_twin::{FaultKind, Lockstep, Twin, TwinParams, calibration};

use crate::dice::Dice;
use crate::judge::Judge;
use crate::mischief::{Mischief, Tap};
use crate::policy::Policy;

/// Time between two stretches of a policy.
const CONTROL: u32 = 50;

pub fn rig() -> RigConfig {
    TwinParams::load("mild").unwrap().rig()
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

/// The mild parameter set with these faults on its links.
pub fn with_links(can: &FaultPlan, arm: &FaultPlan, midi: &FaultPlan) -> TwinParams {
    let plan = |name: &str, plan: &FaultPlan| format!("[links.{name}]\n{}", toml::to_string(plan).unwrap());
    let links = [plan("can", can), plan("arm", arm), plan("midi", midi)];
    TwinParams::load("mild").unwrap().with(&links.concat()).unwrap()
}

/// Where a song begins.
pub fn start_pose() -> [f64; DRIVEN] {
    static POSE: OnceLock<[f64; DRIVEN]> = OnceLock::new();
    *POSE
        .get_or_init(|| World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap().start_pose())
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
    pub fn at_the_keyboard(twin_params: &TwinParams) -> Self {
        let mut bench = Self::new(twin_params, &calibration("twin"));
        bench.place_arm_at_the_keyboard();
        bench
    }

    pub fn new(twin_params: &TwinParams, calibration: &Calibration) -> Self {
        Self::with_rig(&rig(), twin_params, calibration)
    }

    /// A bench whose controller has the settings of this rig.
    pub fn with_rig(rig: &RigConfig, twin_params: &TwinParams, calibration: &Calibration) -> Self {
        let twin = Twin::new(twin_params, rig.hand.side).unwrap();
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

    /// Guides the arm to the middle of the keyboard by hand.
    pub fn place_arm_at_the_keyboard(&mut self) {
        self.lockstep.twin.devices.arm.place(*path(&calibration("twin")).middle());
        self.run(200);
    }

    /// Guides the arm home by hand.
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
        self.judge.target_secs = self.robot.arm().servo_period().as_secs_f64();
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

    /// Holds the arm's replies back; then they come together.
    pub fn hold_replies(&mut self, millis: u32) {
        let held = Rc::new(RefCell::new(Vec::new()));
        let keep = Rc::clone(&held);
        self.mischief.alter_replies = Some(Box::new(move |bytes| keep.borrow_mut().append(bytes)));
        self.run(millis);
        self.mischief.alter_replies = None;
        self.mischief.replies.append(&mut held.borrow_mut());
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

    /// The arm's emulator is stopped, or waits for its state to be set after another client's
    /// change: it does not move either way.
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
