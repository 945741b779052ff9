//! The built-in songs: those of the paper and of its first version.
//!
//! To add a song: one entry in [`SONGS`]. Melodies are in the middle range, one voice for one hand.
//! Tempos are chosen so that episodes are as long as the paper's, which follow from its unrounded
//! F1 values. Songs have no silence in front; an episode adds it ([`Song::episode_frames`]).

use crate::notation;
use crate::song::Song;

/// An entry of the repertoire.
#[derive(Copy, Clone, Debug, PartialEq)]
pub struct BuiltInSong {
    /// What to type.
    pub id: &'static str,
    /// What to print.
    pub title: &'static str,
    /// Length of a beat in seconds.
    pub beat_secs: f64,
    /// Beats in a bar.
    pub beats_per_bar: u8,
    /// The notes, in the [`notation`] of this crate.
    pub music: &'static str,
}

impl BuiltInSong {
    /// The song.
    pub fn song(&self) -> Song {
        notation::read(self.title, self.music, self.beat_secs, self.beats_per_bar)
            .expect("every piece of the repertoire is read by a test")
    }
}

/// Every piece, those of the paper first.
pub const SONGS: &[BuiltInSong] = &[
    BuiltInSong {
        id: "are-you-sleeping",
        title: "Are You Sleeping",
        beat_secs: 1.0,
        beats_per_bar: 4,
        music: "C4 D4 E4 C4 | C4 D4 E4 C4 | E4 F4 G4:2 | E4 F4 G4:2 |
                G4:.5 A4:.5 G4:.5 F4:.5 E4 C4 | G4:.5 A4:.5 G4:.5 F4:.5 E4 C4 | C4 G3 C4:2 | C4 G3 C4:2",
    },
    BuiltInSong {
        id: "happy-birthday",
        title: "Happy Birthday",
        beat_secs: 1.0,
        beats_per_bar: 3,
        music: "C4:.5 C4:.5 | D4 C4 F4 | E4:2 C4:.5 C4:.5 | D4 C4 G4 | F4:2 C4:.5 C4:.5 |
                C5 A4 F4 | E4 D4 Bb4:.5 Bb4:.5 | A4 F4 G4 | F4:2",
    },
    BuiltInSong {
        id: "ode-to-joy",
        title: "Ode To Joy",
        beat_secs: 1.0,
        beats_per_bar: 4,
        music: "E4 E4 F4 G4 | G4 F4 E4 D4 | C4 C4 D4 E4 | E4:1.5 D4:.5 D4:2 |
                E4 E4 F4 G4 | G4 F4 E4 D4 | C4 C4 D4 E4 | D4:1.5 C4:.5 C4:2",
    },
    // RoboPianist's one-hand version: the first two phrases.
    BuiltInSong {
        id: "twinkle",
        title: "Twinkle Twinkle Little Star",
        beat_secs: 0.5,
        beats_per_bar: 4,
        music: "C4 C4 G4 G4 | A4 A4 G4:2 | F4 F4 E4 E4 | D4 D4 C4:2",
    },
    // Scales and chords as in github.com/lasr-lab/learning-to-play-piano.
    BuiltInSong {
        id: "c-major-scale",
        title: "C-Major Scale",
        beat_secs: 0.7,
        beats_per_bar: 4,
        music: "C4 D4 E4 F4 | G4 A4 B4 C5 | B4 A4 G4 F4 | E4 D4 C4",
    },
    BuiltInSong {
        id: "d-major-scale",
        title: "D-Major Scale",
        beat_secs: 0.7,
        beats_per_bar: 4,
        music: "D4 E4 F#4 G4 | A4 B4 C#5 D5 | C#5 B4 A4 G4 | F#4 E4 D4",
    },
    BuiltInSong {
        id: "chord-progression",
        title: "Chord Progression",
        beat_secs: 0.5,
        beats_per_bar: 4,
        music: "C4+E4:4 | F4+A4+C5:4 | G4+B4+D5:4 | C4+E4+G4:4",
    },
];

/// The ids of every piece, in the order of the table.
pub fn ids() -> impl Iterator<Item = &'static str> {
    SONGS.iter().map(|piece| piece.id)
}

/// The song with this id.
pub fn get(id: &str) -> Option<Song> {
    SONGS.iter().find(|piece| piece.id == id).map(BuiltInSong::song)
}
