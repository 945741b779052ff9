//! `etude record --excitation`, `identify` and `rehearse`: the way from a robot back to a
//! simulator.

use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::{Sandbox, TINY, errors};

/// Waits until `file` is there, then sends `signal` to the process.
fn interrupt_at(mut command: Command, file: &std::path::Path, signal: &str) -> Option<i32> {
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let begun = Instant::now();
    while !file.exists() && begun.elapsed() < Duration::from_secs(120) {
        sleep(Duration::from_millis(5));
    }
    Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    child.wait().unwrap().code()
}

#[test]
fn the_rail_is_identified_from_its_excitation_and_an_interruption_changes_nothing() {
    let sandbox = Sandbox::new();
    sandbox.ok("record --robot twin --twin-params worn --excitation rail -o rail.mcap");
    sandbox.ok("record --robot twin --twin-params worn --excitation rail --seed 1 -o again.mcap");
    let identify =
        |out: &str| format!("identify rail.mcap --held-out again.mcap --evaluations 30 -o {out} --json");
    let report = sandbox.json(&identify("a"));
    for errors in ["fit_errors", "held_out_errors"] {
        let joints = report[errors]["joints"].as_array().unwrap();
        assert_eq!(joints.len(), 1, "only the rail moves: {joints:?}");
        let error = |when: &str| joints[0][when].as_f64().unwrap();
        assert!(error("after") < 0.3 * error("before"), "{errors}: {joints:?}");
    }
    let code = interrupt_at(sandbox.command(&identify("b")), &sandbox.path("b/state.json"), "-INT");
    assert_eq!(code, Some(3), "it says that it was interrupted");
    sandbox.ok(&identify("b"));
    assert_eq!(sandbox.bytes("a/identified.toml"), sandbox.bytes("b/identified.toml"));
    interrupt_at(sandbox.command(&identify("c")), &sandbox.path("c/state.json"), "-KILL");
    sandbox.ok(&identify("c"));
    assert_eq!(sandbox.bytes("a/identified.toml"), sandbox.bytes("c/identified.toml"));
    // Which part it is at, on standard error, also where that is no terminal.
    let output = sandbox.command("identify rail.mcap --evaluations 30 -o d").output().unwrap();
    let said = errors(&output);
    assert!(said.contains("pass 1, joint by joint, ") && said.contains(" settled, 0:0"), "{said}");
    assert!(said.contains(" so far, at most about 0:"), "{said}");
    // What was identified is a layer of a training's settings.
    let train = sandbox.tiny("short.mid --config a/identified.toml -o run --json").output().unwrap();
    assert!(train.status.success(), "{}", errors(&train));
    let config = String::from_utf8(sandbox.bytes("run/config.toml")).unwrap();
    assert!(config.contains("joint.rail.delay"), "{config}");
}

#[test]
fn recordings_that_would_mislead_are_refused_with_the_reason() {
    let sandbox = Sandbox::new();
    sandbox.ok("record --robot twin --secs 3 -o rest.mcap");
    sandbox.ok("play short.mid --scripted -o sim");
    std::fs::write(sandbox.path("note.txt"), "no recording").unwrap();
    for (args, said) in [
        ("identify rest.mcap", "it has no commands"),
        ("identify sim/1/recording.mcap", "what rig it was made on"),
        ("identify note.txt", "not a recording of Étude"),
        ("identify nowhere.mcap", "nowhere.mcap"),
        ("identify rest.mcap --fit sgd", "unknown variant `sgd`, expected `lm` or `bo`"),
        ("identify rest.mcap --fit cma", "unknown variant `cma`, expected `lm` or `bo`"),
        ("record --robot twin --excitation dance -o x.mcap", "open-close, chirp, rail"),
    ] {
        let output = sandbox.command(args).output().unwrap();
        assert!(!output.status.success(), "{args}");
        assert!(errors(&output).contains(said), "{args}: {}", errors(&output));
    }
}

#[test]
#[ignore = "takes minutes: `make test-heavy`, which .ci/run calls"]
fn a_rehearsal_that_was_killed_goes_on_to_the_same_end() {
    let sandbox = Sandbox::new();
    let rehearse = |out: &str| {
        let mut command =
            sandbox.command("rehearse short.mid --robot twin --iterations 1 --runs 1 --evaluations 2");
        command.args(TINY.iter().flat_map(|set| ["--set", set])).args(["-o", out]);
        command
    };
    let finish = |command: &mut Command| {
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", errors(&output));
        output
    };
    let said = errors(&finish(&mut rehearse("a")));
    for part in [
        "iteration 0 of 1: training, step ",
        "recorded chirp (2 of 5)",
        "iteration 1: lag measurement (not counted)",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let of = |out: &str| -> [Value; 2] {
        let file = |number: usize| sandbox.bytes(format!("{out}/iteration-{number}/iteration.json"));
        [0, 1].map(|number| serde_json::from_slice(&file(number)).unwrap())
    };
    let iterations = of("a");
    assert!(
        iterations[0]["held_out_rad"].is_null() && iterations[1]["held_out_rad"][1].as_f64().unwrap() > 0.0
    );
    assert!(sandbox.path(iterations[1]["recordings"][0].as_str().unwrap()).is_file());
    assert!(!sandbox.path("a/iteration-1/training/checkpoints/replay").exists(), "it takes up space");
    let places = [
        "iteration-0/training/run.lock",
        "excitation/chirp.partial",
        "iteration-1/identified/state.json",
        "iteration-1/training/run.lock",
        "iteration-1/performance/1/run-1.mcap",
    ];
    for place in places {
        interrupt_at(rehearse("b"), &sandbox.path("b").join(place), "-KILL");
    }
    let same: Vec<Value> = serde_json::from_slice(&finish(rehearse("b").arg("--json")).stdout).unwrap();
    assert_eq!(same, of("b"));
    for (iteration, same) in iterations.iter().zip(&same) {
        for key in ["sim_f1", "robot_f1", "latency_compensation_secs", "lag_secs", "physics", "held_out_rad"]
        {
            assert_eq!(iteration[key], same[key], "{key}");
        }
    }
    let page = String::from_utf8(sandbox.bytes("b/rehearsal.html")).unwrap();
    // The first performance of the second iteration was killed.
    for (iteration, number) in [(0, 1), (1, 2)] {
        let take = format!("iteration-{iteration}/performance/{number}/run-1.wav");
        assert!(
            page.contains(&format!("src=\"{take}\"")) && sandbox.path("b").join(&take).is_file(),
            "{page}"
        );
    }
    // With drives that are fitted already only the keyboard is recorded, and a motion that is not
    // fitted.
    finish(rehearse("drives").args(["--simulator", "a/iteration-1/identified/identified.toml"]));
    let files =
        std::fs::read_dir(sandbox.path("drives/excitation")).unwrap().map(|file| file.unwrap().file_name());
    assert_eq!(
        files.collect::<std::collections::BTreeSet<_>>(),
        ["held-out.mcap", "keys.mcap"].map(Into::into).into()
    );
    let changed =
        sandbox.command("rehearse short.mid --robot twin --iterations 1 --runs 2 -o a").output().unwrap();
    assert!(errors(&changed).contains("another rehearsal"), "{}", errors(&changed));
}

/// On the worn twin joint mirroring has half of Twinkle's notes; what the joints and the fingers
/// missed is learned in two minutes of playing.
#[test]
fn playing_is_adapted_on_the_robot_itself_and_a_kill_changes_nothing() {
    let sandbox = Sandbox::new();
    let rehearse = |out: &str| {
        let rest =
            "--twin-params worn --iterations 0 --runs 2 --set task.plan.latency_compensation_secs=0.08";
        let mut command = sandbox.command(&format!("rehearse twinkle --robot twin {rest} --json"));
        command.current_dir(sandbox.path(out)).args(["-o", "there"]);
        command
    };
    let adapt = |out: &str| {
        let mut command = rehearse(out);
        command.args(["--adapt", "2"]);
        command
    };
    let report_of = |mut command: Command| -> Value {
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", errors(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let finish = |out: &str| report_of(adapt(out));
    for out in ["a", "b"] {
        std::fs::create_dir(sandbox.path(out)).unwrap();
    }
    let report = finish("a");
    let adapted = &report["adapted"];
    let before = &adapted["adapting"][1];
    assert!(before["notes_right"].as_f64().unwrap() < 10.0, "{before}");
    assert!(adapted["notes_right"].as_f64().unwrap() >= 13.0, "{adapted}");
    // 0.69 before; 0.90 if the joints alone come to their path, and the fingers do not aim deeper.
    assert!(before["robot_f1"].as_f64().unwrap() < 0.75, "{before}");
    assert!(adapted["robot_f1"].as_f64().unwrap() > 0.93, "{adapted}");
    let missed = |run: &Value| run["rail_missed_m"].as_f64().unwrap();
    let best = &adapted["adapting"][adapted["best"].as_u64().unwrap() as usize];
    assert!(missed(best) < 0.7 * missed(before), "{adapted}");

    // The rehearsal alone keeps on its page what was learned.
    assert_eq!(report_of(rehearse("a")), report);
    let page = String::from_utf8(sandbox.bytes("a/there/rehearsal.html")).unwrap();
    for part in [
        "Learned on the robot itself",
        "href=\"adaptation/run-02/1/run-1.html\"",
        "href=\"adaptation/performance/1/run-2.html\"",
        "src=\"adaptation/performance/1/run-2.wav\"",
    ] {
        assert!(page.contains(part), "{part} is not in {page}");
    }

    for place in ["run-02/adapted.json", "performance/1/run-2.mcap"] {
        interrupt_at(adapt("b"), &sandbox.path("b/there/adaptation").join(place), "-KILL");
    }
    // And at any other moment; the times are spread over its duration and the same in each run.
    for kill in 0_u64..4 {
        let mut child = adapt("b").stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        sleep(Duration::from_millis(30 + 997 * kill * kill % 1_500));
        let _ = child.kill();
        child.wait().unwrap();
    }
    assert_eq!(finish("b"), report);
    let correction = "there/adaptation/correction.json";
    assert_eq!(sandbox.bytes(format!("a/{correction}")), sandbox.bytes(format!("b/{correction}")));
    let other = adapt("b").args(["--seed", "7"]).output().unwrap();
    assert!(errors(&other).contains("another"), "{}", errors(&other));

    let perform = |song: &str, rest: &str| {
        let twin_params = if rest.contains("--twin-params") { "" } else { "--twin-params worn" };
        let line = format!("perform {song} {twin_params} --correction {correction} --json {rest}");
        let output = sandbox.command(&line).current_dir(sandbox.path("a")).output().unwrap();
        (serde_json::from_slice::<Value>(&output.stdout).unwrap_or_default(), errors(&output))
    };
    let (again, said) = perform("twinkle", "");
    assert!(again["notes_right"].as_f64().unwrap() >= 13.0 && again["mode"] == "joint-mirroring", "{said}");
    assert!(sandbox.path("a/out/twinkle-joint-mirroring-worn-corrected").is_dir(), "{said}");
    let refused = [
        ("c-major-scale", "", "the correction is for Twinkle Twinkle Little Star, not for"),
        (
            "twinkle",
            "--twin-params standard",
            "the correction is for the robot `twin (worn)`, not for `twin (standard)`",
        ),
        (
            "twinkle",
            "--mode real",
            "the correction is for joint-mirroring, in which it was learned, not for real",
        ),
        ("twinkle", "--scripted", "cannot be used with"),
    ];
    for (song, rest, why) in refused {
        let (_, said) = perform(song, rest);
        assert!(said.contains(why), "{said}");
    }
    std::fs::write(sandbox.path("a").join(correction), "{").unwrap();
    let (_, said) = perform("twinkle", "");
    assert!(said.contains("correction.json is damaged"), "{said}");
}

#[test]
fn an_adaptation_after_rounds_in_hybrid_execution_plays_in_it() {
    let sandbox = Sandbox::new();
    let output = sandbox.ok(
        "rehearse twinkle --robot twin --mode hybrid --iterations 0 --runs 1 --adapt 0.1 --json -o there",
    );
    let report: Value = serde_json::from_str(&output).unwrap();
    assert_eq!(report["adapted"]["mode"], "hybrid");
    let again =
        sandbox.ok("perform twinkle --robot twin --correction there/adaptation/correction.json --json");
    assert_eq!(serde_json::from_str::<Value>(&again).unwrap()["mode"], "hybrid");
}

/// With a corpus the iterations continue the sight-reader for all songs; the song is what the robot
/// plays.
#[test]
#[ignore = "takes a minute: `make test-heavy`, which .ci/run calls"]
fn the_sight_reader_is_adapted_once_for_all_songs() {
    let sandbox = Sandbox::new();
    let mut command = sandbox
        .command("rehearse short.mid --preset sight-reader --iterations 1 --runs 1 --evaluations 2 --json");
    let sets = ["trainer.total_steps=400", "trainer.warmup_steps=100", "corpus.validation_pieces=1"];
    let output = command.args(sets.iter().flat_map(|set| ["--set", set])).output().unwrap();
    assert!(output.status.success(), "{}", errors(&output));
    let iterations: Vec<Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert!(
        iterations[0]["policy"].as_str().unwrap().ends_with("policies/sight-reader.safetensors"),
        "{iterations:?}"
    );
    let training = "out/rehearse-sight-reader/iteration-1/training";
    assert!(iterations[1]["policy"].as_str().unwrap().starts_with(training), "{iterations:?}");
    // It learned the corpus, in the fitted simulator.
    assert!(!sandbox.path(training).join("song.mid").exists());
    let config = String::from_utf8(sandbox.bytes(format!("{training}/config.toml"))).unwrap();
    assert!(config.contains("[corpus]") && config.contains("joint.rail.delay"), "{config}");
    let lead = |iteration: usize| iterations[iteration]["latency_compensation_secs"].as_f64().unwrap();
    let late = iterations[1]["lag_secs"].as_f64().unwrap();
    assert!((0.0..=0.25).contains(&lead(1)) && lead(1) != 0.025 && late.abs() < 0.03, "{iterations:?}");
    // It plays other songs too.
    let lead = format!("task.plan.latency_compensation_secs={}", lead(1));
    let report = sandbox.json(&format!("perform twinkle --policy {training} --set {lead} -o twinkle --json"));
    assert!(report["notes_right"].as_f64().unwrap() > 7.0, "{report}");
}
