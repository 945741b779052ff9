//! Real-time priority: while a robot has power, the thread that controls it comes before other
//! programs, and its memory is not swapped out.
//!
//! Linux allows it to root, or within the limits `rtprio` and `memlock` of a user
//! (`/etc/security/limits.conf`, `man limits.conf`).

use std::io::Result;

/// Real-time priority of one thread, until it is dropped. Threads and processes that this thread
/// starts do not inherit it.
#[derive(Debug)]
pub struct Priority(system::Raised);

/// Where a thread stands among those with real-time priority.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rank {
    /// What the controller waits for, and must not be held up by: the policy, the simulation beside
    /// the robot, the recording.
    Worker = 49,
    /// The controller, and a twin that stands in for hardware.
    Controller = 50,
    /// The guard, which must be able to act when the controller does not end.
    Guard = 51,
}

impl Priority {
    /// Gives it to this thread, and, except for a worker, locks the memory of this process where
    /// that cannot make a later allocation fail.
    ///
    /// # Errors
    /// If the system does not permit it.
    pub fn of_this_thread(rank: Rank) -> Result<Self> {
        system::raise(rank as i32, rank != Rank::Worker).map(Self)
    }

    /// Whether memory is locked too.
    pub fn locks_memory(&self) -> bool {
        self.0.locked
    }
}

#[cfg(target_os = "linux")]
#[allow(unsafe_code)] // Calls of the C library that take numbers and one small structure.
mod system {
    use std::io::{Error, Result};

    #[derive(Debug)]
    pub struct Raised {
        thread: libc::pid_t,
        pub locked: bool,
    }

    /// Sets the policy of a thread.
    fn schedule(thread: libc::pid_t, policy: libc::c_int, priority: libc::c_int) -> Result<()> {
        // SAFETY: all fields of the structure are numbers, and zero is valid for each.
        let mut param: libc::sched_param = unsafe { std::mem::zeroed() };
        param.sched_priority = priority;
        // SAFETY: the pointer is that of a whole structure, which the call only reads.
        let result = unsafe { libc::sched_setscheduler(thread, policy, &raw const param) };
        if result == 0 { Ok(()) } else { Err(Error::last_os_error()) }
    }

    /// Whether memory may be locked without a limit, beyond which allocations would fail.
    fn unlimited() -> bool {
        let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
        // SAFETY: the pointer is that of a whole structure, which the call fills; the other call
        // takes nothing.
        let [read, user] =
            unsafe { [libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit), libc::geteuid() as i32] };
        user == 0 || (read == 0 && limit.rlim_cur == libc::RLIM_INFINITY)
    }

    pub fn raise(priority: libc::c_int, lock: bool) -> Result<Raised> {
        // SAFETY: takes nothing, and cannot fail.
        let thread = unsafe { libc::gettid() };
        schedule(thread, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, priority)?;
        // Pages are locked when they are first used: a process reserves far more than it uses.
        let flags = libc::MCL_CURRENT | libc::MCL_FUTURE | libc::MCL_ONFAULT;
        // SAFETY: takes flags alone.
        let locked = lock && unlimited() && unsafe { libc::mlockall(flags) } == 0;
        Ok(Raised { thread, locked })
    }

    impl Drop for Raised {
        fn drop(&mut self) {
            // A thread that has ended needs neither.
            let _ = schedule(self.thread, libc::SCHED_OTHER, 0);
            if self.locked {
                // SAFETY: takes nothing.
                unsafe { libc::munlockall() };
            }
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod system {
    use std::io::{ErrorKind, Result};

    #[derive(Debug)]
    pub struct Raised {
        pub locked: bool,
    }

    pub fn raise(_: i32, _: bool) -> Result<Raised> {
        Err(ErrorKind::Unsupported.into())
    }
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use super::*;

    /// Fields 40 and 41 of `/proc/thread-self/stat` (`man proc_pid_stat`): the priority, and the
    /// policy, of which 1 is SCHED_FIFO.
    fn scheduled() -> [i32; 2] {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        // The name, which may hold spaces, ends with the last bracket; the third field comes after
        // it.
        let (_, rest) = stat.rsplit_once(") ").unwrap();
        let mut fields = rest.split_whitespace().skip(40 - 3);
        std::array::from_fn(|_| fields.next().unwrap().parse().unwrap())
    }

    #[test]
    fn a_thread_has_it_until_the_end_and_its_threads_do_not() {
        assert_eq!(scheduled(), [0, 0]);
        match Priority::of_this_thread(Rank::Controller) {
            Ok(priority) => {
                assert_eq!(scheduled(), [50, 1]);
                assert_eq!(std::thread::spawn(scheduled).join().unwrap(), [0, 0]);
                let worker = std::thread::spawn(|| {
                    let worker = Priority::of_this_thread(Rank::Worker).unwrap();
                    (scheduled(), worker.locks_memory())
                });
                assert_eq!(worker.join().unwrap(), ([49, 1], false));
                drop(priority);
            }
            Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::PermissionDenied),
        }
        assert_eq!(scheduled(), [0, 0]);
    }
}
