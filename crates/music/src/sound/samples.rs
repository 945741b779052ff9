//! The sample rate of all sound.

/// Samples a second.
pub const SAMPLE_RATE_HZ: u32 = 44_100;

/// Index of the sample at this many seconds.
pub(super) fn sample_at(secs: f64) -> usize {
    (secs * f64::from(SAMPLE_RATE_HZ)).round() as usize
}
