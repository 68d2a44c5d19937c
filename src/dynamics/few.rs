//! Whole Runge-Kutta steps of S of a model with few states: a block of Jacobians and S in; S at the
//! end of the steps, which stays in registers meanwhile, out.
//!
//! Sums and their order are those of `steps`, and so are the bits.

use super::job::Steps;
use super::rows::{Block, Rows, begin};
use crate::math::simd::Eight;
use std::ops::Range;

/// States at most: two vectors of S, of its sum, of a stage and of the next one for each of four
/// states fill the 32 registers. With more, or with half as many, `steps` is as fast.
const MOST: usize = 4;
/// Stands for an entry that is always zero.
const NONE: u32 = u32::MAX;

/// Per row and state where the entry stands in a file of registers.
type Entries = [[u32; MOST]; MOST];

/// `$do` for `$i` from zero to `$n`, written out: places that constants name can be registers.
macro_rules! all {
    ($i:ident < $n:ident: $do:expr) => { all!($i < $n: $do, 0 1 2 3) };
    ($i:ident < $n:ident: $do:expr, $($at:literal)*) => {$(
        if $at < $n {
            let $i: usize = $at;
            $do;
        }
    )*};
}

/// Does the steps, if there are registers enough (and any directions); else nothing, and says so.
///
/// # Safety
/// As `steps_body`, sizes checked; `stages` are whole steps.
#[inline(always)]
pub(super) unsafe fn steps<V: Eight>(
    block: &Block,
    stages: &Range<usize>,
    job: &mut Steps,
) -> bool {
    if V::COLUMNS < 2 || block.rows.lanes == 0 {
        return false;
    }
    // SAFETY: the caller's promises.
    unsafe {
        match block.rows.rows {
            1 => vectors::<V, 1>(block, stages, job),
            2 => vectors::<V, 2>(block, stages, job),
            3 => vectors::<V, 3>(block, stages, job),
            4 => vectors::<V, 4>(block, stages, job),
            _ => return false,
        }
    }
    true
}

/// # Safety
/// As `steps`; the block has `N` rows.
#[inline(always)]
unsafe fn vectors<V: Eight, const N: usize>(block: &Block, stages: &Range<usize>, job: &mut Steps) {
    let entries = entries(block.rows);
    let mut v = 0;
    // SAFETY: the caller's promises.
    unsafe {
        while v + 16 <= block.rows.lanes {
            chunk::<V, 2, N>(v, block, &entries, stages, job);
            v += 16;
        }
        if v < block.rows.lanes {
            chunk::<V, 1, N>(v, block, &entries, stages, job);
        }
    }
}

/// Of a Jacobian without delayed values.
fn entries(rows: &Rows) -> Entries {
    let (mut entries, mut first) = ([[NONE; MOST]; MOST], 0);
    for (row, &end) in rows.ends.iter().enumerate() {
        for p in &rows.products[first..end as usize] {
            entries[row][p.source as usize / rows.lanes] = p.entry;
        }
        first = end as usize;
    }
    entries
}

/// # Safety
/// As `vectors`; `v + 8 K` directions are there.
#[inline(always)]
unsafe fn chunk<V: Eight, const K: usize, const N: usize>(
    v: usize,
    block: &Block,
    entries: &Entries,
    stages: &Range<usize>,
    job: &mut Steps,
) {
    let (mut phase, mut kept) = (job.phase, job.kept.as_mut_ptr());
    // SAFETY: the caller's promises.
    unsafe {
        let mut s = load::<V, K, N>(job.s.as_ptr().add(v), block.rows.lanes);
        for first in stages.clone().step_by(4) {
            if job.every > 0 {
                if phase == 0 {
                    store(&s, kept.add(v), block.rows.lanes);
                    kept = kept.add(block.rows.size());
                }
                phase = (phase + 1) % job.every;
            }
            step(v, block, entries, first, &job.weights, &mut s);
        }
        store(&s, job.s.as_mut_ptr().add(v), block.rows.lanes);
    }
}

/// One step, whose first stage is `first`.
///
/// # Safety
/// As `chunk`.
#[inline(always)]
unsafe fn step<V: Eight, const K: usize, const N: usize>(
    v: usize,
    block: &Block,
    entries: &Entries,
    first: usize,
    weights: &[[f64; 2]; 4],
    s: &mut [[V; K]; N],
) {
    // SAFETY: the caller's promises.
    unsafe {
        let mut sum = [[V::splat(0.0); K]; N];
        let mut at = *s;
        for (n, [weight, ahead]) in (first..).zip(&weights[..3]) {
            let (weight, ahead, from) = (V::splat(*weight), V::splat(*ahead), at);
            all!(row < N: {
                let k = rate(v, block, entries, n, row, &from);
                for i in 0..K {
                    sum[row][i] = weight.fma(k[i], sum[row][i]);
                    at[row][i] = ahead.fma(k[i], s[row][i]);
                }
            });
        }
        let ahead = V::splat(weights[3][1]);
        all!(row < N: {
            let k = rate(v, block, entries, first + 3, row, &at);
            for i in 0..K {
                s[row][i] = ahead.fma(k[i].add(sum[row][i]), s[row][i]);
            }
        });
    }
}

/// A row of the rates of S at stage `n`, where S is `s`.
///
/// # Safety
/// As `chunk`.
#[inline(always)]
unsafe fn rate<V: Eight, const K: usize, const N: usize>(
    v: usize,
    block: &Block,
    entries: &Entries,
    n: usize,
    row: usize,
    s: &[[V; K]; N],
) -> [V; K] {
    // SAFETY: the caller's promises.
    unsafe {
        let values = block.registers.as_ptr().cast::<f64>().add(n);
        let direct = block.direct.as_ptr().add(n * block.rows.stride);
        let mut sum = begin::<V, K>(direct, block.rows.places(row, v));
        all!(column < N: {
            let entry = entries[row][column];
            if entry != NONE {
                let x = V::splat(*values.add(entry as usize));
                for i in 0..K {
                    sum[i] = x.fma(s[column][i], sum[i]);
                }
            }
        });
        sum
    }
}

/// # Safety
/// `N` rows of `8 K` numbers, `lanes` apart, can be read.
#[inline(always)]
unsafe fn load<V: Eight, const K: usize, const N: usize>(
    from: *const f64,
    lanes: usize,
) -> [[V; K]; N] {
    // SAFETY: the caller's promise.
    std::array::from_fn(|row| {
        std::array::from_fn(|i| unsafe { V::load(from.add(row * lanes + 8 * i)) })
    })
}

/// # Safety
/// As `load`, written.
#[inline(always)]
unsafe fn store<V: Eight, const K: usize, const N: usize>(
    s: &[[V; K]; N],
    to: *mut f64,
    lanes: usize,
) {
    for (row, s) in s.iter().enumerate() {
        for (i, s) in s.iter().enumerate() {
            // SAFETY: the caller's promise.
            unsafe { s.store(to.add(row * lanes + 8 * i)) };
        }
    }
}
