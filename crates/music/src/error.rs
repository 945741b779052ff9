//! Errors of reading, changing and writing songs. Each message says what to do.

use std::io;
use std::path::PathBuf;

use etude_checks::RangeError;
use thiserror::Error;

use crate::range::OutOfRange;

/// Why bytes are not a usable MIDI file.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{0}")]
pub struct MidiError(pub(crate) String);

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
    #[error(
        "there is no song called \"{name}\"{similar}; `etude songs` lists the built-in ones, or give the path of a .mid file"
    )]
    Unknown {
        /// The requested name.
        name: String,
        /// ` (did you mean …?)`, or empty.
        similar: String,
    },
    /// A number outside its range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// Notes that the keyboard does not have.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A note or written music with something wrong in it.
    #[error("{0}")]
    Invalid(String),
}
