//! The progress of a training, and the request to stop.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use etude_experiment::ATTENDED;
use etude_lab::Training;
use etude_learn::{EvaluationRow, LogRow, Score, StopReason, TrainingObserver};
use etude_perform::{LEARNED_F1, NoteCounts};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::status::Status;

/// Exit code of the shell for a program that Ctrl-C ended.
const INTERRUPTED: i32 = 130;
/// Message of a training after the first request to stop.
pub const STOPPING: &str = "stopping and saving; press Ctrl-C again to end at once without saving";

/// The flag that signals set, once a verb has asked for it.
static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// Set by Ctrl-C, SIGTERM or the end of the terminal, and by the end of standard input if the
/// process [`is_attended`]. A second signal ends the program at once.
pub fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = flag();
    let came = Arc::<AtomicBool>::default();
    for signal in stopping_signals() {
        // Before anything else, so that no signal is lost.
        signal_hook::flag::register(signal, flag.clone())?;
        // In this order, so that it sees whether there was a signal before.
        signal_hook::flag::register_conditional_shutdown(signal, INTERRUPTED, came.clone())?;
        signal_hook::flag::register(signal, came.clone())?;
    }
    Ok(flag)
}

/// Set by Ctrl-C, SIGTERM or the end of the terminal, however often they come.
pub fn patient_stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = flag();
    for signal in stopping_signals() {
        signal_hook::flag::register(signal, flag.clone())?;
    }
    Ok(flag)
}

/// Whether one of these signals has come.
pub fn is_stop_requested() -> bool {
    STOP.get().is_some_and(|flag| flag.load(Ordering::Relaxed))
}

/// Signals that request a stop. SIGHUP is not one of them under `nohup`, which ignores it.
fn stopping_signals() -> impl Iterator<Item = i32> {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    [SIGINT, SIGTERM, SIGHUP].into_iter().filter(move |signal| *signal != SIGHUP || ignored & 1 == 0)
}

/// Whether another program launched this process, and attends to it.
pub fn is_attended() -> bool {
    std::env::var_os(ATTENDED).is_some()
}

/// The flag. If the process [`is_attended`], it is set when standard input ends: the process at its
/// other end has closed it or has ended.
fn flag() -> Arc<AtomicBool> {
    let flag = STOP.get_or_init(Arc::default).clone();
    if is_attended() {
        let flag = flag.clone();
        std::thread::spawn(move || {
            let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
            flag.store(true, Ordering::Relaxed);
        });
    }
    flag
}

/// Shows a training and stops it on request.
pub struct Progress {
    stop: Arc<AtomicBool>,
    limit: Option<Duration>,
    started: Instant,
    status: Status,
    total: u64,
    best_f1: f64,
    is_stop_noted: bool,
}

impl Progress {
    /// Progress of `run`, with a time `limit`. `quiet` writes nothing.
    pub fn new(run: &Training, limit: Option<Duration>, quiet: bool, stop: Arc<AtomicBool>) -> Self {
        Self {
            stop,
            limit,
            started: Instant::now(),
            status: Status::new(quiet),
            total: run.config().trainer.total_steps,
            best_f1: run.best_scores().first().map_or(0.0, |f1| f1.value),
            is_stop_noted: false,
        }
    }

    /// The share of the time limit that has passed.
    fn time_share(&self) -> f64 {
        self.limit.map_or(0.0, |limit| self.started.elapsed().as_secs_f64() / limit.as_secs_f64())
    }
}

/// An evaluation in words: notes, then F1. None without scores.
pub fn evaluation_summary(scores: &[Score]) -> Option<String> {
    let f1 = format!("F1 {:.3}", scores.first()?.value);
    Some(NoteCounts::of_evaluation(scores).map_or_else(|| f1.clone(), |notes| format!("{notes}, {f1}")))
}

impl TrainingObserver for Progress {
    fn on_log(&mut self, row: &LogRow) {
        let share = (row.step as f64 / self.total.max(1) as f64).max(self.time_share()).min(1.0);
        self.status.part("learning", &format!(", step {} of {}", row.step, self.total), share);
    }

    fn on_evaluation(&mut self, row: &EvaluationRow) {
        let Some(summary) = evaluation_summary(&row.scores) else { return };
        if row.best {
            self.best_f1 = row.scores[0].value;
        }
        let learned = row.scores.iter().find(|score| score.name == LEARNED_F1);
        let learned = learned.map_or_else(String::new, |f1| format!(", {:.3} on learned pieces", f1.value));
        let secs = self.started.elapsed().as_secs_f64();
        self.status.done(&format!(
            "{secs:>7.0} s  {summary}{learned} (best {:.3})  step {}",
            self.best_f1, row.step
        ));
    }

    fn should_stop(&mut self) -> Option<StopReason> {
        if self.stop.load(Ordering::Relaxed) {
            if !std::mem::replace(&mut self.is_stop_noted, true) {
                self.status.done(STOPPING);
            }
            return Some(StopReason::Requested);
        }
        (self.time_share() >= 1.0).then_some(StopReason::OutOfTime)
    }
}

#[cfg(test)]
mod tests {
    use etude_learn::Score;

    use super::evaluation_summary;

    #[test]
    fn notes_come_first() {
        let score = |(name, value): (&str, f64)| Score { name: name.to_string(), value };
        let counted =
            [("f1", 0.96), ("notes_right", 12.0), ("notes_missed", 2.0), ("notes_wrong", 3.0)].map(score);
        assert_eq!(evaluation_summary(&counted).unwrap(), "12 of 14 notes right, 3 wrong, F1 0.960");
        assert_eq!(evaluation_summary(&counted[..1]).unwrap(), "F1 0.960");
        assert_eq!(evaluation_summary(&[]), None);
    }
}
