//! Rows of numbers and a matrix in; every row times the matrix, as columns, out.

use super::simd::{Eight, Width, by_width};

/// Rows that are multiplied before they are turned into columns: both stay in the nearest cache.
const PIECE: usize = 48;
/// Rows that pass through the matrix side by side.
const SIDE: usize = 6;

/// `rows[sample][n] * matrix[n][columns]`, column by column.
pub fn combined(rows: &[f64], n: usize, matrix: &[f64], columns: usize) -> Vec<Vec<f64>> {
    if n == 0 || columns == 0 {
        return vec![Vec::new(); columns];
    }
    let stride = columns.next_multiple_of(8);
    let mut padded = vec![0.0; n * stride];
    padded
        .chunks_exact_mut(stride)
        .zip(matrix.chunks_exact(columns))
        .for_each(|(to, row)| to[..columns].copy_from_slice(row));
    let mut all: Vec<Vec<f64>> = (0..columns).map(|_| Vec::with_capacity(rows.len() / n)).collect();
    let mut piece = vec![0.0; PIECE * stride];
    for rows in rows.chunks(PIECE * n) {
        let made = &mut piece[..rows.len() / n * stride];
        // SAFETY: the width is this machine's.
        unsafe { multiply(Width::detect(), rows, n, &padded, stride, made) };
        for (k, column) in all.iter_mut().enumerate() {
            column.extend(made.chunks_exact(stride).map(|row| row[k]));
        }
    }
    all
}

by_width! {
    /// `out[row][stride] = rows[row][n] * matrix[n][stride]`; `stride` is a multiple of eight.
    fn multiply(rows: &[f64], n: usize, matrix: &[f64], stride: usize, out: &mut [f64]) = multiply_body
}

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn multiply_body<V: Eight>(
    rows: &[f64],
    n: usize,
    matrix: &[f64],
    stride: usize,
    out: &mut [f64],
) {
    let (mut many, mut to) = (rows.chunks_exact(SIDE * n), out.chunks_exact_mut(SIDE * stride));
    for (rows, out) in (&mut many).zip(&mut to) {
        // SAFETY: the machine has the width.
        unsafe { some::<V, SIDE>(rows, n, matrix, stride, out) };
    }
    let rest = many.remainder().chunks_exact(n);
    for (row, out) in rest.zip(to.into_remainder().chunks_exact_mut(stride)) {
        // SAFETY: the machine has the width.
        unsafe { some::<V, 1>(row, n, matrix, stride, out) };
    }
}

/// `N` rows.
///
/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn some<V: Eight, const N: usize>(
    rows: &[f64],
    n: usize,
    matrix: &[f64],
    stride: usize,
    out: &mut [f64],
) {
    assert!(rows.len() == N * n && matrix.len() == n * stride && out.len() == N * stride);
    for at in (0..stride).step_by(8) {
        // SAFETY: eight numbers from `at` on lie in every row of the matrix and of `out`.
        unsafe {
            let mut sums = [V::splat(0.0); N];
            for i in 0..n {
                let of = V::load(matrix.as_ptr().add(i * stride + at));
                for (k, sum) in sums.iter_mut().enumerate() {
                    *sum = V::splat(*rows.get_unchecked(k * n + i)).fma(of, *sum);
                }
            }
            for (k, sum) in sums.iter().enumerate() {
                sum.store(out.as_mut_ptr().add(k * stride + at));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_multiplied_by_the_matrix() {
        for (samples, n, columns) in [(1, 1, 1), (7, 3, 2), (101, 9, 8), (50, 17, 13), (0, 2, 2)] {
            let numbers = |count: usize, by: f64| -> Vec<f64> {
                (0..count).map(|k| libm::sin(by * k as f64)).collect()
            };
            let (rows, matrix) = (numbers(samples * n, 0.7), numbers(n * columns, 1.3));
            let all = combined(&rows, n, &matrix, columns);
            assert_eq!(all.len(), columns);
            for (k, column) in all.iter().enumerate() {
                assert_eq!(column.len(), samples);
                for (s, found) in column.iter().enumerate() {
                    let want: f64 = (0..n).map(|i| rows[s * n + i] * matrix[i * columns + k]).sum();
                    assert!((found - want).abs() < 1e-12, "{samples} {n} {columns}");
                }
            }
        }
        assert!(combined(&[], 0, &[], 0).is_empty());
    }
}
