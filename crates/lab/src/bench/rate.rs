//! The speed of a whole training.

use std::path::Path;
use std::time::{Duration, Instant};

use etude_learn::{Arithmetic, StopReason, TrainingObserver};
use etude_music::Song;

use crate::config::resolve;
use crate::run::Run;
use crate::song_planner::SongPlanner;

/// Steps with random actions before the first update. The `paper` preset makes 5,000, which would
/// fill a short measurement. Fewer are enough, since a batch is drawn with replacement.
const WARMUP_STEPS: u64 = 256;

/// Environment steps a second of a training of `song` with the `paper` preset, which makes as many
/// updates, in the new folder `folder`. Measures for about `secs` once the warm-up is over:
/// environment, acting, updates and replay together, without evaluations. `threads` as in
/// `trainer.threads`: 0 for one a core.
///
/// # Errors
/// As [`Run::start`] and [`Run::run`].
pub fn training_rate(
    song: Song,
    arithmetic: Arithmetic,
    threads: usize,
    folder: &Path,
    secs: f64,
) -> anyhow::Result<f64> {
    let mut config = resolve("paper", None, &[])?;
    config.droq.arithmetic = arithmetic;
    config.trainer.warmup_steps = WARMUP_STEPS;
    config.trainer.total_steps = u64::MAX;
    config.trainer.evaluate_every_steps = 0;
    config.trainer.threads = threads;
    // The first steps with updates count as warm-up too.
    let warmup_steps = WARMUP_STEPS + 2;
    let limit = Duration::from_secs_f64(secs);
    let mut timer = StepTimer { warmup_steps, limit, steps: 0, began: Instant::now(), took: Duration::ZERO };
    Run::start(Some(song), config, folder, "etude bench", None, &mut SongPlanner::default())?
        .run(&mut timer)?;
    Ok((timer.steps - warmup_steps) as f64 / timer.took.as_secs_f64())
}

/// Counts vector steps, and stops the training when the time after the warm-up is over.
struct StepTimer {
    warmup_steps: u64,
    limit: Duration,
    steps: u64,
    began: Instant,
    took: Duration,
}

impl TrainingObserver for StepTimer {
    fn should_stop(&mut self) -> Option<StopReason> {
        // Asked before each vector step, the first included.
        if self.steps <= self.warmup_steps {
            self.began = Instant::now();
        }
        self.took = self.began.elapsed();
        if self.steps > self.warmup_steps && self.took >= self.limit {
            return Some(StopReason::OutOfTime);
        }
        self.steps += 1;
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_training_is_measured_after_its_warm_up() {
        let folder = tempfile::tempdir().unwrap();
        let song = etude_music::repertoire::get("c-major-scale").unwrap();
        let rate = training_rate(song, Arithmetic::F32, 1, &folder.path().join("run"), 0.05).unwrap();
        assert!(rate > 0.0 && rate.is_finite(), "{rate}");
    }
}
