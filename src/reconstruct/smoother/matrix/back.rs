//! An adjoint in, on its way back; the same before a measurement or a step, and what is smoothed with it, out.

use super::{Grid, Size, VECTOR, add, get, mirror, multiply_body, padded, products, put, rows};
use crate::math::simd::{Eight, Width, by_width};

/// Of every noise (`gamma`: its columns, `[q][y]`) what the adjoint `a` and its covariance say of
/// it: `out` is `[g'a, g'A g]` of each.
pub fn noises(aa: &[f64], a: &[f64], size: Size, gamma: &[f64], out: &mut [[f64; 2]]) {
    let Size { m, x, y, .. } = size;
    assert!(x <= y && y <= m && y.is_multiple_of(VECTOR) && m.is_multiple_of(VECTOR));
    assert!(aa.len() >= x * m && a.len() >= y && gamma.len() >= out.len() * y);
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { noises_by(Width::detect(), aa, a, size, gamma, out) }
}

by_width! {
    fn noises_by(aa: &[f64], a: &[f64], size: Size, gamma: &[f64], out: &mut [[f64; 2]]) = noises_body
}

/// # Safety
/// As `noises`.
#[inline(always)]
unsafe fn noises_body<V: Eight>(
    aa: &[f64],
    a: &[f64],
    Size { m, x, y, .. }: Size,
    gamma: &[f64],
    out: &mut [[f64; 2]],
) {
    for (g, out) in gamma.chunks_exact(y).zip(out) {
        let mut lanes = [[0.0; VECTOR]; 2];
        // SAFETY: the caller has checked the sizes.
        unsafe {
            let mut sums = [V::splat(0.0); 2];
            for v in (0..y).step_by(VECTOR) {
                let zero = [V::splat(0.0)];
                // columns beyond the states meet zeros of `g`
                let [b] = products(zero, x, Grid(g, 0, 1), (aa.get_unchecked(v..), m));
                let own: V = get(g, v);
                sums = [own.fma(get(a, v), sums[0]), own.fma(b, sums[1])];
            }
            sums.iter().zip(&mut lanes).for_each(|(sum, lanes)| sum.store(lanes.as_mut_ptr()));
        }
        *out = lanes.map(|[a, b, c, d, e, f, g, h]| ((a + b) + (c + d)) + ((e + f) + (g + h)));
    }
}

/// Adjoint covariance back through a step: `A <- F' A F`, with `D` by rows, `[x][padded(k)]`; `w`
/// is scratch of `n m` values.
pub fn adjoint_step(a: &mut [f64], size: Size, d: &[f64], w: &mut [f64]) {
    let Size { n, m, x, k, .. } = size;
    assert!(x <= k && k <= n && n <= m && m.is_multiple_of(VECTOR));
    assert!(a.len() >= n * m && d.len() >= x * padded(k) && w.len() >= n * m);
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { adjoint_step_by(Width::detect(), a, size, d, w) }
}

by_width! { fn adjoint_step_by(a: &mut [f64], size: Size, d: &[f64], w: &mut [f64]) = adjoint_step_body }

/// # Safety
/// As `adjoint_step`.
#[inline(always)]
unsafe fn adjoint_step_body<V: Eight>(
    a: &mut [f64],
    Size { n, m, x, k, .. }: Size,
    d: &[f64],
    w: &mut [f64],
) {
    let wide = padded(k);
    // SAFETY: the caller has checked the sizes.
    unsafe {
        for v in (0..m).step_by(VECTOR) {
            // W = A F
            let count = if v < wide { x } else { 0 };
            rows::<V>(n, v, count, Grid(a, m, 1), (d, wide), (a, m), (w, m));
        }
        for v in (0..m).step_by(VECTOR) {
            // F' W
            rows::<V>(k, v, x, Grid(d, 1, wide), (w, m), (w, m), (a, m));
        }
    }
    a[k * m..n * m].copy_from_slice(&w[k * m..n * m]);
    mirror(a, n, m);
}

/// Adjoint covariance back through a measurement: `A <- A - b h' - h b' + d h h'`, with `b = A K`
/// and `d = 1/s + K' A K`. Whole vectors of `h` that are zero cost nothing.
pub fn adjoint_update(a: &mut [f64], n: usize, m: usize, h: &[f64], b: &[f64], d: f64) {
    assert!(a.len() >= n * m && h.len() >= m && b.len() >= m && n <= m);
    assert!(m.is_multiple_of(VECTOR));
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { adjoint_update_by(Width::detect(), a, n, m, h, b, d) }
}

by_width! {
    fn adjoint_update_by(a: &mut [f64], n: usize, m: usize, h: &[f64], b: &[f64], d: f64) = adjoint_update_body
}

/// # Safety
/// As `adjoint_update`.
#[inline(always)]
unsafe fn adjoint_update_body<V: Eight>(
    a: &mut [f64],
    n: usize,
    m: usize,
    h: &[f64],
    b: &[f64],
    d: f64,
) {
    // SAFETY: the caller has checked the sizes.
    unsafe {
        for v in (0..m).step_by(VECTOR) {
            if h[v..v + VECTOR].iter().all(|h| *h == 0.0) {
                continue;
            }
            let whole: V = get(h, v);
            for i in 0..n {
                let f = V::splat(d * h.get_unchecked(i) - b.get_unchecked(i));
                put(f.fma(whole, get(a, i * m + v)), a, i * m + v);
            }
        }
    }
    for i in (0..n).filter(|&i| h[i] != 0.0) {
        // SAFETY: the machine has the width.
        unsafe { add::<V>(&mut a[i * m..(i + 1) * m], -h[i], b) };
    }
}

/// `P_s = P - P A P`; `w` is scratch of `n m` values.
pub fn smoothed(p: &[f64], a: &[f64], n: usize, m: usize, w: &mut [f64], out: &mut [f64]) {
    assert!(p.len() >= n * m && a.len() >= n * m && w.len() >= n * m && out.len() >= n * m);
    assert!(n <= m && m.is_multiple_of(VECTOR));
    // SAFETY: the width is this machine's, the sizes were just checked.
    unsafe { smoothed_by(Width::detect(), p, a, n, m, w, out) }
}

by_width! {
    fn smoothed_by(p: &[f64], a: &[f64], n: usize, m: usize, w: &mut [f64], out: &mut [f64]) = smoothed_body
}

/// # Safety
/// As `smoothed`.
#[inline(always)]
unsafe fn smoothed_body<V: Eight>(
    p: &[f64],
    a: &[f64],
    n: usize,
    m: usize,
    w: &mut [f64],
    out: &mut [f64],
) {
    for i in 0..n {
        let row = &p[i * m..(i + 1) * m];
        // SAFETY: the caller has checked the sizes.
        unsafe { multiply_body::<V>(a, n, m, row, &mut w[i * m..(i + 1) * m]) };
    }
    for i in 0..n {
        let row = &mut out[i * m..(i + 1) * m];
        // SAFETY: as above.
        unsafe { multiply_body::<V>(p, n, m, &w[i * m..(i + 1) * m], row) };
        row.iter_mut().zip(&p[i * m..]).for_each(|(out, p)| *out = p - *out);
    }
    mirror(out, n, m);
}
