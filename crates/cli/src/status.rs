//! A status line. On a terminal it changes in place; elsewhere, as in the log of a batch job, it
//! writes a line for each new phase and then every 30 s.

use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use etude_lab::SongPlanner;
use indicatif::{ProgressBar, ProgressDrawTarget};

use crate::output::note;

/// Time between two lines of one phase in a log.
const LOG_INTERVAL: Duration = Duration::from_secs(30);

/// The line.
pub struct Status {
    bar: ProgressBar,
    quiet: bool,
    phase: String,
    last_logged: Instant,
    /// Nothing is written before.
    from: Instant,
    /// When the phase began, and the share that was done then: a resumed phase does not begin at 0.
    begun: (Instant, f64),
}

/// Share of a phase that must be done in this process before the time left is estimated.
const MIN_SHARE: f64 = 0.02;

impl Status {
    /// Writes nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        let hidden = quiet || !std::io::stderr().is_terminal();
        let bar = ProgressBar::new_spinner();
        bar.set_draw_target(if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() });
        let now = Instant::now();
        Self { bar, quiet, phase: String::new(), last_logged: now, from: now, begun: (now, 0.0) }
    }

    /// The same for work that is slow only for long songs: nothing is written in the first second.
    pub fn late(quiet: bool) -> Self {
        let mut status = Self::new(quiet);
        status.from += Duration::from_secs(1);
        status
    }

    /// As [`Self::part`], with the share as the state.
    pub fn share(&mut self, phase: &str, share: f64) {
        self.part(phase, &format!(", {:.0} %", 100.0 * share), share);
    }

    /// As [`Self::now`], for a phase of which a `share` is done, 0 to 1; adds the time left.
    pub fn part(&mut self, phase: &str, state: &str, share: f64) {
        if phase != self.phase {
            self.begun = (Instant::now(), share);
        }
        let (begun, before) = self.begun;
        let left = left_secs(begun.elapsed().as_secs_f64(), before, share)
            .map_or_else(String::new, |secs| format!(", {} left", clock(secs)));
        self.now(phase, &format!("{state}{left}"));
    }

    /// Shows the current phase and its progress.
    pub fn now(&mut self, phase: &str, state: &str) {
        if Instant::now() < self.from {
            return;
        }
        let is_new = phase != self.phase;
        if self.bar.is_hidden() && !self.quiet && (is_new || self.last_logged.elapsed() >= LOG_INTERVAL) {
            note(format!("{phase}{state}"));
            self.last_logged = Instant::now();
        }
        self.bar.set_message(format!("{phase}{state}"));
        self.bar.tick();
        self.phase = phase.to_string();
    }

    /// Writes a line that stays.
    pub fn done(&self, text: &str) {
        if self.bar.is_hidden() && !self.quiet {
            note(text);
        }
        // Does nothing on a hidden bar.
        self.bar.println(text);
    }
}

/// A planner that shows its progress if a plan is slow. Writes nothing if `quiet`.
pub fn planner(quiet: bool) -> SongPlanner<'static> {
    let mut status: Option<Status> = None;
    SongPlanner::new(move |share| {
        status.get_or_insert_with(|| Status::late(quiet)).share("planning the fingering", share);
        // The line is removed before other lines are written.
        status.take_if(|_| share >= 1.0);
    })
}

/// A duration as `m:ss` or hours and minutes.
pub fn clock(secs: f64) -> String {
    let whole = secs.round() as u64;
    let (hours, minutes, secs) = (whole / 3600, whole / 60 % 60, whole % 60);
    if hours > 0 { format!("{hours} h {minutes:02} min") } else { format!("{minutes}:{secs:02}") }
}

/// Time left, if the share `before` was done at first and `share` is `secs` later; none before
/// [`MIN_SHARE`].
fn left_secs(secs: f64, before: f64, share: f64) -> Option<f64> {
    let done = share - before;
    (done >= MIN_SHARE && share < 1.0).then(|| secs / done * (1.0 - share))
}

impl Drop for Status {
    /// Removes the line, so that the closing lines stand alone.
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::{clock, left_secs};

    #[test]
    fn the_time_left_counts_only_this_process() {
        assert_eq!(left_secs(10.0, 0.0, 0.25), Some(30.0));
        assert_eq!(left_secs(10.0, 0.5, 0.75), Some(10.0));
        assert_eq!((left_secs(1.0, 0.5, 0.51), left_secs(9.0, 0.0, 1.0)), (None, None));
    }

    #[test]
    fn durations_are_formatted() {
        assert_eq!((clock(59.6), clock(3725.0)), ("1:00".to_string(), "1 h 02 min".to_string()));
    }
}
