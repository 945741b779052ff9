//! Rows of metrics: sums and rates since the last row.

use std::{path::Path, time::Instant};

use super::{
    metrics::{ELAPSED, Mark, Metrics},
    observer::LogRow,
    sums::Sums,
};
use crate::{droq::Droq, env::Score, files::FileError, replay::Replay};

/// Sums since the last row, the clock, and the files that the rows go to.
pub(super) struct Logger {
    pub metrics: Metrics,
    pub sums: Sums,
    pub term_names: Vec<String>,
    started: Instant,
    /// Seconds of the training before `started`.
    earlier_secs: f64,
    last_row: Instant,
    /// Environment step and updates of the last row.
    last: [u64; 2],
}

impl Logger {
    /// Continues the files in `folder` after `mark`, at an environment step with so many updates.
    pub(super) fn open(
        folder: &Path,
        mark: Mark,
        num_envs: usize,
        term_names: Vec<String>,
        [step, updates]: [u64; 2],
    ) -> Result<Self, FileError> {
        let (metrics, earlier_secs) = Metrics::open(folder, mark)?;
        let (sums, now) = (Sums::new(num_envs, term_names.len()), Instant::now());
        let last = [step, updates];
        Ok(Self { metrics, sums, term_names, started: now, earlier_secs, last_row: now, last })
    }

    /// Wall-clock seconds of the training, over all resumptions.
    pub(super) fn elapsed_secs(&self) -> f64 {
        self.earlier_secs + self.started.elapsed().as_secs_f64()
    }

    /// Writes a row of the means and rates since the last one.
    pub(super) fn write_log(&mut self, step: u64, droq: &Droq, replay: &Replay) -> Result<LogRow, FileError> {
        let mut values = self.sums.take(&self.term_names);
        let secs = self.last_row.elapsed().as_secs_f64().max(1e-9);
        let [last_step, last_updates] = self.last;
        let mut add = |name: &str, value: f64| values.push((name.to_owned(), value));
        add("charts/temperature", droq.temperature());
        add("charts/updates", droq.updates() as f64);
        add("charts/replay", replay.len() as f64);
        add("perf/steps_per_sec", (step - last_step) as f64 / secs);
        add("perf/updates_per_sec", (droq.updates() - last_updates) as f64 / secs);
        add(ELAPSED, self.elapsed_secs());
        (self.last_row, self.last) = (Instant::now(), [step, droq.updates()]);
        self.metrics.write(step, &values)?;
        Ok(LogRow { step, values })
    }

    /// Writes a row of an evaluation's scores.
    pub(super) fn write_evaluation(&mut self, step: u64, scores: &[Score]) -> Result<(), FileError> {
        let values: Vec<_> =
            scores.iter().map(|score| (format!("eval/{}", score.name), score.value)).collect();
        self.metrics.write(step, &values)
    }
}
