//! States that start at a noisy sample: are the standard deviations honest?

use super::{normal, rng};
use crate::dynamics::{Channel, Record};
use crate::estimate::{Estimation, InitialFrom, Settings, estimate};
use crate::model::{Constants, Model};

const DECAY: &str = r#"
title = "A decay from where it was seen first"

[parameters]
c  = { unit = "1/s", start = 0.7 }
x0 = { unit = "m", start = 0.0 }

[states]
x = { unit = "m", rate = "-c*(x - x0)", start = "measured" }

[outputs]
x = { unit = "m", value = "x" }
"#;

/// Four decays, and what is made of them.
fn decays(seed: u64, settings: &Settings, same: bool) -> Estimation {
    let model = Model::parse("decay", DECAY, &Constants::default()).unwrap();
    let mut rng = rng(seed);
    let (n, dt) = (400, 0.02);
    let first = 0.02 * normal(&mut rng);
    let record = |k: usize| {
        let size = if same { 1.0 } else { [1.0, -0.8, 0.6, -1.2][k] };
        let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let mut z: Vec<f64> =
            t.iter().map(|t| 0.1 + size * (-0.5 * t).exp() + 0.02 * normal(&mut rng)).collect();
        if same {
            z[0] = 0.1 + size + first;
        }
        let channels = vec![Channel { output: 0, t: t.into(), z: z.into() }];
        Record { dt, n, inputs: Vec::new().into(), channels, ..Record::default() }
    };
    let records: Vec<Record> = (0..4).map(record).collect();
    estimate(&model, &records, settings).unwrap()
}

/// Errors over the standard deviations: their root mean square over 100 campaigns, of `c` and `x0`, and the
/// mean sd of `c`.
fn scatter(settings: &Settings, same: bool) -> (f64, f64) {
    let (mut squares, mut sd) = (0.0, 0.0);
    for seed in 0..100 {
        let e = decays(700 + seed, settings, same);
        for (row, truth) in e.rows.iter().filter(|r| r.segment.is_none()).zip([0.5, 0.1]) {
            squares += ((row.value - truth) / row.sd.unwrap()).powi(2) / 200.0;
        }
        sd += e.rows[0].sd.unwrap() / 100.0;
    }
    (squares.sqrt(), sd)
}

#[test]
fn truth_noise_of_the_samples_that_states_start_at_is_in_the_sd() {
    let own = Settings::default();
    let (z, sd) = scatter(&own, false);
    assert!((0.85..1.15).contains(&z), "{z}");
    // One sample for all of them: one error.
    let (of_one, sd_of_one) =
        scatter(&Settings { initial_from: InitialFrom::First, ..own.clone() }, true);
    assert!((0.8..1.2).contains(&of_one), "{of_one}");
    assert!(sd_of_one > 1.5 * sd, "{sd_of_one} {sd}");
    let e = decays(700, &own, false);
    let noisy = e.noisy_starts.as_ref().expect("told");
    assert_eq!(noisy.states, ["x"]);
    let of_c = noisy.larger.iter().find(|(name, _)| name == "c").expect("larger").1;
    assert!(of_c > 2.0, "{noisy:?}");
    assert!((e.rows[0].sd.unwrap() / e.rows[0].sd_crlb.unwrap() / of_c - 1.0).abs() < 0.2);
    // Starts that are estimated have nothing of it, and tell more.
    let free = decays(700, &Settings { initial: vec!["x".into()], ..own }, false);
    assert!(free.noisy_starts.is_none() && free.rows[0].sd < e.rows[0].sd, "{free:?}");
}
