//! Statistics of scores of several trainings: means and interquartile means with bootstrap
//! intervals, stratified by song as Agarwal et al. do ("Deep reinforcement learning at the edge of
//! the statistical precipice", 2021). Checked against their package and SciPy
//! (`scripts/golden_statistics.py`).

use etude_perform::stats::{mean, quantile, sorted};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Resamples of a bootstrap.
const RESAMPLES: usize = 10_000;
/// Ends of the intervals.
const TAILS: [f64; 2] = [0.025, 0.975];
/// Share of the scores that the interquartile mean leaves out at each end.
const TRIMMED: f64 = 0.25;

/// A statistic with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The statistic.
    pub value: f64,
    /// Its interval by percentile bootstrap; none where nothing can be resampled.
    pub interval: Option<[f64; 2]>,
}

/// Scores in short.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// How many scores.
    pub count: usize,
    /// Their mean.
    pub mean: Interval,
    /// Mean of the middle half, on which one failed training has little influence.
    pub interquartile_mean: Interval,
}

impl Summary {
    /// Of scores in strata: one a song, one score a training. Trainings are resampled within their
    /// song. `None` without scores.
    pub fn new(strata: &[Vec<f64>]) -> Option<Self> {
        let all = strata.concat();
        if all.is_empty() {
            return None;
        }
        let [mean_of, middle_of] = bootstrap(strata, [mean, interquartile_mean]);
        Some(Self {
            count: all.len(),
            mean: Interval { value: mean(&all), interval: mean_of },
            interquartile_mean: Interval { value: interquartile_mean(&all), interval: middle_of },
        })
    }
}

/// Mean of what is left when a quarter is cut off at each end, in whole scores.
pub fn interquartile_mean(scores: &[f64]) -> f64 {
    let sorted = sorted(scores.iter().copied());
    let cut = (TRIMMED * sorted.len() as f64) as usize;
    mean(&sorted[cut..sorted.len() - cut])
}

/// Percentile intervals of two statistics over the same resamples; none where a stratum has a
/// single score, which would look as if it had no spread.
fn bootstrap(strata: &[Vec<f64>], statistics: [fn(&[f64]) -> f64; 2]) -> [Option<[f64; 2]>; 2] {
    if strata.iter().any(|scores| scores.len() == 1) {
        return [None, None];
    }
    // The same scores have the same interval, whatever else is reported.
    let mut random = Pcg64::seed_from_u64(0);
    let mut found = [Vec::with_capacity(RESAMPLES), Vec::with_capacity(RESAMPLES)];
    let mut sample = Vec::with_capacity(strata.iter().map(Vec::len).sum());
    for _ in 0..RESAMPLES {
        sample.clear();
        for scores in strata.iter().filter(|scores| !scores.is_empty()) {
            sample.extend((0..scores.len()).map(|_| scores[random.random_range(0..scores.len())]));
        }
        for (found, statistic) in found.iter_mut().zip(statistics) {
            found.push(statistic(&sample));
        }
    }
    found.map(|values| {
        let values = sorted(values);
        Some(TAILS.map(|tail| quantile(&values, tail)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Deserialize)]
    struct Golden {
        strata: Vec<Vec<f64>>,
        mean: f64,
        mean_interval: [f64; 2],
        interquartile_mean: f64,
        interquartile_mean_interval: [f64; 2],
    }

    #[test]
    fn statistics_are_those_of_rliable_and_scipy() {
        let golden: Vec<Golden> =
            serde_json::from_str(include_str!("../tests/golden/statistics.json")).unwrap();
        assert!(golden.len() >= 4);
        for case in golden {
            let found = Summary::new(&case.strata).unwrap();
            assert!((found.mean.value - case.mean).abs() < 1e-12);
            assert!((found.interquartile_mean.value - case.interquartile_mean).abs() < 1e-12);
            // Both are drawn: their ends differ by the noise of 10,000 resamples.
            let close = |ours: Interval, theirs: [f64; 2]| {
                let ours = ours.interval.unwrap();
                let width = theirs[1] - theirs[0];
                for (a, b) in ours.iter().zip(theirs) {
                    assert!((a - b).abs() < 0.04 * width, "{ours:?} and {theirs:?}");
                }
            };
            close(found.mean, case.mean_interval);
            close(found.interquartile_mean, case.interquartile_mean_interval);
        }
    }

    #[test]
    fn what_cannot_be_resampled_has_no_interval() {
        assert_eq!(Summary::new(&[]), None);
        assert_eq!(Summary::new(&[Vec::new()]), None);
        let one = Summary::new(&[vec![0.5], vec![0.7]]).unwrap();
        assert!((one.mean.value - 0.6).abs() < 1e-12);
        assert_eq!((one.mean.interval, one.count), (None, 2));
        assert_eq!(Summary::new(&[vec![0.5], vec![0.6, 0.7]]).unwrap().mean.interval, None);
        let two = Summary::new(&[vec![0.5, 0.7]]).unwrap();
        assert_eq!(two.mean.interval, Some([0.5, 0.7]));
    }
}
