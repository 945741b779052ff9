//! The key at which a finger should be.

use etude_stage::FINGERS;

/// Control steps before the beginning of a note from which its key is the goal of its finger: half
/// a second, enough for every move of the fingers and most of the rail.
pub const AHEAD_STEPS: usize = 10;

/// The key at which a finger should be in one control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Goal {
    /// The key (0 is the lowest C).
    pub key: usize,
    /// Position `[x, y]` for the centre of the fingertip, m.
    pub over: [f64; 2],
    /// Control steps until the note begins; 0 while it sounds.
    pub wait_steps: usize,
    /// Control steps since the note began; 0 before.
    pub age_steps: usize,
    /// MIDI velocity of the note.
    pub velocity: u8,
}

impl Goal {
    /// Whether its note sounds in this step.
    pub fn sounds(&self) -> bool {
        self.wait_steps == 0
    }

    /// Whether its note begins in this step.
    pub fn begins(&self) -> bool {
        self.sounds() && self.age_steps == 0
    }
}

/// The goal of each finger in one control step, if it has one.
pub type Goals = [Option<Goal>; FINGERS];
