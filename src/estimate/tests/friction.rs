//! Friction as a parameter: found again from any size, with an honest interval, and said where it
//! holds everything.

use super::{normal, rng};
use crate::dynamics::{Channel, Directions, Interpolation, Propagator, Record};
use crate::estimate::{Estimation, Settings, Stop, estimate};
use crate::model::{Constants, Model};
use rayon::prelude::*;

const SURFACE: &str = r#"
title = "A surface on a spring, with friction"

[inputs]
M = "N m"

[constants]
J = { unit = "kg m^2", value = 0.5 }

[parameters]
k   = { unit = "N m/rad", start = 150.0 }
c   = { unit = "N m s", start = 4.0 }
F_c = { unit = "N m", start = 0.5, min = 0.0 }

[states]
delta     = { unit = "rad", rate = "delta_dot", start = 0.0 }
delta_dot = { unit = "rad/s", rate = "(M - k*delta - c*delta_dot)/J", start = 0.0, friction = "F_c/J" }

[outputs]
delta = { unit = "rad", value = "delta" }
"#;

const TRUTH: [f64; 3] = [200.0, 3.0, 2.0];
const SD: f64 = 2e-4;

fn model() -> Model {
    Model::parse("surface", SURFACE, &Constants::default()).unwrap()
}

/// A 3211 of the moment, which is held between samples, flown with the true friction times `more`.
fn flown(model: &Model, seed: u64, size: f64, more: f64) -> Record {
    let (n, dt) = (1000, 0.01);
    let edges = [(1.0, 1.0), (4.0, -1.0), (6.0, 1.0), (7.0, -1.0), (8.0, 0.0)];
    let moment = |t: f64| edges.iter().rfind(|(from, _)| *from <= t).map_or(0.0, |e| size * e.1);
    let mut record = Record {
        dt,
        n,
        inputs: (0..n).map(|k| moment(k as f64 * dt + 1e-9)).collect(),
        interpolation: vec![Interpolation::Hold],
        ..Record::default()
    };
    let propagator = Propagator::new(model, Directions::default()).unwrap();
    let y = propagator.run(&[TRUTH[0], TRUTH[1], more * TRUTH[2]], &[], &record, false).y;
    let mut rng = rng(seed);
    let z = y.iter().map(|y| y + SD * normal(&mut rng)).collect();
    record.channels = vec![Channel { output: 0, t: (0..n).map(|k| k as f64 * dt).collect(), z }];
    record
}

fn started(record: &Record, friction: f64, profile: &[&str]) -> Estimation {
    let settings = Settings {
        starts: [("F_c".to_string(), friction)].into(),
        profile: profile.iter().map(ToString::to_string).collect(),
        ..Settings::default()
    };
    estimate(&model(), std::slice::from_ref(record), &settings).unwrap()
}

/// The cost has creases and further minima where a stop of the surface comes or goes, and a search
/// from a spring and a damper as far off as here may end there. The best of several starts is the
/// truth.
#[test]
fn recovery_of_friction_from_several_sizes() {
    let record = flown(&model(), 1, 20.0, 1.0);
    let settings = Settings {
        tries: [("F_c".to_string(), vec![0.0, 0.25, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0])].into(),
        profile: vec!["F_c".to_string()],
        ..Settings::default()
    };
    let e = estimate(&model(), std::slice::from_ref(&record), &settings).unwrap();
    e.tried.iter().for_each(|t| println!("{t:?}"));
    assert_eq!((e.stop, e.tried.len(), e.profiles.len()), (Stop::Converged, 9, 1));
    for (row, truth) in e.rows.iter().zip(TRUTH) {
        let sd = row.sd.unwrap();
        assert!((row.value - truth).abs() < 4.0 * sd && sd < 0.01 * truth, "{}", row.name);
    }
    let there: Vec<_> = e.tried.iter().filter(|t| t.there).collect();
    assert!(3 * there.len() >= e.tried.len(), "{} of {}", there.len(), e.tried.len());
    // Those that end elsewhere are worse by far: the data tell which.
    assert!(e.tried.iter().all(|t| t.there || !t.rivals(there[0].cost)));
}

/// A column on a spring, let go four times.
const COLUMN: &str = r#"
title = "A column on a spring, let go"

[inputs]
M = "N m"

[constants]
J = { unit = "kg m^2", value = 2.0 }

[parameters]
k   = { unit = "N m/rad", start = 90.0 }
c   = { unit = "N m s", start = 5.0, min = 0.0 }
F_c = { unit = "N m", start = 4.0, min = 0.0 }

[states]
delta     = { unit = "rad", rate = "delta_dot", start = "measured" }
delta_dot = { unit = "rad/s", rate = "(M - k*delta - c*delta_dot)/J", start = 0.0, friction = "F_c/J" }

[outputs]
delta = { unit = "rad", value = "delta" }
"#;

/// Decays of a column with 8 N m of friction, each from another place, and what a fit from half as much
/// says of it.
fn let_go(seed: u64) -> Estimation {
    let model = Model::parse("column", COLUMN, &Constants::default()).unwrap();
    let mut rng = rng(seed);
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let records: Vec<Record> = (0..3)
        .map(|m| {
            let (n, dt) = (300, 0.02);
            let from = (0.55 + 0.2 * normal(&mut rng).clamp(-1.0, 1.0)) * [1.0, -1.0][m % 2];
            let mut record = Record { dt, n, inputs: vec![0.0; n].into(), ..Record::default() };
            let flown = Record { substeps: 16, ..record.clone() };
            let y = propagator.run(&[120.0, 2.5, 8.0], &[from], &flown, false).y;
            // Where it is let go from is known: a model that starts "measured" takes that sample.
            let mut z: Vec<f64> = y.iter().map(|y| y + 2e-3 * normal(&mut rng)).collect();
            z[0] = y[0];
            record.channels = vec![Channel {
                output: 0,
                t: (0..n).map(|k| k as f64 * dt).collect(),
                z: z.into(),
            }];
            record
        })
        .collect();
    estimate(&model, &records, &Settings::default()).unwrap()
}

#[test]
fn recovery_of_friction_from_decays_and_poor_starts() {
    let found: Vec<Estimation> = (0..8).into_par_iter().map(|seed| let_go(900 + seed)).collect();
    let right = |e: &&Estimation| (e.rows[2].value - 8.0).abs() < 4.0 * e.rows[2].sd.unwrap();
    for e in &found {
        let rows = e.rows.iter().map(|r| {
            let sd = r.sd.unwrap_or(f64::NAN);
            format!("{} {:.4} +- {:.4}", r.name, r.value, sd)
        });
        println!("{:?} {:?} {:?}", e.stop, rows.collect::<Vec<_>>(), e.elsewhere.is_some());
    }
    assert!(found.iter().filter(right).count() >= 7);
}

#[test]
fn recovery_coverage_of_friction_and_its_profile() {
    let trials = 200;
    let hits: Vec<[bool; 4]> = (0..trials)
        .into_par_iter()
        .map(|seed| {
            let e = started(&flown(&model(), 100 + seed, 20.0, 1.0), 1.0, &["F_c"]);
            assert_eq!(e.stop, Stop::Converged, "{seed}");
            let within = |i: usize| {
                let row = &e.rows[i];
                (row.value - TRUTH[i]).abs() <= 1.96 * row.sd.unwrap()
            };
            let (row, truth) = (&e.rows[2], TRUTH[2]);
            let profile =
                row.lower.is_none_or(|l| l <= truth) && row.upper.is_none_or(|u| u >= truth);
            [within(0), within(1), within(2), profile]
        })
        .collect();
    let share = |i: usize| hits.iter().filter(|h| h[i]).count() as f64 / trials as f64;
    let pooled = (share(0) + share(1) + share(2)) / 3.0;
    println!(
        "k {:.3}, c {:.3}, F_c {:.3}, its profile {:.3}",
        share(0),
        share(1),
        share(2),
        share(3)
    );
    assert!((0.93..=0.97).contains(&pooled), "{pooled}");
    assert!((0.91..=0.98).contains(&share(3)), "{}", share(3));
}

#[test]
fn fault_a_level_that_holds_everything_is_said() {
    let record = flown(&model(), 3, 20.0, 20.0);
    let e = started(&record, 40.0, &[]);
    assert!(e.stop != Stop::Converged);
    assert_eq!(e.stuck, [(0, "delta_dot".to_string())]);
}

#[test]
fn fault_negative_friction_is_said() {
    let text = SURFACE.replace("friction = \"F_c/J\"", "friction = \"-F_c/J\"");
    let negative = Model::parse("surface", &text, &Constants::default()).unwrap();
    let e = estimate(&negative, &[flown(&model(), 4, 20.0, 1.0)], &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::NotFinite);
    let why = "the friction of \"delta_dot\" is negative at the start values";
    assert_eq!(e.why.as_deref(), Some(why));
}
