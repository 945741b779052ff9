//! The thread that computes what a controller by the wall clock waits for.

use std::sync::atomic::{AtomicBool, Ordering};

use etude_robot::priority::{Priority, Rank};
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// One thread, kept from one control step to the next: a new thread has normal priority until it
/// runs for the first time, and on a busy machine that took up to 145 ms.
#[derive(Debug)]
pub struct Worker(ThreadPool);

impl Worker {
    /// Starts it, with real-time priority where the system permits that.
    ///
    /// # Errors
    /// If the system has no thread left.
    pub fn start() -> Result<Self, ThreadPoolBuildError> {
        let raise = |_| {
            // It has it as long as the thread lives.
            let _ = Priority::of_this_thread(Rank::Worker).map(std::mem::forget);
        };
        ThreadPoolBuilder::new().num_threads(1).start_handler(raise).build().map(Self)
    }

    /// Does `work` there and calls `meanwhile` here until it is done. A panic of the work is one of
    /// the caller.
    pub fn run(&self, work: &mut (dyn FnMut() + Send), mut meanwhile: impl FnMut()) {
        /// Says so also after a panic.
        struct Done<'a>(&'a AtomicBool);
        impl Drop for Done<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Release);
            }
        }
        let is_done = AtomicBool::new(false);
        self.0.in_place_scope(|scope| {
            scope.spawn(|_| {
                let _done = Done(&is_done);
                work();
            });
            while !is_done.load(Ordering::Acquire) {
                meanwhile();
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::thread;

    use super::*;

    #[test]
    fn all_work_is_done_by_one_thread_with_its_priority() {
        let worker = Worker::start().unwrap();
        let mut seen = Vec::new();
        for _ in 0..3 {
            let mut turns = 0;
            worker.run(
                &mut || {
                    let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
                    // Field 40, the priority, counted from the third, which is after the name.
                    let priority =
                        stat.rsplit_once(") ").unwrap().1.split(' ').nth(40 - 3).unwrap().to_string();
                    seen.push((thread::current().id(), priority));
                    thread::sleep(std::time::Duration::from_millis(5));
                },
                || {
                    turns += 1;
                    thread::yield_now();
                },
            );
            assert!(turns > 0);
        }
        let permitted = thread::spawn(|| Priority::of_this_thread(Rank::Worker).is_ok()).join().unwrap();
        let priority = if permitted { "49" } else { "0" };
        assert_ne!(seen[0].0, thread::current().id());
        assert!(seen.iter().all(|found| *found == (seen[0].0, priority.to_string())), "{seen:?}");
    }

    #[test]
    fn a_panic_of_the_work_is_one_of_the_caller() {
        let worker = Worker::start().unwrap();
        let panics = AssertUnwindSafe(|| worker.run(&mut || panic!("the work's"), || {}));
        assert!(catch_unwind(panics).is_err());
        let mut done = false;
        worker.run(&mut || done = true, || {});
        assert!(done);
    }
}
