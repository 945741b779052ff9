//! Speed of the environment compared with bare MuJoCo, for `make bench`.

use std::time::Instant;

use etude_learn::{StepBatch, VectorEnvironment};
use etude_music::Song;
use etude_stage::{DRIVEN_JOINTS, World};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

use crate::environment::Environment;
use crate::{ACTION_LEN, PianoVectorEnv, Piece, TargetRange, TaskConfig, TaskError, layout};

/// Rates of one measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepRates {
    /// Control steps per second of one environment: controllers, physics, keys, reward,
    /// observation.
    pub steps_per_sec: f64,
    /// Control steps per second of only the `mj_step` calls that those steps make, under the same
    /// torques.
    pub bare_steps_per_sec: f64,
}

impl StepRates {
    /// Time in addition to MuJoCo's, as a fraction of MuJoCo's.
    pub fn overhead(&self) -> f64 {
        self.bare_steps_per_sec / self.steps_per_sec - 1.0
    }
}

/// Measures with random actions on `song` for about `secs` each. Episodes of the environment and of
/// bare MuJoCo alternate, so that other load on the machine slows both equally.
///
/// # Errors
/// If the configuration is not valid.
pub fn stepping(config: &TaskConfig, song: &Song, secs: f64) -> Result<StepRates, TaskError> {
    let piece = Piece::for_task(song, config)?;
    let range = TargetRange::new(&piece);
    let mut environment = Environment::new(config, &piece, 0)?;
    let mut observer = World::new(&config.stage, &config.params()?)?;
    let mut bare = World::new(&config.stage, &config.params()?)?;
    let mut random = Pcg64::seed_from_u64(0);
    let (mut full_secs, mut bare_secs, mut steps) = (0.0, 0.0, 0u32);
    let mut observation = vec![0.0; layout(config).len()];
    let mut parts = vec![0.0; environment.reward().names().len()];
    while full_secs < secs {
        let actions: Vec<[f32; ACTION_LEN]> =
            (0..piece.steps()).map(|_| std::array::from_fn(|_| random.random_range(-1.0..=1.0))).collect();
        let start = Instant::now();
        for action in &actions {
            environment.step(action, &mut parts);
            environment.observe(&mut observation);
        }
        environment.reset();
        full_secs += start.elapsed().as_secs_f64();
        let mut torques: Vec<[f64; DRIVEN_JOINTS]> = Vec::new();
        for (step, action) in actions.iter().enumerate() {
            observer.step_watched(&range.targets(action, step), |world| torques.push(*world.torques()));
        }
        observer.reset();
        let start = Instant::now();
        for torques in &torques {
            bare.bare_physics_step(torques);
        }
        bare.reset();
        bare_secs += start.elapsed().as_secs_f64();
        steps += piece.steps() as u32;
    }
    Ok(StepRates {
        steps_per_sec: f64::from(steps) / full_secs,
        bare_steps_per_sec: f64::from(steps) / bare_secs,
    })
}

/// Control steps per second over all cores, of four environments a core that step together under
/// random actions, measured for about `secs`.
///
/// # Errors
/// If the configuration is not valid.
pub fn all_cores(config: &TaskConfig, song: &Song, secs: f64) -> Result<f64, TaskError> {
    let piece = Piece::for_task(song, config)?;
    let num_envs = 4 * std::thread::available_parallelism().map_or(1, usize::from);
    let mut vector = PianoVectorEnv::new(config, &piece, num_envs, 0)?;
    let mut batch = StepBatch::new(num_envs, vector.layout(), vector.reward_term_names().len());
    let mut random = Pcg64::seed_from_u64(0);
    let mut actions = vec![0.0; num_envs * ACTION_LEN];
    let (start, mut vector_steps) = (Instant::now(), 0u32);
    while start.elapsed().as_secs_f64() < secs {
        actions.fill_with(|| random.random_range(-1.0..=1.0));
        vector.step(&actions, &mut batch);
        vector_steps += 1;
    }
    Ok(f64::from(vector_steps) * num_envs as f64 / start.elapsed().as_secs_f64())
}
