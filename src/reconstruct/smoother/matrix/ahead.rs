//! A covariance in; the same after a measurement or a step out.

use super::{Grid, Size, VECTOR, add, get, mirror, padded, put, rows};
use crate::dynamics::{AHEAD, WEIGHT};
use crate::math::simd::{Eight, Width, by_width};

/// `g = P h` for a row `h` that is zero but at the places `at`.
pub fn seen(p: &[f64], m: usize, h: &[f64], at: &[usize], g: &mut [f64]) {
    assert!(at.iter().all(|&j| j < h.len() && (j + 1) * m <= p.len()) && g.len() >= m);
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { seen_by(Width::detect(), p, m, h, at, g) }
}

by_width! { fn seen_by(p: &[f64], m: usize, h: &[f64], at: &[usize], g: &mut [f64]) = seen_body }

/// # Safety
/// As `seen`.
#[inline(always)]
unsafe fn seen_body<V: Eight>(p: &[f64], m: usize, h: &[f64], at: &[usize], g: &mut [f64]) {
    // SAFETY: the caller has checked the sizes.
    unsafe {
        for v in (0..m).step_by(VECTOR) {
            let mut sum = V::splat(0.0);
            for &j in at {
                sum = V::splat(h[j]).fma(get(p, j * m + v), sum);
            }
            put(sum, g, v);
        }
    }
}

/// `P <- P - a a'`, which stays symmetric to the bit: a product does not know its order.
pub fn deduct(p: &mut [f64], n: usize, m: usize, a: &[f64]) {
    assert!(p.len() >= n * m && a.len() >= m && n <= m && m.is_multiple_of(VECTOR));
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { deduct_by(Width::detect(), p, n, m, a) }
}

by_width! { fn deduct_by(p: &mut [f64], n: usize, m: usize, a: &[f64]) = deduct_body }

/// # Safety
/// As `deduct`.
#[inline(always)]
unsafe fn deduct_body<V: Eight>(p: &mut [f64], n: usize, m: usize, a: &[f64]) {
    // SAFETY: the caller has checked the sizes.
    unsafe {
        for v in (0..m).step_by(VECTOR) {
            let whole: V = get(a, v);
            for i in 0..n {
                let minus = V::splat(-*a.get_unchecked(i));
                put(minus.fma(whole, get(p, i * m + v)), p, i * m + v);
            }
        }
    }
}

/// `P <- (I - K h') P (I - K h')' + r K K'` (Joseph), given `g = P h`: symmetric and positive
/// whatever was rounded in `K`.
#[allow(clippy::too_many_arguments)]
pub fn joseph(
    p: &mut [f64],
    n: usize,
    m: usize,
    h: &[f64],
    at: &[usize],
    g: &[f64],
    k: &[f64],
    r: f64,
) {
    assert!(p.len() >= n * m && h.len() >= m && g.len() >= m && k.len() >= m);
    assert!(at.iter().all(|&j| j < n) && n <= m && m.is_multiple_of(VECTOR));
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { joseph_by(Width::detect(), p, n, m, h, at, g, k, r) }
}

by_width! {
    fn joseph_by(
        p: &mut [f64], n: usize, m: usize, h: &[f64], at: &[usize], g: &[f64], k: &[f64], r: f64,
    ) = joseph_body
}

/// # Safety
/// As `joseph`.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
unsafe fn joseph_body<V: Eight>(
    p: &mut [f64],
    n: usize,
    m: usize,
    h: &[f64],
    at: &[usize],
    g: &[f64],
    k: &[f64],
    r: f64,
) {
    for i in 0..n {
        let row = &mut p[i * m..(i + 1) * m];
        // SAFETY: the machine has the width.
        unsafe { add::<V>(row, -k[i], g) };
        let left: f64 = at.iter().map(|&j| row[j] * h[j]).sum();
        let upto = padded(i + 1);
        // SAFETY: as above.
        unsafe { add::<V>(&mut row[..upto], r * k[i] - left, &k[..upto]) };
    }
    mirror(p, n, m);
}

/// The step's columns `[D | Gamma]` over `h` s by the classic Runge-Kutta on `S' = A S + B`:
/// `rates` are the columns of `[A | B]` at the four stages, `[4][k + q][y]`; `scratch` has three
/// times the size of a step.
pub fn transition(step: &mut [f64], size: Size, rates: &[f64], scratch: &mut [f64], h: f64) {
    let (Size { x, y, k, .. }, all) = (size, size.step());
    assert!(step.len() >= all && rates.len() >= 4 * all && scratch.len() >= 3 * all);
    assert!(x <= k && x <= y && y.is_multiple_of(VECTOR));
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { transition_by(Width::detect(), step, size, rates, scratch, h) }
}

by_width! {
    fn transition_by(step: &mut [f64], size: Size, rates: &[f64], scratch: &mut [f64], h: f64) = transition_body
}

/// # Safety
/// As `transition`.
#[inline(always)]
unsafe fn transition_body<V: Eight>(
    step: &mut [f64],
    size: Size,
    rates: &[f64],
    scratch: &mut [f64],
    h: f64,
) {
    let (Size { x, y, k, q, .. }, all) = (size, size.step());
    let (stage, rest) = scratch[..3 * all].split_at_mut(all);
    let (slopes, own) = rest.split_at_mut(all);
    own[..x * y].fill(0.0);
    for l in 0..4 {
        let rates = &rates[l * all..(l + 1) * all];
        if l == 0 {
            // the first stage begins at the identity: of a state that is a column of A
            slopes.copy_from_slice(rates);
        } else {
            own[x * y..].copy_from_slice(&rates[x * y..]);
            for v in (0..y).step_by(VECTOR) {
                // SAFETY: the caller has checked the sizes.
                unsafe {
                    let (to, c) = ((&mut *slopes, y), Grid(stage, y, 1));
                    rows::<V>(k + q, v, x, c, (rates, y), (own, y), to);
                }
            }
        }
        // SAFETY: as above.
        unsafe {
            let (weight, ahead) = (V::splat(h / 6.0 * WEIGHT[l]), V::splat(AHEAD[l.min(2)] * h));
            for at in (0..all).step_by(VECTOR) {
                let slope: V = get(slopes, at);
                let sum = if l == 0 { V::splat(0.0) } else { get(step, at) };
                put(weight.fma(slope, sum), step, at);
                put(ahead.fma(slope, V::splat(0.0)), stage, at);
            }
        }
        (0..x).for_each(|i| stage[i * y + i] += 1.0);
    }
}

/// `P <- F P F' + sum q_l g_l g_l'`; `w` is scratch of `n y` values.
pub fn predict(p: &mut [f64], size: Size, step: &[f64], q: &[f64], w: &mut [f64]) {
    let Size { n, m, x, y, k, q: noises } = size;
    assert!(x <= k && k <= n && n <= m && x <= y && y <= m);
    assert!(m.is_multiple_of(VECTOR) && y.is_multiple_of(VECTOR));
    assert!(p.len() >= n * m && step.len() >= size.step() && q.len() >= noises && w.len() >= n * y);
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { predict_by(Width::detect(), p, size, step, q, w) }
}

by_width! { fn predict_by(p: &mut [f64], size: Size, step: &[f64], q: &[f64], w: &mut [f64]) = predict_body }

/// # Safety
/// As `predict`.
#[inline(always)]
unsafe fn predict_body<V: Eight>(
    p: &mut [f64],
    Size { n, m, x, y, k, q: noises }: Size,
    step: &[f64],
    q: &[f64],
    w: &mut [f64],
) {
    // SAFETY: the caller has checked the sizes.
    unsafe {
        // W = P F', its columns of states
        for v in (0..y).step_by(VECTOR) {
            rows::<V>(n, v, k, Grid(p, m, 1), (step, y), (p, m), (w, y));
        }
        // F W, its rows of states
        for v in (0..y).step_by(VECTOR) {
            rows::<V>(x, v, k, Grid(step, 1, y), (w, y), (w, y), (p, m));
            for i in 0..x {
                let mut sum: V = get(p, i * m + v);
                for l in 0..noises {
                    let g = &step[(k + l) * y..];
                    let f = V::splat(*q.get_unchecked(l) * *g.get_unchecked(i));
                    sum = f.fma(get(g, v), sum);
                }
                put(sum, p, i * m + v);
            }
        }
        // of what stands behind the states within a vector, and of all others, `W` is the new value
        for r in x..n {
            for i in 0..x {
                let value = *w.get_unchecked(r * y + i);
                *p.get_unchecked_mut(r * m + i) = value;
                *p.get_unchecked_mut(i * m + r) = value;
            }
        }
    }
    mirror(p, x, m);
}
