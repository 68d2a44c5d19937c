//! Rows and what of each is wanted in; their sum out: a filter that runs over the rows of a matrix.

use super::simd::{Eight, Width, by_width};

/// A row that takes part, by how far it begins behind the row in question, in numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Term {
    pub factor: f64,
    pub row: isize,
}

/// A row of `n` numbers, `b[to..] = scale (a[at..] + sum of terms of a + sum of terms of b)`: rows
/// of `terms` are counted from `at`, those of `own` from `to`.
pub fn mix(
    (a, at, terms): (&[f64], usize, &[Term]),
    (b, to, own): (&mut [f64], usize, &[Term]),
    n: usize,
    scale: f64,
) {
    let lies = |rows: &[f64], at: usize, terms: &[Term]| {
        let begins = |term: &Term| at.checked_add_signed(term.row);
        at + n <= rows.len()
            && terms.iter().all(|term| begins(term).is_some_and(|from| from + n <= rows.len()))
    };
    assert!(lies(a, at, terms) && lies(b, to, own));
    // SAFETY: the width is this machine's, and all rows lie where they should.
    unsafe {
        let (a, b) = (a.as_ptr().add(at), b.as_mut_ptr().add(to));
        rows(Width::detect(), a, terms, b, own, n, scale)
    }
}

by_width! {
    /// See `mix`.
    fn rows(a: *const f64, terms: &[Term], b: *mut f64, own: &[Term], n: usize, scale: f64) = rows_body
}

/// # Safety
/// The machine has the width; every row has `n` numbers.
#[inline(always)]
unsafe fn rows_body<V: Eight>(
    a: *const f64,
    terms: &[Term],
    b: *mut f64,
    own: &[Term],
    n: usize,
    scale: f64,
) {
    let mut at = 0;
    // SAFETY: the caller's promises; the last vector may overlap the one before it, whose numbers it
    // writes again.
    unsafe {
        while at + 32 <= n {
            vectors::<V, 4>(a.add(at), terms, b.add(at), own, scale);
            at += 32;
        }
        while at + 8 <= n {
            vectors::<V, 1>(a.add(at), terms, b.add(at), own, scale);
            at += 8;
        }
        if at < n && n >= 8 {
            vectors::<V, 1>(a.add(n - 8), terms, b.add(n - 8), own, scale);
            return;
        }
        for at in at..n {
            let mut sum = *a.add(at);
            for term in terms {
                sum = term.factor.mul_add(*a.add(at).offset(term.row), sum);
            }
            for term in own {
                sum = term.factor.mul_add(*b.add(at).offset(term.row), sum);
            }
            *b.add(at) = sum * scale;
        }
    }
}

/// # Safety
/// The machine has the width; every row has `8 N` numbers.
#[inline(always)]
unsafe fn vectors<V: Eight, const N: usize>(
    a: *const f64,
    terms: &[Term],
    b: *mut f64,
    own: &[Term],
    scale: f64,
) {
    // SAFETY: the caller's promises.
    unsafe {
        let mut sums: [V; N] = std::array::from_fn(|k| V::load(a.add(8 * k)));
        for (rows, terms) in [(a, terms), (b.cast_const(), own)] {
            for term in terms {
                let (factor, row) = (V::splat(term.factor), rows.offset(term.row));
                for (k, sum) in sums.iter_mut().enumerate() {
                    *sum = factor.fma(V::load(row.add(8 * k)), *sum);
                }
            }
        }
        let (scale, zero) = (V::splat(scale), V::splat(0.0));
        for (k, sum) in sums.iter().enumerate() {
            sum.fma(scale, zero).store(b.add(8 * k));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_any_length_are_mixed_and_all_widths_mix_the_same_bits() {
        for n in [1, 7, 8, 13, 40, 71] {
            let a: Vec<f64> = (0..3 * n).map(|k| libm::sin(0.7 * k as f64)).collect();
            let b: Vec<f64> = (0..2 * n).map(|k| libm::cos(0.3 * k as f64)).collect();
            let back = -(n as isize);
            let terms = [Term { factor: 0.4, row: back }, Term { factor: -0.3, row: 2 * back }];
            let own = [Term { factor: 0.25, row: back }];
            let mut mixed = b.clone();
            mix((&a, 2 * n, &terms), (&mut mixed, n, &own), n, 1.5);
            assert_eq!(mixed[..n], b[..n]);
            for k in 0..n {
                let want = 1.5 * (a[2 * n + k] + 0.4 * a[n + k] - 0.3 * a[k] + 0.25 * b[k]);
                assert!((mixed[n + k] - want).abs() < 1e-14, "{n} {k}");
            }
            for width in Width::available() {
                let mut other = b.clone();
                let (a, b) = (a[2 * n..].as_ptr(), other[n..].as_mut_ptr());
                // SAFETY: the machine has the width, and the rows lie in both lists.
                unsafe { rows(*width, a, &terms, b, &own, n, 1.5) };
                assert_eq!(other, mixed, "{n} {width:?}");
            }
        }
    }
}
