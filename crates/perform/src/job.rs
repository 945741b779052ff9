//! Work that takes long: how it reports progress, and how it is interrupted.

use std::sync::atomic::{AtomicBool, Ordering};

/// Passed to a function that runs for long: a callback for its progress, and the flag that ends it
/// early. `E` is the type of its reports.
pub struct Job<'a, E> {
    on_progress: &'a mut (dyn FnMut(&E) + Send + 'a),
    interrupt: &'a AtomicBool,
}

impl<'a, E> Job<'a, E> {
    /// A job that reports to `on_progress` and ends soon after `interrupt` is set.
    pub fn new(on_progress: &'a mut (dyn FnMut(&E) + Send + 'a), interrupt: &'a AtomicBool) -> Self {
        Self { on_progress, interrupt }
    }

    /// Reports progress.
    pub fn report(&mut self, event: &E) {
        (self.on_progress)(event);
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
        let on_progress = &mut *self.on_progress;
        let mut translated = move |event: &P| on_progress(&translate(event));
        work(&mut Job::new(&mut translated, self.interrupt))
    }
}
