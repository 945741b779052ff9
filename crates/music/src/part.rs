//! The parts of a collection: what is learned, and what is held out.

use std::fmt;

use crate::melody::melody;
use crate::song::Song;

/// Of as many songs, one is for validation and one for test.
const HELD_OUT_ONE_IN: u32 = 20;

/// What a song of a collection is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// It is learned.
    Training,
    /// It decides which policy of a training is the best.
    Validation,
    /// It is played when all is decided.
    Test,
}

impl Part {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Training, Self::Validation, Self::Test];
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Training => "training",
            Self::Validation => "validation",
            Self::Test => "test",
        })
    }
}

impl Song {
    /// The part that the song belongs to, by a checksum of its intervals: transposed, faster or slower, it is in the same part.
    pub fn part(&self) -> Part {
        let pitches = || self.notes().iter().map(|note| i16::from(note.pitch));
        let intervals = pitches().zip(pitches().skip(1)).map(|(from, to)| to - from);
        let bytes: Vec<u8> = intervals.flat_map(i16::to_le_bytes).collect();
        match crc32c::crc32c(&bytes) % HELD_OUT_ONE_IN {
            0 => Part::Validation,
            1 => Part::Test,
            _ => Part::Training,
        }
    }
}

/// The melodies of a part, in the order of their seeds from `first` on.
pub fn melodies(part: Part, first: u64) -> impl Iterator<Item = Song> {
    (first..).map(melody).filter(move |song| song.part() == part)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn a_song_stays_in_its_part_in_every_key_and_tempo() {
        let mut counts = [0; 3];
        for seed in 0..400 {
            let song = melody(seed);
            let part = song.part();
            counts[part as usize] += 1;
            assert_eq!(song.transpose(-5).unwrap().stretch(1.3).unwrap().part(), part);
        }
        assert!(counts[0] > 330 && counts[1] > 5 && counts[2] > 5, "{counts:?}");
    }

    /// Whatever seed or key it has: two seeds could draw the same melody.
    #[test]
    fn no_tune_is_in_two_parts() {
        let intervals = |song: Song| -> Vec<i16> {
            let pitches: Vec<i16> = song.notes().iter().map(|note| note.pitch.into()).collect();
            pitches.windows(2).map(|pair| pair[1] - pair[0]).collect()
        };
        let tunes = |part| melodies(part, 0).take(60).map(intervals).collect::<BTreeSet<_>>();
        let [training, validation, test] = Part::ALL.map(tunes);
        assert!(
            training.is_disjoint(&validation) && training.is_disjoint(&test) && validation.is_disjoint(&test)
        );
        assert!([&training, &validation, &test].iter().all(|part| part.len() > 55));
    }
}
