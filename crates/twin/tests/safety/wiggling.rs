//! A joint whose encoder or motor is wrong is found by a small turn of each, before anything is played.

use std::sync::atomic::AtomicBool;
use std::time::Duration;

use etude_robot::{Pace as _, Phase, Robot, WIGGLED, Wiggled, wiggle};
use etude_twin::{FaultKind, Lockstep, Truth, Twin, calibration};

use crate::bench::{rig, robot};

/// A twin that holds still where it is switched on, with a fault.
fn holding(truth: &str, fault: Option<FaultKind>) -> (Robot, Lockstep) {
    let twin = Twin::new(&Truth::load(truth).unwrap(), rig().hand.side).unwrap();
    let (mut robot, mut pace) = (robot(&calibration("twin")), Lockstep::new(twin).unwrap());
    if let Some(fault) = fault {
        pace.begin(fault);
    }
    robot.start(pace.now());
    while !matches!(robot.phase(), Phase::Holding | Phase::Fault) {
        let next = pace.now() + Duration::from_millis(10);
        pace.run_until(&mut robot, next);
    }
    assert_eq!(robot.phase(), Phase::Holding, "{:?}", robot.fault());
    (robot, pace)
}

fn wiggled(truth: &str, fault: Option<FaultKind>) -> (Vec<Wiggled>, Robot, Lockstep) {
    let (mut robot, mut pace) = holding(truth, fault);
    let found = wiggle(&mut robot, &mut pace, &AtomicBool::new(false)).unwrap();
    (found, robot, pace)
}

#[test]
fn every_joint_of_a_sound_hand_turns_and_the_arm_does_not() {
    for truth in ["ideal", "mild", "standard", "worn", "random:1"] {
        let before = holding(truth, None).1.twin.devices.arm.joints();
        let (found, robot, pace) = wiggled(truth, None);
        assert_eq!(found.len(), WIGGLED, "{truth}: {:?}", robot.fault());
        for joint in &found {
            assert_eq!(joint.problem(), None, "{truth}: {joint:?}");
        }
        let least = found.iter().map(|joint| joint.turned_rad / joint.sent_rad).fold(f64::MAX, f64::min);
        println!("{truth}: each joint turned by at least {:.0} % of what it was sent", 100.0 * least);
        assert_eq!(robot.phase(), Phase::Holding);
        let moved = before.iter().zip(pace.twin.devices.arm.joints()).map(|(a, b)| (a - b).abs());
        assert!(moved.fold(0.0, f64::max) < 1e-9, "{truth}: the arm moved");
    }
}

#[test]
fn each_joint_that_is_wrong_is_named() {
    for joint in 0..WIGGLED {
        let number = joint as u8;
        let (found, robot, _) = wiggled("mild", Some(FaultKind::JointDead(number)));
        let wrong: Vec<usize> =
            found.iter().filter(|joint| joint.problem().is_some()).map(|joint| joint.joint).collect();
        assert_eq!((wrong, found.len(), robot.phase()), (vec![joint], WIGGLED, Phase::Holding), "{found:?}");
        assert!(found[joint].problem().unwrap().contains("did not turn"));
    }
    // The thumb's first joint would begin far outside its range: with that the robot does not start.
    for joint in (0..WIGGLED).filter(|joint| *joint != 12) {
        let (found, mut robot, mut pace) = wiggled("mild", Some(FaultKind::JointReversed(joint as u8)));
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
