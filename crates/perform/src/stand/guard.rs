//! The guard: a separate process. It stops the robot when the controller has ended, for example by a panic or by kill -9, or
//! hangs.
//!
//! The controller sends a byte at least every 50 ms. If no byte arrives for 300 ms, or the pipe ends without the byte for a
//! regular end, the guard stops the robot. The controller sends that byte only after the robot has confirmed that it stands still.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use etude_robot::rig::RigConfig;
use etude_robot::stop::{Stopped, stop};

/// Time without a byte after which the guard acts; the controller sends six times as often.
const SILENCE: Duration = Duration::from_millis(300);
/// The same before the first byte, while the controller starts; nothing moves until then.
const FIRST_SILENCE: Duration = Duration::from_secs(10);
const BEAT: u8 = b'.';
const FAREWELL: u8 = b'q';
/// The guard prints this line when it is ready.
pub const READY: &str = "on guard";

/// The controller's side of the pipe.
pub(super) struct Guard {
    child: Child,
    pipe: ChildStdin,
}

impl Guard {
    /// Starts the guard of a rig (`PROGRAM robot guard`) and waits until it is ready.
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

    /// Sends a sign of life; `false` if the guard has ended.
    pub fn beat(&mut self) -> bool {
        self.pipe.write_all(&[BEAT]).is_ok()
    }

    /// Ends the guard. To be called only when the robot stands still.
    pub fn farewell(&mut self) {
        // It may have ended already.
        let _ = self.pipe.write_all(&[FAREWELL]);
        let _ = self.child.wait();
    }
}

/// The guard's side of the pipe: reads the controller's bytes from standard input and stops the robot when they stop. `None` after a
/// regular end.
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
