//! Rows of sensitivities and their residuals in; sums of products of the rows with each other and
//! with the residuals out.
//!
//! The lower triangle of `G'G`, and behind it `e'G` as one more row, is made of tiles of up to nine
//! rows and sixteen columns, which stay in registers while a stretch of samples passes by. Every
//! sum adds its products in the order of the samples, fused, so that neither the width of the
//! vectors nor the size of a tile changes a bit.

use crate::math::simd::{Eight, Width, by_width};

/// Numbers of the samples that pass through one tile before the next tile has its turn: their rows
/// stay in the nearest cache.
const STRETCH: usize = 4096;

/// Numbers that [`add`] wants room for.
pub fn room(nd: usize) -> usize {
    (nd + 1) * nd.next_multiple_of(8)
}

/// The sums over samples whose residual `e` is a number, in `sums[nd + 1][nd, padded to eight]`: `g g'`
/// (of its rows what stands left of the diagonal, and the diagonal; the rest is anything), and `e g` as the
/// last row. Rows of `g` have `nd` numbers. The number of such samples and the sum of their `e^2`.
pub fn add(e: &[f64], g: &[f64], nd: usize, sums: &mut [f64]) -> (usize, f64) {
    add_of(Width::detect(), e, g, nd, sums)
}

fn add_of(width: Width, e: &[f64], g: &[f64], nd: usize, sums: &mut [f64]) -> (usize, f64) {
    let sums = &mut sums[..room(nd)];
    let (mut count, mut square) = (0, 0.0);
    let most = (STRETCH / nd.max(1)).clamp(16, 256);
    let mut from = 0;
    while from < e.len() {
        let to = e[from..]
            .iter()
            .take(most)
            .position(|e| e.is_nan())
            .map_or(e.len().min(from + most), |n| from + n);
        if to > from {
            let (e, g) = (&e[from..to], &g[from * nd..to * nd]);
            // SAFETY: the width is this machine's.
            unsafe { stretch(width, e, g, nd, count == 0, sums, &mut square) };
        }
        count += to - from;
        // past a masked sample, if that is what ended the stretch
        from = if e.get(to).is_some_and(|e| e.is_nan()) { to + 1 } else { to };
    }
    if count == 0 {
        sums.fill(0.0);
    }
    (count, square)
}

by_width! {
    /// A stretch without masked samples: `sums[nd + 1][nd, padded to eight]`, of which nothing is
    /// there yet at the `first` one, and the sum of `e^2`.
    fn stretch(e: &[f64], g: &[f64], nd: usize, first: bool, sums: &mut [f64], square: &mut f64) = stretch_body
}

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn stretch_body<V: Eight>(
    e: &[f64],
    g: &[f64],
    nd: usize,
    first: bool,
    sums: &mut [f64],
    square: &mut f64,
) {
    let stride = nd.next_multiple_of(8);
    assert!(g.len() >= e.len() * nd && sums.len() >= (nd + 1) * stride);
    let mut all = Sums { e, g, nd, stride, first, sums, square: 0.0 };
    // SAFETY: the sizes were just checked; tiles lie in the matrix.
    unsafe {
        let mut column = 0;
        while column < stride {
            let two = V::COLUMNS > 1 && column + 8 < stride;
            let mut row = column;
            if two {
                // beside the diagonal there is nothing to the right of the first eight rows
                tile::<V, 8, 1, 0>(&mut all, row, column);
                row += 8;
            }
            while row + 8 < nd {
                if two {
                    tile::<V, 8, 2, 0>(&mut all, row, column)
                } else {
                    tile::<V, 8, 1, 0>(&mut all, row, column)
                }
                row += 8;
            }
            all.square = *square;
            macro_rules! last {
                ($($rows:literal)*) => {
                    match (nd - row, two) {
                        $(($rows, true) => tile::<V, $rows, 2, 1>(&mut all, row, column),
                        ($rows, false) => tile::<V, $rows, 1, 1>(&mut all, row, column),)*
                        _ => {}
                    }
                };
            }
            last!(1 2 3 4 5 6 7 8);
            column += if two { 16 } else { 8 };
        }
        if nd == 0 {
            all.square = e.iter().fold(*square, |sum, e| e.mul_add(*e, sum));
        }
    }
    *square = all.square;
}

struct Sums<'a> {
    e: &'a [f64],
    g: &'a [f64],
    nd: usize,
    stride: usize,
    /// Nothing was added yet.
    first: bool,
    sums: &'a mut [f64],
    /// The sum of `e^2` after a tile with the residuals' row.
    square: f64,
}

/// `R` rows and `C` times eight columns; with `E = 1` also the row of the residuals.
///
/// # Safety
/// The machine has the width; the tile lies in the matrix.
#[inline(always)]
unsafe fn tile<V: Eight, const R: usize, const C: usize, const E: usize>(
    all: &mut Sums,
    row: usize,
    column: usize,
) {
    let (nd, stride) = (all.nd, all.stride);
    let last = nd.min(column + 8 * C) - (column + 8 * (C - 1));
    let zero = [[0.0; 8]; C];
    // SAFETY: the caller's promise; of the last vector of a row no more is read than there is.
    unsafe {
        let at = |i: usize, c: usize| (row + i) * stride + column + 8 * c;
        let places = all.sums.as_mut_ptr();
        let before = |at: usize, c: usize| {
            V::load(if all.first { zero[c].as_ptr() } else { places.add(at) })
        };
        let mut sum: [[V; C]; R] =
            std::array::from_fn(|i| std::array::from_fn(|c| before(at(i, c), c)));
        let towards = |c: usize| nd * stride + column + 8 * c;
        let mut slope: [V; C] = std::array::from_fn(|c| match E {
            1 => before(towards(c), c),
            _ => V::load(zero[c].as_ptr()),
        });
        let mut square = all.square;
        for (k, e) in all.e.iter().enumerate() {
            let p = all.g.as_ptr().add(k * nd);
            let v: [V; C] = std::array::from_fn(|c| {
                let from = p.add(column + 8 * c);
                if c + 1 == C { V::load_first(from, last) } else { V::load(from) }
            });
            for (i, sum) in sum.iter_mut().enumerate() {
                let x = V::splat(*p.add(row + i));
                for (sum, v) in sum.iter_mut().zip(v) {
                    *sum = x.fma(v, *sum);
                }
            }
            if E == 1 {
                let x = V::splat(*e);
                for (slope, v) in slope.iter_mut().zip(v) {
                    *slope = x.fma(v, *slope);
                }
                square = e.mul_add(*e, square);
            }
        }
        for (i, sum) in sum.into_iter().enumerate() {
            for (c, sum) in sum.into_iter().enumerate() {
                sum.store(places.add(at(i, c)));
            }
        }
        if E == 1 {
            for (c, slope) in slope.into_iter().enumerate() {
                slope.store(places.add(towards(c)));
            }
            all.square = square;
        }
    }
}

/// `to += w from`, number by number.
pub fn add_scaled(to: &mut [f64], w: f64, from: &[f64]) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += w * f;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_any_size_are_those_written_out_and_of_the_same_bits_at_any_width() {
        for nd in [0, 1, 3, 8, 9, 11, 15, 16, 23, 24, 25, 60] {
            for n in [0, 1, 2, 5, 9, 300] {
                let number = |i: usize| ((i * 7919 + 13) % 1009) as f64 / 1009.0 - 0.5;
                let g: Vec<f64> = (0..n * nd).map(number).collect();
                let mut e: Vec<f64> = (0..n).map(|k| number(k + 31)).collect();
                (0..n).filter(|k| k % 97 == 3).for_each(|k| e[k] = f64::NAN);
                let stride = nd.next_multiple_of(8);
                let mut sums = vec![f64::NAN; room(nd)];
                let (count, square) = add(&e, &g, nd, &mut sums);
                let there: Vec<usize> = (0..n).filter(|&k| !e[k].is_nan()).collect();
                assert_eq!(count, there.len());
                assert_eq!(square, there.iter().fold(0.0, |s, &k| e[k].mul_add(e[k], s)));
                for i in 0..nd {
                    assert_eq!(
                        sums[nd * stride + i],
                        there.iter().fold(0.0, |s, &k| e[k].mul_add(g[k * nd + i], s)),
                        "{nd} {n} {i}"
                    );
                    for j in 0..=i {
                        let sum =
                            there.iter().fold(0.0, |s, &k| g[k * nd + i].mul_add(g[k * nd + j], s));
                        assert_eq!(sums[i * stride + j], sum, "{nd} {n} {i} {j}");
                    }
                }
                for &width in Width::available() {
                    let mut again = vec![0.0; room(nd)];
                    assert_eq!(add_of(width, &e, &g, nd, &mut again), (count, square), "{width:?}");
                    let told = |sums: &[f64], row: usize| {
                        sums[row * stride..][..(row + 1).min(nd)].to_vec()
                    };
                    for row in 0..=nd {
                        assert_eq!(told(&again, row), told(&sums, row), "{width:?}");
                    }
                }
            }
        }
    }
}
