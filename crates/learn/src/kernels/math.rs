//! Exponential, logistic, hyperbolic tangent and logarithm as straight-line polynomials, so that
//! loops over them vectorise. Relative error is a few units in the last place, checked against the
//! standard library below.
#![allow(unsafe_code)] // Calls of the copies that `kernel!` compiles for wider vectors.

use super::{fma, kernel};

/// Adding 1.5 * 2^23 rounds to an integer and leaves it in the low mantissa bits.
const ROUND: f32 = 12_582_912.0;

/// `e^x`; inputs are clamped to the range in which the result and its inverse are normal numbers.
#[inline(always)]
pub(super) fn exp<const FMA: bool>(x: f32) -> f32 {
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.0, 87.0);
    let shifted = fma::<FMA>(x, std::f32::consts::LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = fma::<FMA>(n, -LN2_LOW, fma::<FMA>(n, -LN2_HIGH, x));
    // Taylor to r^7 on |r| <= ln(2)/2: truncation below 1e-8.
    let mut p = 1.0 / 5040.0;
    for c in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        p = fma::<FMA>(p, r, c);
    }
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// `1 / (1 + 2^-y)`, which is the logistic function of `y ln 2`. In base 2 the range reduction is a
/// single subtraction.
#[inline(always)]
pub(super) fn logistic_base_2<const FMA: bool>(y: f32) -> f32 {
    let x = (-y).clamp(-125.0, 125.0);
    let shifted = x + ROUND;
    let f = x - (shifted - ROUND);
    // 2^f on |f| <= 1/2, least worst relative error (1.4e-7), fitted by reweighted least squares at
    // Chebyshev nodes.
    let mut p = 1.327_647_2e-3;
    for c in [9.675_541e-3, 5.550_713e-2, 2.402_212e-1, 6.931_469_4e-1, 1.0] {
        p = fma::<FMA>(p, f, c);
    }
    1.0 / (1.0 + f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23)))
}

/// `tanh x`: odd polynomial near zero (Cephes `tanhf`), exponential elsewhere.
#[inline(always)]
pub(super) fn tanh<const FMA: bool>(x: f32) -> f32 {
    let a = x.abs();
    let far = 1.0 - 2.0 / (1.0 + exp::<FMA>(2.0 * a));
    let z = x * x;
    let mut p = -5.704_988_7e-3;
    for c in [2.063_909e-2, -5.373_971_6e-2, 1.333_144_2e-1, -3.333_328e-1] {
        p = fma::<FMA>(p, z, c);
    }
    let near = fma::<FMA>(p * z, x, x);
    if a < 0.625 { near } else { far.copysign(x) }
}

/// `ln(1 + y)` for `0 <= y <= 1`, from the series of `2 artanh(y / (2 + y))`.
#[inline(always)]
fn ln_1p<const FMA: bool>(y: f32) -> f32 {
    let z = y / (2.0 + y);
    let z2 = z * z;
    let mut p = 1.0 / 15.0;
    for c in [1.0 / 13.0, 1.0 / 11.0, 1.0 / 9.0, 1.0 / 7.0, 1.0 / 5.0, 1.0 / 3.0, 1.0] {
        p = fma::<FMA>(p, z2, c);
    }
    2.0 * z * p
}

kernel! {
    /// Replaces each value by its exponential.
    fn exp_in_place(values: &mut [f32]) {
        for value in values {
            *value = exp::<FMA>(*value);
        }
    }
}

kernel! {
    /// Squashes `u` into `action = tanh u` and writes `log_slope = ln(1 - tanh² u)`, the change of
    /// log-density.
    ///
    /// `ln(1 - tanh² u) = 2 (ln 2 - |u| - ln(1 + e^(-2|u|)))`, which does not cancel for large `u`.
    fn squash(u: &[f32], action: &mut [f32], log_slope: &mut [f32]) {
        for ((&u, action), log_slope) in u.iter().zip(action).zip(log_slope) {
            let a = u.abs();
            *action = tanh::<FMA>(u);
            *log_slope = 2.0 * (std::f32::consts::LN_2 - a - ln_1p::<FMA>(exp::<FMA>(-2.0 * a)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn worst(range: std::ops::Range<f64>, ours: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64) -> f64 {
        (0..200_000)
            .map(|i| (range.start + (range.end - range.start) * f64::from(i) / 200_000.0) as f32)
            .map(|x| {
                let exact = exact(f64::from(x));
                (f64::from(ours(x)) - exact).abs() / exact.abs().max(1e-30)
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn functions_match_the_standard_library() {
        assert!(worst(-80.0..80.0, exp::<true>, f64::exp) < 3e-7);
        assert!(worst(-80.0..80.0, exp::<false>, f64::exp) < 3e-7);
        assert!(worst(-20.0..20.0, logistic_base_2::<true>, |x| 1.0 / (1.0 + (-x).exp2())) < 4e-7);
        assert!(worst(-12.0..12.0, tanh::<true>, f64::tanh) < 4e-7);
        assert!(worst(-12.0..12.0, tanh::<false>, f64::tanh) < 4e-7);
        assert!(worst(0.0..1.0, ln_1p::<true>, f64::ln_1p) < 4e-7);
    }

    #[test]
    fn extremes_stay_finite() {
        for x in [-1e30, -100.0, 0.0, 100.0, 1e30] {
            let (mut action, mut log_slope) = ([0.0], [0.0]);
            squash(&[x], &mut action, &mut log_slope);
            assert!(action[0].abs() <= 1.0 && log_slope[0].is_finite(), "{x}: {action:?} {log_slope:?}");
        }
        assert_eq!(tanh::<true>(0.0), 0.0);
        assert!(exp::<true>(f32::NAN).is_nan());
    }
}
