//! Training, validation and test songs of a collection.

use std::fmt;

use crate::melody::melody;
use crate::song::Song;

/// Of as many songs, one is for validation and one for test.
const HELD_OUT_ONE_IN: u32 = 20;

/// What a song of a collection is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// It is learned.
    Training,
    /// It decides which policy of a training is the best.
    Validation,
    /// It is played when all is decided.
    Test,
}

impl Split {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Training, Self::Validation, Self::Test];
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Training => "training",
            Self::Validation => "validation",
            Self::Test => "test",
        })
    }
}

impl Song {
    /// The split that the song belongs to, by a checksum of its intervals: the same in every key
    /// and tempo.
    pub fn split(&self) -> Split {
        let pitches = || self.notes().iter().map(|note| i16::from(note.pitch));
        let intervals = pitches().zip(pitches().skip(1)).map(|(from, to)| to - from);
        let bytes: Vec<u8> = intervals.flat_map(i16::to_le_bytes).collect();
        match crc32c::crc32c(&bytes) % HELD_OUT_ONE_IN {
            0 => Split::Validation,
            1 => Split::Test,
            _ => Split::Training,
        }
    }
}

/// The melodies of a split, in the order of their seeds from `first` on.
pub fn melodies(split: Split, first: u64) -> impl Iterator<Item = Song> {
    (first..).map(melody).filter(move |song| song.split() == split)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn a_song_stays_in_its_split_in_every_key_and_tempo() {
        let mut counts = [0; 3];
        for seed in 0..400 {
            let song = melody(seed);
            let split = song.split();
            counts[split as usize] += 1;
            assert_eq!(song.transpose(-5).unwrap().stretch(1.3).unwrap().split(), split);
        }
        assert!(counts[0] > 330 && counts[1] > 5 && counts[2] > 5, "{counts:?}");
    }

    /// Whatever seed or key it has: two seeds could draw the same melody.
    #[test]
    fn no_tune_is_in_two_splits() {
        let intervals = |song: Song| -> Vec<i16> {
            let pitches: Vec<i16> = song.notes().iter().map(|note| note.pitch.into()).collect();
            pitches.windows(2).map(|pair| pair[1] - pair[0]).collect()
        };
        let tunes = |split| melodies(split, 0).take(60).map(intervals).collect::<BTreeSet<_>>();
        let [training, validation, test] = Split::ALL.map(tunes);
        assert!(
            training.is_disjoint(&validation) && training.is_disjoint(&test) && validation.is_disjoint(&test)
        );
        assert!([&training, &validation, &test].iter().all(|split| split.len() > 55));
    }
}
