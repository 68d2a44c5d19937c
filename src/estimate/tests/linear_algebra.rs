//! The arrow elimination and the lag sums against the same formulas written with full matrices.

use super::{Toy, normal, rng};
use crate::estimate::colour::{Source, tests_only};
use crate::least_squares::{Arrow, Covariance, Layout, Own};
use crate::math::dense::{cholesky, cholesky_inverse, multiply, transpose};
use crate::noise::Ar;

/// A random positive definite arrow: the sum of squares of random rows, each over the border and
/// one segment.
fn random_arrow(seed: u64, nc: usize, own: &[usize]) -> Arrow {
    let mut rng = rng(seed);
    let mut arrow = Arrow { shared: nc, cc: vec![0.0; nc * nc], own: vec![] };
    for &n in own {
        let mut block = Own::empty(n, &(0..nc).collect::<Vec<_>>());
        for _ in 0..3 * (n + nc) {
            let c: Vec<f64> = (0..nc).map(|_| normal(&mut rng)).collect();
            let s: Vec<f64> = (0..n).map(|_| normal(&mut rng)).collect();
            (0..nc * nc).for_each(|k| arrow.cc[k] += c[k / nc] * c[k % nc]);
            (0..n * n).for_each(|k| block.ss[k] += s[k / n] * s[k % n]);
            (0..n * nc).for_each(|k| block.sc[k] += s[k / nc] * c[k % nc]);
        }
        arrow.own.push(block);
    }
    arrow
}

fn dense(arrow: &Arrow) -> (Vec<f64>, usize) {
    let nc = arrow.shared;
    let n = nc + arrow.own.iter().map(|o| o.n).sum::<usize>();
    let mut full = vec![0.0; n * n];
    (0..nc * nc).for_each(|k| full[(k / nc) * n + k % nc] = arrow.cc[k]);
    let mut at = nc;
    for own in &arrow.own {
        for i in 0..own.n {
            for j in 0..own.n {
                full[(at + i) * n + at + j] = own.ss[i * own.n + j];
            }
            for j in 0..nc {
                full[(at + i) * n + j] = own.sc[i * nc + j];
                full[j * n + at + i] = own.sc[i * nc + j];
            }
        }
        at += own.n;
    }
    (full, n)
}

/// The blocks that an arrow has, out of a full matrix.
fn blocks(full: &[f64], n: usize, like: &Arrow) -> Arrow {
    let mut arrow = like.clone();
    let nc = like.shared;
    (0..nc * nc).for_each(|k| arrow.cc[k] = full[(k / nc) * n + k % nc]);
    let mut at = nc;
    for own in &mut arrow.own {
        for i in 0..own.n {
            (0..own.n).for_each(|j| own.ss[i * own.n + j] = full[(at + i) * n + at + j]);
            (0..nc).for_each(|j| own.sc[i * nc + j] = full[(at + i) * n + j]);
        }
        at += own.n;
    }
    arrow
}

fn close(a: &[f64], b: &[f64]) {
    let size = b.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    assert_eq!(a.len(), b.len());
    for (k, (a, b)) in a.iter().zip(b).enumerate() {
        assert!((a - b).abs() < 1e-10 * size, "element {k}: {a} and {b}");
    }
}

#[test]
fn elimination_equals_the_full_solution() {
    for own in [vec![], vec![2, 0, 3], vec![1; 7]] {
        let m = random_arrow(1, 4, &own);
        let m = if own.is_empty() { Arrow { cc: random_arrow(1, 4, &[1]).cc, ..m } } else { m };
        let (full, n) = dense(&m);
        let inverse = cholesky_inverse(&cholesky(&full, n).unwrap(), n);
        let mut rng = rng(2);
        let rhs: Vec<f64> = (0..n).map(|_| normal(&mut rng)).collect();
        let factor = m.factor().unwrap();
        let solved = factor.solve(&rhs);
        close(&solved, &multiply(&inverse, &rhs, n, n, 1));
        let quadratic: f64 = solved.iter().zip(&rhs).map(|(a, b)| a * b).sum();
        assert!((m.quadratic(&solved) - quadratic).abs() < 1e-10 * quadratic);
        let q = if own.is_empty() { m.clone() } else { random_arrow(3, 4, &own) };
        let product = multiply(&multiply(&inverse, &dense(&q).0, n, n, n), &inverse, n, n, n);
        for (got, want) in [
            (factor.sandwich(&q), blocks(&product, n, &m)),
            (factor.sandwich(&m), blocks(&inverse, n, &m)),
        ] {
            close(&got.cc, &want.cc);
            for (g, w) in got.own.iter().zip(&want.own) {
                if g.n > 0 {
                    close(&g.ss, &w.ss);
                    close(&g.sc, &w.sc);
                }
            }
        }
    }
}

#[test]
fn no_shared_parameters() {
    let m = random_arrow(5, 0, &[2, 3]);
    let (full, n) = dense(&m);
    let inverse = cholesky_inverse(&cholesky(&full, n).unwrap(), n);
    close(&m.factor().unwrap().solve(&[1.0; 5]), &multiply(&inverse, &[1.0; 5], n, n, 1));
}

#[test]
fn pinned_component_is_taken_and_the_rest_solved_for() {
    for index in [1, 5] {
        let m = random_arrow(7, 4, &[2, 3]);
        let (full, n) = dense(&m);
        let mut pinned = m.clone();
        let mut rhs = vec![1.0; n];
        pinned.pin(&mut rhs, index, 0.7);
        let d = pinned.factor().unwrap().solve(&rhs);
        assert!((d[index] - 0.7).abs() < 1e-12);
        let back = multiply(&full, &d, n, n, 1);
        assert!((0..n).filter(|&i| i != index).all(|i| (back[i] - 1.0).abs() < 1e-9), "{back:?}");
    }
}

/// The sandwich `M^-1 G' R^-1 Sigma R^-1 G M^-1`, and the series that stand in for the noise: with
/// `P = (G' Sigma^-1 G)^-1` their products are those of `(e - G P G' Sigma^-1 e)(...)' + G P G'`.
/// With full matrices over two segments of unequal length.
#[test]
fn spread_and_absorbed_part_equal_the_full_matrices() {
    let mut toy = Toy::simulate(1, 2, 40, 0.1, 0.5);
    toy.z[1].truncate(30);
    let layout: Layout = toy.layout();
    let theta = [0.93, 0.11, 0.02, 0.13];
    let evaluate = |s: usize, p: &[f64], _: bool| toy.evaluate(s, p);
    let model = Ar::with_coefficients(&[0.6, 0.25], 0.01).unwrap();
    let (r, np) = (0.02, 4);
    let mut rows: Vec<(usize, usize, Vec<f64>)> = vec![];
    let mut e = vec![];
    for s in 0..2 {
        let block = &evaluate(s, &layout.local(s, &theta), true).unwrap()[0];
        e.extend(&block.e);
        for k in 0..block.e.len() {
            let mut g = vec![0.0; np];
            g[..2].copy_from_slice(&block.g[3 * k..3 * k + 2]);
            g[2 + s] = block.g[3 * k + 2];
            rows.push((s, k, g));
        }
    }
    let n = rows.len();
    let c = model.autocovariance(40);
    let sigma: Vec<f64> = (0..n * n)
        .map(|k| {
            let ((s, i, _), (t, j, _)) = (&rows[k / n], &rows[k % n]);
            if s == t { c[i.abs_diff(*j)] } else { 0.0 }
        })
        .collect();
    let g: Vec<f64> = rows.iter().flat_map(|row| row.2.clone()).collect();
    let gt = transpose(&g, n, np);
    let m: Vec<f64> = multiply(&gt, &g, np, n, np).iter().map(|v| v / r).collect();
    let inverse = cholesky_inverse(&cholesky(&m, np).unwrap(), np);
    let q: Vec<f64> = multiply(&multiply(&gt, &sigma, np, n, n), &g, np, n, np)
        .iter()
        .map(|v| v / (r * r))
        .collect();
    let p = multiply(&multiply(&inverse, &q, np, np, np), &inverse, np, np, np);

    let (_, totals) = crate::least_squares::pass(&layout, &evaluate, &theta).unwrap();
    let (matrix, _) = totals.weigh(&layout, &[1.0 / r]);
    let source = Source::new(&layout, &evaluate, &theta);
    let (covariance, series) = tests_only::spread_and_series(
        &source,
        &matrix,
        &[Covariance::diagonal(&[r], &[n])],
        &[model],
    )
    .unwrap();
    let want = blocks(&p, np, &covariance);
    close(&covariance.cc, &want.cc);
    for (g, w) in covariance.own.iter().zip(&want.own) {
        close(&g.ss, &w.ss);
        close(&g.sc, &w.sc);
    }
    let weights = cholesky_inverse(&cholesky(&sigma, n).unwrap(), n);
    let gw = multiply(&gt, &weights, np, n, n);
    let known = cholesky_inverse(&cholesky(&multiply(&gw, &g, np, n, np), np).unwrap(), np);
    let step = multiply(&known, &multiply(&gw, &e, np, n, 1), np, np, 1);
    let left: Vec<f64> = e.iter().zip(multiply(&g, &step, n, np, 1)).map(|(e, y)| e - y).collect();
    let mut wanted = multiply(&multiply(&g, &known, n, np, np), &gt, n, np, n);
    (0..n * n).for_each(|k| wanted[k] += left[k / n] * left[k % n]);
    for (s, from) in [(0, 0), (1, 40)] {
        let (series, n_s) = (&series[s][0], if s == 0 { 40 } else { 30 });
        let products = |k: usize| series.iter().map(|x| x[k / n_s] * x[k % n_s]).sum();
        let block: Vec<f64> =
            (0..n_s * n_s).map(|k| wanted[(from + k / n_s) * n + from + k % n_s]).collect();
        close(&(0..n_s * n_s).map(products).collect::<Vec<f64>>(), &block);
    }
}
