//! Errors of rendering and writing sound.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::file_limits::MAX_DURATION_SECS;

/// Why notes cannot be rendered or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SoundError {
    /// The SoundFont cannot be opened.
    #[error("cannot read the SoundFont {}: {source}; check the path, or leave it out for the built-in tone", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The SoundFont is compressed.
    #[error("{} is a compressed SoundFont (SF3), which is not supported; use an SF2 file, or convert it with a SoundFont editor such as Polyphone", .path.display())]
    Compressed {
        /// The file.
        path: PathBuf,
    },
    /// The file is not a usable SoundFont.
    #[error("{} is not a usable SoundFont: {why}; use an SF2 file, or leave it out for the built-in tone", .path.display())]
    NotASoundFont {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// Notes that cannot be rendered.
    #[error(
        "note {index} (counting from 0) cannot be rendered: its times must be finite, not negative, in order and below {MAX_DURATION_SECS} s"
    )]
    BadNote {
        /// Its index in the list.
        index: usize,
    },
    /// The WAV file cannot be written.
    #[error("cannot write the sound to {}: {source}; {}", .path.display(), write_hint(.source))]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// What to do about a file that cannot be written.
pub fn write_hint(source: &io::Error) -> &'static str {
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => "free some space or choose another disk",
        io::ErrorKind::NotFound => "create the folder first",
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "choose a folder that you may write to"
        }
        _ => "choose another place",
    }
}
