//! Columns in; sums of products of each with each, side by side and each as if it were alone, out.

use super::simd::{Eight, by_width};

by_width! {
    /// Adds to sum `[i][j]` the products of column `i` of `a`, all of one length, with column `j` of `b`, none of
    /// them shorter; where `upper`, with those from column `i` on.
    pub fn add_products(a: &[&[f64]], b: &[&[f64]], upper: bool, sums: &mut [f64]) = add_products_body
}

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn add_products_body<V: Eight>(a: &[&[f64]], b: &[&[f64]], upper: bool, sums: &mut [f64]) {
    // SAFETY: the caller's promise.
    unsafe { tiles::<V, true>(a, b, upper, sums) }
}

by_width! {
    /// The same with sums as `products::dot` makes them.
    pub fn add_each(a: &[&[f64]], b: &[&[f64]], sums: &mut [f64]) = add_each_body
}

/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn add_each_body<V: Eight>(a: &[&[f64]], b: &[&[f64]], sums: &mut [f64]) {
    // SAFETY: the caller's promise.
    unsafe { tiles::<V, false>(a, b, false, sums) }
}

/// As many products side by side as there are registers for: what is loaded meets several others, and no sum
/// waits for the one before. Each is summed as if it were alone.
///
/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn tiles<V: Eight, const FUSED: bool>(
    a: &[&[f64]],
    b: &[&[f64]],
    upper: bool,
    sums: &mut [f64],
) {
    let mut i = 0;
    while i < a.len() {
        let first = if upper { i } else { 0 };
        let (a, b, sums) = (&a[i..], &b[first..], &mut sums[i * b.len() + first..]);
        let stride = first + b.len();
        // SAFETY: the machine has the width.
        i += unsafe {
            match a.len() {
                4.. if V::COLUMNS > 1 => strip::<V, 4, FUSED>(a, b, upper, sums, stride),
                2.. => strip::<V, 2, FUSED>(a, b, upper, sums, stride),
                _ => strip::<V, 1, FUSED>(a, b, upper, sums, stride),
            }
        };
    }
}

/// The first `M` of `a` with all of `b`; rows of sums are `stride` apart. Says how many.
///
/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn strip<V: Eight, const M: usize, const FUSED: bool>(
    a: &[&[f64]],
    b: &[&[f64]],
    upper: bool,
    sums: &mut [f64],
    stride: usize,
) -> usize {
    let a: [&[f64]; M] = std::array::from_fn(|m| a[m]);
    let mut j = 0;
    while j < b.len() {
        let (b, sums) = (&b[j..], &mut sums[j..]);
        let below = if upper { j } else { M };
        // SAFETY: the machine has the width.
        j += unsafe {
            match b.len() {
                4.. if V::COLUMNS > 1 || M == 1 => {
                    tile::<V, M, 4, FUSED>(a, b, below, sums, stride)
                }
                2.. => tile::<V, M, 2, FUSED>(a, b, below, sums, stride),
                _ => tile::<V, M, 1, FUSED>(a, b, below, sums, stride),
            }
        };
    }
    M
}

/// `M` with the first `N` of `b`, but for those of which `b` stands before `a`: `below` is how many of `a`
/// the first of `b` stands behind. Says how many.
///
/// # Safety
/// The machine has the width.
#[inline(always)]
unsafe fn tile<V: Eight, const M: usize, const N: usize, const FUSED: bool>(
    a: [&[f64]; M],
    b: &[&[f64]],
    below: usize,
    sums: &mut [f64],
    stride: usize,
) -> usize {
    let b: [&[f64]; N] = std::array::from_fn(|n| b[n]);
    let rows = a[0].len();
    let whole = rows - rows % 8;
    assert!(a.iter().all(|a| a.len() == rows) && b.iter().all(|b| b.len() >= rows));
    let mut lanes = [[[0.0; 8]; N]; M];
    // SAFETY: eight numbers from every such place on lie in all of them.
    unsafe {
        let mut sums = [[V::splat(0.0); N]; M];
        for k in (0..whole).step_by(8) {
            let a: [V; M] = std::array::from_fn(|m| V::load(a[m].as_ptr().add(k)));
            for n in 0..N {
                let b = V::load(b[n].as_ptr().add(k));
                for m in 0..M {
                    let sum = &mut sums[m][n];
                    *sum = if FUSED { a[m].fma(b, *sum) } else { sum.add(a[m].mul(b)) };
                }
            }
        }
        for (sums, lanes) in sums.iter().zip(&mut lanes) {
            sums.iter().zip(lanes).for_each(|(sum, lanes)| sum.store(lanes.as_mut_ptr()));
        }
    }
    for m in 0..M {
        for n in (0..N).filter(|n| below + n >= m) {
            let sum = lanes[m][n].iter().sum::<f64>();
            let rest = a[m][whole..].iter().zip(&b[n][whole..]);
            sums[m * stride + n] += if FUSED {
                rest.fold(sum, |sum, (a, b)| a.mul_add(*b, sum))
            } else {
                sum + rest.map(|(a, b)| a * b).sum::<f64>()
            };
        }
    }
    N
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::products::{PIECE, dot, upper_rows, with_lags};
    use crate::math::simd::Width;

    #[test]
    fn sums_side_by_side_have_the_bits_of_each_alone_whatever_the_width() {
        let bits = |sums: &[f64]| sums.iter().map(|x| x.to_bits()).collect::<Vec<u64>>();
        // Lanes and the rest behind them, one after the other, as every width and tile has to add them.
        let alone = |a: &[f64], b: &[f64]| {
            let mut lanes = [0.0; 8];
            let whole = a.len() / 8 * 8;
            (0..whole).for_each(|k| lanes[k % 8] = a[k].mul_add(b[k], lanes[k % 8]));
            (whole..a.len()).fold(lanes.iter().sum(), |sum: f64, k| a[k].mul_add(b[k], sum))
        };
        for rows in [0, 1, 7, 8, 9, 16, 23, 64, 77, PIECE - 1, PIECE, PIECE + 1, 2 * PIECE + 13] {
            let columns: Vec<Vec<f64>> = (0..11)
                .map(|c| (0..rows).map(|k| libm::sin((0.7 + c as f64) * k as f64)).collect())
                .collect();
            let all: Vec<&[f64]> = columns.iter().map(|column| &column[..]).collect();
            for n in 1..=all.len() {
                let b = &all[..n];
                for m in 0..=n {
                    let mut upper = vec![0.0; m * n];
                    for (i, j) in (0..m).flat_map(|i| (i..n).map(move |j| (i, j))) {
                        let pieces = b[i].chunks(PIECE).zip(b[j].chunks(PIECE));
                        pieces.for_each(|(a, b)| upper[i * n + j] += alone(a, b));
                    }
                    assert_eq!(bits(&upper_rows(b, m)), bits(&upper), "{rows} {n} {m}");

                    // Columns that begin later meet the beginnings of the others.
                    let late: Vec<&[f64]> = all[..m].iter().map(|a| &a[rows / 3..]).collect();
                    let pairs = || late.iter().flat_map(|&a| b.iter().map(move |&b| (a, b)));
                    let products = pairs().map(|(a, b)| 0.25 + alone(a, b)).collect::<Vec<f64>>();
                    let dots = pairs().map(|(a, b)| 0.25 + dot(a, b)).collect::<Vec<f64>>();
                    for &width in Width::available() {
                        let (mut sums, mut plain) = (vec![0.25; m * n], vec![0.25; m * n]);
                        // SAFETY: the machine has the width.
                        unsafe {
                            add_products(width, &late, b, false, &mut sums);
                            add_each(width, &late, b, &mut plain);
                        }
                        assert_eq!(bits(&sums), bits(&products), "{rows} {n} {m} {width:?}");
                        assert_eq!(bits(&plain), bits(&dots), "{rows} {n} {m} {width:?}");
                        let mut sums = vec![0.0; m * n];
                        for from in (0..rows).step_by(PIECE) {
                            let rows = from..(from + PIECE).min(rows);
                            let b: Vec<&[f64]> = b.iter().map(|b| &b[rows.clone()]).collect();
                            // SAFETY: the machine has the width.
                            unsafe { add_products(width, &b[..m], &b, true, &mut sums) };
                        }
                        assert_eq!(bits(&sums), bits(&upper), "{rows} {n} {m} {width:?}");
                    }
                }
            }
            for lags in (0..rows).take(20) {
                let want: Vec<f64> = (0..=lags)
                    .map(|lag| alone(&all[0][lags..], &all[0][lags - lag..rows - lag]))
                    .collect();
                assert_eq!(bits(&with_lags(all[0], lags)), bits(&want), "{rows} {lags}");
            }
        }
    }
}
