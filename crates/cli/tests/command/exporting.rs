//! `etude export`: models that other programs run.

use etude_learn::Policy;

use crate::playing::check_elsewhere;
use crate::{Sandbox, errors, root, shipped, succeed};

#[test]
fn onnx_runtime_acts_as_the_policy_does() {
    let sandbox = Sandbox::new();
    let shipped = shipped("twinkle");
    let mut policy = Policy::load(&shipped).unwrap();
    let layout = policy.header().layout;
    // Joints far beyond their ranges too, and a tenth of the keys.
    let value = |index: usize| match index % layout.len() {
        column if column < layout.real => 3.0 * (0.7 * index as f32).sin(),
        _ => f32::from(u8::from(index.wrapping_mul(2_654_435_761).is_multiple_of(10))),
    };
    let observations: Vec<f32> = (0..100 * layout.len()).map(value).collect();
    let mut actions = vec![0.0; 100 * policy.header().action_len];
    policy.act(&observations, &mut actions);
    let write = |name: &str, values: &[f32]| {
        std::fs::write(sandbox.path(name), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())
            .unwrap();
    };
    write("observations", &observations);
    write("actions", &actions);

    let said = sandbox.json("export onnx twinkle -o new/twinkle.onnx --json");
    assert_eq!(said["model"], "new/twinkle.onnx");
    let files = ["new/twinkle.onnx", "observations", "actions"].map(|name| sandbox.path(name));
    check_elsewhere("check_onnx.py", &files);
}

/// What the policy saw and did in performances on the twin, from the description in the model and
/// from joints and keys alone: with an observation relative to the hand, with one of the whole
/// keyboard, and with velocities.
#[test]
fn a_model_says_all_that_is_needed_to_play() {
    let sandbox = Sandbox::new();
    let song = root().join("songs/au-clair-de-la-lune.mid");
    for (name, song, policy) in [
        ("sight", song.to_str().unwrap(), "sight-reader"),
        ("own", "twinkle", "twinkle"),
        ("velocities", "chord-progression", "surprise-symphony"),
    ] {
        let policy = format!("--policy {}", shipped(policy).display());
        sandbox.ok(&format!("export onnx {song} {policy} -o {name}.onnx"));
        sandbox.ok(&format!("perform {song} {policy} --robot twin -o {name}"));
        let files = [format!("{name}.onnx"), format!("{name}/1/run-1.mcap")].map(|file| sandbox.path(file));
        check_elsewhere("check_contract.py", &files);
    }
}

#[test]
fn what_cannot_be_exported_is_refused() {
    let sandbox = Sandbox::new();
    for (args, message) in [
        ("export onnx twinkle --scripted", "no network"),
        ("export onnx twinkle -o twinkle.pb", "the name must end in .onnx"),
        ("export onnx twinckle", "did you mean twinkle"),
    ] {
        let output = sandbox.command(args).output().unwrap();
        assert!(!output.status.success() && errors(&output).contains(message), "{args}: {}", errors(&output));
    }
    assert_eq!(sandbox.left_behind(), [""; 0]);
    succeed(sandbox.tiny("short.mid -o run --json"));
    assert!(sandbox.ok("export onnx short.mid --policy run").contains("short.onnx"));
    // A song without a policy of its own gets the sight-reader.
    let said = sandbox.json("export onnx short.mid --json");
    assert!(said["policy"].as_str().unwrap().ends_with("sight-reader.safetensors"), "{said}");
}
