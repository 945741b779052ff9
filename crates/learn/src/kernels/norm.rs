//! A critic's hidden layer after its matrix product, fused: bias, dropout, LayerNorm, GELU, and the way back.
//!
//! The order (dropout before LayerNorm) is that of Hiraoka et al. 2022, arXiv 2110.02034. Values go through the first
//! cache once in each direction; what the way back needs (normalised values, slopes, one deviation a row) stays behind.
#![allow(unsafe_code)] // Calls of the copies that `kernel!` compiles for wider vectors.

use super::{
    fma,
    gelu::gelu,
    kernel,
    reduce::{dot, sum},
};

/// Added to the variance before its root; the default of flax's `LayerNorm`.
const EPSILON: f32 = 1e-6;

/// Arguments of [`norm_forward`]. `rows` is the batch, `width` the number of units.
pub(crate) struct NormForward<'a> {
    /// `[rows, width]`: matrix product in; activations out.
    pub values: &'a mut [f32],
    /// `[width]` each.
    pub bias: &'a [f32],
    pub scale: &'a [f32],
    pub shift: &'a [f32],
    /// Positions `row * width + unit` of dropped units, ascending.
    pub drops: &'a [u32],
    /// What kept units are multiplied by: `1 / (1 - rate)`.
    pub keep_scale: f32,
    /// `[rows, width]` each and `[rows]`, or all empty when no gradient is wanted.
    pub normalised: &'a mut [f32],
    pub slope: &'a mut [f32],
    pub inverse_deviation: &'a mut [f32],
}

/// Arguments of [`norm_backward`].
pub(crate) struct NormBackward<'a> {
    /// `[rows, width]`: gradient of the activations in; gradient of the matrix product out.
    pub error: &'a mut [f32],
    /// `[width]`.
    pub scale: &'a [f32],
    /// As given to the forward pass.
    pub drops: &'a [u32],
    pub keep_scale: f32,
    /// What the forward pass left.
    pub normalised: &'a [f32],
    pub slope: &'a [f32],
    pub inverse_deviation: &'a [f32],
    /// `[width]` each, overwritten with the parameter gradients; all empty when those are not wanted.
    pub bias_gradient: &'a mut [f32],
    pub scale_gradient: &'a mut [f32],
    pub shift_gradient: &'a mut [f32],
}

/// `gelu(scale * normalise(dropout(values + bias)) + shift)`.
pub(crate) fn norm_forward(arguments: NormForward<'_>) {
    let NormForward { values, bias, scale, shift, drops, keep_scale, normalised, slope, inverse_deviation } =
        arguments;
    forward(values, bias, scale, shift, drops, keep_scale, normalised, slope, inverse_deviation);
}

/// The gradient of [`norm_forward`].
pub(crate) fn norm_backward(arguments: NormBackward<'_>) {
    let NormBackward {
        error,
        scale,
        drops,
        keep_scale,
        normalised,
        slope,
        inverse_deviation,
        bias_gradient,
        scale_gradient,
        shift_gradient,
    } = arguments;
    let [bias, scales, shifts] = [bias_gradient, scale_gradient, shift_gradient];
    backward(error, scale, drops, keep_scale, normalised, slope, inverse_deviation, bias, scales, shifts);
}

// The kernels take slices and not the structs: only of arguments does the compiler know that they do not overlap.
kernel! {
    fn forward(
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
    fn backward(
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
