//! Strikes and releases: when they happened, in which order, how fast, and that they agree with the
//! keys.

use etude_music::{KeyEvent, KeySet};
use etude_stage::{DRIVEN_JOINTS, PHYSICS_STEPS, PhysicalParams, RAIL, StageConfig, World};
use proptest::prelude::*;

use crate::bench::{self, all_targets, over};
use crate::replica::{Replica, STEP_SECS};

proptest! {
    #![proptest_config(bench::cases(16))]
    #[test]
    fn events_are_the_crossings_of_both_thresholds_at_their_physics_step(
        gestures in bench::gestures(),
        threshold in 0.1f64..0.9,
        hysteresis in prop_oneof![Just(0.0), 0.0f64..0.9],
    ) {
        let mut params = PhysicalParams::default();
        params.set("key.threshold", threshold).unwrap();
        params.set("key.hysteresis", hysteresis).unwrap();
        let mut world = World::new(&StageConfig::default(), &params).unwrap();
        let mut replica = Replica::of(&world, |xml| xml);
        let mut before = KeySet::EMPTY;
        let mut physics_steps = 0;
        for targets in all_targets(&world, &gestures) {
            world.step(&targets);
            let mut expected: Vec<(f64, usize, bool)> = Vec::new();
            for _ in 0..PHYSICS_STEPS {
                replica_step(&mut replica, &targets);
                physics_steps += 1;
                let now = replica.sounding(replica.data.qpos(), before, hysteresis);
                let secs = f64::from(physics_steps) * STEP_SECS;
                expected.extend(now.difference(before).iter().map(|key| (secs, key, true)));
                expected.extend(before.difference(now).iter().map(|key| (secs, key, false)));
                before = now;
            }
            let found: Vec<_> = world.events().iter().map(|e| (e.secs, e.key, e.velocity > 0)).collect();
            prop_assert_eq!(found, expected);
            prop_assert_eq!(world.pressed(), before);
            prop_assert!(world.events().iter().all(|e| e.velocity <= 127));
        }
    }
}

fn replica_step(replica: &mut Replica, targets: &[f64; DRIVEN_JOINTS]) {
    let torques = replica.torques(targets);
    replica.physics_step(&torques);
}

fn strike(world: &mut World, height: f64) -> KeyEvent {
    let press = over(world, 1, 24, height).unwrap();
    (0..40)
        .find_map(|_| {
            world.step(&press);
            world.events().first().copied()
        })
        .expect("a strike")
}

#[test]
fn a_harder_stroke_is_louder() {
    let mut world = bench::nominal();
    let high = over(&world, 1, 24, 0.03).unwrap();
    for _ in 0..20 {
        world.step(&high);
    }
    let fast = strike(&mut world, -0.03).velocity;
    world.reset();
    // Down a millimetre at a time.
    let slow = (0..)
        .find_map(|step| {
            let pose = over(&world, 1, 24, 0.002 - 0.0005 * f64::from(step)).unwrap();
            world.step(&pose);
            world.events().first().copied()
        })
        .expect("a strike")
        .velocity;
    println!("velocity of a fast stroke {fast}, of a slow one {slow}");
    assert!(fast > 2 * slow && slow >= 1, "{fast} {slow}");
}

#[test]
fn a_delay_puts_every_event_off_by_itself() {
    let mut params = PhysicalParams::default();
    let first = strike(&mut bench::nominal(), -0.014);
    params.set("joint.all.delay", 0.06).unwrap();
    let mut late = World::new(&StageConfig::default(), &params).unwrap();
    let second = strike(&mut late, -0.014);
    assert!((second.secs - first.secs - 0.06).abs() < 1e-9, "{} and {}", first.secs, second.secs);
    assert_eq!((second.key, second.velocity), (first.key, first.velocity));
}

/// A world whose finger encoders are off by `bias`.
fn biased(bias: f64) -> World {
    let mut params = PhysicalParams::default();
    params.set("joint.fingers.encoder_bias", bias).unwrap();
    params.set("joint.rail.encoder_bias", 0.01).unwrap();
    World::new(&StageConfig::default(), &params).unwrap()
}

fn furthest(a: [f64; DRIVEN_JOINTS], b: [f64; DRIVEN_JOINTS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn an_encoder_bias_is_read_but_moves_nothing_by_itself() {
    let unbiased = bench::nominal();
    let mut world = biased(0.05);
    for joint in 0..DRIVEN_JOINTS {
        let bias = if joint == RAIL { 0.01 } else { 0.05 };
        assert!((world.joints()[joint] - unbiased.joints()[joint] - bias).abs() < 1e-12);
    }
    for finger in 0..3 {
        assert_eq!(world.fingertip(finger), unbiased.fingertip(finger), "the true place is the same");
    }
    let targets = world.start_pose();
    for _ in 0..20 {
        world.step(&targets);
    }
    assert!(furthest(world.joints(), targets) < 1e-9);
}

/// The hand that trusts wrong encoders reads what it wants and misses by as much.
#[test]
fn an_encoder_bias_is_obeyed() {
    let unbiased = bench::nominal();
    // Downward, so that the start pose does not run into the end of a joint.
    let mut world = biased(-0.05);
    for _ in 0..60 {
        world.step(&unbiased.start_pose());
    }
    assert!(furthest(world.joints(), unbiased.start_pose()) < 1e-3);
    let (wanted, found) = (unbiased.fingertip(0), world.fingertip(0));
    assert!((wanted[1] - found[1] - 0.01).abs() < 0.008, "the rail's bias: {wanted:?} {found:?}");
    let missed = wanted.iter().zip(found).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    assert!(missed > 0.01, "{missed}");
}
