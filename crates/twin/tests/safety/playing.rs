//! A robot that nobody disturbs.

use etude_robot::Phase;
use etude_robot::joints::RAIL;
use etude_twin::{Truth, calibration};

use crate::bench::{Bench, Policy, start_pose};

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
