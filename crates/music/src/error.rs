//! Errors of reading, changing and writing songs. Each message says what to do.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::limits::{MAX_CONTROL_HZ, MAX_DURATION_SECS, MAX_FILE_BYTES, MAX_NOTES, MAX_TEMPO_CHANGES};
use crate::range::OutOfRange;

/// Why bytes are not a usable MIDI file.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum MidiError {
    /// No bytes at all.
    #[error("the file is empty; export the song again as a Standard MIDI File")]
    Empty,
    /// The first bytes are not those of a MIDI file.
    #[error("this is not a Standard MIDI File (it does not begin with `MThd`); {hint}")]
    NotMidi {
        /// What the file seems to be, and what to do.
        hint: &'static str,
    },
    /// More bytes than any song needs.
    #[error(
        "the file has {bytes} bytes, more than the {MAX_FILE_BYTES} that are read; a song is far smaller, so check that this is one"
    )]
    TooLarge {
        /// Size of the file.
        bytes: u64,
    },
    /// The file ends too early.
    #[error("the file is cut short: {what} at byte {offset}; copy or export it again")]
    Truncated {
        /// What is missing.
        what: &'static str,
        /// Where, from the start of the file.
        offset: usize,
    },
    /// Fewer tracks than the header announces.
    #[error(
        "the header announces {announced} tracks but only {found} are there; copy or export the file again"
    )]
    MissingTracks {
        /// By the header.
        announced: u16,
        /// In the file.
        found: usize,
    },
    /// The format is neither 0 nor 1.
    #[error(
        "MIDI format {format} is not supported; export the song as format 0 or 1 (one song, played together), format 2 holds loose patterns"
    )]
    Format {
        /// The format number in the header.
        format: u16,
    },
    /// The header's time division is invalid.
    #[error("the header's time division ({division:#06x}) is invalid: {why}; export the song again")]
    Division {
        /// The two bytes as they are.
        division: u16,
        /// What is wrong with it.
        why: &'static str,
    },
    /// An event that cannot be read.
    #[error("track {track} is damaged at byte {offset} of the file; copy or export the file again")]
    BadEvent {
        /// Track number, from one.
        track: usize,
        /// From the start of the file.
        offset: usize,
    },
    /// A tempo of zero microseconds a beat.
    #[error("track {track} sets a tempo of zero seconds a beat; correct the tempo and export the song again")]
    ZeroTempo {
        /// Track number, from one.
        track: usize,
    },
    /// More tempo or time signature changes than the limit.
    #[error(
        "the file changes tempo or time signature more than {MAX_TEMPO_CHANGES} times; export it with a simpler tempo track"
    )]
    TooManyTempoChanges,
    /// More notes than the limit.
    #[error("the file has more than {MAX_NOTES} notes; cut out the part you want to hear")]
    TooManyNotes,
    /// Longer than the limit.
    #[error(
        "the last note ends after {secs:.0} s, more than the limit of {MAX_DURATION_SECS} s; cut out the part you want to hear"
    )]
    TooLong {
        /// End of the last note.
        secs: f64,
    },
    /// No notes for a piano.
    #[error("the file has no notes to play{}", percussion_hint(*.percussion))]
    NoNotes {
        /// Strokes on channel 10, which are drums.
        percussion: usize,
    },
}

fn percussion_hint(strokes: usize) -> String {
    match strokes {
        0 => "; check that you exported the track with the melody".into(),
        1 => " (1 stroke on the percussion channel is ignored); move the melody to another channel than 10"
            .into(),
        n => format!(
            " ({n} strokes on the percussion channel are ignored); move the melody to another channel than 10"
        ),
    }
}

/// Why a song cannot be read, changed, written or played.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SongError {
    /// The file cannot be read.
    #[error("cannot read the song {}: {source}; check the path and its permissions", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("cannot write {}: {source}; check that the folder exists and the disk has room", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file is not a usable MIDI file.
    #[error("cannot use {}: {source}", .path.display())]
    Midi {
        /// The file.
        path: PathBuf,
        /// What is wrong with its bytes.
        source: MidiError,
    },
    /// Neither in the repertoire nor a file.
    #[error("there is no song called \"{name}\"{}; `etude songs` lists the built-in ones, or give the path of a .mid file", did_you_mean(.close))]
    Unknown {
        /// The requested name.
        name: String,
        /// Built-in ids that look like it, best first.
        close: Vec<&'static str>,
    },
    /// Notes that the keyboard does not have.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A note with impossible numbers.
    #[error("note {index} (counting from 0) is not playable: {why}")]
    BadNote {
        /// Its index in the list.
        index: usize,
        /// What is wrong with it.
        why: &'static str,
    },
    /// More notes than the limit.
    #[error("{notes} notes are more than the limit of {MAX_NOTES}; cut out the part you want to hear")]
    TooManyNotes {
        /// How many there are.
        notes: usize,
    },
    /// The song's length is out of range.
    #[error("the song would last {secs} s; it must be at least 0 s and at most {MAX_DURATION_SECS} s")]
    BadDuration {
        /// The length asked for.
        secs: f64,
    },
    /// A tempo factor that is not positive.
    #[error(
        "cannot stretch a song by {factor}; give a positive factor, above 1 for slower and below 1 for faster"
    )]
    BadStretch {
        /// The factor asked for.
        factor: f64,
    },
    /// A transposition beyond the range of MIDI.
    #[error("transposing by {semitones} semitones takes {} (MIDI {pitch}) off the MIDI scale; transpose by less", crate::pitch_name(*.pitch))]
    BadTransposition {
        /// The shift asked for.
        semitones: i32,
        /// A pitch that would be out of range.
        pitch: u8,
    },
    /// A control rate that is out of range.
    #[error(
        "cannot cut a song into {control_hz} frames a second; give a rate above 0 and at most {MAX_CONTROL_HZ}"
    )]
    BadControlRate {
        /// The rate asked for, in hertz.
        control_hz: f64,
    },
    /// Music written as text with a mistake in it.
    #[error("in the written music, token {token} (`{text}`): {why}")]
    Notation {
        /// Token number, from one.
        token: usize,
        /// The token.
        text: String,
        /// What is wrong with it.
        why: &'static str,
    },
}

fn did_you_mean(close: &[&'static str]) -> String {
    if close.is_empty() { String::new() } else { format!(" (did you mean {}?)", close.join(", ")) }
}
