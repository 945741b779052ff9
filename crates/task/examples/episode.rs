//! Writes the observations of so many control steps as little-endian `f32`, the first of them from
//! the reset: what other languages' packages are compared with, byte for byte
//! (python/tests/test_environments.py plays the same). After the song it begins again.
//!
//! ```text
//! episode SONG SEED STEPS
//! ```

use std::error::Error;
use std::io::Write as _;

use etude_task::{ACTION_LEN, Environment, Piece, TaskConfig, layout};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [song, seed, steps] = arguments.as_slice() else { return Err("episode SONG SEED STEPS".into()) };
    // The preset `paper`, whose world is the Python environments' default.
    let mut preset: toml::Table = include_str!("../../../configs/presets/paper.toml").parse()?;
    let mut config: TaskConfig = preset.remove("task").ok_or("no [task]")?.try_into()?;
    config.randomisation.intensity = 0.5;
    let piece = Piece::for_task(&etude_music::resolve(song)?, &config)?;
    let mut environment = Environment::new(&config, &piece, seed.parse()?)?;
    let mut parts = vec![0.0; environment.reward().names().len()];
    let mut observation = vec![0.0; layout(&config).len()];
    let mut out = std::io::stdout().lock();
    let mut write = |environment: &Environment| {
        environment.observe(&mut observation);
        observation.iter().try_for_each(|value| out.write_all(&value.to_le_bytes()))
    };
    write(&environment)?;
    for step in 0..steps.parse()? {
        // Exact in every language: whole numbers over a thousand.
        let action: [f32; ACTION_LEN] =
            std::array::from_fn(|joint| ((step * 7919_usize + joint * 104_729) % 2001) as f32 / 1000.0 - 1.0);
        if environment.step(&action, &mut parts).song_over {
            environment.reset();
        }
        write(&environment)?;
    }
    Ok(())
}
