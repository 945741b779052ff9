//! What the fences are for: wherever a finger comes down, it presses one white key and not two, and
//! a finger that holds a key cannot be dragged onto the neighbour.

use etude_music::KeySet;
use etude_stage::geometry::WHITE_PITCH;
use etude_stage::{PhysicalParams, RAIL, StageConfig, World};

use crate::bench::{over, over_beside};

fn world(fences: bool) -> World {
    World::new(&StageConfig { fences, ..StageConfig::default() }, &PhysicalParams::default()).unwrap()
}

/// The keys that sound after pressing `key` at each millimetre from its middle to the middle of the
/// next one.
fn presses(fences: bool, key: usize, depth: f64) -> Vec<KeySet> {
    let mut world = world(fences);
    (0..=(WHITE_PITCH * 1000.0) as u32)
        .map(|mm| {
            let aside = f64::from(mm) / 1000.0;
            let above = over_beside(&world, 1, key, 0.01, aside).expect("in reach");
            let down = over_beside(&world, 1, key, -depth, aside).expect("in reach");
            world.reset_to(&above);
            for _ in 0..20 {
                world.step(&down);
            }
            world.pressed()
        })
        .collect()
}

#[test]
fn with_fences_no_place_presses_two_white_keys_and_without_many_do() {
    // E to F has no black key between, C to D has one.
    for key in [28, 24] {
        for depth in [0.006, 0.010, 0.016] {
            let double = |fences| presses(fences, key, depth).iter().filter(|keys| keys.len() > 1).count();
            let (with, without) = (double(true), double(false));
            println!(
                "key {key}, {depth} m deep: two keys at {with} places with fences, at {without} without"
            );
            assert_eq!(with, 0);
            assert!(without >= 8);
        }
    }
}

#[test]
fn with_fences_half_a_key_off_still_presses_the_right_key() {
    let right = |fences| {
        let alone: KeySet = [28].into_iter().collect();
        presses(fences, 28, 0.016).iter().take_while(|keys| **keys == alone).count()
    };
    let (with, without) = (right(true), right(false));
    println!("alone up to {with} mm off with fences, {without} mm without");
    assert!(with >= 10 && with > 2 * without);
}

/// Holds E with the middle finger at `depth`, then drags the rail by `keys` white keys for two
/// seconds.
fn drag(fences: bool, depth: f64, keys: f64) -> Vec<KeySet> {
    let mut world = world(fences);
    let (above, mut down) = (over(&world, 1, 28, 0.01).unwrap(), over(&world, 1, 28, -depth).unwrap());
    world.reset_to(&above);
    for _ in 0..12 {
        world.step(&down);
    }
    assert_eq!(world.pressed(), [28].into_iter().collect());
    down[RAIL] += keys * WHITE_PITCH;
    let mut played = Vec::new();
    for _ in 0..40 {
        world.step(&down);
        played.push(world.pressed());
    }
    played
}

/// In this model a key held deep is a trough anyway, since the neighbours' sides are walls as high
/// as its travel: that is why this holds without fences too, and why it is the presses above that
/// need them.
#[test]
fn a_finger_that_holds_a_key_is_not_dragged_onto_the_neighbour() {
    for fences in [true, false] {
        for depth in [0.009, 0.012, 0.016] {
            for keys in [-1.5, -1.0, -0.5, 0.5, 1.0, 1.5] {
                let played = drag(fences, depth, keys);
                let held = [28].into_iter().collect();
                assert!(played.iter().all(|keys| *keys == held), "{fences} {depth} {keys}");
            }
        }
    }
}
