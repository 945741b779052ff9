//! Which keys the hand reaches together, as far as drawn melodies need to know.
//!
//! The hand plays with three fingers; the thumb is not used. The fingers have a fixed spacing, each
//! can lean a little to the left and to the right, and the rail moves all of them together. So keys
//! that sound together must match the spacing of the fingers within that range. What is played of a
//! song is decided by its fingering (`etude_task::fingering`).

/// Fingers that press keys: index, middle and ring (the paper's hand leaves the thumb unused).
const PLAYING_FINGERS: usize = 3;
/// Distance between neighbouring fingertips at rest, in millimetres (palm of the Allegro hand).
const FINGER_SPACING_MM: f64 = 43.5;
/// How far a fingertip can move laterally to press the middle of a key, in millimetres to each
/// side. Estimated: the finger's first joint turns it about its own axis, which moves a curled
/// fingertip sideways by about a quarter of the spacing.
const FINGER_LATERAL_RANGE_MM: f64 = 12.0;
/// Width of the keyboard over its number of white keys, in millimetres: 674 mm for 29, as measured
/// in github.com/lasr-lab/learning-to-play-piano.
pub(crate) const WHITE_KEY_PITCH_MM: f64 = 674.0 / 29.0;

/// Lateral position of the middle of a key, in millimetres from an arbitrary origin. A black key is
/// taken to lie on the border between its white neighbours.
pub(crate) fn key_centre_mm(pitch: u8) -> f64 {
    const HALF_WHITES: [i32; 12] = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12];
    const HALF_WHITES_AN_OCTAVE: i32 = 14;
    let halves = i32::from(pitch / 12) * HALF_WHITES_AN_OCTAVE + HALF_WHITES[usize::from(pitch % 12)];
    f64::from(halves) / 2.0 * WHITE_KEY_PITCH_MM
}

/// Whether the playing fingers can reach all of these keys at once; pitches lowest first.
pub(crate) fn within_reach(pitches: &[u8]) -> bool {
    // Which finger takes which key: every way to choose as many fingers, in order, as there are
    // keys.
    (0u32..1 << PLAYING_FINGERS).filter(|fingers| fingers.count_ones() as usize == pitches.len()).any(
        |fingers| {
            let chosen = (0..PLAYING_FINGERS).filter(|finger| fingers >> finger & 1 == 1);
            // Where the rail would have to be for each finger to be straight; they must agree
            // within that range.
            let rail = pitches
                .iter()
                .zip(chosen)
                .map(|(&pitch, f)| key_centre_mm(pitch) - f as f64 * FINGER_SPACING_MM);
            let (low, high) = rail.fold((f64::MAX, f64::MIN), |(low, high), mm| (low.min(mm), high.max(mm)));
            high - low <= 2.0 * FINGER_LATERAL_RANGE_MM
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_follows_the_spacing_of_the_fingers() {
        for chord in
            [&[60, 64][..], &[65, 69, 72], &[67, 71, 74], &[60, 64, 67], &[60, 62], &[60, 65], &[60, 67]]
        {
            assert!(within_reach(chord), "{chord:?}");
        }
        for chord in
            [&[60, 61][..], &[61, 62], &[60, 69], &[60, 72], &[60, 61, 64], &[60, 62, 64], &[60, 67, 72]]
        {
            assert!(!within_reach(chord), "{chord:?}");
        }
    }

    #[test]
    fn keys_have_their_lateral_positions() {
        for (low, high, whites) in [(60, 61, 0.5), (64, 65, 1.0), (59, 60, 1.0), (36, 84, 28.0)] {
            let span = (key_centre_mm(high) - key_centre_mm(low)) / WHITE_KEY_PITCH_MM;
            assert!((span - whites).abs() < 1e-9, "{low} {high}: {span}");
        }
    }
}
