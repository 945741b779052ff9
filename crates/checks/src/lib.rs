//! Range checks of settings, with one message for all of them.
//!
//! ```
//! use etude_checks::check_range;
//!
//! assert!(check_range("droq.dropout", 0.01, 0.0..1.0).is_ok());
//! let error = check_range("droq.dropout", 1.5, 0.0..1.0).unwrap_err();
//! assert_eq!(error.to_string(), "droq.dropout is 1.5: it must be at least 0 and less than 1");
//! ```

use std::fmt::{self, Display};
use std::ops::{Bound, RangeBounds};

/// A setting is outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} is {value}: it must be {allowed}")]
pub struct RangeError {
    /// Its dotted path in the configuration, as `arm.servo_hz`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// The values that are allowed.
    pub allowed: Allowed,
}

/// A range of finite numbers, as people read it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allowed {
    /// Its lower end.
    pub low: Bound<f64>,
    /// Its upper end.
    pub high: Bound<f64>,
}

impl Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use Bound::{Excluded, Included, Unbounded};
        match (self.low, self.high) {
            (Unbounded, Unbounded) => write!(f, "a finite number"),
            (Included(low), Included(high)) => write!(f, "from {low} to {high}"),
            (low, high) => {
                match low {
                    Included(low) => write!(f, "at least {low}")?,
                    Excluded(low) => write!(f, "more than {low}")?,
                    Unbounded => {}
                }
                if low != Unbounded && high != Unbounded {
                    write!(f, " and ")?;
                }
                match high {
                    Included(high) => write!(f, "at most {high}"),
                    Excluded(high) => write!(f, "less than {high}"),
                    Unbounded => Ok(()),
                }
            }
        }
    }
}

/// Numbers above 0 and at most `high`.
pub fn positive_to(high: f64) -> (Bound<f64>, Bound<f64>) {
    (Bound::Excluded(0.0), Bound::Included(high))
}

/// Numbers above 0.
pub const POSITIVE: (Bound<f64>, Bound<f64>) = (Bound::Excluded(0.0), Bound::Unbounded);

/// Checks that the setting `name` has a finite value in `range`.
///
/// # Errors
/// If it does not. NaN and infinity are in no range.
pub fn check_range(
    name: impl Into<String>,
    value: f64,
    range: impl RangeBounds<f64>,
) -> Result<(), RangeError> {
    if value.is_finite() && range.contains(&value) {
        return Ok(());
    }
    let allowed = Allowed { low: range.start_bound().cloned(), high: range.end_bound().cloned() };
    Err(RangeError { name: name.into(), value, allowed })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(value: f64, range: impl RangeBounds<f64>) -> String {
        check_range("x", value, range).unwrap_err().to_string()
    }

    #[test]
    fn ends_count_as_the_range_says() {
        assert!(check_range("x", 1.0, 0.0..=1.0).is_ok() && check_range("x", 0.0, 0.0..1.0).is_ok());
        assert_eq!(refused(1.0, 0.0..1.0), "x is 1: it must be at least 0 and less than 1");
        assert_eq!(refused(2.0, 0.0..=1.0), "x is 2: it must be from 0 to 1");
        assert_eq!(refused(0.0, POSITIVE), "x is 0: it must be more than 0");
        assert_eq!(refused(0.0, positive_to(5.0)), "x is 0: it must be more than 0 and at most 5");
        assert_eq!(refused(0.0, 1.0..), "x is 0: it must be at least 1");
        assert_eq!(refused(3.0, ..=2.0), "x is 3: it must be at most 2");
    }

    #[test]
    fn no_range_has_nan_or_infinity() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(refused(value, ..).ends_with("it must be a finite number"));
            assert!(check_range("x", value, 0.0..).is_err());
        }
    }
}
