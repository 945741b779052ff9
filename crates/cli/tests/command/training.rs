//! `etude train`: what a run leaves, and that stopping, killing and threads change none of it.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::{Sandbox, errors, processes, succeed};

/// What must be the same, byte for byte, in two runs of one training.
const RESULTS: [&str; 3] =
    ["policy-best.safetensors", "policy-last.safetensors", "checkpoints/last.safetensors"];

/// Long enough to be stopped in the middle. The replay is small so that the checkpoint, which names
/// the replay's files, has forgotten where the training was stopped.
pub const LONGER: &str = "--set trainer.total_steps=4000 --set droq.replay_capacity=600";

fn assert_same_results(sandbox: &Sandbox, a: &str, b: &str) {
    for name in RESULTS {
        assert!(
            sandbox.bytes(format!("{a}/{name}")) == sandbox.bytes(format!("{b}/{name}")),
            "{name} of {a} and {b} differ"
        );
    }
}

/// Starts a training, whose standard output nobody reads, and waits until it has saved a checkpoint
/// after its first update.
fn start_and_wait(sandbox: &Sandbox, args: &str, folder: &str) -> Child {
    started(&mut sandbox.tiny(args), &sandbox.path(folder))
}

/// The same for a command that trains in `folder`.
pub fn started(command: &mut Command, folder: &Path) -> Child {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let rows = folder.join("metrics.jsonl");
    while std::fs::read_to_string(&rows).map_or(0, |text| text.lines().count()) < 3 {
        assert!(child.try_wait().unwrap().is_none(), "it ended before it could be stopped");
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

#[test]
fn a_run_is_complete_and_describes_itself() {
    let sandbox = Sandbox::new();
    let printed: serde_json::Value =
        serde_json::from_str(&succeed(sandbox.tiny("short.mid -o run --json"))).unwrap();
    assert_eq!((&printed["step"], &printed["updates"]), (&400.into(), &600.into()));
    assert!(
        printed["f1"].is_number() && printed["stopped"].is_null() && printed["run"] == "run",
        "{printed}"
    );
    assert_eq!(printed["policy"], "run/policy-best.safetensors");
    for name in ["song.mid", "meta.json", "metrics.jsonl", "events.out.tfevents.etude"].iter().chain(&RESULTS)
    {
        assert!(!sandbox.bytes(format!("run/{name}")).is_empty(), "{name}");
    }
    let meta: serde_json::Value = serde_json::from_slice(&sandbox.bytes("run/meta.json")).unwrap();
    assert!(meta["command"].as_str().unwrap().contains("short.mid"), "{meta}");
    let metrics = String::from_utf8(sandbox.bytes("run/metrics.jsonl")).unwrap();
    assert!(metrics.lines().all(|line| serde_json::from_str::<serde_json::Value>(line).is_ok()));
    // Its configuration makes the same training again, whatever preset it is laid over.
    succeed(sandbox.command("train short.mid -o again --preset appendix --config run/config.toml --json"));
    let text = |name: &str| String::from_utf8(sandbox.bytes(name)).unwrap();
    assert_eq!(text("run/config.toml"), text("again/config.toml"));
    assert_same_results(&sandbox, "run", "again");
}

#[test]
fn threads_and_an_interruption_change_nothing() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny(&format!("short.mid -o whole --set trainer.threads=1 {LONGER}")));
    let more = format!("short.mid -o parts --set trainer.threads=2 --set trainer.overlap=false {LONGER}");
    let child = start_and_wait(&sandbox, &more, "parts");
    processes::signal(child.id(), "INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", errors(&output));
    assert!(errors(&output).contains("stopping and saving"), "{}", errors(&output));
    assert_ne!(
        sandbox.bytes("whole/policy-last.safetensors"),
        sandbox.bytes("parts/policy-last.safetensors")
    );
    let text = sandbox.ok("train --resume parts --set trainer.threads=1");
    assert!(text.contains("resumed at step") && text.contains("Finished after 4000 steps"), "{text}");
    assert_same_results(&sandbox, "whole", "parts");
}

#[test]
fn a_killed_training_goes_on_from_its_last_checkpoint() {
    let sandbox = Sandbox::new();
    let more = format!("short.mid -o killed {LONGER}");
    let mut child = start_and_wait(&sandbox, &more, "killed");
    // Nobody else may work there meanwhile.
    let output = sandbox.command("train --resume killed").output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("another `etude train` is at work in killed"), "{}", errors(&output));
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(sandbox.ok("train --resume killed").contains("Finished after 4000 steps"));
    succeed(sandbox.tiny(&format!("short.mid -o whole {LONGER}")));
    assert_same_results(&sandbox, "whole", "killed");
}

/// Another world, the same song: what was learned is there at step 0, and a run that begins so is
/// one like any other.
#[test]
fn a_training_begins_with_what_another_one_has_learned() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o source"));
    let other = "--set task.physics.joint.rail.acceleration_limit=7.5";
    let more = format!("short.mid --from source {other} {LONGER}");
    let text = succeed(sandbox.tiny(&format!("{more} -o whole --set trainer.threads=1")));
    assert!(text.contains("from source"), "{text}");
    let meta: serde_json::Value = serde_json::from_slice(&sandbox.bytes("whole/meta.json")).unwrap();
    assert_eq!(meta["from"], "source");
    // Its first row is the source's last policy in the new world.
    let metrics = String::from_utf8(sandbox.bytes("whole/metrics.jsonl")).unwrap();
    let first: serde_json::Value = serde_json::from_str(metrics.lines().next().unwrap()).unwrap();
    let play = format!("play short.mid --policy source/policy-last.safetensors {other} --json");
    assert_eq!((&first["step"], &first["eval/f1"]), (&0.into(), &sandbox.json(&play)["f1"]));

    let child = start_and_wait(&sandbox, &format!("{more} -o parts --set trainer.threads=2"), "parts");
    processes::signal(child.id(), "INT");
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(3));
    // The source is not needed to go on.
    std::fs::remove_dir_all(sandbox.path("source")).unwrap();
    assert!(sandbox.ok("train --resume parts --set trainer.threads=1").contains("Finished after 4000 steps"));
    assert_same_results(&sandbox, "whole", "parts");
}

#[test]
fn time_runs_out_and_more_can_be_asked_for() {
    let sandbox = Sandbox::new();
    let text = succeed(sandbox.tiny("short.mid -o run --minutes 0.0000001"));
    assert!(text.contains("Not evaluated yet") && text.contains("etude train --resume run"), "{text}");
    // Playable all the same.
    assert!(sandbox.ok("play short.mid --policy run").contains("policy-last"));
    assert!(sandbox.ok("train --resume run").contains("Finished after 400 steps"));
    let text = sandbox.ok("train --resume run --set trainer.total_steps=6e2");
    assert!(text.contains("resumed at step 400") && text.contains("Finished after 600 steps"), "{text}");
    assert!(String::from_utf8(sandbox.bytes("run/config.toml")).unwrap().contains("total_steps = 600"));
}
