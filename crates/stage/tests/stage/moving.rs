//! How fast the joints move, and that they stand still when they should.

use etude_stage::geometry::HALF_WIDTH;
use etude_stage::params::{JointRow, PhysicalParams};
use etude_stage::{Actuation, RAIL, Side, StageConfig, World};

use crate::bench;

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
            let config = StageConfig { side, fences, actuation };
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
