//! Flown records of the HFB-320 and the ATTAS: the steps listed by hand are found.

use super::super::{Kind, Maneuver, Settings};
use super::data::{mat_columns, text_columns};
use super::find;

const DEG: f64 = std::f64::consts::PI / 180.0;

/// Listed (from, to, level): times at which the signal is clearly on its level, so each edge lies
/// between two listed times.
fn has_steps(m: &Maneuver, listed: &[(f64, f64, f64)], tolerance: f64, level_tolerance: f64) {
    assert_eq!(m.steps.len(), listed.len(), "{m:?}");
    for (s, (from, to, level)) in m.steps.iter().zip(listed) {
        assert!(
            (s.start - from).abs() < tolerance && (s.end - to).abs() < tolerance,
            "{s:?}, listed {from} to {to}"
        );
        assert!((s.level - level).abs() < level_tolerance, "{s:?}, listed {level}");
    }
}

#[test]
fn hfb320_elevator() {
    let Some((t, u)) = text_columns("hfb320/hfb320_1_10.asc", (0, 1)) else { return };
    let found = find(&t, &u, &Settings::default());
    found.iter().for_each(|m| println!("{m:?}"));
    assert_eq!(found.iter().map(|m| m.kind).collect::<Vec<_>>(), [Kind::K3211, Kind::Step]);
    let listed = [(4.6, 7.5, 0.68), (7.8, 9.6, -0.74), (9.9, 10.7, 0.62), (11.0, 11.7, -0.63)]
        .map(|(a, b, l)| (a, b, l * DEG));
    has_steps(&found[0], &listed, 0.3, 0.12 * DEG);
    assert!((found[0].unit_time - 1.0).abs() < 0.1 && found[0].polarity == 1.0);
    has_steps(&found[1], &[(25.5, 41.2, 0.71 * DEG)], 0.3, 0.12 * DEG);
}

/// One column of an ATTAS record, or the difference of two halved.
fn attas(file: &str, plus: usize, minus: Option<usize>) -> Option<(Vec<f64>, Vec<f64>)> {
    let c = mat_columns(&format!("attas/{file}.mat"))?;
    let u = match minus {
        None => c[plus - 1].clone(),
        Some(minus) => c[plus - 1].iter().zip(&c[minus - 1]).map(|(a, b)| 0.5 * (a - b)).collect(),
    };
    Some((c[0].iter().map(|t| t - c[0][0]).collect(), u))
}

fn attas_finds(
    file: &str,
    plus: usize,
    minus: Option<usize>,
    kinds: &[Kind],
    listed: &[(f64, f64, f64)],
    level_tolerance: f64,
) {
    let Some((t, u)) = attas(file, plus, minus) else { return };
    let found = find(&t, &u, &Settings::default());
    for m in &found {
        let steps: Vec<String> = m
            .steps
            .iter()
            .map(|s| format!("{:.2}..{:.2} {:+.2}", s.start, s.end, s.level))
            .collect();
        println!("{file}: {} unit {:.2} s score {:.2}: {steps:?}", m.kind, m.unit_time, m.score);
    }
    assert!(kinds.contains(&found[0].kind), "{:?}", found[0].kind);
    // What follows the maneuver can only be the pilot's recovery, which is a step at most.
    assert!(found[1..].iter().all(|m| m.kind == Kind::Step), "{found:?}");
    has_steps(&found[0], listed, 0.2, level_tolerance);
}

#[test]
fn attas_elevator_1() {
    let listed = [(5.64, 7.64, -2.8), (7.76, 9.80, 2.2), (9.96, 10.92, -2.6), (11.04, 12.04, 2.7)];
    attas_finds("fAttasElv1", 22, None, &[Kind::K2211], &listed, 0.6);
}

#[test]
fn attas_elevator_2() {
    // 2.56, 2.05, 1.16, 0.83 s: nearly as near to 2-2-1-1 as to 3-2-1-1
    let listed =
        [(6.16, 8.60, 2.6), (8.72, 10.64, -3.6), (10.76, 11.80, 2.1), (11.92, 12.64, -3.8)];
    attas_finds("fAttasElv2", 22, None, &[Kind::K3211, Kind::K2211], &listed, 0.6);
}

#[test]
fn attas_aileron() {
    let listed = [(5.60, 6.96, 12.7), (7.00, 9.32, -14.0), (9.36, 10.44, 12.6)];
    attas_finds("fAttasAil1", 29, Some(28), &[Kind::Multistep], &listed, 2.5);
}

#[test]
fn attas_rudder() {
    let listed = [(6.00, 7.12, -4.8), (7.36, 8.64, 3.8)];
    attas_finds("fAttasRud1", 30, None, &[Kind::Doublet], &listed, 1.2);
}
