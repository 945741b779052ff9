//! What must hold for every song, file and performance, however odd.

#![allow(clippy::unwrap_used, reason = "an unwrap that fails fails the test")]

use std::collections::BTreeSet;

use etude_music::metrics::{frame_scores, note_scores};
use etude_music::{KEY_COUNT, KeyEvent, KeySet, Note, Song, notes_from_key_events, sound};
use proptest::collection::{btree_set, vec};
use proptest::prelude::*;

fn key_set() -> impl Strategy<Value = KeySet> {
    btree_set(0..KEY_COUNT, 0..6).prop_map(|keys| keys.into_iter().collect())
}

fn note(pitches: std::ops::RangeInclusive<u8>) -> impl Strategy<Value = Note> {
    (pitches, 1..=127u8, 0..20_000u32, 0..3_000u32).prop_map(|(pitch, velocity, start, length)| Note {
        pitch,
        velocity,
        start_secs: f64::from(start) / 1000.0,
        end_secs: f64::from(start + length) / 1000.0,
    })
}

fn song() -> impl Strategy<Value = Song> {
    vec(note(0..=127), 1..60).prop_map(|notes| Song::new("any", notes, 0.0).unwrap())
}

fn playable_song() -> impl Strategy<Value = Song> {
    vec(note(36..=84), 0..60).prop_map(|notes| Song::new("playable", notes, 0.0).unwrap())
}

/// The notes of a sequence of frames: each run of frames with a key is one note.
fn notes_of(frames: &[KeySet], hz: f64) -> Vec<Note> {
    let mut before = KeySet::EMPTY;
    let mut events = Vec::new();
    for (frame, &now) in frames.iter().enumerate() {
        let event = |key, velocity| KeyEvent { secs: frame as f64 / hz, key, velocity };
        events.extend(before.difference(now).iter().map(|key| event(key, 0)));
        events.extend(now.difference(before).iter().map(|key| event(key, 64)));
        before = now;
    }
    notes_from_key_events(&events, frames.len() as f64 / hz)
}

/// Everything that a user can do with a file must end in a song or an error.
fn use_file(bytes: &[u8]) {
    let Ok(song) = Song::from_midi(bytes, "any") else { return };
    assert!(!song.notes().is_empty());
    let _ = song.frames(20.0);
    if let Err(error) = song.check_range() {
        assert!(error.to_string().contains("keyboard"));
    }
    let again = Song::from_midi(&song.to_midi(), "again").unwrap();
    assert!(again.notes().len() <= song.notes().len());
}

fn golden_files() -> Vec<Vec<u8>> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/midi");
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().map(|path| std::fs::read(path).unwrap()).collect()
}

proptest! {
    #[test]
    fn key_sets_are_sets(a in btree_set(0..KEY_COUNT, 0..KEY_COUNT), b in btree_set(0..KEY_COUNT, 0..KEY_COUNT), key in 0..KEY_COUNT) {
        let set = |keys: &BTreeSet<usize>| keys.iter().copied().collect::<KeySet>();
        let (x, y) = (set(&a), set(&b));
        prop_assert_eq!(x.intersection(y), set(&(&a & &b)));
        prop_assert_eq!(x.difference(y), set(&(&a - &b)));
        prop_assert_eq!(x.iter().collect::<Vec<_>>(), a.iter().copied().collect::<Vec<_>>());
        prop_assert_eq!((x.len(), x.is_empty(), x.contains(key)), (a.len(), a.is_empty(), a.contains(&key)));
        prop_assert_eq!(KeySet::from_pitches(x.pitches()), x);
        let (mut z, mut c) = (x, a);
        prop_assert_eq!(z.insert(key), c.insert(key));
        prop_assert_eq!(z, set(&c));
        prop_assert_eq!(z.remove(key), c.remove(&key));
        prop_assert_eq!(z, set(&c));
    }

    #[test]
    fn a_song_survives_its_midi_file(song in song(), silence in 0.0..5.0f64, factor in 0.3..3.0f64) {
        // Half a tick each for the note and for the border of its stretch of tempo.
        const TICK_SECS: f64 = 0.5 * 3.0 / 9600.0;
        let song = song.stretch(factor).unwrap().with_initial_silence(silence).unwrap();
        let again = Song::from_midi(&song.to_midi(), song.title()).unwrap();
        // Ticks may bring the ends of notes together, and with them two strokes of no length; never
        // more.
        prop_assert!(again.notes().len() <= song.notes().len());
        for note in again.notes() {
            let near = song.notes().iter().any(|old| old.pitch == note.pitch
                && old.velocity == note.velocity
                && (old.start_secs - note.start_secs).abs() <= TICK_SECS
                && (old.end_secs - note.end_secs).abs() <= TICK_SECS);
            prop_assert!(near, "{:?} is not in {:?}", note, song.notes());
        }
        for old in song.notes() {
            let near = again.notes().iter().any(|note| old.pitch == note.pitch
                && (old.start_secs - note.start_secs).abs() <= TICK_SECS);
            prop_assert!(near, "{:?} is lost in {:?}", old, again.notes());
        }
        // Nothing more is lost by doing it again.
        let third = Song::from_midi(&again.to_midi(), "").unwrap();
        prop_assert_eq!(third.notes().len(), again.notes().len());
    }

    #[test]
    fn notes_never_overlap_and_changes_undo(song in song(), semitones in -20..20i32) {
        for pitch in 0..128 {
            let same: Vec<_> = song.notes().iter().filter(|note| note.pitch == pitch).collect();
            prop_assert!(same.windows(2).all(|pair| pair[0].end_secs <= pair[1].start_secs));
        }
        prop_assert!(song.notes().is_sorted_by(|a, b| (a.start_secs, a.pitch) < (b.start_secs, b.pitch)));
        prop_assert_eq!(Song::new("any", song.notes().to_vec(), 0.0).unwrap(), song.clone());
        if let Ok(moved) = song.transpose(semitones) {
            prop_assert_eq!(moved.transpose(-semitones).unwrap(), song);
        }
    }

    #[test]
    fn frames_have_the_right_length_and_sound_what_is_written(song in playable_song(), hz in 1..200u32) {
        let frames = song.frames(f64::from(hz)).unwrap();
        prop_assert_eq!(frames.len(), (song.duration_secs() * f64::from(hz) + 1e-6) as usize + 1);
        let played = notes_of(&frames, f64::from(hz));
        let step = 1.0 / f64::from(hz);
        for note in &played {
            let asked = song.notes().iter().any(|due| due.pitch == note.pitch
                && due.start_secs < note.end_secs + 1e-6 && note.start_secs < due.end_secs + step);
            prop_assert!(asked, "{:?} was not written", note);
        }
    }

    #[test]
    fn frames_and_notes_are_two_ways_to_say_one_thing(frames in vec(key_set(), 0..60)) {
        let notes = notes_of(&frames, 20.0);
        let song = Song::new("", notes, 0.0).unwrap();
        let mut again = song.frames(20.0).unwrap();
        again.resize(frames.len().max(again.len()), KeySet::EMPTY);
        let mut frames = frames;
        frames.resize(again.len(), KeySet::EMPTY);
        prop_assert_eq!(again, frames);
    }

    #[test]
    fn frame_scores_are_shares(due in vec(key_set(), 0..30), pressed in vec(key_set(), 0..30)) {
        let scores = frame_scores(&due, &pressed);
        let all = [scores.precision, scores.recall, scores.f1,
            scores.pooled_precision, scores.pooled_recall, scores.pooled_f1];
        prop_assert!(all.iter().all(|share| (0.0..=1.0).contains(share)), "{:?}", scores);
        prop_assert_eq!(frame_scores(&due, &due).f1, 1.0);
        let swapped = frame_scores(&pressed, &due);
        prop_assert_eq!((scores.precision, scores.recall, scores.f1), (swapped.recall, swapped.precision, swapped.f1));
        prop_assert_eq!(scores.pooled_f1, swapped.pooled_f1);
    }

    #[test]
    fn note_scores_are_shares_and_ignore_order(
        (due, shuffled) in vec(note(60..=62), 0..25).prop_flat_map(|notes| (Just(notes.clone()), Just(notes).prop_shuffle())),
        played in vec(note(60..=62), 0..25),
        shift_ms in -50..50i32,
    ) {
        let scores = note_scores(&due, &played);
        prop_assert_eq!(note_scores(&shuffled, &played), scores);
        let all = [scores.onset_precision, scores.onset_recall, scores.onset_f1,
            scores.onset_offset_precision, scores.onset_offset_recall, scores.onset_offset_f1];
        prop_assert!(all.iter().all(|share| (0.0..=1.0).contains(share)), "{:?}", scores);
        prop_assert!(scores.onset_offset_f1 <= scores.onset_f1);
        prop_assert_eq!((scores.matched + scores.missed, scores.matched + scores.wrong), (due.len(), played.len()));
        prop_assert!(scores.onset_error_median_secs.is_none_or(|error| error.abs() < 0.0501));
        let swapped = note_scores(&played, &due);
        prop_assert_eq!((scores.onset_precision, scores.onset_recall), (swapped.onset_recall, swapped.onset_precision));

        // Late by a little, everything still matches, and the bias says by how much.
        let song = Song::new("", due, 0.0).unwrap().with_initial_silence(1.0).unwrap();
        let shift = f64::from(shift_ms) / 1000.0;
        let late: Vec<Note> = song.notes().iter()
            .map(|note| Note { start_secs: note.start_secs + shift, end_secs: note.end_secs + shift, ..*note })
            .collect();
        let scores = note_scores(song.notes(), &late);
        prop_assert_eq!(scores.matched, song.notes().len());
    }

    #[test]
    fn any_bytes_end_in_a_song_or_an_error(bytes in vec(any::<u8>(), 0..400)) {
        use_file(&bytes);
        let mut file = b"MThd\0\0\0\x06\0\x01\0\x01\0\x60MTrk".to_vec();
        file.extend((bytes.len() as u32).to_be_bytes());
        file.extend(&bytes);
        use_file(&file);
    }

    #[test]
    fn a_damaged_file_ends_in_a_song_or_an_error(
        which in any::<prop::sample::Index>(),
        damage in vec((any::<prop::sample::Index>(), any::<u8>(), 0..4u8), 1..12),
    ) {
        let files = golden_files();
        let mut bytes = files[which.index(files.len())].clone();
        for (place, value, kind) in damage {
            let at = place.index(bytes.len());
            match kind {
                0 => bytes[at] = value,
                1 => bytes[at] ^= 1 << (value % 8),
                2 => bytes.insert(at, value),
                _ => drop(bytes.remove(at)),
            }
            if bytes.is_empty() { break }
        }
        use_file(&bytes);
    }

    #[test]
    fn any_header_ends_in_a_song_or_an_error(format in any::<u16>(), tracks in 0..4u16, division in any::<u16>()) {
        for file in golden_files() {
            let mut bytes = file.clone();
            bytes[8..10].copy_from_slice(&format.to_be_bytes());
            bytes[10..12].copy_from_slice(&tracks.to_be_bytes());
            bytes[12..14].copy_from_slice(&division.to_be_bytes());
            use_file(&bytes);
            bytes[8..10].copy_from_slice(&1u16.to_be_bytes());
            use_file(&bytes);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn sound_never_clips(notes in vec(note(0..=127), 0..8)) {
        let samples = sound::render(&notes, None).unwrap();
        prop_assert!(samples.iter().all(|sample| sample.abs() <= 1.0));
    }
}
