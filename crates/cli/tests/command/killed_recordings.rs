//! A recording is readable wherever its process is killed.

use std::process::Stdio;
use std::time::Duration;

use etude_perform::Recording;

use crate::playing::read_elsewhere;
use crate::served_twin::{Served, is_safe};
use crate::{Sandbox, wait_for};

/// Kills recordings at `moments` (s after the file is there), of a robot that first homes, and in
/// lockstep. Any MCAP reader must open each, with all but the last second.
fn kill_recordings(robot: &[f64], lockstep: &[f64]) {
    let sandbox = Sandbox::new();
    let twin = Served::start(&sandbox);
    let live = format!("record --robot {} --home --excitation open-close", twin.rig.display());
    // A run that measures the lag would be removed before the one that counts begins.
    let lead = "--set task.plan.latency_compensation_secs=0.1";
    let in_lockstep = format!("perform ode-to-joy --scripted --mode joint-mirroring --robot twin {lead}");
    let mut files = Vec::new();
    for (index, moment) in robot.iter().chain(lockstep).enumerate() {
        let is_live = index < robot.len();
        let file =
            sandbox.path(&if is_live { format!("{index}.mcap") } else { format!("{index}/1/run-1.mcap") });
        let args = match is_live {
            true => format!("{live} -o {index}.mcap"),
            false => format!("{in_lockstep} -o {index}"),
        };
        // On a busy machine a safety stop may end it first.
        let was_killed = || {
            let mut command = sandbox.command(&args);
            let mut process = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            let has_begun = || file.exists() && (*moment == 0.0 || Recording::read(&file).is_ok());
            wait_for("it never began to record", has_begun);
            std::thread::sleep(Duration::from_secs_f64(*moment));
            let ended = process.try_wait().unwrap().is_some();
            process.kill().unwrap();
            process.wait().unwrap();
            if ended && is_live {
                std::fs::remove_file(&file).unwrap();
            }
            !ended || !is_live
        };
        assert!((0..5).any(|_| was_killed()), "{moment} s: it always ended by itself");
        if is_live {
            wait_for("the guard did not stop the robot", || is_safe(twin.seen(&sandbox)));
        }
        // Killed in its first milliseconds, it has an end, but not yet a message.
        let ours = Recording::read(&file);
        if *moment > 0.0 {
            assert!(!ours.unwrap().complete || !is_live, "{moment} s: it was killed");
        }
        files.push(file);
    }
    let Some(found) = read_elsewhere("check_cut_recordings.py", &files) else { return };
    let found: Vec<(u64, f64)> = serde_json::from_str(&found).unwrap();
    for ((messages, secs), moment) in found.iter().zip(robot) {
        // Until its wires are open, nothing can be recorded.
        const OPENING_SECS: f64 = 1.0;
        assert!(*messages > 0 && *secs > moment - 1.0 - OPENING_SECS, "{moment} s: {messages} to {secs} s");
    }
    let all = robot.iter().chain(lockstep);
    assert!(
        found.iter().zip(all).all(|((messages, _), moment)| *messages > 0 || *moment == 0.0),
        "{found:?}"
    );
}

/// The bits of a small generator as moments up to `longest`, s.
fn moments(count: u64, longest: f64) -> Vec<f64> {
    let noise = |index: u64| (index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 11;
    (0..count).map(|index| longest * noise(index) as f64 / (1u64 << 53) as f64).collect()
}

#[test]
fn a_recording_that_was_cut_off_opens_anywhere() {
    kill_recordings(&[2.5], &[0.0, 0.05, 0.2, 0.4]);
}

#[test]
#[ignore = "takes minutes: `make test-heavy`, which .ci/run calls"]
fn fifty_recordings_that_were_cut_off_open_anywhere() {
    kill_recordings(&moments(20, 6.0), &moments(30, 1.0));
}
