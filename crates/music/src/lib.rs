//! Songs: everything Étude knows about music, and nothing about robots.
//!
//! A [`Song`] is a list of notes in seconds with a beat grid beside it. It comes from a MIDI file
//! ([`Song::load`]), from the built-in [`repertoire`], or from what a hand played ([`notes_from_frames`],
//! [`notes_from_key_events`]). Learning sees a song as *frames*: one [`KeySet`] a control step, made by
//! RoboPianist's rules so that scores compare ([`Song::frames`]). [`metrics`] says how well a performance
//! matches its song, [`sound`] makes it audible.
//!
//! The keyboard is the paper's: four octaves and a C. A *key* is an index from the left, a *pitch* is a MIDI
//! number; the two differ by [`LOWEST_PITCH`].
//!
//! ```
//! use etude_music::{CONTROL_HZ, metrics, notes_from_frames, resolve};
//!
//! let song = resolve("twinkle")?;
//! let due = song.episode_frames(CONTROL_HZ, 1.0)?;
//! let mut pressed = due.clone();
//! pressed[39].remove(24); // the second middle C let go one control step early
//! let scores = metrics::frame_scores(&due, &pressed);
//! assert!(scores.f1 > 0.99 && scores.pooled_recall < 1.0);
//! assert_eq!(notes_from_frames(&pressed, CONTROL_HZ, 80).len(), song.notes().len());
//! # Ok::<(), etude_music::SongError>(())
//! ```

mod error;
mod frames;
mod keys;
mod limits;
mod meter;
pub mod metrics;
mod midi;
pub mod notation;
mod note;
mod range;
mod reach;
pub mod repertoire;
mod resolve;
mod song;
pub mod sound;

pub use error::{MidiError, SongError};
pub use frames::{KeyEvent, notes_from_frames, notes_from_key_events};
pub use keys::{HIGHEST_PITCH, KEYS, KeySet, LOWEST_PITCH, key_is_black, pitch_name};
pub use limits::{MAX_DURATION_SECS, MAX_NOTES};
pub use meter::{BeatGrid, Position};
pub use note::Note;
pub use range::{OffendingNote, OutOfRange};
pub use reach::{
    FINGER_PLAY_MM, FINGER_SPACING_MM, PLAYING_FINGERS, WHITE_KEY_PITCH_MM, Warning, WarningKind,
    key_centre_mm,
};
pub use resolve::resolve;
pub use song::Song;

/// Control steps per second: how often the policy acts and the sheet is sampled (RoboPianist, fact sheet §1.3;
/// the paper's episode lengths agree, §2.8).
pub const CONTROL_HZ: f64 = 20.0;
