//! Digits, a time unit and amplitudes in, the levels of a multistep out.

use super::keys;
use super::shape::{Mistake, Shape};
use crate::simulate::settings::Maneuver;

/// The digits of a multistep kind.
pub fn digits(kind: &str) -> Option<Vec<u32>> {
    match kind {
        "doublet" => Some(vec![1, 1]),
        "step" => Some(vec![1]),
        _ if kind.is_empty() => None,
        _ => kind.chars().map(|c| c.to_digit(10).filter(|d| *d > 0)).collect(),
    }
}

/// Steps of `digits` time units with alternating sign (Koehler and Wilhelm, DFVLR IB 154-77/40,
/// 1977).
pub fn shape(maneuver: &Maneuver, digits: &[u32], mistakes: &mut Vec<Mistake>) -> Option<Shape> {
    keys::only(maneuver, &["amplitude", "amplitudes", "unit_time_s", "edge_s"], mistakes);
    let sizes = sizes(maneuver, digits.len(), mistakes);
    let unit = keys::positive(maneuver.unit_time_s, "unit_time_s", "a multistep", mistakes)?;
    let shortest = unit * f64::from(*digits.iter().min()?);
    if !(0.0..=shortest).contains(&maneuver.edge_s) {
        mistakes.push((
            "edge_s",
            format!(
                "an edge must take from 0 s to one step, {shortest} s, not {}",
                maneuver.edge_s
            ),
        ));
    }
    let mut changes = Vec::new();
    let (mut time, mut level, mut sign) = (0u32, 0.0, f64::from(maneuver.polarity));
    for (digit, size) in digits.iter().zip(sizes?) {
        let next = sign * size;
        changes.push((f64::from(time) * unit, next - level));
        (time, level, sign) = (time + digit, next, -sign);
    }
    changes.push((f64::from(time) * unit, -level));
    Some(Shape::Steps { changes, edge: maneuver.edge_s })
}

/// The height of each of `count` steps.
fn sizes(maneuver: &Maneuver, count: usize, mistakes: &mut Vec<Mistake>) -> Option<Vec<f64>> {
    let Some(each) = &maneuver.amplitudes else {
        return keys::amplitude(maneuver, "a multistep", mistakes).map(|a| vec![a; count]);
    };
    if maneuver.amplitude.is_some() {
        mistakes.push((
            "amplitudes",
            "the maneuver has both `amplitude` and `amplitudes`; keep one of them".into(),
        ));
    }
    if each.len() != count {
        let what = format!(
            "\"{}\" has {count} steps: `amplitudes` must have as many values, not {}",
            maneuver.kind,
            each.len()
        );
        mistakes.push(("amplitudes", what));
        return None;
    }
    each.iter().map(|a| keys::size("amplitudes", *a, mistakes)).collect()
}
