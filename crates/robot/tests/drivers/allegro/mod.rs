//! The hand's driver against the emulator, in virtual time: the start, a closed loop, every fault,
//! and any bytes at all.

mod hostile;
mod running;
mod starting;

use std::collections::VecDeque;
use std::time::Duration;

use etude_emulators::{FreeHand, HandEmulator, HandEmulatorConfig};
use etude_robot::allegro::{
    DeviceId, Finger, Hand, HandConfig, HandEvent, HandFault, HandState, HostMessage, JointLoop,
    JointLoopConfig, WIRE_JOINTS,
};
use etude_robot::can::CanFrame;

/// Positions (deg) that the maker calls home (allegro_hand_ros_v4).
const HOME_DEG: [f64; WIRE_JOINTS] =
    [0.0, -10.0, 45.0, 45.0, 0.0, -10.0, 45.0, 45.0, 5.0, -5.0, 50.0, 45.0, 60.0, 25.0, 15.0, 45.0];
pub const TICK: Duration = Duration::from_micros(500);

pub fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

/// What happens to a frame on its way.
pub type Fate = Box<dyn FnMut(Duration, &CanFrame) -> bool>;

/// A driver, a joint loop, an emulator and free joints on a bus, half a millisecond at a time.
pub struct Bench {
    pub now: Duration,
    pub hand: Hand,
    pub joints: JointLoop,
    pub reference: [f64; WIRE_JOINTS],
    /// Frames on their way to the host, and to the hand.
    pub to_host: VecDeque<CanFrame>,
    pub to_hand: VecDeque<CanFrame>,
    pub emulator: HandEmulator,
    pub free: FreeHand,
    /// Each frame that the host sent, and when.
    pub sent: Vec<(Duration, CanFrame)>,
    pub ticks: u32,
    /// Whether a frame of the hand, or of the host, arrives.
    pub arrives: Fate,
    pub heard: Fate,
    pub attended: bool,
}

impl Bench {
    pub fn new(config: &HandConfig, emulator: &HandEmulatorConfig) -> Self {
        Self {
            now: Duration::ZERO,
            hand: Hand::new(config).unwrap(),
            joints: JointLoop::new(&JointLoopConfig::default()).unwrap(),
            reference: HOME_DEG.map(f64::to_radians),
            to_host: VecDeque::new(),
            to_hand: VecDeque::new(),
            emulator: HandEmulator::new(emulator),
            free: FreeHand::default(),
            sent: vec![],
            ticks: 0,
            arrives: Box::new(|_, _| true),
            heard: Box::new(|_, _| true),
            attended: true,
        }
    }

    pub fn default() -> Self {
        Self::new(&HandConfig::default(), &HandEmulatorConfig::default())
    }

    /// A bench whose hand has just become ready.
    pub fn ready() -> Self {
        let mut bench = Self::default();
        bench.start();
        assert_eq!(bench.hand.state(), HandState::Ready);
        bench
    }

    pub fn start(&mut self) {
        self.hand.start(self.now);
        while self.hand.state() == HandState::Starting {
            self.step();
        }
    }

    pub fn run(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.step();
        }
    }

    pub fn step(&mut self) {
        self.now += TICK;
        let mut out = vec![];
        while let Some(frame) = self.to_hand.pop_front() {
            if (self.heard)(self.now, &frame) {
                self.emulator.receive(self.now, &frame, &mut out);
            }
        }
        self.free.step(TICK.as_secs_f64(), &self.emulator.pwm());
        self.emulator.set_positions(&self.free.positions());
        self.emulator.tick(self.now, &mut out);
        self.to_host.extend(out);
        let mut out = vec![];
        let mut over = false;
        while let Some(frame) = self.to_host.pop_front() {
            if (self.arrives)(self.now, &frame) {
                over |= self.hand.receive(self.now, &frame) == HandEvent::Positions;
            }
        }
        over |= self.hand.poll(self.now, &mut out) == HandEvent::Positions;
        if over && self.attended {
            self.ticks += 1;
            let at = self.hand.positions_at().unwrap();
            let wanted = self.joints.pwm(at, &self.hand.positions(), &self.reference, 0.0);
            let _ = self.hand.send_pwm(self.now, &wanted, &mut out);
        }
        for frame in out {
            self.sent.push((self.now, frame));
            self.to_hand.push_back(frame);
        }
    }

    /// Messages that the host sent from `from` on.
    pub fn said(&self, from: Duration) -> Vec<HostMessage> {
        let frames = self.sent.iter().filter(|(at, _)| *at >= from);
        frames.map(|(_, frame)| HostMessage::decode(DeviceId::default(), frame).unwrap()).collect()
    }

    /// The fault that ends the next two seconds.
    pub fn fault(&mut self) -> HandFault {
        self.run(ms(2500));
        match self.hand.state() {
            HandState::Fault(fault) => fault,
            state => panic!("{state:?} after {:?}", self.now),
        }
    }

    pub fn worst_error(&self) -> f64 {
        let errors =
            self.free.positions().into_iter().zip(self.reference).map(|(is, wanted)| (is - wanted).abs());
        errors.fold(0.0, f64::max)
    }
}

pub fn zero_torques(repeats: usize) -> Vec<HostMessage> {
    let once = Finger::ALL.map(|finger| HostMessage::Torque { finger, pwm: [0; 4] });
    once.into_iter().cycle().take(4 * repeats).collect()
}
