//! Prints one episode of a song under random actions, which other engines can repeat: `trace SONG`.
//! In the form of `scripts/check_model.py`: one line for the start and one for each physics step,
//! with the torques and then all joint positions after the step. `benches/run.py` gives it to
//! `mujoco.rollout`.
//!
//! Random torques are not representative: without a controller the hand swings freely and touches
//! little, which is up to twice as fast to simulate.

use std::error::Error;
use std::io::Write as _;

use etude_stage::World;
use etude_task::{ACTION_LEN, Piece, TargetRange, TaskConfig};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

fn main() -> Result<(), Box<dyn Error>> {
    let song = std::env::args().nth(1).ok_or("trace SONG")?;
    let config = TaskConfig::default();
    let piece = Piece::for_task(&etude_music::resolve(&song)?, &config)?;
    let range = TargetRange::new(&piece);
    let mut world = World::new(&config.stage, &config.params()?)?;
    let mut random = Pcg64::seed_from_u64(0);
    let mut text = String::new();
    let mut add = |world: &World| {
        let numbers = world.torques().iter().chain(world.data().qpos());
        text.extend(numbers.map(|number| format!("{number:e} ")));
        text.push('\n');
    };
    add(&world);
    for step in 0..piece.steps() {
        let action: [f32; ACTION_LEN] = std::array::from_fn(|_| random.random_range(-1.0..=1.0));
        world.step_watched(&range.targets(&action, step), &mut add);
    }
    Ok(std::io::stdout().write_all(text.as_bytes())?)
}
