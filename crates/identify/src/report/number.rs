//! Numbers and units in a report: four digits, milliradians and millimetres.

use etude_stage::RAIL;

/// Powers of ten that are printed without an exponent.
const PLAIN: std::ops::Range<i32> = -3..6;

/// Four significant digits without trailing zeros; `∞` for infinity and `–` for NaN.
pub(super) fn number(value: f64) -> String {
    if value.is_nan() {
        return "–".to_string();
    }
    if value.is_infinite() {
        return if value > 0.0 { "∞" } else { "-∞" }.to_string();
    }
    // Rounded first: 0.99999 has the power of ten of 1.
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    if rounded == 0.0 {
        return "0".to_string();
    }
    let power = rounded.abs().log10().floor() as i32;
    if PLAIN.contains(&power) { format!("{rounded}") } else { format!("{rounded:e}") }
}

/// A share of the whole as whole per cent.
pub(super) fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.0} %", 100.0 * share) } else { "–".to_string() }
}

/// How many times smaller an error has become.
pub(super) fn factor([before, after]: [f64; 2]) -> String {
    match (before.is_finite(), after.is_finite()) {
        (true, true) if after > 0.0 => number(before / after),
        (_, false) => "diverged".to_string(),
        _ => "∞".to_string(),
    }
}

/// Two digits, for prose.
pub(super) fn about(value: f64) -> String {
    format!("{value:.1e}").parse().map_or_else(|_| number(value), number)
}

/// An error of a joint, rad or m, in mrad or mm.
pub(super) fn milli(error: f64) -> String {
    if error.is_infinite() { "diverged".to_string() } else { number(1e3 * error) }
}

/// The unit that [`milli`] gives a joint's errors.
pub(super) fn milli_unit(joint: usize) -> &'static str {
    if joint == RAIL { "mm" } else { "mrad" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (0.005, "0.005"),
            (29_439.89, "29440"),
            (1366.58, "1367"),
            (0.99999, "1"),
            (-2.5, "-2.5"),
            (100.0, "100"),
            (6.25e-5, "6.25e-5"),
            (33_333_333.3, "3.333e7"),
            (f64::INFINITY, "∞"),
            (f64::NAN, "–"),
        ] {
            assert_eq!(number(value), text, "{value}");
        }
        assert_eq!([about(18.22), about(7.715), about(f64::INFINITY)], ["18", "7.7", "∞"]);
        assert_eq!(milli(f64::INFINITY), "diverged");
        assert_eq!(factor([0.4, 0.1]), "4");
        assert_eq!(factor([0.4, f64::INFINITY]), "diverged");
        assert_eq!(factor([f64::INFINITY, 0.1]), "∞");
    }

    proptest! {
        #[test]
        fn what_is_printed_is_the_number(value in proptest::num::f64::NORMAL) {
            let back: f64 = number(value).parse().unwrap();
            prop_assert!(value.abs() > 1e307 || (back - value).abs() <= 6e-4 * value.abs(), "{back}");
        }
    }
}
