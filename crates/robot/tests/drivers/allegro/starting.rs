//! The start, and what ends it.

use std::time::Duration;

use etude_emulators::HandEmulatorConfig;
use etude_robot::allegro::{
    DeviceId, Finger, Hand, HandConfig, HandFault, HandSide, HandState, HostMessage, Request, StatusBits,
    WIRE_JOINTS,
};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use super::{Bench, ms, zero_torques};

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
fn nothing_is_driven_before_the_hand_is_known() {
    let mut hand = Hand::new(&HandConfig::default()).unwrap();
    let mut out = vec![];
    assert_eq!(hand.send_pwm(ms(0), &[100.0; WIRE_JOINTS], &mut out), [0; WIRE_JOINTS]);
    assert!(out.is_empty());
    hand.start(ms(0));
    for millis in 0..=2100 {
        let _ = hand.poll(ms(millis), &mut out);
        let before = out.len();
        assert_eq!(hand.send_pwm(ms(millis), &[100.0; WIRE_JOINTS], &mut out), [0; WIRE_JOINTS]);
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
        assert!(!bench.emulator.servo_on() && bench.emulator.pwm() == [0; WIRE_JOINTS]);
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

/// Whatever frame of the start is lost, it is said again; nothing but zeros before the hand is
/// ready.
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
            assert_eq!(bench.emulator.pwm(), [0; WIRE_JOINTS]);
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
