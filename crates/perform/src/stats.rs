//! Statistics of a list of numbers.

/// Mean; 0 without values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Standard deviation of a sample (divided by `n - 1`); 0 of fewer than two values.
pub fn deviation(values: &[f64]) -> f64 {
    if values.len() < 2 {
        return 0.0;
    }
    let mean = mean(values);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (squares / (values.len() - 1) as f64).sqrt()
}

/// The values in ascending order.
pub fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Quantile of sorted values, interpolated between neighbours (NumPy's `linear`); 0 without values.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let place = share * last as f64;
    let (below, part) = (place as usize, place.fract());
    sorted[below] + part * (sorted[(below + 1).min(last)] - sorted[below])
}

/// The smallest of the sorted values that at least `share` of them do not exceed (NumPy's
/// `inverted_cdf`); 0 without values.
pub fn nearest_rank(sorted: &[f64], share: f64) -> f64 {
    let rank = (sorted.len() as f64 * share).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_and_none() {
        assert_eq!(
            (mean(&[]), deviation(&[1.0]), quantile(&[], 0.5), nearest_rank(&[], 0.5)),
            (0.0, 0.0, 0.0, 0.0)
        );
        let values = sorted([4.0, 1.0, 2.0, 3.0]);
        assert_eq!(
            (values[0], mean(&values), quantile(&values, 0.5), nearest_rank(&values, 0.5)),
            (1.0, 2.5, 2.5, 2.0)
        );
        assert!((deviation(&values) - (5.0f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!((quantile(&values, 1.0), nearest_rank(&values, 1.0)), (4.0, 4.0));
    }
}
