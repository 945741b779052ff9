//! Checks of settings against their ranges, with one message for all devices.

/// A setting is outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} is {value}: set it to {} {highest}", from(*.lowest))]
pub struct SettingError {
    /// Its name in the file, as `arm.servo_hz`.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Smallest allowed value; [`POSITIVE`] for any number above 0.
    pub lowest: f64,
    /// Largest allowed value.
    pub highest: f64,
}

/// As the lowest value of a range: any number above 0.
pub const POSITIVE: f64 = f64::MIN_POSITIVE;
/// Longest time that a setting may be, s.
pub const DAY_SECS: f64 = 86_400.0;

fn from(lowest: f64) -> String {
    if lowest == POSITIVE { "more than 0 and at most".to_string() } else { format!("{lowest} to") }
}

/// Checks that a value lies in its range, ends included. NaN lies in none.
///
/// # Errors
/// If it does not.
pub fn check_range(
    name: impl Into<String>,
    value: f64,
    lowest: f64,
    highest: f64,
) -> Result<(), SettingError> {
    if (lowest..=highest).contains(&value) {
        return Ok(());
    }
    Err(SettingError { name: name.into(), value, lowest, highest })
}
