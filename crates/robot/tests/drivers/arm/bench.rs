//! Driver and emulator on one bench, in virtual time, with somebody who listens in.

use std::f64::consts::PI;
use std::time::Duration;

use etude_emulators::{ArmEmulator, ArmEmulatorConfig, ConnectionId, ReportKind};
use etude_robot::xarm::codec::{Frame, FrameParser, Register, floats};
use etude_robot::xarm::kinematics::{ARM_JOINTS, JOINT_LIMITS_RAD, PAPER_HOME_DEG, Pose, forward};
use etude_robot::xarm::{Arm, ArmConfig, ArmError, ArmFault, ArmState};

pub const MS: Duration = Duration::from_millis(1);

/// Driver and emulator with a wire of no length between them, and somebody who listens in.
pub struct Bench {
    pub arm: Arm,
    pub emulator: ArmEmulator,
    pub id: ConnectionId,
    pub now: Duration,
    pub wire: Ear,
    /// The network holds replies back.
    pub held: bool,
    /// Replies of this register have these bits of their state set.
    pub spoil: Option<(u8, u8)>,
    /// The port of the reports.
    pub reports: ReportKind,
    /// The report that comes instead of each other one.
    pub repeated: Option<Vec<u8>>,
}

/// Checks everything that the driver sends.
#[derive(Default)]
pub struct Ear {
    parser: FrameParser,
    pub frames: Vec<Frame>,
    pub targets: Vec<[f64; ARM_JOINTS]>,
}

impl Ear {
    pub fn hear(&mut self, mut bytes: &[u8]) {
        while let Some(frame) = self.parser.next(&mut bytes) {
            if frame.register() == Register::ServoJoints as u8 {
                let target = floats::<ARM_JOINTS>(frame.params()).unwrap().map(f64::from);
                for (angle, (lowest, highest)) in target.iter().zip(JOINT_LIMITS_RAD) {
                    assert!((lowest - 1e-6..=highest + 1e-6).contains(angle), "{target:?}");
                }
                if let Some(before) = self.targets.last() {
                    // 20 ms is the longest gap that counts.
                    assert!(apart(before, &target) <= PI * 0.0201, "{before:?} {target:?}");
                }
                self.targets.push(target);
            } else if frame.register() != Register::SetState as u8 {
                // Whatever else is sent, the arm may be elsewhere when the next target comes.
                self.targets.clear();
            }
            self.frames.push(frame);
        }
        assert_eq!(self.parser.skipped(), 0);
    }

    pub fn said(&self, register: Register, first: u8) -> usize {
        let is =
            |frame: &&Frame| frame.register() == register as u8 && frame.params().first() == Some(&first);
        self.frames.iter().filter(is).count()
    }

    /// Servo targets since the beginning.
    pub fn streamed(&self) -> usize {
        self.frames.iter().filter(|frame| frame.register() == Register::ServoJoints as u8).count()
    }

    pub fn stops(&self) -> usize {
        self.said(Register::SetState, 4)
    }
}

impl Bench {
    pub fn new() -> Self {
        Self::with(ArmEmulatorConfig::default())
    }

    pub fn with(config: ArmEmulatorConfig) -> Self {
        let mut emulator = ArmEmulator::new(config);
        let mut arm = Arm::new(ArmConfig::default()).unwrap();
        let id = emulator.connect();
        assert_eq!(arm.state(), ArmState::Disconnected);
        arm.connected(Duration::ZERO);
        Self {
            arm,
            emulator,
            id,
            now: Duration::ZERO,
            wire: Ear::default(),
            held: false,
            spoil: None,
            reports: ReportKind::Real,
            repeated: None,
        }
    }

    pub fn ready() -> Self {
        Self::ready_on(ReportKind::Real)
    }

    pub fn ready_on(reports: ReportKind) -> Self {
        let mut bench = Self { reports, ..Self::new() };
        bench.arm.start(bench.now).unwrap();
        bench.until(ArmState::Ready);
        bench
    }

    pub fn step(&mut self) {
        self.now += MS;
        self.emulator.advance(self.now);
        let mut bytes = Vec::new();
        self.emulator.take_reports(self.reports, &mut bytes);
        if let Some(repeated) = self.repeated.as_ref().filter(|_| !bytes.is_empty()) {
            bytes.clone_from(repeated);
        }
        self.arm.receive_report(self.now, &bytes);
        bytes.clear();
        if !self.held {
            self.emulator.take(self.id, &mut bytes);
        }
        // A reply comes alone: one request is outstanding at a time.
        if let Some((register, bits)) = self.spoil
            && bytes.get(6) == Some(&register)
        {
            bytes[7] |= bits;
        }
        self.arm.receive_command(self.now, &bytes);
        bytes.clear();
        self.arm.poll(self.now, &mut bytes);
        self.send(&bytes);
    }

    pub fn send(&mut self, bytes: &[u8]) {
        self.wire.hear(bytes);
        self.emulator.receive(self.now, self.id, bytes);
    }

    pub fn run(&mut self, millis: u64) {
        (0..millis).for_each(|_| self.step());
    }

    #[track_caller]
    pub fn until(&mut self, state: ArmState) {
        for _ in 0..20_000 {
            if self.arm.state() == state {
                return;
            }
            self.step();
        }
        panic!("{:?} instead of {state:?}", self.arm.state());
    }

    pub fn stop(&mut self) {
        let mut bytes = Vec::new();
        self.arm.stop(self.now, &mut bytes);
        self.send(&bytes);
    }

    pub fn servo(&mut self, joints: [f64; ARM_JOINTS]) -> Result<(), ArmError> {
        self.arm.servo(self.now, joints)
    }

    /// Streams every 5 ms where the joints should be, as told by the time since the beginning in s.
    pub fn stream(
        &mut self,
        secs: f64,
        mut path: impl FnMut(f64) -> [f64; ARM_JOINTS],
    ) -> Result<(), ArmError> {
        for tick in 0..(secs * 200.0) as u32 {
            self.servo(path(f64::from(tick) * 0.005))?;
            self.run(5);
        }
        Ok(())
    }

    /// The bytes of the arm's next rich report.
    pub fn reported(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.run(400);
        self.emulator.take_reports(ReportKind::Rich, &mut bytes);
        bytes.split_off(bytes.len() - 587)
    }

    pub fn fault(&self) -> Option<ArmFault> {
        match self.arm.state() {
            ArmState::Fault(fault) => Some(fault),
            _ => None,
        }
    }
}

pub fn apart(one: &[f64; ARM_JOINTS], other: &[f64; ARM_JOINTS]) -> f64 {
    one.iter().zip(other).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Distance between the flange's positions at two places, m.
pub fn flange_m(one: &[f64; ARM_JOINTS], other: &[f64; ARM_JOINTS]) -> f64 {
    (forward(one).position_m - forward(other).position_m).norm()
}

pub fn home() -> [f64; ARM_JOINTS] {
    PAPER_HOME_DEG.map(f64::to_radians)
}

/// The paper's slide: `share` is 0 over the highest key and 1 over the lowest
/// (lasr-lab/learning-to-play-piano).
pub fn over_keys(share: f64) -> Pose {
    let at = [0.485, 0.3365 - 0.673 * share, 0.169 + 0.003 * share];
    Pose::from_rpy(at, [-90.0_f64, 225.0, -90.0].map(f64::to_radians))
}

/// Smoothly from 0 to 1 in one unit of time.
pub fn smooth(time: f64) -> f64 {
    let t = time.clamp(0.0, 1.0);
    t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
}
