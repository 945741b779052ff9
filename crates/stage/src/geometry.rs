//! Geometry of the keyboard, an M-Audio Keystation 49e.
//!
//! World frame: origin at the middle of the keyboard on its base plane, `+x` toward the player,
//! `+y` toward the high notes, `+z` up. Lengths in metres, angles in radians.
//!
//! Sources: box sizes, hinge and white travel from RoboPianist
//! (github.com/google-research/robopianist, `models/piano/piano_constants.py`); pitch of the white
//! keys, black travel and masses from the authors' model of the Keystation 49e
//! (github.com/lasr-lab/learning-to-play-piano, `robopianist/models/piano/piano_constants.py`).

use etude_music::{KEY_COUNT, key_is_black};

/// White keys on the keyboard.
pub const WHITE_KEYS: usize = 29;
/// Distance between the centres of neighbouring white keys, m: the measured width over the number
/// of white keys.
pub const WHITE_PITCH: f64 = 0.674 / WHITE_KEYS as f64;
/// Half the width of the keyboard, m: how far the rail must reach to either side.
pub const HALF_WIDTH: f64 = WHITE_PITCH * WHITE_KEYS as f64 / 2.0;

/// Size and place of one kind of key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyShape {
    /// Length (x), width (y), height (z) of the box, m.
    pub size: [f64; 3],
    /// Centre of the box along `x`, m.
    pub x: f64,
    /// Centre of the box along `z`, m.
    pub z: f64,
    /// Travel of the front edge from rest to the lower stop, m.
    pub travel: f64,
    /// Mass, kg.
    pub mass: f64,
}

/// A white key.
pub const WHITE: KeyShape =
    KeyShape { size: [0.15, 0.0225, 0.0225], x: 0.0, z: 0.01125, travel: 0.010, mass: 0.010 };
/// A black key.
pub const BLACK: KeyShape =
    KeyShape { size: [0.09, 0.010, 0.018], x: -0.03, z: 0.026, travel: 0.007, mass: 0.005 };

impl KeyShape {
    /// The shape of key `key` (0 is the lowest C).
    pub fn of(key: usize) -> &'static KeyShape {
        if key_is_black(key) { &BLACK } else { &WHITE }
    }

    /// Angle of the hinge at the lower stop, rad.
    pub fn max_angle(&self) -> f64 {
        (self.travel / self.size[0]).atan()
    }

    /// Height of the top surface at rest, m.
    pub const fn top(&self) -> f64 {
        self.z + self.size[2] / 2.0
    }

    /// Front edge (toward the player) along `x`, m.
    pub fn front(&self) -> f64 {
        self.x + self.size[0] / 2.0
    }

    /// Point `[x, z]` that a fingertip should aim for, m: toward the player from the middle of the
    /// key, and a quarter of its height above its centre. As in RoboPianist's fingering reward
    /// (`piano_with_shadow_hands.py`).
    pub fn target(&self) -> [f64; 2] {
        [self.x + 0.35 * self.size[0] / 2.0, self.z + 0.5 * self.size[2] / 2.0]
    }
}

/// Centre of key `key` along the keyboard (`y`), m. A black key stands over the gap between its
/// white neighbours.
///
/// # Panics
/// If `key` is not one of the [`KEY_COUNT`] keys.
pub fn key_lateral(key: usize) -> f64 {
    assert!(key < KEY_COUNT, "key {key} is not on a keyboard of {KEY_COUNT} keys");
    let whites_below = (0..key).filter(|k| !key_is_black(*k)).count() as f64;
    let middle = (WHITE_KEYS - 1) as f64 / 2.0;
    let index = if key_is_black(key) { whites_below - 0.5 } else { whites_below };
    (index - middle) * WHITE_PITCH
}

/// Where a fingertip should touch key `key` at rest: `[x, y, z]` in the keyboard's frame, m.
pub fn key_target(key: usize) -> [f64; 3] {
    let [x, z] = KeyShape::of(key).target();
    [x, key_lateral(key), z]
}

/// One fence: a thin fixed wall in the gap between two white keys of the simulation. It is a model
/// of what the bodies of the neighbouring keys do on a real keyboard: they keep a finger on its
/// key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fence {
    /// Place along the keyboard, m.
    pub y: f64,
    /// Extent along `x`, m.
    pub x: [f64; 2],
}

/// Height of the fences' tops relative to the tops of the white keys at rest, m; negative is below.
/// A fingertip that comes down off the middle then reaches its key before it meets a fence, and a
/// pressed key is well below the fences on both sides. Our choice, since the paper shows the fences
/// without a size.
pub const FENCE_RISE: f64 = -0.002;
/// Sliding friction of the fences. They are slippery plastic (paper, appendix), so that a fingertip
/// that comes down on a fence slides onto a key.
pub const FENCE_FRICTION: f64 = 0.1;
/// Thickness of a fence, m: it fills the gap between two white keys.
pub const FENCE_THICKNESS: f64 = WHITE_PITCH - WHITE.size[1];

/// The fences between all neighbouring white keys. Where a black key stands between them the fence
/// ends in front of it.
pub fn fences() -> impl Iterator<Item = Fence> {
    (0..KEY_COUNT - 1).filter(|key| !key_is_black(*key)).map(|key| {
        let y = key_lateral(key) + WHITE_PITCH / 2.0;
        let clearance = 0.002;
        let rear = if key_is_black(key + 1) { BLACK.front() + clearance } else { -WHITE.size[0] / 2.0 };
        Fence { y, x: [rear, WHITE.front()] }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_keyboard_is_as_wide_as_measured() {
        assert_eq!((0..KEY_COUNT).filter(|k| !key_is_black(*k)).count(), WHITE_KEYS);
        let width = key_lateral(KEY_COUNT - 1) - key_lateral(0) + WHITE.size[1];
        assert!((width - 0.6733).abs() < 1e-4, "{width}");
        assert!((key_lateral(24)).abs() < 1e-12, "middle C is in the middle");
        assert_eq!(fences().count(), WHITE_KEYS - 1);
    }

    #[test]
    fn black_keys_stand_midway_between_their_neighbours() {
        for key in (1..KEY_COUNT - 1).filter(|k| key_is_black(*k)) {
            let middle = (key_lateral(key - 1) + key_lateral(key + 1)) / 2.0;
            assert!((key_lateral(key) - middle).abs() < 1e-12);
        }
    }

    #[test]
    fn angles_are_those_of_the_sources() {
        assert!((WHITE.max_angle() - 0.066568).abs() < 1e-6);
        assert!((BLACK.max_angle().to_degrees() - 4.447).abs() < 1e-3);
        assert!((BLACK.top() - WHITE.top() - 0.0125).abs() < 1e-12);
    }
}
