//! Keys at rest cost nothing: no constraint, no contact, and they sleep. It is what makes the
//! engine fast enough, and it must not change what is played.

use etude_music::{KEY_COUNT, KeySet};
use etude_stage::{Actuation, PhysicalParams, StageConfig, World};
use proptest::prelude::*;

use crate::bench::{self, all_targets, over};
use crate::replica::{Moment, Replica, swap};

fn asleep(world: &World) -> usize {
    world.data().tree_asleep().iter().filter(|tree| **tree >= 0).count()
}

#[test]
fn a_still_world_has_no_constraints_and_its_keys_sleep() {
    for fences in [true, false] {
        for actuation in [Actuation::Controlled, Actuation::Position] {
            let config = StageConfig { fences, actuation, ..StageConfig::default() };
            let mut world = World::new(&config, &PhysicalParams::default()).unwrap();
            let still = world.start_pose();
            assert_eq!(world.data().nefc(), 0, "even before settling");
            for _ in 0..20 {
                world.step(&still);
                assert_eq!((world.data().nefc(), world.data().ncon()), (0, 0));
            }
            assert_eq!(asleep(&world), KEY_COUNT, "all keys sleep and the hand does not");
            assert!((0..KEY_COUNT).all(|key| world.key_travel(key) == 0.0));
        }
    }
}

#[test]
fn a_key_wakes_for_a_touch_and_sleeps_again() {
    let mut world = bench::nominal();
    let still = world.start_pose();
    for _ in 0..20 {
        world.step(&still);
    }
    let press = over(&world, 1, 24, -0.014).unwrap();
    for _ in 0..20 {
        world.step(&press);
    }
    assert!(world.pressed().contains(24) && asleep(&world) < KEY_COUNT);
    let release = over(&world, 1, 24, 0.02).unwrap();
    for _ in 0..60 {
        world.step(&release);
    }
    assert_eq!((asleep(&world), world.data().nefc()), (KEY_COUNT, 0));
    assert!(world.key_travel(24).abs() < 1e-8, "it rests where it sleeps: {}", world.key_travel(24));
}

/// Frames of a recording: which keys are past half their travel after each control step.
fn frames(replica: &Replica, moments: &[Moment]) -> Vec<KeySet> {
    moments.iter().skip(9).step_by(10).map(|moment| replica.down(&moment.positions)).collect()
}

proptest! {
    #![proptest_config(bench::cases(16))]
    #[test]
    fn sleeping_changes_no_note(config in bench::config(), gestures in bench::gestures()) {
        let world = World::new(&config, &PhysicalParams::default()).unwrap();
        let mut sleepy = Replica::of(&world, |xml| xml);
        let mut awake = Replica::of(&world, |xml| swap(xml, r#"<flag sleep="enable"/>"#, ""));
        // The same torques for both, for one second of stillness (so that all keys sleep) and then
        // the gestures.
        let mut targets = vec![world.start_pose(); 20];
        targets.extend(all_targets(&world, &gestures));
        let moments = sleepy.record(&targets);
        let mut worst: f64 = 0.0;
        let mut others = Vec::new();
        for moment in &moments {
            awake.physics_step(&moment.torques);
            let positions = awake.data.qpos().to_vec();
            let apart = positions.iter().zip(&moment.positions).map(|(a, b)| (a - b).abs());
            worst = worst.max(apart.fold(0.0, f64::max));
            others.push(Moment { torques: moment.torques, positions });
        }
        println!("largest difference of a position with and without sleep: {worst:.3e}");
        prop_assert_eq!(frames(&sleepy, &moments), frames(&awake, &others));
        // The same torques, no feedback: contacts amplify a difference of rounding, once to 6e-6. A
        // key sounds at some 0.03 rad.
        prop_assert!(worst < 1e-4, "{}", worst);
    }
}
