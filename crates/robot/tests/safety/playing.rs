//! A robot that nobody disturbs.

use std::time::Duration;

use etude_emulators::ReportKind;
use etude_robot::Phase;
use etude_robot::joints::RAIL;
use etude_twin::{TwinParams, calibration};
use proptest::prelude::*;

use crate::bench::{Bench, start_pose};
use crate::policy::Policy;

#[test]
fn it_starts_goes_to_the_keyboard_and_follows() {
    // Whichever port the arm's reports come from.
    for reports in [ReportKind::Real, ReportKind::Control] {
        let mut bench = Bench::new(&TwinParams::load("mild").unwrap(), &calibration("twin"));
        bench.lockstep.reports = reports;
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
        // The policy keeps the limits: once the way to where it begins is made up, nothing of it
        // may be changed.
        assert_eq!(bench.robot.clamped(), clamped);
        let world = bench.lockstep.twin.joints()[RAIL];
        assert!((world - bench.robot.joints()[RAIL]).abs() < 0.01, "{world}");
        println!("{} frames, {} targets", bench.judge.frames, bench.judge.targets);
    }
}

/// Whatever rig it is, within the ranges of docs/twin.md: its controller brings it to the keyboard
/// and it follows a policy along the whole of it.
#[test]
fn every_rig_that_is_drawn_starts_and_follows() {
    let drawn = (1..=20).map(|seed| format!("random:{seed}"));
    for name in ["standard", "worn"].map(str::to_string).into_iter().chain(drawn) {
        let twin_params = TwinParams::load(&name).unwrap();
        let mut bench = Bench::with_rig(&twin_params.rig(), &twin_params, &calibration("twin"));
        bench.start_and_hold();
        bench.robot.home(bench.now(), &start_pose()).unwrap();
        bench.until_phase(Phase::Holding, 60_000);
        for policy in [Policy::Smooth, Policy::Sweeps] {
            bench.follow(policy);
            bench.run(3000);
            assert_eq!(bench.robot.phase(), Phase::Following, "{name}: {:?}", bench.robot.fault());
        }
        let moved = bench.lockstep.twin.joints()[RAIL] - bench.robot.joints()[RAIL];
        assert!(moved.abs() < 0.08, "{name}: the hand is {moved} m from its set-point");
    }
}

/// By the wall clock a command comes a millisecond or more after its control step has begun, while
/// the grid of the set-points has any phase.
#[test]
fn a_command_that_comes_within_a_set_point_changes_nothing() {
    for (phase, late) in [(0, 0), (0, 2), (1, 1), (2, 2), (3, 2), (4, 4)] {
        let mut bench = Bench::at_the_keyboard(&TwinParams::load("mild").unwrap());
        bench.start_and_hold();
        bench.run(100 + phase);
        let (begun, from) = (bench.now(), bench.robot.joints());
        bench.run(late);
        let before = bench.robot.clamped();
        for step in 0..40 {
            let waypoints: Vec<_> = (1..=10)
                .map(|n| {
                    let secs = 0.05 * f64::from(step) + 0.005 * f64::from(n);
                    let mut pose = from;
                    pose[RAIL] += 0.1 * (1.0 - (1.5 * secs).cos());
                    pose
                })
                .collect();
            bench.robot.follow(begun + Duration::from_millis(50) * step, &waypoints).unwrap();
            bench.run(50);
        }
        assert_eq!(bench.robot.phase(), Phase::Following, "{:?}", bench.robot.fault());
        // A waypoint that is skipped and one that is repeated would ask for more than the rail's
        // acceleration.
        let clamped = bench.robot.clamped() - before;
        // The first one is from rest.
        assert!(clamped <= 1, "grid {phase} ms, command {late} ms late: {clamped}");
    }
}

/// All replies of the arm are held back once, and then come together. The judge looks at each
/// target that is sent afterwards.
#[test]
fn replies_that_were_held_back_make_no_leap() {
    println!("| held back | on the way | moving | playing |\n|---|---|---|---|");
    for held_ms in (30..=240).step_by(30) {
        let mut cells = Vec::new();
        for phase in 0..3 {
            let mut bench = Bench::new(&TwinParams::load("mild").unwrap(), &calibration("twin"));
            let mut pose = start_pose();
            pose[RAIL] = 0.2;
            if phase == 0 {
                bench.start_and_hold();
                bench.robot.home(bench.now(), &pose).unwrap();
                bench.run(3000);
            } else {
                bench.place_arm_at_the_keyboard();
                bench.start_and_hold();
                if phase == 1 {
                    bench.robot.approach(bench.now(), &pose).unwrap();
                    bench.run(1500);
                } else {
                    bench.follow(Policy::Smooth);
                    // The waves along the keyboard are fastest then.
                    bench.run(1050);
                }
            }
            (bench.judge.worst_step_m, bench.judge.worst_m_s2) = (0.0, 0.0);
            let targets = bench.judge.targets;
            bench.hold_replies(held_ms);
            bench.run(400);
            assert!(bench.judge.targets > targets, "nothing was sent afterwards");
            let (step_mm, m_s2) = (bench.judge.worst_step_m * 1e3, bench.judge.worst_m_s2);
            let ends = if bench.robot.phase() == Phase::Fault { ", fault" } else { "" };
            cells.push(format!("{step_mm:.1} mm, {m_s2:.1} m/s²{ends}"));
        }
        println!("| {held_ms} ms | {} |", cells.join(" | "));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, max_shrink_iters: 100, ..ProptestConfig::default() })]

    /// The same for any delays, one after the other, at the greatest speed that the limits allow.
    #[test]
    fn no_delays_of_replies_make_a_leap(
        policy in prop_oneof![Just(Policy::Sweeps), Just(Policy::Jumps)],
        delays in prop::collection::vec((1_u32..260, 1_u32..300), 1..8),
    ) {
        let mut bench = Bench::at_the_keyboard(&TwinParams::load("mild").unwrap());
        bench.start_and_hold();
        bench.follow(policy);
        bench.run(200);
        for (held_ms, then_ms) in delays {
            bench.hold_replies(held_ms);
            let targets = bench.judge.targets;
            bench.run(then_ms);
            let sends = bench.robot.phase() != Phase::Following || then_ms < 20 || bench.judge.targets > targets;
            prop_assert!(sends, "nothing was sent after {held_ms} ms");
        }
    }
}
