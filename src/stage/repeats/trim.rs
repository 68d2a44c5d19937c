//! The trimmed condition before a maneuver in; which maneuvers were flown at the same one out.

use crate::error::Result;
use crate::table::Table;
use std::collections::BTreeMap;

/// What a model was driven by, and what it was scored with, before the maneuver: name, unit, value.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trim(Vec<(String, String, f64)>);

/// The conditions of the maneuvers of a flight, by maneuver: of the named columns those that a
/// condition is told by, airspeeds, pressures, angles, altitudes. Rates, forces and currents are not.
pub fn all(conditions: &Table, columns: &[String]) -> Result<BTreeMap<String, Trim>> {
    let (signals, units) = (conditions.strings("signal")?, conditions.strings("unit")?);
    let values = conditions.f64("value")?;
    let mut all: BTreeMap<String, Trim> = BTreeMap::new();
    for (i, segment) in conditions.strings("segment")?.into_iter().enumerate() {
        let (signal, unit, value) = (signals[i], units[i], values[i]);
        let tells = value.is_finite() && tolerance(unit, value).is_some();
        if tells && columns.iter().any(|column| column == signal) {
            let one = (signal.to_string(), unit.to_string(), value);
            all.entry(segment.to_string()).or_default().0.push(one);
        }
    }
    Ok(all)
}

/// How far two maneuvers of one condition may be apart: what is flown again by hand or by an
/// autopilot comes back to it, and coefficients that vary with the condition hardly move.
const ANGLE: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// The same for altitudes and distances, m.
const LENGTH: f64 = 150.0;
/// The same for airspeeds, as a share.
const SPEED: f64 = 0.03;
/// The same for pressures, as a share: twice that of the airspeed.
const PRESSURE: f64 = 0.06;

impl Trim {
    /// Whether anything is known of the condition.
    pub fn is_known(&self) -> bool {
        !self.0.is_empty()
    }

    /// Whether two maneuvers were flown at the same condition, as far as both tell; not where
    /// nothing is known.
    pub fn is_like(&self, other: &Trim) -> bool {
        let close = |(name, unit, value): &(String, String, f64)| {
            let (.., theirs) = other.0.iter().find(|(n, ..)| n == name)?;
            Some((value - theirs).abs() <= tolerance(unit, 0.5 * (value + theirs))?)
        };
        let told: Vec<bool> = self.0.iter().filter_map(close).collect();
        !told.is_empty() && told.into_iter().all(|c| c)
    }

    /// `qbar 4120 Pa, alpha 0.0512 rad`
    pub fn words(&self) -> String {
        let digits = |v: f64| {
            let before_point =
                if v == 0.0 { 1 } else { libm::floor(libm::log10(v.abs())) as i32 + 1 };
            format!("{v:.*}", (3 - before_point).clamp(0, 5) as usize)
        };
        self.0
            .iter()
            .map(|(name, unit, value)| format!("{name} {} {unit}", digits(*value)))
            .collect::<Vec<_>>()
            .join(", ")
    }
}

/// Whether a quantity of this SI unit tells a condition.
pub fn tells(unit: &str) -> bool {
    tolerance(unit, 1.0).is_some()
}

/// How far a quantity of this SI unit may be off within one condition; none for those that tell no
/// condition.
fn tolerance(unit: &str, value: f64) -> Option<f64> {
    match unit {
        "rad" => Some(ANGLE),
        "m" => Some(LENGTH),
        "m/s" => Some(SPEED * value.abs()),
        "Pa" => Some(PRESSURE * value.abs()),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trim(v: f64, alpha: f64, q: f64) -> Trim {
        let table = Table::build("conditions")
            .repeat("flight", "f")
            .repeat("segment", "s")
            .strings("signal", ["V", "alpha", "q"]);
        let table = table
            .strings("unit", ["m/s", "rad", "rad/s"])
            .f64("value", [v, alpha, q])
            .finish()
            .expect("conditions");
        let mut all = all(&table, &["V", "alpha", "q"].map(String::from)).expect("conditions");
        all.remove("s").expect("a condition")
    }

    #[test]
    fn a_condition_is_the_same_within_its_tolerances() {
        let a = trim(80.0, 0.07, 0.0);
        assert!(a.is_like(&trim(81.5, 0.075, 0.3)), "rates tell no condition");
        assert!(!a.is_like(&trim(84.0, 0.07, 0.0)) && !a.is_like(&trim(80.0, 0.085, 0.0)));
        assert!(!Trim::default().is_like(&Trim::default()) && !Trim::default().is_known());
        assert_eq!(a.words(), "V 80.0 m/s, alpha 0.0700 rad");
    }
}
