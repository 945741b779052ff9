//! The guard: a process of its own that stops the robot when its controller is gone, be it by a panic or by kill -9, or
//! hangs.
//!
//! The controller sends a byte with every slice of time that it has run. Silence, or the end of the pipe without a
//! farewell, means that nobody controls the robot any more. The farewell is said only after the robot has confirmed that it
//! stands still.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use etude_robot::rig::RigConfig;
use etude_robot::stop::{Stopped, stop};

/// Silence after which the guard acts; the controller beats six times as often.
const SILENCE: Duration = Duration::from_millis(300);
/// Silence that it bears before the first beat, while the controller sets itself up; nothing moves until then.
const FIRST_SILENCE: Duration = Duration::from_secs(10);
const BEAT: u8 = b'.';
const FAREWELL: u8 = b'q';
/// What the guard says when it listens.
pub const READY: &str = "on guard";

/// The controller's end.
pub(super) struct Guard {
    child: Child,
    pipe: ChildStdin,
}

impl Guard {
    /// Starts the guard of a rig, this program with the verb for it, and waits until it listens.
    pub fn start(program: &Path, rig: &Path) -> std::io::Result<Self> {
        let mut command = Command::new(program);
        command.args(["robot", "guard", "--robot"]).arg(rig).stdin(Stdio::piped()).stdout(Stdio::piped());
        // Ctrl-C in a terminal goes to the whole group, and the guard must outlive the controller.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn()?;
        let (Some(pipe), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(std::io::ErrorKind::BrokenPipe.into());
        };
        let mut said = String::new();
        BufReader::new(output).read_line(&mut said)?;
        if said.trim_end() != READY {
            let _ = child.wait();
            return Err(std::io::Error::other("it ended at once; its message is above"));
        }
        Ok(Self { child, pipe })
    }

    /// Says that the controller is alive; `false` if the guard is not.
    pub fn beat(&mut self) -> bool {
        self.pipe.write_all(&[BEAT]).is_ok()
    }

    /// Sends the guard home. To be called only when the robot stands still.
    pub fn farewell(&mut self) {
        // A guard that is gone needs no farewell.
        let _ = self.pipe.write_all(&[FAREWELL]);
        let _ = self.child.wait();
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
    let mut patience = FIRST_SILENCE;
    loop {
        match heard.recv_timeout(patience) {
            Ok(FAREWELL) => return None,
            Ok(_) => patience = SILENCE,
            Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => return Some(stop(rig)),
        }
    }
}
