//! Broken, empty, huge and hostile MIDI files: a clear error, soon, and never more memory than the
//! file deserves.

#![allow(clippy::unwrap_used, reason = "an unwrap that fails fails the test")]

use std::time::{Duration, Instant};

use etude_music::{MAX_NOTES, MidiError, Song, SongError};

const END: [u8; 4] = [0, 0xFF, 0x2F, 0];

fn chunk(kind: &[u8; 4], body: &[u8]) -> Vec<u8> {
    [kind, (body.len() as u32).to_be_bytes().as_slice(), body].concat()
}

fn header(format: u16, tracks: u16, division: u16) -> Vec<u8> {
    chunk(b"MThd", &[format, tracks, division].map(u16::to_be_bytes).concat())
}

/// A format 0 file of these events and an end.
fn file(events: &[u8]) -> Vec<u8> {
    [header(0, 1, 96), chunk(b"MTrk", &[events, &END].concat())].concat()
}

fn note(pitch: u8) -> Vec<u8> {
    vec![0, 0x90, pitch, 64, 0x60, pitch, 0]
}

fn error(bytes: &[u8]) -> MidiError {
    Song::from_midi(bytes, "bad").unwrap_err()
}

#[test]
fn every_kind_of_damage_has_its_message() {
    let tempo = |micros: [u8; 3]| [&[0, 0xFF, 0x51, 3][..], &micros].concat();
    let with_division =
        |division| [header(0, 1, division), chunk(b"MTrk", &[note(60), END.into()].concat())].concat();
    let swallowed = [&[0, 0xFF, 0x01, 0x7F][..], &note(60)].concat();
    let far = [&[0, 0x90, 60, 64][..], &[0xFF, 0xFF, 0xFF, 0x7F, 60, 0].repeat(20)].concat();
    for (bytes, start) in [
        (vec![], "the file is empty;"),
        (
            b"hello, this is no song".to_vec(),
            "this is not a Standard MIDI File (it does not begin with `MThd`); give",
        ),
        (
            b"RIFF....WAVEfmt ".to_vec(),
            "this is not a Standard MIDI File (it does not begin with `MThd`); it is a RIFF",
        ),
        (
            b"<?xml version".to_vec(),
            "this is not a Standard MIDI File (it does not begin with `MThd`); it looks like MusicXML",
        ),
        (b"MThd".to_vec(), "the file is truncated: the header is incomplete at byte 4;"),
        (chunk(b"MThd", &[0, 0]), "the file is truncated: the header is too short at byte 10;"),
        (header(0, 1, 96), "the header announces 1 tracks but none is there;"),
        (file(&note(60))[..30].to_vec(), "the file is truncated: a track is incomplete at byte 14;"),
        (header(2, 0, 96), "MIDI format 2 is not supported;"),
        (header(9, 0, 96), "MIDI format 9 is not supported;"),
        (with_division(0), "the header's time division (0x0000) is invalid: a beat of no ticks;"),
        (with_division(0xE700), "the header's time division (0xe700) is invalid: a frame of no ticks;"),
        (with_division(0x8001), "the header's time division (0x8001) is invalid: a frame rate other than"),
        (file(&[0, 0x90, 60, 0x80]), "track 1 is damaged at byte 22 of the file ("),
        (file(&[0, 60, 64]), "track 1 is damaged at byte 22 of the file ("),
        (file(&[0, 0xF8]), "the file has no notes to play; check"),
        (file(&swallowed), "track 1 is damaged at byte 22 of the file ("),
        (file(&tempo([0; 3])), "track 1 sets a tempo of zero seconds a beat;"),
        (file(&[]), "the file has no notes to play; check"),
        (
            file(&[0, 0x99, 36, 64, 9, 36, 0]),
            "the file has no notes to play (1 stroke on the percussion channel is ignored);",
        ),
        (file(&far), "the last note ends after "),
        (vec![0; 11 << 20], "the file has 11534336 bytes, more than the 10485760 that are read;"),
    ] {
        let message = error(&bytes).to_string();
        assert!(message.starts_with(start), "expected {start:?}, got {message:?}");
    }
}

#[test]
fn a_file_cut_anywhere_is_an_error() {
    let whole = file(&note(60));
    Song::from_midi(&whole, "").unwrap();
    for length in 0..whole.len() {
        error(&whole[..length]);
    }
}

#[test]
fn extremes_that_are_legal_are_read() {
    // The longest delta before a note, at the fastest tempo.
    let fast = [&[0, 0xFF, 0x51, 3, 0, 0, 1, 0xFF, 0xFF, 0xFF, 0x7F, 0x90, 60, 64, 0x60, 60, 0][..]].concat();
    let song = Song::from_midi(&file(&fast), "").unwrap();
    assert!(song.duration_secs() > 2.0 && song.duration_secs() < 3.0);
    let again = Song::from_midi(&song.to_midi(), "").unwrap();
    assert!((again.notes()[0].start_secs - song.notes()[0].start_secs).abs() < 1e-3);
    // Signatures that no music has are labels, not errors.
    let odd = [0, 0xFF, 0x58, 4, 4, 255, 24, 8, 0, 0xFF, 0x58, 4, 0, 2, 24, 8];
    let song = Song::from_midi(&file(&[&odd[..], &note(60)].concat()), "").unwrap();
    assert_eq!(song.position(2.0).to_string(), "bar 2, beat 1");
    // A rest of days after the last note costs nothing.
    let rest = [note(60), [0xFF, 0xFF, 0xFF, 0x7F, 0xB0, 7, 7].repeat(50)].concat();
    assert_eq!(Song::from_midi(&file(&rest), "").unwrap().duration_secs(), 0.5);
}

/// Files of the largest size, each stuffed with one thing.
#[test]
fn stuffed_files_end_soon() {
    let size = 10 * 1024 * 1024 - 1000;
    let stuffed = |unit: &[u8]| file(&unit.repeat(size / unit.len()));
    let began = Instant::now();
    let empty_tracks = [header(1, 1, 96), chunk(b"MTrk", &[]).repeat(size / 8)].concat();
    for (bytes, said) in [
        (stuffed(&[1, 0x90, 60, 64, 1, 60, 0]), "the file has more than 100000 notes;"),
        (stuffed(&[1, 0x90, 60, 64]), "the file has more than 100000 notes;"),
        (stuffed(&[1, 0xFF, 0x51, 3, 0, 0, 9]), "the file changes tempo or time signature more than"),
        (stuffed(&[1, 0xFF, 0x58, 4, 4, 2, 24, 8]), "the file changes tempo or time signature more than"),
        (stuffed(&[1, 0xB0, 1, 1]), "the file has no notes to play; check"),
        (empty_tracks, "the file has no notes to play; check"),
    ] {
        let message = error(&bytes).to_string();
        assert!(message.starts_with(said), "{message}");
    }
    assert!(began.elapsed() < Duration::from_secs(20), "{:?}", began.elapsed());
}

#[test]
fn the_most_notes_allowed_are_handled() {
    let many = file(&[1, 0x90, 60, 64].repeat(MAX_NOTES));
    let song = Song::from_midi(&many, "").unwrap();
    assert_eq!(song.notes().len(), MAX_NOTES);
    assert_eq!(song.frames(20.0).unwrap().len(), (song.duration_secs() * 20.0) as usize + 1);
    assert_eq!(Song::from_midi(&song.to_midi(), "").unwrap().notes().len(), MAX_NOTES);
}

#[test]
fn errors_of_files_name_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("song.mid");
    let missing = Song::load(&path).unwrap_err();
    assert!(
        matches!(missing, SongError::Read { .. }) && missing.to_string().contains("song.mid"),
        "{missing}"
    );
    std::fs::write(&path, b"MThd").unwrap();
    let broken = Song::load(&path).unwrap_err();
    assert!(matches!(broken, SongError::Midi { .. }) && broken.to_string().contains("song.mid"), "{broken}");
    let unreadable = Song::load(folder.path()).unwrap_err();
    assert!(matches!(unreadable, SongError::Read { .. }), "{unreadable}");
    let song = Song::from_midi(&file(&note(60)), "").unwrap();
    let nowhere = song.save(folder.path().join("no/such/song.mid")).unwrap_err();
    assert!(
        matches!(nowhere, SongError::Write { .. }) && nowhere.to_string().contains("song.mid"),
        "{nowhere}"
    );
    song.save(&path).unwrap();
    assert_eq!(Song::load(&path).unwrap().notes(), song.notes());
}
