//! Normal equations in arrow form: a matrix with one border and one block per segment in; steps and covariances out, in time and
//! memory linear in the number of segments.
//!
//! With `c` the shared parameters and `s` a segment's own, `M` has the blocks `M_cc`, `M_ss`, `M_sc` and zeros between different
//! segments. Every segment is eliminated first: `T_s = M_ss^-1 M_sc`, and what remains is the Schur complement
//! `S = M_cc - sum_s M_cs T_s`.

use crate::math::dense::{self, multiply};

/// One segment's rows of an arrow matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Own {
    /// Number of the segment's own parameters.
    pub n: usize,
    /// `[n][n]`, symmetric.
    pub ss: Vec<f64>,
    /// `[n][shared]`.
    pub sc: Vec<f64>,
}

/// A symmetric arrow matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrow {
    pub shared: usize,
    /// `[shared][shared]`, symmetric.
    pub cc: Vec<f64>,
    pub own: Vec<Own>,
}

/// An eliminated arrow matrix.
#[derive(Debug, Clone)]
pub struct Factor {
    shared: usize,
    /// `S^-1`.
    v: Vec<f64>,
    own: Vec<Eliminated>,
}

#[derive(Debug, Clone)]
struct Eliminated {
    n: usize,
    /// `M_ss^-1`.
    inverse: Vec<f64>,
    /// `T_s`, `[n][shared]`.
    t: Vec<f64>,
}

/// Pivots smaller than this share of their diagonal count as zero: what is left of a parameter's information after all others are
/// known. Sensitivities carry rounding errors of some 1e-14, which square to nothing; sums of products carry 1e-16 each.
pub const PIVOT: f64 = 1e-13;

/// Inverse of a symmetric positive definite matrix by Cholesky factors; `None` where a pivot is below `PIVOT` times `scale[i]`.
pub fn invert(matrix: &[f64], scale: &[f64]) -> Option<Vec<f64>> {
    let n = scale.len();
    let l = dense::cholesky(matrix, n).ok()?;
    let sound = (0..n).all(|i| l[i * n + i] * l[i * n + i] > PIVOT * scale[i] && l[i * n + i].is_finite());
    sound.then(|| dense::cholesky_inverse(&l, n))
}

impl Arrow {
    /// Eliminates every segment, then the border; `None` where the matrix is singular to working precision.
    pub fn factor(&self) -> Option<Factor> {
        let nc = self.shared;
        let mut schur = self.cc.clone();
        let mut own = Vec::with_capacity(self.own.len());
        for s in &self.own {
            let inverse = invert(&s.ss, &diagonal(&s.ss, s.n))?;
            let t = multiply(&inverse, &s.sc, s.n, s.n, nc);
            subtract_transposed(&mut schur, &s.sc, &t, s.n, nc);
            own.push(Eliminated { n: s.n, inverse, t });
        }
        let v = invert(&schur, &diagonal(&self.cc, nc))?;
        Some(Factor { shared: nc, v, own })
    }

    /// The Schur complement, not scaled; `None` where a segment's own block is singular.
    pub fn schur(&self) -> Option<Vec<f64>> {
        let mut schur = self.cc.clone();
        for s in &self.own {
            let inverse = invert(&s.ss, &diagonal(&s.ss, s.n))?;
            let t = multiply(&inverse, &s.sc, s.n, s.n, self.shared);
            subtract_transposed(&mut schur, &s.sc, &t, s.n, self.shared);
        }
        Some(schur)
    }

    /// `-M_ss^-1 M_sc x`: how the own parameters of segment `s` follow a change `x` of the shared ones where they can compensate it;
    /// empty where its block is singular.
    pub fn follow(&self, s: usize, x: &[f64]) -> Vec<f64> {
        let own = &self.own[s];
        let Some(inverse) = invert(&own.ss, &diagonal(&own.ss, own.n)) else { return Vec::new() };
        let force = multiply(&own.sc, x, own.n, self.shared, 1);
        multiply(&inverse, &force, own.n, own.n, 1).iter().map(|v| -v).collect()
    }

    /// Adds `value` on the diagonal at `index` of the whole vector (shared parameters first, then segment by segment).
    pub fn add_diagonal(&mut self, index: usize, value: f64) {
        if index < self.shared {
            self.cc[index * self.shared + index] += value;
        } else if let Some((s, i)) = self.place(index) {
            let own = &mut self.own[s];
            own.ss[i * own.n + i] += value;
        }
    }

    /// `d' M d`.
    pub fn quadratic(&self, d: &[f64]) -> f64 {
        let nc = self.shared;
        let mut sum = 0.0;
        for i in 0..nc {
            sum += d[i] * dot(&self.cc[i * nc..(i + 1) * nc], &d[..nc]);
        }
        let mut offset = nc;
        for own in &self.own {
            for i in 0..own.n {
                let with_own = dot(&own.ss[i * own.n..(i + 1) * own.n], &d[offset..offset + own.n]);
                sum += d[offset + i] * (with_own + 2.0 * dot(&own.sc[i * nc..(i + 1) * nc], &d[..nc]));
            }
            offset += own.n;
        }
        sum
    }

    /// Empties row and column `index`: the parameter carries no information and, in a covariance, no variance.
    pub fn clear(&mut self, index: usize) {
        let mut nothing = vec![0.0; self.own.iter().fold(self.shared, |n, own| n + own.n)];
        self.pin(&mut nothing, index, 0.0);
        self.add_diagonal(index, -1.0);
    }

    /// Prescribes component `index` of the solution of `M d = rhs` as `value`, without changing the size of the system.
    pub fn pin(&mut self, rhs: &mut [f64], index: usize, value: f64) {
        let nc = self.shared;
        let mut offset = nc;
        if index < nc {
            for i in 0..nc {
                rhs[i] -= self.cc[i * nc + index] * value;
                self.cc[i * nc + index] = 0.0;
                self.cc[index * nc + i] = 0.0;
            }
            self.cc[index * nc + index] = 1.0;
            for own in &mut self.own {
                for i in 0..own.n {
                    rhs[offset + i] -= own.sc[i * nc + index] * value;
                    own.sc[i * nc + index] = 0.0;
                }
                offset += own.n;
            }
        } else if let Some((s, k)) = self.place(index) {
            offset = index - k;
            let own = &mut self.own[s];
            for (i, r) in rhs[..nc].iter_mut().enumerate() {
                *r -= own.sc[k * nc + i] * value;
                own.sc[k * nc + i] = 0.0;
            }
            for i in 0..own.n {
                rhs[offset + i] -= own.ss[i * own.n + k] * value;
                own.ss[i * own.n + k] = 0.0;
                own.ss[k * own.n + i] = 0.0;
            }
            own.ss[k * own.n + k] = 1.0;
        }
        rhs[index] = value;
    }

    /// Segment and position within it of an own parameter.
    pub fn place(&self, index: usize) -> Option<(usize, usize)> {
        let mut offset = self.shared;
        for (s, own) in self.own.iter().enumerate() {
            if index < offset + own.n {
                return index.checked_sub(offset).map(|i| (s, i));
            }
            offset += own.n;
        }
        None
    }
}

impl Factor {
    /// Solves `M d = rhs`.
    pub fn solve(&self, rhs: &[f64]) -> Vec<f64> {
        let nc = self.shared;
        let mut reduced = rhs[..nc].to_vec();
        let mut offset = nc;
        for own in &self.own {
            for i in 0..own.n {
                for (c, r) in reduced.iter_mut().enumerate() {
                    *r -= own.t[i * nc + c] * rhs[offset + i];
                }
            }
            offset += own.n;
        }
        let mut d = multiply(&self.v, &reduced, nc, nc, 1);
        offset = nc;
        for own in &self.own {
            let mut part = multiply(&own.inverse, &rhs[offset..offset + own.n], own.n, own.n, 1);
            for (i, p) in part.iter_mut().enumerate() {
                *p -= dot(&own.t[i * nc..(i + 1) * nc], &d[..nc]);
            }
            d.extend_from_slice(&part);
            offset += own.n;
        }
        d
    }

    /// The blocks of `M^-1 Q M^-1` on the border and of every segment with itself and the border; `Q` has the same arrow form
    /// (blocks between two segments vanish because their noise is independent). With `Q = M` these are the blocks of `M^-1`.
    ///
    /// For a gradient of covariance `Q` the estimates are `d_c = V h` with `h = g_c - sum_s T_s' g_s`, and
    /// `d_s = M_ss^-1 g_s - T_s d_c`; the blocks are the covariances of these.
    pub fn sandwich(&self, q: &Arrow) -> Arrow {
        let nc = self.shared;
        let mut qh = q.cc.clone();
        // Covariance of g_s with h, `[n][nc]`: Q_sc - Q_ss T_s.
        let mut with_h = Vec::with_capacity(self.own.len());
        for (e, qs) in self.own.iter().zip(&q.own) {
            let qt = multiply(&qs.ss, &e.t, e.n, e.n, nc);
            let mut k = qs.sc.clone();
            k.iter_mut().zip(&qt).for_each(|(k, qt)| *k -= qt);
            // var(h) = Q_cc - sum_s (T_s' (Q_sc - Q_ss T_s) + Q_cs T_s)
            subtract_transposed(&mut qh, &e.t, &k, e.n, nc);
            subtract_transposed(&mut qh, &qs.sc, &e.t, e.n, nc);
            with_h.push(k);
        }
        let vq = multiply(&self.v, &qh, nc, nc, nc);
        let mut cc = multiply(&vq, &self.v, nc, nc, nc);
        symmetrise(&mut cc, nc);
        let own = self.own.iter().zip(&q.own).zip(&with_h).map(|((e, qs), k)| self.sandwich_own(e, qs, k, &cc)).collect();
        Arrow { shared: nc, cc, own }
    }

    fn sandwich_own(&self, e: &Eliminated, qs: &Own, k: &[f64], cc: &[f64]) -> Own {
        let (n, nc) = (e.n, self.shared);
        // Covariance of M_ss^-1 g_s with d_c.
        let ik = multiply(&e.inverse, k, n, n, nc);
        let a = multiply(&ik, &self.v, n, nc, nc);
        let tp = multiply(&e.t, cc, n, nc, nc);
        let sc: Vec<f64> = a.iter().zip(&tp).map(|(a, tp)| a - tp).collect();
        let iq = multiply(&e.inverse, &qs.ss, n, n, n);
        let mut ss = multiply(&iq, &e.inverse, n, n, n);
        for i in 0..n {
            for j in 0..n {
                let (ti, tj) = (&e.t[i * nc..(i + 1) * nc], &e.t[j * nc..(j + 1) * nc]);
                ss[i * n + j] -= dot(&a[i * nc..(i + 1) * nc], tj) + dot(&sc[j * nc..(j + 1) * nc], ti);
            }
        }
        symmetrise(&mut ss, n);
        Own { n, ss, sc }
    }
}

pub fn diagonal(matrix: &[f64], n: usize) -> Vec<f64> {
    (0..n).map(|i| matrix[i * n + i]).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `c -= a' b` with `a`, `b` `[n][m]`.
fn subtract_transposed(c: &mut [f64], a: &[f64], b: &[f64], n: usize, m: usize) {
    for k in 0..n {
        for i in 0..m {
            let aki = a[k * m + i];
            for j in 0..m {
                c[i * m + j] -= aki * b[k * m + j];
            }
        }
    }
}

fn symmetrise(a: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..i {
            let mean = 0.5 * (a[i * n + j] + a[j * n + i]);
            a[i * n + j] = mean;
            a[j * n + i] = mean;
        }
    }
}
