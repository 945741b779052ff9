//! Matrix products of numbers rounded to bfloat16, summed in `f32`: AVX-512's `vdpbf16ps` does two
//! multiplications and two additions where the `f32` instruction does one of each, so a product
//! takes about half the time.
//!
//! Operands are rounded and packed afresh for every product, which is a tenth of its work. Two
//! neighbours along the inner dimension share 32 bits, the first one in the lower half; where that
//! dimension is odd, the last pair ends in a zero.
#![allow(unsafe_code)] // Intrinsics and raw pointers; the bounds are asserted where the pointers are made.

use super::{Matrix, product};
use crate::buffer::Buffer;

/// Room for the packed operands of one product after another. Exists only where the processor has
/// the instruction.
#[derive(Clone)]
pub(crate) struct Bf16Products {
    left: Buffer,
    right: Buffer,
    /// The right operand before it is turned.
    unturned: Buffer,
}

impl Bf16Products {
    /// Room for operands with at most `rows` rows or columns one way and `widest` the other, or
    /// `widest` both ways; `None` where the processor lacks the instruction.
    pub(crate) fn new(rows: usize, widest: usize) -> Option<Self> {
        let room = || Buffer::new((rows.max(widest) + 1) * (widest + 1));
        available().then(|| Self { left: room(), right: room(), unturned: room() })
    }

    /// `out = a b`. Shapes that the kernel does not take (not both operands transposed, columns by
    /// sixteens) are multiplied in `f32`.
    pub(crate) fn product(&mut self, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
        #[cfg(target_arch = "x86_64")]
        if b.shape().1.is_multiple_of(16) && !(a.transposed && b.transposed) {
            // SAFETY: `new` makes a value only where the processor has what the function is
            // compiled for.
            return unsafe { wide::product(self, out, a, b) };
        }
        product(out, false, a, b);
    }
}

/// Whether this processor has such products; without them all is computed in f32.
pub fn available() -> bool {
    #[cfg(target_arch = "x86_64")]
    let found = super::level() == super::Level::Avx512 && std::arch::is_x86_feature_detected!("avx512bf16");
    #[cfg(not(target_arch = "x86_64"))]
    let found = false;
    found
}

#[cfg(target_arch = "x86_64")]
mod wide {
    use std::arch::x86_64::{
        __m256bh, __m256i, __m512, __m512bh, __m512i, _mm512_castsi512_ps, _mm512_cvtepu16_epi32,
        _mm512_cvtne2ps_pbh, _mm512_cvtneps_pbh, _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_or_si512,
        _mm512_set1_ps, _mm512_setzero_ps, _mm512_slli_epi32, _mm512_storeu_ps,
    };

    use super::{super::LANES, Bf16Products, Matrix};

    /// Rows and sixteens of columns of one tile: its sums, its columns and one broadcast fill the
    /// 32 registers.
    const ROWS: usize = 6;
    const COLUMNS: usize = 4;

    fn bits(pairs: __m512bh) -> __m512i {
        // SAFETY: both are 512 bits without meaning of their own.
        unsafe { std::mem::transmute(pairs) }
    }

    fn pairs(values: __m512) -> __m512bh {
        // SAFETY: as above.
        unsafe { std::mem::transmute(values) }
    }

    /// The upper half of `value`, rounded to nearest, ties to even; not-a-numbers stay such.
    fn round(value: f32) -> u32 {
        let bits = value.to_bits();
        if value.is_nan() { (bits >> 16) | 0x40 } else { (bits + 0x7fff + ((bits >> 16) & 1)) >> 16 }
    }

    fn pair(low: f32, high: f32) -> f32 {
        f32::from_bits(round(low) | (round(high) << 16))
    }

    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
    pub(super) fn product(room: &mut Bf16Products, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
        let ((m, k), (inner, n)) = (a.shape(), b.shape());
        assert!(k == inner && out.len() == m * n);
        let pairs = k.div_ceil(2);
        let left = &mut room.left[..m * pairs];
        let (row, next) = if a.transposed {
            interleave(&a, left);
            (1, m)
        } else {
            shorten(&a, left);
            (pairs, 1)
        };
        let right = &mut room.right[..pairs * n];
        if b.transposed {
            let unturned = &mut room.unturned[..n * pairs];
            shorten(&b, unturned);
            turn(unturned, pairs, right);
        } else {
            interleave(&b, right);
        }
        let strips = Strips { left, row, next, right, pairs, n };
        let mut column = 0;
        while column < n {
            let rest = (n - column) / LANES;
            match rest {
                COLUMNS.. => strips.strip::<COLUMNS>(column, m, out),
                2.. => strips.strip::<2>(column, m, out),
                _ => strips.strip::<1>(column, m, out),
            }
            column += LANES * if rest >= COLUMNS { COLUMNS } else { rest.min(2) };
        }
    }

    /// Packed operands: pair `p` of row `i` of the left one at `i * row + p * next`, of column `j`
    /// of the right one at `p * n + j`.
    struct Strips<'a> {
        left: &'a [f32],
        row: usize,
        next: usize,
        right: &'a [f32],
        pairs: usize,
        n: usize,
    }

    impl Strips<'_> {
        /// `C` sixteens of columns from `column` on, in all `m` rows.
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
        fn strip<const C: usize>(&self, column: usize, m: usize, out: &mut [f32]) {
            let mut i = 0;
            while i < m {
                match m - i {
                    ROWS.. => self.tile::<ROWS, C>(i, column, out),
                    2.. => self.tile::<2, C>(i, column, out),
                    _ => self.tile::<1, C>(i, column, out),
                }
                i += if m - i >= ROWS { ROWS } else { (m - i).min(2) };
            }
        }

        #[inline]
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
        fn tile<const R: usize, const C: usize>(&self, i: usize, column: usize, out: &mut [f32]) {
            let Self { left, row, next, right, pairs: count, n } = *self;
            assert!(count > 0 && column + C * LANES <= n);
            assert!((i + R - 1) * row + (count - 1) * next < left.len() && count * n <= right.len());
            assert!((i + R) * n <= out.len());
            let mut sums = [[_mm512_setzero_ps(); C]; R];
            // SAFETY: the three assertions bound every address below.
            unsafe {
                let (left, right) = (left.as_ptr().add(i * row), right.as_ptr().add(column));
                for p in 0..count {
                    let mut columns = [pairs(_mm512_setzero_ps()); C];
                    for (c, columns) in columns.iter_mut().enumerate() {
                        *columns = pairs(_mm512_loadu_ps(right.add(p * n + c * LANES)));
                    }
                    for (r, sums) in sums.iter_mut().enumerate() {
                        let value = pairs(_mm512_set1_ps(*left.add(r * row + p * next)));
                        for (sum, &columns) in sums.iter_mut().zip(&columns) {
                            *sum = _mm512_dpbf16_ps(*sum, value, columns);
                        }
                    }
                }
                let out = out.as_mut_ptr().add(i * n + column);
                for (r, sums) in sums.iter().enumerate() {
                    for (c, &sum) in sums.iter().enumerate() {
                        _mm512_storeu_ps(out.add(r * n + c * LANES), sum);
                    }
                }
            }
        }
    }

    /// Pairs within the rows of the stored matrix, row after row.
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
    fn shorten(matrix: &Matrix<'_>, packed: &mut [f32]) {
        let width = matrix.columns.div_ceil(2);
        for (index, packed) in packed.chunks_exact_mut(width).enumerate() {
            let row = matrix.row(index);
            let (wide, rest) = row.as_chunks::<{ 2 * LANES }>();
            let (packed, packed_rest) = packed.as_chunks_mut::<LANES>();
            for (values, packed) in wide.iter().zip(&mut *packed) {
                let (low, high) = values.split_at(LANES);
                // SAFETY: the two halves and the result are as long as a register.
                unsafe {
                    let (low, high) = (_mm512_loadu_ps(low.as_ptr()), _mm512_loadu_ps(high.as_ptr()));
                    let both = _mm512_castsi512_ps(bits(_mm512_cvtne2ps_pbh(high, low)));
                    _mm512_storeu_ps(packed.as_mut_ptr(), both);
                }
            }
            let packed_rest = packed[wide.len()..].as_flattened_mut().iter_mut().chain(packed_rest);
            for (values, packed) in rest.chunks(2).zip(packed_rest) {
                *packed = pair(values[0], values.get(1).copied().unwrap_or(0.0));
            }
        }
    }

    /// Pairs across two neighbouring rows of the stored matrix.
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
    fn interleave(matrix: &Matrix<'_>, packed: &mut [f32]) {
        let width = matrix.columns;
        for (index, packed) in packed.chunks_exact_mut(width).enumerate() {
            let first = matrix.row(2 * index);
            // Without a second row, the first stands in and its half is cleared below.
            let alone = 2 * index + 1 == matrix.rows;
            let second = if alone { first } else { matrix.row(2 * index + 1) };
            let ((firsts, first_rest), (seconds, second_rest)) =
                (first.as_chunks::<LANES>(), second.as_chunks::<LANES>());
            let (packed, packed_rest) = packed.as_chunks_mut::<LANES>();
            for ((first, second), packed) in firsts.iter().zip(seconds).zip(packed) {
                // SAFETY: all three are as long as a register.
                unsafe {
                    let low = widened(_mm512_loadu_ps(first.as_ptr()));
                    let high = _mm512_slli_epi32::<16>(widened(_mm512_loadu_ps(second.as_ptr())));
                    let both = if alone { low } else { _mm512_or_si512(low, high) };
                    _mm512_storeu_ps(packed.as_mut_ptr(), _mm512_castsi512_ps(both));
                }
            }
            for ((&first, &second), packed) in first_rest.iter().zip(second_rest).zip(packed_rest) {
                *packed = pair(first, if alone { 0.0 } else { second });
            }
        }
    }

    /// Sixteen values rounded, each in the lower half of 32 bits.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
    fn widened(values: __m512) -> __m512i {
        let short = _mm512_cvtneps_pbh(values);
        // SAFETY: both are 256 bits without meaning of their own.
        _mm512_cvtepu16_epi32(unsafe { std::mem::transmute::<__m256bh, __m256i>(short) })
    }

    /// `turned[p, j] = values[j, p]`, for rows of `pairs`.
    fn turn(values: &[f32], pairs: usize, turned: &mut [f32]) {
        let n = values.len() / pairs;
        for start in (0..n).step_by(LANES) {
            for p in 0..pairs {
                for (j, turned) in turned[p * n + start..][..LANES].iter_mut().enumerate() {
                    *turned = values[(start + j) * pairs + p];
                }
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Products for operands of these sizes. Without the instruction: says that the test is
    /// skipped. It fails where the processor has the instruction and `ETUDE_NEEDS_ALL` is set.
    pub(crate) fn products_or_skip(rows: usize, widest: usize) -> Option<Bf16Products> {
        let products = Bf16Products::new(rows, widest);
        if products.is_none() {
            #[cfg(target_arch = "x86_64")]
            let able = std::arch::is_x86_feature_detected!("avx512bf16");
            #[cfg(not(target_arch = "x86_64"))]
            let able = false;
            let must = able && std::env::var_os("ETUDE_NEEDS_ALL").is_some();
            assert!(!must, "this processor has AVX-512 BF16, but it is not used");
            println!("skipped: products in bfloat16, because this processor has no AVX-512 BF16");
        }
        products
    }

    /// `value` with the 16 lower bits rounded away, ties to even.
    fn rounded(value: f32) -> f64 {
        let bits = value.to_bits();
        f64::from(f32::from_bits((bits + 0x7fff + ((bits >> 16) & 1)) & 0xffff_0000))
    }

    #[test]
    fn products_are_those_of_the_rounded_operands() {
        let value = |i: usize, phase: f32| (i as f32 * 0.37 + phase).sin();
        for (m, k, n) in
            [(1, 1, 16), (2, 3, 16), (7, 5, 32), (13, 64, 48), (64, 33, 80), (256, 128, 128), (128, 256, 128)]
        {
            let Some(mut products) = products_or_skip(m.max(k), m.max(k).max(n)) else { return };
            let a: Vec<f32> = (0..m * k).map(|i| value(i, 0.1)).collect();
            let b: Vec<f32> = (0..k * n).map(|i| value(i, 0.7)).collect();
            let a_turned: Vec<f32> = (0..m * k).map(|i| a[(i % m) * k + i / m]).collect();
            let b_turned: Vec<f32> = (0..k * n).map(|i| b[(i % k) * n + i / k]).collect();
            let operands = [
                (Matrix::new(&a, m, k), Matrix::new(&b, k, n)),
                (Matrix::new(&a, m, k), Matrix::new(&b_turned, n, k).transposed()),
                (Matrix::new(&a_turned, k, m).transposed(), Matrix::new(&b, k, n)),
            ];
            for (form, (left, right)) in operands.into_iter().enumerate() {
                let mut out = vec![9.0; m * n];
                products.product(&mut out, left, right);
                for i in 0..m {
                    for j in 0..n {
                        let exact: f64 = (0..k).map(|x| rounded(a[i * k + x]) * rounded(b[x * n + j])).sum();
                        let found = f64::from(out[i * n + j]);
                        assert!(
                            (found - exact).abs() < 1e-4,
                            "{m} {k} {n} form {form} at {i} {j}: {found} {exact}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn not_a_number_stays_one() {
        let Some(mut products) = products_or_skip(4, 16) else { return };
        let mut a = vec![1.0; 4 * 3];
        a[5] = f32::from_bits(0x7f80_0001);
        let mut out = vec![0.0; 4 * 16];
        products.product(&mut out, Matrix::new(&a, 4, 3), Matrix::new(&[1.0; 48], 3, 16));
        assert!(out[16].is_nan() && out[0] == 3.0);
    }
}
