//! A status line. On a terminal it changes in place; elsewhere, as in the log of a batch job, a line is written for each new phase
//! and then every 30 s.

use std::time::{Duration, Instant};

use etude_lab::planning_told;
use indicatif::ProgressBar;

use crate::progress::{clock, target};
use crate::verbs::note;

/// Time between two lines of one phase in a log.
const MENTIONED: Duration = Duration::from_secs(30);

/// The line.
pub struct Status {
    bar: ProgressBar,
    quiet: bool,
    phase: String,
    mentioned: Instant,
    /// When the phase began, and the share of it that was done then: some of it may be from before a stop.
    begun: (Instant, f64),
}

/// How much of a phase must be done in this process before the rest of it is estimated.
const ENOUGH: f64 = 0.02;

impl Status {
    /// Writes nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        let bar = ProgressBar::new_spinner();
        bar.set_draw_target(target(quiet));
        Self { bar, quiet, phase: String::new(), mentioned: Instant::now(), begun: (Instant::now(), 0.0) }
    }

    /// The same for a phase of which a `share` is done, 0 to 1: says how long it still takes. `phase` is what does not change in it.
    pub fn part(&mut self, phase: &str, state: &str, share: f64) {
        if phase != self.phase {
            self.begun = (Instant::now(), share);
        }
        let (begun, before) = self.begun;
        let left = left_secs(begun.elapsed().as_secs_f64(), before, share)
            .map_or_else(String::new, |secs| format!(", {} left", clock(secs)));
        self.now(phase, &format!("{state}{left}"));
    }

    /// The current phase and its progress.
    pub fn now(&mut self, phase: &str, state: &str) {
        let is_new = phase != self.phase;
        if self.bar.is_hidden() && !self.quiet && (is_new || self.mentioned.elapsed() >= MENTIONED) {
            note(format!("{phase}{state}"));
            self.mentioned = Instant::now();
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

/// Work that takes long for a long song alone: nothing is said in the first second.
pub struct LongWork {
    status: Status,
    begun: Instant,
    is_said: bool,
}

impl LongWork {
    /// Says nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        Self { status: Status::new(quiet), begun: Instant::now(), is_said: false }
    }

    /// Says what share of the fingering is planned.
    pub fn planned(&mut self, share: f64) {
        if share < 1.0 {
            self.part("planning the fingering", share);
        } else if self.is_said {
            self.status.now("the fingering is planned", "");
        }
    }

    /// Says what share of a phase is done.
    pub fn part(&mut self, phase: &str, share: f64) {
        if self.begun.elapsed() >= Duration::from_secs(1) {
            self.is_said = true;
            self.status.part(phase, &format!(", {:.0} %", 100.0 * share), share);
        }
    }
}

/// Does `work`, and says how far its planning is if that takes long. Says nothing if `quiet`.
pub fn while_planning<T>(quiet: bool, work: impl FnOnce() -> T) -> T {
    let mut planning = Some(LongWork::new(quiet));
    let listener = move |share: f64| {
        if let Some(now) = &mut planning {
            now.planned(share);
        }
        // What the work says next has the line to itself.
        planning.take_if(|_| share >= 1.0);
    };
    planning_told(listener, work)
}

/// Time until all is done, if the share `before` was done at first and `share` is `secs` later; none while there is too little to say so.
fn left_secs(secs: f64, before: f64, share: f64) -> Option<f64> {
    let done = share - before;
    (done >= ENOUGH && share < 1.0).then(|| secs / done * (1.0 - share))
}

impl Drop for Status {
    /// Removes the line, so that the closing lines stand alone.
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::left_secs;

    #[test]
    fn the_time_left_counts_what_was_done_here_alone() {
        assert_eq!(left_secs(10.0, 0.0, 0.25), Some(30.0));
        assert_eq!(left_secs(10.0, 0.5, 0.75), Some(10.0));
        assert_eq!((left_secs(1.0, 0.5, 0.51), left_secs(9.0, 0.0, 1.0)), (None, None));
    }
}
