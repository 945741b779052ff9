//! Wires that come back, devices that are not there, and what an operator may ask at the wrong
//! time.

use std::time::Duration;

use etude_robot::joints::{DRIVEN, RAIL};
use etude_robot::xarm::ArmState;
use etude_robot::{Phase, Refused};
use etude_twin::{FaultKind, TwinParams, calibration};

use crate::bench::Bench;
use crate::policy::Policy;

fn twin_params() -> TwinParams {
    TwinParams::load("mild").unwrap()
}

fn following() -> Bench {
    let mut bench = Bench::at_the_keyboard(&twin_params());
    bench.start_and_hold();
    bench.follow(Policy::Smooth);
    bench.run(300);
    bench
}

/// A bench whose arm is on its own way to the keyboard.
fn homing() -> Bench {
    let mut bench = Bench::new(&twin_params(), &calibration("twin"));
    bench.start_and_hold();
    bench.robot.home(bench.now(), &[0.0; DRIVEN]).unwrap();
    assert!(bench.until(5000, |b| b.judge.targets > 0).is_some());
    bench.run(100);
    bench
}

#[test]
fn a_hand_whose_bus_comes_back_is_let_go_without_being_asked() {
    let mut bench = following();
    bench.begin(FaultKind::CanBusOff);
    bench.run(1000);
    assert!(!bench.hand_is_free(), "the test wants a hand that holds a torque");
    bench.end(FaultKind::CanBusOff);
    let took = bench.until(150, Bench::hand_is_off);
    assert!(took.is_some(), "the hand still holds {:?}", bench.lockstep.twin.devices.hand.pwm());
    assert_eq!(bench.robot.phase(), Phase::Fault);
}

#[test]
fn an_arm_whose_link_comes_back_is_stopped_without_being_asked() {
    let mut bench = homing();
    bench.begin(FaultKind::ArmDisconnect);
    bench.run(200);
    assert!(!bench.arm_is_stopped(), "the test wants an arm that goes on with its move");
    // The hand's bus is dead as well, and stays so.
    bench.begin(FaultKind::CanBusOff);
    bench.run(10);
    bench.end(FaultKind::ArmDisconnect);
    assert!(
        bench.until(20, Bench::arm_is_stopped).is_some(),
        "state {}",
        bench.lockstep.twin.devices.arm.state()
    );
    bench.run(1000);
    assert!(bench.arm_is_stopped());
    assert_eq!(bench.robot.phase(), Phase::Fault);
}

/// A stop is said until it must have been heard.
#[test]
fn a_bus_that_loses_half_of_its_frames_carries_a_stop_all_the_same() {
    let mut slowest = 0;
    for round in 0..8 {
        let mut bench = following();
        // The same dice fall otherwise after other times.
        bench.run(3 * round);
        bench.mischief.frame_loss = 0.5;
        bench.stop();
        let took = bench.until(1500, Bench::hand_is_off);
        slowest = slowest.max(took.unwrap_or_else(|| panic!("round {round}: the hand was never let go")));
        bench.run(300);
        assert!(bench.hand_is_off());
    }
    println!("half of the frames lost: the hand was off after {slowest} ms at the latest");
}

#[test]
fn a_keyboard_that_is_not_there_is_a_fault_that_says_so() {
    let mut bench = Bench::at_the_keyboard(&twin_params());
    let mut bench = {
        // Nobody has seen the keyboard yet.
        bench.begin(FaultKind::KeyboardUnplugged);
        bench.robot = crate::bench::robot(&calibration("twin"));
        bench
    };
    bench.start();
    bench.until_phase(Phase::Fault, 3000);
    let fault = bench.robot.fault().unwrap().to_string();
    assert!(fault.contains("plug it in"), "{fault}");
    bench.run(20);
    assert!(bench.hand_is_off() && bench.arm_is_stopped());
    bench.end(FaultKind::KeyboardUnplugged);
    bench.run(20);
    bench.start_and_hold();
}

/// The serial number of the arm is read while it starts: nothing may move before it is known.
#[test]
fn another_arm_than_the_calibrations_never_moves() {
    let mut other = calibration("twin");
    other.arm_serial = "XS130424A01A09".into();
    let mut bench = Bench::new(&twin_params(), &other);
    bench.start();
    bench.until_phase(Phase::Fault, 3000);
    let fault = bench.robot.fault().unwrap().to_string();
    assert!(fault.contains("XS130424A01A09") && fault.contains("calibrate again"), "{fault}");
    bench.run(20);
    assert!(bench.hand_is_off() && bench.arm_is_stopped());
    assert_eq!((bench.judge.targets, bench.judge.set_points), (0, 0));
}

#[test]
fn the_first_fault_stays() {
    let mut bench = following();
    bench.lockstep.twin.devices.hand.config_mut().board_celsius = 80;
    bench.until_phase(Phase::Fault, 150);
    let first = bench.robot.fault().unwrap().to_string();
    bench.lockstep.twin.devices.arm.inject_error(31);
    bench.begin(FaultKind::KeyboardUnplugged);
    bench.begin(FaultKind::CanBusOff);
    bench.run(300);
    assert_eq!(bench.robot.fault().unwrap().to_string(), first);
    bench.stop();
    assert_eq!(bench.robot.phase(), Phase::Fault, "a stop does not hide a fault");
}

/// Only a stop ends a move that the arm planned itself.
#[test]
fn it_never_holds_while_the_arm_moves() {
    let mut bench = homing();
    bench.robot.hold(bench.now());
    while bench.robot.phase() != Phase::Holding {
        assert_eq!(bench.robot.phase(), Phase::Moving, "{:?}", bench.notes);
        bench.step();
        assert!(bench.now() < Duration::from_secs(60));
    }
    assert_eq!(bench.robot.arm().state(), ArmState::Ready);
    let joints = bench.lockstep.twin.devices.arm.joints();
    bench.run(200);
    let moved = joints.iter().zip(bench.lockstep.twin.devices.arm.joints()).map(|(a, b)| (a - b).abs());
    assert!(moved.fold(0.0, f64::max) < 1e-3);
}

#[test]
fn goals_that_are_no_poses_are_refused_or_brought_within_the_limits() {
    let mut bench = Bench::at_the_keyboard(&twin_params());
    bench.start_and_hold();
    for joint in [0, 7, RAIL] {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut goal = bench.robot.joints();
            goal[joint] = value;
            assert!(bench.robot.approach(bench.now(), &goal).is_err(), "{value} for joint {joint}");
            assert!(bench.robot.home(bench.now(), &goal).is_err(), "{value} for joint {joint}");
            assert!(bench.robot.follow(bench.now(), &[goal; 10]).is_err(), "{value} for joint {joint}");
            assert_eq!(bench.robot.phase(), Phase::Holding);
        }
    }
    let mut goal = bench.robot.joints();
    goal[RAIL] = -1e12;
    bench.robot.approach(bench.now(), &goal).unwrap();
    bench.until_phase(Phase::Holding, 30_000);
    assert!((bench.robot.joints()[RAIL] + 0.337).abs() < 2e-3, "{}", bench.robot.joints()[RAIL]);
}

/// A stretch that begins far ahead would otherwise stand for ever.
#[test]
fn a_stream_from_the_future_does_not_silence_the_watchdog() {
    for ahead in [Duration::from_secs(3600), Duration::MAX] {
        let mut bench = following();
        bench.policy = Policy::Silent;
        let (begun, pose) = (bench.now().saturating_add(ahead), bench.robot.joints());
        bench.robot.follow(begun, &[pose; 10]).unwrap();
        bench.until_phase(Phase::Fault, 1000);
        assert!(bench.robot.fault().unwrap().to_string().contains("no new command"));
    }
}

#[test]
fn what_is_asked_at_the_wrong_time_is_refused_and_moves_nothing() {
    let mut bench = Bench::new(&twin_params(), &calibration("twin"));
    let pose = [0.0; DRIVEN];
    let refused = |bench: &mut Bench, place: &str| {
        let now = bench.now();
        let asked = [bench.robot.follow(now, &[pose; 10]), bench.robot.approach(now, &pose)];
        for answer in asked {
            assert!(answer.is_err(), "{place}");
        }
    };
    refused(&mut bench, "off");
    bench.start();
    bench.run(15);
    refused(&mut bench, "starting");
    bench.until_phase(Phase::Holding, 3000);
    // The arm is not at the keyboard.
    refused(&mut bench, "away from the keyboard");
    assert_eq!(bench.judge.targets, 0);
    bench.robot.home(bench.now(), &pose).unwrap();
    bench.run(1000);
    refused(&mut bench, "homing");
    assert!(matches!(bench.robot.home(bench.now(), &pose), Err(Refused::Phase { .. })));
    bench.stop();
    let targets = bench.judge.targets;
    refused(&mut bench, "stopped");
    bench.run(100);
    assert_eq!(bench.judge.targets, targets);
}
