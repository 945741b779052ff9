//! Sums along a row.
//!
//! The result of a floating-point sum depends on its order, so the compiler may not vectorise it,
//! and its code for interleaved sums takes twice as long as the rest of LayerNorm. So there are
//! intrinsics for AVX-512; elsewhere sixteen interleaved sums.
#![allow(unsafe_code)] // Vector loads inside slices of known length.

use super::{LANES, fma};

/// Σ values.
#[inline(always)]
pub(super) fn sum<const WIDE: bool>(values: &[f32]) -> f32 {
    #[cfg(target_arch = "x86_64")]
    if WIDE {
        // SAFETY: `WIDE` is set only in the copies of kernels that are compiled for, and run on,
        // AVX-512.
        return unsafe { wide::sum(values) };
    }
    let mut partial = [0.0f32; LANES];
    let (chunks, rest) = values.as_chunks::<LANES>();
    for chunk in chunks {
        for (sum, &value) in partial.iter_mut().zip(chunk) {
            *sum += value;
        }
    }
    total(partial) + rest.iter().sum::<f32>()
}

/// Σ (aᵢ - shift) (bᵢ - shift), over two equally long rows.
#[inline(always)]
pub(super) fn dot<const FMA: bool, const WIDE: bool>(a: &[f32], b: &[f32], shift: f32) -> f32 {
    assert!(a.len() == b.len());
    #[cfg(target_arch = "x86_64")]
    if WIDE {
        // SAFETY: as above.
        return unsafe { wide::dot(a, b, shift) };
    }
    let mut partial = [0.0f32; LANES];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for ((sum, &a), &b) in partial.iter_mut().zip(a).zip(b) {
            *sum = fma::<FMA>(a - shift, b - shift, *sum);
        }
    }
    total(partial) + a_rest.iter().zip(b_rest).map(|(a, b)| (a - shift) * (b - shift)).sum::<f32>()
}

#[inline(always)]
fn total(mut partial: [f32; LANES]) -> f32 {
    let mut half = LANES / 2;
    while half > 0 {
        for lane in 0..half {
            partial[lane] += partial[lane + half];
        }
        half /= 2;
    }
    partial[0]
}

#[cfg(target_arch = "x86_64")]
mod wide {
    use std::arch::x86_64::{
        __m512, _mm512_add_ps, _mm512_fmadd_ps, _mm512_loadu_ps, _mm512_reduce_add_ps, _mm512_set1_ps,
        _mm512_setzero_ps, _mm512_sub_ps,
    };

    use super::LANES;

    #[inline]
    #[target_feature(enable = "avx512f")]
    fn load(chunk: &[f32; LANES]) -> __m512 {
        // SAFETY: the chunk is as long as the register.
        unsafe { _mm512_loadu_ps(chunk.as_ptr()) }
    }

    #[inline]
    #[target_feature(enable = "avx512f")]
    pub(super) fn sum(values: &[f32]) -> f32 {
        // Two sums in turn, since an addition takes longer than the next one has to wait for a
        // load.
        let (mut even, mut odd) = (_mm512_setzero_ps(), _mm512_setzero_ps());
        let (chunks, rest) = values.as_chunks::<LANES>();
        let (pairs, last) = chunks.as_chunks::<2>();
        for [a, b] in pairs {
            even = _mm512_add_ps(even, load(a));
            odd = _mm512_add_ps(odd, load(b));
        }
        for chunk in last {
            even = _mm512_add_ps(even, load(chunk));
        }
        _mm512_reduce_add_ps(_mm512_add_ps(even, odd)) + rest.iter().sum::<f32>()
    }

    #[inline]
    #[target_feature(enable = "avx512f")]
    pub(super) fn dot(a: &[f32], b: &[f32], shift: f32) -> f32 {
        let shifts = _mm512_set1_ps(shift);
        let (mut even, mut odd) = (_mm512_setzero_ps(), _mm512_setzero_ps());
        let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
        let ((a, a_last), (b, b_last)) = (a.as_chunks::<2>(), b.as_chunks::<2>());
        for ([a0, a1], [b0, b1]) in a.iter().zip(b) {
            let (a0, b0) = (_mm512_sub_ps(load(a0), shifts), _mm512_sub_ps(load(b0), shifts));
            let (a1, b1) = (_mm512_sub_ps(load(a1), shifts), _mm512_sub_ps(load(b1), shifts));
            even = _mm512_fmadd_ps(a0, b0, even);
            odd = _mm512_fmadd_ps(a1, b1, odd);
        }
        for (a, b) in a_last.iter().zip(b_last) {
            even = _mm512_fmadd_ps(_mm512_sub_ps(load(a), shifts), _mm512_sub_ps(load(b), shifts), even);
        }
        let rest = a_rest.iter().zip(b_rest).map(|(a, b)| (a - shift) * (b - shift)).sum::<f32>();
        _mm512_reduce_add_ps(_mm512_add_ps(even, odd)) + rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::kernel;

    kernel! {
        fn both(a: &[f32], b: &[f32], shift: f32, out: &mut [f32; 2]) {
            *out = [sum::<WIDE>(a), dot::<FMA, WIDE>(a, b, shift)];
        }
    }

    #[test]
    fn every_length_and_every_copy_agree_with_double_precision() {
        for len in (0..70).chain([96, 128, 200, 256]) {
            let a: Vec<f32> = (0..len).map(|i| (i as f32 * 0.7).sin()).collect();
            let b: Vec<f32> = (0..len).map(|i| (i as f32 * 1.3).cos()).collect();
            let exact_sum: f64 = a.iter().map(|&a| f64::from(a)).sum();
            let exact_dot: f64 =
                a.iter().zip(&b).map(|(&a, &b)| f64::from(a - 0.3) * f64::from(b - 0.3)).sum();
            let mut chosen = [0.0; 2];
            both(&a, &b, 0.3, &mut chosen);
            let plain = [sum::<false>(&a), dot::<false, false>(&a, &b, 0.3)];
            for [sum, dot] in [chosen, plain] {
                assert!(
                    (f64::from(sum) - exact_sum).abs() < 1e-5 && (f64::from(dot) - exact_dot).abs() < 2e-5
                );
            }
        }
    }
}
