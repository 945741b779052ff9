//! Divides a joint's remaining error by what it correlates with: the direction of motion (backlash,
//! dry friction), velocity (timing), acceleration (inertia), a constant offset, the readings'
//! noise, and the rest.
//!
//! A regression of the differences between simulation and recording on direction, velocity and
//! acceleration of the simulated joint. These correlate in most motions, so the explained part is
//! divided in proportion to the variance of each of the three terms. No share is negative, and they
//! sum to the explained part.

use etude_stage::RAIL;
use nalgebra::{Matrix4, Vector4};

use crate::motion::RecordedMotion;
use crate::replay::Trace;

/// Regressors: direction, velocity, acceleration.
const REGRESSORS: usize = 3;
/// A regressor with a smaller share of independent variance is dropped.
const COLLINEAR: f64 = 1e-6;
/// Step of the differences for the simulated joint's velocity and acceleration, s: one physics
/// step.
const DIFFERENCE_SECS: f64 = 0.005;
/// A slower joint keeps its last direction, rad/s and m/s, because backlash and friction do.
const STANDSTILL: [f64; 2] = [0.005, 0.0005];

/// One reading of a joint and its simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// Simulated minus measured, rad or m.
    pub error: f64,
    /// Direction of the last motion, 1 or −1; 0 before any. Then velocity and acceleration, in s,
    /// of the simulated joint.
    pub motion: [f64; REGRESSORS],
}

/// Parts of a joint's mean square error. Shares are of the mean square and sum to one.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ErrorDecomposition {
    /// Root mean square error, rad or m.
    pub rms: f64,
    /// Share of the mean error.
    pub offset: f64,
    /// Shares of direction, velocity and acceleration.
    pub shares: [f64; REGRESSORS],
    /// Share of the rest.
    pub rest: f64,
    /// Share of the readings' noise.
    pub noise: f64,
    /// The mean error, rad or m.
    pub mean_error: f64,
    /// Error per unit of direction (rad or m), of velocity (s) and of acceleration (s²).
    pub slopes: [f64; REGRESSORS],
}

/// Readings of a joint and its simulation.
pub(super) fn samples(motion: &RecordedMotion, trace: &Trace, joint: usize) -> Vec<Sample> {
    let stands = STANDSTILL[usize::from(joint == RAIL)];
    let mut direction = 0.0;
    let sample = |(secs, measured): (f64, f64)| {
        // At the start there is no reading before the first.
        let centre = secs.max(DIFFERENCE_SECS);
        let [earlier, here, later] =
            [-1.0, 0.0, 1.0].map(|side| trace.position(joint, centre + side * DIFFERENCE_SECS));
        let velocity = (later - earlier) / (2.0 * DIFFERENCE_SECS);
        let acceleration = (later - 2.0 * here + earlier) / (DIFFERENCE_SECS * DIFFERENCE_SECS);
        if velocity.abs() > stands {
            direction = velocity.signum();
        }
        Sample { error: trace.position(joint, secs) - measured, motion: [direction, velocity, acceleration] }
    };
    motion.readings(joint).map(sample).collect()
}

/// Divides the mean square error of these samples; `noise` is the standard deviation of a reading
/// at rest. `None` without samples, without error, or with one that is not finite.
pub(super) fn decompose(samples: &[Sample], noise: f64) -> Option<ErrorDecomposition> {
    let count = samples.len() as f64;
    // Regressors and, last, the error.
    let columns = |sample: &Sample| {
        let [direction, velocity, acceleration] = sample.motion;
        Vector4::new(direction, velocity, acceleration, sample.error)
    };
    let means = samples.iter().map(columns).sum::<Vector4<f64>>() / count;
    let spread = |sample: &Sample| {
        let away = columns(sample) - means;
        away * away.transpose() / count
    };
    let covariance: Matrix4<f64> = samples.iter().map(spread).sum();
    let mean_error = means[REGRESSORS];
    let square = mean_error * mean_error + covariance[(REGRESSORS, REGRESSORS)];
    let is_sound = square > 0.0 && square.is_finite() && covariance.iter().all(|c| c.is_finite());
    if !is_sound {
        return None;
    }
    let slopes = regress(&covariance);
    let terms: [f64; REGRESSORS] = std::array::from_fn(|k| slopes[k] * slopes[k] * covariance[(k, k)]);
    let explained: f64 = (0..REGRESSORS).map(|k| slopes[k] * covariance[(k, REGRESSORS)]).sum();
    let (explained, all) = ((explained / square).clamp(0.0, 1.0), terms.iter().sum::<f64>());
    let shares = terms.map(|term| if all > 0.0 { explained * term / all } else { 0.0 });
    let offset = mean_error * mean_error / square;
    let rest = (1.0 - offset - shares.iter().sum::<f64>()).max(0.0);
    let noise = (noise * noise / square).min(rest);
    Some(ErrorDecomposition {
        rms: square.sqrt(),
        offset,
        shares,
        rest: rest - noise,
        noise,
        mean_error,
        slopes,
    })
}

/// Slopes of the error by least squares, from the covariances; zero for a regressor that depends on
/// those before it.
fn regress(covariance: &Matrix4<f64>) -> [f64; REGRESSORS] {
    let mut left = *covariance;
    let mut taken = [false; REGRESSORS];
    for k in 0..REGRESSORS {
        let pivot = left.row(k).into_owned();
        if pivot[k] <= COLLINEAR * covariance[(k, k)] || pivot[k] <= f64::MIN_POSITIVE {
            continue;
        }
        taken[k] = true;
        for (row, mut cells) in left.row_iter_mut().enumerate() {
            let ratio = if row == k { 1.0 - 1.0 / pivot[k] } else { cells[k] / pivot[k] };
            cells -= ratio * pivot;
        }
    }
    std::array::from_fn(|k| if taken[k] { left[(k, REGRESSORS)] } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng as _};

    /// A sweep with rising frequency: 20 s at 333 Hz.
    fn sweep(error: impl Fn([f64; 3], f64) -> f64) -> Vec<Sample> {
        (0..6660)
            .map(|i| {
                let secs = f64::from(i) / 333.0;
                let phase = 1.5 * secs * secs;
                let (speed, rise) = (3.0 * secs, 3.0);
                let velocity = 0.2 * speed * phase.cos();
                let acceleration = 0.2 * (rise * phase.cos() - speed * speed * phase.sin());
                let motion = [velocity.signum(), velocity, acceleration];
                Sample { error: error(motion, secs), motion }
            })
            .collect()
    }

    #[test]
    fn a_single_cause_is_found_with_its_size() {
        for (cause, size) in [(1, 0.003), (2, 2e-5)] {
            let found = decompose(&sweep(|motion, _| size * motion[cause]), 0.0).unwrap();
            assert!((found.slopes[cause] - size).abs() < 1e-9 * size, "{found:?}");
            assert!(
                (found.shares[cause] + found.offset - 1.0).abs() < 1e-9 && found.rest < 1e-9,
                "{found:?}"
            );
        }
        let found = decompose(&sweep(|motion, _| 0.002 * motion[0]), 0.0).unwrap();
        assert!((found.slopes[0] - 0.002).abs() < 1e-12 && found.slopes[1].abs() < 1e-12, "{found:?}");
        assert!((found.shares[0] + found.offset - 1.0).abs() < 1e-9, "{found:?}");
        let offset = decompose(&sweep(|_, _| 0.004), 0.0).unwrap();
        assert!((offset.offset - 1.0).abs() < 1e-9 && (offset.mean_error - 0.004).abs() < 1e-12);
    }

    #[test]
    fn noise_is_noise_and_what_goes_with_nothing_is_left() {
        let rng = std::cell::RefCell::new(rand_pcg::Pcg64::seed_from_u64(1));
        let uniform = || rng.borrow_mut().random_range(-1.0..1.0) * 3f64.sqrt() * 1e-3;
        let noise = decompose(&sweep(|_, _| uniform()), 1e-3).unwrap();
        assert!(noise.noise > 0.9 && noise.rest < 0.1, "{noise:?}");
        let hum = decompose(&sweep(|_, secs| 1e-3 * (secs * 700.0).sin()), 1e-5).unwrap();
        assert!(hum.rest > 0.97, "{hum:?}");
        let drift = decompose(&sweep(|_, secs| 1e-3 * (secs * 0.7).sin()), 1e-5).unwrap();
        assert!(drift.rest > 0.97, "{drift:?}");
    }

    #[test]
    fn regressors_without_any_correlation_have_their_own_squares() {
        // A design of all signs: nothing correlates, so the shares are those of a textbook.
        let signs = [-1.0, 1.0];
        let mut samples = Vec::new();
        for a in signs {
            for b in signs {
                for c in signs {
                    let error = 3.0 * a + 2.0 * b + c + 2f64.sqrt();
                    samples.push(Sample { error, motion: [a, b, c] });
                }
            }
        }
        let found = decompose(&samples, 0.0).unwrap();
        for (share, expected) in found.shares.iter().zip([9.0, 4.0, 1.0]) {
            assert!((share - expected / 16.0).abs() < 1e-12, "{found:?}");
        }
        assert!((found.offset - 2.0 / 16.0).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn nothing_to_explain() {
        assert_eq!(decompose(&[], 1.0), None);
        assert_eq!(decompose(&sweep(|_, _| 0.0), 1.0), None);
        assert_eq!(decompose(&sweep(|_, _| f64::NAN), 1.0), None);
        // Two regressors that are one: the first has it all.
        let twice =
            |sample: Sample| Sample { motion: [sample.motion[0], 3.0 * sample.motion[0], 0.0], ..sample };
        let found: Vec<Sample> = sweep(|motion, _| 0.002 * motion[0]).into_iter().map(twice).collect();
        let found = decompose(&found, 0.0).unwrap();
        assert!(
            (found.shares[0] + found.offset - 1.0).abs() < 1e-9 && (found.slopes[0] - 0.002).abs() < 1e-12,
            "{found:?}"
        );
        // A joint that never moves has an offset and nothing else.
        let still = Sample { error: 1.0, motion: [0.0; 3] };
        assert_eq!(decompose(&[still; 10], 0.0).unwrap().offset, 1.0);
    }

    proptest! {
        #[test]
        fn shares_sum_to_one(
            values in proptest::collection::vec(
                (-1.0..1.0f64, -1.0..1.0f64, -9.0..9.0f64),
                1..60,
            ),
            noise in 0.0..2.0f64,
        ) {
            let samples: Vec<Sample> = values
                .iter()
                .map(|&(error, a, b)| {
                    let motion = [a.signum(), b, a * b];
                    Sample { error, motion }
                })
                .collect();
            if let Some(found) = decompose(&samples, noise) {
                let all = [found.offset, found.noise, found.rest].into_iter().chain(found.shares);
                prop_assert!((all.clone().sum::<f64>() - 1.0).abs() < 1e-6, "{found:?}");
                prop_assert!(all.clone().all(|share| share >= 0.0), "{found:?}");
            }
        }
    }
}
