//! Outputs that a gust moves all at once: is it told by how much standard deviations are too small?

use super::{normal, rng};
use crate::dynamics::{Channel, Record};
use crate::estimate::{Estimation, Settings, estimate};
use crate::model::{Constants, Model};

const GAIN: &str = r#"
title = "A gain, measured three times"

[inputs]
u = "rad"

[parameters]
k = { unit = "-", start = 0.5 }
c = { unit = "rad", start = 0.0 }

[outputs]
y1 = { unit = "rad", value = "k*u + c" }
y2 = { unit = "rad", value = "k*u + c" }
y3 = { unit = "rad", value = "k*u + c" }
"#;

/// Eight records of 40 s; what moves the outputs lasts half a second, and is one for all or one for each.
fn measured(seed: u64, is_one: bool) -> Estimation {
    let model = Model::parse("gain", GAIN, &Constants::default()).unwrap();
    let mut rng = rng(seed);
    let (n, dt) = (2000, 0.02);
    let stays = (-dt / 0.5f64).exp();
    let record = |_: usize| {
        let (mut inputs, mut z) = (Vec::new(), [const { Vec::new() }; 3]);
        let mut gust = [0.0f64; 3];
        for k in 0..n {
            let t = k as f64 * dt;
            let u = (0.9 * t).sin() + (2.3 * t + 1.0).sin();
            let one = normal(&mut rng);
            for (gust, z) in gust.iter_mut().zip(&mut z) {
                let new = if is_one { one } else { normal(&mut rng) };
                *gust = stays * *gust + (1.0 - stays * stays).sqrt() * 0.1 * new;
                z.push(u + *gust + 0.005 * normal(&mut rng));
            }
            inputs.push(u);
        }
        let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let all = z.into_iter().enumerate();
        let channels =
            all.map(|(output, z)| Channel { output, t: t.clone().into(), z: z.into() }).collect();
        Record { dt, n, inputs: inputs.into(), channels, ..Record::default() }
    };
    let records: Vec<Record> = (0..8).map(record).collect();
    estimate(&model, &records, &Settings::default()).unwrap()
}

/// Three that say the same tell no more than one: `sd` is too small by the root of three.
#[test]
fn recovery_outputs_that_one_gust_moves_make_sd_larger() {
    let all: Vec<Estimation> = (0..16).map(|seed| measured(100 + seed, true)).collect();
    let mut told = 0.0;
    for e in &all {
        let (_, by) = e.together.iter().find(|(name, _)| name == "k").expect("it is told");
        told += by / 16.0;
    }
    assert!((told / 3f64.sqrt() - 1.0).abs() < 0.15, "{told}");
    // The scatter of 16 is known to 18%.
    let square = |e: &Estimation| (e.rows[0].value - 1.0).powi(2);
    let scatter = (all.iter().map(square).sum::<f64>() / 16.0).sqrt();
    let sd = all.iter().map(|e| e.rows[0].sd.unwrap()).sum::<f64>() / 16.0;
    assert!((scatter / (told * sd) - 1.0).abs() < 0.5, "{scatter} {sd} {told}");
}

#[test]
fn outputs_with_gusts_of_their_own_do_not_go_together() {
    for seed in 0..30 {
        let e = measured(300 + seed, false);
        assert!(e.together.is_empty(), "{seed}: {:?}", e.together);
    }
}
