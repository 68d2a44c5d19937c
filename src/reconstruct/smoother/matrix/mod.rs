//! Covariances and adjoints in, the same after a measurement or a step out: the kernels of the
//! smoother, in place, nothing allocated: of its filter (`ahead.rs`) and of its way back (`back.rs`).
//!
//! A matrix of `n` columns is stored in rows of `m` values, `m` a multiple of eight, the rest zero:
//! every row is whole vectors. All sums run over rows, so that nothing is added across a vector.
//!
//! A step is `F = I + [D; 0]`: constant parameters stay, and only the first `k` of what is smoothed
//! (the states, and the parameters their rates depend on) have columns of `D` that are not zero. It
//! is kept by columns, `[column][y]` with `y` the states in whole vectors: those of `D`, then those
//! of the noise, `Gamma`.

mod ahead;
mod back;

pub use ahead::{deduct, joseph, predict, seen, transition};
pub use back::{adjoint_step, adjoint_update, noises, smoothed};

use crate::math::simd::{Eight, Width, by_width};

/// Rows are whole vectors of this many.
pub const VECTOR: usize = 8;

/// `n` rounded up to whole vectors.
pub fn padded(n: usize) -> usize {
    n.next_multiple_of(VECTOR)
}

/// Sizes of what is smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// States and parameters, and the same in whole vectors.
    pub n: usize,
    pub m: usize,
    /// States, and the same in whole vectors.
    pub x: usize,
    pub y: usize,
    /// States and the parameters that move them: they stand first.
    pub k: usize,
    /// Noises that drive the states.
    pub q: usize,
}

impl Size {
    /// Values of a step: the columns of `D` and of `Gamma`.
    pub fn step(&self) -> usize {
        (self.k + self.q) * self.y
    }

    /// The values of a matrix `[n][m]`.
    pub fn square(&self) -> usize {
        self.n * self.m
    }
}

/// Copies the lower triangle of the first `n` rows to the upper one.
#[inline(always)]
fn mirror(a: &mut [f64], n: usize, m: usize) {
    for i in 1..n {
        for j in 0..i {
            a[j * m + i] = a[i * m + j];
        }
    }
}

/// Eight numbers from `at` on.
///
/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn get<V: Eight>(a: &[f64], at: usize) -> V {
    debug_assert!(at + VECTOR <= a.len());
    // SAFETY: callers have checked the sizes of their arrays.
    unsafe { V::load(a.as_ptr().add(at)) }
}

/// # Safety
/// As `get`.
#[inline(always)]
unsafe fn put<V: Eight>(v: V, a: &mut [f64], at: usize) {
    debug_assert!(at + VECTOR <= a.len());
    // SAFETY: as `get`.
    unsafe { v.store(a.as_mut_ptr().add(at)) }
}

/// Rows that are made side by side: a sum waits for itself, four do not.
const ROWS: usize = 4;

/// Numbers of a matrix: the first, and how far the next row and column are.
#[derive(Clone, Copy)]
struct Grid<'a>(&'a [f64], usize, usize);

/// `sums[r] += sum_j c(r, j) v(j)` over `count` vectors `v`, `stride` apart.
///
/// # Safety
/// The machine has the width, and all of it lies in the arrays.
#[inline(always)]
unsafe fn products<V: Eight, const N: usize>(
    mut sums: [V; N],
    count: usize,
    Grid(c, row, column): Grid,
    (vectors, stride): (&[f64], usize),
) -> [V; N] {
    for j in 0..count {
        // SAFETY: the caller's promise.
        unsafe {
            let v: V = get(vectors, j * stride);
            for (r, sum) in sums.iter_mut().enumerate() {
                *sum = V::splat(*c.get_unchecked(r * row + j * column)).fma(v, *sum);
            }
        }
    }
    sums
}

/// `out(i) = from(i) + sum_j c(i, j) v(j)` for the rows `0..n`, vector by vector: `from`, `out` and
/// `v` are rows of so many values, all but `c` from the column `v` on.
///
/// # Safety
/// As `products`.
#[inline(always)]
unsafe fn rows<V: Eight>(
    n: usize,
    v: usize,
    count: usize,
    Grid(c, row, column): Grid,
    (vectors, stride): (&[f64], usize),
    (from, apart): (&[f64], usize),
    (out, out_apart): (&mut [f64], usize),
) {
    // SAFETY: the caller's promise.
    unsafe {
        let mut i = 0;
        while i < n {
            let vectors = (vectors.get_unchecked(v..), stride);
            if n < ROWS {
                let sums = [get::<V>(from, i * apart + v)];
                let c = Grid(c.get_unchecked(i * row..), row, column);
                let [sum] = products(sums, count, c, vectors);
                put(sum, out, i * out_apart + v);
                i += 1;
                continue;
            }
            // the last ones overlap those before
            let first = i.min(n - ROWS);
            let mut sums = [V::splat(0.0); ROWS];
            for (r, sum) in sums.iter_mut().enumerate() {
                *sum = get(from, (first + r) * apart + v);
            }
            let c = Grid(c.get_unchecked(first * row..), row, column);
            for (r, sum) in products(sums, count, c, vectors).into_iter().enumerate() {
                put(sum, out, (first + r) * out_apart + v);
            }
            i += ROWS;
        }
    }
}

/// `y += a x`, over whole vectors.
///
/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn add<V: Eight>(y: &mut [f64], a: f64, x: &[f64]) {
    for (y, x) in y.chunks_exact_mut(VECTOR).zip(x.chunks_exact(VECTOR)) {
        // SAFETY: chunks of eight.
        unsafe { V::splat(a).fma(get::<V>(x, 0), get::<V>(y, 0)).store(y.as_mut_ptr()) }
    }
}

/// `sum x[j] A[j]` over the rows `0..n`, as many columns as `out` has (whole vectors): of a
/// symmetric matrix `A x`.
pub fn multiply(a: &[f64], n: usize, m: usize, x: &[f64], out: &mut [f64]) {
    assert!(a.len() >= n * m && x.len() >= n && out.len() <= m && m.is_multiple_of(VECTOR));
    assert!(out.len().is_multiple_of(VECTOR));
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { multiply_by(Width::detect(), a, n, m, x, out) }
}

by_width! { fn multiply_by(a: &[f64], n: usize, m: usize, x: &[f64], out: &mut [f64]) = multiply_body }

/// # Safety
/// As `multiply`.
#[inline(always)]
unsafe fn multiply_body<V: Eight>(a: &[f64], n: usize, m: usize, x: &[f64], out: &mut [f64]) {
    // SAFETY: the caller has checked the sizes.
    unsafe {
        for v in (0..out.len()).step_by(VECTOR) {
            // four sums side by side: one would wait for itself
            let mut sums = [V::splat(0.0); 4];
            let mut i = 0;
            while i + 4 <= n {
                for (l, sum) in sums.iter_mut().enumerate() {
                    *sum = V::splat(*x.get_unchecked(i + l)).fma(get(a, (i + l) * m + v), *sum);
                }
                i += 4;
            }
            for i in i..n {
                sums[0] = V::splat(*x.get_unchecked(i)).fma(get(a, i * m + v), sums[0]);
            }
            put(sums[0].add(sums[1]).add(sums[2].add(sums[3])), out, v);
        }
    }
}
