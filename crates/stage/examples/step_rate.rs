//! Control steps per second under random targets, and the share of the bare engine in it.
//!
//! `cargo run --release -p etude-stage --example step_rate [SECONDS]`

use std::time::{Duration, Instant};

use etude_stage::{JOINTS, PHYSICS_STEPS, PhysicalParams, StageConfig, World};

fn main() {
    let secs = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(3.0);
    let mut world = World::new(&StageConfig::default(), &PhysicalParams::default()).expect("the world");
    let mut state = 1u64;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as f64 / (1u64 << 31) as f64 * 2.0 - 1.0
    };
    let start = Instant::now();
    let (mut steps, mut contacts, mut pressed, mut collided) = (0u64, 0usize, 0usize, 0usize);
    while start.elapsed() < Duration::from_secs_f64(secs) {
        for _ in 0..200 {
            let targets: [f64; JOINTS] = std::array::from_fn(|j| {
                let [low, high] = etude_stage::joint_range(j);
                low + (random() + 1.0) / 2.0 * (high - low)
            });
            let outcome = world.step(&targets);
            contacts += world.data().ncon() as usize;
            pressed += world.pressed().len();
            collided += usize::from(outcome.collided);
            steps += 1;
        }
        world.reset();
    }
    let rate = steps as f64 / start.elapsed().as_secs_f64();
    println!(
        "{rate:.0} control steps/s ({} physics steps each), contacts {:.2}, keys down {:.2}, collisions {:.2}",
        PHYSICS_STEPS,
        contacts as f64 / steps as f64,
        pressed as f64 / steps as f64,
        collided as f64 / steps as f64
    );
}
