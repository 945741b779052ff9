//! The number of independent samples of a series with correlated neighbours.

/// Largest number of pairs of lags: ten seconds at 200 Hz.
const MAX_PAIRS: usize = 1000;

/// Integrated autocorrelation time of residuals, in samples, at least one: `n` of them count as `n
/// / τ` independent ones.
///
/// τ = 1 + 2 Σ ρ(k), summed over pairs of lags as long as the pairs' sums are positive and do not
/// grow (Geyer 1992, initial monotone sequence): needs no window to be chosen, and errs towards a τ
/// that is too large where correlations swing below zero. Residuals of a true model have mean zero,
/// so the mean is not subtracted: an offset counts as correlation. White noise gives one, an AR(1)
/// process with coefficient φ gives (1 + φ) / (1 − φ). A series that is all zero, shorter than four
/// samples or not finite gives one.
pub fn integrated_autocorrelation(series: &[f64]) -> f64 {
    let n = series.len();
    let largest = series.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
    if n < 4 || largest == 0.0 || !series.iter().all(|x| x.is_finite()) {
        return 1.0;
    }
    let scaled: Vec<f64> = series.iter().map(|x| x / largest).collect();
    let at_lag = |lag: usize| scaled.iter().zip(&scaled[lag..]).map(|(a, b)| a * b).sum::<f64>();
    let square = at_lag(0);
    let (mut sum, mut smallest) = (0.0, f64::INFINITY);
    // Beyond half the series too few pairs remain.
    for pair in 0..(n / 4).min(MAX_PAIRS) {
        let both = (at_lag(2 * pair) + at_lag(2 * pair + 1)) / square;
        if both <= 0.0 {
            break;
        }
        smallest = both.min(smallest);
        sum += smallest;
    }
    (2.0 * sum - 1.0).clamp(1.0, n as f64)
}
