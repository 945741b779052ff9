//! The notes of a melody one after the other, and what sounds with them.

use super::draw::Draw;
use crate::keys::{HIGHEST_PITCH, LOWEST_PITCH};
use crate::playability::{WHITE_KEY_PITCH_MM, key_centre_mm, within_reach};

/// Widest leap, scale degrees: an octave.
const MAX_LEAP_DEGREES: usize = 7;
/// Probabilities of a repeated note, a second and a third, before those of the leaps.
const SMALL_STEPS: [f64; 3] = [0.16, 0.5, 0.2];
/// Widths of leaps, white keys, and the shortest time from one onset to the next for them, s.
const LEAP_SECS: [(f64, f64); 2] = [(4.0, 0.3), (6.0, 0.45)];

/// Whether the hand can leap from one pitch to another whose onsets are `secs` apart.
pub(super) fn leap_is_playable(from: u8, to: u8, secs: f64) -> bool {
    let keys = (key_centre_mm(to) - key_centre_mm(from)).abs() / WHITE_KEY_PITCH_MM;
    LEAP_SECS.iter().all(|(min_keys, needed)| keys < *min_keys || secs >= *needed)
}

/// The pitches of a scale in the part of the keyboard that the melody uses.
pub(super) struct Line {
    pub scale: Vec<u8>,
    /// Share of leaps of a fourth and more.
    pub leaps: f64,
    /// Probability that a note is moved by a semitone.
    pub chromatic: f64,
    degree: usize,
}

impl Line {
    /// From the middle of the scale.
    pub(super) fn new(scale: Vec<u8>, leaps: f64, chromatic: f64) -> Self {
        let degree = scale.len() / 2;
        Self { scale, leaps, chromatic, degree }
    }

    /// The next pitch, `secs` after the one before.
    pub(super) fn next(&mut self, draw: &mut Draw, secs: f64) -> u8 {
        let last = self.scale.len() - 1;
        let mut weights = [0.0; MAX_LEAP_DEGREES + 1];
        weights[..SMALL_STEPS.len()].copy_from_slice(&SMALL_STEPS);
        for (width, weight) in weights.iter_mut().enumerate().skip(SMALL_STEPS.len()) {
            *weight = self.leaps / (width - 1) as f64;
        }
        // Towards the middle more often than away from it.
        let up = draw.chance(0.5 + 0.4 * (0.5 - self.degree as f64 / last.max(1) as f64));
        let reached = |width: usize| {
            let to = if up { self.degree + width } else { self.degree.wrapping_sub(width) };
            self.scale.get(to).map(|pitch| (to, *pitch))
        };
        let from = self.scale[self.degree];
        for (width, weight) in weights.iter_mut().enumerate() {
            if !reached(width).is_some_and(|(_, pitch)| leap_is_playable(from, pitch, secs)) {
                *weight = 0.0;
            }
        }
        let width = draw.weighted(&weights).unwrap_or(0);
        self.degree = reached(width).map_or(self.degree, |(to, _)| to);
        let pitch = self.scale[self.degree];
        if draw.chance(self.chromatic) {
            let moved = if draw.chance(0.5) { pitch + 1 } else { pitch - 1 };
            return moved.clamp(LOWEST_PITCH, HIGHEST_PITCH);
        }
        pitch
    }

    /// Pitches of the scale that the hand reaches together with `pitch`, one or two of them, at
    /// most an octave away; none where it reaches none.
    pub(super) fn chord(&self, draw: &mut Draw, pitch: u8) -> Vec<u8> {
        let candidates =
            || self.scale.iter().copied().filter(|other| *other != pitch && other.abs_diff(pitch) <= 12);
        let sorted = |mut pitches: Vec<u8>| {
            pitches.sort_unstable();
            pitches
        };
        let mut sets: Vec<Vec<u8>> = candidates().map(|one| vec![one]).collect();
        if draw.chance(0.4) {
            sets = candidates()
                .flat_map(|one| candidates().filter(move |two| *two > one).map(move |two| vec![one, two]))
                .collect();
        }
        sets.retain(|others| within_reach(&sorted(others.iter().copied().chain([pitch]).collect())));
        if sets.is_empty() {
            return Vec::new();
        }
        let chosen = draw.whole(0, sets.len() - 1);
        sets.swap_remove(chosen)
    }

    /// A pitch of the scale that the hand reaches together with each of `pitches`.
    pub(super) fn held(&self, draw: &mut Draw, pitches: &[u8]) -> Option<u8> {
        let together = |held: u8| {
            pitches.iter().all(|pitch| *pitch != held && within_reach(&[held.min(*pitch), held.max(*pitch)]))
        };
        let all: Vec<u8> = self.scale.iter().copied().filter(|pitch| together(*pitch)).collect();
        if all.is_empty() { None } else { Some(all[draw.whole(0, all.len() - 1)]) }
    }
}
