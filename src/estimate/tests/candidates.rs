//! Sensor errors that may be left out: are those held that are not there, and those estimated that
//! are, with what is said of each?

use super::{normal, rng};
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{Estimation, Settings, Stop, Support, estimate};
use crate::model::{Constants, Model};

/// `k` scales what a sensor shows of `x`, `b` and `b2` are the same bias under two names, `c` bends
/// its scale.
const LAG: &str = r#"
title = "Lag and its sensor"
[inputs]
u = "-"
[parameters]
T  = { unit = "s", start = 0.5, min = 0.05 }
k  = { unit = "-", start = 1.0, fixed = true }
b  = { unit = "-", start = 0.0, fixed = true }
b2 = { unit = "-", start = 0.0, fixed = true }
c  = { unit = "-", start = 0.0, fixed = true }
[states]
x = { unit = "-", rate = "(u - x)/T", start = 0.0 }
[outputs]
y = { unit = "-", value = "k*x + b + b2 + c*x^2" }
"#;

/// Estimates with the given candidates from a record with these true values, noise 0.05.
fn lag(seed: u64, truth: [f64; 5], candidates: &[&str]) -> Estimation {
    let model = Model::parse("lag", LAG, &Constants::default()).unwrap();
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let n = 400;
    let inputs: Vec<f64> = (0..n).map(|k| [0.0, 1.0, -1.0, 2.0][k / 50 % 4]).collect();
    let channel =
        Channel { output: 0, t: (0..n).map(|k| k as f64 * 0.02).collect(), z: vec![0.0; n].into() };
    let mut record =
        Record { dt: 0.02, n, inputs: inputs.into(), channels: vec![channel], ..Record::default() };
    let run = propagator.run(&truth, &[], &record, false);
    let mut rng = rng(seed);
    record.channels[0].z = run.y.iter().map(|y| y + 0.05 * normal(&mut rng)).collect();
    let settings = Settings {
        candidates: candidates.iter().map(ToString::to_string).collect(),
        ..Settings::default()
    };
    estimate(&model, &[record], &settings).unwrap()
}

fn support(e: &Estimation, name: &str) -> Support {
    e.decisions
        .iter()
        .find(|d| d.parameter == name)
        .unwrap_or_else(|| panic!("no decision on {name}: {:?}", e.decisions))
        .support
}

#[test]
fn recovery_a_bias_that_is_there_is_estimated_and_a_bend_that_is_not_is_held() {
    let e = lag(1, [0.3, 1.0, 0.1, 0.0, 0.0], &["b", "c"]);
    assert_eq!(e.stop, Stop::Converged);
    assert_eq!(
        (support(&e, "b"), support(&e, "c")),
        (Support::Significant, Support::NotSignificant)
    );
    assert_eq!(e.rows.iter().map(|r| r.name.as_str()).collect::<Vec<_>>(), ["T", "b"]);
    let b = &e.rows[1];
    assert!((b.value - 0.1).abs() < 3.0 * b.sd.unwrap(), "{b:?}");
}

#[test]
fn recovery_what_is_not_there_is_called_significant_once_in_twenty() {
    let wrong = (0..100).filter(|seed| {
        support(&lag(100 + seed, [0.3, 1.0, 0.0, 0.0, 0.0], &["c"]), "c") == Support::Significant
    });
    let wrong = wrong.count();
    // 4.55% of 100, and three standard deviations of a binomial count
    assert!(wrong <= 10, "{wrong} of 100");
}

#[test]
fn fault_of_two_that_are_the_same_to_the_data_the_last_named_is_held_as_not_observable() {
    let e = lag(2, [0.3, 1.2, 0.05, 0.05, 0.0], &["b", "b2", "k"]);
    assert_eq!(e.stop, Stop::Converged);
    assert_eq!(
        (support(&e, "b2"), support(&e, "b"), support(&e, "k")),
        (Support::NotObservable, Support::Significant, Support::Significant)
    );
    let b = e.rows.iter().find(|r| r.name == "b").unwrap();
    assert!((b.value - 0.1).abs() < 3.0 * b.sd.unwrap(), "{b:?}");
}

#[test]
fn fault_a_candidate_that_the_model_does_not_have_is_named() {
    let model = Model::parse("lag", LAG, &Constants::default()).unwrap();
    let settings = Settings { candidates: vec!["k_x".into()], ..Settings::default() };
    let error = estimate(&model, &[], &settings).unwrap_err().to_string();
    assert!(error.contains("candidates") && error.contains("k_x"), "{error}");
}
