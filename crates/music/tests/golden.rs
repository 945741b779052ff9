//! The crate against independent implementations: scikit-learn, mir_eval, mido, and RoboPianist's
//! rules in exact fractions. `scripts/golden_music.py` made the files.

#![allow(clippy::unwrap_used, reason = "an unwrap that fails fails the test")]

use std::path::PathBuf;

use etude_music::metrics::{frame_scores, note_scores};
use etude_music::{KeySet, Note, Song};
use serde_json::Value;

fn golden(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

fn read(name: &str) -> Value {
    serde_json::from_slice(&std::fs::read(golden(name)).unwrap()).unwrap()
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap()
}

fn key_sets(value: &Value) -> Vec<KeySet> {
    list(value).iter().map(|word| KeySet(word.as_u64().unwrap())).collect()
}

/// A note from `[pitch, start, end]`, or from `[pitch, velocity, start, end]`.
fn note(value: &Value) -> Note {
    let numbers: Vec<f64> = list(value).iter().map(|number| number.as_f64().unwrap()).collect();
    let (pitch, velocity, start_secs, end_secs) = match numbers[..] {
        [pitch, start, end] => (pitch, 64.0, start, end),
        [pitch, velocity, start, end] => (pitch, velocity, start, end),
        _ => panic!("not a note: {value}"),
    };
    Note { pitch: pitch as u8, velocity: velocity as u8, start_secs, end_secs }
}

fn notes(value: &Value) -> Vec<Note> {
    list(value).iter().map(note).collect()
}

/// Compares every score of the golden file with the field of that name.
fn assert_scores(case: &Value, ours: &Value) {
    for (name, theirs) in case["scores"].as_object().unwrap() {
        let (ours, theirs) = (ours[name].as_f64().unwrap(), theirs.as_f64().unwrap());
        assert!((ours - theirs).abs() < 1e-12, "{} {name}: ours {ours}, theirs {theirs}", case["name"]);
    }
}

#[test]
fn frame_scores_are_those_of_scikit_learn() {
    let golden = read("metrics.json");
    for case in list(&golden["frames"]) {
        let scores = frame_scores(&key_sets(&case["due"]), &key_sets(&case["pressed"]));
        assert_scores(case, &serde_json::to_value(scores).unwrap());
    }
}

#[test]
fn note_scores_are_those_of_mir_eval() {
    let golden = read("metrics.json");
    for case in list(&golden["notes"]).iter().chain(list(&golden["velocities"])) {
        let scores = note_scores(&notes(&case["reference"]), &notes(&case["played"]));
        assert_scores(case, &serde_json::to_value(scores).unwrap());
    }
}

#[test]
fn frames_follow_the_rules_of_robopianist() {
    for (i, case) in list(&read("rolls.json")).iter().enumerate() {
        let song = Song::new("", notes(&case["notes"]), case["duration"].as_f64().unwrap()).unwrap();
        let frames = song.frames(case["hz"].as_f64().unwrap()).unwrap();
        let expected = key_sets(&case["frames"]);
        assert_eq!(frames.len(), expected.len(), "case {i}");
        for (step, (ours, theirs)) in frames.iter().zip(&expected).enumerate() {
            assert_eq!(ours, theirs, "case {i}, frame {step}: ours {ours}, theirs {theirs}");
        }
    }
}

#[test]
fn midi_files_hold_the_notes_that_mido_finds() {
    for case in list(&read("midi.json")) {
        let file = case["file"].as_str().unwrap();
        let song = Song::load(golden("midi").join(file)).unwrap();
        let expected = notes(&case["notes"]);
        assert_eq!(song.notes().len(), expected.len(), "{file}: {:?}", song.notes());
        for (ours, theirs) in song.notes().iter().zip(&expected) {
            let same = ours.pitch == theirs.pitch
                && ours.velocity == theirs.velocity
                && (ours.start_secs - theirs.start_secs).abs() < 1e-9
                && (ours.end_secs - theirs.end_secs).abs() < 1e-9;
            assert!(same, "{file}: ours {ours:?}, theirs {theirs:?}");
        }
        let last = expected.iter().map(|note| note.end_secs).fold(0.0, f64::max);
        assert!((song.duration_secs() - last).abs() < 1e-9, "{file}");
    }
}

#[test]
fn bars_follow_signatures_and_tempos() {
    let song = Song::load(golden("midi").join("signatures.mid")).unwrap();
    let places: Vec<String> =
        song.notes().iter().map(|note| song.position(note.start_secs).to_string()).collect();
    assert_eq!(places, ["bar 1, beat 1", "bar 2, beat 1", "bar 3, beat 1", "bar 4, beat 1"]);
    assert_eq!(song.position(0.75).to_string(), "bar 1, beat 2.5");
    // Six eighth notes a bar, of half the length of a quarter note.
    assert_eq!(song.position(1.5 + 0.75).to_string(), "bar 2, beat 4");
    // Twice as fast from here on.
    assert_eq!(song.position(3.0 + 0.125).to_string(), "bar 3, beat 2");
}
