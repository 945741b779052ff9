//! The part of the first layer that multiplies 0/1 inputs: add up the weight rows of the ones.
//!
//! A dense product would spend 90 % of the first layer on zeros.
#![allow(unsafe_code)] // Calls of the copies that `kernel!` compiles for wider vectors.

use super::{LANES, kernel};

/// Columns that are summed at a time, in eight AVX-512 registers.
const BLOCK: usize = 8 * LANES;

kernel! {
    /// `out[r] = Σ_{i in ones of row r} weights[i]`.
    ///
    /// `weights` is `[inputs, width]`, `out` is `[rows, width]`; the ones of row `r` are
    /// `ones[offsets[r]..offsets[r + 1]]`.
    fn gather_rows(weights: &[f32], width: usize, offsets: &[u32], ones: &[u32], out: &mut [f32]) {
        for (row, bounds) in out.chunks_exact_mut(width).zip(offsets.windows(2)) {
            let ones = &ones[bounds[0] as usize..bounds[1] as usize];
            let mut blocks = row.chunks_exact_mut(BLOCK);
            let mut start = 0;
            for block in &mut blocks {
                let mut sum = [0.0f32; BLOCK];
                for &one in ones {
                    let from = one as usize * width + start;
                    for (sum, &weight) in sum.iter_mut().zip(&weights[from..from + BLOCK]) {
                        *sum += weight;
                    }
                }
                for (to, &sum) in block.iter_mut().zip(&sum) {
                    *to = sum;
                }
                start += BLOCK;
            }
            let rest = blocks.into_remainder();
            rest.fill(0.0);
            for &one in ones {
                let from = one as usize * width + start;
                for (sum, &weight) in rest.iter_mut().zip(&weights[from..]) {
                    *sum += weight;
                }
            }
        }
    }
}

kernel! {
    /// `gradient[i] = Σ_{rows r in which i is one} error[r]`; the shapes are those of
    /// [`gather_rows`].
    fn scatter_rows(gradient: &mut [f32], width: usize, offsets: &[u32], ones: &[u32], error: &[f32]) {
        gradient.fill(0.0);
        for (row, bounds) in error.chunks_exact(width).zip(offsets.windows(2)) {
            for &one in &ones[bounds[0] as usize..bounds[1] as usize] {
                let from = one as usize * width;
                for (sum, &value) in gradient[from..from + width].iter_mut().zip(row) {
                    *sum += value;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn same_as_a_dense_product_with_zeros_and_ones() {
        for width in [1, 5, 64, 100, 128] {
            let weights: Vec<f32> = (0..7 * width).map(|x| (x as f32 * 0.37).sin()).collect();
            let error: Vec<f32> = (0..3 * width).map(|x| (x as f32 * 0.73).cos()).collect();
            let (offsets, ones) = ([0, 2, 2, 5], [0, 6, 1, 3, 6]);
            let mut dense = [0.0f32; 3 * 7];
            for r in 0..3 {
                for &i in &ones[offsets[r] as usize..offsets[r + 1] as usize] {
                    dense[r * 7 + i as usize] = 1.0;
                }
            }
            let mut out = vec![9.0; 3 * width];
            gather_rows(&weights, width, &offsets, &ones, &mut out);
            let mut gradient = vec![9.0; 7 * width];
            scatter_rows(&mut gradient, width, &offsets, &ones, &error);
            for j in 0..width {
                for r in 0..3 {
                    let exact: f32 = (0..7).map(|i| dense[r * 7 + i] * weights[i * width + j]).sum();
                    assert!((out[r * width + j] - exact).abs() < 1e-6);
                }
                for i in 0..7 {
                    let exact: f32 = (0..3).map(|r| dense[r * 7 + i] * error[r * width + j]).sum();
                    assert!((gradient[i * width + j] - exact).abs() < 1e-6);
                }
            }
        }
    }
}
