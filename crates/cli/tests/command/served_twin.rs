//! A twin in a process of its own.

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::Sandbox;

/// A twin in a process of its own.
pub struct Served {
    pub process: Child,
    pub rig: PathBuf,
    _alone: MutexGuard<'static, ()>,
}

/// By the wall clock, one robot at a time: several at once are late on a small machine.
static ALONE: Mutex<()> = Mutex::new(());

impl Served {
    pub fn start(sandbox: &Sandbox) -> Self {
        Self::with_fault(sandbox, None)
    }

    pub fn with_fault(sandbox: &Sandbox, fault: Option<&str>) -> Self {
        let fault = fault.map_or_else(String::new, |fault| format!(" --fault {fault}"));
        Self::of(sandbox, &format!("twin -o twin --twin-params mild{fault}"))
    }

    /// What `etude` with `args` serves.
    pub fn of(sandbox: &Sandbox, args: &str) -> Self {
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let mut command = sandbox.command(args);
        let command = command.arg("--json").stdout(Stdio::piped()).stderr(Stdio::null());
        let mut process = command.spawn().unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let ready: Value = serde_json::from_str(&line).unwrap();
        let rig = PathBuf::from(ready["rig"].as_str().unwrap());
        // A busy machine must not fail the test: what is waited for here is the stop, not the
        // fault.
        let text = std::fs::read_to_string(&rig).unwrap();
        let text = text.replace("stale_after_secs = 0.05", "stale_after_secs = 0.1");
        std::fs::write(&rig, text.replace("report_stale_after_secs = 0.1", "report_stale_after_secs = 1.0"))
            .unwrap();
        Self { process, rig, _alone: alone }
    }

    /// What the monitor saw last.
    pub fn last_line(&self, sandbox: &Sandbox) -> Value {
        let until = Instant::now() + Duration::from_secs(20);
        loop {
            let text = sandbox.ok(&format!("robot monitor --robot {} --secs 0.7 --json", self.rig.display()));
            // On a busy machine it may end before it has seen anything.
            if let Some(last) = text.lines().last() {
                return serde_json::from_str(last).unwrap();
            }
            assert!(Instant::now() < until, "the monitor never saw anything");
        }
    }

    /// Servo of the hand, state of the arm.
    pub fn seen(&self, sandbox: &Sandbox) -> (Value, Value) {
        let last = self.last_line(sandbox);
        (last["hand"]["servo_on"].clone(), last["arm"]["state"].clone())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Servo off and state 4.
pub fn is_safe((servo_on, state): (Value, Value)) -> bool {
    servo_on == false && state == 4
}
