//! Ctrl-C: nothing is lost, nothing half done counts, and the exit code is 3. `terminals` goes
//! through all long verbs.

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::training::{LONGER, started};
use crate::{Sandbox, TINY, errors, processes, wait_for};

#[test]
fn a_closed_terminal_saves_a_training_and_nohup_keeps_it_running() {
    let sandbox = Sandbox::new();
    for (signals, folder, code) in
        [("--default-signal=HUP", "closed", 3), ("--ignore-signal=HUP", "nohup", 0)]
    {
        // `env` sets what the signal does, whatever it does to this test.
        let mut env = Command::new("env");
        env.current_dir(sandbox.path("")).arg(signals).arg(assert_cmd::cargo::cargo_bin!("etude"));
        env.args(["train", "short.mid", "-o", folder]).args(TINY.iter().flat_map(|set| ["--set", set]));
        let child = started(env.args(LONGER.split_whitespace()), &sandbox.path(folder));
        processes::signal(child.id(), "HUP");
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{folder}: {}", errors(&output));
    }
    assert!(sandbox.ok("train --resume closed").contains("Finished after 4000 steps"));
}

/// Starts `etude perform` with twenty runs and interrupts it when the first has ended and the
/// second plays.
fn interrupted_in_the_second_run(sandbox: &Sandbox, more: &str) -> std::process::Output {
    let perform = sandbox.command(&format!("perform ode-to-joy --scripted --runs 20 {more}"));
    let mut child = { perform }.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    if more.contains("closed") {
        drop(child.stdout.take());
    }
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut line = String::new();
    while !line.starts_with("run 1") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "it ended before the first run");
    }
    // The second is past the way to the keyboard when more than half of its recording is there.
    let folder = sandbox.path(more.split_whitespace().last().unwrap());
    let size = |run: &str| std::fs::metadata(folder.join(run)).map_or(0, |file| file.len());
    while size("1/run-2.mcap") < size("1/run-1.mcap") * 6 / 10 {
        std::thread::sleep(Duration::from_millis(5));
    }
    processes::signal(child.id(), "INT");
    child.wait_with_output().unwrap()
}

#[test]
fn an_interrupted_performance_counts_in_no_mean() {
    let sandbox = Sandbox::new();
    let output = interrupted_in_the_second_run(&sandbox, "-o open");
    assert_eq!(output.status.code(), Some(3));
    let report: Value = serde_json::from_slice(&sandbox.bytes("open/1/report.json")).unwrap();
    let runs = report["runs"].as_array().unwrap();
    assert_eq!(runs[1]["ending"], "interrupted", "{report}");
    assert!(runs.len() == 2 && runs[1]["f1"].as_f64().unwrap() < runs[0]["f1"].as_f64().unwrap(), "{report}");
    assert_eq!(report["robot_f1"], runs[0]["f1"], "{report}");
    assert_eq!(report["notes_right"], runs[0]["matched"].as_f64().unwrap(), "{report}");
    // Also if nobody reads what it prints.
    assert_eq!(interrupted_in_the_second_run(&sandbox, "-o closed").status.code(), Some(3));
}

/// What a command says that is interrupted as soon as the file is there; it must end with 3.
fn interrupted_at(mut command: Command, file: impl FnOnce(&Child) -> PathBuf) -> String {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let file = file(&child);
    while !file.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it has ended before it made {}", file.display());
        std::thread::sleep(Duration::from_millis(1));
    }
    processes::signal(child.id(), "INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    errors(&output)
}

#[test]
fn a_video_that_is_interrupted_leaves_nothing() {
    let sandbox = Sandbox::new();
    sandbox.ok("play ode-to-joy --scripted -o out");
    if !crate::rendering::draws(&sandbox) {
        return;
    }
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        return crate::browser::skip("there is no ffmpeg here");
    }
    let command = sandbox.command("render out --size 640x480 -o film.mp4");
    let before = sandbox.left_behind();
    let is_new = |name: &String| !before.contains(name);
    let _ = interrupted_at(command, |_| {
        let work = || sandbox.left_behind().into_iter().find(is_new);
        wait_for("a folder of its own", || work().is_some());
        sandbox.path(work().unwrap()).join("video.mp4")
    });
    assert_eq!(sandbox.left_behind().into_iter().find(is_new), None);
}

#[test]
fn a_performance_that_is_interrupted_before_it_plays_leaves_nothing() {
    let sandbox = Sandbox::new();
    // The recording is opened when the robot starts.
    let said = interrupted_at(sandbox.command("perform ode-to-joy --scripted -o begun"), |_| {
        sandbox.path("begun/1/run-1.mcap")
    });
    assert!(said.contains("interrupted before a run was complete"), "{said}");
    assert!(!sandbox.path("begun").exists());
}

#[test]
fn a_performance_on_a_robot_replaces_no_other() {
    let sandbox = Sandbox::new();
    sandbox.ok("perform short.mid --scripted --runs 2 -o there");
    sandbox.ok("replay there");
    let whole = sandbox.bytes("there/1/run-1.mcap");
    let said = interrupted_at(sandbox.command("perform ode-to-joy --scripted -o there"), |_| {
        sandbox.path("there/2/run-1.mcap")
    });
    assert!(said.contains("interrupted before a run was complete"), "{said}");
    assert!(!sandbox.path("there/2").exists(), "there is no music in it");

    // A fault is kept to be looked at, and is not the latest.
    let failed = sandbox.command("perform short.mid --scripted --fault can-bus-off@10.5 -o there");
    assert_eq!({ failed }.output().unwrap().status.code(), Some(1));
    assert!(sandbox.path("there/2/run-1.mcap").is_file());
    assert_eq!(sandbox.bytes("there/latest/run-1.mcap"), whole);
    assert!(
        sandbox.path("there/latest/run-2.wav").is_file() && sandbox.path("there/1/replay.html").is_file()
    );

    sandbox.ok("perform short.mid --scripted -o there");
    assert_eq!(sandbox.bytes("there/latest/report.json"), sandbox.bytes("there/3/report.json"));
    assert!(!sandbox.path("there/latest/run-2.mcap").exists());
    assert_eq!(sandbox.bytes("there/1/run-1.mcap"), whole);
    sandbox.ok("compare there there/2");
}

#[test]
fn an_interrupted_play_leaves_nothing() {
    let sandbox = Sandbox::new();
    sandbox.ok("play short.mid --scripted -o mine");
    let said = interrupted_at(sandbox.command("play ode-to-joy --scripted -o mine"), |_| {
        sandbox.path("mine/2/recording.mcap")
    });
    assert!(said.contains("nothing was written"), "{said}");
    assert!(!sandbox.path("mine/2").exists() && sandbox.path("mine/latest/report.json").is_file());
    let _ = interrupted_at(sandbox.command("play ode-to-joy --scripted -o new"), |_| {
        sandbox.path("new/1/recording.mcap")
    });
    assert!(!sandbox.path("new").exists());
}

#[test]
fn each_player_has_a_folder_of_its_own() {
    let sandbox = Sandbox::new();
    let folder = |args: &str| {
        let report = sandbox.json(&format!("play twinkle {args} --json"));
        let midi = report["files"]["midi"].as_str().unwrap().to_string();
        midi.strip_suffix("/1/performance.mid").unwrap().to_string()
    };
    assert_eq!(folder(""), "out/twinkle");
    assert_eq!(folder("--scripted"), "out/twinkle-scripted");
    std::fs::create_dir_all(sandbox.path("runs/other-run")).unwrap();
    std::fs::copy(crate::shipped("twinkle"), sandbox.path("runs/other-run/policy-best.safetensors")).unwrap();
    assert_eq!(folder("--policy runs/other-run"), "out/twinkle-other-run");
    assert_eq!(folder("--set task.physics.key.threshold=0.6"), "out/twinkle-threshold-0.6");
}

/// When another policy becomes the best, what the one before played stays; by `play` and on a
/// robot.
#[test]
fn a_new_best_policy_replaces_no_performance_of_another() {
    let sandbox = Sandbox::new();
    let player = |folder: &str| {
        let report = std::fs::read_to_string(sandbox.path(folder).join("report.json")).unwrap();
        serde_json::from_str::<Value>(&report).unwrap()["player"].as_str().unwrap().to_string()
    };
    sandbox.ok("play twinkle");
    std::fs::create_dir_all(sandbox.path("runs/twinkle__mine")).unwrap();
    std::fs::copy(crate::shipped("twinkle"), sandbox.path("runs/twinkle__mine/policy-best.safetensors"))
        .unwrap();
    sandbox.ok("play twinkle");
    assert!(player("out/twinkle/1").ends_with("policies/twinkle.safetensors"));
    assert!(player("out/twinkle/latest").contains("twinkle__mine"));
    // Of several results a gallery shows the latest.
    assert_eq!(sandbox.json("gallery out --json")["exhibits"].as_array().unwrap().len(), 1);
}

#[test]
fn a_policy_in_another_world_says_so() {
    let sandbox = Sandbox::new();
    let said = |set: &str| errors(&sandbox.command(&format!("play twinkle --set {set}")).output().unwrap());
    let right = said("task.stage.side=right");
    assert!(right.contains("trained with other settings; now task.stage.side = \"right\""), "{right}");
    assert!(said("task.stage.fences=false").contains("now task.stage.fences = false"));
    assert!(said("task.scale=si").contains("now task.scale = \"si\""));
    // The lead is chosen for a robot, and what is as it was is no change.
    assert_eq!(said("task.plan.latency_compensation_secs=0.05"), "");
    assert_eq!(said("task.stage.side=left"), "");
}

#[test]
fn a_recording_is_not_replaced() {
    let sandbox = Sandbox::new();
    sandbox.ok("record --robot twin --secs 1 -o r.mcap");
    let before = sandbox.bytes("r.mcap");
    let output = sandbox.command("record --robot twin --secs 2 -o r.mcap").output().unwrap();
    assert!(errors(&output).contains("r.mcap exists: choose another name"), "{}", errors(&output));
    assert!(output.status.code() == Some(1) && sandbox.bytes("r.mcap") == before);
    // One that is interrupted is kept.
    let child = sandbox.command("record --robot twin --secs 600 -o long.mcap");
    let child = { child }.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let long = |file: std::fs::Metadata| file.len() as usize > before.len();
    wait_for("it records", || std::fs::metadata(sandbox.path("long.mcap")).is_ok_and(long));
    processes::signal(child.id(), "INT");
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(3));
    assert!(etude_perform::Recording::read(&sandbox.path("long.mcap")).is_ok());
}
