//! Any bytes, taken for a MIDI file: whatever a user can do with one must end in a song or an error.
//!
//! Beyond not panicking, it checks what the rest of Étude relies on: sorted notes that never overlap on a key,
//! frames of the right number, and a song that survives being written and read again.
#![no_main]

use etude_music::{CONTROL_HZ, MAX_DURATION_SECS, MidiFile, Song, SongError};
use libfuzzer_sys::fuzz_target;

/// A tick of the slowest tempo that a file can have.
const NEAR_SECS: f64 = 0.002;

fuzz_target!(|bytes: &[u8]| {
    let MidiFile { song, remarks } = match MidiFile::read(bytes, "fuzz") {
        Ok(file) => file,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return;
        }
    };
    assert!(remarks.iter().all(|remark| !remark.to_string().is_empty()));
    assert!(!song.notes().is_empty());
    assert!((0.0..=MAX_DURATION_SECS).contains(&song.duration_secs()));
    assert!(song.notes().is_sorted_by(|a, b| (a.start_secs, a.pitch) < (b.start_secs, b.pitch)));

    match song.frames(CONTROL_HZ) {
        Ok(frames) => assert_eq!(frames.len(), (song.duration_secs() * CONTROL_HZ + 1e-6) as usize + 1),
        Err(SongError::OutOfRange(out)) => {
            assert!(out.to_string().contains("keyboard"));
            for semitones in out.transpositions {
                song.transpose(semitones).unwrap().check_range().unwrap();
            }
        }
        Err(error) => panic!("{error}"),
    }
    song.within_range().check_range().unwrap();
    let trimmed = song.without_initial_silence();
    assert!(trimmed.notes().len() == song.notes().len() && trimmed.notes()[0].start_secs.abs() < 1e-9);
    let again = Song::from_midi(&song.to_midi(), "again").unwrap();
    assert!(again.notes().len() <= song.notes().len());
    let drift = (again.duration_secs() - song.duration_secs()).abs();
    assert!(drift < NEAR_SECS, "{drift}");
    for note in again.notes() {
        let near = |old: &&etude_music::Note| {
            old.pitch == note.pitch && (old.start_secs - note.start_secs).abs() < NEAR_SECS
        };
        // Sorted by start, so that only a window needs looking at.
        let from = song.notes().partition_point(|old| old.start_secs < note.start_secs - 2.0 * NEAR_SECS);
        let window =
            song.notes()[from..].iter().take_while(|old| old.start_secs < note.start_secs + 2.0 * NEAR_SECS);
        assert!(window.filter(near).next().is_some(), "{note:?} was not in the file");
    }
});
