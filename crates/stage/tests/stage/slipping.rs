//! What the fences are for: a finger that holds a white key cannot be dragged onto the neighbour.

use etude_music::KeySet;
use etude_stage::geometry::WHITE_PITCH;
use etude_stage::{PhysicalParams, RAIL, StageConfig, World};

use crate::bench::over;

/// Holds middle-row key E with the middle finger at `depth`, then drags the rail and the finger toward F.
fn drag(fences: bool, depth: f64, by: f64) -> Vec<KeySet> {
    let config = StageConfig { fences, ..StageConfig::default() };
    let mut world = World::new(&config, &PhysicalParams::default()).unwrap();
    let (above, down) = (over(&world, 1, 28, 0.01).unwrap(), over(&world, 1, 28, -depth).unwrap());
    world.reset_to(&above);
    for _ in 0..12 {
        world.step(&down);
    }
    assert_eq!(world.pressed(), [28].into_iter().collect(), "fences {fences} depth {depth}");
    let mut pushed = down;
    pushed[RAIL] += by;
    (0..40)
        .map(|_| {
            world.step(&pushed);
            world.pressed()
        })
        .collect()
}

#[test]
fn study() {
    for depth in [0.007, 0.009, 0.012, 0.016] {
        for by in [0.3, 0.6, 1.0, 1.5] {
            for fences in [true, false] {
                let keys: Vec<String> = drag(fences, depth, by * WHITE_PITCH).iter().map(|k| k.to_string()).collect();
                let mut short = keys.clone();
                short.dedup();
                println!("depth {depth} by {by} fences {fences}: {short:?}");
            }
        }
    }
}
