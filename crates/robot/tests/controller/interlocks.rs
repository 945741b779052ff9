//! What keeps the hand from being dragged or thrown along the keyboard.

use etude_robot::joints::{DRIVEN, RAIL};
use etude_robot::xarm::kinematics::forward;
use etude_robot::{Phase, Record};

use crate::bench::Bench;

/// A stream that moves the hand along the keyboard by 0.25 m, faster than the limits allow, and
/// each set-point of the rail then, m.
fn rush(bench: &mut Bench) -> Vec<f64> {
    bench.follow(&[0.0; DRIVEN], 100);
    bench.records.clear();
    let mut pose = [0.0; DRIVEN];
    pose[RAIL] = 0.25;
    for _ in 0..12 {
        if bench.robot.phase() == Phase::Following {
            bench.robot.follow(bench.now(), &[pose; 10]).unwrap();
        }
        bench.run(50);
    }
    rail(bench)
}

/// The set-points of the rail that were recorded, m.
fn rail(bench: &Bench) -> Vec<f64> {
    let sent = |record: &Record| match record {
        Record::SetPoint { sent, .. } => Some(sent[RAIL]),
        _ => None,
    };
    bench.records.iter().filter_map(sent).collect()
}

fn fastest(places: &[f64]) -> f64 {
    places.windows(2).map(|pair| (pair[1] - pair[0]) / 0.005).fold(0.0, f64::max)
}

fn clamps(bench: &Bench, name: &str) -> usize {
    let is_it = |record: &&Record| match record {
        Record::SetPoint { clamps, .. } => {
            clamps.iter().any(|(joint, clamp)| *joint == RAIL && clamp.name() == name)
        }
        _ => false,
    };
    bench.records.iter().filter(is_it).count()
}

#[test]
fn while_a_key_is_down_the_hand_moves_slowly_along_the_keyboard() {
    let mut free = Bench::holding();
    let unbound = fastest(&rush(&mut free));
    assert!(unbound > 0.7, "{unbound} m/s");
    let mut bench = Bench::holding();
    bench.devices.keyboard.press(bench.now(), 20, 90);
    bench.run(20);
    let bound = fastest(&rush(&mut bench));
    assert!((0.37..0.47).contains(&bound), "{bound} m/s");
    assert!(clamps(&bench, "key-down") > 10 && clamps(&free, "key-down") == 0);
    // It gets there all the same.
    assert!((bench.robot.joints()[RAIL] - 0.25).abs() < 0.03, "{}", bench.robot.joints()[RAIL]);
    // A key that goes down on the way slows it from then on, within the acceleration limit.
    let mut late = Bench::holding();
    late.follow(&[0.0; DRIVEN], 100);
    let mut pose = [0.0; DRIVEN];
    pose[RAIL] = 0.3;
    late.robot.follow(late.now(), &[pose; 40]).unwrap();
    late.run(170);
    late.records.clear();
    late.devices.keyboard.press(late.now(), 20, 90);
    late.run(60);
    let places = rail(&late);
    let last = places.windows(2).last().map(|pair| (pair[1] - pair[0]) / 0.005).unwrap();
    assert!(fastest(&places) > 0.7 && last < 0.47, "{places:?}");
}

/// An arm that is held for a moment is not thrown after its set-points when it gets free.
#[test]
fn the_rail_waits_for_an_arm_that_is_held() {
    let mut bench = Bench::holding();
    bench.follow(&[0.0; DRIVEN], 100);
    let mut pose = [0.0; DRIVEN];
    pose[RAIL] = 0.3;
    bench.robot.follow(bench.now(), &[pose; 60]).unwrap();
    bench.run(90);
    bench.devices.arm.set_stuck(true);
    let held = forward(&bench.devices.arm.joints()).position_m;
    bench.run(95);
    assert_eq!(bench.robot.phase(), Phase::Following, "{}", bench.fault());
    let sent = forward(&bench.robot.arm().sent().unwrap()).position_m;
    let ahead_m = (sent - held).norm();
    // 60 mm, and the way on which it brakes.
    assert!((0.06..0.1).contains(&ahead_m), "{ahead_m} m");
    assert!(clamps(&bench, "ahead") > 3);
    let places = rail(&bench);
    let last = (places[places.len() - 1] - places[places.len() - 2]) / 0.005;
    assert!(last < 0.6 * fastest(&places), "{last} m/s at the end: it brakes");
    // It gets free and follows; and one that stays held is a fault.
    bench.devices.arm.set_stuck(false);
    bench.run(60);
    assert_eq!(bench.robot.phase(), Phase::Following, "{}", bench.fault());
    bench.devices.arm.set_stuck(true);
    bench.robot.follow(bench.now(), &[[0.0; DRIVEN]; 100]).unwrap();
    bench.until(Phase::Fault, 900);
    assert!(bench.fault().contains("arm"), "{}", bench.fault());
}
