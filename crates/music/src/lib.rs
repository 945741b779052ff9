//! Songs: notes, MIDI files, frames, metrics, sound.
//!
//! A [`Song`] is a list of notes in seconds with a beat grid. It is read from a MIDI file
//! ([`Song::load`]) or taken from the built-in [`repertoire`] or drawn at random ([`melody()`]);
//! notes that a hand played come from [`notes_from_key_events`]. Learning uses a song as *frames*:
//! one [`KeySet`] a control step, by RoboPianist's rules so that scores compare ([`Song::frames`]).
//! [`metrics`] compares a performance with its song, [`sound`] renders it.
//!
//! The keyboard is the paper's: four octaves and a C. A *key* is an index from the left, a *pitch*
//! is a MIDI number; the two differ by [`LOWEST_PITCH`].
//!
//! ```
//! use etude_music::{CONTROL_HZ, metrics, resolve};
//!
//! let song = resolve("twinkle")?;
//! let due = song.episode_frames(CONTROL_HZ, 1.0)?;
//! let mut pressed = due.clone();
//! pressed[39].remove(24); // the second middle C, released one control step early
//! let scores = metrics::frame_scores(&due, &pressed);
//! assert!(scores.f1 > 0.99 && scores.pooled_recall < 1.0);
//! # Ok::<(), etude_music::SongError>(())
//! ```

mod density;
mod error;
mod file_limits;
mod frames;
mod key_schedule;
mod keys;
mod melody;
mod meter;
pub mod metrics;
mod midi;
pub mod notation;
mod note;
mod playability;
mod range;
pub mod repertoire;
mod resolve;
mod song;
pub mod sound;
mod spelling;
mod split;

pub use density::BusiestSecond;
pub use error::{MidiError, SongError};
pub use file_limits::{MAX_DURATION_SECS, MAX_NOTES};
pub use frames::{KeyEvent, ceil_frame, keys_at, notes_from_key_events};
pub use key_schedule::{KeySchedule, KeyScheduleConfig, KeyScheduleRule, MAX_LATENCY_COMPENSATION_SECS};
pub use keys::{HIGHEST_PITCH, KEY_COUNT, KeySet, LOWEST_PITCH, key_is_black, pitch_name};
pub use melody::melody;
pub use meter::{BeatGrid, Position};
pub use midi::{MidiFile, Remark};
pub use note::{Note, chords};
pub use range::{OffendingNote, OutOfRange};
pub use resolve::{is_named_midi, resolve, resolve_file};
pub use song::Song;
pub use spelling::{did_you_mean, similar_names};
pub use split::{Split, melodies};

/// Control steps per second: rate of the policy and of the frames. As in RoboPianist
/// (github.com/google-research/robopianist); it agrees with the lengths of the paper's episodes.
pub const CONTROL_HZ: f64 = 20.0;
