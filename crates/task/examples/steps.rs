//! Control steps a second of environments that step together: what `benches/python_steps.py` holds
//! the Python package against.
//!
//! ```text
//! steps SONG ENVIRONMENTS THREADS SECS ACTIONS
//! ```
//!
//! `ACTIONS` is a file of little-endian `f32`, `[rounds, environments, 13]`; they are played over
//! and over.

use std::error::Error;
use std::io::Write as _;
use std::time::Instant;

use etude_learn::{StepBatch, VectorEnvironment as _};
use etude_task::{ACTION_LEN, PianoVectorEnv, Piece, TaskConfig};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [song, num_envs, threads, secs, actions] = arguments.as_slice() else {
        return Err("steps SONG ENVIRONMENTS THREADS SECS ACTIONS".into());
    };
    let (num_envs, secs): (usize, f64) = (num_envs.parse()?, secs.parse()?);
    let config = TaskConfig::default();
    let piece = Piece::for_task(&etude_music::resolve(song)?, &config)?;
    let mut vector = PianoVectorEnv::new(&config, &piece, num_envs, 0)?;
    let mut batch = StepBatch::new(num_envs, vector.layout(), vector.reward_term_names().len());
    let bytes = std::fs::read(actions)?;
    let (values, _) = bytes.as_chunks::<4>();
    let actions: Vec<f32> = values.iter().map(|value| f32::from_le_bytes(*value)).collect();
    let actions: Vec<&[f32]> = actions.chunks_exact(num_envs * ACTION_LEN).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.parse()?).build()?;
    let rate = pool.install(|| {
        let (start, mut rounds) = (Instant::now(), 0);
        while start.elapsed().as_secs_f64() < secs {
            vector.step(actions[rounds % actions.len()], &mut batch);
            rounds += 1;
        }
        (rounds * num_envs) as f64 / start.elapsed().as_secs_f64()
    });
    Ok(writeln!(std::io::stdout(), "{rate}")?)
}
