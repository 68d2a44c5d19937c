//! A real square matrix in; its eigenvalues, with left and right eigenvectors, out.
//!
//! Balanced by powers of two, brought to Hessenberg form by eliminations, then QR with Wilkinson's
//! shifts in complex numbers (Golub & Van Loan 2013, secs. 7.4 and 7.5); eigenvectors by inverse
//! iteration. Meant for the state matrices of models: some tens of rows.

use super::complex::Complex;

/// An eigenvalue `l` with `A right = l right` and `left' A = l left'` (no conjugation).
#[derive(Debug, Clone, PartialEq)]
pub struct Eigen {
    pub value: Complex,
    pub left: Vec<Complex>,
    pub right: Vec<Complex>,
}

/// QR steps per eigenvalue before it is given up.
const MOST_STEPS: usize = 100;
/// Below this share of the matrix an imaginary part is rounding.
const REAL: f64 = 1e-9;

/// The eigenvalues of a matrix `[n][n]`, of pairs the one with the positive imaginary part, fastest
/// first; none where it is not finite, or the iteration does not end.
pub fn eigen(a: &[f64], n: usize) -> Option<Vec<Eigen>> {
    if a.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let (b, scale) = balanced(a, n);
    let norm = b.iter().fold(0.0f64, |most, v| most.max(v.abs())).max(f64::MIN_POSITIVE);
    let mut found = Vec::new();
    for value in values(&b, n)? {
        let value = if value.im.abs() <= REAL * norm { Complex::real(value.re) } else { value };
        if value.im >= 0.0 {
            found.push(value);
        }
    }
    let order = |x: &Complex| (x.abs(), x.re, x.im);
    found.sort_by(|x, y| {
        let (x, y) = (order(x), order(y));
        y.0.total_cmp(&x.0).then(y.1.total_cmp(&x.1)).then(y.2.total_cmp(&x.2))
    });
    let transposed = super::dense::transpose(&b, n, n);
    let of = |value: Complex| {
        let mut right = vector(&b, n, value, norm)?;
        let mut left = vector(&transposed, n, value, norm)?;
        for i in 0..n {
            right[i] = right[i].times(scale[i]);
            left[i] = left[i].times(1.0 / scale[i]);
        }
        Some(Eigen { value, left, right })
    };
    found.into_iter().map(of).collect()
}

/// `D^-1 A D` with rows and columns of like size, and `D` (Parlett & Reinsch 1969).
fn balanced(a: &[f64], n: usize) -> (Vec<f64>, Vec<f64>) {
    let (mut b, mut scale) = (a.to_vec(), vec![1.0; n]);
    for _ in 0..MOST_STEPS {
        let mut done = true;
        for i in 0..n {
            let others = || (0..n).filter(|&j| j != i);
            let row: f64 = others().map(|j| b[i * n + j].abs()).sum();
            let mut column: f64 = others().map(|j| b[j * n + i].abs()).sum();
            if row == 0.0 || column == 0.0 {
                continue;
            }
            let (before, mut f) = (row + column, 1.0);
            while column < row / 2.0 {
                (f, column) = (f * 2.0, column * 4.0);
            }
            while column >= row * 2.0 {
                (f, column) = (f / 2.0, column / 4.0);
            }
            if (row + column) / f < 0.95 * before {
                done = false;
                scale[i] *= f;
                (0..n).for_each(|j| b[i * n + j] /= f);
                (0..n).for_each(|j| b[j * n + i] *= f);
            }
        }
        if done {
            break;
        }
    }
    (b, scale)
}

/// The same matrix, similar to it, with nothing below the first subdiagonal.
fn hessenberg(a: &[f64], n: usize) -> Vec<f64> {
    let mut h = a.to_vec();
    for m in 1..n.saturating_sub(1) {
        let size = |h: &[f64], i: usize| h[i * n + m - 1].abs();
        let pivot = (m..n).max_by(|&i, &j| size(&h, i).total_cmp(&size(&h, j))).unwrap_or(m);
        if size(&h, pivot) == 0.0 {
            continue;
        }
        (0..n).for_each(|j| h.swap(pivot * n + j, m * n + j));
        (0..n).for_each(|j| h.swap(j * n + pivot, j * n + m));
        for i in m + 1..n {
            let factor = h[i * n + m - 1] / h[m * n + m - 1];
            if factor != 0.0 {
                (0..n).for_each(|j| h[i * n + j] -= factor * h[m * n + j]);
                (0..n).for_each(|j| h[j * n + m] += factor * h[j * n + i]);
            }
        }
    }
    h
}

fn values(a: &[f64], n: usize) -> Option<Vec<Complex>> {
    let mut h: Vec<Complex> = hessenberg(a, n).into_iter().map(Complex::real).collect();
    for j in 0..n {
        (j + 2..n).for_each(|i| h[i * n + j] = Complex::ZERO);
    }
    let (mut end, mut steps) = (n, 0);
    let mut all = vec![Complex::ZERO; n];
    while end > 0 {
        let last = end - 1;
        let small = |h: &[Complex], i: usize| {
            let around = h[i * n + i].abs() + h[(i - 1) * n + i - 1].abs();
            h[i * n + i - 1].abs() <= f64::EPSILON * around.max(f64::MIN_POSITIVE)
        };
        let begin = (1..=last).rev().find(|&i| small(&h, i)).unwrap_or(0);
        if begin == last {
            all[last] = h[last * n + last];
            (end, steps) = (last, 0);
            continue;
        }
        steps += 1;
        if steps > MOST_STEPS {
            return None;
        }
        let shift = if steps % 10 == 0 {
            // Breaks a circle that the usual shift would stay in.
            h[last * n + last].plus(Complex::real(h[last * n + last - 1].abs()))
        } else {
            wilkinson(&h, n, last)
        };
        step(&mut h, n, begin..end, shift);
    }
    Some(all)
}

/// The eigenvalue of the last block of two that is nearer to its last element.
fn wilkinson(h: &[Complex], n: usize, last: usize) -> Complex {
    let at = |i: usize, j: usize| h[i * n + j];
    let (a, b, c, d) =
        (at(last - 1, last - 1), at(last - 1, last), at(last, last - 1), at(last, last));
    let half = a.minus(d).times(0.5);
    let root = half.by(half).plus(b.by(c)).sqrt();
    let middle = a.plus(d).times(0.5);
    let (one, other) = (middle.plus(root), middle.minus(root));
    if one.minus(d).abs() < other.minus(d).abs() { one } else { other }
}

/// One QR step with a shift on the rows and columns of a range, by rotations.
fn step(h: &mut [Complex], n: usize, range: std::ops::Range<usize>, shift: Complex) {
    let (begin, end) = (range.start, range.end);
    range.clone().for_each(|i| h[i * n + i] = h[i * n + i].minus(shift));
    let mut turns = Vec::with_capacity(range.len());
    for k in begin..end - 1 {
        let (x, y) = (h[k * n + k], h[(k + 1) * n + k]);
        let size = libm::hypot(x.abs(), y.abs());
        let (c, s) = match size > 0.0 {
            true => (x.times(1.0 / size), y.times(1.0 / size)),
            false => (Complex::real(1.0), Complex::ZERO),
        };
        for j in k..end {
            let (x, y) = (h[k * n + j], h[(k + 1) * n + j]);
            h[k * n + j] = c.conjugate().by(x).plus(s.conjugate().by(y));
            h[(k + 1) * n + j] = c.by(y).minus(s.by(x));
        }
        turns.push((c, s));
    }
    for (k, (c, s)) in (begin..).zip(turns) {
        for i in begin..(k + 2).min(end) {
            let (x, y) = (h[i * n + k], h[i * n + k + 1]);
            h[i * n + k] = x.by(c).plus(y.by(s));
            h[i * n + k + 1] = y.by(c.conjugate()).minus(x.by(s.conjugate()));
        }
    }
    range.for_each(|i| h[i * n + i] = h[i * n + i].plus(shift));
}

/// The vector of an eigenvalue, by inverse iteration from a little beside it.
fn vector(a: &[f64], n: usize, value: Complex, norm: f64) -> Option<Vec<Complex>> {
    let beside = value.plus(Complex::real(4.0 * f64::EPSILON * norm));
    let mut x: Vec<Complex> = (0..n).map(|i| Complex::real(1.0 + 0.1 * i as f64)).collect();
    for _ in 0..3 {
        let mut m: Vec<Complex> = a.iter().map(|v| Complex::real(*v)).collect();
        (0..n).for_each(|i| m[i * n + i] = m[i * n + i].minus(beside));
        solve(&mut m, n, &mut x, norm);
        let size = x.iter().fold(0.0f64, |most, v| most.max(v.abs()));
        if !(size > 0.0 && size.is_finite()) {
            return None;
        }
        x.iter_mut().for_each(|v| *v = v.times(1.0 / size));
    }
    Some(x)
}

/// Elimination with row pivots; a pivot that vanishes counts as rounding.
fn solve(m: &mut [Complex], n: usize, x: &mut [Complex], norm: f64) {
    for k in 0..n {
        let size = |m: &[Complex], i: usize| m[i * n + k].abs();
        let pivot = (k..n).max_by(|&i, &j| size(m, i).total_cmp(&size(m, j))).unwrap_or(k);
        (0..n).for_each(|j| m.swap(pivot * n + j, k * n + j));
        x.swap(pivot, k);
        if m[k * n + k].abs() < f64::EPSILON * norm {
            m[k * n + k] = Complex::real(f64::EPSILON * norm);
        }
        for i in k + 1..n {
            let factor = m[i * n + k].over(m[k * n + k]);
            (k..n).for_each(|j| m[i * n + j] = m[i * n + j].minus(factor.by(m[k * n + j])));
            x[i] = x[i].minus(factor.by(x[k]));
        }
    }
    for i in (0..n).rev() {
        let mut sum = x[i];
        for j in i + 1..n {
            sum = sum.minus(m[i * n + j].by(x[j]));
        }
        x[i] = sum.over(m[i * n + i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn known_eigenvalues_are_found() {
        // A block with -1 +- 2i, and -3 and -0.5, turned into each other; two integrators.
        let a = [
            -1.0, 2.0, 0.3, 0.0, 0.0, 0.0, -2.0, -1.0, 0.0, 0.7, 0.0, 0.0, 0.0, 0.0, -3.0, 1.0,
            0.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e4, 0.0,
            0.0, 0.0, 0.0,
        ];
        let found = eigen(&a, 6).expect("eigenvalues");
        let want = [(-3.0, 0.0), (-1.0, 2.0), (-0.5, 0.0), (0.0, 0.0), (0.0, 0.0)];
        assert_eq!(found.len(), want.len());
        for (found, (re, im)) in found.iter().zip(want) {
            let value = found.value;
            assert!((value.re - re).abs() < 1e-9 && (value.im - im).abs() < 1e-9, "{value:?}");
        }
    }

    #[test]
    fn values_and_vectors_solve_their_equations() {
        let mut random = rand_pcg::Pcg64::seed_from_u64(3);
        for n in 1..13 {
            let mut a: Vec<f64> = (0..n * n).map(|_| random.random_range(-1.0..1.0)).collect();
            // As badly scaled as metres and radians.
            (0..n).for_each(|j| a[j] *= 1e3);
            (0..n).for_each(|j| a[j * n] /= 1e3);
            let all = eigen(&a, n).expect("eigenvalues");
            let count: usize = all.iter().map(|e| if e.value.im > 0.0 { 2 } else { 1 }).sum();
            assert_eq!(count, n);
            let trace: f64 = (0..n).map(|i| a[i * n + i]).sum();
            let sum: f64 =
                all.iter().map(|e| (1.0 + f64::from(e.value.im > 0.0)) * e.value.re).sum();
            assert!((trace - sum).abs() < 1e-9 * 1e3, "{trace} {sum}");
            for e in &all {
                for i in 0..n {
                    let at = |v: &[Complex], f: &dyn Fn(usize) -> f64| {
                        (0..n).fold(Complex::ZERO, |sum, j| sum.plus(v[j].times(f(j))))
                    };
                    let right = at(&e.right, &|j| a[i * n + j]).minus(e.value.by(e.right[i]));
                    let left = at(&e.left, &|j| a[j * n + i]).minus(e.value.by(e.left[i]));
                    assert!(right.abs() < 1e-8 * 1e3 && left.abs() < 1e-8 * 1e3, "{n} {e:?}");
                }
            }
        }
    }
}
