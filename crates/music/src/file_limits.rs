//! Limits on songs and MIDI files: what is beyond them is a damaged file or a typing error.

/// Longest song in seconds: an hour. Frames of the whole song are kept in memory while it is
/// learned.
pub const MAX_DURATION_SECS: f64 = 3600.0;
/// Largest number of notes of a song: an hour of very fast playing.
pub const MAX_NOTES: usize = 100_000;
/// Highest control rate, Hz: frames of the longest song at this rate fit in memory.
pub(crate) const MAX_CONTROL_HZ: f64 = 1000.0;
/// Largest MIDI file, in bytes: dense piano recordings of an hour are far smaller.
pub(crate) const MAX_FILE_BYTES: u64 = 10 * 1024 * 1024;
/// Largest number of tempo and time signature changes of a MIDI file.
pub(crate) const MAX_TEMPO_CHANGES: usize = 100_000;
