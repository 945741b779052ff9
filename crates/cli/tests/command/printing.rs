//! The verbs that only print, and how printing behaves.

use std::process::Stdio;

use etude_music::{Note, Song};
use etude_stage::{PhysicalParams, Side, StageConfig, World, mjcf};

use crate::{Sandbox, succeed};

#[test]
fn the_exported_model_is_the_world() {
    let sandbox = Sandbox::new();
    sandbox.ok("model export -o world.xml");
    // The world in which the preset `fast` learns.
    let config = StageConfig::default();
    let mut params = PhysicalParams::default();
    params.set("joint.fingers.viscosity", 0.1).unwrap();
    let expected = mjcf(&config, &params);
    assert_eq!(String::from_utf8(sandbox.bytes("world.xml")).unwrap(), expected);
    assert_eq!(sandbox.ok("model export").trim_end(), expected.trim_end());
    World::new(&config, &PhysicalParams::default()).unwrap();
    let right = sandbox.ok("model export --set task.stage.side=right --set task.physics.key.threshold=0.6");
    let config = StageConfig { side: Side::Right, ..config };
    params.set("key.threshold", 0.6).unwrap();
    assert_eq!(right.trim_end(), mjcf(&config, &params).trim_end());
}

#[test]
fn figures_come_as_json_with_the_documented_keys() {
    let sandbox = Sandbox::new();
    let all = |value: &serde_json::Value, keys: &[&str]| {
        assert!(keys.iter().all(|key| value.get(key).is_some()), "{keys:?} in {value}");
    };
    let lags = sandbox.json("model lags --json");
    all(&lags, &["sound_secs", "silence_secs", "shortest_silence_secs", "follow_secs"]);
    assert!(sandbox.ok("model lags").contains("silent for 100 ms before it is struck again: long enough"));
    // Whoever takes what is suggested has enough.
    let slow = "model lags --set task.physics.joint.fingers.low_pass=0.1";
    let said = sandbox.ok(slow);
    let (_, suggested) = said.trim_end().split_once("too short. Use ").unwrap();
    assert!(sandbox.ok(&format!("{slow} {suggested}")).contains("long enough"), "{suggested}");
    let params = sandbox.json("model params --json --set task.physics.key.threshold=0.6");
    assert_eq!(params.as_array().unwrap().len(), PhysicalParams::rows().count());
    for row in params.as_array().unwrap() {
        all(row, &["path", "value", "default", "low", "high", "unit", "doc"]);
    }
    assert!(
        params.as_array().unwrap().iter().any(|row| row["path"] == "key.threshold" && row["value"] == 0.6)
    );
    let doctor = sandbox.json("doctor --json");
    for finding in doctor.as_array().unwrap() {
        all(finding, &["name", "ok", "found", "cost"]);
    }
    let real_time = doctor.as_array().unwrap().iter().find(|finding| finding["name"] == "real time").unwrap();
    let said = real_time[if real_time["ok"] == true { "found" } else { "cost" }].as_str().unwrap();
    assert!(said.contains("robot"), "{real_time}");
    assert!(sandbox.ok("doctor").contains("mujoco"));
}

#[test]
fn help_is_worth_reading() {
    let sandbox = Sandbox::new();
    let help = sandbox.ok("--help");
    assert!(help.contains("First steps") && help.contains("Exit codes"), "{help}");
    for verb in ["songs", "train", "play", "evaluate", "model"] {
        assert!(help.contains(verb) && sandbox.ok(&format!("{verb} --help")).contains("Examples:"), "{verb}");
    }
    assert!(sandbox.ok("doctor --help").contains("missing"));
    assert!(sandbox.ok("--version").starts_with("etude "));
}

#[test]
fn nobody_listening_is_no_failure() {
    let sandbox = Sandbox::new();
    // Both ends of standard output and standard error are closed before the first line.
    for mut command in
        [sandbox.command("songs"), sandbox.command("model params"), sandbox.command("doctor --json")]
    {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{command:?}");
    }
    let mut command = sandbox.tiny("short.mid -o run");
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stderr.take());
    assert_eq!(child.wait().unwrap().code(), Some(0), "a training goes on when its progress is not read");
    assert!(sandbox.path("run/policy-best.safetensors").is_file());
}

#[test]
fn without_a_terminal_progress_is_plain_lines() {
    let sandbox = Sandbox::new();
    let output = sandbox.tiny("short.mid -o run").output().unwrap();
    let lines = crate::errors(&output);
    assert_eq!(
        lines.lines().filter(|line| line.contains("F1") && line.contains("step")).count(),
        2,
        "{lines}"
    );
    assert!(!lines.contains('\u{1b}') && !lines.contains('\r'), "{lines:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        text.contains("Finished after 400 steps") && text.contains("etude play short.mid --policy run"),
        "{text}"
    );
    let quiet = sandbox.tiny("short.mid -o quiet --json").output().unwrap();
    assert_eq!(crate::errors(&quiet), "");
    // Some minutes of music take some seconds.
    let notes = (0..1600).map(|at| {
        let start_secs = 0.25 * f64::from(at);
        Note { pitch: 60 + (at % 5) as u8, start_secs, end_secs: start_secs + 0.2, velocity: 80 }
    });
    Song::new("Long", notes.collect(), 400.0).unwrap().save(sandbox.path("long.mid")).unwrap();
    let said = crate::errors(&sandbox.command("play long.mid --scripted -o long").output().unwrap());
    assert!(said.contains("playing, ") && said.contains(" %"), "{said}");
    // A pipe that closes after the first line ends nothing but the printing.
    assert!(succeed(sandbox.command("songs")).lines().count() > 7);
}
