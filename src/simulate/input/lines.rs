//! Times and values of a profile, or size and period of a sweep, in; straight lines out.

use super::keys;
use super::shape::{Mistake, Shape};
use crate::simulate::settings::Maneuver;

/// Most cycles of a sweep; more is a mistake in a number.
const MOST_CYCLES: u32 = 1000;

/// Straight lines between the points of `times_s` and `values`; polarity -1 turns them over.
pub fn profile(maneuver: &Maneuver, mistakes: &mut Vec<Mistake>) -> Option<Shape> {
    keys::only(maneuver, &["times_s", "values"], mistakes);
    let times = list(maneuver.times_s.as_ref(), "times_s", mistakes);
    let values = list(maneuver.values.as_ref(), "values", mistakes);
    let (times, values) = (times?, values?);
    ascend(times, mistakes);
    if values.len() != times.len() {
        let what = format!(
            "`values` must have one value for each of the {} times, not {}",
            times.len(),
            values.len()
        );
        mistakes.push(("values", what));
    } else if values.iter().all(|v| *v == 0.0) {
        mistakes.push(("values", "the profile never leaves 0".into()));
    }
    let sign = f64::from(maneuver.polarity);
    Some(Shape::Lines { t: times.clone(), value: values.iter().map(|v| sign * v).collect() })
}

/// The numbers of a key that must be there.
fn list<'m>(
    given: Option<&'m Vec<f64>>,
    key: &'static str,
    mistakes: &mut Vec<Mistake>,
) -> Option<&'m Vec<f64>> {
    match given {
        None => mistakes.push((key, format!("a profile needs `{key}`"))),
        Some(list) => match list.iter().find(|x| !x.is_finite()) {
            None => return Some(list),
            Some(x) => mistakes.push((key, format!("`{key}` must be numbers, not {x}"))),
        },
    }
    None
}

/// Times begin at 0 and ascend.
fn ascend(times: &[f64], mistakes: &mut Vec<Mistake>) {
    if times.len() < 2 {
        let what = format!("a profile needs two points or more, not {}", times.len());
        mistakes.push(("times_s", what));
    }
    if let Some(first) = times.first().filter(|t| **t != 0.0) {
        let what = format!(
            "the times count from the first point: they must begin at 0 s, not at {first} s"
        );
        mistakes.push(("times_s", what));
    }
    if let Some(w) = times.windows(2).find(|w| w[1] <= w[0]) {
        let what = format!("the times must ascend: {} s follows {} s", w[1], w[0]);
        mistakes.push(("times_s", what));
    }
}

/// A slow triangle: straight lines of one rate from 0 to the amplitude, to the other side, and back
/// to 0, so many times.
pub fn sweep(maneuver: &Maneuver, mistakes: &mut Vec<Mistake>) -> Option<Shape> {
    keys::only(maneuver, &["amplitude", "period_s", "cycles"], mistakes);
    let amplitude = keys::amplitude(maneuver, "a sweep", mistakes);
    let period = keys::positive(maneuver.period_s, "period_s", "a sweep", mistakes);
    let cycles = maneuver.cycles.unwrap_or(1);
    if !(1..=MOST_CYCLES).contains(&cycles) {
        let what = format!("a sweep has 1 to {MOST_CYCLES} cycles, not {cycles}");
        mistakes.push(("cycles", what));
        return None;
    }
    let (amplitude, period) = (amplitude?, period?);
    let (mut t, mut value) = (vec![0.0], vec![0.0]);
    let mut side = f64::from(maneuver.polarity) * amplitude;
    for turn in 0..2 * cycles {
        t.push((0.25 + 0.5 * f64::from(turn)) * period);
        value.push(side);
        side = -side;
    }
    t.push(f64::from(cycles) * period);
    value.push(0.0);
    Some(Shape::Lines { t, value })
}
