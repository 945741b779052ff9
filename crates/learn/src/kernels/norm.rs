//! A critic's hidden layer after its matrix product, fused: bias, dropout, LayerNorm, GELU, forward
//! and backward.
//!
//! The order (dropout before LayerNorm) is that of Hiraoka et al. 2022, arXiv 2110.02034. The
//! forward pass keeps what the backward pass needs (normalised values, slopes, one deviation a
//! row), so that values go through the first cache once in each direction.
#![allow(unsafe_code)] // Calls of the copies that `kernel!` compiles for wider vectors.

use super::{
    fma,
    gelu::gelu,
    kernel,
    reduce::{dot, sum},
};

/// Added to the variance before its root; the default of flax's `LayerNorm`.
const EPSILON: f32 = 1e-6;

kernel! {
    /// `values = gelu(scale * normalise(dropout(values + bias)) + shift)` for `[rows, width]`
    /// values, a matrix product.
    ///
    /// `bias`, `scale` and `shift` are `[width]`. `drops` holds the positions `row * width + unit`
    /// of dropped units, ascending; kept units are multiplied by `keep_scale`, `1 / (1 - rate)`.
    /// `normalised` and `slope` (`[rows, width]`) and `inverse_deviation` (`[rows]`) are for the
    /// backward pass; all three are empty when no gradient is wanted.
    fn norm_forward(
        values: &mut [f32],
        bias: &[f32],
        scale: &[f32],
        shift: &[f32],
        drops: &[u32],
        keep_scale: f32,
        normalised: &mut [f32],
        slope: &mut [f32],
        inverse_deviation: &mut [f32],
    ) {
        let width = bias.len();
        let (scale, shift) = (&scale[..width], &shift[..width]);
        let per_width = 1.0 / width as f32;
        let keep = !slope.is_empty();
        let mut next_drop = 0;
        for (index, row) in values.chunks_exact_mut(width).enumerate() {
            for (x, &b) in row.iter_mut().zip(bias) {
                *x = (*x + b) * keep_scale;
            }
            let start = index * width;
            while next_drop < drops.len() && (drops[next_drop] as usize) < start + width {
                row[drops[next_drop] as usize - start] = 0.0;
                next_drop += 1;
            }
            let mean = sum::<WIDE>(row) * per_width;
            let variance = dot::<FMA, WIDE>(row, row, mean) * per_width;
            let inverse = 1.0 / (variance + EPSILON).sqrt();
            if keep {
                inverse_deviation[index] = inverse;
                let normalised = &mut normalised[start..start + width];
                let slope = &mut slope[start..start + width];
                for unit in 0..width {
                    let unscaled = (row[unit] - mean) * inverse;
                    normalised[unit] = unscaled;
                    (row[unit], slope[unit]) = gelu::<FMA>(fma::<FMA>(unscaled, scale[unit], shift[unit]));
                }
            } else {
                for ((x, &scale), &shift) in row.iter_mut().zip(scale).zip(shift) {
                    *x = gelu::<FMA>(fma::<FMA>((*x - mean) * inverse, scale, shift)).0;
                }
            }
        }
    }
}

kernel! {
    /// The gradient of [`norm_forward`]: `error` (`[rows, width]`) is that of the activations
    /// before, of the matrix product after.
    ///
    /// `drops` and `keep_scale` are those of the forward pass, `normalised`, `slope` and
    /// `inverse_deviation` are its results. The three gradients (`[width]`) are overwritten; they
    /// are empty when those of the parameters are not wanted.
    fn norm_backward(
        error: &mut [f32],
        scale: &[f32],
        drops: &[u32],
        keep_scale: f32,
        normalised: &[f32],
        slope: &[f32],
        inverse_deviation: &[f32],
        bias_gradient: &mut [f32],
        scale_gradient: &mut [f32],
        shift_gradient: &mut [f32],
    ) {
        let width = scale.len();
        let per_width = 1.0 / width as f32;
        let with_parameters = !bias_gradient.is_empty();
        bias_gradient.fill(0.0);
        scale_gradient.fill(0.0);
        shift_gradient.fill(0.0);
        let mut next_drop = 0;
        for (index, row) in error.chunks_exact_mut(width).enumerate() {
            let start = index * width;
            let normalised = &normalised[start..start + width];
            let slope = &slope[start..start + width];
            if with_parameters {
                let gradients = scale_gradient.iter_mut().zip(&mut *shift_gradient);
                for (((e, &slope), &x), (scale_sum, shift_sum)) in
                    row.iter_mut().zip(slope).zip(normalised).zip(gradients)
                {
                    *e *= slope;
                    *scale_sum = fma::<FMA>(*e, x, *scale_sum);
                    *shift_sum += *e;
                }
                for (e, &scale) in row.iter_mut().zip(scale) {
                    *e *= scale;
                }
            } else {
                for ((e, &slope), &scale) in row.iter_mut().zip(slope).zip(scale) {
                    *e *= slope * scale;
                }
            }
            let mean = sum::<WIDE>(row) * per_width;
            let correlation = dot::<FMA, WIDE>(row, normalised, 0.0) * per_width;
            let factor = inverse_deviation[index] * keep_scale;
            for (e, &x) in row.iter_mut().zip(normalised) {
                *e = factor * (*e - fma::<FMA>(x, correlation, mean));
            }
            while next_drop < drops.len() && (drops[next_drop] as usize) < start + width {
                row[drops[next_drop] as usize - start] = 0.0;
                next_drop += 1;
            }
            if with_parameters {
                for (sum, &e) in bias_gradient.iter_mut().zip(row.iter()) {
                    *sum += e;
                }
            }
        }
    }
}
