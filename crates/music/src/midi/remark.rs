//! What of a MIDI file is not played as it is written.

use std::fmt;

use crate::keys::pitch_name;

/// Something that a reader of the file may expect in the song, and that is not there.
#[derive(Clone, Debug, PartialEq)]
pub enum Remark {
    /// Strokes after the end of a track.
    AfterEndOfTrack {
        /// The track, counting from 1.
        track: usize,
        /// Their number.
        strokes: usize,
    },
    /// Strokes on channel 10, which is percussion by General MIDI.
    Percussion {
        /// Their number.
        strokes: usize,
    },
    /// Notes without a release, which last until the end of the file.
    NeverReleased {
        /// Their number.
        notes: usize,
        /// Pitch of the first.
        pitch: u8,
        /// Its start, s.
        start_secs: f64,
        /// Its end, s.
        end_secs: f64,
    },
    /// Notes that the message "all notes off" ends.
    AllNotesOff {
        /// Their number.
        notes: usize,
    },
    /// Silence before the first note.
    Silence {
        /// Its length, s.
        secs: f64,
    },
    /// Fewer tracks than the header announces.
    MissingTracks {
        /// Tracks by the header.
        announced: usize,
        /// Tracks in the file.
        found: usize,
    },
    /// A track of another length than it announces.
    WrongLength {
        /// The track, counting from 1.
        track: usize,
        /// Bytes by its head.
        announced: u64,
        /// Bytes up to its end-of-track event.
        found: usize,
    },
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::AfterEndOfTrack { track, strokes } => {
                write!(f, "{} after the end of track {track}: left out", count(*strokes, "note"))
            }
            Self::Percussion { strokes } => write!(
                f,
                "{} on channel 10 (percussion): left out; move a melody there to another channel",
                count(*strokes, "stroke")
            ),
            Self::NeverReleased { notes: 1, pitch, start_secs, end_secs } => write!(
                f,
                "{} at {start_secs:.1} s is never released, and lasts to the end of the file at {end_secs:.1} s",
                pitch_name(*pitch)
            ),
            Self::NeverReleased { notes, pitch, start_secs, end_secs } => write!(
                f,
                "{notes} notes are never released, and last to the end of the file at {end_secs:.1} s; the first is \
                 {} at {start_secs:.1} s",
                pitch_name(*pitch)
            ),
            Self::AllNotesOff { notes } => {
                write!(f, "{} without a release: \"all notes off\" ends them", count(*notes, "note"))
            }
            Self::Silence { secs } => {
                write!(f, "{secs:.1} s of silence before the first note: left out (--keep-silence keeps it)")
            }
            Self::MissingTracks { announced, found } => write!(
                f,
                "the header announces {}, the file has {found}: parts may be missing",
                count(*announced, "track")
            ),
            Self::WrongLength { track, announced, found } => {
                write!(f, "track {track} announces {announced} bytes and has {found}")
            }
        }
    }
}

/// `3 notes`
fn count(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}
