//! Estimates by equation error: do the intervals cover, is what noise in the regressors does told as
//! it is, and do searches find what there is?

use super::{noise, rng};
use crate::dynamics::{Channel, Record};
use crate::estimate::{By, Estimation, Search, Settings, Stop, Support, estimate};
use crate::model::{Constants, Model};
use rayon::prelude::*;

fn model(text: &str) -> Model {
    Model::parse("test", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn method() -> Settings {
    Settings { by: By::EquationError, ..Settings::default() }
}

/// Inputs by column, and what was measured of outputs, on one grid.
fn record(dt: f64, inputs: &[Vec<f64>], outputs: &[(usize, Vec<f64>)]) -> Record {
    let n = outputs[0].1.len();
    let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    let channel = |(output, z): &(usize, Vec<f64>)| Channel {
        output: *output,
        t: t.clone().into(),
        z: z.clone().into(),
    };
    Record {
        dt,
        n,
        inputs: (0..n).flat_map(|k| inputs.iter().map(move |u| u[k])).collect(),
        channels: outputs.iter().map(channel).collect(),
        ..Record::default()
    }
}

fn sums(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

const COEFFICIENT: &str = r#"title = "A coefficient"
[inputs]
x = "rad"
u = "rad"
[parameters]
C_0 = { unit = "-", start = 0.0 }
C_x = { unit = "1/rad", start = 0.0 }
C_u = { unit = "1/rad", start = 0.0 }
[outputs]
C = { unit = "-", value = "C_0 + C_x*x + C_u*u" }
"#;

const TRUTH: [f64; 3] = [0.2, -1.5, 0.6];

/// A slow and a fast sine that begin anywhere, and their coefficient.
fn regressors(n: usize) -> ([Vec<f64>; 2], Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|k| (0.02 * k as f64).sin()).collect();
    let u: Vec<f64> = (0..n).map(|k| (0.09 * k as f64).cos()).collect();
    let c = x.iter().zip(&u).map(|(x, u)| TRUTH[0] + TRUTH[1] * x + TRUTH[2] * u).collect();
    ([x, u], c)
}

#[test]
fn recovery_intervals_of_a_regression_cover_the_truth() {
    let model = model(COEFFICIENT);
    for rho in [0.0, 0.9] {
        let trials = 300u64;
        let one = |seed: u64| {
            let (inputs, c) = regressors(600);
            let z = sums(&c, &noise(&mut rng(seed), 600, 0.1, rho));
            let e = estimate(&model, &[record(0.02, &inputs, &[(0, z)])], &method()).unwrap();
            assert_eq!(e.stop, Stop::Converged);
            let miss = |(row, truth): (&crate::estimate::Row, f64)| (row.value - truth).abs();
            let both: Vec<[f64; 2]> = e
                .rows
                .iter()
                .zip(TRUTH)
                .map(|(row, truth)| {
                    let miss = miss((row, truth));
                    [row.sd, row.sd_crlb].map(|sd| f64::from(miss <= 1.96 * sd.unwrap()))
                })
                .collect();
            [0, 1].map(|w| both.iter().map(|b| b[w]).sum::<f64>() / 3.0)
        };
        let all: Vec<[f64; 2]> = (0..trials).into_par_iter().map(one).collect();
        let share = |w: usize| all.iter().map(|a| a[w]).sum::<f64>() / trials as f64;
        println!("rho {rho}: sd {:.3}, white {:.3}", share(0), share(1));
        assert!((0.90..=0.975).contains(&share(0)), "{rho}: {}", share(0));
        assert!(rho == 0.0 || share(1) < 0.8, "{rho}: {}", share(1));
    }
}

/// Mean of the miss of parameter `p` and of what is told of it, over draws.
fn moved(draws: u64, p: usize, truth: f64, one: impl Fn(u64) -> Estimation + Sync) -> [f64; 2] {
    let all: Vec<[f64; 2]> = (0..draws)
        .into_par_iter()
        .map(|seed| {
            let e = one(seed);
            let told = e.regression.as_ref().unwrap().rows[p].shift.unwrap();
            [e.rows[p].value - truth, told]
        })
        .collect();
    [0, 1].map(|w| all.iter().map(|a| a[w]).sum::<f64>() / draws as f64)
}

#[test]
fn recovery_what_noise_in_a_regressor_does_is_told() {
    let model = model(COEFFICIENT);
    let [is, told] = moved(200, 1, TRUTH[1], |seed| {
        let ([x, u], c) = regressors(600);
        let mut random = rng(seed);
        let x = sums(&x, &noise(&mut random, 600, 0.2, 0.0));
        let z = sums(&c, &noise(&mut random, 600, 0.05, 0.0));
        estimate(&model, &[record(0.02, &[x, u], &[(0, z)])], &method()).unwrap()
    });
    println!("coefficient: moved by {is:.4}, told {told:.4}");
    // 0.04 of a mean square of some 0.5, towards zero; the told one is in terms of the moved value.
    assert!(is > 0.05 && (told / is - 1.0).abs() < 0.15, "{is} {told}");
}

/// A sensor at half of the grid's rate, and at a quarter: between its samples are straight lines, whose noise
/// is smaller than that of the samples, and not white.
#[test]
fn recovery_what_noise_does_on_a_finer_grid_is_told() {
    let model = model(COEFFICIENT);
    for every in [2, 4] {
        let [is, told] = moved(200, 1, TRUTH[1], |seed| {
            let ([x, u], c) = regressors(600);
            let mut random = rng(seed);
            let white = noise(&mut random, 600 / every + 2, 0.2, 0.0);
            let line = |k: usize| {
                let (low, part) = (k / every, (k % every) as f64 / every as f64);
                (1.0 - part) * white[low] + part * white[low + 1]
            };
            let x = sums(&x, &(0..600).map(line).collect::<Vec<f64>>());
            let z = sums(&c, &noise(&mut random, 600, 0.05, 0.0));
            let mut record = record(0.02, &[x, u], &[(0, z)]);
            record.spacings = vec![0.02 * every as f64, 0.02];
            estimate(&model, &[record], &method()).unwrap()
        });
        println!("every {every}: moved by {is:.4}, told {told:.4}");
        assert!(is > 0.03 && (told / is - 1.0).abs() < 0.15, "{every}: {is} {told}");
    }
    // Of what nobody knows the spacing, nothing is told.
    let ([x, u], c) = regressors(600);
    let mut record = record(0.02, &[x, u], &[(0, c)]);
    record.spacings = vec![f64::NAN, 0.02];
    let e = estimate(&model, &[record], &method()).unwrap();
    assert!(e.regression.unwrap().rows.iter().all(|row| row.shift.is_none()));
}

const MOTION: &str = r#"title = "Short period"
[inputs]
de = "rad"
[parameters]
Z_a = { unit = "1/s", start = -0.5 }
M_a = { unit = "1/s^2", start = -4.0 }
M_q = { unit = "1/s", start = -1.0 }
M_d = { unit = "1/s^2", start = -8.0 }
[states]
alpha = { unit = "rad", rate = "q + Z_a*alpha", start = 0.0 }
q = { unit = "rad/s", rate = "M_a*alpha + M_q*q + M_d*de", start = 0.0 }
[outputs]
alpha = { unit = "rad", value = "alpha" }
q = { unit = "rad/s", value = "q" }
"#;

const OF_MOTION: [f64; 4] = [-1.0, -6.0, -2.0, -10.0];

/// The motion under an input, integrated in small steps: the input, and alpha, q. `of` are Z_a, Z_d, M_a, M_q,
/// M_d.
fn motion(
    [z_a, z_d, m_a, m_q, m_d]: [f64; 5],
    de: impl Fn(f64) -> f64,
    (n, dt): (usize, f64),
) -> (Vec<f64>, [Vec<f64>; 2]) {
    let (mut a, mut q) = (0.0, 0.0);
    let mut out = [Vec::new(), Vec::new()];
    let steps = 50;
    for k in 0..n {
        out[0].push(a);
        out[1].push(q);
        for i in 0..steps {
            let h = dt / f64::from(steps);
            let at = de(k as f64 * dt + (f64::from(i) + 0.5) * h);
            let rate = |a: f64, q: f64| (q + z_a * a + z_d * at, m_a * a + m_q * q + m_d * at);
            let (ra, rq) = rate(a, q);
            let (ra, rq) = rate(a + 0.5 * h * ra, q + 0.5 * h * rq);
            (a, q) = (a + h * ra, q + h * rq);
        }
    }
    ((0..n).map(|k| de(k as f64 * dt)).collect(), out)
}

/// That of `MOTION` under a swept sine, at 50 Hz.
fn swept_motion(n: usize) -> (Vec<f64>, [Vec<f64>; 2]) {
    let [z_a, m_a, m_q, m_d] = OF_MOTION;
    let de = |t: f64| 0.1 * (0.5 * t * (1.0 + 0.1 * t)).sin();
    motion([z_a, 0.0, m_a, m_q, m_d], de, (n, 0.02))
}

#[test]
fn recovery_what_noise_in_a_state_does_to_its_rate_is_told() {
    let model = model(MOTION);
    let (de, [alpha, q]) = swept_motion(800);
    let run = |seed: u64, sd: f64| {
        let mut random = rng(seed);
        let alpha = sums(&alpha, &noise(&mut random, 800, sd, 0.0));
        let q = sums(&q, &noise(&mut random, 800, 0.1 * sd, 0.0));
        let settings = Settings { smoothing_s: 0.2, ..method() };
        let outputs = [(0, alpha), (1, q)];
        estimate(&model, &[record(0.02, std::slice::from_ref(&de), &outputs)], &settings).unwrap()
    };
    let exact = run(0, 0.0);
    for (row, truth) in exact.rows.iter().zip(OF_MOTION) {
        assert!((row.value / truth - 1.0).abs() < 5e-3, "{} {}", row.name, row.value);
    }
    // As far from the values without noise, not from the truth: so has the trapezoidal rule.
    let [is, told] = moved(200, 1, exact.rows[1].value, |seed| run(seed, 0.02));
    println!("rate: moved by {is:.4}, told {told:.4}");
    assert!(is > 0.2 && (told / is - 1.0).abs() < 0.2, "{is} {told}");
}

/// The same with a lift of the surface, as a normal acceleration sees it.
const LIFT: &str = r#"title = "Short period with lift"
[inputs]
de = "rad"
[parameters]
Z_a = { unit = "1/s", start = -0.5 }
Z_d = { unit = "1/s", start = -0.1 }
M_a = { unit = "1/s^2", start = -4.0 }
M_q = { unit = "1/s", start = -1.0 }
M_d = { unit = "1/s^2", start = -8.0 }
[states]
alpha = { unit = "rad", rate = "q + Z_a*alpha + Z_d*de", start = 0.0 }
q = { unit = "rad/s", rate = "M_a*alpha + M_q*q + M_d*de", start = 0.0 }
[outputs]
alpha = { unit = "rad", value = "alpha" }
q = { unit = "rad/s", value = "q" }
a_z = { unit = "rad/s", value = "Z_a*alpha + Z_d*de" }
"#;

/// A window that is long beside the edges of a 3211 keeps no more of the states than of the inputs: without
/// noise the derivatives are those of the motion, whatever it is.
#[test]
fn recovery_of_a_light_aircraft_whatever_the_window() {
    let truth = [-3.0, -0.3, -40.0, -6.0, -30.0];
    let [z_a, z_d, ..] = truth;
    // Edges of 0.1 s: 3, 2, 1, 1 times 0.3 s.
    let level = |t: f64| match t {
        t if t < 0.5 => 0.0,
        t if t < 1.4 => 0.05,
        t if t < 2.0 => -0.05,
        t if t < 2.3 => 0.05,
        t if t < 2.6 => -0.05,
        _ => 0.0,
    };
    let de = |t: f64| (0..100).map(|i| level(t - 0.001 * f64::from(i))).sum::<f64>() / 100.0;
    let (de, [alpha, q]) = motion(truth, de, (500, 0.01));
    let a_z = alpha.iter().zip(&de).map(|(a, de)| z_a * a + z_d * de).collect();
    let record = record(0.01, &[de], &[(0, alpha), (1, q), (2, a_z)]);
    for smoothing_s in [0.1, 0.5, 1.0] {
        let settings = Settings { smoothing_s, ..method() };
        let e = estimate(&model(LIFT), std::slice::from_ref(&record), &settings).unwrap();
        for (row, truth) in e.rows.iter().zip(truth) {
            let off = row.value / truth - 1.0;
            assert!(off.abs() < 5e-3, "{smoothing_s} s: {} {}", row.name, row.value);
        }
    }
}

/// Heat of hardening cement against four of its parts (Hald 1952).
const HALD: [[f64; 5]; 13] = [
    [7.0, 26.0, 6.0, 60.0, 78.5],
    [1.0, 29.0, 15.0, 52.0, 74.3],
    [11.0, 56.0, 8.0, 20.0, 104.3],
    [11.0, 31.0, 8.0, 47.0, 87.6],
    [7.0, 52.0, 6.0, 33.0, 95.9],
    [11.0, 55.0, 9.0, 22.0, 109.2],
    [3.0, 71.0, 17.0, 6.0, 102.7],
    [1.0, 31.0, 22.0, 44.0, 72.5],
    [2.0, 54.0, 18.0, 22.0, 93.1],
    [21.0, 47.0, 4.0, 26.0, 115.9],
    [1.0, 40.0, 23.0, 34.0, 83.8],
    [11.0, 66.0, 9.0, 12.0, 113.3],
    [10.0, 68.0, 8.0, 12.0, 109.4],
];

const HEAT: &str = r#"title = "Heat"
[inputs]
x1 = "-"
x2 = "-"
x3 = "-"
x4 = "-"
[parameters]
b0 = { unit = "-", start = 0.0 }
b1 = { unit = "-", start = 0.0 }
b2 = { unit = "-", start = 0.0 }
b3 = { unit = "-", start = 0.0 }
b4 = { unit = "-", start = 0.0 }
[outputs]
y = { unit = "-", value = "b0 + b1*x1 + b2*x2 + b3*x3 + b4*x4" }
"#;

fn heat(search: Search) -> Estimation {
    let column = |i: usize| HALD.iter().map(|row| row[i]).collect::<Vec<f64>>();
    let record = record(1.0, &(0..4).map(column).collect::<Vec<_>>(), &[(0, column(4))]);
    let candidates = ["b1", "b2", "b3", "b4"].map(String::from).to_vec();
    let settings = Settings { search, candidates, limit_f: 3.3, ..method() };
    estimate(&model(HEAT), &[record], &settings).unwrap_or_else(|e| panic!("{e}"))
}

/// Draper & Smith 1998, sec. 15.4: x4 comes in, x1, x2, then x4 goes out.
#[test]
fn truth_stepwise_regression_of_halds_cement() {
    let e = heat(Search::Stepwise);
    let published = [
        ("start", None, f64::NAN, 0.0, 15.04),
        ("in", Some("b4"), 22.80, 0.675, 8.96),
        ("in", Some("b1"), 108.22, 0.972, 2.73),
        ("in", Some("b2"), 5.03, 0.982, 2.31),
        ("out", Some("b4"), 1.86, 0.979, 2.41),
    ];
    assert_eq!(e.searched.len(), published.len(), "{:#?}", e.searched);
    for (step, (action, name, f, r2, s)) in e.searched.iter().zip(published) {
        assert_eq!((step.action, step.parameter.as_deref()), (action, name), "{step:?}");
        assert!(f.is_nan() || (step.partial_f - f).abs() < 6e-3, "{step:?}");
        assert!((step.r2 - r2).abs() < 6e-4 && (step.s - s).abs() < 6e-3, "{step:?}");
        assert_eq!(step.kept, action == "out");
    }
    let value = |name: &str| e.rows.iter().find(|r| r.name == name).map(|r| r.value);
    for (name, published) in [("b0", 52.58), ("b1", 1.468), ("b2", 0.662)] {
        assert!(value(name).is_some_and(|v| (v / published - 1.0).abs() < 1e-3), "{name}");
    }
    assert_eq!((value("b3"), value("b4")), (None, None));
    let not_taken = e.decisions.iter().filter(|d| d.support == Support::NotTaken);
    assert_eq!(not_taken.map(|d| d.parameter.as_str()).collect::<Vec<_>>(), ["b3", "b4"]);
}

#[test]
fn an_orthogonal_search_orders_by_what_is_explained_and_ends_at_the_least_error() {
    let e = heat(Search::Orthogonal);
    let names: Vec<&str> = e.searched.iter().filter_map(|s| s.parameter.as_deref()).collect();
    assert_eq!(names, ["b4", "b1", "b2", "b3"]);
    // All in: R2 0.98238, s 2.446 (Draper & Smith 1998, sec. 15.2).
    let last = e.searched.last().unwrap();
    assert!((last.r2 - 0.98238).abs() < 1e-5 && (last.s - 2.446).abs() < 6e-4, "{last:?}");
    let total: f64 = 2715.763;
    for step in &e.searched {
        // By its definition, from the published total sum of squares.
        let (n, p) = (13.0, step.terms as f64);
        let pse = (1.0 - step.r2) * total / n + total / n * p / n;
        assert!((step.pse / pse - 1.0).abs() < 1e-5, "{step:?} {pse}");
    }
    let kept: Vec<usize> = e.searched.iter().filter(|s| s.kept).map(|s| s.step).collect();
    let least = e.searched.iter().min_by(|a, b| a.pse.total_cmp(&b.pse)).unwrap().step;
    assert_eq!(kept, [least]);
    // With 13 samples and all of the variance to lose, one term more costs 16: two are worth it.
    let estimated: Vec<&str> = e.rows.iter().map(|r| r.name.as_str()).collect();
    assert_eq!((least, estimated), (2, vec!["b0", "b1", "b4"]));
}

#[test]
fn the_noise_that_drives_a_model_is_in_no_equation() {
    let driven = MOTION
        .replace("[states]", "F = { unit = \"rad/s^1.5\", start = 0.1, min = 0.0 }\n[states]")
        .replace("M_d*de\", start = 0.0", "M_d*de\", start = 0.0, noise = \"F\"");
    let (de, [alpha, q]) = swept_motion(400);
    let e = estimate(&model(&driven), &[record(0.02, &[de], &[(0, alpha), (1, q)])], &method())
        .unwrap();
    let row = e.rows.iter().find(|r| r.name == "F").expect("a row");
    assert!(row.idle && row.value == 0.1 && row.sd.is_none(), "{row:?}");
    assert_eq!(e.why_idle(row), crate::estimate::Idle::NoEquation);
    assert!(e.rows.iter().filter(|r| r.name != "F").all(|r| r.sd.is_some()));
    let names: Vec<&str> = e.responses[0].iter().map(|t| t.name.as_str()).collect();
    assert_eq!(names, ["rate of alpha", "rate of q"]);
}

const LATERAL: &str = r#"title = "Lateral motion, the vane ahead of the centre of gravity and the accelerometer, too"
[inputs]
da = "rad"
dr = "rad"
[parameters]
Y_b = { unit = "1/s", start = -0.2 }
L_b = { unit = "1/s^2", start = -10.0 }
L_p = { unit = "1/s", start = -4.0 }
L_r = { unit = "1/s", start = 1.0 }
L_a = { unit = "1/s^2", start = 20.0 }
N_b = { unit = "1/s^2", start = 5.0 }
N_p = { unit = "1/s", start = 0.0 }
N_r = { unit = "1/s", start = -0.5 }
N_d = { unit = "1/s^2", start = -5.0 }
L_0 = { unit = "rad/s^2", start = 0.0, per = "segment" }
N_0 = { unit = "rad/s^2", start = 0.0, per = "segment" }
[constants]
g_V = { unit = "1/s", value = 0.4 }
V = { unit = "m/s", value = 25.0 }
x_v = { unit = "m", value = 0.7 }
x_a = { unit = "m", value = 0.2 }
[equations]
pdot = "L_0 + L_b*beta + L_p*p + L_r*r + L_a*da"
rdot = "N_0 + N_b*beta + N_p*p + N_r*r + N_d*dr"
[states]
beta = { unit = "rad", rate = "Y_b*beta - r + g_V*sin(phi)", start = 0.0 }
p = { unit = "rad/s", rate = "pdot", start = 0.0 }
r = { unit = "rad/s", rate = "rdot", start = 0.0 }
phi = { unit = "rad", rate = "p", start = 0.0 }
[outputs]
beta = { unit = "rad", value = "beta + x_v*r/V" }
p = { unit = "rad/s", value = "p" }
r = { unit = "rad/s", value = "r" }
phi = { unit = "rad", value = "phi" }
ay = { unit = "m/s^2", value = "V*Y_b*beta + x_a*rdot" }
"#;

const LATERAL_TRUTH: [f64; 9] = [-0.3, -16.0, -6.0, 2.0, 40.0, 9.0, -0.6, -0.9, -8.0];

/// Maneuvers of it, with noise of these sd per output.
fn lateral(model: &Model, seed: u64, sd: [f64; 5]) -> Vec<Record> {
    use crate::dynamics::{Directions, Propagator};
    let propagator = Propagator::new(model, Directions::default()).unwrap();
    let mut random = rng(seed);
    let one = |s: usize| {
        let (dt, n) = (0.01, 600);
        let step = |k: usize, at: f64| {
            let t = k as f64 * dt - at;
            if !(0.0..=1.0).contains(&t) {
                0.0
            } else {
                0.05 * (2.0 * std::f64::consts::PI * t).sin()
            }
        };
        let size = [1.0, -0.7, 0.8, -1.2][s % 4];
        let da: Vec<f64> = (0..n).map(|k| size * step(k, 0.5)).collect();
        let dr: Vec<f64> = (0..n).map(|k| size * step(k, 2.0)).collect();
        let nothing: Vec<(usize, Vec<f64>)> = (0..5).map(|o| (o, vec![0.0; n])).collect();
        let mut flown = record(dt, &[da, dr], &nothing);
        flown.substeps = 4;
        let mut parameters = model.parameter_starts();
        parameters[..9].copy_from_slice(&LATERAL_TRUTH);
        let response = propagator.respond(&parameters, &[], &flown, false);
        for (channel, (y, sd)) in flown.channels.iter_mut().zip(response.y.iter().zip(sd)) {
            channel.z = sums(y, &noise(&mut random, n, sd, 0.0)).into();
        }
        flown
    };
    (0..6).map(one).collect()
}

/// What the output of a state's name has besides the state is taken off it.
#[test]
fn truth_a_vane_away_from_the_centre_of_gravity_is_brought_there() {
    let model = model(LATERAL);
    let exact = estimate(&model, &lateral(&model, 1, [0.0; 5]), &method()).unwrap();
    for (row, truth) in exact.rows.iter().zip(LATERAL_TRUTH) {
        assert!((row.value - truth).abs() < 2e-3 * truth.abs(), "{row:?} for {truth}");
    }
    let beta = exact.regression.as_ref().unwrap().equations.iter().find(|e| e.name == "beta");
    assert_eq!(beta.unwrap().outcome, "the state, and more that is taken off: its rate is used");
    for seed in 2..6 {
        let records = lateral(&model, seed, [2e-3, 3e-3, 3e-3, 2e-3, 0.05]);
        let e = estimate(&model, &records, &method()).unwrap();
        assert_eq!(e.stop, Stop::Converged, "{:?}", e.iterations);
        for (row, truth) in e.rows.iter().zip(LATERAL_TRUTH) {
            assert!((row.value - truth).abs() < 0.1 * truth.abs() + 0.1, "{row:?} for {truth}");
        }
    }
}
