//! Rows of sensitivities and their residuals in; sums of products of the rows with each other and with the residuals out.
//!
//! The lower triangle of `G'G` is made of tiles of up to eight rows and eight columns, which stay in registers while a stretch of
//! samples passes by. Every sum adds its products in the order of the samples, fused, so that neither the width of the vectors nor the
//! size of a tile changes a bit.

use crate::math::simd::{Eight, Width, by_width};

/// Numbers of the samples that pass through one tile before the next tile has its turn: their rows stay in the nearest cache.
const STRETCH: usize = 4096;

/// Adds the sums over samples whose residual `e` is a number: `gram[nd][nd]` (lower triangle) `+= g g'`, `gradient[nd] += e g`. Rows of
/// `g` have `nd` numbers. The number of such samples and the sum of their `e^2`.
pub fn add(e: &[f64], g: &[f64], nd: usize, gram: &mut [f64], gradient: &mut [f64]) -> (usize, f64) {
    let width = Width::detect();
    let (mut count, mut square) = (0, 0.0);
    let most = (STRETCH / nd.max(1)).clamp(16, 256);
    let mut from = 0;
    while from < e.len() {
        let to = e[from..].iter().position(|e| e.is_nan()).map_or(e.len(), |n| from + n).min(from + most);
        // SAFETY: the width is this machine's.
        unsafe { squares(width, &e[from..to], &mut square) };
        count += to - from;
        stretch(width, &e[from..to], &g[from * nd..to * nd], nd, gram, gradient);
        // past a masked sample, if that is what ended the stretch
        from = if e.get(to).is_some_and(|e| e.is_nan()) { to + 1 } else { to };
    }
    (count, square)
}

/// A stretch without masked samples. Vectors are read eight numbers at a time, beyond the end of a row: the last row goes through a
/// copy with room behind it.
fn stretch(width: Width, e: &[f64], g: &[f64], nd: usize, gram: &mut [f64], gradient: &mut [f64]) {
    let Some(last) = e.len().checked_sub(1).filter(|_| nd > 0) else { return };
    let mut tail = vec![0.0; nd + 8];
    tail[..nd].copy_from_slice(&g[last * nd..]);
    // rows that can be read eight numbers beyond their end without leaving `g`
    let whole = last.min((g.len().saturating_sub(nd + 8)) / nd + usize::from(g.len() >= nd + 8)).min(last);
    sums(width, &e[..whole], g, nd, gram, gradient);
    for k in whole..last {
        let mut row = vec![0.0; nd + 8];
        row[..nd].copy_from_slice(&g[k * nd..(k + 1) * nd]);
        sums(width, &e[k..=k], &row, nd, gram, gradient);
    }
    sums(width, &e[last..], &tail, nd, gram, gradient);
}

fn sums(width: Width, e: &[f64], g: &[f64], nd: usize, gram: &mut [f64], gradient: &mut [f64]) {
    for column in (0..nd).step_by(8) {
        let columns = (nd - column).min(8);
        // SAFETY: the width is this machine's; the callers leave eight numbers behind the last row.
        unsafe { towards(width, e, g, nd, column, &mut gradient[column..column + columns]) };
        for row in (column..nd).step_by(8) {
            // SAFETY: as above.
            unsafe { tile(width, e.len(), g, nd, (row, column), gram) };
        }
    }
}

by_width! { fn squares(e: &[f64], sum: &mut f64) = squares_body }
by_width! { fn towards(e: &[f64], g: &[f64], nd: usize, column: usize, out: &mut [f64]) = towards_body }
by_width! { fn tile(samples: usize, g: &[f64], nd: usize, at: (usize, usize), gram: &mut [f64]) = tile_body }

/// # Safety
/// The machine has the width (without hardware for it a fused multiply-add is a slow call).
#[inline(always)]
#[allow(clippy::extra_unused_type_parameters)]
unsafe fn squares_body<V: Eight>(e: &[f64], sum: &mut f64) {
    for e in e {
        *sum = e.mul_add(*e, *sum);
    }
}

/// # Safety
/// The machine has the width; `g` can be read eight numbers from `column` of every row.
#[inline(always)]
unsafe fn towards_body<V: Eight>(e: &[f64], g: &[f64], nd: usize, column: usize, out: &mut [f64]) {
    let mut lanes = [0.0; 8];
    lanes[..out.len()].copy_from_slice(out);
    // SAFETY: the caller's promise.
    unsafe {
        let mut sum = V::load(lanes.as_ptr());
        for (k, e) in e.iter().enumerate() {
            sum = V::splat(*e).fma(V::load(g.as_ptr().add(k * nd + column)), sum);
        }
        sum.store(lanes.as_mut_ptr());
    }
    out.copy_from_slice(&lanes[..out.len()]);
}

/// # Safety
/// As `towards_body`.
#[inline(always)]
unsafe fn tile_body<V: Eight>(samples: usize, g: &[f64], nd: usize, at: (usize, usize), gram: &mut [f64]) {
    let rows = (nd - at.0).min(8);
    // SAFETY: the caller's promise.
    unsafe {
        match rows {
            1 => tile_of::<V, 1>(samples, g, nd, at, gram),
            2 => tile_of::<V, 2>(samples, g, nd, at, gram),
            3 => tile_of::<V, 3>(samples, g, nd, at, gram),
            4 => tile_of::<V, 4>(samples, g, nd, at, gram),
            5 => tile_of::<V, 5>(samples, g, nd, at, gram),
            6 => tile_of::<V, 6>(samples, g, nd, at, gram),
            7 => tile_of::<V, 7>(samples, g, nd, at, gram),
            _ => tile_of::<V, 8>(samples, g, nd, at, gram),
        }
    }
}

/// # Safety
/// As `towards_body`.
#[inline(always)]
unsafe fn tile_of<V: Eight, const R: usize>(samples: usize, g: &[f64], nd: usize, (row, column): (usize, usize), gram: &mut [f64]) {
    let columns = (nd - column).min(8);
    let mut lanes = [[0.0; 8]; R];
    for (i, lanes) in lanes.iter_mut().enumerate() {
        lanes[..columns].copy_from_slice(&gram[(row + i) * nd + column..][..columns]);
    }
    // SAFETY: the caller's promise.
    unsafe {
        let mut sum: [V; R] = std::array::from_fn(|i| V::load(lanes[i].as_ptr()));
        for k in 0..samples {
            let p = g.as_ptr().add(k * nd);
            let v = V::load(p.add(column));
            for (i, sum) in sum.iter_mut().enumerate() {
                *sum = V::splat(*p.add(row + i)).fma(v, *sum);
            }
        }
        for (sum, lanes) in sum.into_iter().zip(&mut lanes) {
            sum.store(lanes.as_mut_ptr());
        }
    }
    // only the lower triangle is anybody's business
    for (i, lanes) in lanes.iter().enumerate() {
        let part = columns.min(row + i + 1 - column);
        gram[(row + i) * nd + column..][..part].copy_from_slice(&lanes[..part]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_any_size_are_those_written_out_and_of_the_same_bits_at_any_width() {
        for nd in [0, 1, 3, 8, 11, 15, 16, 23, 60] {
            for n in [0, 1, 2, 5, 9, 300] {
                let number = |i: usize| ((i * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5;
                let g: Vec<f64> = (0..n * nd).map(number).collect();
                let mut e: Vec<f64> = (0..n).map(|k| number(k + 31)).collect();
                (0..n).filter(|k| k % 97 == 3).for_each(|k| e[k] = f64::NAN);
                let (mut gram, mut gradient) = (vec![0.0; nd * nd], vec![0.0; nd]);
                let (count, square) = add(&e, &g, nd, &mut gram, &mut gradient);
                let there: Vec<usize> = (0..n).filter(|&k| !e[k].is_nan()).collect();
                assert_eq!(count, there.len());
                assert_eq!(square, there.iter().fold(0.0, |s, &k| e[k].mul_add(e[k], s)));
                for i in 0..nd {
                    assert_eq!(gradient[i], there.iter().fold(0.0, |s, &k| e[k].mul_add(g[k * nd + i], s)), "{nd} {n} {i}");
                    for j in 0..=i {
                        let sum = there.iter().fold(0.0, |s, &k| g[k * nd + i].mul_add(g[k * nd + j], s));
                        assert_eq!(gram[i * nd + j], sum, "{nd} {n} {i} {j}");
                    }
                }
                for width in Width::available() {
                    let (mut again, mut towards) = (vec![0.0; nd * nd], vec![0.0; nd]);
                    if there.len() == n && n <= 16 {
                        stretch(width, &e, &g, nd, &mut again, &mut towards);
                        assert_eq!((&again, &towards), (&gram, &gradient), "{width:?}");
                    }
                }
            }
        }
    }
}
