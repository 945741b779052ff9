//! A controller and the three emulators on wires of no length, a millisecond at a time. The hand's
//! joints are guided by the test, or move freely.

use std::collections::VecDeque;
use std::time::Duration;

use etude_emulators::{
    ArmEmulator, ArmEmulatorConfig, ConnectionId, FreeHand, HandEmulator, HandEmulatorConfig,
    KeyboardEmulator, KeyboardEmulatorConfig, ReportKind,
};
use etude_robot::allegro::{JointLoopConfig, WIRE_JOINTS};
use etude_robot::calibration::{Calibration, Point, RailPath};
use etude_robot::can::{CanError, CanFrame};
use etude_robot::joints::DRIVEN;
use etude_robot::keyboard::MidiError;
use etude_robot::rig_file::RigConfig;
use etude_robot::wires::Wires;
use etude_robot::xarm::ArmLinkError;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Phase, Record, Robot};

pub const MS: Duration = Duration::from_millis(1);

pub fn rig() -> RigConfig {
    // The hand of this bench has no weight.
    let joint_loop = JointLoopConfig { gravity_pwm_per_nm: 0.0, ..JointLoopConfig::default() };
    RigConfig { name: "bench".into(), joint_loop, ..RigConfig::default() }
}

pub fn path() -> RailPath {
    let point = |pitch, rail_m: f64| Point {
        pitch,
        rail_m,
        position_mm: [485.0, -rail_m * 1e3, 170.0],
        orientation_deg: [-90.0, 225.0, -90.0],
        shown_unix_secs: 0,
    };
    let calibration = Calibration {
        rig: "bench".into(),
        arm_serial: "XS130424A01A08".into(),
        points: vec![point(36, -0.33), point(60, 0.0), point(84, 0.33)],
        ..Calibration::default()
    };
    RailPath::new(&calibration, [-0.337, 0.337], &PAPER_HOME_DEG.map(f64::to_radians)).unwrap()
}

/// The devices, and what is on its way from them.
pub struct Devices {
    pub hand: HandEmulator,
    pub joints: FreeHand,
    /// Angles that the test guides the hand's joints to; joints without one move freely.
    pub guided: [Option<f64>; WIRE_JOINTS],
    pub arm: ArmEmulator,
    pub keyboard: KeyboardEmulator,
    client: ConnectionId,
    now: Duration,
    frames: VecDeque<CanFrame>,
    /// The bus gives nothing to the controller, which does not notice.
    pub held: bool,
    pub can_cut: bool,
    pub arm_cut: bool,
}

impl Wires for Devices {
    fn send_frame(&mut self, frame: CanFrame) -> Result<(), CanError> {
        if self.can_cut {
            return Err(CanError::Broken { bus: "bench".into(), message: "cut".into() });
        }
        let mut answers = Vec::new();
        self.hand.receive(self.now, &frame, &mut answers);
        self.frames.extend(answers);
        Ok(())
    }

    fn next_frame(&mut self) -> Result<Option<CanFrame>, CanError> {
        Ok(if self.held { None } else { self.frames.pop_front() })
    }

    fn send_arm(&mut self, bytes: &[u8]) -> Result<(), ArmLinkError> {
        self.arm.receive(self.now, self.client, bytes);
        Ok(())
    }

    fn receive_arm(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        if self.arm_cut {
            let source = std::io::ErrorKind::NotConnected.into();
            return Err(ArmLinkError::Broken { doing: "talking on the bench", source });
        }
        self.arm.take(self.client, bytes);
        Ok(())
    }

    fn receive_report(&mut self, bytes: &mut Vec<u8>) -> Result<(), ArmLinkError> {
        self.arm.take_reports(ReportKind::Real, bytes);
        Ok(())
    }

    fn receive_midi(&mut self, bytes: &mut Vec<u8>) -> Result<(), MidiError> {
        self.keyboard.poll(self.now, bytes);
        Ok(())
    }
}

pub struct Bench {
    pub robot: Robot,
    pub devices: Devices,
    pub records: Vec<Record>,
}

impl Bench {
    /// Nothing is started; the arm stands in the middle of the keyboard, the fingers are straight.
    pub fn new() -> Self {
        Self::with(&rig())
    }

    /// The same with another rig.
    pub fn with(rig: &RigConfig) -> Self {
        Self::with_arm(rig, ArmEmulatorConfig::default())
    }

    /// The same with another arm.
    pub fn with_arm(rig: &RigConfig, arm: ArmEmulatorConfig) -> Self {
        let mut arm = ArmEmulator::new(arm);
        let path = path();
        arm.place(*path.middle());
        let client = arm.connect();
        let devices = Devices {
            hand: HandEmulator::new(&HandEmulatorConfig { side: rig.hand.side, ..Default::default() }),
            joints: FreeHand::default(),
            guided: [None; WIRE_JOINTS],
            arm,
            keyboard: KeyboardEmulator::new(&KeyboardEmulatorConfig::default()).unwrap(),
            client,
            now: Duration::ZERO,
            frames: VecDeque::new(),
            held: false,
            can_cut: false,
            arm_cut: false,
        };
        Self { robot: Robot::new(rig, path).unwrap(), devices, records: Vec::new() }
    }

    pub fn holding() -> Self {
        let mut bench = Self::new();
        bench.start();
        bench.until(Phase::Holding, 3000);
        bench
    }

    pub fn now(&self) -> Duration {
        self.devices.now
    }

    pub fn start(&mut self) {
        self.robot.start(self.devices.now);
    }

    /// Time passes for the devices alone.
    pub fn pass(&mut self) {
        let devices = &mut self.devices;
        devices.now += MS;
        devices.arm.advance(devices.now);
        devices.joints.step(MS.as_secs_f64(), &devices.hand.pwm());
        let mut positions = devices.joints.positions();
        for (position, guided) in positions.iter_mut().zip(devices.guided) {
            *position = guided.unwrap_or(*position);
        }
        devices.hand.set_positions(&positions);
        let mut frames = Vec::new();
        devices.hand.tick(devices.now, &mut frames);
        devices.frames.extend(frames);
    }

    pub fn step(&mut self) {
        self.pass();
        self.robot.poll(self.devices.now, &mut self.devices);
        self.records.extend(self.robot.records());
    }

    pub fn run(&mut self, millis: u64) {
        (0..millis).for_each(|_| self.step());
    }

    /// Guides a joint of the hand to an angle, at 3 rad/s.
    pub fn guide(&mut self, joint: usize, to_rad: f64) {
        let mut angle = self.devices.guided[joint].unwrap_or(self.devices.joints.positions()[joint]);
        while (to_rad - angle).abs() > 1e-9 {
            angle += (to_rad - angle).clamp(-0.003, 0.003);
            self.devices.guided[joint] = Some(angle);
            self.step();
        }
    }

    #[track_caller]
    pub fn until(&mut self, phase: Phase, millis: u64) {
        for _ in 0..millis {
            if self.robot.phase() == phase {
                return;
            }
            self.step();
        }
        panic!("{:?} and not {phase:?}: {:?}", self.robot.phase(), self.robot.fault());
    }

    pub fn fault(&self) -> String {
        self.robot.fault().map(ToString::to_string).unwrap_or_default()
    }

    /// Follows one pose for a second, a stretch every 50 ms.
    pub fn follow(&mut self, pose: &[f64; DRIVEN], millis: u64) {
        for _ in 0..millis / 50 {
            self.robot.follow(self.devices.now, &[*pose; 10]).unwrap();
            self.run(50);
        }
    }
}
