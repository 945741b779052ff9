//! The keys and the rail as seen from the hand.
//!
//! The keyboard is a row of *slots*, half a white key wide: white keys are in the even ones, black
//! keys in the odd ones between them, and there is none between B and C or E and F. The window is
//! the slots around the planned position of the rail. So a passage looks the same in every octave,
//! and what is learned in one is known in all.

use etude_stage::geometry::{WHITE_PITCH, key_lateral};

/// Slots to either side of the rail's planned position: five white keys, more than the outer
/// fingers reach.
const SIDE_SLOTS: i32 = 10;
/// Slots of the window.
pub const SLOTS: usize = 2 * SIDE_SLOTS as usize + 1;
/// Width of a slot, m.
const SLOT_M: f64 = WHITE_PITCH / 2.0;

/// The slot of `key`.
pub fn slot_of_key(key: usize) -> i32 {
    slot(key_lateral(key))
}

/// The window in one control step.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    middle: i32,
}

fn slot(lateral: f64) -> i32 {
    (lateral / SLOT_M).round() as i32
}

impl Window {
    /// The window around this position of the rail, m.
    pub fn around(rail: f64) -> Self {
        Self { middle: slot(rail) }
    }

    /// Its middle slot; 0 is that in the middle of the keyboard.
    pub fn middle(self) -> i32 {
        self.middle
    }

    /// Writes which of `keys` are in the window, lowest slot first.
    pub(crate) fn show(self, keys: impl IntoIterator<Item = usize>, columns: &mut [f32]) {
        for key in keys {
            let column = slot_of_key(key) - self.middle + SIDE_SLOTS;
            if let Some(column) = usize::try_from(column).ok().and_then(|column| columns.get_mut(column)) {
                *column = 1.0;
            }
        }
    }

    /// How far `rail` is from the middle of the window, white keys.
    pub(crate) fn off_middle(self, rail: f64) -> f64 {
        rail / WHITE_PITCH - f64::from(self.middle) / 2.0
    }
}
