//! What keys bear from a hand that moves on while a finger holds one of them, with the controller
//! of a real robot.

use etude_robot::{Pace, Phase, Robot};
use etude_stage::geometry::KeyShape;
use etude_stage::hand::{TIP_RADIUS, root_lateral};
use etude_stage::kinematics;

use super::keyboard::{E, MIDDLE, ROLL, SETS, key_contacts};
use super::*;

/// The most that keys get along the keyboard, N, on average over 20 ms: twice the 16 N with which
/// the excitation `keys` pushes against a black key. An arm that pushes a finger at its stop takes
/// 24 to 232 N.
const MAX_N: f64 = 30.0;
/// The same within a millisecond, in which a finger strikes the edge of a key; at its stop up to
/// 1,000 N.
const MAX_IN_A_STRIKE_N: f64 = 200.0;

/// The middle finger presses E, and after half a second the policy asks for a place `way_m` farther
/// along the keyboard at once, with the finger still pressing: the force on all keys along the
/// keyboard in each millisecond from then on, N.
fn drag(name: &str, way_m: f64) -> Vec<f64> {
    let twin_params = TwinParams::load(name).unwrap();
    let home = PAPER_HOME_DEG.map(f64::to_radians);
    let path = RailPath::new(&calibration("twin"), [-HALF_WIDTH, HALF_WIDTH], &home).unwrap();
    let mut twin = Twin::new(&twin_params, HandSide::Left).unwrap();
    let rail_m = key_lateral(E) - root_lateral(Side::Left, MIDDLE);
    twin.devices.arm.place(path.joints(rail_m, path.middle()).unwrap());
    let start = twin.world.start_pose();
    let fingers = std::array::from_fn(|joint| start[joint]);
    let mut lockstep = crate::Lockstep::new(twin).unwrap();
    let mut robot = Robot::new(&twin_params.rig(), path).unwrap();
    robot.start(lockstep.now());
    while robot.phase() != Phase::Holding {
        assert_eq!(robot.fault().map(ToString::to_string), None, "{name}");
        // Without power they would sink.
        lockstep.twin.place_fingers(&fingers);
        lockstep.run_until(&mut robot, lockstep.now() + STEP);
    }
    let hovering = robot.joints();
    let [x, z] = [KeyShape::of(E).target()[0], KeyShape::of(E).top() + TIP_RADIUS - 0.016];
    let angles = kinematics::reach(Side::Left, MIDDLE, [x, key_lateral(E), z], rail_m).unwrap();
    let mut pressing = hovering;
    pressing[ROLL..ROLL + angles.len()].copy_from_slice(&angles);
    let mut moved_on = pressing;
    moved_on[RAIL] += way_m;
    let mut forces = Vec::new();
    for (pose, stretches) in [(hovering, 4), (pressing, 10), (moved_on, 30)] {
        forces.clear();
        for _ in 0..stretches {
            robot.follow(lockstep.now(), &[pose; 10]).unwrap();
            for _ in 0..50 {
                lockstep.run_until(&mut robot, lockstep.now() + STEP);
                forces.push(key_contacts(&lockstep.twin.world).1[1]);
            }
        }
        assert!(pose != pressing || lockstep.twin.world.key_travel(E) > 0.9, "{name}: E is not down");
    }
    assert_eq!(robot.phase(), Phase::Following, "{name}: {:?}", robot.fault());
    forces
}

#[test]
fn a_hand_that_moves_on_with_a_pressed_key_stops_before_the_arm_pushes_it() {
    for name in SETS {
        for way_m in [-0.25, 0.25] {
            let forces = drag(name, way_m);
            let sustained = forces.windows(20).map(|some| (some.iter().sum::<f64>() / 20.0).abs());
            let sustained = sustained.fold(0.0, f64::max);
            let peak = forces.iter().fold(0.0, |most: f64, force| most.max(force.abs()));
            println!("{name}, {way_m} m: {sustained:.1} N over 20 ms, {peak:.0} N over 1 ms");
            assert!(sustained < MAX_N, "{name}, {way_m} m: {sustained} N");
            assert!(peak < MAX_IN_A_STRIKE_N, "{name}, {way_m} m: {peak} N");
        }
    }
}
