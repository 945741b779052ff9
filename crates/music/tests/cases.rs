//! Small MIDI files that other players read, or that hold something to be said: from the field.

#![allow(clippy::unwrap_used, reason = "an unwrap that fails fails the test")]

use std::path::{Path, PathBuf};

use etude_music::MidiFile;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/cases")
}

fn load(name: &str) -> MidiFile {
    MidiFile::load(folder().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Pitch, start and end of each note, s.
fn notes(file: &MidiFile) -> Vec<(u8, f64, f64)> {
    let rounded = |secs: f64| (secs * 1e6).round() / 1e6;
    file.song
        .notes()
        .iter()
        .map(|note| (note.pitch, rounded(note.start_secs), rounded(note.end_secs)))
        .collect()
}

/// C, D, E, F of half a second each, from the beginning on.
const FOUR: [(u8, f64, f64); 4] = [(60, 0.0, 0.5), (62, 0.5, 1.0), (64, 1.0, 1.5), (65, 1.5, 2.0)];

fn said(file: &MidiFile) -> Vec<String> {
    file.remarks.iter().map(ToString::to_string).collect()
}

/// Every file of the folder is in one of the tests below, and most hold the same four notes.
#[test]
fn what_says_nothing_of_notes_changes_no_note() {
    let all = std::fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().file_name());
    for name in all.map(|name| name.into_string().unwrap()) {
        let file = load(&name);
        if !OTHERS.iter().any(|(other, ..)| *other == name) {
            assert_eq!(notes(&file), FOUR, "{name}");
            assert_eq!(said(&file), [""; 0], "{name}");
        }
    }
}

/// Files with other notes or with remarks: their notes, and what is said.
#[expect(clippy::type_complexity, reason = "a table")]
const OTHERS: &[(&str, &[(u8, f64, f64)], &[&str])] = &[
    (
        "a-minute-of-silence.mid",
        &[(60, 60.0, 60.5), (62, 60.5, 61.0), (64, 61.0, 61.5), (65, 61.5, 62.0)],
        &["60.0 s of silence before the first note: left out (--keep-silence keeps it)"],
    ),
    (
        "all-notes-off-ends.mid",
        &[(60, 0.0, 0.5), (62, 0.5, 1.0)],
        &["2 notes without a release: \"all notes off\" ends them"],
    ),
    (
        "left-hand-on-channel-10.mid",
        &FOUR,
        &["4 strokes on channel 10 (percussion): left out; move a melody there to another channel"],
    ),
    ("length-3-too-long-first-track.mid", &FOUR, &["track 1 announces 14 bytes and has 11"]),
    ("length-3-too-short-first-track.mid", &FOUR, &["track 1 announces 8 bytes and has 11"]),
    ("length-one-too-long.mid", &FOUR, &["track 1 announces 41 bytes and has 40"]),
    (
        "no-release-long-tail.mid",
        &[(60, 0.0, 601.0), (62, 0.5, 1.0)],
        &["C4 at 0.0 s is never released, and lasts to the end of the file at 601.0 s"],
    ),
    (
        "notes-after-end.mid",
        &[(60, 0.0, 0.5), (62, 0.5, 1.0)],
        &["2 notes after the end of track 1: left out"],
    ),
    ("ok-two-channels-one-pitch.mid", &[(60, 0.0, 0.5), (67, 0.0, 0.5)], &[]),
    (
        "one-track-too-few.mid",
        &FOUR,
        &["the header announces 3 tracks, the file has 2: parts may be missing"],
    ),
    ("struck-again-new-first.mid", &[(60, 0.0, 0.5), (60, 0.5, 1.0)], &[]),
    ("struck-again-old-first.mid", &[(60, 0.0, 0.5), (60, 0.5, 1.0)], &[]),
];

#[test]
fn what_is_left_out_or_lengthened_is_said() {
    for (name, expected, remarks) in OTHERS {
        let file = load(name);
        assert_eq!(notes(&file), *expected, "{name}");
        assert_eq!(said(&file), *remarks, "{name}");
    }
}

/// A release in the tick of its stroke ends it, unless it is that of the stroke before.
#[test]
fn a_note_of_no_length_stays() {
    let of = |events: &[u8]| {
        let body = [events, &[0, 0xFF, 0x2F, 0]].concat();
        let head = [&b"MThd\0\0\0\x06\0\0\0\x01\x01\xE0MTrk\0\0\0"[..], &[body.len() as u8]].concat();
        notes(&MidiFile::read(&[head, body].concat(), "").unwrap())
    };
    // C struck, struck again after 0.25 s, and released twice at once: the second has no length.
    let twice = [0, 0x90, 60, 80, 0x81, 0x70, 0x90, 60, 80, 0, 0x80, 60, 0, 0, 0x80, 60, 0];
    assert_eq!(of(&twice), [(60, 0.0, 0.25), (60, 0.25, 0.25)]);
    let once = &twice[..13];
    assert_eq!(of(once), of(&twice), "the one release is its own if no other comes");
    let alone = [0, 0x90, 60, 80, 0, 0x80, 60, 0, 0, 0x90, 62, 80, 0x83, 0x60, 0x80, 62, 0];
    assert_eq!(of(&alone), [(60, 0.0, 0.0), (62, 0.0, 0.5)]);
}

#[test]
fn a_bad_note_is_named_with_its_byte() {
    let mut bytes = std::fs::read(folder().join("plain.mid")).unwrap();
    bytes[24] = 0x80;
    let said = MidiFile::read(&bytes, "").unwrap_err().to_string();
    assert!(said.starts_with("track 1 is damaged at byte "), "{said}");
    assert!(said.contains("(a note of pitch 128, above 127)"), "{said}");
}

#[test]
fn silence_in_front_is_cut_off_with_its_bars() {
    let written = load("a-minute-of-silence.mid").song;
    let cut = written.without_initial_silence();
    assert_eq!(notes(&MidiFile { song: cut.clone(), remarks: vec![] }), FOUR);
    assert_eq!(cut.duration_secs(), 2.0);
    for secs in [0.0, 0.7, 1.9] {
        assert_eq!(cut.position(secs).to_string(), written.position(60.0 + secs).to_string(), "{secs} s");
    }
    assert_eq!(cut.without_initial_silence(), cut);
}
