//! The built-in tone: a model of a struck string with what makes it sound like a piano.
//!
//! Each partial has a prompt sound that decays fast and a quieter, slightly detuned aftersound that
//! decays slowly, because two or three strings share a note (Weinreich, "Coupled piano strings",
//! 1977). Stiffness stretches the partials (Fletcher, 1964), the hammer's position leaves some of
//! them out, and harder strokes are brighter. The replay page has the same model in
//! `viewer/src/piano.js`.

use super::samples::{SAMPLE_RATE_HZ, sample_at};
use crate::note::Note;

const PARTIALS: u32 = 16;
/// Where along the string the hammer strikes: partials with a node there are weak.
const HAMMER_POSITION: f64 = 1.0 / 8.0;
/// Stiffness of the strings of middle C, and by how much it grows an octave. Partial *n* is sharp
/// by half of it times *n* squared.
const STIFFNESS: f64 = 3.5e-4;
const STIFFNESS_AN_OCTAVE: f64 = 2.3;
/// How fast overtones of the softest stroke get weaker, as a power of their number; by how much
/// less in the loudest; and more an octave.
const SLOPE: f64 = 1.9;
const SLOPE_BY_FORCE: f64 = 1.1;
const SLOPE_AN_OCTAVE: f64 = 0.25;
/// Seconds in which the prompt sound of middle C's fundamental falls to 1/e, and octaves in which
/// this halves.
const PROMPT_SECS: f64 = 0.7;
const PROMPT_OCTAVES: f64 = 1.0 / 0.6;
/// The aftersound: its share of the onset, how much longer it rings, and its detuning.
const AFTER_SHARE: f64 = 0.22;
const AFTER_LONGER: f64 = 5.0;
const AFTER_DETUNED: f64 = 1.0004;
/// Softening of the onset, in seconds.
const ATTACK_SECS: f64 = 0.002;
/// The knock of the hammer: level beside the tone, time to fall to 1/e in seconds, and how dull its
/// noise is.
const KNOCK_LEVEL: f64 = 0.48;
const KNOCK_SECS: f64 = 0.012;
const KNOCK_DULLNESS: f64 = 0.11;
/// Level of the softest stroke, and the power of the force by which it grows.
const SOFTEST: f64 = 0.08;
const LOUDNESS_POWER: f64 = 1.6;
/// Fall to 1/e once the damper is on the string, in seconds.
const RELEASE_SECS: f64 = 0.06;
/// What decays is cut off after this many of its time constants, where it cannot be heard.
const DECAY_TIMES: f64 = 8.0;

const MIDDLE_C: f64 = 60.0;
const A4: f64 = 69.0;
const A4_HZ: f64 = 440.0;
const SEMITONES: f64 = 12.0;
const RATE: f64 = SAMPLE_RATE_HZ as f64;

/// Adds one note to the samples.
pub(super) fn strike(note: &Note, samples: &mut [f32]) {
    let start = sample_at(note.start_secs).min(samples.len());
    let end = sample_at(note.end_secs + RELEASE_SECS * DECAY_TIMES).min(samples.len());
    let released = sample_at(note.end_secs) - sample_at(note.start_secs);
    let mut tone = vec![0.0; end - start];

    let force = f64::from(note.velocity.min(127)) / 127.0;
    let octaves = (f64::from(note.pitch) - MIDDLE_C) / SEMITONES;
    let fundamental_hz = A4_HZ * ((f64::from(note.pitch) - A4) / SEMITONES).exp2();
    let stiffness = STIFFNESS * STIFFNESS_AN_OCTAVE.powf(octaves);
    let slope = SLOPE - SLOPE_BY_FORCE * force + SLOPE_AN_OCTAVE * octaves;
    let mut sum = 0.0;
    for partial in 1..=PARTIALS {
        let n = f64::from(partial);
        let hz = fundamental_hz * n * (1.0 + stiffness * n * n).sqrt();
        if hz >= 0.45 * RATE {
            break;
        }
        let level = (std::f64::consts::PI * n * HAMMER_POSITION).sin().abs() * n.powf(-slope);
        let ring_secs = PROMPT_SECS * (-octaves / PROMPT_OCTAVES).exp2() / (0.6 + 0.4 * n);
        ring(&mut tone, hz, level * (1.0 - AFTER_SHARE), ring_secs);
        ring(&mut tone, hz * AFTER_DETUNED, level * AFTER_SHARE, ring_secs * AFTER_LONGER);
        sum += level;
    }
    knock(&mut tone, force * sum);

    let gain = (SOFTEST + (1.0 - SOFTEST) * force.powf(LOUDNESS_POWER)) / sum.max(f64::MIN_POSITIVE);
    let (attack, release) = (ATTACK_SECS * RATE, (-1.0 / (RELEASE_SECS * RATE)).exp());
    let mut damper = 1.0;
    for (i, (sample, tone)) in samples[start..end].iter_mut().zip(tone).enumerate() {
        if i >= released {
            damper *= release;
        }
        *sample += (gain * damper * (i as f64 / attack).min(1.0) * tone) as f32;
    }
}

/// Adds a decaying sine: a rotating and shrinking vector, whose height is the sample.
fn ring(tone: &mut [f64], hz: f64, level: f64, secs: f64) {
    let shrink = (-1.0 / (secs * RATE)).exp();
    let (sin, cos) = (std::f64::consts::TAU * hz / RATE).sin_cos();
    let (mut x, mut y) = (level, 0.0);
    let audible = (secs * DECAY_TIMES * RATE) as usize;
    for sample in tone.iter_mut().take(audible) {
        *sample += y;
        (x, y) = (shrink * (x * cos - y * sin), shrink * (x * sin + y * cos));
    }
}

/// Adds low-pass noise that decays at once. It is the same for every stroke, so that a performance
/// always sounds the same.
fn knock(tone: &mut [f64], level: f64) {
    let mut seed = 1i32;
    let mut dull = 0.0;
    for (i, sample) in tone.iter_mut().take((KNOCK_SECS * DECAY_TIMES * RATE) as usize).enumerate() {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        dull += KNOCK_DULLNESS * (f64::from(seed) / -f64::from(i32::MIN) - dull);
        *sample += KNOCK_LEVEL * level * dull * (-(i as f64) / (KNOCK_SECS * RATE)).exp();
    }
}
