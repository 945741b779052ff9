//! The hand's driver against the emulator, in virtual time: the start, every fault, a closed loop, and any
//! bytes at all.

#![allow(clippy::unwrap_used, reason = "a test that cannot continue has failed")]

use std::collections::VecDeque;
use std::time::Duration;

use etude_emulators::{FreeHand, HandEmulator, HandEmulatorConfig};
use etude_robot::allegro::{
    DeviceId, Finger, Hand, HandConfig, HandEvent, HandFault, HandMessage, HandSide, HandState, HostMessage,
    JOINT_LIMITS_RAD, JOINTS, JointLoop, JointLoopConfig, PWM_LIMITS, Request, StatusBits, counts_from_rad,
};
use etude_robot::can::CanFrame;
use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_pcg::Pcg64;

/// Positions (deg) that the maker calls home (allegro_hand_ros_v4).
const HOME_DEG: [f64; JOINTS] =
    [0.0, -10.0, 45.0, 45.0, 0.0, -10.0, 45.0, 45.0, 5.0, -5.0, 50.0, 45.0, 60.0, 25.0, 15.0, 45.0];
const TICK: Duration = Duration::from_micros(500);

fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

/// What happens to a frame on its way.
type Fate = Box<dyn FnMut(Duration, &CanFrame) -> bool>;

/// A driver, a joint loop, an emulator and free joints on a bus, half a millisecond at a time.
struct Bench {
    now: Duration,
    hand: Hand,
    joints: JointLoop,
    reference: [f64; JOINTS],
    /// Frames on their way to the host, and to the hand.
    to_host: VecDeque<CanFrame>,
    to_hand: VecDeque<CanFrame>,
    emulator: HandEmulator,
    free: FreeHand,
    /// Each frame that the host sent, and when.
    sent: Vec<(Duration, CanFrame)>,
    ticks: u32,
    /// Whether a frame of the hand, or of the host, arrives.
    arrives: Fate,
    heard: Fate,
    attended: bool,
}

impl Bench {
    fn new(config: &HandConfig, emulator: &HandEmulatorConfig) -> Self {
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

    fn default() -> Self {
        Self::new(&HandConfig::default(), &HandEmulatorConfig::default())
    }

    /// A bench whose hand has just become ready.
    fn ready() -> Self {
        let mut bench = Self::default();
        bench.start();
        assert_eq!(bench.hand.state(), HandState::Ready);
        bench
    }

    fn start(&mut self) {
        self.hand.start(self.now);
        while self.hand.state() == HandState::Starting {
            self.step();
        }
    }

    fn run(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.step();
        }
    }

    fn step(&mut self) {
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
            let _ = self.hand.torque(self.now, &wanted, &mut out);
        }
        for frame in out {
            self.sent.push((self.now, frame));
            self.to_hand.push_back(frame);
        }
    }

    /// Messages that the host sent from `from` on.
    fn said(&self, from: Duration) -> Vec<HostMessage> {
        let frames = self.sent.iter().filter(|(at, _)| *at >= from);
        frames.map(|(_, frame)| HostMessage::decode(DeviceId::default(), frame).unwrap()).collect()
    }

    /// The fault that ends the next two seconds.
    fn fault(&mut self) -> HandFault {
        self.run(ms(2500));
        match self.hand.state() {
            HandState::Fault(fault) => fault,
            state => panic!("{state:?} after {:?}", self.now),
        }
    }

    fn worst_error(&self) -> f64 {
        let errors =
            self.free.positions().into_iter().zip(self.reference).map(|(is, wanted)| (is - wanted).abs());
        errors.fold(0.0, f64::max)
    }
}

fn zero_torques(repeats: usize) -> Vec<HostMessage> {
    let once = Finger::ALL.map(|finger| HostMessage::Torque { finger, pwm: [0; 4] });
    once.into_iter().cycle().take(4 * repeats).collect()
}

#[test]
fn the_start_in_its_order() {
    let bench = Bench::ready();
    let mut said = bench.said(Duration::ZERO);
    let streaming = HostMessage::Positions(3);
    let mut wanted = zero_torques(1);
    wanted.extend([
        HostMessage::ServoOff,
        HostMessage::Positions(0),
        HostMessage::Request(Request::Information),
        HostMessage::Request(Request::Serial),
        HostMessage::Request(Request::Temperature(Finger::Middle)),
        streaming,
    ]);
    wanted.extend(zero_torques(1));
    wanted.extend([HostMessage::ServoOn, HostMessage::Request(Request::Information)]);
    said.truncate(wanted.len());
    assert_eq!(said, wanted);
    assert!(bench.now < ms(100), "{:?}", bench.now);
    assert_eq!(bench.hand.serial().unwrap().to_string(), "SAH040A0000001");
    assert_eq!(bench.hand.information().unwrap().generation(), 4);
    assert!(bench.emulator.servo_on());
}

#[test]
fn the_loop_settles_at_a_pose() {
    for (noise_counts, clock_skew) in [(0, 0.0), (8, 0.001), (8, -0.001)] {
        let emulator =
            HandEmulatorConfig { noise_counts, clock_skew, seed: 7, ..HandEmulatorConfig::default() };
        let mut bench = Bench::new(&HandConfig::default(), &emulator);
        bench.start();
        let (ticks, start) = (bench.ticks, bench.now);
        bench.run(ms(3000));
        assert!(bench.worst_error() < 0.002, "{}", bench.worst_error());
        // Quiet: no joint is shaken against its neighbour's noise.
        assert!(bench.free.positions().iter().all(|rad| rad.is_finite()));
        let rate = f64::from(bench.ticks - ticks) / (bench.now - start).as_secs_f64();
        assert!((rate - 1000.0 / 3.0 * (1.0 + clock_skew)).abs() < 1.0, "{rate}");
    }
}

#[test]
fn the_same_inputs_give_the_same_frames() {
    let run = || {
        let emulator = HandEmulatorConfig { noise_counts: 5, seed: 3, ..HandEmulatorConfig::default() };
        let mut bench = Bench::new(&HandConfig::default(), &emulator);
        bench.start();
        bench.run(ms(500));
        bench.sent
    };
    assert_eq!(run(), run());
}

#[test]
fn a_hand_is_told_to_let_go_until_it_confirms_it() {
    let mut bench = Bench::ready();
    // Nothing that is sent is heard for 350 ms.
    let until = bench.now + ms(350);
    bench.heard = Box::new(move |now, _| now >= until);
    let mut out = vec![];
    bench.hand.stop(bench.now, &mut out);
    bench.to_hand.extend(out);
    bench.run(ms(340));
    assert!(!bench.hand.has_let_go() && bench.emulator.servo_on(), "nothing was heard");
    bench.run(ms(160));
    assert!(bench.hand.has_let_go() && !bench.emulator.servo_on());
    bench.sent.clear();
    bench.run(ms(500));
    assert!(bench.sent.is_empty(), "then it is quiet: another controller may come");
}

#[test]
fn lost_frames_neither_stall_nor_shake_the_loop() {
    let mut bench = Bench::ready();
    let mut random = Pcg64::seed_from_u64(5);
    bench.arrives = Box::new(move |_, frame| frame.id() >= 0x100 || random.random_bool(0.9));
    let ticks = bench.ticks;
    bench.run(ms(3000));
    assert_eq!(bench.hand.state(), HandState::Ready);
    assert!((990..=1001).contains(&(bench.ticks - ticks)), "{}", bench.ticks - ticks);
    assert!(bench.worst_error() < 0.002, "{}", bench.worst_error());
}

#[test]
fn stop_is_allowed_always_and_often() {
    let mut stopped = zero_torques(3);
    stopped.extend([
        HostMessage::ServoOff,
        HostMessage::Request(Request::Information),
        HostMessage::Positions(0),
    ]);
    let mut hand = Hand::new(&HandConfig::default()).unwrap();
    for _ in 0..2 {
        let mut out = vec![];
        hand.stop(ms(1), &mut out);
        let said: Vec<_> =
            out.iter().map(|frame| HostMessage::decode(DeviceId::default(), frame).unwrap()).collect();
        assert_eq!((said, hand.state()), (stopped.clone(), HandState::Stopped));
    }
    let mut bench = Bench::ready();
    bench.run(ms(200));
    let mut out = vec![];
    bench.hand.stop(bench.now, &mut out);
    assert!(!bench.hand.has_let_go());
    bench.to_hand.extend(out);
    bench.sent.clear();
    bench.run(ms(500));
    assert!(bench.hand.has_let_go());
    assert_eq!((bench.sent.len(), bench.emulator.pwm(), bench.emulator.servo_on()), (0, [0; JOINTS], false));
    // And a new start is a new start.
    bench.start();
    assert_eq!(bench.hand.state(), HandState::Ready);
}

#[test]
fn nothing_is_driven_before_the_hand_is_known() {
    let mut hand = Hand::new(&HandConfig::default()).unwrap();
    let mut out = vec![];
    assert_eq!(hand.torque(ms(0), &[100.0; JOINTS], &mut out), [0; JOINTS]);
    assert!(out.is_empty());
    hand.start(ms(0));
    for millis in 0..=2100 {
        let _ = hand.poll(ms(millis), &mut out);
        let before = out.len();
        assert_eq!(hand.torque(ms(millis), &[100.0; JOINTS], &mut out), [0; JOINTS]);
        assert_eq!(out.len(), before);
    }
    assert_eq!(hand.state(), HandState::Fault(HandFault::NoInformation));
    let torques =
        out.iter().filter_map(|frame| match HostMessage::decode(DeviceId::default(), frame).unwrap() {
            HostMessage::Torque { pwm, .. } => Some(pwm),
            HostMessage::ServoOn => panic!("switched on without an answer"),
            _ => None,
        });
    assert!(torques.into_iter().all(|pwm| pwm == [0; 4]));
}

#[test]
fn faults_while_starting() {
    let start = |change: &dyn Fn(&mut HandEmulatorConfig)| {
        let mut config = HandEmulatorConfig::default();
        change(&mut config);
        let mut bench = Bench::new(&HandConfig::default(), &config);
        bench.hand.start(Duration::ZERO);
        let fault = bench.fault();
        assert!(!bench.emulator.servo_on() && bench.emulator.pwm() == [0; JOINTS]);
        fault
    };
    assert_eq!(start(&|c| c.hardware = 0x0300), HandFault::WrongVersion { generation: 3 });
    // The other byte order of the version is not a v4 hand.
    assert_eq!(start(&|c| c.hardware = 0x0004), HandFault::WrongVersion { generation: 0 });
    assert_eq!(start(&|c| c.side = HandSide::Right), HandFault::WrongSide { found: HandSide::Right });
    assert_eq!(start(&|c| c.board_celsius = 71), HandFault::BoardHot { celsius: 71, limit: 70 });
    assert_eq!(start(&|c| c.joint_celsius[6] = 66), HandFault::JointHot { joint: 6, celsius: 66, limit: 65 });
    assert_eq!(start(&|c| c.fault_bits = 0b1_0110), HandFault::Reported { bits: 0b1_0110 });
    assert_eq!(start(&|c| c.device_id = DeviceId::new(1).unwrap()), HandFault::NoInformation);

    // The servo stays off: ON does not arrive.
    let mut bench = Bench::default();
    bench.heard = Box::new(|_, frame| frame.id() != 0x100);
    bench.start();
    assert_eq!(bench.hand.state(), HandState::Fault(HandFault::ServoOff), "and never ready before");
    assert!(bench.now > ms(2000), "{:?}", bench.now);
    // The positions of one finger never come, or those of all.
    for (id, finger) in [(0x84, 1), (0x80, 0)] {
        let mut bench = Bench::default();
        bench.arrives = Box::new(move |_, frame| frame.id() != id);
        bench.hand.start(Duration::ZERO);
        let fault = bench.fault();
        assert!(matches!(fault, HandFault::PositionsStale { finger: f, .. } if f == finger), "{fault:?}");
    }
}

/// Whatever frame of the start is lost, it is said again; nothing but zeros before the hand is ready.
#[test]
fn a_lost_frame_costs_no_start() {
    for lost in [0x104, 0x180, 0x200, 0x204, 0x100] {
        let mut bench = Bench::default();
        let mut once = false;
        // The first frame with this identifier once the hand has answered, or the first of all.
        bench.heard = Box::new(move |now, frame| {
            let late = matches!(lost, 0x100 | 0x204) && now < ms(40);
            let this = frame.id() == lost && !once && !late;
            once |= this;
            !this
        });
        bench.start();
        assert_eq!(bench.hand.state(), HandState::Ready, "{lost:#x}");
        assert!(bench.now < ms(300), "{lost:#x}: {:?}", bench.now);
    }
    // A third of all frames both ways, for as long as the start takes.
    let mut ready = 0;
    for seed in 0..50 {
        let mut bench = Bench::new(
            &HandConfig { stale_after_secs: 0.1, ..HandConfig::default() },
            &HandEmulatorConfig::default(),
        );
        let mut random = Pcg64::seed_from_u64(seed);
        bench.heard = Box::new(move |_, _| random.random_bool(0.67));
        bench.hand.start(bench.now);
        while bench.hand.state() == HandState::Starting {
            bench.step();
            assert_eq!(bench.emulator.pwm(), [0; JOINTS]);
        }
        ready += u32::from(bench.hand.state() == HandState::Ready);
    }
    assert!(ready >= 49, "{ready} of 50");
}

#[test]
fn a_watchdog_bit_left_over_from_before_is_no_fault() {
    let config = HandEmulatorConfig { fault_bits: StatusBits::HOST_TIMEOUT, ..HandEmulatorConfig::default() };
    let mut bench = Bench::new(&HandConfig::default(), &config);
    bench.start();
    bench.run(ms(500));
    assert_eq!(bench.hand.state(), HandState::Ready);
    bench.emulator.config_mut().fault_bits = 0;
    bench.run(ms(200));
    bench.emulator.config_mut().fault_bits = StatusBits::HOST_TIMEOUT;
    assert_eq!(bench.fault(), HandFault::Reported { bits: StatusBits::HOST_TIMEOUT });
}

/// Runs a ready hand, applies a change, and gives the fault; the hand must have been let go at once and stay
/// so.
fn fault_after(change: impl FnOnce(&mut Bench)) -> HandFault {
    let mut bench = Bench::ready();
    bench.run(ms(300));
    bench.sent.clear();
    change(&mut bench);
    while bench.hand.state() == HandState::Ready && bench.now < ms(5000) {
        bench.step();
    }
    let HandState::Fault(fault) = bench.hand.state() else { panic!("{:?}", bench.hand.state()) };
    // At most one step between the fault and its frames: three times zero, then OFF.
    let at = bench.now;
    bench.step();
    let said = bench.said(at);
    let off = said.iter().position(|message| *message == HostMessage::ServoOff).unwrap();
    assert_eq!(said[..=off][off.saturating_sub(12)..off], zero_torques(3));
    let after = bench.now;
    bench.run(ms(1000));
    assert_eq!(bench.hand.state(), HandState::Fault(fault), "latched");
    // Again and again, and nothing else.
    let said = bench.said(after);
    assert_eq!(said.iter().filter(|message| **message == HostMessage::ServoOff).count(), 10);
    let is_release = |message: &HostMessage| match message {
        HostMessage::ServoOff | HostMessage::Request(Request::Information) => true,
        message => zero_torques(1).contains(message),
    };
    assert!(said.iter().all(is_release));
    let mut out = vec![];
    assert_eq!(bench.hand.torque(bench.now, &[100.0; JOINTS], &mut out), [0; JOINTS]);
    assert!(out.is_empty());
    assert!(!fault.to_string().is_empty());
    fault
}

#[test]
fn faults_while_running() {
    let stale = fault_after(|bench| bench.arrives = Box::new(|_, frame| frame.id() != 0x88));
    let HandFault::PositionsStale { finger: 2, age } = stale else { panic!("{stale:?}") };
    assert!((ms(15)..=ms(16)).contains(&age), "{age:?}");
    let silent = fault_after(|bench| bench.arrives = Box::new(|_, frame| frame.id() != 0x200));
    assert!(matches!(silent, HandFault::InformationStale { .. }), "{silent:?}");
    let off = fault_after(|bench| {
        let mut none = vec![];
        bench.emulator.receive(bench.now, &HostMessage::ServoOff.encode(DeviceId::default()), &mut none);
    });
    assert_eq!(off, HandFault::ServoOff);
    let hot = fault_after(|bench| bench.emulator.config_mut().board_celsius = 90);
    assert_eq!(hot, HandFault::BoardHot { celsius: 90, limit: 70 });
    let hot = fault_after(|bench| bench.emulator.config_mut().joint_celsius[13] = 80);
    assert_eq!(hot, HandFault::JointHot { joint: 13, celsius: 80, limit: 65 });
    let reported = fault_after(|bench| bench.emulator.config_mut().fault_bits = StatusBits::INTERNAL);
    assert_eq!(reported, HandFault::Reported { bits: StatusBits::INTERNAL });
    // Another hand is plugged in.
    let other = fault_after(|bench| bench.emulator.config_mut().side = HandSide::Right);
    assert_eq!(other, HandFault::WrongSide { found: HandSide::Right });
    // The cable of the whole bus.
    let cut = fault_after(|bench| bench.arrives = Box::new(|_, _| false));
    assert!(matches!(cut, HandFault::PositionsStale { .. }), "{cut:?}");
}

#[test]
fn a_hand_that_ignores_off_is_let_go_all_the_same() {
    let config = HandEmulatorConfig { off_cuts: false, ..HandEmulatorConfig::default() };
    let mut bench = Bench::new(&HandConfig::default(), &config);
    bench.start();
    bench.run(ms(20));
    assert_ne!(bench.emulator.pwm(), [0; JOINTS]);
    bench.arrives = Box::new(|_, _| false);
    // The frames of the fault are lost too; the repeats are not.
    bench.heard = Box::new(|now, _| now > ms(300));
    bench.run(ms(200));
    assert!(matches!(bench.hand.state(), HandState::Fault(_)));
    assert_ne!(bench.emulator.pwm(), [0; JOINTS], "the last torque is held");
    bench.run(ms(200));
    assert_eq!((bench.emulator.pwm(), bench.emulator.servo_on()), ([0; JOINTS], true));
}

/// A finger's position frames with one joint replaced.
fn with_joint(hand: &mut Hand, now: Duration, counts: [i16; 4]) -> HandState {
    let message = HandMessage::Position { finger: Finger::Middle, counts };
    let _ = hand.receive(now, &message.encode(DeviceId::default()));
    hand.state()
}

#[test]
fn encoders_that_cannot_be_right() {
    let mut bench = Bench::ready();
    bench.run(ms(1500));
    let rest = bench.hand.positions();
    let counts: [i16; 4] = std::array::from_fn(|joint| counts_from_rad(rest[4 + joint]));
    // One wild reading is left out, and so are two.
    let mut hand = bench.hand.clone();
    for (after, wild) in [(3, 25_000), (6, -20_000)] {
        let now = bench.now + ms(after);
        assert_eq!(with_joint(&mut hand, now, [counts[0], counts[1], wild, counts[3]]), HandState::Ready);
        assert!((hand.positions()[6] - rest[6]).abs() < 1e-3);
    }
    assert_eq!(with_joint(&mut hand, bench.now + ms(9), counts), HandState::Ready);
    // Three in a row are a fault: outside the stops, or a jump.
    for (wild, range) in [(32_000, true), (counts[2] - 9000, false)] {
        let mut hand = bench.hand.clone();
        for n in 1..=3 {
            with_joint(&mut hand, bench.now + ms(3 * n), [counts[0], counts[1], wild, counts[3]]);
        }
        match hand.state() {
            HandState::Fault(HandFault::EncoderRange { joint: 6, rad }) if range => assert!(rad > 2.8),
            HandState::Fault(HandFault::EncoderJump { joint: 6, jump_rad, within }) if !range => {
                assert!((jump_rad + 0.8).abs() < 0.01 && within <= ms(12), "{jump_rad} {within:?}");
            }
            state => panic!("{state:?}"),
        }
        assert!((hand.positions()[6] - rest[6]).abs() < 1e-3, "the last believed angle stands");
    }
    // The fastest motion that any source knows, two periods delivered at once, is believed.
    let mut hand = bench.hand.clone();
    for n in 1..=10i16 {
        let now = bench.now + ms(6 * (n as u64).div_ceil(2));
        with_joint(&mut hand, now, [counts[0], counts[1], counts[2] + n * counts_from_rad(0.039), counts[3]]);
    }
    assert_eq!(hand.state(), HandState::Ready);
    let shift = hand.positions()[6] - rest[6];
    assert!((shift - 0.39).abs() < 2e-3, "every reading counted: {shift}");
}

#[test]
fn a_torque_that_nobody_renews_is_not_held() {
    let mut bench = Bench::ready();
    bench.run(ms(10));
    assert_ne!(bench.emulator.pwm(), [0; JOINTS]);
    bench.attended = false;
    let from = bench.now;
    bench.run(ms(60));
    assert_eq!((bench.emulator.pwm(), bench.hand.state()), ([0; JOINTS], HandState::Ready));
    let torques =
        bench.said(from + TICK).into_iter().filter(|said| matches!(said, HostMessage::Torque { .. }));
    assert_eq!(torques.collect::<Vec<_>>(), zero_torques(1), "once");
}

#[test]
fn what_was_sent_is_said_and_within_the_table() {
    let mut config = HandConfig::default();
    config.pwm_limit[2] = 10;
    let mut bench = Bench::new(&config, &HandEmulatorConfig::default());
    bench.start();
    let mut wanted = [1e9; JOINTS];
    (wanted[0], wanted[1], wanted[3], wanted[4], wanted[5]) = (f64::NAN, -1e9, f64::INFINITY, -3.99, 374.99);
    let mut out = vec![];
    let sent = bench.hand.torque(bench.now, &wanted, &mut out);
    let mut allowed = PWM_LIMITS;
    (allowed[0], allowed[1], allowed[2], allowed[3], allowed[4], allowed[5]) = (0, -675, 10, 0, -3, 374);
    assert_eq!(sent, allowed);
    let mut on_wire = vec![];
    for frame in &out {
        if let Some(HostMessage::Torque { pwm, .. }) = HostMessage::decode(DeviceId::default(), frame) {
            on_wire.extend(pwm);
        }
    }
    assert_eq!(on_wire, sent);
}

/// Frames that a hand, a host or a broken bus could send: identifiers mostly with a meaning, and this share
/// of them with any bytes, the others with some that let a driver go on.
fn random_frame(random: &mut Pcg64, hostile: f64) -> CanFrame {
    let known = [
        0x100, 0x104, 0x180, 0x184, 0x188, 0x18C, 0x204, 0x200, 0x220, 0x80, 0x84, 0x88, 0x8C, 0xC0, 0xE0,
        0xE4, 0x40,
    ];
    let known = known[random.random_range(0..known.len())];
    let wild = random.random_bool(hostile);
    let id = if wild && random.random_bool(0.1) { random.random_range(0..=CanFrame::MAX_ID) } else { known };
    if random.random_bool(0.1) {
        return CanFrame::remote(id).unwrap();
    }
    let small = random.random_range(0..100);
    let (data, len) = match id {
        _ if wild => (random.random(), random.random_range(0..=8)),
        0x200 => ([0, 4, 1, 1, 1, 30, 1, 0], 7),
        0xE0 | 0xE4 => ([30; 8], 4),
        0x80..=0x8C => ([small, 0, small, 0, small, 0, small, 0], 8),
        0x204 => ([3, 0, 0, 0, 0, 0, 0, 0], 6),
        0x100 | 0x104 => ([0; 8], 0),
        _ => (random.random(), 8),
    };
    CanFrame::new(id, &data[..len]).unwrap()
}

fn within_the_table(first_joint: usize, pwm: &[i16]) -> bool {
    pwm.iter().zip(&PWM_LIMITS[first_joint..]).all(|(pwm, limit)| pwm.unsigned_abs() <= limit.unsigned_abs())
}

/// Half a million frames into a driver, and into an emulator that hears it too; any torques asked for; starts
/// and stops at any time. Gives how often the driver sent a torque.
fn storm(hostile: f64) -> u32 {
    let mut random = Pcg64::seed_from_u64(11);
    let config = HandEmulatorConfig { noise_counts: 100, ..HandEmulatorConfig::default() };
    let mut emulator = HandEmulator::new(&config);
    let mut hand = Hand::new(&HandConfig { stale_after_secs: 0.1, ..HandConfig::default() }).unwrap();
    let (mut now, mut driven) = (Duration::ZERO, 0);
    for _ in 0..500_000 {
        now += Duration::from_micros(random.random_range(0..300));
        let (mut to_host, mut to_hand) = (vec![random_frame(&mut random, hostile)], vec![]);
        emulator.receive(now, &to_host[0].clone(), &mut to_host);
        emulator.tick(now, &mut to_host);
        assert!(within_the_table(0, &emulator.pwm()));
        // Another program that drives the hand is a fault at once.
        let drives = |frame: &CanFrame| {
            HostMessage::decode(DeviceId::default(), frame).is_some_and(|message| message.drives())
        };
        for frame in to_host.iter().filter(|frame| hostile == 1.0 || !drives(frame)) {
            let _ = hand.receive(now, frame);
        }
        let _ = hand.poll(now, &mut to_hand);
        if !matches!(hand.state(), HandState::Starting | HandState::Ready) && random.random_bool(0.1) {
            hand.start(now);
        }
        if random.random_bool(0.0001) {
            hand.stop(now, &mut to_hand);
        }
        let wanted: [f64; JOINTS] = std::array::from_fn(|_| f64::from_bits(random.random()));
        let sent = hand.torque(now, &wanted, &mut to_hand);
        assert!(within_the_table(0, &sent));
        driven += u32::from(sent != [0; JOINTS]);
        for frame in to_hand {
            let message = HostMessage::decode(DeviceId::default(), &frame);
            if let Some(HostMessage::Torque { finger, pwm }) = message {
                assert!(within_the_table(4 * finger.number(), &pwm));
            }
            emulator.receive(now, &frame, &mut vec![]);
        }
    }
    driven
}

#[test]
fn a_million_random_frames_and_never_more_than_the_table() {
    let driven = [1.0, 0.1, 0.001].map(storm);
    // Anything at all stops it before long; what is almost right does not, and is driven.
    assert!(driven[0] < 1000 && driven[2] > 100_000, "{driven:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Any torques asked of a ready hand, any limits configured: the wire stays within both.
    #[test]
    fn no_request_passes_the_limits(
        wanted in prop::collection::vec(any::<[u64; JOINTS]>(), 20), shares in any::<[u8; JOINTS]>(),
    ) {
        let mut config = HandConfig::default();
        for (limit, share) in config.pwm_limit.iter_mut().zip(shares) {
            *limit = (i32::from(*limit) * i32::from(share) / 255) as i16;
        }
        let mut bench = Bench::new(&config, &HandEmulatorConfig::default());
        bench.attended = false;
        bench.start();
        for bits in wanted {
            let mut out = vec![];
            let sent = bench.hand.torque(bench.now, &bits.map(f64::from_bits), &mut out);
            prop_assert_eq!(out.len(), 4);
            let within = |(pwm, limit): (&i16, i16)| (-limit..=limit).contains(pwm);
            prop_assert!(sent.iter().zip(config.pwm_limit).all(within));
            let on_wire: Vec<u8> = out.iter().flat_map(|frame| frame.payload().to_vec()).collect();
            prop_assert_eq!(on_wire, sent.map(i16::to_le_bytes).concat());
        }
    }

    /// Wherever the joints are within their limits, the hand starts and its positions are right to a count.
    #[test]
    fn positions_are_those_of_the_joints(shares in any::<[u8; JOINTS]>()) {
        let mut bench = Bench::default();
        let pose = std::array::from_fn(|joint| {
            let [lower, upper] = JOINT_LIMITS_RAD[joint];
            lower + f64::from(shares[joint]) / 255.0 * (upper - lower)
        });
        bench.attended = false;
        bench.free.set_positions(&pose);
        bench.start();
        prop_assert_eq!(bench.hand.state(), HandState::Ready);
        prop_assert!(bench.hand.positions().iter().zip(pose).all(|(told, is)| (told - is).abs() < 1e-4));
    }
}
