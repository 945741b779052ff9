//! Matrix products, on one thread, through the `gemm` crate.
#![allow(unsafe_code)] // `gemm` takes raw pointers; the bounds are checked here.

use super::{LANES, kernel};

/// A row-major matrix view: `rows` x `columns`, rows `stride` values apart.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    values: &'a [f32],
    pub(super) rows: usize,
    pub(super) columns: usize,
    stride: usize,
    pub(super) transposed: bool,
}

impl<'a> Matrix<'a> {
    pub(crate) fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        Self::strided(values, rows, columns, columns)
    }

    /// The first `columns` of rows that are `stride` values apart.
    pub(crate) fn strided(values: &'a [f32], rows: usize, columns: usize, stride: usize) -> Self {
        assert!(columns <= stride && (rows == 0 || (rows - 1) * stride + columns <= values.len()));
        Self { values, rows, columns, stride, transposed: false }
    }

    pub(crate) fn transposed(self) -> Self {
        Self { transposed: !self.transposed, ..self }
    }

    /// Row `index` of the matrix as it is stored.
    pub(super) fn row(&self, index: usize) -> &'a [f32] {
        &self.values[index * self.stride..][..self.columns]
    }

    pub(super) fn shape(&self) -> (usize, usize) {
        if self.transposed { (self.columns, self.rows) } else { (self.rows, self.columns) }
    }

    /// (column stride, row stride) as `gemm` wants them.
    fn strides(&self) -> (isize, isize) {
        let stride = self.stride as isize;
        if self.transposed { (stride, 1) } else { (1, stride) }
    }
}

/// `out = a b`, or `out += a b` when `accumulate`. `out` is row-major and packed.
pub(crate) fn product(out: &mut [f32], accumulate: bool, a: Matrix<'_>, b: Matrix<'_>) {
    let ((m, k), (inner, n)) = (a.shape(), b.shape());
    assert!(k == inner && out.len() == m * n);
    let ((a_column, a_row), (b_column, b_row)) = (a.strides(), b.strides());
    // SAFETY: the three shapes agree and lie inside their slices (asserted here and in `strided`);
    // `out` is borrowed exclusively, so it overlaps neither input.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            out.as_mut_ptr(),
            1,
            n as isize,
            accumulate,
            a.values.as_ptr(),
            a_column,
            a_row,
            b.values.as_ptr(),
            b_column,
            b_row,
            if accumulate { 1.0 } else { 0.0 },
            1.0,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

kernel! {
    /// Adds `row` (`[columns]`) to every row of `matrix` (`[rows, columns]`), of which there may be
    /// one.
    fn add_row(matrix: &mut [f32], row: &[f32]) {
        for values in matrix.chunks_exact_mut(row.len()) {
            for (value, &addend) in values.iter_mut().zip(row) {
                *value += addend;
            }
        }
    }
}

kernel! {
    /// `sums[j] = Σ_i matrix[i, j]`.
    fn column_sums(matrix: &[f32], sums: &mut [f32]) {
        let width = sums.len();
        sums.fill(0.0);
        for start in (0..width).step_by(4 * LANES) {
            let end = width.min(start + 4 * LANES);
            let mut partial = [0.0f32; 4 * LANES];
            for row in matrix.chunks_exact(width) {
                for (sum, &value) in partial.iter_mut().zip(&row[start..end]) {
                    *sum += value;
                }
            }
            sums[start..end].copy_from_slice(&partial[..end - start]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_with_every_transposition() {
        let a: Vec<f32> = (0..6).map(|x| x as f32).collect(); // 2 x 3
        let b: Vec<f32> = (0..12).map(|x| (x * x) as f32).collect(); // 3 x 4
        let exact = |i: usize, j: usize| (0..3).map(|k| a[i * 3 + k] * b[k * 4 + j]).sum::<f32>();
        let a_t: Vec<f32> = (0..6).map(|x| a[(x % 2) * 3 + x / 2]).collect();
        let b_t: Vec<f32> = (0..12).map(|x| b[(x % 3) * 4 + x / 3]).collect();
        let mut out = vec![0.0; 8];
        for a in [Matrix::new(&a, 2, 3), Matrix::new(&a_t, 3, 2).transposed()] {
            for b in [Matrix::new(&b, 3, 4), Matrix::new(&b_t, 4, 3).transposed()] {
                product(&mut out, false, a, b);
                product(&mut out, true, a, b);
                for i in 0..2 {
                    for j in 0..4 {
                        assert_eq!(out[i * 4 + j], 2.0 * exact(i, j));
                    }
                }
            }
        }
    }

    #[test]
    fn sums_and_broadcast() {
        let mut matrix = vec![1.0; 3 * 70];
        add_row(&mut matrix, &(0..70).map(|x| x as f32).collect::<Vec<_>>());
        let mut sums = vec![9.0; 70];
        column_sums(&matrix, &mut sums);
        assert!(sums.iter().enumerate().all(|(j, &sum)| sum == 3.0 * (j as f32 + 1.0)));
    }
}
