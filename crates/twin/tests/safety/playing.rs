//! A robot that nobody disturbs.

use etude_emulators::faults::FaultPlan;
use etude_robot::joints::RAIL;
use etude_robot::xarm::ArmFault;
use etude_robot::{Doubt, Fault, Phase};
use etude_twin::{Truth, calibration};

use crate::bench::{Bench, Policy, start_pose, with_links};

#[test]
fn it_starts_goes_to_the_keyboard_and_follows() {
    let mut bench = Bench::new(&Truth::load("standard").unwrap(), &calibration("twin"));
    bench.start_and_hold();
    let mut pose = start_pose();
    pose[RAIL] = 0.05;
    bench.robot.home(bench.now(), &pose).unwrap();
    bench.until_phase(Phase::Holding, 60_000);
    println!("at the keyboard at {:?}", bench.now());
    assert!((bench.robot.joints()[RAIL] - 0.05).abs() < 1e-3);
    bench.follow(Policy::Smooth);
    bench.run(500);
    let clamped = bench.robot.clamped();
    bench.run(2000);
    assert_eq!(bench.robot.phase(), Phase::Following, "{:?}", bench.robot.fault());
    // The policy keeps the limits: once the way to where it begins is made up, nothing of it may be changed.
    assert_eq!(bench.robot.clamped(), clamped);
    let world = bench.lockstep.twin.joints()[RAIL];
    assert!((world - bench.robot.joints()[RAIL]).abs() < 0.01, "{world}");
    println!("{} frames, {} targets", bench.judge.frames, bench.judge.targets);
}

/// Slow replies slow the arm a little; ones with which it cannot keep up are a fault, and do not leave the hand behind.
#[test]
fn an_arm_that_replies_late_follows_or_stops() {
    // One way.
    for (delay_secs, follows) in [(0.003, true), (0.0065, false)] {
        let arm = FaultPlan { delay_secs, ..FaultPlan::default() };
        let none = FaultPlan::default();
        let truth = with_links(&none, &arm, &none);
        let mut bench = Bench::new(&truth, &calibration("twin"));
        bench.start_and_hold();
        bench.robot.home(bench.now(), &start_pose()).unwrap();
        if follows {
            bench.until_phase(Phase::Holding, 60_000);
        } else {
            bench.until_phase(Phase::Fault, 3000);
            let late = matches!(bench.robot.fault(), Some(Fault::Arm(ArmFault::LateReplies)));
            assert!(late, "{:?}", bench.robot.fault());
            bench = Bench::at_the_keyboard(&truth);
            bench.start_and_hold();
        }
        bench.follow(Policy::Smooth);
        for _ in 0..60 {
            bench.run(50);
            let [world, set] = [bench.lockstep.twin.joints()[RAIL], bench.robot.joints()[RAIL]];
            assert!((world - set).abs() < 0.15, "{delay_secs} s: {world}, {set}");
        }
        assert_eq!(
            bench.robot.phase() == Phase::Following,
            follows,
            "{delay_secs} s: {:?}",
            bench.robot.fault()
        );
        if !follows {
            let away = matches!(bench.robot.fault(), Some(Fault::Doubted(Doubt::ArmAway { .. })));
            assert!(away, "{:?}", bench.robot.fault());
        }
    }
}
