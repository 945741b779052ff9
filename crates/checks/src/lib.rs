//! Range checks of settings, with one message for all of them.
//!
//! [`settings!`] makes a structure of settings from one row each: name, type, default, range.
//! [`check_range`] checks what depends on other settings.
//!
//! ```
//! use etude_checks::{check_range, settings};
//!
//! settings! {
//!     /// What can be set of a lamp.
//!     pub struct LampConfig("lamp") {
//!         /// Brightness, as a share.
//!         pub brightness: f64 = 0.5, 0.0..=1.0;
//!         /// Where it hangs.
//!         pub place: String = "hall".into();
//!     }
//! }
//!
//! let lamp = LampConfig { brightness: 1.5, ..LampConfig::default() };
//! assert!(LampConfig::default().check_ranges().is_ok());
//! let error = lamp.check_ranges().unwrap_err();
//! assert_eq!(error.to_string(), "lamp.brightness is 1.5: it must be from 0 to 1");
//! assert!(check_range("lamp.height_m", 2.6, 1.0..lamp.brightness + 1.0).is_err());
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

/// A setting with a range: a number, or several numbers in the same one.
pub trait Numbers {
    /// Checks each number.
    ///
    /// # Errors
    /// Names the first that is not in `range`.
    fn check(&self, name: &str, range: &impl RangeBounds<f64>) -> Result<(), RangeError>;
}

macro_rules! numbers {
    ($($number:ty)*) => {
        $(impl Numbers for $number {
            fn check(&self, name: &str, range: &impl RangeBounds<f64>) -> Result<(), RangeError> {
                check_range(name, *self as f64, (range.start_bound().cloned(), range.end_bound().cloned()))
            }
        })*
    };
}

numbers! { f64 u8 u16 u64 }

impl<T: Numbers> Numbers for Option<T> {
    fn check(&self, name: &str, range: &impl RangeBounds<f64>) -> Result<(), RangeError> {
        self.as_ref().map_or(Ok(()), |number| number.check(name, range))
    }
}

impl<T: Numbers, const N: usize> Numbers for [T; N] {
    fn check(&self, name: &str, range: &impl RangeBounds<f64>) -> Result<(), RangeError> {
        let mut numbers = self.iter().enumerate();
        numbers.try_for_each(|(index, number)| number.check(&format!("{name}[{index}]"), range))
    }
}

/// Makes a structure of settings, its `Default`, and `check_ranges`. Each row is a field, its
/// default and, if it is a [number](Numbers), its range. The literal behind the structure's name is
/// what the paths of its settings begin with; without one, no setting has a range.
#[macro_export]
macro_rules! settings {
    (
        $(#[$about:meta])*
        $vis:vis struct $name:ident($prefix:literal) {
            $($(#[$doc:meta])* $field_vis:vis $field:ident: $type:ty = $default:expr $(, $range:expr)?;)*
        }
    ) => {
        $crate::settings! {
            $(#[$about])*
            $vis struct $name { $($(#[$doc])* $field_vis $field: $type = $default;)* }
        }

        impl $name {
            /// Checks each setting that has a range of its own.
            ///
            /// # Errors
            /// Names the first one that is not in its range.
            $vis fn check_ranges(&self) -> Result<(), $crate::RangeError> {
                $($($crate::Numbers::check(&self.$field, concat!($prefix, ".", stringify!($field)), &($range))?;)?)*
                Ok(())
            }
        }
    };
    (
        $(#[$about:meta])*
        $vis:vis struct $name:ident {
            $($(#[$doc:meta])* $field_vis:vis $field:ident: $type:ty = $default:expr;)*
        }
    ) => {
        $(#[$about])*
        $vis struct $name { $($(#[$doc])* $field_vis $field: $type,)* }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }
    };
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
