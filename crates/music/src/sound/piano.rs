//! The built-in tone: eight decaying partials.
//!
//! It models what makes a tone sound like a struck string: a fast onset, faster decay of higher overtones and of higher notes, and more
//! overtones for harder strokes.

use super::{SAMPLE_RATE_HZ, sample_at};
use crate::note::Note;

const PARTIALS: u32 = 8;
/// How fast overtones of a middle stroke get weaker: the amplitude of partial *n* is *n* to minus this power.
const BRIGHTNESS: f64 = 1.4;
/// Softer strokes are duller, harder ones brighter, by up to this much of the power.
const BRIGHTNESS_BY_VELOCITY: f64 = 0.5;
/// Strings are stiff: partial *n* is sharp by half of this times *n* squared (middle register of a piano).
const STIFFNESS: f64 = 4e-4;
/// Seconds in which the fundamental of middle C falls to 1/e; halves with every octave up.
const DECAY_SECS: f64 = 1.2;
/// Softening of the onset, in seconds.
const ATTACK_SECS: f64 = 0.004;
/// Fall to 1/e once the damper is back on the string, in seconds.
const RELEASE_SECS: f64 = 0.06;
/// The release is cut off after this many of its time constants, where it cannot be heard.
const RELEASE_SPAN: f64 = 8.0;

const MIDDLE_C: f64 = 60.0;
const A4: f64 = 69.0;
const A4_HZ: f64 = 440.0;
const SEMITONES: f64 = 12.0;

/// Adds one note to the samples.
pub(super) fn strike(note: &Note, samples: &mut [f32]) {
    let rate = f64::from(SAMPLE_RATE_HZ);
    let start = sample_at(note.start_secs).min(samples.len());
    let released = sample_at(note.end_secs) - sample_at(note.start_secs);
    let end = sample_at(note.end_secs + RELEASE_SECS * RELEASE_SPAN).min(samples.len());
    let target = &mut samples[start..end];

    let force = f64::from(note.velocity.min(127)) / 127.0;
    let power = BRIGHTNESS + BRIGHTNESS_BY_VELOCITY * (0.5 - force);
    let fundamental_hz = A4_HZ * ((f64::from(note.pitch) - A4) / SEMITONES).exp2();
    let ring_secs = DECAY_SECS * ((MIDDLE_C - f64::from(note.pitch)) / SEMITONES).exp2();
    let release = (-1.0 / (RELEASE_SECS * rate)).exp();

    for partial in 1..=PARTIALS {
        let n = f64::from(partial);
        let hz = fundamental_hz * n * (1.0 + STIFFNESS * n * n / 2.0);
        if hz >= rate / 2.0 {
            break;
        }
        // A rotating and shrinking vector, whose height is the sample.
        let decay = (-n / (ring_secs * rate)).exp();
        let (sin, cos) = (std::f64::consts::TAU * hz / rate).sin_cos();
        let (mut x, mut y) = (force * force * n.powf(-power), 0.0);
        for (i, sample) in target.iter_mut().enumerate() {
            let attack = (i as f64 / (ATTACK_SECS * rate)).min(1.0);
            *sample += (attack * y) as f32;
            let shrink = if i >= released { decay * release } else { decay };
            (x, y) = (shrink * (x * cos - y * sin), shrink * (x * sin + y * cos));
        }
    }
}
