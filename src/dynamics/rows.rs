//! Sparse Jacobians over lanes of directions: `J_x S + J_p + J_d D`, and the sums of a Runge-Kutta step, eight directions at a time.

use crate::math::simd::{Aligned, Eight, by_width};
use crate::model::linear::Sparse;

/// Distance of two entries of one point in `propagate::Lanes`.
const APART: usize = super::propagate::LANES;

/// One product of a row: the entry of the Jacobian, and the row of S or D it multiplies.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Product {
    entry: u32,
    source: u32,
}

/// The entries of a Jacobian, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rows {
    /// Ends of each row's products with states, then of those with delayed values, in `products`.
    ends: Vec<[u32; 2]>,
    products: Vec<Product>,
    /// Entry, row and direction of what acts on the row itself.
    direct: Vec<(u32, u32, u32)>,
    /// Rows of S and of D that are read: one more than the largest.
    reach: [usize; 2],
    /// One more than the largest direction.
    directions: usize,
}

impl Rows {
    pub fn new(sparse: &Sparse, rows: usize) -> Rows {
        let mut out = Rows::default();
        for row in 0..rows {
            let mut ends = [0; 2];
            for (k, list) in [&sparse.states, &sparse.delayed].into_iter().enumerate() {
                for e in list.iter().filter(|e| e.row == row) {
                    out.products.push(Product { entry: e.output as u32, source: e.column as u32 });
                    out.reach[k] = out.reach[k].max(e.column + 1);
                }
                ends[k] = out.products.len() as u32;
            }
            out.ends.push(ends);
        }
        out.direct = sparse.parameters.iter().map(|e| (e.output as u32, e.row as u32, e.column as u32)).collect();
        out.directions = sparse.parameters.iter().map(|e| e.column + 1).max().unwrap_or(0);
        out
    }
}

by_width! {
    /// `out = J_x s + J_p + J_d delayed`, rows of `lanes` directions; `direct` keeps J_p between calls.
    ///
    /// # Safety
    /// The machine has the width; `values` points to one point's entries, `APART` numbers apart, as many as the Jacobian's program has.
    pub fn stage_rows(
        rows: &Rows, values: *const f64, direct: &mut Aligned, s: &Aligned, delayed: &Aligned, lanes: usize, out: &mut Aligned,
    ) = stage_rows_body
}

#[inline(always)]
#[allow(clippy::too_many_arguments)]
unsafe fn stage_rows_body<V: Eight>(
    rows: &Rows,
    values: *const f64,
    direct: &mut Aligned,
    s: &Aligned,
    delayed: &Aligned,
    lanes: usize,
    out: &mut Aligned,
) {
    let n = rows.ends.len() * lanes;
    assert!(direct.len() >= n && out.len() >= n && s.len() >= rows.reach[0] * lanes && delayed.len() >= rows.reach[1] * lanes);
    assert!(rows.directions <= lanes && lanes.is_multiple_of(8));
    // SAFETY: the sizes were just checked; rows and sources are below what they were checked against; `values` is the caller's promise.
    unsafe {
        let (direct, out, s, delayed) = (direct.as_mut_ptr(), out.as_mut_ptr(), s.as_ptr(), delayed.as_ptr());
        for &(entry, row, direction) in &rows.direct {
            *direct.add(row as usize * lanes + direction as usize) = *values.add(entry as usize * APART);
        }
        let mut v = 0;
        while v + 16 <= lanes {
            let mut from = 0;
            for (row, ends) in rows.ends.iter().enumerate() {
                let (mut a, mut b) = (V::load(direct.add(row * lanes + v)), V::load(direct.add(row * lanes + v + 8)));
                for (end, source) in [(ends[0] as usize, s), (ends[1] as usize, delayed)] {
                    for p in rows.products.get_unchecked(from..end) {
                        let (x, at) = (V::splat(*values.add(p.entry as usize * APART)), source.add(p.source as usize * lanes + v));
                        a = x.fma(V::load(at), a);
                        b = x.fma(V::load(at.add(8)), b);
                    }
                    from = end;
                }
                a.store(out.add(row * lanes + v));
                b.store(out.add(row * lanes + v + 8));
            }
            v += 16;
        }
        if v < lanes {
            let mut from = 0;
            for (row, ends) in rows.ends.iter().enumerate() {
                let mut a = V::load(direct.add(row * lanes + v));
                for (end, source) in [(ends[0] as usize, s), (ends[1] as usize, delayed)] {
                    for p in rows.products.get_unchecked(from..end) {
                        let at = source.add(p.source as usize * lanes + v);
                        a = V::splat(*values.add(p.entry as usize * APART)).fma(V::load(at), a);
                    }
                    from = end;
                }
                a.store(out.add(row * lanes + v));
            }
        }
    }
}

by_width! {
    /// `sum += weight k` (`first`: `sum = weight k`), `next = s + ahead k`.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn combine(k: &Aligned, s: &Aligned, weight: f64, ahead: f64, first: bool, sum: &mut Aligned, next: &mut Aligned) = combine_body
}

#[inline(always)]
unsafe fn combine_body<V: Eight>(
    k: &Aligned,
    s: &Aligned,
    weight: f64,
    ahead: f64,
    first: bool,
    sum: &mut Aligned,
    next: &mut Aligned,
) {
    let n = k.len();
    assert!(n.is_multiple_of(8) && s.len() == n && sum.len() == n && next.len() == n);
    // SAFETY: the sizes were just checked.
    unsafe {
        let (w, c) = (V::splat(weight), V::splat(ahead));
        for i in (0..n).step_by(8) {
            let x = V::load(k.as_ptr().add(i));
            let before = if first { V::splat(0.0) } else { V::load(sum.as_ptr().add(i)) };
            w.fma(x, before).store(sum.as_mut_ptr().add(i));
            c.fma(x, V::load(s.as_ptr().add(i))).store(next.as_mut_ptr().add(i));
        }
    }
}

by_width! {
    /// The step itself, with the last stage's `k`: `s += h6 (sum + k)`.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn stage_end(k: &Aligned, sum: &Aligned, h6: f64, s: &mut Aligned) = stage_end_body
}

#[inline(always)]
unsafe fn stage_end_body<V: Eight>(k: &Aligned, sum: &Aligned, h6: f64, s: &mut Aligned) {
    let n = k.len();
    assert!(n.is_multiple_of(8) && s.len() == n && sum.len() == n);
    // SAFETY: the sizes were just checked.
    unsafe {
        let h = V::splat(h6);
        for i in (0..n).step_by(8) {
            let x = V::load(k.as_ptr().add(i)).add(V::load(sum.as_ptr().add(i)));
            h.fma(x, V::load(s.as_ptr().add(i))).store(s.as_mut_ptr().add(i));
        }
    }
}
