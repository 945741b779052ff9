//! Standard MIDI Files in and out.
//!
//! `midly` decodes and encodes events. Around it stands what a file from anywhere needs: chunks checked before
//! anything is trusted ([`chunks`]), ticks turned into seconds ([`tempo`]), limits on everything that a hostile
//! file could inflate, and errors where `midly` would end a track silently.

mod chunks;
mod read;
mod tempo;
mod write;

pub(crate) use read::read;
pub(crate) use write::write;
