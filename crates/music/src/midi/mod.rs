//! Standard MIDI Files in and out.
//!
//! `midly` decodes and encodes events. In addition, chunks are checked first ([`chunks`]), ticks are converted to seconds ([`tempo`]), sizes
//! are limited, and damaged events, at which `midly` ends a track silently, are errors.

mod chunks;
mod read;
mod tempo;
mod write;

pub(crate) use read::read;
pub(crate) use write::write;
