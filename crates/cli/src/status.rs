//! A status line. On a terminal it changes in place; elsewhere, as in the log of a batch job, a line is written for each new phase
//! and then every 30 s.

use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use crate::progress::target;
use crate::verbs::note;

/// Time between two lines of one phase in a log.
const MENTIONED: Duration = Duration::from_secs(30);

/// The line.
pub struct Status {
    bar: ProgressBar,
    quiet: bool,
    phase: String,
    mentioned: Instant,
}

impl Status {
    /// Writes nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        let bar = ProgressBar::new_spinner();
        bar.set_draw_target(target(quiet));
        Self { bar, quiet, phase: String::new(), mentioned: Instant::now() }
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

impl Drop for Status {
    /// Removes the line, so that the closing lines stand alone.
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
