//! Pressing keys: the right one sounds, no other, for as long as it is held, and the closed-form
//! kinematics that aims the fingers is MuJoCo's.

use etude_music::{KEY_COUNT, KeySet, key_is_black};
use etude_stage::hand::JOINTS_PER_FINGER;
use etude_stage::{FINGERS, PhysicalParams, RAIL, Side, StageConfig, World, joint_range, kinematics};
use proptest::prelude::*;

use crate::bench::{self, over};

fn only(key: usize) -> KeySet {
    [key].into_iter().collect()
}

/// Moves over the key, presses a little deeper than it goes, holds for two seconds; `None` where
/// the finger cannot reach. The keys that were down at any time before, and at each step of the
/// hold.
fn press(world: &mut World, finger: usize, key: usize) -> Option<(KeySet, Vec<KeySet>)> {
    let above = over(world, finger, key, 0.018)?;
    // By way of just above the key: a straight stroke in joint angles swings the tip into the front
    // of a black key.
    let near = over(world, finger, key, 0.003)?;
    let down = over(world, finger, key, -0.009)?;
    world.reset_to(&above);
    let mut before = KeySet::EMPTY;
    for targets in [[above; 5], [near; 5], [down; 5]].as_flattened() {
        world.step(targets);
        before = before.iter().chain(world.pressed().iter()).collect();
    }
    let held = (0..40)
        .map(|_| {
            world.step(&down);
            world.pressed()
        })
        .collect();
    Some((before, held))
}

#[test]
fn every_key_sounds_alone_and_as_long_as_it_is_held() {
    let mut failures = Vec::new();
    for side in [Side::Left, Side::Right] {
        for fences in [true, false] {
            let config = StageConfig { side, fences, ..StageConfig::default() };
            let mut world = World::new(&config, &PhysicalParams::default()).unwrap();
            let mut reached = [0; KEY_COUNT];
            for (key, reached) in reached.iter_mut().enumerate() {
                for finger in 0..FINGERS {
                    let Some((before, held)) = press(&mut world, finger, key) else { continue };
                    *reached += 1;
                    if !before.difference(only(key)).is_empty() || held.iter().any(|down| *down != only(key))
                    {
                        let downs = held.iter().filter(|down| **down == only(key)).count();
                        failures.push(format!(
                            "{side:?} fences {fences} finger {finger} key {key} black {}: before {before}, alone in {downs} of 40",
                            key_is_black(key)
                        ));
                    }
                }
            }
            assert!(reached.iter().all(|fingers| *fingers >= 1), "keys out of reach: {reached:?}");
            assert!(reached[6..43].iter().all(|fingers| *fingers == FINGERS), "{reached:?}");
        }
    }
    assert!(failures.is_empty(), "{} failures: {failures:#?}", failures.len());
}

#[test]
fn a_released_key_comes_up_at_once() {
    let mut world = bench::nominal();
    press(&mut world, 1, 24).unwrap();
    let up = over(&world, 1, 24, 0.018).unwrap();
    let steps = (1..40).find(|_| {
        world.step(&up);
        world.pressed().is_empty()
    });
    assert!(steps.is_some_and(|steps| steps <= 4), "up after {steps:?} control steps");
}

proptest! {
    #![proptest_config(bench::cases(64))]
    #[test]
    fn the_closed_form_kinematics_is_mujocos(
        right in any::<bool>(),
        shares in prop::array::uniform13(0.0f64..1.0),
    ) {
        let side = if right { Side::Right } else { Side::Left };
        let config = StageConfig { side, ..StageConfig::default() };
        let mut world = World::new(&config, &PhysicalParams::default()).unwrap();
        let pose = bench::at_shares(&shares);
        world.reset_to(&pose);
        for finger in 0..FINGERS {
            let angles = std::array::from_fn(|number| pose[finger * JOINTS_PER_FINGER + number]);
            let expected = kinematics::fingertip(side, finger, &angles, pose[RAIL]);
            let found = world.fingertip(finger);
            for axis in 0..3 {
                prop_assert!((expected[axis] - found[axis]).abs() < 1e-12, "{:?} {:?}", expected, found);
            }
        }
        prop_assert!((0..13).all(|joint| (world.joints()[joint] - pose[joint]).abs() < 1e-15));
        prop_assert!(pose[RAIL] >= joint_range(RAIL)[0]);
    }
}
