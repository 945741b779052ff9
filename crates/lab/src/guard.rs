//! The guard: a process of its own that stops the robot when its controller is gone, be it by a panic or by kill -9, or
//! hangs.
//!
//! The controller sends a byte with every slice of time that it has run. Silence or the end of the pipe without a
//! farewell means that nobody controls the robot any more.

use std::io::{Read as _, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use etude_robot::rig::RigConfig;
use etude_robot::stop::{Stopped, stop};
use etude_robot::wires::Wires;
use etude_robot::{Pace, Robot};

/// Longest time between two beats of a controller that runs.
const BEAT_PERIOD: Duration = Duration::from_millis(50);
/// Silence after which the guard acts.
const SILENCE: Duration = Duration::from_millis(300);
const BEAT: u8 = b'.';
const FAREWELL: u8 = b'q';

/// The controller's end.
pub(crate) struct Guard {
    child: Child,
    pipe: Option<ChildStdin>,
}

impl Guard {
    /// Starts the guard of a rig: this program with the verb for it.
    pub fn start(program: &Path, rig: &Path) -> std::io::Result<Self> {
        let mut command = Command::new(program);
        command.args(["robot", "guard", "--robot"]).arg(rig).stdin(Stdio::piped()).stdout(Stdio::null());
        // Ctrl-C in a terminal goes to the whole group, and the guard must outlive the controller.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let pipe = child.stdin.take();
        Ok(Self { child, pipe })
    }

    fn beat(&mut self) {
        // A guard that is gone is noticed when the robot is stopped; it cannot be helped in the middle of a song.
        if let Some(pipe) = &mut self.pipe {
            let _ = pipe.write_all(&[BEAT]);
        }
    }
}

impl Drop for Guard {
    /// A controller that comes to its end in order needs no guard. One that panics says no farewell.
    fn drop(&mut self) {
        if let (Some(mut pipe), false) = (self.pipe.take(), std::thread::panicking()) {
            let _ = pipe.write_all(&[FAREWELL]);
        }
        let _ = self.child.wait();
    }
}

/// Time that a guard watches.
pub(crate) struct Guarded<P> {
    pub pace: P,
    pub guard: Guard,
}

impl<P: Pace> Pace for Guarded<P> {
    fn now(&self) -> Duration {
        self.pace.now()
    }

    fn run_until(&mut self, robot: &mut Robot, until: Duration) {
        loop {
            self.guard.beat();
            let next = (self.pace.now() + BEAT_PERIOD).min(until);
            self.pace.run_until(robot, next);
            if next >= until {
                return;
            }
        }
    }

    fn wires(&mut self) -> &mut dyn Wires {
        self.pace.wires()
    }
}

/// The guard's end: waits for the controller's bytes on standard input; stops the robot when they stay away. `None` if the
/// controller said farewell.
pub fn stand_guard(rig: &RigConfig) -> Option<Stopped> {
    let (beats, heard) = channel();
    std::thread::spawn(move || {
        let mut byte = [0];
        while matches!(std::io::stdin().read(&mut byte), Ok(1)) && beats.send(byte[0]).is_ok() {}
    });
    loop {
        match heard.recv_timeout(SILENCE) {
            Ok(FAREWELL) => return None,
            Ok(_) => {}
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return Some(stop(rig)),
        }
    }
}
