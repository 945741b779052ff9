//! How fast the joints move, and that they stand still when they should.

use etude_stage::geometry::HALF_WIDTH;
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::params::{JointRow, PhysicalParams};
use etude_stage::{Actuation, MAX_AHEAD_M, RAIL, Side, StageConfig, World, joint_range};

use crate::bench::{self, over};

/// Least time for a rest-to-rest move over `distance` within the limits on velocity, acceleration
/// and jerk. Holds where both limits are reached, as on a long move.
fn fastest_secs(distance: f64, velocity: f64, acceleration: f64, jerk: f64) -> f64 {
    distance / velocity + velocity / acceleration + acceleration / jerk
}

/// Moves the rail over `distance` and returns when it was within `near` for good, and the greatest
/// speed.
fn rail_move(world: &mut World, distance: f64, near: f64) -> (f64, f64) {
    let mut targets = world.start_pose();
    targets[RAIL] = -distance / 2.0;
    world.reset_to(&targets);
    targets[RAIL] = distance / 2.0;
    let (mut arrived, mut fastest) = (0.0, 0.0f64);
    for _ in 0..100 {
        world.step(&targets);
        fastest = fastest.max(world.joint_velocities()[RAIL].abs());
        if (world.joints()[RAIL] - targets[RAIL]).abs() > near {
            arrived = world.time_secs();
        }
    }
    (arrived, fastest)
}

#[test]
fn a_full_width_move_takes_what_the_limits_say() {
    let params = PhysicalParams::default();
    let limit = |quantity| params.joint(quantity, RAIL);
    let (velocity, acceleration, jerk) =
        (limit(JointRow::VelocityLimit), limit(JointRow::AccelerationLimit), limit(JointRow::JerkLimit));
    let distance = 2.0 * HALF_WIDTH;
    let least = fastest_secs(distance, velocity, acceleration, jerk);
    let mut world = bench::nominal();
    for near in [0.01, 0.002] {
        let (secs, speed) = rail_move(&mut world, distance, near);
        println!("full width to {near} m in {secs:.2} s, ideal {least:.2} s, {speed:.3} m/s of {velocity}");
        // Never faster than the limits; the controller's soft landing may cost as much again.
        assert!(secs >= least - near / velocity - 0.05, "{secs} s");
        assert!(secs <= 2.0 * least, "{secs} s");
        assert!(speed <= velocity * 1.02 && speed > 0.95 * velocity, "{speed} m/s");
    }
}

#[test]
fn a_hand_that_holds_its_starting_pose_does_not_drift() {
    for (actuation, fences) in [(Actuation::Controlled, true), (Actuation::Position, false)] {
        for side in [Side::Left, Side::Right] {
            let config = StageConfig { side, fences, actuation, ..StageConfig::default() };
            let mut world = World::new(&config, &PhysicalParams::default()).unwrap();
            let still = world.start_pose();
            for _ in 0..100 {
                let outcome = world.step(&still);
                assert!(!outcome.collided && world.pressed().is_empty());
            }
            let drift = world.joints().iter().zip(still).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(drift < 1e-9, "{actuation:?} {drift}");
        }
    }
}

/// A finger presses a key, and holds it while the rail moves on over `distance`: the largest angle
/// of its roll joint, rad.
fn drag(interlock: bool, key: usize, distance: f64) -> f64 {
    const FINGER: usize = 1;
    let config = StageConfig { interlock, ..StageConfig::default() };
    let mut world = World::new(&config, &PhysicalParams::default()).unwrap();
    let [above, mut down] = [0.018, -0.009].map(|height| over(&world, FINGER, key, height).unwrap());
    world.reset_to(&above);
    (0..10).for_each(|_| _ = world.step(&down));
    assert_eq!(world.pressed().len(), 1);
    down[RAIL] += distance;
    let mut largest = 0.0f64;
    for _ in 0..20 {
        let roll = |world: &World| world.joints()[JOINTS_PER_FINGER * FINGER].abs();
        world.step_watched(&down, |world| largest = largest.max(roll(world)));
    }
    // It may always go back.
    down[RAIL] -= distance;
    (0..20).for_each(|_| _ = world.step(&down));
    assert!((world.joints()[RAIL] - down[RAIL]).abs() < 0.002, "{} m", world.joints()[RAIL]);
    largest
}

#[test]
fn the_interlock_keeps_a_dragged_finger_from_its_stop() {
    let [_, stop] = joint_range(0);
    for (key, distance) in [24, 31].into_iter().flat_map(|key| [(key, 0.08), (key, -0.08)]) {
        let [with, without] = [true, false].map(|interlock| drag(interlock, key, distance));
        println!("key {key}, {distance} m: {with:.3} rad with the interlock, {without:.3} without");
        assert!(with < stop + 0.005 && without > stop + 0.02, "{with} and {without} rad");
    }
}

/// The reference of a rail that follows late runs ahead of the hand by speed times delay.
#[test]
fn the_interlock_bounds_how_far_the_reference_is_ahead() {
    let mut params = PhysicalParams::default();
    params.set("joint.rail.delay", 0.1).unwrap();
    let ahead = |interlock: bool| {
        let config = StageConfig { interlock, ..StageConfig::default() };
        let mut world = World::new(&config, &params).unwrap();
        let mut targets = world.start_pose();
        targets[RAIL] = -0.2;
        world.reset_to(&targets);
        targets[RAIL] = 0.2;
        let mut most = 0.0f64;
        for _ in 0..40 {
            let distance = |world: &World| world.references()[RAIL] - world.joints()[RAIL];
            world.step_watched(&targets, |world| most = most.max(distance(world)));
        }
        assert!((world.joints()[RAIL] - 0.2).abs() < 0.002);
        most
    };
    let [with, without] = [true, false].map(ahead);
    println!("{with:.4} m with the interlock, {without:.4} m without");
    // It brakes from there on.
    assert!(with < MAX_AHEAD_M + 0.02 && without > MAX_AHEAD_M + 0.035, "{with} and {without} m");
}
