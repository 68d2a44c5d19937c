//! A maneuver and the keys its kind has in; the keys that are missing, that are out of range or
//! that belong to another kind out.

use super::shape::Mistake;
use crate::simulate::settings::Maneuver;

/// Keys that not every kind has, and what has them.
const KEYS: [(&str, &str); 10] = [
    ("amplitude", "a multistep, a multisine or a sweep"),
    ("amplitudes", "a multistep"),
    ("unit_time_s", "a multistep"),
    ("edge_s", "a multistep"),
    ("duration_s", "a multisine"),
    ("band_hz", "a multisine"),
    ("period_s", "a sweep"),
    ("cycles", "a sweep"),
    ("times_s", "a profile"),
    ("values", "a profile"),
];

/// Reports the keys that are given and are not among those the kind has.
pub fn only(maneuver: &Maneuver, has: &[&str], mistakes: &mut Vec<Mistake>) {
    let given = |key: &str| match key {
        "amplitude" => maneuver.amplitude.is_some(),
        "amplitudes" => maneuver.amplitudes.is_some(),
        "unit_time_s" => maneuver.unit_time_s.is_some(),
        "edge_s" => maneuver.edge_s != 0.0,
        "duration_s" => maneuver.duration_s.is_some(),
        "band_hz" => maneuver.band_hz.is_some(),
        "period_s" => maneuver.period_s.is_some(),
        "cycles" => maneuver.cycles.is_some(),
        "times_s" => maneuver.times_s.is_some(),
        _ => maneuver.values.is_some(),
    };
    for (key, whose) in KEYS.into_iter().filter(|(key, _)| given(key) && !has.contains(key)) {
        mistakes.push((key, format!("`{key}` belongs to {whose}, not to \"{}\"", maneuver.kind)));
    }
}

/// A time that must be there and greater than 0.
pub fn positive(
    value: Option<f64>,
    key: &'static str,
    for_what: &str,
    mistakes: &mut Vec<Mistake>,
) -> Option<f64> {
    match value {
        Some(x) if x.is_finite() && x > 0.0 => Some(x),
        Some(x) => {
            mistakes.push((key, format!("`{key}` must be greater than 0 s, not {x}")));
            None
        }
        None => {
            mistakes.push((key, format!("{for_what} needs `{key}`")));
            None
        }
    }
}

/// The amplitude, which must be there and greater than 0.
pub fn amplitude(maneuver: &Maneuver, for_what: &str, mistakes: &mut Vec<Mistake>) -> Option<f64> {
    match maneuver.amplitude {
        Some(a) => size("amplitude", a, mistakes),
        None => {
            mistakes.push(("amplitude", format!("{for_what} needs `amplitude`")));
            None
        }
    }
}

/// An amplitude that must be greater than 0.
pub fn size(key: &'static str, value: f64, mistakes: &mut Vec<Mistake>) -> Option<f64> {
    if value.is_finite() && value > 0.0 {
        return Some(value);
    }
    mistakes.push((
        key,
        format!("the amplitude must be greater than 0, not {value}; the sign is `polarity`"),
    ));
    None
}
