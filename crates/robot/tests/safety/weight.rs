//! The hand has a weight in the twin, and the controller's feed-forward holds it: computed by
//! MuJoCo, not by our formula.

use std::time::Duration;

use etude_robot::allegro::{self, holding_torques};
use etude_robot::calibration::RailPath;
use etude_robot::xarm::kinematics::PAPER_HOME_DEG;
use etude_robot::{Pace as _, Phase, Robot};
use etude_stage::{DRIVEN_JOINTS, ModelOptions, PhysicalParams, StageConfig, World};
use etude_twin::{Lockstep, Twin, TwinParams, calibration};
use proptest::prelude::*;

fn world() -> World {
    let params = PhysicalParams::default();
    let options = ModelOptions { gravity: true, step_secs: 0.001, ..ModelOptions::default() };
    World::with_options(&StageConfig { fences: false, ..StageConfig::default() }, &params, &options).unwrap()
}

/// The fastest joint after 5 ms from rest at `pose` under `torques`, rad/s.
fn fastest(world: &mut World, pose: &[f64; DRIVEN_JOINTS], torques: &[f64; DRIVEN_JOINTS]) -> f64 {
    world.reset_to(pose);
    for _ in 0..5 {
        world.drive(torques);
    }
    world.joint_velocities().iter().fold(0.0, |most, speed| most.max(speed.abs()))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..Default::default() })]
    #[test]
    fn fingers_stay_where_they_are_held(
        rolls in prop::array::uniform3(-0.4..0.4_f64),
        // Above the keys.
        bends in prop::array::uniform9(-0.15..0.25_f64),
    ) {
        let mut pose = [0.0; DRIVEN_JOINTS];
        let mut positions = [0.0; allegro::WIRE_JOINTS];
        for finger in 0..3 {
            pose[4 * finger] = rolls[finger];
            pose[4 * finger + 1..4 * finger + 4].copy_from_slice(&bends[3 * finger..3 * finger + 3]);
        }
        positions[..12].copy_from_slice(&pose[..12]);
        let held = holding_torques(&positions);
        let mut torques = [0.0; DRIVEN_JOINTS];
        torques[..12].copy_from_slice(&held[..12]);
        let mut world = world();
        let held = fastest(&mut world, &pose, &torques);
        let falling = fastest(&mut world, &pose, &[0.0; DRIVEN_JOINTS]);
        prop_assert!(held < 0.01 * falling && falling > 0.05, "{held} and {falling} rad/s");
    }
}

/// How far the flexed joints of a twin's hand are from the pose that it holds, rad.
fn sag(feed_forward: bool) -> f64 {
    let twin_params = TwinParams::load("mild").unwrap().with("[world]\ngravity = true\n").unwrap();
    let mut rig = twin_params.rig();
    assert!(rig.joint_loop.gravity_pwm_per_nm > 0.0, "the rig of a hand with a weight holds it");
    if !feed_forward {
        rig.joint_loop.gravity_pwm_per_nm = 0.0;
    }
    let home = PAPER_HOME_DEG.map(f64::to_radians);
    let path = RailPath::new(&calibration("twin"), rig.limits.rail_range_m, &home).unwrap();
    let mut robot = Robot::new(&rig, path).unwrap();
    let mut lockstep = Lockstep::new(Twin::new(&twin_params, rig.hand.side).unwrap()).unwrap();
    robot.start(lockstep.now());
    let mut run = |robot: &mut Robot, millis: u64| {
        let until = lockstep.now() + Duration::from_millis(millis);
        lockstep.run_until(robot, until);
        lockstep.now()
    };
    let now = run(&mut robot, 2000);
    // Above the keyboard, fingers straight.
    robot.home(now, &[0.0; DRIVEN_JOINTS]).unwrap();
    run(&mut robot, 3000);
    assert_eq!(robot.phase(), Phase::Moving, "{:?}", robot.fault());
    let joints = robot.joints();
    (0..3).map(|finger| joints[4 * finger + 1].abs()).fold(0.0, f64::max)
}

#[test]
fn a_hand_with_a_weight_hangs_without_the_feed_forward() {
    let (held, hanging) = (sag(true), sag(false));
    println!("the base of a finger hangs by {hanging:.4} rad, {held:.4} rad with the feed-forward");
    // 0.072 N·m over 3 N·m/rad and the encoders' bias, 0.01 rad at most, which stays; dry friction
    // holds a part.
    assert!((0.02..0.04).contains(&hanging) && held < 0.015, "{held} {hanging}");
}
