//! What counts as a collision: anything that touches but a fingertip on the keyboard.

use etude_stage::{PhysicalParams, StageConfig, World};

use crate::bench::{self, over};

#[test]
fn a_fingertip_on_a_key_is_play() {
    let mut world = bench::nominal();
    for (finger, key) in [(0, 24), (1, 25), (2, 28)] {
        let down = over(&world, finger, key, -0.014).unwrap();
        world.reset_to(&over(&world, finger, key, 0.015).unwrap());
        for _ in 0..20 {
            assert!(!world.step(&down).collided);
        }
        assert!(world.pressed().contains(key) && world.data().ncon() > 0);
    }
}

#[test]
fn a_link_on_the_keys_is_a_collision() {
    let mut params = PhysicalParams::default();
    params.set("keyboard.depth", 0.03).unwrap();
    params.set("keyboard.height", 0.03).unwrap();
    let mut world = World::new(&StageConfig::default(), &params).unwrap();
    // Bent at the root, the last link folded away: the back of the finger comes down first.
    let mut fist = world.start_pose();
    fist[4..8].copy_from_slice(&[0.0, 0.3, 1.7, 1.6]);
    for other in [0, 8] {
        fist[other..other + 4].copy_from_slice(&[0.0, -0.19, 0.0, 0.0]);
    }
    world.reset_to(&fist);
    fist[5] = 1.6;
    let hit = (0..40).any(|_| world.step(&fist).collided);
    assert!(hit);
    let names: Vec<String> = world
        .data()
        .contact()
        .iter()
        .flat_map(|contact| contact.geom)
        .filter_map(|geom| {
            let kind = mujoco_rs::prelude::MjtObjBase::mjOBJ_GEOM;
            world.data().model().id_to_name(kind, geom as usize).map(str::to_string)
        })
        .collect();
    assert!(names.iter().any(|n| n == "middle_medial" || n == "middle_distal"), "{names:?}");
}

#[test]
fn fingers_that_meet_collide() {
    let mut world = bench::nominal();
    let mut crossed = world.start_pose();
    // Roll the outer finger inward and the middle one toward it, at the same height.
    for (joint, angle) in [(0, -0.47), (4, 0.47)] {
        crossed[joint] = angle;
    }
    let one = (0..30).any(|_| world.step(&crossed).collided);
    world.reset();
    for (joint, angle) in [(0, 0.47), (4, -0.47)] {
        crossed[joint] = angle;
    }
    let other = (0..30).any(|_| world.step(&crossed).collided);
    assert!(one != other, "toward each other they meet, apart they do not: {one} {other}");
}

#[test]
fn a_collision_within_the_step_counts_even_if_it_is_over_at_its_end() {
    // Count collisions by control step against contacts at the end of the step: the former can only be more.
    let mut world = bench::nominal();
    let (mut seen, mut at_end) = (0, 0);
    for step in 0..200 {
        let swing = if step % 4 < 2 { 0.47 } else { -0.47 };
        let mut targets = world.start_pose();
        targets[0] = swing;
        targets[4] = -swing;
        seen += usize::from(world.step(&targets).collided);
        at_end += usize::from(world.data().ncon() > 0);
    }
    assert!(seen >= at_end && seen > 0, "{seen} {at_end}");
}
