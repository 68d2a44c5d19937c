//! Estimates that are one number per flight come in; whether they scatter from flight to flight as their
//! standard deviations say, goes out.
//!
//! What differs from flight to flight may be the condition, and then a line shows it. Where nothing else does,
//! it is what standard deviations of one flight cannot know: errors that its inputs had throughout.

use super::one::One;
use super::set::{Set, set};
use crate::config::list;
use crate::error::Result;
use crate::model::extend::is_shift;
use crate::stage::correlations::Correlations;
use crate::table::Table;
use std::collections::BTreeMap;

/// The word for such a set in the table.
pub const FLIGHTS: &str = "flights";
/// So many times what is claimed is worth a word, where it is as rare as this by chance, all parameters together.
const TIMES: f64 = 2.0;
const RARE: f64 = 0.001;

/// What was estimated once per flight and has an sd, parameter by parameter; initial values differ.
pub fn of_flights(estimates: &Table) -> Result<Vec<Vec<One<'_>>>> {
    let (parameters, units) = (estimates.strings("parameter")?, estimates.strings("unit")?);
    let (values, sds) = (estimates.f64("value")?, estimates.f64("sd")?);
    let (segments, per) = (estimates.opt_strings("segment")?, estimates.strings("per")?);
    let mut all: BTreeMap<&str, Vec<One>> = BTreeMap::new();
    for (row, flight) in estimates.opt_strings("flight")?.into_iter().enumerate() {
        let (parameter, value, sd) = (parameters[row], values[row], sds[row]);
        let is_one = segments[row].is_none() && per[row] == "campaign";
        // Initial values and zero shifts are no repeats of each other.
        let differs = parameter.ends_with("(0)") || is_shift(parameter);
        let Some(flight) = flight.filter(|_| is_one && !differs) else {
            continue;
        };
        if !(value.is_finite() && sd > 0.0 && sd.is_finite()) {
            continue;
        }
        all.entry(parameter).or_default().push(One {
            parameter,
            unit: units[row],
            segment: flight,
            value,
            sd,
            trim: None,
            flight: Some(flight),
            input: None,
            kind: None,
        });
    }
    Ok(all.into_values().collect())
}

/// The flights of one parameter beside each other.
pub fn beside<'a>(ones: &[One<'a>]) -> Option<Set<'a>> {
    set(FLIGHTS, &ones.iter().collect::<Vec<_>>(), &Correlations::default())
}

/// What there is to say about parameters that no line goes through (`lined`): how many, and the words.
pub fn loose(rows: &[Set], lined: &[&str]) -> Option<(usize, String)> {
    let flights: Vec<&Set> = rows.iter().filter(|row| row.set == FLIGHTS).collect();
    let limit = RARE / flights.len().max(1) as f64;
    let ratio = |row: &Set| row.found.scatter / row.found.claimed;
    let is_loose =
        |row: &&&Set| ratio(row) > TIMES && row.found.p < limit && !lined.contains(&row.parameter);
    let mut loose: Vec<&&Set> = flights.iter().filter(is_loose).collect();
    loose.sort_by(|a, b| ratio(b).total_cmp(&ratio(a)));
    let each = |row: &&&Set| format!("{} by {:.1} times", row.parameter, ratio(row));
    let each: Vec<String> = loose.iter().map(each).collect();
    let text = format!(
        "values of {} flights scatter by more than their standard deviations say: {}. They depend on the condition (a [[fit]] shows on which), the air was rough (turbulence: noise that drives the model, filter error), or inputs have errors that last a flight (`shifts.inputs`)",
        loose.first()?.found.n,
        list(&each)
    );
    Some((loose.len(), text))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(values: &[f64]) -> Vec<One<'static>> {
        let one = |value: &f64| One {
            parameter: "C_n_beta",
            unit: "1/rad",
            segment: "",
            value: *value,
            sd: 0.01,
            trim: None,
            flight: Some(""),
            input: None,
            kind: None,
        };
        values.iter().map(one).collect()
    }

    #[test]
    fn flights_that_differ_by_more_than_their_sd_have_a_large_ratio() {
        let of = |values: &[f64]| beside(&flown(values)).expect("a set").found;
        let far = of(&[0.10, 0.16, 0.04, 0.12, 0.20]);
        assert!(far.scatter / far.claimed > 5.0 && far.p < 1e-6);
        let near = of(&[0.10, 0.11, 0.09, 0.105, 0.095]);
        assert!(near.scatter / near.claimed < TIMES && near.p > 0.3);
        assert!(beside(&flown(&[0.1])).is_none());
    }
}
