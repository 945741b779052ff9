//! Rendering notes as sound.
//!
//! With a SoundFont a performance sounds like a piano; without one there is a built-in tone in a
//! small room. Samples are mono, 44.1 kHz, from −1 to 1, with a second for the last note to decay,
//! as RoboPianist renders them.

mod error;
mod piano;
mod reverb;
mod samples;
mod soundfont;
mod wav;

pub use error::{SoundError, write_hint};
pub use samples::SAMPLE_RATE_HZ;
use samples::sample_at;
pub use soundfont::SoundFont;
pub use wav::write_wav;

use crate::file_limits::MAX_DURATION_SECS;
use crate::note::Note;

/// What follows the last note, in seconds.
pub const TAIL_SECS: f64 = 1.0;
/// Loudest sample of a rendering, leaving headroom below full scale.
const PEAK: f32 = 0.9;

/// Renders notes with a SoundFont, or with the built-in tone without one. Empty if there are no
/// notes; else as long as the last note and [`TAIL_SECS`]. The loudest sample is just below full
/// scale.
///
/// # Errors
/// If a note's times are not finite, in order and within the longest song; if the SoundFont turns
/// out to be damaged.
pub fn render(notes: &[Note], font: Option<&SoundFont>) -> Result<Vec<f32>, SoundError> {
    for (index, note) in notes.iter().enumerate() {
        let in_order = 0.0 <= note.start_secs && note.start_secs <= note.end_secs;
        if !(in_order && note.end_secs <= MAX_DURATION_SECS) {
            return Err(SoundError::BadNote { index });
        }
    }
    let Some(last_secs) = notes.iter().map(|note| note.end_secs).reduce(f64::max) else {
        return Ok(Vec::new());
    };
    let mut samples = vec![0.0; sample_at(last_secs + TAIL_SECS)];
    match font {
        Some(font) => font.render(notes, &mut samples)?,
        None => {
            notes.iter().for_each(|note| piano::strike(note, &mut samples));
            reverb::reverberate(&mut samples);
        }
    }
    normalise(&mut samples);
    Ok(samples)
}

fn normalise(samples: &mut [f32]) {
    let loudest = samples.iter().fold(0.0f32, |loudest, sample| loudest.max(sample.abs()));
    if loudest > 0.0 {
        let gain = PEAK / loudest;
        samples.iter_mut().for_each(|sample| *sample *= gain);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::repertoire;

    fn note(pitch: u8, velocity: u8, start_secs: f64, end_secs: f64) -> Note {
        Note { pitch, velocity, start_secs, end_secs }
    }

    fn loudness(samples: &[f32]) -> f64 {
        (samples.iter().map(|sample| f64::from(sample * sample)).sum::<f64>() / samples.len() as f64).sqrt()
    }

    #[test]
    fn a_song_is_audible_in_time_and_does_not_clip() {
        let song = repertoire::get("chord-progression").unwrap();
        let samples = render(song.notes(), None).unwrap();
        assert_eq!(samples.len(), sample_at(song.duration_secs() + TAIL_SECS));
        assert!(samples.iter().all(|sample| sample.abs() <= PEAK + 1e-6));
        assert!(loudness(&samples[sample_at(0.1)..sample_at(0.5)]) > 0.05);
        assert!(loudness(&samples[sample_at(8.8)..]) < 1e-3);
    }

    #[test]
    fn velocity_is_loudness() {
        let both = render(&[note(60, 30, 0.0, 0.5), note(60, 120, 2.0, 2.5)], None).unwrap();
        let soft = loudness(&both[..sample_at(0.5)]);
        let loud = loudness(&both[sample_at(2.0)..sample_at(2.5)]);
        assert!(loud > 3.0 * soft, "{loud} {soft}");
    }

    #[test]
    fn the_tone_has_the_pitch_of_its_note() {
        // Of the frequencies within a semitone of A4, the one that the sound has most of.
        let samples = render(&[note(69, 100, 0.0, 3.0)], None).unwrap();
        let part = &samples[sample_at(0.2)..sample_at(1.2)];
        let strength = |cents: &i32| {
            let angle = std::f64::consts::TAU * 440.0 * (f64::from(*cents) / 1200.0).exp2()
                / f64::from(SAMPLE_RATE_HZ);
            let turned = |of: fn(f64) -> f64| {
                part.iter().enumerate().map(|(i, s)| f64::from(*s) * of(angle * i as f64)).sum::<f64>()
            };
            turned(f64::sin).hypot(turned(f64::cos))
        };
        let strongest = (-100..=100).step_by(5).max_by(|a, b| strength(a).total_cmp(&strength(b)));
        assert!(strongest.is_some_and(|cents| cents.abs() <= 5), "{strongest:?} cents");
    }

    #[test]
    fn odd_notes_are_refused_and_none_are_silent() {
        assert!(render(&[], None).unwrap().is_empty());
        for bad in [
            note(60, 64, -1.0, 1.0),
            note(60, 64, 0.0, f64::NAN),
            note(60, 64, 0.0, 1e9),
            note(60, 64, 2.0, 1.0),
        ] {
            assert!(matches!(render(&[bad], None), Err(SoundError::BadNote { index: 0 })), "{bad:?}");
        }
        // The ends of the scale, a stroke of no length, and a velocity beyond MIDI all stay finite.
        for odd in [note(0, 1, 0.0, 0.0), note(127, 127, 0.0, 0.1), note(255, 255, 0.0, 0.1)] {
            assert!(render(&[odd], None).unwrap().iter().all(|sample| sample.is_finite()), "{odd:?}");
        }
    }
}
