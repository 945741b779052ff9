//! What every drawn melody keeps to, and what a thousand of them have.

#![allow(clippy::unwrap_used, reason = "an unwrap that fails fails the test")]

use std::collections::BTreeSet;

use etude_music::{HIGHEST_PITCH, LOWEST_PITCH, Note, Song, key_is_black, melody};
use proptest::prelude::*;

/// Least time from one onset to the next, s.
const LEAST_SECS: f64 = 0.2;

fn chords(song: &Song) -> Vec<&[Note]> {
    song.notes().chunk_by(|one, next| next.start_secs - one.start_secs < 0.005).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn every_melody_can_be_put_on_the_keyboard(seed in any::<u64>()) {
        let song = melody(seed);
        prop_assert_eq!(&song, &melody(seed));
        prop_assert!(song.check_range().is_ok());
        prop_assert!((8.0..25.0).contains(&song.duration_secs()), "{} s", song.duration_secs());
        prop_assert!((2..=300).contains(&song.notes().len()), "{} notes", song.notes().len());
        for note in song.notes() {
            prop_assert!((LOWEST_PITCH..=HIGHEST_PITCH).contains(&note.pitch));
            prop_assert!((20..=120).contains(&note.velocity));
            prop_assert!(note.duration_secs() >= 0.08, "{note:?}");
            prop_assert!(note.end_secs <= song.duration_secs() + 1e-9);
        }
        // No key is struck while it sounds.
        for (index, note) in song.notes().iter().enumerate() {
            for later in song.notes()[index + 1..].iter().filter(|later| later.pitch == note.pitch) {
                prop_assert!(later.start_secs >= note.end_secs - 1e-9, "{note:?} {later:?}");
            }
        }
        for pair in chords(&song).windows(2) {
            let wait = pair[1][0].start_secs - pair[0][0].start_secs;
            prop_assert!(wait >= LEAST_SECS - 1e-9, "{wait} s");
        }
        prop_assert!(chords(&song).iter().all(|chord| chord.len() <= 3));
        // As a file it is the same song.
        let read = Song::from_midi(&song.to_midi(), "again").unwrap();
        prop_assert_eq!(read.notes().len(), song.notes().len());
        prop_assert_eq!(read.split(), song.split());
    }
}

/// A change of a melody changes what was trained and what was held out: it must be deliberate.
#[test]
fn melodies_never_change() {
    let checksum = |seeds: std::ops::Range<u64>| {
        let bytes: Vec<u8> = seeds.flat_map(|seed| melody(seed).to_midi()).collect();
        crc32c::crc32c(&bytes)
    };
    assert_eq!(checksum(0..200), 2_694_918_469);
}

#[test]
fn a_thousand_melodies_are_as_varied_as_they_are_said_to_be() {
    let songs: Vec<Song> = (0..1000).map(melody).collect();
    let notes: Vec<&Note> = songs.iter().flat_map(Song::notes).collect();
    let share = |count: usize, of: usize| count as f64 / of as f64;
    let pitches: BTreeSet<u8> = notes.iter().map(|note| note.pitch).collect();
    assert_eq!(pitches.len(), 49, "every key");
    let black = notes.iter().filter(|note| key_is_black(usize::from(note.pitch - LOWEST_PITCH))).count();
    assert!((0.3..0.55).contains(&share(black, notes.len())), "{}", share(black, notes.len()));
    let onsets: Vec<usize> = songs
        .iter()
        .flat_map(|song| chords(song).iter().map(|chord| chord.len()).collect::<Vec<_>>())
        .collect();
    for (size, expected) in [(1, 0.55..0.8), (2, 0.12..0.3), (3, 0.07..0.2)] {
        let found = share(onsets.iter().filter(|notes| **notes == size).count(), onsets.len());
        assert!(expected.contains(&found), "{size} notes at once: {found}");
    }
    let legato = |song: &Song| {
        let pairs = chords(song);
        let joined = pairs
            .windows(2)
            .filter(|pair| pair[0].iter().any(|note| note.end_secs >= pair[1][0].start_secs - 1e-9));
        share(joined.count(), pairs.len()) > 0.6
    };
    let without_silence = share(songs.iter().filter(|song| legato(song)).count(), songs.len());
    assert!((0.25..0.45).contains(&without_silence), "{without_silence} are without silence");
    let steps: Vec<(f64, u8)> = songs
        .iter()
        .flat_map(|song| {
            let chords = chords(song);
            let pairs = chords.windows(2).map(|pair| {
                let [from, to] = [pair[0], pair[1]].map(|chord| chord[chord.len() - 1]);
                (to.start_secs - from.start_secs, to.pitch.abs_diff(from.pitch))
            });
            pairs.collect::<Vec<_>>()
        })
        .collect();
    let of_steps = |what: &dyn Fn(&(f64, u8)) -> bool| {
        share(steps.iter().filter(|step| what(step)).count(), steps.len())
    };
    assert!((0.1..0.3).contains(&of_steps(&|(_, semitones)| *semitones == 0)), "repeats");
    assert!((0.05..0.3).contains(&of_steps(&|(_, semitones)| *semitones > 4)), "leaps");
    assert!((0.1..0.5).contains(&of_steps(&|(secs, _)| *secs < 0.35)), "quick notes");
    assert!((0.05..0.5).contains(&of_steps(&|(secs, _)| *secs > 0.8)), "slow notes");
    // Beats of a bar: the last beat of any bar. Tempi: the time of a beat.
    let last_beat = |song: &Song| {
        let times = (0..800).map(|hundredth| f64::from(hundredth) / 100.0);
        times.map(|secs| song.position(secs).beat as u32).max().unwrap()
    };
    let metres: Vec<u32> = songs.iter().map(last_beat).collect();
    for beats in [2, 3, 4, 6] {
        let found = share(metres.iter().filter(|metre| **metre == beats).count(), metres.len());
        assert!((0.05..0.6).contains(&found), "bars of {beats} beats: {found}");
    }
    let tempi: BTreeSet<u32> = songs.iter().map(|song| (60.0 / song.beats().beat_secs(0.0)) as u32).collect();
    assert!(tempi.len() > 80, "{tempi:?}");
    // A held note sounds while others begin.
    let holds = |song: &&Song| {
        song.notes().iter().any(|held| {
            let during = held.start_secs + 0.01..held.end_secs - 0.01;
            song.notes().iter().filter(|note| during.contains(&note.start_secs)).count() > 1
        })
    };
    let held = share(songs.iter().filter(holds).count(), songs.len());
    assert!((0.05..0.3).contains(&held), "{held} have held notes");
}
