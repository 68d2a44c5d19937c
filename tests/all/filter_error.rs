//! Models whose states are driven by noise: is the likelihood that of the record, are its derivatives
//! right, and is what published records hide found again?

use crate::flightdata::data;
use koehler::dynamics::{Channel, Directions, Filter, Interpolation, Propagator, Record};
use koehler::estimate::{Estimation, Settings, Stop, estimate};
use koehler::model::{Constants, Model, Scope, Scored};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

fn model(name: &str, text: &str) -> Model {
    Model::parse(name, text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn numbers(path: &std::path::Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).expect("the record");
    let row = |line: &str| line.split_whitespace().map(|v| v.parse().expect("a number")).collect();
    text.lines().filter(|line| !line.trim().is_empty()).map(row).collect()
}

/// Lateral motion in turbulence (Jategaonkar's y13aus, DHC-2).
const LATERAL: &str = r#"title = "Lateral motion in turbulence"
source = "Jategaonkar, Flight Vehicle System Identification"

[inputs]
da = "rad"
dr = "rad"
v  = "m/s"

[parameters]
Lp  = { unit = "1/s", start = -6.7 }
Lr  = { unit = "1/s", start = 1.83 }
Lda = { unit = "1/s^2", start = -18.3 }
Ldr = { unit = "1/s^2", start = 0.43 }
Lv  = { unit = "1/(m s)", start = -0.114 }
L0  = { unit = "1/s^2", start = 0.0 }
Np  = { unit = "1/s", start = -0.906 }
Nr  = { unit = "1/s", start = -0.665 }
Nda = { unit = "1/s^2", start = -0.66 }
Ndr = { unit = "1/s^2", start = -2.82 }
Nv  = { unit = "1/(m s)", start = 0.0069 }
N0  = { unit = "1/s^2", start = 0.0 }
Yp  = { unit = "m/s", start = -0.64 }
Yr  = { unit = "m/s", start = 1.3 }
Yda = { unit = "m/s^2", start = -1.4 }
Ydr = { unit = "m/s^2", start = 2.79 }
Yv  = { unit = "1/s", start = -0.193 }
Y0  = { unit = "m/s^2", start = 0.0 }
F_p = { unit = "rad/s^1.5", start = 0.1, min = 0.0 }
F_r = { unit = "rad/s^1.5", start = 0.1, min = 0.0 }

[equations]
L = "Lp*p + Lr*r + Lda*da + Ldr*dr + Lv*v + L0"
N = "Np*p + Nr*r + Nda*da + Ndr*dr + Nv*v + N0"

[states]
p = { unit = "rad/s", rate = "L", start = "measured", noise = "F_p" }
r = { unit = "rad/s", rate = "N", start = "measured", noise = "F_r" }

[outputs]
p    = { unit = "rad/s", value = "p" }
r    = { unit = "rad/s", value = "r" }
pdot = { unit = "rad/s^2", value = "L" }
rdot = { unit = "rad/s^2", value = "N" }
ay   = { unit = "m/s^2", value = "Yp*p + Yr*r + Yda*da + Ydr*dr + Yv*v + Y0" }
"#;

const TRUTH: [(&str, f64); 15] = [
    ("Lp", -5.81996),
    ("Lr", 1.78187),
    ("Lda", -16.4338),
    ("Ldr", 0.443457),
    ("Lv", -0.096877),
    ("Np", -0.664906),
    ("Nr", -0.711906),
    ("Nda", -0.428722),
    ("Ndr", -2.82432),
    ("Nv", 0.00843836),
    ("Yp", -0.278403),
    ("Yr", 1.40995),
    ("Yda", -0.447117),
    ("Ydr", 2.65706),
    ("Yv", -0.179944),
];

fn record(rows: &[Vec<f64>], dt: f64, inputs: &[usize], outputs: &[usize]) -> Record {
    let n = rows.len();
    let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    let channels = outputs.iter().enumerate().map(|(output, &column)| Channel {
        output,
        t: t.clone().into(),
        z: rows.iter().map(|row| row[column - 1]).collect(),
    });
    Record {
        dt,
        n,
        inputs: rows.iter().flat_map(|row| inputs.iter().map(|&c| row[c - 1])).collect(),
        channels: channels.collect(),
        ..Record::default()
    }
}

fn value(e: &Estimation, name: &str) -> (f64, f64) {
    let row = e.rows.iter().find(|r| r.name == name).expect("a parameter");
    (row.value, row.sd.unwrap_or(f64::NAN))
}

#[test]
fn truth_lateral_motion_in_turbulence_without_noise_of_the_sensors() {
    let Some(folder) = data("records/y13aus_da1.asc") else { return };
    let rows = numbers(&folder.join("records/y13aus_da1.asc"));
    let record = record(&rows, 0.05, &[17, 18, 19], &[15, 16, 12, 13, 14]);
    let found = estimate(&model("lateral", LATERAL), &[record], &Settings::default())
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(found.stop, Stop::Converged);
    for (name, truth) in TRUTH {
        let (is, _) = value(&found, name);
        assert!((is / truth - 1.0).abs() < 5e-3, "{name}: {is} for {truth}");
    }
    for output in &found.outputs {
        // The sensors are without noise: it ends at what the numbers resolve, and says so.
        let row = found.rows.iter().find(|r| r.name == format!("sd_{}", output.name));
        assert!(row.is_some_and(|r| r.at_bound && r.sd.is_none()), "{}", output.name);
    }
    // States known exactly at every sample: the noise is what the motion between two of them does not
    // explain. Its r.m.s. over the root of the step is 0.2057 and 0.1931; as a density, which is
    // damped within the step, 0.23735 and 0.19637 (by the matrix exponential of Van Loan 1978).
    for (name, exact) in [("F_p", 0.23735), ("F_r", 0.19637)] {
        let (is, _) = value(&found, name);
        assert!((is / exact - 1.0).abs() < 5e-4, "{name}: {is} for {exact}");
    }
}

#[test]
fn a_density_that_starts_at_zero_goes_where_the_score_in_the_variance_leads() {
    let Some(folder) = data("records/y13aus_da1.asc") else { return };
    let rows = numbers(&folder.join("records/y13aus_da1.asc"));
    let record = record(&rows, 0.05, &[17, 18, 19], &[15, 16, 12, 13, 14]);
    let of = |start: &str| {
        let text = LATERAL.replace("start = 0.1, min", &format!("start = {start}, min"));
        estimate(&model("lateral", &text), std::slice::from_ref(&record), &Settings::default())
            .unwrap_or_else(|e| panic!("{e}"))
    };
    let [from_zero, from_above] = ["0.0", "0.1"].map(of);
    assert_eq!(from_zero.stop, Stop::Converged);
    for name in ["F_p", "F_r", "Lda", "Ndr"] {
        let [(a, _), (b, _)] = [&from_zero, &from_above].map(|e| value(e, name));
        assert!((a / b - 1.0).abs() < 1e-4, "{name}: {a} from zero, {b} from above");
    }
}

/// Short period of an unstable aircraft (Jategaonkar's unStabAC).
const UNSTABLE: &str = r#"title = "Unstable short period"
source = "Jategaonkar, Flight Vehicle System Identification"

[inputs]
de = "rad"

[constants]
U0 = { unit = "m/s", value = 44.5695 }
Zq = { unit = "m/s", value = -1.4768 }

[parameters]
Zw  = { unit = "1/s", start = -1.22871 }
Zde = { unit = "m/s^2", start = -4.20491 }
Mw  = { unit = "rad/(m s)", start = 0.116197 }
Mq  = { unit = "1/s", start = -2.70670 }
Mde = { unit = "1/s^2", start = -18.7718 }
F_w = { unit = "m/s^1.5", start = 0.1, min = 0.0 }
F_q = { unit = "rad/s^1.5", start = 0.01, min = 0.0 }

[equations]
az = "Zw*w + Zq*q + Zde*de"

[states]
w = { unit = "m/s", rate = "az + U0*q", start = "measured", noise = "F_w" }
q = { unit = "rad/s", rate = "Mw*w + Mq*q + Mde*de", start = "measured", noise = "F_q" }

[outputs]
w  = { unit = "m/s", value = "w" }
q  = { unit = "rad/s", value = "q" }
az = { unit = "m/s^2", value = "az" }
"#;

#[test]
fn truth_an_unstable_aircraft_without_stabilisation() {
    let Some(folder) = data("records/unStabAC_sim.asc") else { return };
    let rows = numbers(&folder.join("records/unStabAC_sim.asc"));
    let dt = rows[1][0] - rows[0][0];
    let record = record(&rows, dt, &[5], &[3, 4, 6]);
    let found = estimate(&model("unstable", UNSTABLE), &[record], &Settings::default())
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(found.stop, Stop::Converged);
    let truth =
        [("Zw", -1.4249), ("Zde", -6.2632), ("Mw", 0.2163), ("Mq", -3.7067), ("Mde", -12.784)];
    for (name, truth) in truth {
        let (is, _) = value(&found, name);
        assert!((is / truth - 1.0).abs() < 1e-3, "{name}: {is} for {truth}");
    }
}

/// Output error from the book's start ends in a minimum that means nothing (published: det R 3.1e-5); a regression on the
/// equations leads to the other one.
#[test]
fn truth_a_false_minimum_is_left_for_the_one_that_regression_leads_to() {
    let Some(folder) = data("records/unStabAC_sim.asc") else { return };
    let rows = numbers(&folder.join("records/unStabAC_sim.asc"));
    let record = record(&rows, rows[1][0] - rows[0][0], &[5], &[3, 4, 6]);
    let kept = |line: &&str| !line.starts_with("F_");
    let text: Vec<&str> = UNSTABLE.lines().filter(kept).collect();
    let text = text.join("\n").replace(", noise = \"F_w\"", "").replace(", noise = \"F_q\"", "");
    let found = estimate(&model("unstable", &text), &[record], &Settings::default())
        .unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(found.stop, Stop::Converged);
    let other = found.elsewhere.as_ref().expect("two minima");
    assert!(other.taken && other.worse > 100.0 && found.det_r < 1e-12, "{other:?} {}", found.det_r);
    let truth =
        [("Zw", -1.4249), ("Zde", -6.2632), ("Mw", 0.2163), ("Mq", -3.7067), ("Mde", -12.784)];
    for (name, truth) in truth {
        let (is, _) = value(&found, name);
        // what straight lines between the elevator's samples cost an unstable motion
        assert!((is / truth - 1.0).abs() < 0.02, "{name}: {is} for {truth}");
    }
}

/// A first-order system driven by noise, seen by two sensors.
const FIRST: &str = r#"title = "First order"

[inputs]
u = "rad"

[parameters]
a = { unit = "1/s", start = 2.0 }
b = { unit = "1/s", start = 3.0 }
F = { unit = "rad/s^0.5", start = 0.3, min = 0.0 }

[states]
x = { unit = "rad", rate = "b*u - a*x", start = 0.1, noise = "F" }

[outputs]
x = { unit = "rad", value = "x" }
y = { unit = "rad", value = "2*x + 0.5*u" }
"#;

#[test]
fn truth_the_likelihood_is_that_of_all_samples_together() {
    let (a, b, f, dt, n) = (2.0f64, 3.0, 0.3f64, 0.01, 60);
    let input = |t: f64| (5.0 * t).sin();
    // Two sensors on clocks of their own; one sample of the second is missing.
    let times: [Vec<f64>; 2] = [
        (1..12).map(|k| 0.05 * f64::from(k)).collect(),
        (0..9).map(|k| 0.013 + 0.063 * f64::from(k)).collect(),
    ];
    let z: [Vec<f64>; 2] = [
        times[0].iter().map(|t| 0.2 + 0.9 * t + 0.1 * (40.0 * t).sin()).collect(),
        times[1].iter().enumerate().map(|(k, t)| if k == 4 { f64::NAN } else { 0.5 + t }).collect(),
    ];
    let channels = (0..2).map(|output| Channel {
        output,
        t: times[output].clone().into(),
        z: z[output].clone().into(),
    });
    let inputs = (0..n).map(|k| input(dt * f64::from(k))).collect();
    let record =
        Record { dt, n: n as usize, inputs, channels: channels.collect(), ..Record::default() };
    let sd = [0.05, 0.08];
    let mut settings = Settings { max_iterations: 0, ..Settings::default() };
    for (name, sd) in ["sd_x", "sd_y"].iter().zip(sd) {
        settings.starts.insert(name.to_string(), sd);
    }
    let found =
        estimate(&model("first", FIRST), &[record], &settings).unwrap_or_else(|e| panic!("{e}"));
    // All samples are one Gaussian vector: cov(x(t), x(s)) = exp(-a (t - s)) P(s), s <= t.
    let mean = |t: f64| {
        // 0.1 exp(-a t) + b int exp(-a (t - s)) sin(5 s) ds, u between samples straight to 1e-4
        let steps = 2000;
        let h = t / f64::from(steps);
        let g = |s: f64| (-a * (t - s)).exp() * input(s);
        let mid: f64 = (0..steps).map(|i| g((f64::from(i) + 0.5) * h)).sum();
        0.1 * (-a * t).exp() + b * h * mid
    };
    let variance = |t: f64| f * f * (1.0 - (-2.0 * a * t).exp()) / (2.0 * a);
    let mut all = Vec::new();
    for (j, gain) in [1.0, 2.0].iter().enumerate() {
        for (t, z) in times[j].iter().zip(&z[j]).filter(|(_, z)| z.is_finite()) {
            let direct = if j == 1 { 0.5 * input(*t) } else { 0.0 };
            all.push((*t, *gain, sd[j] * sd[j], z - gain * mean(*t) - direct));
        }
    }
    let m = all.len();
    let mut c = vec![0.0; m * m];
    for (i, (ti, gi, ri, _)) in all.iter().enumerate() {
        for (k, (tk, gk, ..)) in all.iter().enumerate() {
            let (late, early) = (ti.max(*tk), ti.min(*tk));
            c[i * m + k] = gi * gk * (-a * (late - early)).exp() * variance(early);
        }
        c[i * m + i] += ri;
    }
    let cost = gaussian(c, all.iter().map(|x| x.3).collect());
    let is = found.iterations[0].cost;
    assert!((is - cost).abs() < 2e-3 * cost.abs(), "{is} {cost}");
}

/// `1/2 (ln|C| + e' C^-1 e)` by elimination.
fn gaussian(mut c: Vec<f64>, mut e: Vec<f64>) -> f64 {
    let m = e.len();
    let mut cost = 0.0;
    for i in 0..m {
        let pivot = c[i * m + i];
        cost += 0.5 * (pivot.ln() + e[i] * e[i] / pivot);
        for k in i + 1..m {
            let share = c[k * m + i] / pivot;
            for l in i..m {
                c[k * m + l] -= share * c[i * m + l];
            }
            e[k] -= share * e[i];
        }
    }
    cost
}

/// Nonlinear in states and parameters, with a delayed input and a free start.
const CURVED: &str = r#"title = "Pendulum in gusts"

[inputs]
u = "rad"

[parameters]
k = { unit = "1/s^2", start = 9.0 }
d = { unit = "1/s", start = 0.6 }
b = { unit = "1/s^2", start = 4.0 }
tau = { unit = "s", start = 0.07, min = 0.0 }
F = { unit = "rad/s^1.5", start = 0.4, min = 0.0 }
gain = { unit = "-", start = 1.2 }

[states]
x = { unit = "rad", rate = "v", start = "measured" }
v = { unit = "rad/s", rate = "b*delay(u, tau) - k*sin(x) - d*v*(1 + v^2*T_v^2)", start = 0.0, noise = "F*(1 + x^2)" }

[constants]
T_v = { unit = "s", value = 0.3 }

[outputs]
x = { unit = "rad", value = "gain*sin(x)" }
v = { unit = "rad/s", value = "v + k*x^2*T_v" }
"#;

/// A servo with a limited rate, play behind it, and a motion in gusts that the surface drives: neither
/// servo nor surface hangs on what the gusts do.
const LOOSE: &str = r#"title = "Loose surface in gusts"

[inputs]
u = "rad"

[parameters]
R = { unit = "rad/s", start = 0.9 }
play = { unit = "rad", start = 0.05 }
k = { unit = "1/s^2", start = 9.0 }
d = { unit = "1/s", start = 0.6 }
b = { unit = "1/s^2", start = 4.0 }
tau = { unit = "s", start = 0.0673, min = 0.0 }
F = { unit = "rad/s^1.5", start = 0.4, min = 0.0 }

[states]
servo = { unit = "rad", rate = "0", min = "delay(u, tau)", max = "delay(u, tau)", rate_max = "R", start = "u" }
surface = { unit = "rad", rate = "0", min = "servo - play", max = "servo + play", start = "servo" }
x = { unit = "rad", rate = "v", start = "measured" }
v = { unit = "rad/s", rate = "b*surface - k*sin(x) - d*v", start = 0.0, noise = "F" }

[outputs]
x = { unit = "rad", value = "x" }
v = { unit = "rad/s", value = "v + 0.3*surface/one" }

[constants]
one = { unit = "s", value = 1.0 }
"#;

/// A record of `u` with samples of two outputs on a clock of their own.
fn two_sensors(u: impl Fn(f64) -> f64) -> Record {
    let (dt, n) = (0.02, 200);
    let t: Vec<f64> = (1..100).map(|k| 0.013 + 0.037 * f64::from(k)).collect();
    let of = |output: usize, z: fn(f64) -> f64| Channel {
        output,
        z: t.iter().map(|t| z(*t)).collect(),
        t: t.clone().into(),
    };
    let channels = vec![of(0, |t| 0.3 * (2.5 * t).sin()), of(1, |t| 0.7 * (2.5 * t).cos())];
    let inputs = (0..n).map(|k| u(dt * k as f64)).collect();
    Record { dt, n, inputs, channels, substeps: 2, ..Record::default() }
}

/// Every derivative of the innovations and their variances against differences; state `start` begins
/// at 0.2, and may begin elsewhere.
fn held_against_differences(model: &Model, start: usize, record: &Record) {
    let scored = [(0, 0.03), (1, 0.05)].map(|(output, start)| Scored { output, start, floor: 0.0 });
    let model = model
        .with_covariance(&scored, &[start], &Scope::Campaign)
        .unwrap_or_else(|e| panic!("{e}"));
    let directions =
        Directions { parameters: (0..model.parameters.len()).collect(), starts: vec![start] };
    let propagator = Propagator::new(&model, directions).expect("a propagator");
    let filter = Filter::new(&model, &propagator).expect("a filter");
    let at = |point: &[f64], derivatives: bool| {
        let (parameters, starts) = point.split_at(model.parameters.len());
        let out = filter.run(&propagator, parameters, starts, record, derivatives);
        assert!(out.lost.is_none(), "{:?}", out.lost);
        out
    };
    let mut point = model.parameter_starts();
    point.push(0.2);
    let exact = at(&point, true);
    let nd = point.len();
    for d in 0..nd {
        let h = 1e-6 * point[d].abs().max(0.1);
        let shifted = |by: f64| {
            let mut moved = point.clone();
            moved[d] += by;
            at(&moved, false)
        };
        let (up, down) = (shifted(h), shifted(-h));
        for c in 0..2 {
            let [mut worst, mut largest] = [[0.0f64; 2]; 2];
            for k in 0..record.channels[c].t.len() {
                let (dy, ds) = (exact.channels[c].dy[k * nd + d], exact.channels[c].ds[k * nd + d]);
                let of = &exact.channels[c];
                let differences = [
                    (up.channels[c].y[k] - down.channels[c].y[k]) / (2.0 * h) / of.s[k].sqrt(),
                    (up.channels[c].s[k] - down.channels[c].s[k]) / (2.0 * h) / of.s[k],
                ];
                for (i, (is, wanted)) in [dy, ds].iter().zip(differences).enumerate() {
                    worst[i] = worst[i].max((is - wanted).abs());
                    largest[i] = largest[i].max(wanted.abs());
                }
            }
            for i in 0..2 {
                let name = model.parameters.get(d).map_or("start", |p| &p.quantity.name);
                assert!(
                    worst[i] <= (2e-6 * largest[i]).max(4e-9),
                    "{name} {c} {i}: {worst:?} of {largest:?}"
                );
            }
        }
    }
}

#[test]
fn derivatives_of_innovations_are_those_of_differences() {
    let record = two_sensors(|t| if (0.39..1.39).contains(&t) { 0.4 } else { -0.2 });
    held_against_differences(&model("curved", CURVED), 0, &record);
    let smooth = two_sensors(|t| 0.4 * (1.7 * t).sin() + 0.2 * (6.1 * t).sin());
    held_against_differences(&model("loose", LOOSE), 2, &smooth);
}

#[test]
fn what_noise_does_not_reach_moves_in_a_filter_as_without_one() {
    // Sensors that nobody believes correct nothing: what is predicted is the motion by itself.
    let record = two_sensors(|t| 0.4 * (1.7 * t).sin() + 0.2 * (6.1 * t).sin());
    let plain = model("loose", LOOSE);
    let scored = [0, 1].map(|output| Scored { output, start: 1e9, floor: 0.0 });
    let driven = plain.with_covariance(&scored, &[2], &Scope::Campaign).expect("a filter");
    let propagator = Propagator::new(&driven, Directions::default()).expect("a propagator");
    let filter = Filter::new(&driven, &propagator).expect("a filter");
    let filtered = filter.run(&propagator, &driven.parameter_starts(), &[0.2], &record, false);
    let propagator = Propagator::new(&plain, Directions::default()).expect("a propagator");
    let still = propagator.run(&plain.parameter_starts(), &[0.2], &record, false);
    let mut worst = 0.0f64;
    for (c, of) in filtered.channels.iter().enumerate() {
        for (t, y) in record.channels[c].t.iter().zip(&of.y) {
            // both grids are finer than the motion: straight lines between points
            let (k, share) = ((t / record.dt) as usize, (t / record.dt).fract());
            let [a, b] = [k, k + 1].map(|k| still.y[2 * k + c]);
            worst = worst.max((a + share * (b - a) - y).abs());
        }
    }
    assert!(worst < 2e-3, "{worst}");
}

#[test]
fn a_stop_that_noise_reaches_is_refused_by_name() {
    let text = LOOSE.replace("max = \"servo + play\"", "max = \"servo + play + 0.1*x\"");
    let error = model("loose", &text).with_covariance(&[], &[], &Scope::Campaign).err();
    let words = error.map(|e| e.to_string()).unwrap_or_default();
    assert!(words.contains("\"surface\" has a stop, and noise reaches it"), "{words}");
}

/// The same without noise that drives it.
fn still() -> String {
    let text = LATERAL.replace(", noise = \"F_p\"", "").replace(", noise = \"F_r\"", "");
    let is_density = |line: &&str| line.starts_with("F_p") || line.starts_with("F_r");
    text.lines().filter(|line| !is_density(line)).collect::<Vec<_>>().join("\n")
}

/// Numbers of one stream.
fn normal(random: &mut rand_pcg::Pcg64) -> f64 {
    StandardNormal.sample(random)
}

#[test]
fn recovery_coverage_with_noise_of_the_sensors_in_turbulence() {
    let Some(folder) = data("records/y13aus_da1.asc") else { return };
    let rows = numbers(&folder.join("records/y13aus_da1.asc"));
    let draws = if std::env::var("KOEHLER_SLOW").as_deref() == Ok("1") { 200 } else { 20 };
    let sd = [0.005, 0.005, 0.05, 0.05, 0.05];
    let (plain, model) = (model("plain", &still()), model("lateral", LATERAL));
    let free = Settings { initial: vec!["p".into(), "r".into()], ..Settings::default() };
    let (mut inside, mut first_worst, mut sum) = (0, 0.0f64, [0.0; 2]);
    let mut by_output_error = 0;
    for draw in 0..draws {
        let mut random = rand_pcg::Pcg64::seed_from_u64(20 + draw);
        let mut record = record(&rows, 0.05, &[17, 18, 19], &[15, 16, 12, 13, 14]);
        for (channel, sd) in record.channels.iter_mut().zip(sd) {
            channel.z.iter_mut().for_each(|z| *z += sd * normal(&mut random));
        }
        let beside = estimate(&plain, std::slice::from_ref(&record), &free)
            .unwrap_or_else(|e| panic!("{e}"));
        let found =
            estimate(&model, &[record], &Settings::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(found.stop, Stop::Converged, "draw {draw}");
        for (name, truth) in TRUTH {
            let (is, sd) = value(&beside, name);
            by_output_error += usize::from((is - truth).abs() < 1.96 * sd);
            let (is, sd) = value(&found, name);
            let off = (is - truth) / sd;
            inside += usize::from(off.abs() < 1.96);
            sum = [sum[0] + off, sum[1] + off * off];
            if draw == 0 {
                first_worst = first_worst.max(off.abs());
            }
        }
    }
    let n = (draws * TRUTH.len() as u64) as f64;
    let share = inside as f64 / n;
    println!(
        "{draws} draws: {:.1} % (output error {:.1} %), mean {:.2}, r.m.s. {:.2} sd, first {first_worst:.1}",
        100.0 * share,
        100.0 * by_output_error as f64 / n,
        sum[0] / n,
        (sum[1] / n).sqrt()
    );
    assert!(first_worst < 3.0, "{first_worst}");
    let slack = if draws < 100 { 0.03 } else { 0.0 };
    assert!((0.93 - slack..=0.97 + slack).contains(&share), "{share}");
}

#[test]
fn recovery_without_turbulence_the_density_is_nothing_and_derivatives_are_those_of_output_error() {
    // The pendulum-like roll of LATERAL is driven by a 3211; there are no gusts.
    let (plain, driven) = (model("plain", &still()), model("lateral", LATERAL));
    let (dt, n) = (0.05, 400);
    let square = |k: usize, from: usize| match (k.wrapping_sub(from)) / 15 {
        0..3 => 0.05,
        3..5 => -0.05,
        5 => 0.05,
        6 => -0.05,
        _ => 0.0,
    };
    let inputs: Vec<f64> = (0..n)
        .flat_map(|k| [square(k, 20), square(k, 180), 2.0 * (0.3 * k as f64 * dt).sin()])
        .collect();
    let propagator = Propagator::new(&plain, Directions::default()).expect("a propagator");
    let mut parameters = plain.parameter_starts();
    for (name, truth) in TRUTH {
        parameters[plain.parameter(name).expect("a parameter")] = truth;
    }
    let run = Record { dt, n, inputs: inputs.into(), ..Record::default() };
    let y = propagator.run(&parameters, &[0.0, 0.0], &run, false).y;
    let sd = [0.005, 0.005, 0.05, 0.05, 0.05];
    let settings = Settings { initial: vec!["p".into(), "r".into()], ..Settings::default() };
    let draws = if std::env::var("KOEHLER_SLOW").as_deref() == Ok("1") { 200 } else { 20 };
    let (mut significant, mut zero, mut apart) = (0, 0, [0.0f64; 2]);
    for draw in 0..draws {
        let mut random = rand_pcg::Pcg64::seed_from_u64(500 + draw);
        let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let mut channel = |output: usize| Channel {
            output,
            t: t.clone().into(),
            z: (0..n).map(|k| y[k * 5 + output] + sd[output] * normal(&mut random)).collect(),
        };
        let channels = (0..5).map(&mut channel).collect();
        let record = Record { channels, ..run.clone() };
        let of = |model: &Model| {
            estimate(model, std::slice::from_ref(&record), &settings)
                .unwrap_or_else(|e| panic!("{e}"))
        };
        let (filtered, output_error) = (of(&driven), of(&plain));
        assert_eq!(filtered.stop, Stop::Converged, "draw {draw}");
        let before = zero;
        for name in ["F_p", "F_r"] {
            let (is, sd) = value(&filtered, name);
            significant += usize::from(is > 1.645 * sd);
            let row = filtered.rows.iter().find(|r| r.name == name).expect("a density");
            if is == 0.0 {
                // Nothing asks for it: an upper limit stands in place of its sd.
                zero += 1;
                let upper = row.upper.expect("an upper limit");
                assert!(
                    row.at_bound && row.sd.is_none() && (1e-4..0.02).contains(&upper),
                    "{upper}"
                );
            }
        }
        for (name, _) in TRUTH {
            let ((a, _), (b, sd)) = (value(&filtered, name), value(&output_error, name));
            let here = &mut apart[usize::from(zero < before + 2)];
            *here = here.max((a - b).abs() / sd);
        }
    }
    println!(
        "{significant} of {} densities are significant, {zero} zero; derivatives {:.2} sd apart where both are, {:.2} elsewhere",
        2 * draws,
        apart[0],
        apart[1]
    );
    let share = significant as f64 / (2 * draws) as f64;
    let most = if draws < 100 { 0.15 } else { 0.08 };
    assert!(share <= most && (draws < 100 || share >= 0.02), "{share}");
    assert!(zero > draws / 2 && apart[0] < 0.2 && apart[1] < 0.6, "{zero} {apart:?}");
}

/// Short period in vertical gusts; what flies has noise as an input, what is estimated is driven by it.
fn short_period(gusts: &str, inputs: &str) -> String {
    format!(
        r#"title = "Short period in vertical gusts"
use = ["{gusts}"]

[inputs]
de = "rad"
V  = "m/s"
{inputs}

[parameters]
Zw  = {{ unit = "1/s", start = -1.2 }}
Zde = {{ unit = "m/s^2", start = -10.0 }}
Mw  = {{ unit = "rad/(m s)", start = -0.05 }}
Mq  = {{ unit = "1/s", start = -2.0 }}
Mde = {{ unit = "1/s^2", start = -12.0 }}

[equations]
w_air = "w - w_gust"
az    = "Zw*w_air + Zde*de"

[states]
w = {{ unit = "m/s", rate = "az + V*q", start = 0.0 }}
q = {{ unit = "rad/s", rate = "Mw*w_air + Mq*q + Mde*de", start = 0.0 }}

[outputs]
w_air = {{ unit = "m/s", value = "w_air", doc = "from the angle-of-attack vane" }}
q     = {{ unit = "rad/s", value = "q" }}
az    = {{ unit = "m/s^2", value = "az" }}
"#
    )
}

const SHORT_PERIOD: [(&str, f64); 5] =
    [("Zw", -1.2), ("Zde", -10.0), ("Mw", -0.05), ("Mq", -2.0), ("Mde", -12.0)];

/// Elevator 3211s in Dryden gusts of `sigma` m/s at 100 m/s: flown with steps of 5 ms, recorded at
/// 20 Hz with noise of the sensors.
fn flown(random: &mut rand_pcg::Pcg64, sigma: f64) -> Record {
    const FINE: f64 = 0.005;
    const EVERY: usize = 10;
    let n = 12_001;
    let unused = "turbulence = \"m/s\"\nnoise_u = \"-\"\nnoise_v = \"-\"\nnoise_w = \"-\"";
    let truth = model("flown", &short_period("dryden", unused));
    // Edges on samples of both rates.
    let command = |k: usize| match (k % 4000).checked_sub(600) {
        Some(0..360 | 600..720) => 0.03,
        Some(360..600 | 720..840) => -0.03,
        _ => 0.0,
    };
    let mut inputs = Vec::new();
    for k in 0..n {
        for input in &truth.inputs {
            inputs.push(match input.name.as_str() {
                "de" => command(k),
                "V" => 100.0,
                "turbulence" => sigma,
                // two-sided density 1 per Hz over steps of FINE
                _ => normal(random) / FINE.sqrt(),
            });
        }
    }
    let interpolation = vec![Interpolation::Hold; truth.inputs.len()];
    let fine = Record { dt: FINE, n, inputs: inputs.into(), interpolation, ..Record::default() };
    let propagator = Propagator::new(&truth, Directions::default()).expect("a propagator");
    let y = propagator.run(&truth.parameter_starts(), &[], &fine, false).y;
    let (dt, n) = (FINE * EVERY as f64, (n - 1) / EVERY + 1);
    let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
    let mut channel = |output: usize, sd: f64| Channel {
        output,
        t: t.clone().into(),
        z: (0..n).map(|k| y[k * EVERY * 3 + output] + sd * normal(random)).collect(),
    };
    let channels = vec![channel(0, 0.1), channel(1, 0.002), channel(2, 0.05)];
    let inputs = (0..n).flat_map(|k| [command(k * EVERY), 100.0]).collect();
    let interpolation = vec![Interpolation::Hold; 2];
    Record { dt, n, inputs, interpolation, channels, ..Record::default() }
}

#[test]
fn recovery_coverage_in_dryden_turbulence() {
    let draws = if std::env::var("KOEHLER_SLOW").as_deref() == Ok("1") { 200 } else { 20 };
    let driven = model("driven", &short_period("gust_dryden_w", ""));
    let (mut inside, mut sum, mut intensity) = (0, [0.0; 2], Vec::new());
    for draw in 0..draws {
        let mut random = rand_pcg::Pcg64::seed_from_u64(9000 + draw);
        let record = flown(&mut random, 0.8);
        let found =
            estimate(&driven, &[record], &Settings::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(found.stop, Stop::Converged, "draw {draw}");
        for (name, truth) in SHORT_PERIOD.into_iter().chain([("sigma_w", 0.8)]) {
            let (is, sd) = value(&found, name);
            let off = (is - truth) / sd;
            inside += usize::from(off.abs() < 1.96);
            sum = [sum[0] + off, sum[1] + off * off];
        }
        intensity.push(value(&found, "sigma_w").0);
    }
    let n = (draws * 6) as f64;
    let share = inside as f64 / n;
    let mean = intensity.iter().sum::<f64>() / draws as f64;
    println!(
        "{draws} draws in Dryden gusts: {:.1} %, mean {:.2}, r.m.s. {:.2} sd, intensity {mean:.3} of 0.8",
        100.0 * share,
        sum[0] / n,
        (sum[1] / n).sqrt()
    );
    let slack = if draws < 100 { 0.04 } else { 0.0 };
    assert!((0.93 - slack..=0.97 + slack).contains(&share), "{share}");
    assert!((mean - 0.8).abs() < 0.03, "{mean}");
}

#[test]
fn truth_gusts_of_the_fragments_have_the_variance_they_say() {
    for (fragment, gust, sigma) in [
        ("gust_dryden_u", "u_gust", "sigma_u"),
        ("gust_dryden_v", "v_gust", "sigma_v"),
        ("gust_dryden_w", "w_gust", "sigma_w"),
        ("gust_first_order_v", "v_gust", "sigma_v"),
        ("gust_first_order_w", "w_gust", "sigma_w"),
    ] {
        let text = format!(
            "title = \"gusts\"\nuse = [\"{fragment}\"]\n[inputs]\nV = \"m/s\"\n[outputs]\ny = {{ unit = \"m/s\", value = \"{gust}\" }}"
        );
        let plain = model("gusts", &text);
        let scored = [Scored { output: 0, start: 0.1, floor: 0.0 }];
        let wide =
            plain.with_covariance(&scored, &[], &Scope::Campaign).unwrap_or_else(|e| panic!("{e}"));
        let propagator = Propagator::new(&wide, Directions::default()).expect("a propagator");
        let mut parameters = wide.parameter_starts();
        parameters[wide.parameter(sigma).expect("an intensity")] = 1.7;
        let n = 4000;
        let record = Record { dt: 0.05, n, inputs: vec![60.0; n].into(), ..Record::default() };
        let end = propagator.run(&parameters, &[], &record, false).x_end;
        let p = wide.covariance.as_ref().expect("a covariance");
        // second order: sqrt(3) y1 + (1 - sqrt(3)) y2
        let gains = if p.motion == 2 { vec![3f64.sqrt(), 1.0 - 3f64.sqrt()] } else { vec![1.0] };
        let mut variance = 0.0;
        for (i, a) in gains.iter().enumerate() {
            for (j, b) in gains.iter().enumerate() {
                variance += a * b * end[p.place(i, j)];
            }
        }
        assert!((variance / (1.7 * 1.7) - 1.0).abs() < 1e-6, "{fragment}: {variance}");
    }
}
