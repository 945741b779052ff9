//! What the controller makes of a hand that is elsewhere, does not follow, or is heard late.

use etude_robot::allegro::WIRE_JOINTS;
use etude_robot::{Fault, Implausible, Phase, Record, Refused};

use crate::bench::Bench;

#[test]
fn the_thumb_counts_where_a_stream_begins() {
    let mut bench = Bench::holding();
    let pose = bench.robot.joints();
    // Free, it stands 0.1 rad from where the rig's file wants it.
    bench.devices.guided[14] = Some(0.3);
    bench.run(10);
    let refused = bench.robot.follow(bench.now(), &[pose; 10]);
    assert!(matches!(refused, Err(Refused::FingerFar { joint: 14, .. })), "{refused:?}");
    bench.devices.guided[14] = Some(0.1);
    bench.run(10);
    bench.robot.follow(bench.now(), &[pose; 10]).unwrap();
}

#[test]
fn a_joint_far_outside_its_range_is_a_fault_before_any_torque() {
    let mut bench = Bench::new();
    bench.devices.guided[13] = Some(-0.105 - 0.12);
    bench.start();
    bench.until(Phase::Fault, 3000);
    assert!(matches!(bench.robot.fault(), Some(Fault::OutsideRange { joint: 13, .. })), "{}", bench.fault());
    assert!(bench.fault().contains("by hand"));
    assert!(!bench.records.iter().any(|record| matches!(record, Record::Hand { .. })));
}

/// From a little outside, the reference begins where the joint is, and goes slowly.
#[test]
fn a_joint_a_little_outside_its_range_is_brought_in_slowly() {
    let mut bench = Bench::new();
    bench.devices.guided[1] = Some(1.61 + 0.09);
    bench.start();
    bench.until(Phase::Holding, 3000);
    let begun = bench.now();
    bench.run(700);
    let mut before = 1.70;
    for record in &bench.records {
        let Record::Hand { at, positions, reference, wanted, .. } = record else { continue };
        assert!((reference[1] - before).abs() < 0.005, "{} at {at:?}", reference[1]);
        before = reference[1];
        if *at < begun + 20 * crate::bench::MS {
            assert!((reference[1] - positions[1]).abs() < 0.002 && wanted[1].abs() < 10.0, "{reference:?}");
        }
    }
    assert!((before - 1.61).abs() < 1e-9, "{before}");
}

/// A finger that is held while it should stay.
#[test]
fn a_finger_that_does_not_follow_is_a_fault() {
    // A joint that flexes, and one that only turns a little to the side: a quarter of the range of
    // each.
    for (finger, near, far) in [(5, 0.44, 0.47), (4, 0.22, 0.25)] {
        let mut bench = Bench::holding();
        bench.run(50);
        bench.guide(finger, near);
        bench.run(1000);
        assert_eq!(bench.robot.phase(), Phase::Holding, "{}", bench.fault());
        bench.guide(finger, far);
        bench.run(4970);
        assert_eq!(bench.robot.phase(), Phase::Holding, "{}", bench.fault());
        bench.until(Phase::Fault, 60);
        let fault = bench.robot.fault();
        assert!(
            matches!(fault, Some(Fault::NotFollowing { joint, .. }) if *joint == finger),
            "{}",
            bench.fault()
        );
        assert_eq!(bench.devices.hand.pwm(), [0; WIRE_JOINTS]);
    }
}

/// Starts the robot, guides joint 5 by 0.3 rad away from where it stood, and holds it there for
/// some seconds.
fn push_for(bench: &mut Bench, secs: u64) {
    bench.start();
    bench.until(Phase::Holding, 3000);
    bench.run(50);
    let away = if bench.robot.hand().positions()[5] < 0.2 { 0.3 } else { -0.3 };
    bench.guide(5, bench.robot.hand().positions()[5] + away);
    bench.run(1000 * secs);
}

/// What a motor has heated up by counts after a stop, until it has cooled down.
#[test]
fn a_joint_that_pushes_again_and_again_gets_hot() {
    let mut bench = Bench::new();
    push_for(&mut bench, 15);
    assert_eq!(bench.robot.phase(), Phase::Holding, "{}", bench.fault());
    assert_eq!(bench.devices.hand.pwm()[5], -675);
    bench.robot.stop(bench.now(), &mut bench.devices);
    bench.run(200);

    push_for(&mut bench, 1);
    assert_eq!(bench.robot.phase(), Phase::Holding, "{}", bench.fault());
    bench.until(Phase::Fault, 3000);
    let fault = bench.robot.fault();
    assert!(
        matches!(fault, Some(Fault::Implausible(Implausible::MotorHot { joint: 5, .. }))),
        "{}",
        bench.fault()
    );
    assert_eq!(bench.devices.hand.pwm(), [0; WIRE_JOINTS]);
    bench.run(200);
    assert!(!bench.devices.hand.servo_on());

    // At once after a fault there is little left; after a minute, nearly all.
    push_for(&mut bench, 4);
    assert_eq!(bench.robot.phase(), Phase::Fault);
    bench.run(60_000);
    push_for(&mut bench, 15);
    assert_eq!(bench.robot.phase(), Phase::Holding, "{}", bench.fault());
}

/// What the joint loop takes off for damping, from each period's record: wanted = kp (reference −
/// measured) − damping.
fn dampings(records: &[Record]) -> Vec<f64> {
    let kp = crate::bench::rig().joint_loop.kp[1];
    let damping = |record: &Record| match record {
        Record::Hand { positions, reference, wanted, .. } => {
            Some(kp * (reference[1] - positions[1]) - wanted[1])
        }
        _ => None,
    };
    records.iter().filter_map(damping).collect()
}

/// A finger at a steady 3 rad/s; for `stall` milliseconds nothing is heard of it, and then all at
/// once.
fn moving_finger(stall: u64, unpolled: bool) -> Vec<f64> {
    let mut bench = Bench::holding();
    bench.run(30);
    bench.records.clear();
    for millis in 0..200u32 {
        bench.devices.guided[1] = Some(-0.1 + 3e-3 * f64::from(millis));
        let stalled = (100..100 + stall).contains(&u64::from(millis));
        bench.devices.held = stalled;
        if stalled && unpolled {
            bench.pass();
        } else {
            bench.step();
        }
    }
    assert_eq!(bench.robot.phase(), Phase::Holding, "{}", bench.fault());
    dampings(&bench.records)
}

#[test]
fn angles_that_arrive_all_at_once_are_no_spike() {
    let twin_params = 120.0 * 3.0;
    let on_time = moving_finger(0, false);
    let settled = &on_time[20..];
    assert!(settled.iter().all(|damping| (damping - twin_params).abs() < 0.05 * twin_params), "{settled:?}");
    // 12 ms without a frame are borne; the controller itself may sleep for longer.
    for (stall, unpolled) in [(12, false), (12, true), (30, true), (31, true), (32, true)] {
        let late = moving_finger(stall, unpolled);
        let worst = late[20..].iter().fold(0.0f64, |most, damping| most.max((damping - twin_params).abs()));
        // How old the newest angles are is not known to better than a period.
        assert!(worst < 0.45 * twin_params, "{stall} ms, {unpolled}: {worst} off, {late:?}");
    }
}
