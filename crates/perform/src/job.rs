//! Work that takes long: how it reports progress, and how it is interrupted.

use std::sync::atomic::{AtomicBool, Ordering};

/// Passed to a function that runs for long: a callback for its progress, and the flag that ends it early. `E` is the type of its
/// reports.
pub struct Job<'a, E> {
    report: &'a mut (dyn FnMut(&E) + Send + 'a),
    interrupt: &'a AtomicBool,
}

impl<'a, E> Job<'a, E> {
    /// A job that reports to `report` and ends soon after `interrupt` is set.
    pub fn new(report: &'a mut (dyn FnMut(&E) + Send + 'a), interrupt: &'a AtomicBool) -> Self {
        Self { report, interrupt }
    }

    /// Reports progress.
    pub fn tell(&mut self, event: &E) {
        (self.report)(event);
    }

    /// Whether the work must end.
    pub fn is_interrupted(&self) -> bool {
        self.interrupt.load(Ordering::Relaxed)
    }

    /// The flag itself, for a part of the work that reports nothing.
    pub fn interrupt(&self) -> &'a AtomicBool {
        self.interrupt
    }

    /// Runs a part of the work; `translate` turns its reports into reports of this job.
    pub fn part<P, R>(
        &mut self,
        translate: impl Fn(&P) -> E + Send,
        work: impl FnOnce(&mut Job<'_, P>) -> R,
    ) -> R {
        let report = &mut *self.report;
        let mut translated = move |event: &P| report(&translate(event));
        work(&mut Job::new(&mut translated, self.interrupt))
    }
}
