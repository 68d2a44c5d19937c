//! Covariances and adjoints in, the same after a measurement or a step out: the kernels of the
//! smoother, in place, nothing allocated.
//!
//! A matrix of `n` columns is stored in rows of `m` values, `m` a multiple of eight, the rest zero:
//! every row is whole vectors. All sums run over rows, so that nothing is added across a vector.
//!
//! A step is `F = I + [D; 0]`: constant parameters stay, and only the first `k` of what is smoothed
//! (the states, and the parameters their rates depend on) have columns of `D` that are not zero. It
//! is kept by columns, `[column][y]` with `y` the states in whole vectors: those of `D`, then those
//! of the noise, `Gamma`.

use crate::dynamics::{AHEAD, WEIGHT};
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
