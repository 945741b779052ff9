//! The guard: a separate process. It stops the robot when the controller has ended, for example by
//! a panic or by kill -9, or hangs.
//!
//! The controller sends a byte every 20 ms, and the guard answers each. If no byte arrives for 70
//! ms, or the connection ends without the byte for a regular end, the guard stops the robot, and
//! tries again until the robot has confirmed it, also while a controller that hangs still has its
//! claim. The controller sends the byte for a regular end only after the robot has confirmed that
//! it stands still. If no answer comes for 50 ms, the guard hangs, and the controller stops the
//! robot. Neither waits for the other.

use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::parent_id;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use etude_robot::priority::{Priority, Rank};
use etude_robot::rig_file::{RigConfig, WiresConfig};
use etude_robot::stop::{Stopped, stop};

use super::claim::Claim;
use super::error::SessionError;

/// Time between two bytes.
pub(super) const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(20);
/// Time without a byte after which the guard acts: the hand must have no torque 100 ms after its
/// controller hangs.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(70);
/// Time without an answer after which the controller acts.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(50);
/// Longest time for which a guard may take to end after the byte for a regular end.
const EXIT_TIMEOUT: Duration = Duration::from_millis(300);
/// The same before the first byte, while the controller starts; nothing moves until then.
const STARTUP_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest time for which the guard tries to stop a robot that does not confirm it.
const STOP_TIMEOUT: Duration = Duration::from_secs(30);
const RETRY_INTERVAL: Duration = Duration::from_millis(100);
const HEARTBEAT: u8 = b'.';
const FAREWELL: u8 = b'q';
const READY: &str = "on guard: ";

/// The line that the guard of a rig with these wires prints when it is ready.
pub fn ready(wires: &WiresConfig) -> String {
    format!("{READY}{}", devices_at(wires))
}

/// The devices that a guard stops.
fn devices_at(wires: &WiresConfig) -> String {
    format!("hand at {}, arm at {}", wires.can, wires.arm)
}

/// The controller's side.
#[derive(Debug)]
pub struct Guard {
    child: Child,
    line: UnixStream,
    /// When the last byte was sent.
    sent: Option<Instant>,
    answers: Answers,
}

/// How long the guard has not answered.
#[derive(Debug, Default)]
struct Answers {
    /// When the first of the bytes was sent that have no answer.
    unanswered: Option<Instant>,
    /// When this was looked at last.
    looked: Option<Instant>,
}

impl Answers {
    /// Whether the guard hangs. If this program itself stood still, so may have the whole machine:
    /// the guard has its time from now on.
    fn are_late(&mut self, now: Instant) -> bool {
        let stood_still = self.looked.is_some_and(|at| now.duration_since(at) > 2 * HEARTBEAT_INTERVAL);
        self.looked = Some(now);
        if stood_still && self.unanswered.is_some() {
            self.unanswered = Some(now);
        }
        self.unanswered.is_some_and(|since| now.duration_since(since) > ANSWER_TIMEOUT)
    }
}

impl Guard {
    /// Starts the guard of the rig in the file `rig` (`PROGRAM robot guard`) and waits until it is
    /// ready.
    ///
    /// # Errors
    /// If it cannot be started, or the file has other devices than `wires`.
    pub fn start(program: &Path, rig: &Path, wires: &WiresConfig) -> Result<Self, SessionError> {
        let (line, mut child) = Self::spawn(program, rig).map_err(SessionError::Guard)?;
        let refused = match Self::devices_of(&mut child) {
            Ok(Some(devices)) if devices == devices_at(wires) => {
                return Ok(Self { child, line, sent: None, answers: Answers::default() });
            }
            Ok(Some(theirs)) => SessionError::OtherDevices {
                file: rig.display().to_string(),
                theirs,
                ours: devices_at(wires),
            },
            Ok(None) => SessionError::Guard(std::io::Error::other("it ended at once; its message is above")),
            Err(error) => SessionError::Guard(error),
        };
        // Nothing has moved, and it must not stop the devices of another robot.
        let _ = child.kill();
        let _ = child.wait();
        Err(refused)
    }

    /// The process of the guard, and this end of the line to it.
    fn spawn(program: &Path, rig: &Path) -> std::io::Result<(UnixStream, Child)> {
        let (line, theirs) = UnixStream::pair()?;
        line.set_nonblocking(true)?;
        let mut command = Command::new(program);
        command.args(["robot", "guard", "--robot"]).arg(rig);
        command.stdin(OwnedFd::from(theirs)).stdout(Stdio::piped());
        // Ctrl-C in a terminal goes to the whole group, and the guard must outlive the controller.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        // Dropping the command closes this process's copy of the guard's end, so that the end of
        // the guard is seen.
        command.spawn().map(|child| (line, child))
    }

    /// The devices that the guard names when it is ready; `None` if it has ended.
    fn devices_of(child: &mut Child) -> std::io::Result<Option<String>> {
        let Some(output) = child.stdout.take() else { return Err(ErrorKind::BrokenPipe.into()) };
        let mut line = String::new();
        BufReader::new(output).read_line(&mut line)?;
        Ok(line.trim_end().strip_prefix(READY).map(str::to_string))
    }

    /// Sends a sign of life if the last one is old; `false` if the guard has ended or hangs. Never
    /// waits.
    pub fn heartbeat(&mut self) -> bool {
        let mut answers = [0; 64];
        loop {
            match self.line.read(&mut answers) {
                Ok(0) => return false,
                Ok(_) => self.answers.unanswered = None,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(_) => return false,
            }
        }
        if self.sent.is_none_or(|sent| sent.elapsed() >= HEARTBEAT_INTERVAL) {
            let now = Instant::now();
            match self.line.write(&[HEARTBEAT]) {
                // A full line is one that the guard does not read.
                Err(error) if !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                    return false;
                }
                _ => self.sent = Some(now),
            }
            self.answers.unanswered.get_or_insert(now);
        }
        !self.answers.are_late(Instant::now())
    }

    /// Ends the guard. To be called only when the robot stands still.
    pub fn farewell(&mut self) {
        // It may have ended already, or hang.
        let _ = self.line.write(&[FAREWELL]);
        let until = Instant::now() + EXIT_TIMEOUT;
        while matches!(self.child.try_wait(), Ok(None)) {
            if Instant::now() > until {
                let _ = self.child.kill();
                let _ = self.child.wait();
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// The guard's side: reads the controller's bytes from standard input, which is a socket, answers
/// them there, and stops the robot when they stop. `None` after a regular end.
///
/// # Errors
/// If standard input cannot be read with a time limit.
pub fn run_guard(rig: &RigConfig) -> std::io::Result<Option<Stopped>> {
    let controller = parent_id();
    let _priority = Priority::of_this_thread(Rank::Guard);
    let mut line = UnixStream::from(std::io::stdin().as_fd().try_clone_to_owned()?);
    line.set_write_timeout(Some(HEARTBEAT_TIMEOUT))?;
    line.set_read_timeout(Some(STARTUP_TIMEOUT))?;
    let mut bytes = [0; 64];
    loop {
        match line.read(&mut bytes) {
            Ok(0) => break,
            Ok(count) if bytes[..count].contains(&FAREWELL) => return Ok(None),
            Ok(_) => {
                line.set_read_timeout(Some(HEARTBEAT_TIMEOUT))?;
                // A controller that has ended is noticed at the next read.
                let _ = line.write(&[HEARTBEAT]);
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => break,
        }
    }
    let until = Instant::now() + STOP_TIMEOUT;
    let mut stopped = stop(rig);
    let mut claim = None;
    while !stopped.is_sure() && Instant::now() < until {
        // A controller that hangs keeps its claim. After it has ended, a new one must not be
        // disturbed, and none may begin meanwhile.
        if claim.is_none() && parent_id() != controller {
            claim = Claim::new(&rig.wires).ok();
            if claim.is_none() {
                break;
            }
        }
        std::thread::sleep(RETRY_INTERVAL);
        stopped = stop(rig);
    }
    Ok(Some(stopped))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_guard_hangs_only_if_it_does_not_answer_while_this_program_runs() {
        let begun = Instant::now();
        let at = |ms: u64| begun + Duration::from_millis(ms);
        let answers = || Answers { unanswered: Some(at(0)), looked: Some(at(0)) };
        let mut hangs = answers();
        assert!((1..=50).all(|ms| !hangs.are_late(at(ms))) && hangs.are_late(at(51)));
        let mut stalled = answers();
        assert!(!stalled.are_late(at(80)), "both may have stood still");
        assert!((81..=130).all(|ms| !stalled.are_late(at(ms))) && stalled.are_late(at(131)));
    }
}
