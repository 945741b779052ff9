//! A restored world continues bit for bit, in this world or another of its kind.
//!
//! The risk is what MuJoCo keeps outside its state vector: warm starts, and above all which keys
//! sleep.

use etude_stage::{PhysicalParams, World};
use proptest::prelude::*;

use crate::bench::{self, Gesture, all_targets, over};

fn same_future(a: &mut World, b: &mut World, gestures: &[Gesture]) -> Result<(), TestCaseError> {
    for targets in all_targets(a, gestures) {
        prop_assert_eq!(a.step(&targets), b.step(&targets));
        prop_assert_eq!(a.snapshot(), b.snapshot());
        prop_assert_eq!(a.events(), b.events());
        prop_assert_eq!(a.torques(), b.torques());
        for finger in 0..3 {
            prop_assert_eq!(a.fingertip(finger), b.fingertip(finger));
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(bench::cases(24))]
    #[test]
    fn a_restored_world_continues_bit_for_bit(
        config in bench::config(),
        before in bench::gestures(),
        elsewhere in bench::gestures(),
        after in bench::gestures(),
        cut in 0.0f64..1.0,
        sticks in any::<bool>(),
    ) {
        let mut params = PhysicalParams::default();
        if sticks {
            params.set("joint.all.friction", 0.02).unwrap();
            params.set("joint.all.friction_at_rest", 1.5).unwrap();
        }
        let mut world = World::new(&config, &params).unwrap();
        let targets = all_targets(&world, &before);
        let stop = (cut * targets.len() as f64) as usize;
        for targets in &targets[..stop] {
            world.step(targets);
        }
        let snapshot = world.snapshot();
        let mut fresh = World::new(&config, &params).unwrap();
        fresh.restore(&snapshot).unwrap();
        prop_assert_eq!(&fresh.snapshot(), &snapshot);
        prop_assert_eq!(fresh.pressed(), world.pressed());
        prop_assert_eq!(fresh.joints(), world.joints());
        prop_assert_eq!(fresh.joint_velocities(), world.joint_velocities());
        prop_assert_eq!(fresh.time_secs(), world.time_secs());
        same_future(&mut world, &mut fresh, &after)?;
        // Back to the same moment, from wherever the two are now and somewhere else again.
        for targets in all_targets(&world, &elsewhere) {
            world.step(&targets);
        }
        world.restore(&snapshot).unwrap();
        fresh.restore(&snapshot).unwrap();
        same_future(&mut world, &mut fresh, &after)?;
    }
}

/// The moment that the random ones might miss: one key held down, its neighbours awake or asleep,
/// most keys asleep.
#[test]
fn a_snapshot_in_the_middle_of_a_press_keeps_sleepers_asleep() {
    let mut world = bench::nominal();
    let press = over(&world, 1, 24, -0.014).unwrap();
    for _ in 0..30 {
        world.step(&press);
    }
    let asleep = |world: &World| world.data().tree_asleep().iter().filter(|t| **t >= 0).count();
    assert!(world.pressed().contains(24) && world.data().ncon() > 0);
    assert!((40..49).contains(&asleep(&world)), "{} trees sleep", asleep(&world));
    let mut fresh = bench::nominal();
    fresh.restore(&world.snapshot()).unwrap();
    assert_eq!(asleep(&fresh), asleep(&world));
    let away = Gesture::Reach { finger: 2, key: 28, height: -0.014, steps: 30 };
    same_future(&mut world, &mut fresh, &[away]).unwrap();
}

/// What can be read between restoring and the next step is that of the restored moment, not of the
/// one before.
#[test]
fn nothing_of_the_former_moment_can_be_read_after_restoring() {
    let mut world = bench::nominal();
    let start = world.snapshot();
    let torques = *world.torques();
    let press = over(&world, 1, 24, -0.014).unwrap();
    while world.events().is_empty() {
        world.step(&press);
    }
    let (down, pressing, tip) = (world.snapshot(), *world.torques(), world.fingertip(1));
    world.restore(&start).unwrap();
    assert_eq!(*world.torques(), torques);
    assert!(world.events().is_empty(), "{:?}", world.events());
    world.restore(&down).unwrap();
    assert_eq!(*world.torques(), pressing);
    // MuJoCo leaves derived places one step behind the positions; restoring may bring them up to
    // date.
    let moved = tip.iter().zip(world.fingertip(1)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(moved < 0.005, "{moved}");
}
