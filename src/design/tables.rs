//! The results of a study in, the table `designs` out.

use super::judged::{Judged, Summary};
use super::results::Results;
use crate::error::Result;
use crate::table::Table;
use indexmap::IndexMap;

/// What is told of every parameter: ending of the column, meaning, value.
type Told = (&'static str, &'static str, fn(&Summary) -> f64);
const TOLD: [Told; 5] = [
    ("", "mean over the recordings", |s| s.mean),
    ("_error", "mean over the recordings less the true value", |s| s.error),
    ("_scatter", "standard deviation between recordings", |s| s.scatter),
    ("_crlb", "Cramer-Rao bound, root mean square over the recordings", |s| s.crlb),
    ("_sd", "standard deviation with coloured residuals allowed for, root mean square", |s| s.sd),
];

/// The table `designs`: one row per estimate and design.
///
/// # Errors
/// None that a study can cause.
pub fn designs(results: &Results) -> Result<Table> {
    let all: Vec<&Judged> = results.estimates.iter().flatten().collect();
    let number = |of: &dyn Fn(&Judged) -> f64| all.iter().map(|j| of(j)).collect::<Vec<f64>>();
    let excursion =
        |i: usize| number(&|j| j.facts.as_ref().map_or(f64::NAN, |f| f.excursions.0[i]));
    let amplitude = |j: &Judged| {
        let m = &j.design.maneuver;
        let all = m.amplitude.iter().chain(m.amplitudes.iter().flatten());
        all.chain(m.values.iter().flatten()).fold(0.0f64, |most, a| most.max(a.abs()))
    };
    let mut table = Table::build("designs")
        .strings("estimate", all.iter().map(|j| &j.estimate))
        .strings("design", all.iter().map(|j| &j.design.name))
        .strings("kind", all.iter().map(|j| &j.design.maneuver.kind))
        .f64("unit_time_s", number(&|j| j.design.maneuver.unit_time_s.unwrap_or(f64::NAN)))
        .f64("amplitude", number(&amplitude))
        .i64(
            "polarity",
            all.iter().map(|j| i64::from(j.design.maneuver.polarity)).collect::<Vec<_>>(),
        )
        .i64("repeats", all.iter().map(|j| i64::from(j.design.repeats)).collect::<Vec<_>>())
        .f64("duration_s", number(&|j| j.facts.as_ref().map_or(f64::NAN, |f| f.duration)))
        .opt_i64("rank", all.iter().map(|j| j.rank.map(|r| r as i64)).collect::<Vec<_>>())
        .strings("outcome", all.iter().map(|j| j.outcome.word()))
        .i64("runs", all.iter().map(|j| j.runs as i64).collect::<Vec<_>>())
        .i64("determined", all.iter().map(|j| j.determined as i64).collect::<Vec<_>>())
        .f64("trace", number(&|j| j.trace))
        .f64("determinant", number(&|j| j.determinant))
        .f64("squared_error", number(&|j| j.squared_error))
        .f64("airspeed", excursion(0))
        .f64("pitch", excursion(1))
        .f64("bank", excursion(2))
        .f64("load_factor", excursion(3))
        .f64("alpha", excursion(4))
        .f64("current", excursion(5))
        .strings("why", all.iter().map(|j| &j.why));
    for (name, unit) in parameters(&all) {
        let of = |j: &Judged| j.parameters.iter().find(|p| p.name == name).cloned();
        for (ending, doc, value) in TOLD {
            let column = number(&|j| of(j).map_or(f64::NAN, |p| value(&p)));
            table =
                table.dynamic(&format!("{name}{ending}"), &unit, &format!("{name}: {doc}"), column);
        }
    }
    table.finish()?.sorted(&["estimate", "design"])
}

/// Names and units of all parameters, in the order in which estimates bring them.
fn parameters(all: &[&Judged]) -> IndexMap<String, String> {
    all.iter().flat_map(|j| &j.parameters).map(|p| (p.name.clone(), p.unit.clone())).collect()
}
