//! Dense matrices as flat row-major slices in, factors, solutions, inverses and eigenvalues out.
//!
//! A matrix `[n][m]` is a slice of length `n*m` whose element `(i, j)` is at `i*m + j`. Sums run in
//! index order, so the same input gives the same bytes. A slice whose length does not match is a
//! mistake of the caller and panics.

/// The lower Cholesky factor `[n][n]` of a symmetric positive definite `a` (`a = L L'`; only the
/// lower triangle of `a` is read).
///
/// Errors: the index of the first pivot that is not positive: that row depends on the rows before
/// it (or is not finite).
pub fn cholesky(a: &[f64], n: usize) -> Result<Vec<f64>, usize> {
    assert_eq!(a.len(), n * n, "matrix size");
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let mut sum = a[i * n + j];
            for k in 0..j {
                sum -= l[i * n + k] * l[j * n + k];
            }
            if i != j {
                l[i * n + j] = sum / l[j * n + j];
            } else if sum > 0.0 && sum.is_finite() && sum > a[i * n + i] * 4.0 * f64::EPSILON {
                l[i * n + i] = sum.sqrt();
            } else {
                return Err(i);
            }
        }
    }
    Ok(l)
}

/// Solves `L x = b` in place for the lower triangular `l` `[n][n]`.
pub fn forward(l: &[f64], n: usize, b: &mut [f64]) {
    for i in 0..n {
        let mut sum = b[i];
        for k in 0..i {
            sum -= l[i * n + k] * b[k];
        }
        b[i] = sum / l[i * n + i];
    }
}

/// Solves `L' x = b` in place for the lower triangular `l` `[n][n]`.
pub fn backward(l: &[f64], n: usize, b: &mut [f64]) {
    for i in (0..n).rev() {
        let mut sum = b[i];
        for k in i + 1..n {
            sum -= l[k * n + i] * b[k];
        }
        b[i] = sum / l[i * n + i];
    }
}

/// Solves `A x = b` in place, where `l` is the Cholesky factor of `A` `[n][n]`.
pub fn cholesky_solve(l: &[f64], n: usize, b: &mut [f64]) {
    forward(l, n, b);
    backward(l, n, b);
}

/// The inverse `[n][n]` of `A` from its Cholesky factor; exactly symmetric.
pub fn cholesky_inverse(l: &[f64], n: usize) -> Vec<f64> {
    let mut inverse = vec![0.0; n * n];
    let mut column = vec![0.0; n];
    for j in 0..n {
        column.fill(0.0);
        column[j] = 1.0;
        cholesky_solve(l, n, &mut column);
        for i in j..n {
            inverse[i * n + j] = column[i];
            inverse[j * n + i] = column[i];
        }
    }
    inverse
}

/// `ln det A` from the Cholesky factor of `A` `[n][n]`.
pub fn cholesky_log_det(l: &[f64], n: usize) -> f64 {
    (0..n).map(|i| 2.0 * libm::log(l[i * n + i])).sum()
}

/// Solves `A x = b` for a general square `a` `[n][n]` by elimination with row pivoting; `None` when
/// `a` is singular.
pub fn solve(a: &[f64], n: usize, b: &[f64]) -> Option<Vec<f64>> {
    assert_eq!((a.len(), b.len()), (n * n, n), "matrix size");
    let (mut a, mut x) = (a.to_vec(), b.to_vec());
    let scale = a.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i * n + k].abs().total_cmp(&a[j * n + k].abs()))?;
        let size = a[pivot * n + k].abs();
        if !size.is_finite() || size <= scale * n as f64 * f64::EPSILON {
            return None;
        }
        if pivot != k {
            for j in 0..n {
                a.swap(k * n + j, pivot * n + j);
            }
            x.swap(k, pivot);
        }
        for i in k + 1..n {
            let factor = a[i * n + k] / a[k * n + k];
            for j in k..n {
                a[i * n + j] -= factor * a[k * n + j];
            }
            x[i] -= factor * x[k];
        }
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| a[i * n + k] * x[k]).sum();
        x[i] = (x[i] - sum) / a[i * n + i];
    }
    Some(x)
}

/// The product `[n][p]` of `a` `[n][m]` and `b` `[m][p]`.
pub fn multiply(a: &[f64], b: &[f64], n: usize, m: usize, p: usize) -> Vec<f64> {
    assert_eq!((a.len(), b.len()), (n * m, m * p), "matrix size");
    let mut c = vec![0.0; n * p];
    for i in 0..n {
        for k in 0..m {
            let factor = a[i * m + k];
            for j in 0..p {
                c[i * p + j] += factor * b[k * p + j];
            }
        }
    }
    c
}

/// The transpose `[m][n]` of `a` `[n][m]`.
pub fn transpose(a: &[f64], n: usize, m: usize) -> Vec<f64> {
    assert_eq!(a.len(), n * m, "matrix size");
    (0..m * n).map(|k| a[(k % n) * m + k / n]).collect()
}

/// Eigenvalues and eigenvectors of a symmetric matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, ascending.
    pub values: Vec<f64>,
    /// Unit eigenvectors `[n][n]`, one per row, in the order of the values; the largest component
    /// is positive.
    pub vectors: Vec<f64>,
}

/// Eigenvalues and eigenvectors of a symmetric `a` `[n][n]` by cyclic Jacobi rotations (Golub & Van
/// Loan, Section 8.5): slow beyond some hundred rows, but accurate for the small eigenvalues that a
/// verdict on rank needs.
pub fn symmetric_eigen(a: &[f64], n: usize) -> Eigen {
    assert_eq!(a.len(), n * n, "matrix size");
    let mut a = a.to_vec();
    let mut v = vec![0.0; n * n];
    (0..n).for_each(|i| v[i * n + i] = 1.0);
    for _sweep in 0..60 {
        let mut rotated = false;
        for p in 0..n {
            for q in p + 1..n {
                rotated |= rotate(&mut a, &mut v, n, p, q);
            }
        }
        if !rotated {
            break;
        }
    }
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| a[i * n + i].total_cmp(&a[j * n + j]));
    let values = order.iter().map(|&i| a[i * n + i]).collect();
    let vectors = order.iter().flat_map(|&i| signed(&v[i * n..(i + 1) * n])).collect();
    Eigen { values, vectors }
}

/// One Jacobi rotation that zeroes `a[p][q]`; the rows of `v` follow. False when the element is
/// negligible already.
fn rotate(a: &mut [f64], v: &mut [f64], n: usize, p: usize, q: usize) -> bool {
    let (app, aqq, apq) = (a[p * n + p], a[q * n + q], a[p * n + q]);
    if apq.is_nan()
        || apq.abs() <= f64::EPSILON * (app * aqq).abs().sqrt() * 0.5
        || apq.abs() < f64::MIN_POSITIVE
    {
        return false;
    }
    let theta = (aqq - app) / (2.0 * apq);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for k in 0..n {
        let (akp, akq) = (a[k * n + p], a[k * n + q]);
        a[k * n + p] = c * akp - s * akq;
        a[k * n + q] = s * akp + c * akq;
    }
    for k in 0..n {
        let (apk, aqk) = (a[p * n + k], a[q * n + k]);
        a[p * n + k] = c * apk - s * aqk;
        a[q * n + k] = s * apk + c * aqk;
        let (vp, vq) = (v[p * n + k], v[q * n + k]);
        v[p * n + k] = c * vp - s * vq;
        v[q * n + k] = s * vp + c * vq;
    }
    a[p * n + q] = 0.0;
    a[q * n + p] = 0.0;
    true
}

fn signed(vector: &[f64]) -> Vec<f64> {
    let largest = vector.iter().fold(0.0f64, |m, &x| if x.abs() > m.abs() { x } else { m });
    vector.iter().map(|x| if largest < 0.0 { -x } else { *x }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A Hilbert matrix with something on the diagonal: symmetric positive definite, far from
    /// diagonal.
    fn sample(n: usize) -> Vec<f64> {
        (0..n * n)
            .map(|k| {
                1.0 / (1.0 + (k / n) as f64 + (k % n) as f64)
                    + if k / n == k % n { 0.1 } else { 0.0 }
            })
            .collect()
    }

    fn identity_error(a: &[f64], n: usize) -> f64 {
        a.iter()
            .enumerate()
            .map(|(k, v)| (v - if k / n == k % n { 1.0 } else { 0.0 }).abs())
            .fold(0.0, f64::max)
    }

    #[test]
    fn cholesky_inverts_and_solves() {
        let n = 6;
        let a = sample(n);
        let l = cholesky(&a, n).unwrap();
        assert!(identity_error(&multiply(&a, &cholesky_inverse(&l, n), n, n, n), n) < 1e-12);
        let b: Vec<f64> = (0..n).map(|i| i as f64 - 2.0).collect();
        let mut x = b.clone();
        cholesky_solve(&l, n, &mut x);
        let y = solve(&a, n, &b).unwrap();
        let back = multiply(&a, &x, n, n, 1);
        for i in 0..n {
            assert!((x[i] - y[i]).abs() < 1e-11 && (back[i] - b[i]).abs() < 1e-12);
        }
        let product: f64 = symmetric_eigen(&a, n).values.iter().map(|v| v.ln()).sum();
        assert!((cholesky_log_det(&l, n) - product).abs() < 1e-12);
    }

    #[test]
    fn cholesky_names_the_dependent_row() {
        // row 2 = row 0 + row 1
        assert_eq!(cholesky(&[2.0, 0.0, 2.0, 0.0, 3.0, 3.0, 2.0, 3.0, 5.0], 3), Err(2));
        assert_eq!(cholesky(&[f64::NAN], 1), Err(0));
        assert_eq!(cholesky(&[1.0, 0.0, 0.0, -1.0], 2), Err(1));
    }

    #[test]
    fn solve_pivots_and_refuses_singular() {
        let x = solve(&[0.0, 2.0, 1.0, 1.0], 2, &[2.0, 3.0]).unwrap();
        assert_eq!(x, [2.0, 1.0]);
        assert_eq!(solve(&[1.0, 2.0, 2.0, 4.0], 2, &[1.0, 1.0]), None);
        assert_eq!(solve(&[0.0], 1, &[1.0]), None);
    }

    #[test]
    fn eigen_finds_tiny_values_and_orthogonal_vectors() {
        let n = 5;
        let a = sample(n);
        let e = symmetric_eigen(&a, n);
        assert!(e.values.windows(2).all(|w| w[0] <= w[1]));
        for i in 0..n {
            let v = &e.vectors[i * n..(i + 1) * n];
            let av = multiply(&a, v, n, n, 1);
            for j in 0..n {
                assert!((av[j] - e.values[i] * v[j]).abs() < 1e-13);
            }
        }
        let vt = transpose(&e.vectors, n, n);
        assert!(identity_error(&multiply(&e.vectors, &vt, n, n, n), n) < 1e-13);
        // eigenvalues of [[1, 1-d], [1-d, 1]] are d and 2-d
        let d = 1e-10;
        let e = symmetric_eigen(&[1.0, 1.0 - d, 1.0 - d, 1.0], 2);
        assert!((e.values[0] / d - 1.0).abs() < 1e-5 && (e.values[1] - 2.0 + d).abs() < 1e-14);
        assert_eq!(symmetric_eigen(&[3.0], 1), Eigen { values: vec![3.0], vectors: vec![1.0] });
    }

    #[test]
    fn transpose_turns() {
        assert_eq!(
            transpose(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 2, 3),
            [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]
        );
    }
}
