//! `etude play`: every file that it leaves, read back.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::Command;

use etude_music::metrics::note_scores;
use etude_music::{Note, Song, repertoire};
use etude_perform::Recording;

use crate::{Sandbox, csv, errors, root, shipped, succeed};

/// Environment variable that names a Python with scikit-learn and mcap; `make test` sets it.
const PYTHON: &str = "ETUDE_PYTHON";

#[test]
fn a_performance_is_kept_whole() {
    let sandbox = Sandbox::new();
    succeed(sandbox.tiny("short.mid -o run --json"));
    let printed = sandbox.json("play short.mid --policy run -o out --json");

    let report: serde_json::Value = serde_json::from_slice(&sandbox.bytes("out/1/report.json")).unwrap();
    assert_eq!(report, printed);
    for key in [
        "precision",
        "recall",
        "f1",
        "pooled_f1",
        "onset_f1",
        "onset_offset_f1",
        "matched",
        "missed",
        "wrong",
    ] {
        assert!(report[key].is_number(), "{key} in {report}");
    }

    let rows = csv(&sandbox.bytes("out/1/frames.csv"));
    assert_eq!(rows[0], ["step", "due", "pressed"]);
    let steps = report["steps"].as_u64().unwrap() as usize;
    assert_eq!(rows.len(), 1 + steps);
    let pitches = |text: &String| text.split_whitespace().map(|p| p.parse().unwrap()).collect::<Vec<u8>>();

    let recording = Recording::read(&sandbox.path("out/1/recording.mcap")).unwrap();
    assert!(recording.complete && recording.steps.len() == steps && recording.header.joints.len() == 13);
    for ((row, step), due) in rows[1..].iter().zip(&recording.steps).zip(&recording.header.due) {
        assert_eq!((&pitches(&row[1]), &pitches(&row[2])), (due, &step.pressed));
    }
    let strikes = recording.keys.iter().filter(|key| key.velocity > 0).count();

    match Song::load(sandbox.path("out/1/performance.mid")) {
        Ok(played) => assert!(!played.notes().is_empty() && strikes > 0),
        Err(error) => assert!(strikes == 0 && error.to_string().contains("no notes"), "{error}"),
    }

    let wav = sandbox.bytes("out/1/performance.wav");
    assert_eq!((&wav[..4], &wav[8..12], &wav[36..40]), (&b"RIFF"[..], &b"WAVE"[..], &b"data"[..]));
    let data = u32::from_le_bytes(wav[40..44].try_into().unwrap()) as usize;
    assert_eq!((wav.len(), u16::from_le_bytes([wav[34], wav[35]])), (44 + data, 16));

    let text = sandbox.ok("play short.mid --policy run/policy-last.safetensors -o again");
    assert!(text.contains("F1") && text.contains("again/1/performance.wav"), "{text}");
    // The same policy, the same world: the same keys. And a run's own copy of the song is that
    // song.
    succeed(sandbox.command("play run/song.mid --policy run -o copy"));
    assert_eq!(sandbox.bytes("out/1/frames.csv"), sandbox.bytes("copy/1/frames.csv"));
    let output = sandbox.command("play run/song.mid --policy run -o copy").output().unwrap();
    assert_eq!(errors(&output), "");
    check_elsewhere("check_performance.py", &[sandbox.path("out/latest")]);
    check_elsewhere("check_tfevents.py", &[sandbox.path("run")]);
}

#[test]
fn a_run_is_found_by_its_song_and_a_damaged_one_does_not_hide_it() {
    let sandbox = Sandbox::new();
    for run in ["runs/twinkle__mine", "runs/twinkle__bad"] {
        std::fs::create_dir_all(sandbox.path(run)).unwrap();
    }
    std::fs::copy(shipped("twinkle"), sandbox.path("runs/twinkle__mine/policy-best.safetensors")).unwrap();
    std::fs::write(sandbox.path("runs/twinkle__bad/policy-best.safetensors"), "damaged").unwrap();
    let report = sandbox.json("play twinkle --json");
    assert!(report["player"].as_str().unwrap().contains("twinkle__mine"), "{report}");
    assert!(sandbox.path("out/twinkle/latest/performance.wav").is_file());

    // One that has learned less than the sight-reader plays is passed over, and named.
    succeed(sandbox.tiny("short.mid --json"));
    let output = sandbox.command("play short.mid --json").output().unwrap();
    let said = errors(&output);
    assert!(
        said.contains("`short.mid` has a policy that plays ") && said.contains("short__fast__0"),
        "{said}"
    );
    assert!(String::from_utf8_lossy(&output.stdout).contains("sight-reader"), "{said}");
    // Stopped before its first evaluation it has learned nothing: the sight-reader plays better.
    let never = "runs/short__fast__1";
    succeed(sandbox.tiny(&format!(
        "short.mid --set trainer.evaluate_every_steps=1000 --minutes 0.0001 --out {never} --json"
    )));
    assert!(sandbox.path(never).join("policy-last.safetensors").is_file());
    std::fs::remove_dir_all(sandbox.path("runs/short__fast__0")).unwrap();
    let report = sandbox.json("play short.mid --json");
    assert!(report["player"].as_str().unwrap().contains("sight-reader"), "{report}");
}

/// A script of `scripts` on `files`, by the Python that has the readers we did not write.
pub(crate) fn check_elsewhere(script: &str, files: &[PathBuf]) {
    if let Some(said) = read_elsewhere(script, files) {
        println!("{said}");
    }
}

/// What the script prints, which must succeed; none without a Python for it.
pub(crate) fn read_elsewhere(script: &str, files: &[PathBuf]) -> Option<String> {
    let Some(python) = std::env::var_os(PYTHON) else {
        // Not through a macro: the test harness would swallow it.
        let _ = writeln!(
            std::io::stderr(),
            "\n*** SKIPPED: {script}. Set {PYTHON} to a Python that has them. ***\n"
        );
        return None;
    };
    let script = root().join("scripts").join(script);
    let output = Command::new(&python).arg(script).args(files).output();
    let output = output.unwrap_or_else(|error| panic!("{PYTHON}={python:?} does not run: {error}"));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}{}", errors(&output));
    Some(said)
}

/// The written time after the initial silence, in the recording, in the MIDI file, and in what
/// `compare` prints; so another reader of the MIDI file counts as the report does.
#[test]
fn a_note_has_one_time_in_every_file() {
    let sandbox = Sandbox::new();
    let report = sandbox.json("play twinkle -o out --json");
    let song = repertoire::get("twinkle").unwrap();
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-4, "{a} s and {b} s");

    let header = Recording::read(&sandbox.path("out/1/recording.mcap")).unwrap().header;
    let due: Vec<Note> = header.due_notes.iter().map(|note| Note::from(*note)).collect();
    assert_eq!(due.len(), song.notes().len());
    due.iter().zip(song.notes()).for_each(|(due, written)| near(due.start_secs, written.start_secs + 1.0));

    let played = Song::load(sandbox.path("out/1/performance.mid")).unwrap();
    assert_eq!(note_scores(&due, played.notes()).matched, report["matched"].as_u64().unwrap() as usize);
    let compared = sandbox.json("compare out out --json");
    let notes = compared["notes"].as_array().unwrap();
    assert_eq!(notes.len(), due.len());
    for ((note, due), played) in notes.iter().zip(&due).zip(played.notes()) {
        near(note["due_secs"].as_f64().unwrap(), due.start_secs);
        let late_secs = note["played"][0]["onset_error_secs"].as_f64().unwrap();
        near(due.start_secs + late_secs, played.start_secs);
    }
    check_elsewhere("check_midi.py", &[sandbox.path("out/latest")]);
}

/// What the score says is also what another program hears.
#[test]
fn the_sound_of_the_shipped_twinkle_has_its_onsets() {
    let sandbox = Sandbox::new();
    sandbox.ok("play twinkle -o out");
    check_elsewhere("check_sound.py", &[sandbox.path("out/latest")]);
}

#[test]
fn of_equally_good_policies_that_of_a_run_plays() {
    let sandbox = Sandbox::new();
    let shipped = shipped("twinkle");
    assert_eq!(
        sandbox.json("play twinkle -o out --json")["f1"],
        sandbox.json(&format!("play twinkle --policy {} -o out --json", shipped.display()))["f1"]
    );
    std::fs::create_dir_all(sandbox.path("runs/twinkle__mine")).unwrap();
    std::fs::copy(shipped, sandbox.path("runs/twinkle__mine/policy-best.safetensors")).unwrap();
    let player = sandbox.json("play twinkle -o out --json")["player"].as_str().unwrap().to_owned();
    assert!(player.contains("twinkle__mine"), "{player}");
}

#[test]
fn the_scripted_player_needs_no_training() {
    let sandbox = Sandbox::new();
    let report = sandbox.json("play c-major-scale --scripted -o out --json");
    assert!(report["f1"].as_f64().unwrap() > 0.93, "{report}");
    assert_eq!(report["player"], "scripted");
    assert!(report["limits"].as_str().unwrap().contains("notes"));
}
