//! Noise of the inputs: is what it moves told, by how much, and what it alone determines?

use super::{normal, rng};
use crate::dynamics::{Channel, Record};
use crate::estimate::{Estimation, Settings, estimate};
use crate::model::{Constants, Model};

const GAIN: &str = r#"
title = "A gain, and a tab that stands still"

[inputs]
u   = "rad"
tab = "rad"

[parameters]
k  = { unit = "-", start = 0.5 }
c  = { unit = "-", start = 0.1 }
y0 = { unit = "rad", start = 0.0 }

[outputs]
y = { unit = "rad", value = "k*u + c*tab + y0" }
"#;

/// What comes of inputs with so much noise.
fn with_noise(seed: u64, [of_u, of_tab]: [f64; 2]) -> Estimation {
    // A tab that stands still is no other thing than y0.
    let without = GAIN.replace("c  = { unit = \"-\", start = 0.1 }\n", "").replace("c*tab + ", "");
    let text = if of_tab > 0.0 { GAIN } else { &without };
    let model = Model::parse("gain", text, &Constants::default()).unwrap();
    let mut rng = rng(seed);
    let (n, dt) = (1000, 0.02);
    let (mut inputs, mut z) = (Vec::new(), Vec::new());
    for k in 0..n {
        let u = (3.0 * k as f64 * dt).sin();
        z.push(u + 0.5 * 0.02 + 0.01 * normal(&mut rng));
        inputs.extend([u + of_u * normal(&mut rng), 0.02 + of_tab * normal(&mut rng)]);
    }
    let t = (0..n).map(|k| k as f64 * dt).collect();
    let channels = vec![Channel { output: 0, t, z: z.into() }];
    let record = Record { dt, n, inputs: inputs.into(), channels, ..Record::default() };
    estimate(&model, &[record], &Settings::default()).unwrap()
}

/// Attenuation of a gain: `k (1 - v^2/(var u + v^2))`.
#[test]
fn truth_what_noise_of_an_input_moves_is_told() {
    let (mut moved, mut off) = (0.0, 0.0);
    for seed in 0..20 {
        let e = with_noise(40 + seed, [0.1, 0.0]);
        let row = &e.rows[0];
        let noisy = e.noisy_inputs.as_ref().expect("noise");
        let (_, by) = noisy.moved.iter().find(|(name, _)| name == "k").expect("a shift");
        moved += by * row.sd.unwrap() / 20.0;
        off += (1.0 - row.value) / 20.0;
        assert!((noisy.inputs[0].1 - 0.1).abs() < 0.01, "{noisy:?}");
        assert!(noisy.alone.is_empty(), "{noisy:?}");
    }
    let truth = 0.01 / (0.5 + 0.01);
    assert!((off / truth - 1.0).abs() < 0.2, "{off} {truth}");
    assert!((moved / truth - 1.0).abs() < 0.2, "{moved} {truth}");
}

#[test]
fn what_noise_alone_determines_is_told() {
    for seed in 0..10 {
        let e = with_noise(80 + seed, [0.0, 1e-3]);
        let alone = e.noisy_inputs.as_ref().map(|noisy| noisy.alone.clone());
        // What the tab does not tell apart from y0 is told by its noise, of both.
        assert_eq!(alone, Some(vec!["c".to_string(), "y0".to_string()]));
    }
    // Small noise of an input that moves is nothing to speak of.
    assert_eq!(with_noise(99, [1e-4, 0.0]).noisy_inputs, None);
}
