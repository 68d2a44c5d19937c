//! Covariances and adjoints in, the same after a measurement or a step out: the kernels of the
//! smoother, in place, nothing allocated.
//!
//! A matrix of `n` columns is stored in rows of `m` values, `m` a multiple of four, the rest zero:
//! every row is whole vectors. The same operations in the same order on every machine (nothing is
//! fused), so the width of the vectors changes no bit.

use crate::dynamics::{AHEAD, WEIGHT};
use crate::math::products::dot_by;

/// Rows are whole vectors of this many.
pub const VECTOR: usize = 4;

/// `n` rounded up to whole vectors.
pub fn padded(n: usize) -> usize {
    n.div_ceil(VECTOR) * VECTOR
}

/// Compiles a kernel twice and picks the wide one where the machine has it.
macro_rules! kernel {
    ($(#[$doc:meta])* pub fn $name:ident($($arg:ident: $type:ty),* $(,)?) $body:block) => {
        $(#[$doc])*
        #[allow(clippy::too_many_arguments)]
        pub fn $name($($arg: $type),*) {
            #[inline(always)]
            #[allow(clippy::too_many_arguments)]
            fn plain($($arg: $type),*) $body
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2")]
            #[allow(clippy::too_many_arguments)]
            fn wide($($arg: $type),*) {
                plain($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the feature was just found on this machine.
                return unsafe { wide($($arg),*) };
            }
            plain($($arg),*)
        }
    };
}

/// `y += a x`.
#[inline(always)]
pub fn add(y: &mut [f64], a: f64, x: &[f64]) {
    for (y, x) in y.chunks_exact_mut(VECTOR).zip(x.chunks_exact(VECTOR)) {
        for l in 0..VECTOR {
            y[l] += a * x[l];
        }
    }
}

/// Copies the lower triangle of an `n` by `n` matrix to the upper one.
#[inline(always)]
fn mirror(a: &mut [f64], n: usize, m: usize) {
    for i in 1..n {
        for j in 0..i {
            a[j * m + i] = a[i * m + j];
        }
    }
}

kernel! {
    /// `out = A x` for the first `out.len()` rows of `a`.
    pub fn multiply(a: &[f64], m: usize, x: &[f64], out: &mut [f64]) {
        for (row, out) in a.chunks_exact(m).zip(out.iter_mut()) {
            *out = dot_by::<VECTOR>(row, x);
        }
    }
}

kernel! {
    /// `P <- (I - K h') P (I - K h')' + r K K'` (Joseph), given `g = P h`: symmetric and positive
    /// whatever was rounded in `K`.
    pub fn joseph(p: &mut [f64], n: usize, m: usize, h: &[f64], g: &[f64], k: &[f64], r: f64) {
        for i in 0..n {
            let row = &mut p[i * m..(i + 1) * m];
            add(row, -k[i], g);
            let s = r * k[i] - dot_by::<VECTOR>(row, h);
            let upto = padded(i + 1);
            add(&mut row[..upto], s, &k[..upto]);
        }
        mirror(p, n, m);
    }
}

kernel! {
    /// `s = [Phi | Gamma]` (`[nx][lanes]`) over a step of `h` s by the classic Runge-Kutta on
    /// `S' = A S + B`: `values[e]` is entry `e` of `[A | B]` at the four stages, at (row, column)
    /// `entries[e]`, where columns below `n` are states and parameters and the others noise. `k`
    /// and `stage` are scratch of the size of `s`.
    pub fn transition(
        s: &mut [f64], k: &mut [f64], stage: &mut [f64], entries: &[(usize, usize)], values: &[[f64; 4]], nx: usize, n: usize, m: usize,
        lanes: usize, h: f64,
    ) {
        s.fill(0.0);
        for l in 0..4 {
            k.fill(0.0);
            for (&(row, column), value) in entries.iter().zip(values) {
                let to = &mut k[row * lanes..(row + 1) * lanes];
                if column < nx && l > 0 {
                    add(to, value[l], &stage[column * lanes..(column + 1) * lanes]);
                } else {
                    // the first stage begins at the identity
                    to[if column < n { column } else { m + column - n }] += value[l];
                }
            }
            add(s, h / 6.0 * WEIGHT[l], k);
            if l < 3 {
                stage.fill(0.0);
                add(stage, AHEAD[l] * h, k);
                for i in 0..nx {
                    stage[i * lanes + i] += 1.0;
                }
            }
        }
        for i in 0..nx {
            s[i * lanes + i] += 1.0;
        }
    }
}

kernel! {
    /// `P <- F P F' + sum q_j g_j g_j'` for `F = [top; 0 I]`. Rows of `s` are `top` (`m` values)
    /// and then the columns `g` of the noise (`q.len()` of them), `lanes` in all; `w` is scratch of
    /// `nx m` values.
    pub fn predict(p: &mut [f64], n: usize, m: usize, nx: usize, s: &[f64], lanes: usize, q: &[f64], w: &mut [f64]) {
        for i in 0..nx {
            let row = &mut w[i * m..(i + 1) * m];
            row.fill(0.0);
            for j in 0..n {
                let f = s[i * lanes + j];
                if f != 0.0 {
                    add(row, f, &p[j * m..(j + 1) * m]);
                }
            }
        }
        for i in 0..nx {
            for j in 0..=i {
                let mut value = dot_by::<VECTOR>(&w[i * m..(i + 1) * m], &s[j * lanes..j * lanes + m]);
                for (l, q) in q.iter().enumerate() {
                    value += q * s[i * lanes + m + l] * s[j * lanes + m + l];
                }
                p[i * m + j] = value;
            }
            for j in nx..n {
                p[j * m + i] = w[i * m + j];
            }
        }
        mirror(p, n, m);
    }
}

kernel! {
    /// Adjoint covariance back through a step: `A <- F' A F`; `w` is scratch of `n m` values.
    pub fn adjoint_step(a: &mut [f64], n: usize, m: usize, nx: usize, s: &[f64], lanes: usize, w: &mut [f64]) {
        // W = A F
        for i in 0..n {
            let row = &mut w[i * m..(i + 1) * m];
            row.copy_from_slice(&a[i * m..(i + 1) * m]);
            row[..nx].fill(0.0);
            for j in 0..nx {
                add(row, a[i * m + j], &s[j * lanes..j * lanes + m]);
            }
        }
        // A = F' W, lower triangle
        for i in 0..n {
            let upto = padded(i + 1);
            let row = &mut a[i * m..i * m + upto];
            if i < nx {
                row.fill(0.0);
            } else {
                row.copy_from_slice(&w[i * m..i * m + upto]);
            }
            for j in 0..nx {
                let f = s[j * lanes + i];
                if f != 0.0 {
                    add(row, f, &w[j * m..j * m + upto]);
                }
            }
        }
        mirror(a, n, m);
    }
}

kernel! {
    /// Adjoint covariance back through a measurement: `A <- A - b h' - h b' + d h h'`, with
    /// `b = A K` and `d = 1/s + K' A K`.
    pub fn adjoint_update(a: &mut [f64], n: usize, m: usize, h: &[f64], b: &[f64], d: f64) {
        for i in 0..n {
            let row = &mut a[i * m..(i + 1) * m];
            add(row, d * h[i] - b[i], h);
            add(row, -h[i], b);
        }
    }
}

kernel! {
    /// `P_s = P - P A P`; `w` is scratch of `n m` values.
    pub fn smoothed(p: &[f64], a: &[f64], n: usize, m: usize, w: &mut [f64], out: &mut [f64]) {
        for i in 0..n {
            let row = &mut w[i * m..(i + 1) * m];
            row.fill(0.0);
            for j in 0..n {
                add(row, p[i * m + j], &a[j * m..(j + 1) * m]);
            }
        }
        for i in 0..n {
            for j in 0..=i {
                let value = p[i * m + j] - dot_by::<VECTOR>(&w[i * m..(i + 1) * m], &p[j * m..(j + 1) * m]);
                out[i * m + j] = value;
                out[j * m + i] = value;
            }
        }
    }
}
