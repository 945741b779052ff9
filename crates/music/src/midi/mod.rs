//! Standard MIDI Files in and out.
//!
//! Chunks ([`chunks`]) and events ([`events`]) are read here, because `midly` refuses what other
//! players read, and ends a damaged track silently. It writes files. Ticks are converted to seconds
//! ([`tempo`]), and sizes are limited.

mod chunks;
mod events;
mod read;
mod remark;
mod tempo;
mod write;

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use atomic_write_file::AtomicWriteFile;

use crate::error::{MidiError, SongError};
use crate::file_limits::MAX_FILE_BYTES;
use crate::song::Song;

pub use remark::Remark;

/// What a MIDI file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct MidiFile {
    /// Its notes.
    pub song: Song,
    /// What of it is not played as it is written.
    pub remarks: Vec<Remark>,
}

impl MidiFile {
    /// Reads a Standard MIDI File of format 0 or 1, also in a RIFF container or behind the head of
    /// MacBinary.
    ///
    /// All tracks and channels are played together except channel 10, which is percussion by
    /// General MIDI and is ignored. A second note-on of a sounding pitch ends its note and begins
    /// another; a note without end lasts until the end of the file. The pedal is ignored. The song
    /// ends with its last note, as in RoboPianist (`total_time`), without any rest after it.
    ///
    /// # Errors
    /// If the bytes are not such a file, are damaged, hold no notes, or exceed the limits on size,
    /// notes and duration.
    pub fn read(bytes: &[u8], title: impl Into<String>) -> Result<MidiFile, MidiError> {
        read::read(bytes, title.into())
    }

    /// Reads a MIDI file from disk, titled by its file name; see [`MidiFile::read`].
    ///
    /// # Errors
    /// If the file cannot be read or used; the path is named.
    pub fn load(path: impl AsRef<Path>) -> Result<MidiFile, SongError> {
        let path = path.as_ref();
        let unreadable = |source| SongError::Read { path: path.into(), source };
        let unusable = |source| SongError::Midi { path: path.into(), source };
        let file = File::open(path).map_err(unreadable)?;
        let mut bytes = Vec::new();
        // One byte more than allowed shows that a file is too large, without relying on the
        // reported size.
        file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        let title = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        MidiFile::read(&bytes, title).map_err(unusable)
    }
}

impl Song {
    /// The song of a MIDI file as it is written; see [`MidiFile::read`].
    ///
    /// # Errors
    /// As [`MidiFile::read`].
    pub fn from_midi(bytes: &[u8], title: impl Into<String>) -> Result<Song, MidiError> {
        Ok(MidiFile::read(bytes, title)?.song)
    }

    /// The song of a MIDI file on disk; see [`MidiFile::load`].
    ///
    /// # Errors
    /// As [`MidiFile::load`].
    pub fn load(path: impl AsRef<Path>) -> Result<Song, SongError> {
        Ok(MidiFile::load(path)?.song)
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
