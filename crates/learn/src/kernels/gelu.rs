//! The activation: GELU in its tanh form (Hendrycks and Gimpel 2016; the default of flax), written
//! as `x · logistic(2u)` with `u = √(2/π) (x + 0.044715 x³)`, which is the same function and one
//! division.
//!
//! The forward pass also computes the slope, from the same exponential; the backward pass is then
//! one multiplication.
#![allow(unsafe_code)] // Calls of the copies that `kernel!` compiles for wider vectors.

use super::{fma, kernel, math::logistic_base_2};

/// 2 √(2/π).
const LINEAR: f32 = 1.595_769;
/// 2 √(2/π) · 0.044715.
const CUBIC: f32 = 0.071_354_816;
const LOG2_E: f32 = std::f32::consts::LOG2_E;

/// (value, slope) at `x`.
#[inline(always)]
pub(super) fn gelu<const FMA: bool>(x: f32) -> (f32, f32) {
    let square = x * x;
    let gate = logistic_base_2::<FMA>(x * fma::<FMA>(CUBIC * LOG2_E, square, LINEAR * LOG2_E));
    let value = x * gate;
    let twice_u_slope = fma::<FMA>(3.0 * CUBIC, square, LINEAR);
    (value, fma::<FMA>(fma::<FMA>(-value, gate, value), twice_u_slope, gate))
}

kernel! {
    /// `values = gelu(values + bias)` for `[rows, width]` values and `[width]` bias; `slope` (same
    /// shape, or empty when no gradient is wanted) receives the derivative.
    fn bias_gelu(values: &mut [f32], bias: &[f32], slope: &mut [f32]) {
        let width = bias.len();
        if slope.is_empty() {
            for row in values.chunks_exact_mut(width) {
                for (x, &b) in row.iter_mut().zip(bias) {
                    *x = gelu::<FMA>(*x + b).0;
                }
            }
        } else {
            for (row, slope) in values.chunks_exact_mut(width).zip(slope.chunks_exact_mut(width)) {
                for ((x, &b), slope) in row.iter_mut().zip(bias).zip(slope) {
                    (*x, *slope) = gelu::<FMA>(*x + b);
                }
            }
        }
    }
}

kernel! {
    /// `values *= factors`.
    fn multiply(values: &mut [f32], factors: &[f32]) {
        for (value, &factor) in values.iter_mut().zip(factors) {
            *value *= factor;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn value_is_the_published_formula_and_slope_is_its_derivative() {
        let exact = |x: f64| {
            let u = (2.0 / std::f64::consts::PI).sqrt() * (x + 0.044_715 * x * x * x);
            0.5 * x * (1.0 + u.tanh())
        };
        for i in -600..=600 {
            let x = f64::from(i) / 100.0;
            let (value, slope) = gelu::<true>(x as f32);
            assert!((f64::from(value) - exact(x)).abs() < 1e-6 * x.abs().max(1e-3), "{x}");
            let numeric = (exact(x + 1e-5) - exact(x - 1e-5)) / 2e-5;
            assert!((f64::from(slope) - numeric).abs() < 2e-6, "{x}: {slope} {numeric}");
        }
        let (mut far, mut slope) = ([-1e5, 1e5], [0.0; 2]);
        bias_gelu(&mut far, &[0.0, 0.0], &mut slope);
        assert!(far[0].abs() < 1e-30 && far[1] == 1e5 && slope[0].abs() < 1e-20 && slope[1] == 1.0);
    }
}
