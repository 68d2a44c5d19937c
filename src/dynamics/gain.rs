//! A sample that a filter takes, and the derivatives of states and covariance before it, in; those
//! behind it, and those of innovation and variance, out, eight directions at a time.
//!
//! With `g = h/s`: `dx <- dx + nu/s (dh - g ds) - g dy`, `dP_ij <- dP_ij - g_j u_i - g_i u_j`,
//! `u = dh - g ds/2` (the formulas of `innovations`, sorted).

use crate::math::simd::{Eight, by_width};

/// A sample, `n` being the states of the motion.
#[derive(Clone, Copy)]
pub struct Taking<'a> {
    /// The state that is the covariance of two states, `[n][n]`.
    pub places: &'a [usize],
    /// The states that the output depends on, and whether each slope has derivatives.
    pub slopes: &'a [usize],
    pub bent: &'a [bool],
    /// Slopes of the output, zero for other states `[n]`.
    pub c: &'a [f64],
    /// States and covariance before it.
    pub x: &'a [f64],
    /// `P c`, and that over `s`, `[n]`.
    pub h: &'a [f64],
    pub gain: &'a [f64],
    pub nu: f64,
    pub s: f64,
    /// Derivative of the noise's variance `[lanes]`.
    pub dr: &'a [f64],
    /// Derivatives of the output and of its slopes `[1 + slopes][lanes]`.
    pub dc: &'a [f64],
    /// Directions, padded to whole vectors.
    pub lanes: usize,
}

by_width! {
    /// Takes the derivatives `s` (`[state][lanes]`) through a sample; `dh`: scratch, `[n][lanes]`;
    /// `out`: `dy/sqrt(s)` and `ds/s`.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn take(of: Taking, s: &mut [f64], dh: &mut [f64], out: [&mut [f64]; 2]) = take_body
}

#[inline(always)]
unsafe fn take_body<V: Eight>(of: Taking, s: &mut [f64], dh: &mut [f64], out: [&mut [f64]; 2]) {
    let (n, lanes) = (of.h.len(), of.lanes);
    let places = of.places.iter().all(|&place| place < of.x.len());
    assert!(places && of.places.len() == n * n && of.x.len() * lanes <= s.len());
    assert!(lanes.is_multiple_of(8) && of.c.len() == n && of.gain.len() == n);
    assert!(of.slopes.iter().all(|&b| b < n) && of.bent.len() == of.slopes.len());
    assert!(of.dc.len() >= (1 + of.slopes.len()) * lanes && of.dr.len() >= lanes);
    assert!(dh.len() >= n * lanes && out.iter().all(|row| row.len() >= lanes));
    let mut lists =
        Lists { s: s.as_mut_ptr(), dh: dh.as_mut_ptr(), out: out.map(|row| row.as_mut_ptr()) };
    let mut v = 0;
    // SAFETY: the sizes were just checked.
    unsafe {
        while v + 16 <= lanes {
            chunk::<V, 2>(v, &of, &mut lists);
            v += 16;
        }
        if v < lanes {
            chunk::<V, 1>(v, &of, &mut lists);
        }
    }
}

/// Where the numbers stand.
struct Lists {
    s: *mut f64,
    dh: *mut f64,
    out: [*mut f64; 2],
}

/// # Safety
/// The machine has the width; from `p` on `8 K` numbers can be read.
#[inline(always)]
unsafe fn load<V: Eight, const K: usize>(p: *const f64) -> [V; K] {
    // SAFETY: the caller's promises.
    unsafe { std::array::from_fn(|i| V::load(p.add(8 * i))) }
}

/// `by a + b`
///
/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn fma<V: Eight, const K: usize>(by: f64, a: [V; K], b: [V; K]) -> [V; K] {
    // SAFETY: the caller's promise.
    unsafe {
        let by = V::splat(by);
        std::array::from_fn(|i| by.fma(a[i], b[i]))
    }
}

/// # Safety
/// The machine has the width; from `p` on `8 K` numbers can be written.
#[inline(always)]
unsafe fn store<V: Eight, const K: usize>(all: [V; K], p: *mut f64) {
    for (i, one) in all.into_iter().enumerate() {
        // SAFETY: the caller's promises.
        unsafe { one.store(p.add(8 * i)) }
    }
}

/// # Safety
/// As `take_body`, sizes checked.
#[inline(always)]
unsafe fn chunk<V: Eight, const K: usize>(v: usize, of: &Taking, to: &mut Lists) {
    let (n, lanes) = (of.h.len(), of.lanes);
    // SAFETY: the caller's promises.
    unsafe {
        let row = |list: *mut f64, i: usize| list.add(i * lanes + v);
        let dc = |a: usize| load::<V, K>(of.dc.as_ptr().add(a * lanes + v));
        let nothing = [V::splat(0.0); K];
        for i in 0..n {
            let mut sum = nothing;
            for (a, &b) in of.slopes.iter().enumerate() {
                let place = of.places[i * n + b];
                sum = fma(of.c[b], load::<V, K>(row(to.s, place)), sum);
                if of.bent[a] {
                    sum = fma(of.x[place], dc(a + 1), sum);
                }
            }
            store(sum, row(to.dh, i));
        }
        let (dy, mut ds) = (dc(0), load::<V, K>(of.dr.as_ptr().add(v)));
        for (a, &b) in of.slopes.iter().enumerate() {
            ds = fma(of.c[b], load::<V, K>(row(to.dh, b)), ds);
            if of.bent[a] {
                ds = fma(of.h[b], dc(a + 1), ds);
            }
        }
        store(fma(1.0 / of.s.sqrt(), dy, nothing), to.out[0].add(v));
        store(fma(1.0 / of.s, ds, nothing), to.out[1].add(v));
        for i in 0..n {
            let (g, dh) = (of.gain[i], load::<V, K>(row(to.dh, i)));
            let moved = fma(-g, dy, load::<V, K>(row(to.s, i)));
            store(fma(of.nu / of.s, fma(-g, ds, dh), moved), row(to.s, i));
            store(fma(-0.5 * g, ds, dh), row(to.dh, i));
        }
        for i in 0..n {
            let (u, g) = (load::<V, K>(row(to.dh, i)), of.gain[i]);
            for j in 0..=i {
                let at = row(to.s, of.places[i * n + j]);
                let other = fma(-g, load::<V, K>(row(to.dh, j)), load::<V, K>(at));
                store(fma(-of.gain[j], u, other), at);
            }
        }
    }
}
