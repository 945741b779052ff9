//! A status line. On a terminal it changes in place; elsewhere, as in the log of a batch job, a line is written for each new phase
//! and then every 30 s.

use std::io::IsTerminal as _;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use crate::verbs::note;

/// Time between two lines of one phase in a log.
const MENTIONED: Duration = Duration::from_secs(30);

/// The line.
pub struct Status {
    bar: Option<ProgressBar>,
    quiet: bool,
    phase: String,
    mentioned: Instant,
}

impl Status {
    /// Writes nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(ProgressBar::new_spinner);
        Self { bar, quiet, phase: String::new(), mentioned: Instant::now() }
    }

    /// The current phase and its progress.
    pub fn now(&mut self, phase: &str, state: &str) {
        let is_new = phase != self.phase;
        match &self.bar {
            Some(bar) => {
                bar.set_message(format!("{phase}{state}"));
                bar.tick();
            }
            None if !self.quiet && (is_new || self.mentioned.elapsed() >= MENTIONED) => {
                note(format!("{phase}{state}"));
                self.mentioned = Instant::now();
            }
            None => {}
        }
        if is_new {
            self.phase = phase.to_string();
        }
    }

    /// Writes a line that stays.
    pub fn done(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.println(text),
            None if self.quiet => {}
            None => note(text),
        }
    }
}

impl Drop for Status {
    /// Removes the line, so that the closing lines stand alone.
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
