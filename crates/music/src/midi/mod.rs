//! Standard MIDI Files in and out.
//!
//! `midly` decodes and encodes events. In addition, chunks are checked first ([`chunks`]), ticks
//! are converted to seconds ([`tempo`]), sizes are limited, and damaged events, at which `midly`
//! ends a track silently, are errors.

mod chunks;
mod read;
mod tempo;
mod write;

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use atomic_write_file::AtomicWriteFile;

use crate::error::{MidiError, SongError};
use crate::file_limits::MAX_FILE_BYTES;
use crate::song::Song;

impl Song {
    /// Reads a Standard MIDI File of format 0 or 1.
    ///
    /// All tracks and channels are played together except channel 10, which is percussion by
    /// General MIDI and is ignored. A second note-on of a sounding pitch ends its note and begins
    /// another; a note without end lasts until the end of the file. The pedal is ignored. The song
    /// ends with its last note, as in RoboPianist (`total_time`), without any rest after it.
    ///
    /// # Errors
    /// If the bytes are not such a file, are damaged, hold no notes, or exceed the limits on size,
    /// notes and duration.
    pub fn from_midi(bytes: &[u8], title: impl Into<String>) -> Result<Song, MidiError> {
        read::read(bytes, title.into())
    }

    /// Reads a MIDI file from disk, titled by its file name; see [`Song::from_midi`].
    ///
    /// # Errors
    /// If the file cannot be read or used; the path is named.
    pub fn load(path: impl AsRef<Path>) -> Result<Song, SongError> {
        let path = path.as_ref();
        let unreadable = |source| SongError::Read { path: path.into(), source };
        let unusable = |source| SongError::Midi { path: path.into(), source };
        let file = File::open(path).map_err(unreadable)?;
        let mut bytes = Vec::new();
        // One byte more than allowed shows that a file is too large, without relying on the
        // reported size.
        file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        let title = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Song::from_midi(&bytes, title).map_err(unusable)
    }

    /// The song as a Standard MIDI File (format 0) with its tempo, time signatures and title. Times
    /// are rounded to a tick, a twentieth of a millisecond at usual tempos and less than two
    /// milliseconds at any; reading the file back gives the same notes to that precision. Rest
    /// after the last note is not read back.
    pub fn to_midi(&self) -> Vec<u8> {
        write::write(self)
    }

    /// Writes [`Song::to_midi`] to a file, which is replaced only when the new contents are
    /// complete.
    ///
    /// # Errors
    /// If the file cannot be written; the path is named.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), SongError> {
        let path = path.as_ref();
        let write = || {
            let mut file = AtomicWriteFile::open(path)?;
            file.write_all(&self.to_midi())?;
            file.commit()
        };
        write().map_err(|source| SongError::Write { path: path.into(), source })
    }
}
