//! What keeps the hand from being dragged or thrown along the keyboard.

use etude_robot::allegro::tip_depths;
use etude_robot::joints::{DRIVEN, RAIL, to_wire};
use etude_robot::xarm::kinematics::forward;
use etude_robot::{Phase, ROOTS_OVER_KEYS_M, Record};

use crate::bench::Bench;

/// A stream that moves the hand along the keyboard by 0.25 m, faster than the limits allow, and
/// each set-point of the rail then, m.
fn rush(bench: &mut Bench) -> Vec<f64> {
    let mut pose = bench.robot.sent();
    bench.follow(&pose, 100);
    bench.records.clear();
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

/// The middle finger is bent to 5 mm below the tops of the white keys, sent straight down, and held
/// by the keys with its roll joint at `roll`.
fn with_a_held_finger(roll: f64) -> Bench {
    let mut bench = Bench::holding();
    let mut pose = [0.0; DRIVEN];
    bench.follow(&pose, 100);
    (pose[4], pose[6]) = (roll, 0.9);
    while tip_depths(&to_wire(&pose, &[0.0; 4]))[1] < ROOTS_OVER_KEYS_M + 0.005 {
        pose[5] += 0.001;
    }
    pose[4] = 0.0;
    bench.follow(&pose, 500);
    bench.guide(4, roll);
    bench
}

/// What is dragged is a finger among the keys that stays behind. One that comes along, and a hand
/// that goes back, are free.
#[test]
fn a_hand_does_not_drag_a_finger_to_its_stop() {
    let mut free = Bench::holding();
    let unbound = fastest(&rush(&mut free));
    assert!(unbound > 0.7 && clamps(&free, "dragging") == 0, "{unbound} m/s");
    for (roll, speeds) in [
        (0.05, 0.7..0.81),
        (-0.3, 0.7..0.81),
        // It could still be left behind by some 23 mm, in which the hand must be able to stop.
        (0.2, 0.1..0.5),
        (0.45, 0.0..0.001),
    ] {
        let mut bench = with_a_held_finger(roll);
        let fastest = fastest(&rush(&mut bench));
        assert!(speeds.contains(&fastest), "at {roll} rad: {fastest} m/s");
        assert_eq!(clamps(&bench, "dragging") > 10, fastest < 0.7, "at {roll} rad");
    }
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
