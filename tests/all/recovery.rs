//! 500 simulated campaigns of three short-period maneuvers each: do the 95% intervals hold the
//! truth 95 times in 100?

use koehler::dynamics::{Channel, Directions, Propagator, Record};
use koehler::estimate::{Settings, Stop, estimate};
use koehler::model::{Constants, Model};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

const MODEL: &str = r#"
title  = "Short period"
source = "any textbook"

[inputs]
de = { unit = "rad", doc = "elevator" }

[parameters]
Za = { unit = "1/s", start = -0.6 }
Zd = { unit = "1/s", start = -0.05 }
Ma = { unit = "1/s^2", start = -4.0 }
Mq = { unit = "1/s", start = -1.4 }
Md = { unit = "1/s^2", start = -6.0 }
dz = { unit = "rad/s", start = 0.0, per = "segment", doc = "zero shift of the rate gyro" }

[states]
alpha = { unit = "rad", rate = "Za*alpha + q + Zd*de", start = 0.0 }
q     = { unit = "rad/s", rate = "Ma*alpha + Mq*q + Md*de", start = 0.0 }

[outputs]
alpha = { unit = "rad", value = "alpha" }
q     = { unit = "rad/s", value = "q + dz" }
"#;

const TRUTH: [(&str, f64); 8] = [
    ("Za", -0.8),
    ("Zd", -0.1),
    ("Ma", -5.0),
    ("Mq", -2.0),
    ("Md", -7.2),
    ("dz", 0.002),
    ("alpha(0)", 0.01),
    ("q(0)", -0.004),
];
/// Standard deviations of the measurements: rad, rad/s.
const SD: [f64; 2] = [0.003, 0.004];
const CAMPAIGNS: u64 = 500;
const MANEUVERS: usize = 3;
const N: usize = 150;
const DT: f64 = 0.05;

/// A 3211 with a time unit of 0.5 s, 0.05 rad.
fn elevator(k: usize) -> f64 {
    let sign = [0.0, 0.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0];
    0.05 * sign.get(k / 10).copied().unwrap_or(0.0)
}

fn record(z: &[Vec<f64>]) -> Record {
    let t: Vec<f64> = (0..N).map(|k| k as f64 * DT).collect();
    let channels = z
        .iter()
        .enumerate()
        .map(|(output, z)| Channel { output, t: t.clone().into(), z: z.clone().into() })
        .collect();
    Record {
        dt: DT,
        n: N,
        inputs: (0..N).map(elevator).collect(),
        channels,
        substeps: 1,
        ..Default::default()
    }
}

/// The undisturbed outputs of one maneuver.
fn truth(model: &Model) -> Vec<Vec<f64>> {
    let starts = vec![model.state("alpha").expect("alpha"), model.state("q").expect("q")];
    let propagator = Propagator::new(model, Directions { parameters: Vec::new(), starts })
        .expect("a propagator");
    let value = |name: &str| TRUTH.iter().find(|t| t.0 == name).expect("a true value").1;
    let parameters: Vec<f64> = model.parameters.iter().map(|p| value(&p.quantity.name)).collect();
    let given: Vec<f64> = propagator
        .given()
        .iter()
        .map(|&i| value(&format!("{}(0)", model.states[i].quantity.name)))
        .collect();
    let grid = propagator.run(&parameters, &given, &record(&[]), false);
    (0..2).map(|j| (0..N).map(|k| grid.y[2 * k + j]).collect()).collect()
}

/// Noise of correlation `rho` from sample to sample.
fn measured(y: &[Vec<f64>], rho: f64, rng: &mut rand_pcg::Pcg64) -> Vec<Vec<f64>> {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let mut noisy = |y: &Vec<f64>, sd: f64| {
        let mut v = sd * normal();
        let mut next = || {
            let now = v;
            v = rho * v + sd * (1.0 - rho * rho).sqrt() * normal();
            now
        };
        y.iter().map(|y| y + next()).collect()
    };
    y.iter().zip(SD).map(|(y, sd)| noisy(y, sd)).collect()
}

/// Per parameter: share of campaigns' intervals that hold the truth, by `sd` and by `sd_crlb`.
/// Values of single maneuvers count together.
fn coverage(rho: f64) -> Vec<[f64; 2]> {
    let model = Model::parse("short-period", MODEL, &Constants::default()).expect("the model");
    let y = truth(&model);
    let settings = Settings { initial: vec!["alpha".into(), "q".into()], ..Settings::default() };
    let one = |seed: u64| -> Vec<[f64; 3]> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        let records: Vec<Record> =
            (0..MANEUVERS).map(|_| record(&measured(&y, rho, &mut rng))).collect();
        let e = estimate(&model, &records, &settings).expect("an estimation");
        assert_eq!(e.stop, Stop::Converged, "campaign {seed}");
        TRUTH
            .iter()
            .map(|(name, truth)| {
                let mut sum = [0.0; 3];
                for row in e.rows.iter().filter(|r| r.name == *name) {
                    let inside = |sd: Option<f64>| {
                        f64::from(u8::from(
                            (row.value - truth).abs() <= 1.959964 * sd.expect("an sd"),
                        ))
                    };
                    sum = [sum[0] + inside(row.sd), sum[1] + inside(row.sd_crlb), sum[2] + 1.0];
                }
                sum
            })
            .collect()
    };
    let all: Vec<Vec<[f64; 3]>> = (0..CAMPAIGNS).into_par_iter().map(one).collect();
    let total = |i: usize, k: usize| all.iter().map(|c| c[i][k]).sum::<f64>();
    (0..TRUTH.len()).map(|i| [0, 1].map(|k| total(i, k) / total(i, 2))).collect()
}

/// Prints both, and hands back the pooled share of `sd` and of `sd_crlb`.
fn report(what: &str, each: &[[f64; 2]]) -> [f64; 2] {
    println!(
        "{what}, {CAMPAIGNS} campaigns: share of 95% intervals that hold the truth\n  parameter      by sd  by sd_crlb"
    );
    for ((name, _), share) in TRUTH.iter().zip(each) {
        println!("  {name:12} {:6.1}%  {:8.1}%", 100.0 * share[0], 100.0 * share[1]);
    }
    let pooled = [0, 1].map(|k| each.iter().map(|e| e[k]).sum::<f64>() / each.len() as f64);
    println!("  {:12} {:6.1}%  {:8.1}%", "pooled", 100.0 * pooled[0], 100.0 * pooled[1]);
    pooled
}

#[test]
fn recovery_intervals_cover_under_white_noise() {
    let each = coverage(0.0);
    let pooled = report("white noise", &each);
    assert!((0.93..=0.97).contains(&pooled[0]), "{pooled:?}");
    assert!(each.iter().all(|share| (0.91..=0.98).contains(&share[0])), "{each:?}");
}

#[test]
fn recovery_intervals_cover_under_coloured_noise() {
    let each = coverage(0.9);
    let pooled = report("noise of correlation 0.9 between samples", &each);
    assert!((0.93..=0.97).contains(&pooled[0]), "{pooled:?}");
    // what plain Cramer-Rao bounds would claim
    assert!(pooled[1] < 0.6, "{pooled:?}");
}
