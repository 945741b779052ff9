//! Playing at sight: melodies to practise on, a training on them, and what it is used for.

use etude_music::{Note, Song, Split, melodies};
use serde_json::Value;

use crate::{Sandbox, errors, shipped, succeed};

/// A sight-reader that takes seconds to train.
const READER: &str =
    "--preset sight-reader --set corpus.validation_pieces=1 --set trainer.evaluate_every_steps=400";

#[test]
fn melodies_are_written_by_seed_and_by_part() {
    let sandbox = Sandbox::new();
    let said = sandbox.ok("songs make --seed 7 -o melody.mid");
    assert!(said.starts_with("Melody 7 for ") && said.contains("etude play melody.mid"), "{said}");
    sandbox.ok("songs make --seed 7 -o again.mid");
    assert_eq!(sandbox.bytes("melody.mid"), sandbox.bytes("again.mid"));
    let expected = etude_music::melody(7);
    let song = Song::load(sandbox.path("melody.mid")).unwrap();
    assert_eq!(song.notes().len(), expected.notes().len());

    for part in Split::ALL {
        let made = sandbox.json(&format!("songs make --part {part} --seed 3 -o {part}.mid --json"));
        let song = Song::load(sandbox.path(format!("{part}.mid"))).unwrap();
        assert_eq!(song.split(), part);
        assert_eq!((&made["part"], &made["notes"]), (&part.to_string().into(), &song.notes().len().into()));
        assert!(made["seed"].as_u64().unwrap() >= 3 && made["secs"].is_number());
    }
    for (arguments, code, said) in [
        ("songs make --part tests -o x.mid", 2, "training, validation or test"),
        ("songs make -o nowhere/x.mid", 1, "nowhere"),
    ] {
        let output = sandbox.command(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{arguments}");
        assert!(errors(&output).contains(said), "{}", errors(&output));
    }
}

#[test]
fn a_sight_reader_is_trained_resumed_and_plays_what_has_no_policy_of_its_own() {
    let sandbox = Sandbox::new();
    let printed: serde_json::Value =
        serde_json::from_str(&succeed(sandbox.tiny(&format!("{READER} --json")))).unwrap();
    let run = "runs/sight-reader__0";
    assert_eq!((&printed["run"], &printed["step"]), (&run.into(), &400.into()));
    assert!(printed["song"].is_null() && printed["f1"].is_number(), "{printed}");
    assert!(!sandbox.path(run).join("song.mid").exists());
    assert!(String::from_utf8(sandbox.bytes(format!("{run}/config.toml"))).unwrap().contains("[corpus]"));

    // Stopped and resumed it is the same training.
    succeed(sandbox.tiny(&format!("{READER} --set trainer.total_steps=800 -o whole")));
    succeed(sandbox.command(&format!("train --resume {run} --set trainer.total_steps=800")));
    for name in ["policy-last.safetensors", "checkpoints/last.safetensors"] {
        assert!(sandbox.bytes(format!("{run}/{name}")) == sandbox.bytes(format!("whole/{name}")), "{name}");
    }

    // The best sight-reader there is plays, and the verb says so in one line. It may be the one
    // that comes with Étude.
    let output = sandbox.command("play short.mid").output().unwrap();
    let said = errors(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(
        said.contains("`short.mid` has no policy of its own: ") && said.contains("plays it zero-shot"),
        "{said}"
    );
    assert!(said.contains("`etude train short.mid --from sight-reader`"), "{said}");
    // What three fingers cannot reach is said too.
    let note = |pitch| Note { pitch, start_secs: 0.0, end_secs: 0.4, velocity: 80 };
    let wide = [48, 61, 74, 79].map(note).to_vec();
    Song::new("Wide", wide, 0.4).unwrap().save(sandbox.path("wide.mid")).unwrap();
    let said = errors(&sandbox.command("play wide.mid").output().unwrap());
    assert_eq!(said.lines().count(), 2, "{said}");
    let left_out = "omits 2 of 4 notes: 2 because more keys sound at once than there are fingers; `etude songs show wide.mid`";
    assert!(said.contains(left_out), "{said}");
    // Of the one that is named nothing is said: it is for every song.
    let output = sandbox.command(&format!("play short.mid --policy {run}")).output().unwrap();
    assert_eq!(errors(&output), "");
    assert!(String::from_utf8_lossy(&output.stdout).contains(run));
    let report = sandbox.json("play short.mid --policy sight-reader --json");
    assert!(report["player"].as_str().unwrap().ends_with("policies/sight-reader.safetensors"), "{report}");

    // A training of a song begins with it, with its networks and observation.
    let mut tune = sandbox.command("train short.mid -o tuned --set trainer.total_steps=400 --set trainer.warmup_steps=100 --set droq.batch=16");
    tune.args(["--from", run]);
    succeed(tune);
    let config = String::from_utf8(sandbox.bytes("tuned/config.toml")).unwrap();
    assert!(config.contains("view = \"hand\"") && !config.contains("[corpus]"), "{config}");
    assert!(
        config.contains("hidden = [\n    16,\n    16,\n]") || config.contains("hidden = [16, 16]"),
        "{config}"
    );
    let first = String::from_utf8(sandbox.bytes("tuned/metrics.jsonl")).unwrap();
    assert!(
        first.lines().next().unwrap().contains("\"step\":0,\"eval/f1\""),
        "what it begins with is played first"
    );

    // A song's own policy comes first, unless it has learned less.
    succeed(sandbox.tiny("short.mid -o runs/short__fast__0"));
    let said = errors(&sandbox.command("play short.mid").output().unwrap());
    assert!(said.contains("has a policy that plays ") && said.contains("plays it zero-shot"), "{said}");
}

/// Notes and F1 as `songs show` predicts them, and as the shipped sight-reader plays them.
#[test]
fn what_is_predicted_is_what_happens() {
    let sandbox = Sandbox::new();
    let mut songs: Vec<String> = etude_music::repertoire::ids().map(str::to_string).collect();
    // The first test melodies, the last of which is quick and has leaps too far for the time.
    for (number, song) in melodies(Split::Test, 0).take(13).enumerate() {
        song.save(sandbox.path(format!("melody-{number}.mid"))).unwrap();
        songs.push(format!("melody-{number}.mid"));
    }
    let policy = shipped("sight-reader");
    let (mut predicted, mut played) = (Vec::new(), Vec::new());
    for song in &songs {
        let shown = sandbox.json(&format!("songs show {song} --json"));
        let report = sandbox.json(&format!("play {song} --policy {} -o out --json", policy.display()));
        let notes = |report: &Value, name: &str| report[name].as_f64().unwrap();
        let away = notes(&shown["zero_shot"], "notes_right") - notes(&report, "matched");
        assert!(away.abs() <= 2.0 + 0.1 * notes(&shown, "notes"), "{song}: {shown} and {report}");
        predicted.push(notes(&shown["zero_shot"], "f1"));
        played.push(notes(&report, "f1"));
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let away: Vec<f64> = predicted.iter().zip(&played).map(|(one, other)| (one - other).abs()).collect();
    assert!(mean(&away) < 0.015, "{predicted:?} and {played:?}");
    let deviations = |values: &[f64]| values.iter().map(|value| value - mean(values)).collect::<Vec<f64>>();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (one, other) = (deviations(&predicted), deviations(&played));
    let correlation = dot(&one, &other) / (dot(&one, &one) * dot(&other, &other)).sqrt();
    assert!(correlation > 0.9, "{correlation}: {predicted:?} and {played:?}");
    // Four notes at once: one is too many.
    let note = |pitch| Note { pitch, start_secs: 0.0, end_secs: 0.4, velocity: 80 };
    Song::new("Four", [60, 62, 64, 65].map(note).to_vec(), 0.4)
        .unwrap()
        .save(sandbox.path("four.mid"))
        .unwrap();
    let said = sandbox.ok("songs show four.mid");
    assert!(said.contains("Predicted zero-shot: 3 of 4 notes, F1 0."), "{said}");
    assert!(said.contains("Chords too wide, or of more notes than fingers: 1\n"), "{said}");
}

#[test]
fn without_a_song_and_a_corpus_there_is_nothing_to_learn() {
    let sandbox = Sandbox::new();
    let output = sandbox.command("train").output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", errors(&output));
    let output = sandbox.command("train --preset fast").output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("--preset sight-reader"), "{}", errors(&output));
    let output = sandbox.command("train --preset sight-reader --set corpus.folder=none").output().unwrap();
    assert!(errors(&output).contains("none"), "{}", errors(&output));
    // A name that is misspelt, and a preset that asks for what it has not learned.
    for args in ["play twinkle --policy sight-readr", "train twinkle --from sight-readr"] {
        let said = errors(&sandbox.command(args).output().unwrap());
        assert!(
            said.contains("no policy `sight-readr`") && said.contains("sight-reader, surprise"),
            "{said}"
        );
    }
    let output = sandbox.command("train twinkle --preset expressive --from sight-reader").output().unwrap();
    assert!(errors(&output).contains("its task.velocities is false"), "{}", errors(&output));
    assert_eq!(sandbox.left_behind(), Vec::<String>::new());
}
