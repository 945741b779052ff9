//! Updates per second on this machine, for `make bench` and the comparison in `benches/peers`.

use std::time::{Duration, Instant};

use crate::{
    config::DroqConfig,
    droq::Droq,
    env::ObservationLayout,
    random::Stream,
    replay::{Replay, Transition},
    trainer::{TrainError, thread_pool},
};

/// Length of the actions, and columns of the observations, of the paper's task.
const ACTION: usize = 13;
const LAYOUT: ObservationLayout = ObservationLayout { real: 26, binary: 343 };
/// Ones among the binary columns of an average observation: a few keys now and in each frame ahead.
const ONES: usize = 15;

/// Full updates (both critics, actor, temperature, targets) a second, on random transitions of the
/// paper's sizes.
///
/// Measures for about `seconds` after a warm-up of a tenth of that, on `threads` threads; a batch
/// of 256 can use four.
///
/// # Errors
/// If the configuration is not sound or the threads cannot be started.
pub fn update_rate(config: &DroqConfig, seconds: f64, threads: usize) -> Result<f64, TrainError> {
    config.check()?;
    let pool = thread_pool(threads)?;
    let mut stream = Stream::new(0, "bench");
    let mut replay = Replay::new(LAYOUT, ACTION, 20_000, 1);
    let observation = |stream: &mut Stream| {
        let mut observation: Vec<f32> = (0..LAYOUT.real).map(|_| 2.0 * stream.uniform() - 1.0).collect();
        observation.resize(LAYOUT.len(), 0.0);
        (0..ONES).for_each(|_| observation[LAYOUT.real + stream.below(LAYOUT.binary)] = 1.0);
        observation
    };
    for _ in 0..20_000 {
        let (before, after) = (observation(&mut stream), observation(&mut stream));
        let action: Vec<f32> = (0..ACTION).map(|_| 2.0 * stream.uniform() - 1.0).collect();
        let reward = stream.uniform();
        replay.push(Transition {
            observation: &before,
            action: &action,
            reward,
            ends: false,
            next_observation: &after,
        });
    }
    let mut droq = Droq::new(config, LAYOUT, ACTION, 0);
    Ok(pool.install(|| {
        let parallel = rayon::current_num_threads() > 1;
        run(&mut droq, &replay, parallel, 0.1 * seconds);
        run(&mut droq, &replay, parallel, seconds)
    }))
}

fn run(droq: &mut Droq, replay: &Replay, parallel: bool, seconds: f64) -> f64 {
    let (start, limit) = (Instant::now(), Duration::from_secs_f64(seconds.max(0.0)));
    let mut updates = 0u32;
    loop {
        droq.learn(replay, parallel);
        updates += 1;
        if start.elapsed() >= limit {
            return f64::from(updates) / start.elapsed().as_secs_f64();
        }
    }
}
