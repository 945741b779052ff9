//! The same seed gives the same run, whatever the wires do.

use std::time::{Duration, Instant};

use etude_emulators::faults::FaultPlan;
use etude_robot::{Pace as _, Phase, Record};
use etude_twin::{Lockstep, Twin, TwinParams, calibration};

use crate::bench::{Bench, rig, robot, with_links};
use crate::dice::Dice;
use crate::policy::Policy;

fn twin_params(seed: u64) -> TwinParams {
    let late = FaultPlan { delay_secs: 0.0005, jitter_secs: 0.002, ..FaultPlan::default() };
    let can = FaultPlan { loss: 0.03, duplicate: 0.03, reorder: 0.03, ..late.clone() };
    let midi = FaultPlan { loss: 0.02, truncate: 0.02, ..late.clone() };
    with_links(&can, &late, &midi).with_seed_added(seed)
}

/// Everything that was recorded in a few seconds of playing, and how many of them passed in one of
/// the wall's.
fn run(seed: u64) -> (Vec<String>, f64) {
    let twin_params = twin_params(seed);
    let twin = Twin::new(&twin_params, rig().hand.side).unwrap();
    let mut pace = Lockstep::new(twin).unwrap();
    let mut robot = robot(&calibration("twin"));
    let begun = Instant::now();
    let mut records = Vec::new();
    let mut take = |robot: &mut etude_robot::Robot| {
        // As text: a NaN that was asked for is not equal to itself.
        records.extend(robot.records().map(|record: Record| format!("{record:?}")));
    };
    robot.start(pace.now());
    let mut homed = false;
    let mut dice = Dice::new(7);
    for _ in 0..300 {
        let next = pace.now() + Duration::from_millis(50);
        if robot.phase() == Phase::Holding && !homed {
            homed = true;
            robot.home(pace.now(), &[0.0; 13]).unwrap();
        } else if matches!(robot.phase(), Phase::Holding | Phase::Following) {
            let mut waypoints = [robot.joints(); 10];
            waypoints.iter_mut().flatten().for_each(|value| *value += 0.01 * dice.signed());
            waypoints[3][5] = f64::NAN;
            waypoints[0] = robot.joints();
            robot.follow(pace.now(), &waypoints).unwrap();
        }
        pace.run_until(&mut robot, next);
        take(&mut robot);
    }
    assert_eq!(robot.phase(), Phase::Following, "{:?}", robot.fault());
    (records, pace.now().as_secs_f64() / begun.elapsed().as_secs_f64())
}

#[test]
fn the_same_seed_gives_the_same_records() {
    let (first, ratio) = run(3);
    let (second, _) = run(3);
    println!("{} records; virtual time ran {ratio:.0} times as fast as the wall's", first.len());
    assert!(first.len() > 5000, "{}", first.len());
    let differs = first.iter().zip(&second).position(|(a, b)| a != b);
    assert_eq!((first.len(), differs), (second.len(), None));
    let (other, _) = run(4);
    assert_ne!(first, other);
}

/// Through a fault and out of it again, with somebody at the wires.
#[test]
fn the_same_mischief_gives_the_same_frames() {
    let run = || {
        let mut bench = Bench::at_the_keyboard(&twin_params(5));
        bench.start_and_hold();
        bench.follow(Policy::Jumps);
        bench.run(300);
        bench.lockstep.twin.devices.arm.inject_error(31);
        bench.run(300);
        bench.start_and_hold();
        bench.follow(Policy::Nonsense);
        bench.run(300);
        let joints = bench.lockstep.twin.joints().map(f64::to_bits);
        (bench.notes.clone(), joints, bench.judge.frames, bench.judge.targets)
    };
    assert_eq!(run(), run());
}
