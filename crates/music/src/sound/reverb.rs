//! Reverberation for the built-in tone: a feedback delay network (Jot and Chaigne, 1991).

use super::samples::SAMPLE_RATE_HZ;

const LINES: usize = 8;
/// Lengths of the delay lines, in seconds: path lengths of sound in a room of some metres, without
/// a common divisor.
const DELAYS_SECS: [f64; LINES] = [0.0147, 0.0179, 0.0211, 0.0239, 0.0277, 0.0319, 0.0353, 0.0397];
/// Time in which the reverberation falls by 60 dB, in seconds.
const FALL_SECS: f64 = 0.7;
/// Part of each reflection that is smoothed away: walls absorb high notes more.
const DULLNESS: f32 = 0.35;
/// Level of the reverberation beside the direct sound.
const WET: f32 = 0.16;

/// One delay line with its losses.
struct Line {
    samples: Vec<f32>,
    at: usize,
    gain: f32,
    dull: f32,
}

impl Line {
    fn new(secs: f64) -> Self {
        let length = (secs * f64::from(SAMPLE_RATE_HZ)).round() as usize;
        let gain = 10.0f64.powf(-3.0 * secs / FALL_SECS) as f32;
        Self { samples: vec![0.0; length], at: 0, gain, dull: 0.0 }
    }

    fn read(&mut self) -> f32 {
        self.dull += (1.0 - DULLNESS) * (self.samples[self.at] - self.dull);
        self.gain * self.dull
    }

    fn write(&mut self, sample: f32) {
        self.samples[self.at] = sample;
        self.at = (self.at + 1) % self.samples.len();
    }
}

/// Adds the reverberation of a room to `samples`.
pub(super) fn reverberate(samples: &mut [f32]) {
    let mut lines = DELAYS_SECS.map(Line::new);
    for sample in samples {
        let reflections = lines.each_mut().map(Line::read);
        let sum: f32 = reflections.iter().sum();
        // The Householder matrix mixes all lines and keeps their energy.
        let mixed = 2.0 / LINES as f32 * sum;
        for (line, reflection) in lines.iter_mut().zip(reflections) {
            line.write(*sample + reflection - mixed);
        }
        *sample += WET * sum;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reverberation_falls_by_60_db_in_its_time() {
        let rate = SAMPLE_RATE_HZ as usize;
        let mut samples = vec![0.0; rate * 2];
        samples[0] = 1.0;
        reverberate(&mut samples);
        assert_eq!(samples[0], 1.0);
        let level = |from: f64, to: f64| {
            let part = &samples[(from * rate as f64) as usize..(to * rate as f64) as usize];
            10.0 * (part.iter().map(|s| f64::from(s * s)).sum::<f64>() / part.len() as f64).log10()
        };
        let fall = level(0.05, 0.15) - level(FALL_SECS + 0.05, FALL_SECS + 0.15);
        // High notes fall faster than by 60 dB.
        assert!((55.0..90.0).contains(&fall), "{fall} dB");
        assert!(samples.iter().all(|sample| sample.abs() <= 1.0));
    }
}
