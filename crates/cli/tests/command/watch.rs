//! `etude watch`: what it prints, and the screen in a real pseudo-terminal.

use std::path::Path;
use std::process::Command;

use crate::{Sandbox, errors, succeed};

/// A run of 4,000 steps that has made half of them.
fn write_run(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("config.toml"), "[trainer]\ntotal_steps = 4000\nlog_every_steps = 1000\n")
        .unwrap();
    std::fs::write(folder.join("meta.json"), "{\"song\": \"Short\"}").unwrap();
    let row = |step: u32, reward: f64| {
        format!(
            "{{\"step\":{step},\"charts/reward_per_step\":{reward},\"reward/energy\":-0.25,\"reward/key_press\":0.5,\
             \"perf/steps_per_sec\":100.0,\"perf/elapsed_secs\":{}.0}}\n",
            step / 100
        )
    };
    let evaluation = |step: u32, f1: f64| {
        format!(
            "{{\"step\":{step},\"eval/f1\":{f1},\"eval/recall\":0.1,\"eval/notes_right\":3.0,\"eval/notes_missed\":1.0,\"eval/notes_wrong\":2.0}}\n"
        )
    };
    let lines = [
        row(1000, 0.25),
        evaluation(1000, 0.75),
        "{\"step\":1500,\"ev\n".to_string(),
        row(2000, 0.5),
        evaluation(2000, 0.625),
        "{\"step\":3000,\"half".to_string(),
    ];
    std::fs::write(folder.join("metrics.jsonl"), lines.concat()).unwrap();
}

#[test]
fn figures_are_printed_once() {
    let sandbox = Sandbox::new();
    write_run(&sandbox.path("runs/short__fast__0"));
    write_run(&sandbox.path("runs/task/training"));
    let runs = sandbox.json("watch runs/short__fast__0 runs/task --once --json");
    let runs = runs.as_array().unwrap();
    assert_eq!(
        (&runs[0]["run"], &runs[1]["run"]),
        (&"runs/short__fast__0".into(), &"runs/task/training".into())
    );
    for (run, name) in runs.iter().zip(["short__fast__0", "task"]) {
        let expected = serde_json::json!({
            "run": run["run"], "name": name, "song": "Short", "state": "running",
            "secs_since_written": run["secs_since_written"], "step": 2000, "total_steps": 4000, "secs": 20.0,
            "steps_per_sec": 100.0, "secs_left": 20.0, "notes_right": 3, "notes_due": 4, "notes_wrong": 2, "best_f1": 0.75, "best_step": 1000, "last_f1": 0.625,
            "reward_per_step": 0.5, "reward": { "energy": -0.25, "key_press": 0.5 },
        });
        assert_eq!(*run, expected);
        assert!(run["secs_since_written"].as_f64().unwrap() < 100.0);
    }
    // Without arguments: what lies in runs/. Where nobody looks on: a table.
    assert_eq!(sandbox.json("watch --json").as_array().unwrap().len(), 2);
    let table = sandbox.ok("watch");
    let lines: Vec<_> = table.lines().collect();
    assert!(lines.len() == 3 && lines[0].starts_with("run "), "{table}");
    assert!(lines[1..].iter().any(|line| line.starts_with("task ") && line.contains("2k/4k")), "{table}");
    assert!(
        table.contains("3/4 +2")
            && table.contains("0.750")
            && table.contains("0.625")
            && table.contains("0:20"),
        "{table}"
    );
    assert!(!table.contains('\u{1b}'), "{table:?}");
}

#[test]
fn a_real_training_is_watched() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o run --json"));
    let run = &sandbox.json("watch run --json")[0];
    assert_eq!(
        (&run["state"], &run["step"], &run["song"]),
        (&"finished".into(), &400.into(), &"short".into())
    );
    assert!(run["best_f1"].is_number() && run["reward"].as_object().unwrap().len() >= 4, "{run}");
}

#[test]
fn what_is_no_run_is_explained() {
    let sandbox = Sandbox::new();
    let message = |args: &str| {
        let output = sandbox.command(args).output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        errors(&output)
    };
    assert!(message("watch").contains("there is no folder runs"));
    std::fs::create_dir(sandbox.path("empty")).unwrap();
    let said = message("watch empty");
    assert!(said.contains("empty holds no run") && said.contains("etude train"), "{said}");
    write_run(&sandbox.path("new"));
    std::fs::write(sandbox.path("new/metrics.jsonl"), "").unwrap();
    assert!(sandbox.ok("watch new").contains("waiting for the first log line"));
}

/// Drives a program in a pseudo-terminal of 80 by 24: waits until the screen has been drawn, then
/// does what it is told, and prints what the terminal was sent. The exit code is the program's; 99
/// says that the terminal's settings were not restored.
const TERMINAL: &str = r#"
import fcntl, os, pty, select, signal, struct, sys, termios, time
action, program = sys.argv[1], sys.argv[2:]
main, side = pty.openpty()
fcntl.ioctl(side, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
before = termios.tcgetattr(side)
child = os.fork()
if child == 0:
    os.setsid()
    fcntl.ioctl(side, termios.TIOCSCTTY, 0)
    for number in range(3):
        os.dup2(side, number)
    os.execv(program[0], program)
sent, said, deadline = False, b"", time.monotonic() + 30
while time.monotonic() < deadline:
    ended, status = os.waitpid(child, os.WNOHANG)
    while select.select([main], [], [], 0.05)[0]:
        said += os.read(main, 65536)
    if ended:
        break
    if not sent and b"? help" in said:
        sent = True
        if action == "TERM":
            os.kill(child, signal.SIGTERM)
        else:
            os.write(main, action.encode())
else:
    os.kill(child, signal.SIGKILL)
    sys.exit("it went on for too long: " + repr(said))
sys.stdout.buffer.write(said)
sys.stdout.flush()
sys.exit(os.waitstatus_to_exitcode(status) if termios.tcgetattr(side) == before else 99)
"#;

/// What `etude watch` writes to a terminal in which this is done, which must end it with this code.
fn watched(sandbox: &Sandbox, action: &str, code: i32) -> String {
    let mut command = Command::new("python3");
    command.current_dir(sandbox.folder.path()).env("TERM", "xterm-256color").env_remove("NO_COLOR");
    command.args(["-c", TERMINAL, action]).arg(assert_cmd::cargo::cargo_bin!("etude")).arg("watch");
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(code), "{action:?}: {}", errors(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_screen_is_left_as_it_was_found() {
    let sandbox = Sandbox::new();
    write_run(&sandbox.path("runs/short__fast__0"));
    for (action, code) in [("q", 0), ("\u{3}", 3), ("TERM", 3)] {
        let said = watched(&sandbox, action, code);
        let (before, inside) = said.split_once("\u{1b}[?1049h").unwrap();
        let (inside, after) = inside.split_once("\u{1b}[?1049l").unwrap();
        assert!(!before.contains("F1") && !after.contains("F1"), "{action:?}: {said:?}");
        for text in ["short__fast__0", "running", "0.750", "energy", "\u{1b}[38;5;75"] {
            assert!(inside.contains(text), "{text:?} after {action:?} in {said:?}");
        }
        assert!(said.rfind("\u{1b}[?25h") > said.rfind("\u{1b}[?25l"), "the cursor is shown again: {said:?}");
    }
}
