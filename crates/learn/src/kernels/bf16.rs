//! Matrix products of numbers rounded to bfloat16, summed in `f32`: AVX-512's `vdpbf16ps` does two
//! multiplications and two additions where the `f32` instruction does one of each, so a product
//! takes about half the time.
//!
//! Operands are rounded and packed afresh for every product, which is a tenth of its work. Two
//! neighbours along the inner dimension share 32 bits, the first one in the lower half. Sizes are
//! multiples of 32, so that no vector and no tile is cut off.
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
        let room = || Buffer::new(rows.max(widest) * widest);
        available().then(|| Self { left: room(), right: room(), unturned: room() })
    }

    /// `out = a b`. Shapes that the kernel does not take (not both operands transposed, sizes that
    /// are multiples of 32) are multiplied in `f32`.
    pub(crate) fn product(&mut self, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
        #[cfg(target_arch = "x86_64")]
        if [a.shape().0, a.shape().1, b.shape().1].iter().all(|size| size.is_multiple_of(32))
            && !(a.transposed && b.transposed)
        {
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

    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
    pub(super) fn product(room: &mut Bf16Products, out: &mut [f32], a: Matrix<'_>, b: Matrix<'_>) {
        let ((m, k), (inner, n)) = (a.shape(), b.shape());
        assert!(k == inner && out.len() == m * n);
        let pairs = k / 2;
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
            let whole = (n - column) / LANES >= COLUMNS;
            if whole {
                strips.strip::<COLUMNS>(column, m, out);
            } else {
                strips.strip::<2>(column, m, out);
            }
            column += LANES * if whole { COLUMNS } else { 2 };
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
                let whole = m - i >= ROWS;
                if whole {
                    self.tile::<ROWS, C>(i, column, out);
                } else {
                    self.tile::<2, C>(i, column, out);
                }
                i += if whole { ROWS } else { 2 };
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
        for (index, packed) in packed.chunks_exact_mut(matrix.columns / 2).enumerate() {
            let values = matrix.row(index).as_chunks::<{ 2 * LANES }>().0;
            for (values, packed) in values.iter().zip(packed.as_chunks_mut::<LANES>().0) {
                let (low, high) = values.split_at(LANES);
                // SAFETY: the two halves and the result are as long as a register.
                unsafe {
                    let (low, high) = (_mm512_loadu_ps(low.as_ptr()), _mm512_loadu_ps(high.as_ptr()));
                    let both = _mm512_castsi512_ps(bits(_mm512_cvtne2ps_pbh(high, low)));
                    _mm512_storeu_ps(packed.as_mut_ptr(), both);
                }
            }
        }
    }

    /// Pairs across two neighbouring rows of the stored matrix.
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,avx512bf16")]
    fn interleave(matrix: &Matrix<'_>, packed: &mut [f32]) {
        for (index, packed) in packed.chunks_exact_mut(matrix.columns).enumerate() {
            let [firsts, seconds] =
                [2 * index, 2 * index + 1].map(|row| matrix.row(row).as_chunks::<LANES>().0);
            let packed = packed.as_chunks_mut::<LANES>().0;
            for ((first, second), packed) in firsts.iter().zip(seconds).zip(packed) {
                // SAFETY: all three are as long as a register.
                unsafe {
                    let low = widened(_mm512_loadu_ps(first.as_ptr()));
                    let high = _mm512_slli_epi32::<16>(widened(_mm512_loadu_ps(second.as_ptr())));
                    _mm512_storeu_ps(packed.as_mut_ptr(), _mm512_castsi512_ps(_mm512_or_si512(low, high)));
                }
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
            [(32, 32, 32), (64, 32, 96), (96, 160, 32), (32, 64, 160), (256, 128, 128), (128, 256, 128)]
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
        let Some(mut products) = products_or_skip(32, 32) else { return };
        let mut a = vec![1.0; 32 * 32];
        a[33] = f32::from_bits(0x7f80_0001);
        let mut out = vec![0.0; 32 * 32];
        products.product(&mut out, Matrix::new(&a, 32, 32), Matrix::new(&[1.0; 32 * 32], 32, 32));
        assert!(out[32].is_nan() && out[0] == 32.0);
    }
}
