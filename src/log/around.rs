//! The samples of an angle in; the same beyond a turn where it was logged within one, and what is said
//! of that, out.

use super::Note;
use super::channel_map::SignalMap;
use super::series::seconds;
use crate::math::digits;
use crate::signal::round;
use crate::units::Unit;

/// Within a turn, with this room: readings end beside it.
const ROOM: f64 = 1.02;
/// Of a thousand samples one at either end may be an error and says nothing of the others.
const ERRORS: usize = 1000;
/// So many long steps are gaps, or errors.
const FEW: u64 = 3;
/// An angle that goes round moves between two samples no faster than so many times what it does in all but
/// one of a hundred; and, whatever that is, by this share of a turn.
const FASTER: f64 = 10.0;
const LITTLE: f64 = 0.05;

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
    let rate = FASTER * usual_rate(samples, turn);
    let moves = |a: i64, b: i64, step: f64| step <= (rate * seconds(b - a)).max(LITTLE * turn);
    let [turns, jumps] = round::unroll(samples, turn, moves);
    match (turns, jumps) {
        (0, 0) => None,
        (_, 0) => Some(goes_round(name, signal, turns)),
        _ => Some(jumps_far(name, signal, jumps)),
    }
}

/// The rate that an angle does not exceed in 99 of 100 steps, whole turns apart.
fn usual_rate(samples: &[(i64, f64)], turn: f64) -> f64 {
    let rate = |pair: &[(i64, f64)]| {
        let step = (pair[1].1 - pair[0].1).abs();
        let shorter = if round::beyond(step, turn) == 0.0 { step } else { (step - turn).abs() };
        shorter / seconds(pair[1].0 - pair[0].0)
    };
    let all = samples.windows(2).filter(|pair| pair[1].0 > pair[0].0).map(rate);
    let mut rates: Vec<f64> = all.filter(|rate| rate.is_finite()).collect();
    if rates.is_empty() {
        return 0.0;
    }
    let at = (rates.len() - 1) * 99 / 100;
    *rates.select_nth_unstable_by(at, f64::total_cmp).1
}

/// What is said of an angle that steps by nearly a turn where it cannot have gone round.
fn jumps_far(name: &str, signal: &SignalMap, jumps: u64) -> Note {
    let text = format!(
        "{} {}: steps by nearly a whole turn {}, further than it moves anywhere else, whichever way round: these numbers stay as they are; `range` in the channel map drops what cannot be",
        signal.topic,
        signal.field,
        times(jumps)
    );
    Note::warning(name, jumps, text)
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
    let text = format!(
        "{} {}: steps by a whole turn {}: it goes on beyond one, so that what lies between two samples is the shorter way",
        signal.topic,
        signal.field,
        times(turns)
    );
    Note::info(name, turns, text)
}

/// How often, in words.
fn times(n: u64) -> String {
    if n == 1 { "once".to_string() } else { format!("{n} times") }
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
