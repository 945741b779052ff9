//! How well was it played?
//!
//! [`frame_scores`] is the measure of the paper, taken a control step at a time; it is generous to
//! silence and blind to small delays. [`note_scores`] is the measure of music transcription: notes
//! matched one to one, with what a listener would notice about them. Reports give both.

mod frame;
mod matching;
mod note;

pub use frame::{FrameScores, FrameTally, frame_scores};
pub use note::{NoteScores, matched_notes, note_scores};

/// A share of something, or `otherwise` where there is nothing to share.
fn share(part: usize, whole: usize, otherwise: f64) -> f64 {
    if whole == 0 { otherwise } else { part as f64 / whole as f64 }
}
