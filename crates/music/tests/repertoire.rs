//! Every built-in piece, and the one that comes as a file.

#![allow(clippy::unwrap_used, reason = "an unwrap that fails fails the test")]

use std::path::Path;

use etude_music::{CONTROL_HZ, HIGHEST_PITCH, KeySet, LOWEST_PITCH, Song, key_is_black, repertoire, resolve};

const SILENCE_SECS: f64 = 1.0;

fn distinct_black_keys(song: &Song) -> usize {
    let keys = KeySet::from_pitches(song.notes().iter().map(|note| note.pitch));
    keys.iter().filter(|&key| key_is_black(key)).count()
}

#[test]
fn every_piece_is_playable_and_found_by_name() {
    for piece in repertoire::SONGS {
        let song = resolve(piece.id).unwrap();
        assert_eq!(song, piece.song());
        assert_eq!(song.title(), piece.title);
        song.check_range().unwrap();
        let last_end = song.notes().iter().map(|note| note.end_secs).fold(0.0, f64::max);
        assert_eq!((song.notes()[0].start_secs, song.duration_secs()), (0.0, last_end), "{}", piece.id);
        let middle = LOWEST_PITCH + 12..=HIGHEST_PITCH - 7;
        assert!(song.notes().iter().all(|note| middle.contains(&note.pitch)), "{}", piece.id);
    }
    let mut ids: Vec<_> = repertoire::ids().collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), repertoire::SONGS.len(), "two pieces share an id");
    assert!(repertoire::get("no-such-piece").is_none());
}

/// The paper's episodes (design §4); they follow from its unrounded scores.
#[test]
fn episodes_are_as_long_as_in_the_paper() {
    for (id, steps) in [
        ("are-you-sleeping", 661),
        ("happy-birthday", 501),
        ("ode-to-joy", 661),
        ("twinkle", 181),
        ("c-major-scale", 231),
    ] {
        let song = repertoire::get(id).unwrap();
        let frames = song.episode_frames(CONTROL_HZ, SILENCE_SECS).unwrap();
        assert_eq!(frames.len(), steps, "{id}");
        assert!(frames[..20].iter().all(|frame| frame.is_empty()));
        assert_eq!(frames[20..], song.frames(CONTROL_HZ).unwrap());
        // Silence as part of the song makes the same episode.
        assert_eq!(song.with_initial_silence(SILENCE_SECS).unwrap().frames(CONTROL_HZ).unwrap(), frames);
    }
}

#[test]
fn pieces_are_as_their_sources_say() {
    let get = |id| repertoire::get(id).unwrap();
    let pitches = |id| get(id).notes().iter().map(|note| note.pitch).collect::<Vec<_>>();
    assert_eq!(distinct_black_keys(&get("happy-birthday")), 1);
    assert_eq!(get("happy-birthday").position(23.0).to_string(), "bar 8, beat 2");
    for id in ["are-you-sleeping", "ode-to-joy", "twinkle", "c-major-scale", "chord-progression"] {
        assert_eq!(distinct_black_keys(&get(id)), 0, "{id}");
    }
    assert_eq!(pitches("twinkle"), [60, 60, 67, 67, 69, 69, 67, 65, 65, 64, 64, 62, 62, 60]);
    // Six of its notes repeat the one before: as many frames with a gap, all others but the last
    // with a note.
    let frames = get("twinkle").frames(CONTROL_HZ).unwrap();
    assert_eq!(frames.iter().filter(|frame| frame.is_empty()).count(), 6 + 1);
    assert_eq!(pitches("c-major-scale"), [60, 62, 64, 65, 67, 69, 71, 72, 71, 69, 67, 65, 64, 62, 60]);
    assert_eq!(pitches("d-major-scale"), [62, 64, 66, 67, 69, 71, 73, 74, 73, 71, 69, 67, 66, 64, 62]);
    let chords: Vec<String> = get("chord-progression")
        .frames(CONTROL_HZ)
        .unwrap()
        .iter()
        .skip(20)
        .step_by(40)
        .map(KeySet::to_string)
        .collect();
    assert_eq!(chords, ["60 64", "65 69 72", "67 71 74", "60 64 67"]);
}

#[test]
fn the_song_in_a_file_is_found_by_its_path() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../songs/au-clair-de-la-lune.mid");
    let song = resolve(path.to_str().unwrap()).unwrap();
    assert_eq!(song.title(), "au-clair-de-la-lune");
    assert_eq!((song.notes().len(), song.duration_secs()), (44, 40.0));
    assert_eq!(song.position(39.375).to_string(), "bar 16, beat 4");
    song.frames(CONTROL_HZ).unwrap();
}

/// Every mark from *pianissimo* on, an accent, and the surprise: a chord of three, the loudest of
/// all.
#[test]
fn the_song_with_dynamics_is_soft_and_loud() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../songs/surprise-symphony.mid");
    let song = resolve(path.to_str().unwrap()).unwrap();
    assert_eq!((song.notes().len(), song.duration_secs()), (55, 32.0));
    let velocities: std::collections::BTreeSet<u8> = song.notes().iter().map(|note| note.velocity).collect();
    assert_eq!(velocities, [33, 49, 64, 80, 96, 112, 127].into());
    let last: Vec<_> = song.notes().iter().rev().take(4).map(|note| (note.pitch, note.velocity)).collect();
    assert_eq!(last, [(74, 127), (71, 127), (67, 127), (67, 33)]);
}

#[test]
fn bars_survive_the_midi_file() {
    for piece in repertoire::SONGS {
        let song = piece.song();
        let pickup = song.position(0.0).bar == 0;
        for silence_secs in [0.0, 1.25] {
            let late = song.with_initial_silence(silence_secs).unwrap();
            let again = Song::from_midi(&late.to_midi(), piece.title).unwrap();
            // Other programs count a pickup, and silence in front, as bars of their own.
            let extra_bars = u32::from(pickup) + u32::from(silence_secs > 0.0);
            for (written, read) in late.notes().iter().zip(again.notes()) {
                let (written, read) = (late.position(written.start_secs), again.position(read.start_secs));
                assert_eq!(written.bar + extra_bars, read.bar, "{}: {written}, {read}", piece.id);
                // Within the pickup itself the beat counts from one.
                let same_beat = (written.beat - read.beat).abs() < 1e-3;
                assert!(same_beat || written.bar == 0, "{}: {written}, {read}", piece.id);
            }
        }
    }
}
