//! A joint whose encoder or motor is wrong is found by a small turn of each, before anything is
//! played.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use etude_robot::joints::{DRIVEN, HAND_DRIVEN_JOINTS};
use etude_robot::{JOINTS_CHECKED, JointCheck, Pace as _, Phase, Robot, check_joints};
use etude_stage::Side;
use etude_stage::geometry::{BLACK, WHITE, key_lateral};
use etude_stage::hand::TIP_RADIUS;
use etude_stage::kinematics::reach;
use etude_twin::{FaultKind, Lockstep, Twin, TwinParams, calibration};

use crate::bench::{path, rig, robot, start_pose};

/// A twin that holds still where it is switched on, with a fault.
fn holding(twin_params: &str, fault: Option<FaultKind>) -> (Robot, Lockstep) {
    let twin = Twin::new(&TwinParams::load(twin_params).unwrap(), rig().hand.side).unwrap();
    let (mut robot, mut pace) = (robot(&calibration("twin")), Lockstep::new(twin).unwrap());
    if let Some(fault) = fault {
        pace.begin(fault);
    }
    robot.start(pace.now());
    settle(&mut robot, &mut pace);
    (robot, pace)
}

/// Lets time pass until the robot holds still.
fn settle(robot: &mut Robot, pace: &mut Lockstep) {
    while !matches!(robot.phase(), Phase::Holding | Phase::Fault) {
        let next = pace.now() + Duration::from_millis(10);
        pace.run_until(robot, next);
    }
    assert_eq!(robot.phase(), Phase::Holding, "{:?}", robot.fault());
}

fn checked(twin_params: &str, fault: Option<FaultKind>) -> (Vec<JointCheck>, Robot, Lockstep) {
    let (mut robot, mut pace) = holding(twin_params, fault);
    let found = check_joints(&mut robot, &mut pace, &AtomicBool::new(false)).unwrap();
    (found, robot, pace)
}

#[test]
fn every_joint_of_a_sound_hand_turns_and_the_arm_does_not() {
    for twin_params in ["ideal", "mild", "standard", "worn", "random:1"] {
        let before = holding(twin_params, None).1.twin.devices.arm.joints();
        let (found, robot, pace) = checked(twin_params, None);
        assert_eq!(found.len(), JOINTS_CHECKED, "{twin_params}: {:?}", robot.fault());
        for joint in &found {
            assert_eq!(joint.problem(), None, "{twin_params}: {joint:?}");
        }
        let least = found.iter().map(|joint| joint.turned_rad / joint.sent_rad).fold(f64::MAX, f64::min);
        println!("{twin_params}: each joint turned by at least {:.0} % of what it was sent", 100.0 * least);
        assert_eq!(robot.phase(), Phase::Holding);
        let moved = before.iter().zip(pace.twin.devices.arm.joints()).map(|(a, b)| (a - b).abs());
        assert!(moved.fold(0.0, f64::max) < 1e-9, "{twin_params}: the arm moved");
    }
}

/// A robot that was homed and released over the keys, onto which its fingers have sunk, and that
/// holds still again.
fn sunk(twin_params: &str) -> (Robot, Lockstep) {
    let (mut robot, mut pace) = holding(twin_params, None);
    homed(&mut robot, &mut pace, &start_pose());
    let now = pace.now();
    robot.stop(now, pace.wires());
    pace.run_until(&mut robot, now + Duration::from_secs(3));
    assert!(pace.twin.joints()[1] > 0.1, "{:?}", pace.twin.joints());
    robot.start(pace.now());
    settle(&mut robot, &mut pace);
    (robot, pace)
}

#[test]
fn fingers_that_have_sunk_onto_the_keys_turn_too() {
    for twin_params in ["standard", "worn", "random:1", "random:2", "random:3", "random:17"] {
        let (mut robot, mut pace) = sunk(twin_params);
        let found = check_joints(&mut robot, &mut pace, &AtomicBool::new(false)).unwrap();
        assert_eq!(found.len(), JOINTS_CHECKED, "{twin_params}: {:?}", robot.fault());
        for joint in &found {
            assert_eq!(joint.problem(), None, "{twin_params}: {joint:?}");
        }
    }
}

/// The middle finger stands on C beside C sharp: in its rotation at the palm it turns away from that
/// key only, which is not toward the middle of its range.
#[test]
fn a_finger_beside_a_black_key_turns_the_other_way() {
    const ROLL: usize = 4;
    let (mut robot, mut pace) = holding("standard", None);
    let now = pace.now();
    robot.stop(now, pace.wires());
    pace.twin.devices.arm.place(*path(&calibration("twin")).middle());
    // `standard` has its keyboard 2 mm toward the high notes and 1 mm lower.
    let beside = key_lateral(25) + 0.002 - BLACK.size[1] / 2.0 - TIP_RADIUS - 0.0005;
    let tip = [0.0, beside, WHITE.top() + TIP_RADIUS];
    let mut fingers = [0.0; HAND_DRIVEN_JOINTS];
    fingers[ROLL..ROLL + 4].copy_from_slice(&reach(Side::Left, 1, tip, 0.0).unwrap());
    pace.twin.place_fingers(&fingers);
    robot.start(pace.now());
    settle(&mut robot, &mut pace);
    let before = robot.hand().positions()[ROLL];
    let found = check_joints(&mut robot, &mut pace, &AtomicBool::new(false)).unwrap();
    assert_eq!(found.len(), JOINTS_CHECKED, "{:?}", robot.fault());
    assert!(found.iter().all(|joint| joint.problem().is_none()), "{found:?}");
    assert!(before > 0.0 && found[ROLL].sent_rad > 0.0, "from {before} rad: {:?}", found[ROLL]);
}

/// How far the arm has been off its path while the robot is homed, m.
fn homed(robot: &mut Robot, pace: &mut Lockstep, goal: &[f64; DRIVEN]) -> f64 {
    let path = path(&calibration("twin"));
    let mut farthest: f64 = 0.0;
    robot.home(pace.now(), goal).unwrap();
    while robot.phase() == Phase::Moving {
        let next = pace.now() + Duration::from_millis(10);
        pace.run_until(robot, next);
        farthest = farthest.max(path.place(&pace.twin.devices.arm.joints()).beside_m);
    }
    assert_eq!(robot.phase(), Phase::Holding, "{:?}", robot.fault());
    farthest
}

/// A hand that was released over the keys sinks onto them, and a fingertip may be caught before a
/// black key: the arm lifts it off.
#[test]
fn a_hand_that_has_sunk_onto_the_keys_is_homed() {
    let mut goal = start_pose();
    for finger in goal[..HAND_DRIVEN_JOINTS].chunks_exact_mut(4) {
        finger.copy_from_slice(&[0.0, 0.05, 0.15, 0.15]);
    }
    for twin_params in ["standard", "worn", "random:1", "random:2", "random:3"] {
        let (mut robot, mut pace) = sunk(twin_params);
        let lifted = homed(&mut robot, &mut pace, &goal);
        assert!(lifted > 0.07, "{twin_params}: {lifted} m");
        let again = homed(&mut robot, &mut pace, &goal);
        assert!(again < 0.005, "{twin_params}: the fingers are near, and the arm was {again} m off the keys");
        for (joint, goal) in goal[..HAND_DRIVEN_JOINTS].iter().enumerate() {
            let at = robot.hand().positions()[joint];
            assert!((at - goal).abs() < 0.1, "{twin_params}: joint {joint} is at {at} rad of {goal}");
        }
    }
}

#[test]
fn each_joint_that_is_wrong_is_named() {
    for joint in 0..JOINTS_CHECKED {
        let number = joint as u8;
        let (found, robot, _) = checked("mild", Some(FaultKind::JointDead(number)));
        let wrong: Vec<usize> =
            found.iter().filter(|joint| joint.problem().is_some()).map(|joint| joint.joint).collect();
        assert_eq!(
            (wrong, found.len(), robot.phase()),
            (vec![joint], JOINTS_CHECKED, Phase::Holding),
            "{found:?}"
        );
        assert!(found[joint].problem().unwrap().contains("did not turn"));
    }
    // The thumb's first joint would begin far outside its range: with that the robot does not
    // start.
    for joint in (0..JOINTS_CHECKED).filter(|joint| *joint != 12) {
        let (found, mut robot, mut pace) = checked("mild", Some(FaultKind::JointReversed(joint as u8)));
        match robot.fault() {
            // The emulated thumb has no friction: it runs away while other joints are turned.
            Some(fault) => assert!(joint > 12 && fault.to_string().contains(&format!("joint {joint} "))),
            None => {
                let last = found.last().unwrap();
                let problem = last.problem().unwrap_or_default();
                assert!(last.joint == joint && problem.contains("wrong direction"), "{joint}: {found:?}");
                assert_eq!(robot.phase(), Phase::Stopped);
                assert!(found[..joint].iter().all(|joint| joint.problem().is_none()), "{found:?}");
            }
        }
        // What the wire carries arrives within milliseconds.
        let soon = pace.now() + Duration::from_millis(20);
        pace.run_until(&mut robot, soon);
        assert!(!pace.twin.devices.hand.servo_on());
    }
}
