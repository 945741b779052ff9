//! Performances: recordings of what a rig did, and the files that people take away from a song that was played.
//!
//! A [`Recording`] is an MCAP file with JSON messages, so Foxglove, the Python `mcap` package and Étude itself read it.

mod files;
mod recording;

pub use files::{FileError, write_frames_csv, write_text};
pub use recording::{Header, KeyMessage, Recording, RecordingError, RecordingWriter, StepMessage};
