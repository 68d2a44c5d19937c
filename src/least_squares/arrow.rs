//! Normal equations in arrow form: a matrix with one border and one block per segment in; steps and
//! covariances out, in time and memory linear in the number of segments.
//!
//! With `c` the shared parameters and `s` a segment's own, `M` has the blocks `M_cc`, `M_ss`,
//! `M_sc` and zeros between different segments. Every segment is eliminated first:
//! `T_s = M_ss^-1 M_sc`, and what remains is the Schur complement `S = M_cc - sum_s M_cs T_s`.

use crate::math::dense::{self, multiply};
use crate::math::products::dot;

/// One segment's rows of an arrow matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Own {
    /// Number of the segment's own parameters.
    pub n: usize,
    /// The shared parameters that the segment sees: the columns of `sc`, ascending or not, each
    /// once.
    pub columns: Vec<usize>,
    /// `[n][n]`, symmetric.
    pub ss: Vec<f64>,
    /// `[n][columns]`.
    pub sc: Vec<f64>,
}

impl Own {
    /// Nothing in it.
    pub fn empty(n: usize, columns: &[usize]) -> Own {
        Own { n, columns: columns.to_vec(), ss: vec![0.0; n * n], sc: vec![0.0; n * columns.len()] }
    }

    /// Row `i` of `sc`.
    pub fn row(&self, i: usize) -> &[f64] {
        &self.sc[i * self.columns.len()..(i + 1) * self.columns.len()]
    }
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
    columns: Vec<usize>,
    /// `M_ss^-1`.
    inverse: Vec<f64>,
    /// `T_s`, `[n][columns]`.
    t: Vec<f64>,
}

/// Pivots smaller than this share of their diagonal count as zero: what is left of a parameter's
/// information after all others are known. Sensitivities carry rounding errors of some 1e-14, which
/// square to nothing; sums of products carry 1e-16 each.
pub const PIVOT: f64 = 1e-13;

/// Inverse of a symmetric positive definite matrix by Cholesky factors.
///
/// # Errors
/// The first row whose pivot is below `PIVOT` times `scale[i]`: it depends on those before it.
fn invert(matrix: &[f64], scale: &[f64]) -> Result<Vec<f64>, usize> {
    let n = scale.len();
    let l = dense::cholesky(matrix, n)?;
    let sound =
        |i: &usize| l[i * n + i] * l[i * n + i] > PIVOT * scale[*i] && l[i * n + i].is_finite();
    match (0..n).find(|i| !sound(i)) {
        Some(i) => Err(i),
        None => Ok(dense::cholesky_inverse(&l, n)),
    }
}

impl Arrow {
    /// Eliminates every segment, then the border.
    ///
    /// # Errors
    /// The matrix is singular to working precision: the first parameter (index of the whole vector)
    /// that depends on its segment's own ones before it, or a shared one that depends on those
    /// before it and all own ones.
    pub fn factor(&self) -> Result<Factor, usize> {
        let nc = self.shared;
        let mut schur = self.cc.clone();
        let mut own = Vec::with_capacity(self.own.len());
        let mut offset = nc;
        for s in &self.own {
            let inverse = invert(&s.ss, &diagonal(&s.ss, s.n)).map_err(|i| offset + i)?;
            offset += s.n;
            let t = multiply(&inverse, &s.sc, s.n, s.n, s.columns.len());
            subtract_transposed(&mut schur, &s.sc, &t, s.n, &s.columns, nc);
            own.push(Eliminated { n: s.n, columns: s.columns.clone(), inverse, t });
        }
        let v = invert(&schur, &diagonal(&self.cc, nc))?;
        Ok(Factor { shared: nc, v, own })
    }

    /// The Schur complement, not scaled; `None` where a segment's own block is singular.
    pub fn schur(&self) -> Option<Vec<f64>> {
        let mut schur = self.cc.clone();
        for s in &self.own {
            let inverse = invert(&s.ss, &diagonal(&s.ss, s.n)).ok()?;
            let t = multiply(&inverse, &s.sc, s.n, s.n, s.columns.len());
            subtract_transposed(&mut schur, &s.sc, &t, s.n, &s.columns, self.shared);
        }
        Some(schur)
    }

    /// `-M_ss^-1 M_sc x`: how the own parameters of segment `s` follow a change `x` of the shared
    /// ones where they can compensate it; empty where its block is singular.
    pub fn follow(&self, s: usize, x: &[f64]) -> Vec<f64> {
        let own = &self.own[s];
        let Ok(inverse) = invert(&own.ss, &diagonal(&own.ss, own.n)) else { return Vec::new() };
        let force = multiply(&own.sc, &pick(x, &own.columns), own.n, own.columns.len(), 1);
        multiply(&inverse, &force, own.n, own.n, 1).iter().map(|v| -v).collect()
    }

    /// Adds `value` on the diagonal at `index` of the whole vector (shared parameters first, then
    /// segment by segment).
    pub fn add_diagonal(&mut self, index: usize, value: f64) {
        if index < self.shared {
            self.cc[index * self.shared + index] += value;
        } else if let Some((s, i)) = self.place(index) {
            let own = &mut self.own[s];
            own.ss[i * own.n + i] += value;
        }
    }

    /// Of the same form, with nothing in it.
    pub fn empty(&self) -> Arrow {
        let own = self.own.iter().map(|own| Own::empty(own.n, &own.columns)).collect();
        Arrow { shared: self.shared, cc: vec![0.0; self.cc.len()], own }
    }

    /// Adds another one of the same form.
    pub fn add(&mut self, other: &Arrow) {
        let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
        add(&mut self.cc, &other.cc);
        for (own, other) in self.own.iter_mut().zip(&other.own) {
            add(&mut own.ss, &other.ss);
            add(&mut own.sc, &other.sc);
        }
    }

    /// Adds the blocks of `x x'`.
    pub fn add_outer(&mut self, x: &[f64]) {
        let nc = self.shared;
        self.cc.iter_mut().enumerate().for_each(|(k, c)| *c += x[k / nc] * x[k % nc]);
        let mut offset = nc;
        for own in &mut self.own {
            let (n, m) = (own.n, own.columns.len());
            let mine = &x[offset..offset + n];
            own.ss.iter_mut().enumerate().for_each(|(k, c)| *c += mine[k / n] * mine[k % n]);
            let columns = &own.columns;
            own.sc.iter_mut().enumerate().for_each(|(k, c)| *c += mine[k / m] * x[columns[k % m]]);
            offset += n;
        }
    }

    /// Multiplies rows and columns by these numbers, one per parameter of the whole vector.
    pub fn scale(&mut self, by: &[f64]) {
        let nc = self.shared;
        self.cc.iter_mut().enumerate().for_each(|(k, x)| *x *= by[k / nc] * by[k % nc]);
        let mut offset = nc;
        for own in &mut self.own {
            let (n, m) = (own.n, own.columns.len());
            let mine = &by[offset..offset + n];
            own.ss.iter_mut().enumerate().for_each(|(k, x)| *x *= mine[k / n] * mine[k % n]);
            let columns = &own.columns;
            own.sc.iter_mut().enumerate().for_each(|(k, x)| *x *= mine[k / m] * by[columns[k % m]]);
            offset += n;
        }
    }

    /// Element `index` of the diagonal.
    pub fn variance(&self, index: usize) -> Option<f64> {
        if index < self.shared {
            return self.cc.get(index * self.shared + index).copied();
        }
        let (s, k) = self.place(index)?;
        self.own[s].ss.get(k * self.own[s].n + k).copied()
    }

    /// The whole column of a shared parameter.
    pub fn column(&self, index: usize) -> Vec<f64> {
        let nc = self.shared;
        let mut column: Vec<f64> = (0..nc).map(|i| self.cc[i * nc + index]).collect();
        for own in &self.own {
            match own.columns.iter().position(|&c| c == index) {
                Some(at) => column.extend((0..own.n).map(|i| own.row(i)[at])),
                None => column.resize(column.len() + own.n, 0.0),
            }
        }
        column
    }

    /// The whole diagonal.
    pub fn diagonal(&self) -> Vec<f64> {
        let own = self.own.iter().flat_map(|own| diagonal(&own.ss, own.n));
        diagonal(&self.cc, self.shared).into_iter().chain(own).collect()
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
            let seen = pick(d, &own.columns);
            for i in 0..own.n {
                let with_own = dot(&own.ss[i * own.n..(i + 1) * own.n], &d[offset..offset + own.n]);
                sum += d[offset + i] * (with_own + 2.0 * dot(own.row(i), &seen));
            }
            offset += own.n;
        }
        sum
    }

    /// Empties row and column `index`: the parameter carries no information and, in a covariance,
    /// no variance.
    pub fn clear(&mut self, index: usize) {
        let mut nothing = vec![0.0; self.own.iter().fold(self.shared, |n, own| n + own.n)];
        self.pin(&mut nothing, index, 0.0);
        self.add_diagonal(index, -1.0);
    }

    /// Prescribes component `index` of the solution of `M d = rhs` as `value`, without changing the
    /// size of the system.
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
                let nl = own.columns.len();
                if let Some(column) = own.columns.iter().position(|&c| c == index) {
                    for i in 0..own.n {
                        rhs[offset + i] -= own.sc[i * nl + column] * value;
                        own.sc[i * nl + column] = 0.0;
                    }
                }
                offset += own.n;
            }
        } else if let Some((s, k)) = self.place(index) {
            offset = index - k;
            let own = &mut self.own[s];
            let nl = own.columns.len();
            for (i, &column) in own.columns.iter().enumerate() {
                rhs[column] -= own.sc[k * nl + i] * value;
                own.sc[k * nl + i] = 0.0;
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
            for (t, r) in own.rows().zip(&rhs[offset..]) {
                own.columns.iter().zip(t).for_each(|(&c, t)| reduced[c] -= t * r);
            }
            offset += own.n;
        }
        let mut d = multiply(&self.v, &reduced, nc, nc, 1);
        offset = nc;
        for own in &self.own {
            let mut part = multiply(&own.inverse, &rhs[offset..offset + own.n], own.n, own.n, 1);
            let seen = pick(&d, &own.columns);
            part.iter_mut().zip(own.rows()).for_each(|(p, t)| *p -= dot(t, &seen));
            d.extend_from_slice(&part);
            offset += own.n;
        }
        d
    }

    /// The same for a right side that is nothing but in segment `s`: the shared parameters, and those of this
    /// segment.
    pub fn solve_in(&self, s: usize, shared: &[f64], own: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let (nc, e) = (self.shared, &self.own[s]);
        let mut reduced = shared.to_vec();
        for (t, r) in e.rows().zip(own) {
            e.columns.iter().zip(t).for_each(|(&c, t)| reduced[c] -= t * r);
        }
        let d = multiply(&self.v, &reduced, nc, nc, 1);
        let mut part = multiply(&e.inverse, own, e.n, e.n, 1);
        let seen = pick(&d, &e.columns);
        part.iter_mut().zip(e.rows()).for_each(|(p, t)| *p -= dot(t, &seen));
        (d, part)
    }

    /// The blocks of `M^-1 Q M^-1` on the border and of every segment with itself and the border;
    /// `Q` has the same arrow form (blocks between two segments vanish because their noise is
    /// independent). With `Q = M` these are the blocks of `M^-1`.
    ///
    /// For a gradient of covariance `Q` the estimates are `d_c = V h` with
    /// `h = g_c - sum_s T_s' g_s`, and `d_s = M_ss^-1 g_s - T_s d_c`; the blocks are the
    /// covariances of these.
    pub fn sandwich(&self, q: &Arrow) -> Arrow {
        let nc = self.shared;
        let mut qh = q.cc.clone();
        // Covariance of g_s with h, `[n][columns]` (nothing elsewhere): Q_sc - Q_ss T_s.
        let mut with_h = Vec::with_capacity(self.own.len());
        for (e, qs) in self.own.iter().zip(&q.own) {
            let qt = multiply(&qs.ss, &e.t, e.n, e.n, e.columns.len());
            let mut k = qs.sc.clone();
            k.iter_mut().zip(&qt).for_each(|(k, qt)| *k -= qt);
            // var(h) = Q_cc - sum_s (T_s' (Q_sc - Q_ss T_s) + Q_cs T_s)
            subtract_transposed(&mut qh, &e.t, &k, e.n, &e.columns, nc);
            subtract_transposed(&mut qh, &qs.sc, &e.t, e.n, &e.columns, nc);
            with_h.push(k);
        }
        let vq = multiply(&self.v, &qh, nc, nc, nc);
        let mut cc = multiply(&vq, &self.v, nc, nc, nc);
        symmetrise(&mut cc, nc);
        let own = self
            .own
            .iter()
            .zip(&q.own)
            .zip(&with_h)
            .map(|((e, qs), k)| self.sandwich_own(e, qs, k, &cc))
            .collect();
        Arrow { shared: nc, cc, own }
    }

    /// Only the columns that the segment sees are formed: everything needed stays among them.
    fn sandwich_own(&self, e: &Eliminated, qs: &Own, k: &[f64], cc: &[f64]) -> Own {
        let (n, nl) = (e.n, e.columns.len());
        // Covariance of M_ss^-1 g_s with d_c.
        let ik = multiply(&e.inverse, k, n, n, nl);
        let a = multiply(&ik, &square(&self.v, self.shared, &e.columns), n, nl, nl);
        let tp = multiply(&e.t, &square(cc, self.shared, &e.columns), n, nl, nl);
        let sc: Vec<f64> = a.iter().zip(&tp).map(|(a, tp)| a - tp).collect();
        let iq = multiply(&e.inverse, &qs.ss, n, n, n);
        let mut ss = multiply(&iq, &e.inverse, n, n, n);
        for i in 0..n {
            for j in 0..n {
                let (ti, tj) = (&e.t[i * nl..(i + 1) * nl], &e.t[j * nl..(j + 1) * nl]);
                ss[i * n + j] -=
                    dot(&a[i * nl..(i + 1) * nl], tj) + dot(&sc[j * nl..(j + 1) * nl], ti);
            }
        }
        symmetrise(&mut ss, n);
        Own { n, columns: e.columns.clone(), ss, sc }
    }
}

impl Eliminated {
    /// The rows of `t`.
    fn rows(&self) -> impl Iterator<Item = &[f64]> {
        let nl = self.columns.len();
        (0..self.n).map(move |i| &self.t[i * nl..(i + 1) * nl])
    }
}

/// Components `columns` of a vector.
fn pick(x: &[f64], columns: &[usize]) -> Vec<f64> {
    columns.iter().map(|&c| x[c]).collect()
}

/// Rows and columns `columns` of a square matrix of size `n`.
fn square(matrix: &[f64], n: usize, columns: &[usize]) -> Vec<f64> {
    columns.iter().flat_map(|&i| columns.iter().map(move |&j| matrix[i * n + j])).collect()
}

pub fn diagonal(matrix: &[f64], n: usize) -> Vec<f64> {
    (0..n).map(|i| matrix[i * n + i]).collect()
}

/// `c -= a' b` with `a`, `b` `[n][columns]`, into rows and columns `columns` of `c` of size `nc`.
fn subtract_transposed(
    c: &mut [f64],
    a: &[f64],
    b: &[f64],
    n: usize,
    columns: &[usize],
    nc: usize,
) {
    let m = columns.len();
    for k in 0..n {
        let bk = &b[k * m..(k + 1) * m];
        for (aki, &i) in a[k * m..(k + 1) * m].iter().zip(columns) {
            let row = &mut c[i * nc..(i + 1) * nc];
            columns.iter().zip(bk).for_each(|(&j, b)| row[j] -= aki * b);
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
