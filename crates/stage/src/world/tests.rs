use super::*;
use crate::config::KeyFactors;
use crate::geometry::KeyShape;
use crate::mjcf::PALM_PLACE;

/// A key with half the travel reaches its lower stop, and sounds, at half the depth of its
/// neighbours; also after the physical numbers were set again.
#[test]
fn a_keys_travel_is_its_own() {
    let mut keys = ModelOptions::default().keys;
    keys[7] = KeyFactors { stiffness: 1.0, travel: 0.5 };
    let (config, params) = (StageConfig::default(), PhysicalParams::default());
    let options = ModelOptions { keys, ..ModelOptions::default() };
    let mut world = World::with_options(&config, &params, &options).unwrap();
    world.set_params(&params);
    world.put_keys(&std::array::from_fn(|key| 0.3 * KeyShape::of(key).max_angle()));
    assert!((world.key_travel(5) - 0.3).abs() < 1e-12 && (world.key_travel(7) - 0.6).abs() < 1e-12);
    world.watch_keys();
    assert_eq!(world.pressed().iter().collect::<Vec<_>>(), [7]);
}

/// How far a joint of the world with these numbers turns under a steady torque in a second, rad.
/// With a `push` (N·m) in the first 50 ms.
fn turned(numbers: &[(&str, f64)], torque: f64, push: f64) -> f64 {
    const JOINT: usize = 4;
    let mut params = PhysicalParams::default();
    for (name, value) in numbers {
        params.set(&format!("joint.middle_0.{name}"), *value).unwrap();
    }
    let mut world = World::new(&StageConfig::default(), &params).unwrap();
    let before = world.joints()[JOINT];
    for step in 0..200 {
        let pushed = if step < 10 { push } else { 0.0 };
        world.drive(&std::array::from_fn(|joint| if joint == JOINT { torque + pushed } else { 0.0 }));
    }
    world.joints()[JOINT] - before
}

#[test]
fn a_joint_sticks_until_it_breaks_loose() {
    let (slides, sticks) = ([("friction", 0.02)], [("friction", 0.02), ("friction_at_rest", 1.5)]);
    // Friction that holds does hold: with MuJoCo's defaults the joint would creep.
    for held in [turned(&slides, 0.018, 0.0), turned(&sticks, 0.028, 0.0), turned(&sticks, -0.028, 0.0)] {
        assert!(held.abs() < 5e-4, "{held}");
    }
    for loose in [turned(&slides, 0.023, 0.0), turned(&sticks, 0.032, 0.0), turned(&sticks, 0.024, 0.02)] {
        assert!(loose > 0.1, "{loose}");
    }
    assert!(turned(&sticks, -0.032, 0.0) < -0.1);
}

#[test]
fn a_load_acts_as_a_torque_does_and_lasts() {
    let load = turned(&[("load", 0.003)], 0.0, 0.0);
    assert!(load > 0.05 && (load - turned(&[], 0.003, 0.0)).abs() < 1e-9, "{load}");
    assert!(turned(&[("load", -0.01), ("friction", 0.02)], 0.028, 0.0).abs() < 5e-4);
    let mut params = PhysicalParams::default();
    params.set("joint.fingers.load", 0.003).unwrap();
    let mut world = World::new(&StageConfig::default(), &params).unwrap();
    let start = world.snapshot();
    let mut ends = [(); 3].map(|()| {
        (0..100).for_each(|_| world.drive(&[0.0; DRIVEN_JOINTS]));
        let end = world.joints();
        world.restore(&start).unwrap();
        end
    });
    world.reset();
    ends[1] = {
        (0..100).for_each(|_| world.drive(&[0.0; DRIVEN_JOINTS]));
        world.joints()
    };
    assert!(ends.iter().all(|end| *end == ends[0]));
}

/// How far down key `key` is after a fifth of a second with this force at its front, as a share of
/// its travel.
fn pressed_by(world: &mut World, key: usize, newton: f64) -> f64 {
    world.reset();
    let dof = world.layout.key_dof[key];
    for _ in 0..40 {
        world.data.qfrc_applied_mut()[dof] = newton * KeyShape::of(key).size[0];
        world.drive(&[0.0; DRIVEN_JOINTS]);
    }
    world.key_travel(key)
}

/// A white and a black key move from rest at the preload and at no less, whether the model was
/// built with it or was given it later.
#[test]
fn a_key_with_a_preload_needs_that_force_to_move() {
    let config = StageConfig::default();
    let mut params = PhysicalParams::default();
    params.set("key.preload", 0.6).unwrap();
    let mut keys = ModelOptions::default().keys;
    // The preload does not depend on the spring.
    keys[5] = KeyFactors { stiffness: 1.3, travel: 1.0 };
    let options = ModelOptions { keys, ..ModelOptions::default() };
    let built = World::with_options(&config, &params, &options).unwrap();
    let mut given = World::with_options(&config, &PhysicalParams::default(), &options).unwrap();
    given.set_params(&params);
    for mut world in [built, given] {
        for key in [5, 6] {
            let (at_rest, below, above) = (
                pressed_by(&mut world, key, 0.0),
                pressed_by(&mut world, key, 0.55),
                pressed_by(&mut world, key, 0.7),
            );
            // The stop yields by a quarter of a millimetre.
            assert!((-0.03..=0.0).contains(&at_rest) && below.abs() < 0.01, "{key}: {at_rest} {below}");
            // The spring yields to what is more than the preload.
            let shape = KeyShape::of(key);
            let spring = if key == 5 { 1.3 } else { 1.0 };
            let expected = 0.1 * shape.size[0] / spring / shape.max_angle();
            assert!((above / expected - 1.0).abs() < 0.05, "{key}: {above}, not {expected}");
        }
        // A key at rest sleeps as one without a preload does.
        world.reset();
        let zero = [0.0; DRIVEN_JOINTS];
        (0..200).for_each(|_| world.drive(&zero));
        assert!(world.data.tree_asleep()[world.layout.key_tree[20]] >= 0);
    }
    let mut loose = World::new(&config, &PhysicalParams::default()).unwrap();
    assert!(pressed_by(&mut loose, 5, 0.3) > 0.5);
}

/// The hand is turned about its mount and put off its place, and the rail still leads along the
/// keyboard.
#[test]
fn a_hand_can_be_tilted_and_off_its_place() {
    let (config, params) = (StageConfig::default(), PhysicalParams::default());
    let [roll, pitch] = [0.02, 0.03];
    let options = ModelOptions { hand_tilt_rad: [roll, pitch], ..ModelOptions::default() };
    let mut straight = World::new(&config, &params).unwrap();
    let mut tilted = World::with_options(&config, &params, &options).unwrap();
    let mut pose = [0.0; DRIVEN_JOINTS];
    let mut tips = |pose: &[f64; DRIVEN_JOINTS]| {
        straight.reset_to(pose);
        tilted.reset_to(pose);
        [0, 1, 2].map(|finger| [straight.fingertip(finger), tilted.fingertip(finger)])
    };
    for [[x, y, z], found] in tips(&pose) {
        // About the mount, first about the keyboard's length, then about the axis toward the
        // player.
        let (x, z) = (x - PALM_PLACE[0], z - PALM_PLACE[2]);
        let (x, z) = (x * pitch.cos() + z * pitch.sin(), z * pitch.cos() - x * pitch.sin());
        let (y, z) = (y * roll.cos() - z * roll.sin(), y * roll.sin() + z * roll.cos());
        let expected = [x + PALM_PLACE[0], y, z + PALM_PLACE[2]];
        assert!(expected.iter().zip(found).all(|(a, b)| (a - b).abs() < 1e-9), "{expected:?} {found:?}");
    }
    let before = tips(&pose);
    pose[RAIL] = 0.1;
    for ([_, before], [_, after]) in before.into_iter().zip(tips(&pose)) {
        assert!((after[1] - before[1] - 0.1).abs() < 1e-9, "{after:?} {before:?}");
        assert!((after[0] - before[0]).abs() < 1e-9 && (after[2] - before[2]).abs() < 1e-9);
    }
    let offset = [1e-3, -2e-3, 3e-3];
    let before = straight.fingertip(1);
    straight.set_hand_offset(offset);
    straight.reset_to(&pose);
    let after = straight.fingertip(1);
    assert!(
        (0..3).all(|axis| (after[axis] - before[axis] - offset[axis]).abs() < 1e-9),
        "{after:?} {before:?}"
    );
}

/// In the air a hand moves the same without contacts, to the last bit; pressed down it goes through
/// a key that contacts would push down.
#[test]
fn without_contacts_a_hand_moves_the_same_and_presses_nothing() {
    let mut world = World::new(&StageConfig::default(), &PhysicalParams::default()).unwrap();
    let mut play = |contacts: bool, deep: bool| {
        world.set_contacts(contacts);
        world.reset();
        let start = world.start_pose();
        let [x, y, z] = world.fingertip(1);
        let reach = kinematics::reach(world.config.side, 1, [x, y, z - 0.03], start[RAIL]).unwrap();
        let mut path = Vec::new();
        for step in 0..40 {
            let mut targets = start;
            if deep {
                targets[JOINTS_PER_FINGER..2 * JOINTS_PER_FINGER].copy_from_slice(&reach);
            } else {
                targets[JOINTS_PER_FINGER + 1] -= 0.1 * f64::from(step % 7);
                targets[RAIL] += 1e-3 * f64::from(step);
            }
            world.step_watched(&targets, |world| path.push(world.joints()));
        }
        let deepest = (0..KEY_COUNT).map(|key| world.key_travel(key)).fold(0.0, f64::max);
        (path, deepest)
    };
    assert!(play(true, true).1 > 0.5);
    assert!(play(false, true).1 < 1e-3);
    assert_eq!(play(false, false), play(true, false), "and contacts are on again");
}
