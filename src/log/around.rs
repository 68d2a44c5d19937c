//! The samples of an angle in; the same beyond a turn where it was logged within one, and what is said
//! of that, out.

use super::Note;
use super::channel_map::SignalMap;
use crate::math::digits;
use crate::signal::round;
use crate::units::Unit;

/// Within a turn, with this room: readings end beside it.
const ROOM: f64 = 1.02;
/// Of a thousand samples one at either end may be an error and says nothing of the others.
const ERRORS: usize = 1000;
/// So many long steps are gaps, or errors.
const FEW: u64 = 3;

/// A whole turn of an angle, in SI.
pub(super) fn turn(signal: &SignalMap) -> Option<f64> {
    let is_angle = ["deg", "degree", "degrees", "°", "rad", "radian", "radians"]
        .contains(&signal.unit.as_str());
    is_angle.then_some(2.0 * std::f64::consts::PI * signal.scale.abs())
}

/// Lets an angle go on beyond a turn. One whose values lie in more than a turn was not logged within
/// one: its numbers stay, and long steps show that they may be no angle in this unit.
pub(super) fn around(name: &str, signal: &SignalMap, samples: &mut [(i64, f64)]) -> Option<Note> {
    let turn = turn(signal)?;
    if spread(samples) > ROOM * turn {
        return steps_far(name, signal, turn, samples);
    }
    let turns = round::unroll(samples, turn);
    (turns > 0).then(|| goes_round(name, signal, turns))
}

/// From the least to the largest value.
fn spread(samples: &[(i64, f64)]) -> f64 {
    let mut values: Vec<f64> = samples.iter().map(|sample| sample.1).collect();
    if values.is_empty() {
        return 0.0;
    }
    let (errors, last) = (values.len() / ERRORS, values.len() - 1);
    let mut at = |place: usize| *values.select_nth_unstable_by(place, f64::total_cmp).1;
    at(last - errors) - at(errors)
}

/// What is said of an angle that was logged within one turn.
fn goes_round(name: &str, signal: &SignalMap, turns: u64) -> Note {
    let times = if turns == 1 { "once".to_string() } else { format!("{turns} times") };
    let text = format!(
        "{} {}: steps by a whole turn {times}: it goes on beyond one, so that what lies between two samples is the shorter way",
        signal.topic, signal.field
    );
    Note::info(name, turns, text)
}

/// What is said of one that has more than a turn and does not go on from sample to sample.
fn steps_far(name: &str, signal: &SignalMap, turn: f64, samples: &[(i64, f64)]) -> Option<Note> {
    let far = samples.windows(2).filter(|w| (w[1].1 - w[0].1).abs() > 0.5 * turn).count() as u64;
    let unit = Unit::parse(&signal.unit).ok()?;
    let factor = f64::from(signal.sign) * signal.scale;
    let logged = samples.iter().map(|sample| unit.from_si((sample.1 - signal.offset) / factor));
    let ends = (f64::INFINITY, f64::NEG_INFINITY);
    let (low, high) = logged.fold(ends, |(low, high), x| (low.min(x), high.max(x)));
    let other = if signal.unit.starts_with("rad") { " (degrees declared as rad)" } else { "" };
    let text = format!(
        "{} {}: runs from {} to {} {}, more than a turn, and steps by more than half a turn {far} times: is it in another unit{other}?",
        signal.topic,
        signal.field,
        digits(low),
        digits(high),
        signal.unit
    );
    (far > FEW).then(|| Note::warning(name, far, text))
}
