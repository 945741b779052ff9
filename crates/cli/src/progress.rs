//! Progress of a training: a bar on a terminal, plain lines elsewhere, and the request to stop.

use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use etude_lab::Run;
use etude_learn::{EvaluationRow, LogRow, Score, StopReason, TrainingObserver};
use etude_perform::{LEARNED_F1, NoteCounts};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::output::note;

/// Exit code of the shell for a program that Ctrl-C ended.
const INTERRUPTED: i32 = 130;
/// Message of a training after the first request to stop.
pub const STOPPING: &str = "stopping and saving; press Ctrl-C again to end at once without saving";

/// Environment variable: the process stops when its standard input ends.
pub const ATTENDED: &str = "ETUDE_ATTENDED";

/// The flag that signals set, once a verb has asked for it.
static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// Set by Ctrl-C, SIGTERM or the end of the terminal, and by the end of standard input if the
/// process is [`ATTENDED`]. A second signal ends the program at once.
pub fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = STOP.get_or_init(Arc::default).clone();
    if std::env::var_os(ATTENDED).is_some() {
        stop_when_unattended(&flag);
    }
    for signal in stopping_signals() {
        // Registered first, so that it sees the flag of the previous signal.
        signal_hook::flag::register_conditional_shutdown(signal, INTERRUPTED, flag.clone())?;
        signal_hook::flag::register(signal, flag.clone())?;
    }
    Ok(flag)
}

/// Set by Ctrl-C, SIGTERM or the end of the terminal, however often they come.
pub fn patient_stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = STOP.get_or_init(Arc::default).clone();
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

/// Sets the flag when standard input ends: the process at its other end has closed it or has ended.
pub fn stop_when_unattended(flag: &Arc<AtomicBool>) {
    let flag = flag.clone();
    std::thread::spawn(move || {
        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
        flag.store(true, Ordering::Relaxed);
    });
}

/// Progress is drawn on standard error if that is a terminal, else not at all.
pub fn target(quiet: bool) -> ProgressDrawTarget {
    let hidden = quiet || !std::io::stderr().is_terminal();
    if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() }
}

/// A bar of `total` parts with the text `right` beside it, hidden if `quiet` or where standard
/// error is no terminal.
pub fn bar(total: u64, right: &str, quiet: bool) -> ProgressBar {
    let style = ProgressStyle::with_template(&format!("{{bar:32}} {{percent:>3}} %  {right}"));
    ProgressBar::with_draw_target(Some(total), target(quiet))
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Shows a training and stops it on request.
pub struct Progress {
    stop: Arc<AtomicBool>,
    deadline: Option<Instant>,
    quiet: bool,
    bar: ProgressBar,
    total: u64,
    started: Instant,
    first_step: u64,
    last: Vec<Score>,
    best: Vec<Score>,
    is_stop_noted: bool,
}

impl Progress {
    /// Progress of `run`, with a time `limit`. `quiet` writes nothing.
    pub fn new(run: &Run, limit: Option<Duration>, quiet: bool, stop: Arc<AtomicBool>) -> Self {
        let total = run.config().trainer.total_steps;
        let started = Instant::now();
        Self {
            stop,
            deadline: limit.and_then(|limit| started.checked_add(limit)),
            quiet,
            bar: bar(total, "{msg}", quiet),
            total,
            started,
            first_step: run.step(),
            last: Vec::new(),
            best: run.best_scores().to_vec(),
            is_stop_noted: false,
        }
    }

    /// Removes the bar, so that the closing lines stand alone.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn message(&self, step: u64) -> String {
        let best = self.best.first().map_or(0.0, |f1| f1.value);
        let played = match evaluation_summary(&self.last) {
            None => "not yet evaluated".to_string(),
            Some(last) => {
                let learned = self.last.iter().find(|score| score.name == LEARNED_F1);
                let learned =
                    learned.map_or_else(String::new, |f1| format!(", {:.3} on learned pieces", f1.value));
                format!("{last}{learned} (best {best:.3})")
            }
        };
        // A warm start is evaluated before its first step, so it has no speed yet.
        if step == self.first_step {
            return format!("{played}  step {step}");
        }
        let rate =
            step.saturating_sub(self.first_step) as f64 / self.started.elapsed().as_secs_f64().max(1e-3);
        let by_steps = self.total.saturating_sub(step) as f64 / rate.max(1e-3);
        let left = self.deadline.map_or(by_steps, |deadline| {
            by_steps.min(deadline.saturating_duration_since(Instant::now()).as_secs_f64())
        });
        format!("{played}  step {step}  {rate:.0} steps/s  {} left", clock(left))
    }
}

/// An evaluation in words: notes, then F1. None without scores.
pub fn evaluation_summary(scores: &[Score]) -> Option<String> {
    let f1 = format!("F1 {:.3}", scores.first()?.value);
    Some(NoteCounts::of_evaluation(scores).map_or_else(|| f1.clone(), |notes| format!("{notes}, {f1}")))
}

/// A duration as `m:ss` or hours and minutes.
pub fn clock(secs: f64) -> String {
    let whole = secs.round() as u64;
    let (hours, minutes, secs) = (whole / 3600, whole / 60 % 60, whole % 60);
    if hours > 0 { format!("{hours} h {minutes:02} min") } else { format!("{minutes}:{secs:02}") }
}

impl TrainingObserver for Progress {
    fn on_log(&mut self, row: &LogRow) {
        self.bar.set_position(row.step);
        self.bar.set_message(self.message(row.step));
    }

    fn on_evaluation(&mut self, row: &EvaluationRow) {
        self.last.clone_from(&row.scores);
        if row.best {
            self.best.clone_from(&row.scores);
        }
        let message = self.message(row.step);
        if self.bar.is_hidden() && !self.quiet {
            note(format!("{:>7.0} s  {message}", self.started.elapsed().as_secs_f64()));
        }
        self.bar.set_message(message);
    }

    fn should_stop(&mut self) -> Option<StopReason> {
        if self.stop.load(Ordering::Relaxed) {
            if !self.quiet && !std::mem::replace(&mut self.is_stop_noted, true) {
                self.finish();
                note(STOPPING);
            }
            return Some(StopReason::Requested);
        }
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline).then_some(StopReason::OutOfTime)
    }
}

#[cfg(test)]
mod tests {
    use etude_learn::Score;

    use super::{clock, evaluation_summary};

    #[test]
    fn notes_come_first() {
        let score = |(name, value): (&str, f64)| Score { name: name.to_string(), value };
        let counted =
            [("f1", 0.96), ("notes_right", 12.0), ("notes_missed", 2.0), ("notes_wrong", 3.0)].map(score);
        assert_eq!(evaluation_summary(&counted).unwrap(), "12 of 14 notes right, 3 wrong, F1 0.960");
        assert_eq!(evaluation_summary(&counted[..1]).unwrap(), "F1 0.960");
        assert_eq!(evaluation_summary(&[]), None);
    }

    #[test]
    fn durations_are_formatted() {
        assert_eq!((clock(59.6), clock(3725.0)), ("1:00".to_string(), "1 h 02 min".to_string()));
    }
}
