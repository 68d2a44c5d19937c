//! Full covariance of the noise, with samples missing, against the same formulas written sample by
//! sample.

use super::{Known, normal, rng, sds};
use crate::estimate::colour::{Source, tests_only};
use crate::estimate::solution::solve;
use crate::estimate::{Settings, Stop};
use crate::least_squares::{Block, Covariance, Layout, Part, Scatter, Structure, scatter, weighed};
use crate::math::dense::{
    cholesky, cholesky_inverse, cholesky_log_det, multiply, symmetric_eigen, transpose,
};
use crate::noise::Ar;

const OUTPUTS: usize = 3;

fn structure(floor: f64) -> Structure {
    Structure { outputs: OUTPUTS, groups: 1, full: true, floor: vec![floor; OUTPUTS], known: false }
}

/// Correlated noise of three outputs.
fn draw(rng: &mut rand_pcg::Pcg64) -> [f64; OUTPUTS] {
    let (a, b, c) = (normal(rng), normal(rng), normal(rng));
    [0.5 * a, 0.4 * a + 0.3 * b, 0.2 * c - 0.1 * b + 0.05 * a]
}

/// Which outputs are there at instant `k`.
fn pattern(k: usize) -> Vec<usize> {
    match k % 5 {
        0 | 3 => vec![0, 1, 2],
        1 => vec![0, 2],
        2 => vec![1],
        _ => vec![0, 1],
    }
}

type Instant = (Vec<usize>, Vec<f64>);

fn residuals(n: usize) -> Vec<Instant> {
    let mut rng = rng(21);
    let one = |k: usize| {
        let e = draw(&mut rng);
        let outputs = pattern(k);
        let values = outputs.iter().map(|&j| e[j]).collect();
        (outputs, values)
    };
    (0..n).map(one).collect()
}

fn gather(instants: &[Instant]) -> Scatter {
    let mut scatter = Scatter::default();
    instants.iter().for_each(|(outputs, e)| scatter.add_together(outputs, e));
    scatter
}

fn block(r: &[f64], n: usize, of: &[usize]) -> Vec<f64> {
    of.iter().flat_map(|&i| of.iter().map(move |&j| r[i * n + j])).collect()
}

/// `1/2 sum_k (ln|R_m| + e' R_m^-1 e - dim m)`, instant by instant.
fn cost(r: &[f64], instants: &[Instant]) -> f64 {
    let one = |(outputs, e): &Instant| {
        let m = outputs.len();
        let l = cholesky(&block(r, OUTPUTS, outputs), m).unwrap();
        let mut x = e.clone();
        crate::math::dense::forward(&l, m, &mut x);
        0.5 * (cholesky_log_det(&l, m) + x.iter().map(|x| x * x).sum::<f64>() - m as f64)
    };
    instants.iter().map(one).sum()
}

fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
}

#[test]
fn complete_samples_give_the_mean_of_products() {
    let mut rng = rng(20);
    let all: Vec<Instant> = (0..500).map(|_| (vec![0, 1, 2], draw(&mut rng).to_vec())).collect();
    let r = gather(&all).covariance(&structure(1e-30)).unwrap();
    for k in 0..9 {
        let mean = all.iter().map(|(_, e)| e[k / 3] * e[k % 3]).sum::<f64>() / 500.0;
        assert!((r.r[k] - mean).abs() < 1e-13, "{k}");
    }
    let l = cholesky(&r.r, 3).unwrap();
    close(r.cost, 250.0 * cholesky_log_det(&l, 3), 1e-12);
    close(r.ln_det, cholesky_log_det(&l, 3), 1e-12);
}

/// No change of `R` in any direction lowers the likelihood's cost, written instant by instant.
#[test]
fn missing_samples_give_the_largest_likelihood() {
    let all = residuals(400);
    let r = gather(&all).covariance(&structure(1e-30)).unwrap();
    close(r.cost, cost(&r.r, &all), 1e-12);
    assert_eq!(r.count, [320, 320, 240]);
    for i in 0..OUTPUTS {
        for j in 0..=i {
            let moved = |h: f64| {
                let mut m = r.r.clone();
                m[i * OUTPUTS + j] += h;
                m[j * OUTPUTS + i] = m[i * OUTPUTS + j];
                cost(&m, &all)
            };
            let h = 1e-5 * (r.r[i * OUTPUTS + i] * r.r[j * OUTPUTS + j]).sqrt();
            let (up, down) = (moved(h), moved(-h));
            assert!(up > r.cost && down > r.cost, "{i} {j}: {up} {} {down}", r.cost);
            // The slope vanishes: both sides rise alike, by the curvature alone.
            assert!(
                (up - down).abs() < 1e-3 * (up + down - 2.0 * r.cost).abs(),
                "{i} {j}: {up} {} {down}",
                r.cost
            );
        }
    }
}

/// Output 1 only at every third instant of output 0: a regression, known in closed form.
#[test]
fn nested_samples_give_the_closed_form() {
    let mut rng = rng(22);
    let all: Vec<Instant> = (0..300)
        .map(|k| {
            let e = draw(&mut rng);
            if k % 3 == 0 { (vec![0, 1], vec![e[0], e[1]]) } else { (vec![0], vec![e[0]]) }
        })
        .collect();
    let r = gather(&all).covariance(&structure(1e-30)).unwrap();
    let both: Vec<&Instant> = all.iter().filter(|(o, _)| o.len() == 2).collect();
    let mean =
        |f: &dyn Fn(&[f64]) -> f64| both.iter().map(|(_, e)| f(e)).sum::<f64>() / both.len() as f64;
    let first = all.iter().map(|(_, e)| e[0] * e[0]).sum::<f64>() / 300.0;
    let slope = mean(&|e| e[0] * e[1]) / mean(&|e| e[0] * e[0]);
    let rest = mean(&|e| (e[1] - slope * e[0]).powi(2));
    close(r.r[0], first, 1e-10);
    close(r.r[1], slope * first, 1e-10);
    close(r.r[4], rest + slope * slope * first, 1e-10);
    // Output 2 has no sample: it counts nowhere.
    assert_eq!((r.r[8], r.r[2], r.r[5], r.count[2]), (1.0, 0.0, 0.0, 0));
    close(r.ln_det, (first * rest).ln(), 1e-10);
}

#[test]
fn outputs_that_never_meet_are_independent() {
    let mut rng = rng(23);
    let all: Vec<Instant> = (0..90).map(|k| (vec![k % 3], vec![draw(&mut rng)[k % 3]])).collect();
    let r = gather(&all).covariance(&structure(1e-30)).unwrap();
    let alone = gather(&all).covariance(&Structure { full: false, ..structure(1e-30) }).unwrap();
    assert_eq!(r, alone);
    assert!((0..9).filter(|k| k / 3 != k % 3).all(|k| r.r[k] == 0.0));
}

#[test]
fn the_floor_holds_for_every_combination_of_outputs() {
    let mut rng = rng(24);
    // Output 1 is a copy of output 0.
    let all: Vec<Instant> = (0..100)
        .map(|_| {
            let e = draw(&mut rng);
            (vec![0, 1, 2], vec![e[0], e[0], e[2]])
        })
        .collect();
    for floor in [1e-2, 1e-8] {
        let r = gather(&all).covariance(&structure(floor)).unwrap();
        let mut above = r.r.clone();
        (0..3).for_each(|i| above[i * 3 + i] -= floor);
        assert!(symmetric_eigen(&above, 3).values[0] > -1e-15, "{above:?}");
        // The sum of the copies keeps its own variance.
        let sum: f64 = all.iter().map(|(_, e)| (e[0] + e[1]).powi(2)).sum::<f64>() / 100.0;
        close(r.r[0] + r.r[4] + 2.0 * r.r[1], sum, 1e-9);
        close(r.cost, cost(&r.r, &all), 1e-9);
    }
}

/// Two segments, shared slope and own offsets, three outputs at stamps of their own.
struct Lines {
    z: Vec<Vec<Vec<f64>>>,
    instants: Vec<Vec<Vec<u32>>>,
    layout: Layout,
}

impl Lines {
    fn new(seed: u64, sizes: &[usize]) -> Lines {
        Lines::masked(seed, sizes, |k, j| (k * 7 + j) % 23 == 0)
    }

    /// `mask` says of instants and outputs which are masked.
    fn masked(seed: u64, sizes: &[usize], mask: fn(usize, usize) -> bool) -> Lines {
        let mut rng = rng(seed);
        let (mut z, mut instants) = (Vec::new(), Vec::new());
        for &n in sizes {
            let mut series = vec![(Vec::new(), Vec::new()); OUTPUTS];
            let mut last = [0.0; OUTPUTS];
            for k in 0..n {
                let e = draw(&mut rng);
                for j in 0..OUTPUTS {
                    last[j] = 0.6 * last[j] + e[j];
                    if pattern(k).contains(&j) {
                        let masked = mask(k, j);
                        series[j].0.push(if masked {
                            f64::NAN
                        } else {
                            model(&[0.3, 1.0], j, k) + last[j]
                        });
                        series[j].1.push(k as u32);
                    }
                }
            }
            let (values, at): (Vec<_>, Vec<_>) = series.into_iter().unzip();
            z.push(values);
            instants.push(at);
        }
        let mut layout =
            Layout::plain(1, &vec![1; sizes.len()], OUTPUTS, vec![0.0; 1 + sizes.len()]);
        layout.noise = structure(1e-30);
        layout.parts.iter_mut().zip(&instants).for_each(|(part, at)| part.instants.clone_from(at));
        Lines { z, instants, layout }
    }

    fn evaluate(&self, s: usize, p: &[f64]) -> Option<Vec<Block>> {
        let one = |j: usize| {
            let at = self.instants[s][j].iter().map(|&k| k as usize);
            let e = at.clone().zip(&self.z[s][j]).map(|(k, z)| z - model(p, j, k)).collect();
            // d/dslope and d/doffset, with curvature in the slope so that the problem is not linear
            let g = at.flat_map(|k| [weight(j) * time(k) * (1.0 + 0.2 * p[0]), 1.0]).collect();
            Block::new(j, e, g)
        };
        Some((0..OUTPUTS).map(one).collect())
    }

    /// Every scored sample: segment, output, instant, residual, full row.
    fn rows(&self, theta: &[f64]) -> Vec<(usize, usize, u32, f64, Vec<f64>)> {
        let mut rows = Vec::new();
        for s in 0..self.z.len() {
            for block in self.evaluate(s, &self.layout.local(s, theta)).unwrap() {
                for (k, &e) in block.e.iter().enumerate().filter(|(_, e)| !e.is_nan()) {
                    let mut g = vec![0.0; theta.len()];
                    (g[0], g[1 + s]) = (block.g[2 * k], block.g[2 * k + 1]);
                    rows.push((s, block.output, self.instants[s][block.output][k], e, g));
                }
            }
        }
        rows
    }
}

fn time(k: usize) -> f64 {
    0.05 * k as f64
}

fn weight(j: usize) -> f64 {
    [1.0, -0.5, 0.2][j]
}

fn model(p: &[f64], j: usize, k: usize) -> f64 {
    weight(j) * time(k) * (p[0] + 0.1 * p[0] * p[0]) + p[1]
}

/// `R` over all scored rows: blocks of the same segment and instant.
fn big_r(rows: &[(usize, usize, u32, f64, Vec<f64>)], r: &[f64]) -> Vec<f64> {
    let n = rows.len();
    let together = |a: usize, b: usize| (rows[a].0, rows[a].2) == (rows[b].0, rows[b].2);
    (0..n * n)
        .map(
            |k| {
                if together(k / n, k % n) {
                    r[rows[k / n].1 * OUTPUTS + rows[k % n].1]
                } else {
                    0.0
                }
            },
        )
        .collect()
}

#[test]
fn normal_equations_with_missing_samples_are_the_full_ones() {
    let lines = Lines::new(25, &[40, 25]);
    let evaluate = |s: usize, p: &[f64], _: bool| lines.evaluate(s, p);
    let theta = [0.25, 0.9, 1.1];
    let r = scatter(&lines.layout, &evaluate, &theta).unwrap()[0]
        .covariance(&lines.layout.noise)
        .unwrap();
    let rows = lines.rows(&theta);
    let (n, np) = (rows.len(), 3);
    let inverse = cholesky_inverse(&cholesky(&big_r(&rows, &r.r), n).unwrap(), n);
    let g: Vec<f64> = rows.iter().flat_map(|row| row.4.clone()).collect();
    let weighted = multiply(&transpose(&g, n, np), &inverse, np, n, n);
    let full = multiply(&weighted, &g, np, n, np);
    let e: Vec<f64> = rows.iter().map(|row| row.3).collect();
    let slope = multiply(&weighted, &e, np, n, 1);
    let (matrix, gradient) = weighed(&lines.layout, &evaluate, &theta, std::slice::from_ref(&r))
        .unwrap()
        .weigh(&lines.layout, &[1.0]);
    close(matrix.cc[0], full[0], 1e-10);
    for s in 0..2 {
        close(matrix.own[s].ss[0], full[(1 + s) * np + 1 + s], 1e-10);
        close(matrix.own[s].sc[0], full[(1 + s) * np], 1e-9);
    }
    gradient.iter().zip(&slope).for_each(|(a, b)| close(*a, *b, 1e-9));
    // The gradient of the concentrated cost is the gradient at fixed R.
    let concentrated = |theta: &[f64]| {
        scatter(&lines.layout, &evaluate, theta).unwrap()[0]
            .covariance(&lines.layout.noise)
            .unwrap()
            .cost
    };
    for i in 0..3 {
        let moved = |h: f64| {
            let mut t = theta;
            t[i] += h;
            concentrated(&t)
        };
        let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
        assert!(
            (difference + gradient[i]).abs() < 1e-5 * gradient[i].abs().max(1.0),
            "{i}: {difference} {}",
            gradient[i]
        );
    }
}

/// Segment, output and place in its block of every sample, masked ones too; and `Sigma = L C L'`
/// over them, `L = A^-1 D^1/2` of each output, first-order ones of coefficients `a`, and `C` the
/// correlations `c` of innovations of one instant.
fn sigma_of(
    lines: &Lines,
    a: &[f64; 3],
    models: &[Ar],
    c: &dyn Fn(usize, usize) -> f64,
) -> (Vec<(usize, usize, usize)>, Vec<f64>) {
    let mut samples: Vec<(usize, usize, usize)> = Vec::new();
    for s in 0..2 {
        for j in 0..3 {
            (0..lines.instants[s][j].len()).for_each(|k| samples.push((s, j, k)));
        }
    }
    let n = samples.len();
    let mut l = vec![0.0; n * n];
    let mut mix = vec![0.0; n * n];
    for (x, &(s, j, k)) in samples.iter().enumerate() {
        for (y, &(t, i, m)) in samples.iter().enumerate() {
            if (s, j) == (t, i) && m <= k {
                let first = if m == 0 { (1.0 - a[j] * a[j]).sqrt().recip() } else { 1.0 };
                l[x * n + y] = a[j].powi((k - m) as i32) * models[j].variance.sqrt() * first;
            }
            if s == t && lines.instants[s][j][k] == lines.instants[t][i][m] {
                mix[x * n + y] = c(j, i);
            }
        }
    }
    let sigma = multiply(&multiply(&l, &mix, n, n, n), &transpose(&l, n, n), n, n, n);
    for (x, &(_, j, k)) in samples.iter().enumerate() {
        close(sigma[x * n + x], models[j].errors()[0], 1e-12);
        assert!(k < 100);
    }
    (samples, sigma)
}

/// Two first-order outputs and a white one, so that every response is a power, as the residuals `r`
/// are sized; and the innovations' correlation: R's over
/// `sum a_i^k a_j^k / sqrt(sum a_i^2k sum a_j^2k)`.
fn first_order(r: &Covariance, a: [f64; 3]) -> (Vec<Ar>, impl Fn(usize, usize) -> f64) {
    let partial = |j: usize| if a[j] == 0.0 { vec![] } else { vec![a[j]] };
    let models = (0..3)
        .map(|j| Ar { partial: partial(j), variance: r.r[j * 4] * (1.0 - a[j] * a[j]) })
        .collect();
    let c = move |i: usize, j: usize| {
        let like = ((1.0 - a[i] * a[i]) * (1.0 - a[j] * a[j])).sqrt() / (1.0 - a[i] * a[j]);
        if i == j { 1.0 } else { r.correlation(i, j) / like }
    };
    (models, c)
}

/// `M^-1 G' W Sigma W G M^-1`, `Sigma` written out: autoregressive outputs whose innovations are
/// correlated at the same instant.
#[test]
fn coloured_noise_of_correlated_outputs_is_the_full_product() {
    let lines = Lines::new(26, &[30, 20]);
    let evaluate = |s: usize, p: &[f64], _: bool| lines.evaluate(s, p);
    let theta = [0.25, 0.9, 1.1];
    let r = scatter(&lines.layout, &evaluate, &theta).unwrap()[0]
        .covariance(&lines.layout.noise)
        .unwrap();
    let a = [0.6, 0.3, 0.0];
    let (models, c) = first_order(&r, a);
    let all: Vec<f64> = (0..9).map(|k| c(k / 3, k % 3)).collect();
    assert!(symmetric_eigen(&all, 3).values[0] > 0.0, "{all:?}");
    let (samples, sigma) = sigma_of(&lines, &a, &models, &c);
    let n = samples.len();
    // Rows of W G and G over the scored samples, zero elsewhere.
    let rows = lines.rows(&theta);
    let (m, np) = (rows.len(), 3);
    let weights = cholesky_inverse(&cholesky(&big_r(&rows, &r.r), m).unwrap(), m);
    let g: Vec<f64> = rows.iter().flat_map(|row| row.4.clone()).collect();
    let wg = multiply(&weights, &g, m, m, np);
    let place: Vec<usize> = rows
        .iter()
        .map(|row| {
            samples
                .iter()
                .position(|&(s, j, k)| (s, j) == (row.0, row.1) && lines.instants[s][j][k] == row.2)
                .unwrap()
        })
        .collect();
    let scored: Vec<f64> = (0..m * m).map(|k| sigma[place[k / m] * n + place[k % m]]).collect();
    let matrix = weighed(&lines.layout, &evaluate, &theta, std::slice::from_ref(&r))
        .unwrap()
        .weigh(&lines.layout, &[1.0])
        .0;
    let normal = multiply(&transpose(&g, m, np), &wg, np, m, np);
    let inverse = cholesky_inverse(&cholesky(&normal, np).unwrap(), np);
    let q = multiply(&multiply(&transpose(&wg, m, np), &scored, np, m, m), &wg, np, m, np);
    let p = multiply(&multiply(&inverse, &q, np, np, np), &inverse, np, np, np);
    let source = Source::new(&lines.layout, &evaluate, &theta);
    let (covariance, _) =
        tests_only::spread_and_series(&source, &matrix, std::slice::from_ref(&r), &models).unwrap();
    close(covariance.cc[0], p[0], 1e-9);
    for s in 0..2 {
        close(covariance.own[s].ss[0], p[(1 + s) * np + 1 + s], 1e-9);
        close(covariance.own[s].sc[0], p[(1 + s) * np], 1e-8);
    }
}

/// The series that stand in for correlated noise: their products are those of the generalised
/// least-squares residuals and `G P G'`, `Sigma` written out.
#[test]
fn what_a_fit_absorbed_of_correlated_outputs_is_the_full_product() {
    let lines = Lines::masked(26, &[30, 20], |_, _| false);
    let evaluate = |s: usize, p: &[f64], _: bool| lines.evaluate(s, p);
    let theta = [0.25, 0.9, 1.1];
    let r = scatter(&lines.layout, &evaluate, &theta).unwrap()[0]
        .covariance(&lines.layout.noise)
        .unwrap();
    let a = [0.6, 0.3, 0.0];
    let (models, c) = first_order(&r, a);
    let (samples, sigma) = sigma_of(&lines, &a, &models, &c);
    let (n, np) = (samples.len(), 3);
    let rows = lines.rows(&theta);
    assert_eq!(rows.len(), n);
    let place = |row: &(usize, usize, u32, f64, Vec<f64>)| {
        samples
            .iter()
            .position(|&(s, j, k)| (s, j) == (row.0, row.1) && lines.instants[s][j][k] == row.2)
            .unwrap()
    };
    let at: Vec<usize> = rows.iter().map(place).collect();
    let m = at.len();
    let scored: Vec<f64> = (0..m * m).map(|k| sigma[at[k / m] * n + at[k % m]]).collect();
    let weights = cholesky_inverse(&cholesky(&scored, m).unwrap(), m);
    let g: Vec<f64> = rows.iter().flat_map(|row| row.4.clone()).collect();
    let e: Vec<f64> = rows.iter().map(|row| row.3).collect();
    let gw = multiply(&transpose(&g, m, np), &weights, np, m, m);
    let known = cholesky_inverse(&cholesky(&multiply(&gw, &g, np, m, np), np).unwrap(), np);
    let step = multiply(&known, &multiply(&gw, &e, np, m, 1), np, np, 1);
    let left: Vec<f64> = e.iter().zip(multiply(&g, &step, m, np, 1)).map(|(e, y)| e - y).collect();
    let put_back = multiply(&multiply(&g, &known, m, np, np), &transpose(&g, m, np), m, np, m);
    let matrix = weighed(&lines.layout, &evaluate, &theta, std::slice::from_ref(&r))
        .unwrap()
        .weigh(&lines.layout, &[1.0])
        .0;
    let source = Source::new(&lines.layout, &evaluate, &theta);
    let (_, series) =
        tests_only::spread_and_series(&source, &matrix, std::slice::from_ref(&r), &models).unwrap();
    let mut compared = 0;
    for x in 0..m {
        for y in (0..m).filter(|&y| (rows[x].0, rows[x].1) == (rows[y].0, rows[y].1)) {
            let (one, other) = (samples[at[x]], samples[at[y]]);
            let product: f64 = series[one.0][one.1].iter().map(|of| of[one.2] * of[other.2]).sum();
            let want = left[x] * left[y] + put_back[x * m + y];
            assert!((product - want).abs() < 1e-9, "{x} {y}: {product} {want}");
            compared += 1;
        }
    }
    assert!(compared > 1000);
}

/// With white noise the sandwich around `W Sigma W` is the Cramer-Rao bound, whatever the
/// correlation.
#[test]
fn white_correlated_noise_has_the_bound_for_its_covariance() {
    let lines = Lines::new(27, &[60, 45]);
    let evaluate = |s: usize, p: &[f64], _: bool| lines.evaluate(s, p);
    let theta = [0.25, 0.9, 1.1];
    let r: Covariance = scatter(&lines.layout, &evaluate, &theta).unwrap()[0]
        .covariance(&lines.layout.noise)
        .unwrap();
    let matrix = weighed(&lines.layout, &evaluate, &theta, std::slice::from_ref(&r))
        .unwrap()
        .weigh(&lines.layout, &[1.0])
        .0;
    let bound = matrix.factor().unwrap().sandwich(&matrix);
    let white: Vec<Ar> = r.variances().iter().map(|&variance| Ar::white(variance)).collect();
    let source = Source::new(&lines.layout, &evaluate, &theta);
    let (covariance, _) =
        tests_only::spread_and_series(&source, &matrix, std::slice::from_ref(&r), &white).unwrap();
    sds(&covariance).iter().zip(sds(&bound)).for_each(|(a, b)| close(*a, b, 1e-9));
}

/// Two lines of opposite slope about a common mean, over 95% intervals in `trials` draws: hits per
/// parameter, and the mean sd of the slope, with `R` diagonal and full. Noise: a part common to
/// both outputs and one of opposite sign, of correlation `rho` in time.
fn coverage(trials: u64, n: usize, rho: f64, max_ar_order: usize) -> ([[f64; 2]; 2], [f64; 2]) {
    let (mut hits, mut lengths) = ([[0.0; 2]; 2], [0.0; 2]);
    for seed in 0..trials {
        let mut rng = rng(1000 + seed);
        let [common, opposite] = [1.0, 0.3].map(|sd| super::noise(&mut rng, n, sd, rho));
        let line = |w: f64| {
            (0..n)
                .map(|k| 1.0 + 0.3 * w * time(k) + common[k] + 2.0 * w * opposite[k])
                .collect::<Vec<f64>>()
        };
        let z = [line(-0.5), line(0.5)];
        for (which, full) in [false, true].into_iter().enumerate() {
            let mut layout = Layout::plain(2, &[0], 2, vec![0.0, 0.0]);
            layout.noise.full = full;
            let at: Vec<u32> = (0..n as u32).collect();
            layout.parts[0] = Part { instants: vec![at.clone(), at], ..layout.parts[0].clone() };
            let evaluate = |_: usize, p: &[f64], _: bool| {
                let block = |j: usize| {
                    let w = j as f64 - 0.5;
                    let e = z[j]
                        .iter()
                        .enumerate()
                        .map(|(k, z)| z - p[0] - p[1] * w * time(k))
                        .collect();
                    Block::new(j, e, (0..n).flat_map(|k| [1.0, w * time(k)]).collect())
                };
                Some(vec![block(0), block(1)])
            };
            let s = solve(
                &layout,
                &evaluate,
                &Settings { max_ar_order, ..Settings::default() },
                &Known::default(),
            );
            assert_eq!(s.fit.stop, Stop::Converged);
            let sd = sds(s.covariance.as_ref().unwrap());
            for (i, truth) in [1.0, 0.3].iter().enumerate() {
                hits[which][i] +=
                    f64::from(u8::from((s.fit.theta[i] - truth).abs() <= 1.96 * sd[i]))
                        / trials as f64;
            }
            lengths[which] += sd[1] / trials as f64;
        }
    }
    println!(
        "rho {rho}: covered: diagonal {:.3?}, full {:.3?}; mean sd of the slope {lengths:.4?}",
        hits[0], hits[1]
    );
    (hits, lengths)
}

/// With `R` full the sd is right and smaller than with `R` diagonal, whose own is wrong: noise
/// common to both lines hides in the mean, not in the difference.
#[test]
fn recovery_with_shared_noise() {
    let (hits, lengths) = coverage(400, 150, 0.0, 2);
    assert!(hits[1].iter().all(|h| (0.925..=0.975).contains(h)), "{hits:?}");
    assert!(hits[0][0] < 0.9 && lengths[1] < 0.5 * lengths[0], "{hits:?} {lengths:?}");
}

/// The same with noise that is coloured as well.
#[test]
fn recovery_with_shared_coloured_noise() {
    let (hits, lengths) = coverage(400, 400, 0.8, 6);
    assert!((0.93 - 1e-9..=0.97).contains(&(0.5 * (hits[1][0] + hits[1][1]))), "{hits:?}");
    assert!(hits[1].iter().all(|h| (0.91..=0.98).contains(h)), "{hits:?}");
    assert!(hits[0][0] < 0.9 && lengths[1] < 0.5 * lengths[0], "{hits:?} {lengths:?}");
}

/// Innovations that could not be correlated as `R` and the colours ask are correlated as far as
/// they can be: the covariance of the estimates stays a covariance.
#[test]
fn very_different_colours_leave_a_covariance() {
    let lines = Lines::new(28, &[60, 45]);
    let evaluate = |s: usize, p: &[f64], _: bool| lines.evaluate(s, p);
    let theta = [0.25, 0.9, 1.1];
    let r = scatter(&lines.layout, &evaluate, &theta).unwrap()[0]
        .covariance(&lines.layout.noise)
        .unwrap();
    let matrix = weighed(&lines.layout, &evaluate, &theta, std::slice::from_ref(&r))
        .unwrap()
        .weigh(&lines.layout, &[1.0])
        .0;
    let models: Vec<Ar> = [0.98, -0.9, 0.5]
        .iter()
        .zip(r.variances())
        .map(|(a, v)| Ar { partial: vec![*a], variance: v * (1.0 - a * a) })
        .collect();
    let source = Source::new(&lines.layout, &evaluate, &theta);
    let (covariance, _) =
        tests_only::spread_and_series(&source, &matrix, std::slice::from_ref(&r), &models).unwrap();
    let own = &covariance.own;
    assert!(covariance.cc[0] > 0.0);
    for own in own {
        assert!(own.ss[0] * covariance.cc[0] > own.sc[0] * own.sc[0], "{covariance:?}");
    }
}
