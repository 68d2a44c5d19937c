//! The smoother against what it must equal: a dense least-squares solution, itself with other
//! checkpoints, simulated truth.

use super::*;
use crate::math::dense;
use crate::model::{Constants, Model};
use indexmap::IndexMap;

/// Standard normal numbers from a counter.
pub struct Normal(u64);

impl Normal {
    pub fn new(seed: u64) -> Normal {
        Normal(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> f64 {
        let (u, v) = (self.uniform().max(1e-300), self.uniform());
        (-2.0 * libm::log(u)).sqrt() * libm::cos(2.0 * std::f64::consts::PI * v)
    }
}

const LINEAR: &str = r#"
title = "A cart with a biased accelerometer"
[inputs]
a = "m/s^2"
[parameters]
b = { unit = "m/s^2", start = 0.0 }
[states]
v = { unit = "m/s", rate = "a - b - 0.3*v/T", start = 1.0 }
s = { unit = "m", rate = "v", start = 0.0 }
[constants]
T = { unit = "s", value = 1.0 }
[outputs]
s = { unit = "m", value = "s" }
v = { unit = "m/s", value = "v + 0.05*T*a" }
"#;

fn cart() -> Model {
    Model::parse("cart", LINEAR, &Constants::default()).expect("compiles")
}

/// Smoothed means and covariances of all nodes, in the order of time.
#[derive(Default)]
struct Collect {
    t: Vec<f64>,
    x: Vec<Vec<f64>>,
    p: Vec<Vec<f64>>,
}

impl Visit for Collect {
    fn node(
        &mut self,
        tape: &Tape,
        k: usize,
        x: &[f64],
        _: &[f64],
        covariance: &mut dyn FnMut(&mut Vec<f64>),
    ) {
        let mut p = Vec::new();
        covariance(&mut p);
        self.t.insert(0, tape.t[k]);
        self.x.insert(0, x.to_vec());
        self.p.insert(0, p);
    }
}

struct Cart {
    ta: Vec<f64>,
    a: Vec<f64>,
    ts: Vec<f64>,
    zs: Vec<f64>,
    tv: Vec<f64>,
    zv: Vec<f64>,
}

impl Cart {
    fn flight(&self, model: &Model) -> Flight {
        Flight::driven(model, &[(&self.ta, &self.a)], 0.0)
            .measuring(model, [(0, &self.zs[..]), (1, &self.zv[..])])
            .stamped([self.ts.clone(), self.tv.clone()])
    }
}

/// Accelerations at 10 Hz with jitter, positions and speeds at rates of their own.
fn cart_data() -> Cart {
    let mut normal = Normal::new(7);
    let mut noisy = |n: usize, dt: f64, t0: f64| -> (Vec<f64>, Vec<f64>) {
        let t: Vec<f64> =
            (0..n).map(|k| t0 + dt * (k as f64 + 0.1 * normal.next().clamp(-2.0, 2.0))).collect();
        let z = t.iter().map(|&t| libm::sin(t) + 0.1 * normal.next()).collect();
        (t, z)
    };
    let (ta, a) = noisy(40, 0.1, 0.0);
    let (ts, mut zs) = noisy(14, 0.27, 0.05);
    let (tv, zv) = noisy(7, 0.53, 0.2);
    zs[5] = f64::NAN;
    Cart { ta, a, ts, zs, tv, zv }
}

#[test]
fn truth_a_linear_flight_equals_dense_least_squares() {
    let model = cart();
    let d = cart_data();
    let kinematics = Kinematics::new(&model, vec![0]).expect("no delays");
    let flight = d.flight(&model);
    let levels = Levels {
        r: vec![0.04, 0.09],
        density: vec![0.02],
        walk: vec![0.003, 0.0, 0.01],
        start_sd: vec![2.0, 3.0, 0.5],
        ..Default::default()
    };
    let smoother = Smoother::new(&kinematics, &flight, f64::INFINITY);
    let (from, to) = (d.ta[0], d.ta[39]);
    let x0 = [1.0, 0.2, 0.05];
    let mut got = Collect::default();
    smoother.run(&levels, [from, to], &x0, &mut (), &mut got);

    // the same as one system: unknowns are the start and every step's errors of input and walks
    let nodes = got.t.len();
    let size = 3 + 3 * (nodes - 1); // input error, walk of v, walk of b
    let at = |t: f64| {
        let k = d.ta.partition_point(|&x| x <= t).clamp(1, 39) - 1;
        d.a[k] + (t - d.ta[k]) / (d.ta[k + 1] - d.ta[k]) * (d.a[k + 1] - d.a[k])
    };
    let rate = |x: &[f64; 3], u: f64| [u - x[2] - 0.3 * x[0], x[0], 0.0];
    let runge = |x: [f64; 3], u: [f64; 3], h: f64| {
        let ahead =
            |k: &[f64; 3], c: f64| std::array::from_fn::<f64, 3, _>(|i| x[i] + c * h * k[i]);
        let k1 = rate(&x, u[0]);
        let k2 = rate(&ahead(&k1, 0.5), u[1]);
        let k3 = rate(&ahead(&k2, 0.5), u[1]);
        let k4 = rate(&ahead(&k3, 1.0), u[2]);
        std::array::from_fn::<f64, 3, _>(|i| {
            x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
        })
    };
    let mut prior = vec![4.0, 9.0, 0.25];
    let (mut mean, mut maps) = (vec![x0], vec![vec![0.0; 3 * size]]);
    for i in 0..3 {
        maps[0][i * size + i] = 1.0;
    }
    for k in 1..nodes {
        let (t, h) = (got.t[k - 1], got.t[k] - got.t[k - 1]);
        let u = [at(t), at(t + 0.5 * h), at(t + h)];
        mean.push(runge(mean[k - 1], u, h));
        let mut map = vec![0.0; 3 * size];
        let unit = |i: usize| std::array::from_fn::<f64, 3, _>(|j| f64::from(u8::from(i == j)));
        let columns: Vec<[f64; 3]> = (0..3).map(|i| runge(unit(i), [0.0; 3], h)).collect();
        for i in 0..3 {
            for c in 0..size {
                map[i * size + c] = (0..3).map(|j| columns[j][i] * maps[k - 1][j * size + c]).sum();
            }
        }
        let gamma = runge([0.0; 3], [1.0; 3], h);
        let base = 3 + 3 * (k - 1);
        for i in 0..3 {
            map[i * size + base] = gamma[i];
        }
        map[base + 1] = 1.0;
        map[2 * size + base + 2] = 1.0;
        prior.extend([0.02 / h, 0.003 * h, 0.01 * h]);
        maps.push(map);
    }
    let mut information = vec![0.0; size * size];
    let mut right = vec![0.0; size];
    for (i, p) in prior.iter().enumerate() {
        information[i * size + i] = 1.0 / p;
    }
    let mut scored = 0;
    for (t, z, r, is_speed) in
        d.ts.iter()
            .zip(&d.zs)
            .map(|(t, z)| (*t, *z, 0.04, false))
            .chain(d.tv.iter().zip(&d.zv).map(|(t, z)| (*t, *z, 0.09, true)))
    {
        let Some(k) = got.t.iter().position(|x| (x - t).abs() < 1e-9).filter(|_| z.is_finite())
        else {
            continue;
        };
        scored += 1;
        let (row, y) = if is_speed { (0, mean[k][0] + 0.05 * at(t)) } else { (1, mean[k][1]) };
        let h = &maps[k][row * size..(row + 1) * size];
        for i in 0..size {
            right[i] += h[i] / r * (z - y);
            for j in 0..size {
                information[i * size + j] += h[i] * h[j] / r;
            }
        }
    }
    assert_eq!(scored, 20);
    let factor = dense::cholesky(&information, size).expect("positive");
    let covariance = dense::cholesky_inverse(&factor, size);
    dense::cholesky_solve(&factor, size, &mut right);
    let m = matrix::padded(3);
    for k in 0..nodes {
        for i in 0..3 {
            let row = &maps[k][i * size..(i + 1) * size];
            let x = mean[k][i] + row.iter().zip(&right).map(|(a, b)| a * b).sum::<f64>();
            assert!((x - got.x[k][i]).abs() < 1e-9, "node {k} state {i}: {x} {}", got.x[k][i]);
            for j in 0..3 {
                let other = &maps[k][j * size..(j + 1) * size];
                let mut p = 0.0;
                for a in 0..size {
                    for b in 0..size {
                        p += row[a] * covariance[a * size + b] * other[b];
                    }
                }
                assert!(
                    (p - got.p[k][i * m + j]).abs() < 1e-9,
                    "node {k} covariance {i} {j}: {p} {}",
                    got.p[k][i * m + j]
                );
            }
        }
    }
}

#[test]
fn checkpoints_change_no_bit() {
    let model = cart();
    let d = cart_data();
    let kinematics = Kinematics::new(&model, vec![0]).expect("no delays");
    let flight = d.flight(&model);
    let levels = Levels::guess(
        &kinematics,
        &flight,
        &IndexMap::from([("b".to_string(), 0.1)]),
        &IndexMap::new(),
    );
    let path = |stretch: usize| {
        let smoother = Smoother { stretch, ..Smoother::new(&kinematics, &flight, 5.0) };
        let grid = Grid::covering(d.ta[0], d.ta[39], 0.05);
        let mut out = Outputs::empty(2, 3, grid.n);
        let mut watch = Innovations::new(2);
        let smoothed = smoother.path(
            None,
            &levels,
            [d.ta[0], d.ta[39]],
            &[1.0, 0.0, 0.0],
            (grid, 2),
            &mut watch,
            &mut out,
        );
        (smoothed, out, watch.channels.iter().map(|c| c.lagged.clone()).collect::<Vec<_>>())
    };
    let all = path(1_000_000);
    assert!(
        all.0.finite
            && all.1.value[0].iter().all(|v| v.is_finite())
            && all.1.sd[1].iter().all(|v| *v > 0.0)
    );
    for stretch in [0, 1, 7, 16] {
        assert_eq!(path(stretch), all, "checkpoints every {stretch}");
    }
}
