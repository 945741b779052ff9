//! What counts as a collision: anything that touches but a fingertip on the keyboard.

use etude_stage::{PhysicalParams, StageConfig, World};
use mujoco_rs::prelude::MjtObjBase;

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
    let mut names: Vec<String> = Vec::new();
    let mut collisions = 0;
    for _ in 0..40 {
        collisions += usize::from(world.step(&fist).collided);
        let geoms = world.data().contact().iter().flat_map(|contact| contact.geom);
        let name = |geom| world.data().model().id_to_name(MjtObjBase::mjOBJ_GEOM, geom as usize);
        names.extend(geoms.filter_map(name).map(str::to_string));
    }
    assert!(collisions > 0);
    assert!(names.iter().any(|n| n == "middle_medial" || n == "middle_distal"), "{names:?}");
}

#[test]
fn fingers_that_meet_collide() {
    let mut world = bench::nominal();
    let mut meets = |rolls: [f64; 3]| {
        world.reset();
        let mut targets = world.start_pose();
        for (finger, roll) in rolls.into_iter().enumerate() {
            targets[4 * finger] = roll;
        }
        (0..30).any(|_| world.step(&targets).collided)
    };
    let most = 0.47;
    assert!(!meets([most; 3]) && !meets([-most; 3]), "side by side they never meet");
    assert!(meets([most, -most, most]) && meets([-most, most, -most]));
}

#[test]
fn a_collision_within_the_step_counts_even_if_it_is_over_at_its_end() {
    // Count collisions by control step against contacts at the end of the step: the former must be
    // more.
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
    assert!(seen > at_end && at_end > 0, "{seen} {at_end}");
}
