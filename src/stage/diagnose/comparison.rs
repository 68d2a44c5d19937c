//! What the additions of a diagnosis did in; its tables out.

use super::Outcome;
use crate::diagnose::{Channel, Driven, Gap, Match, Relation};
use crate::error::Result;
use crate::table::Table;

fn name(outcome: &Outcome, segment: Option<usize>) -> Option<String> {
    segment.and_then(|s| outcome.names.get(s)).cloned()
}

fn finite(v: f64) -> f64 {
    if v.is_finite() { v } else { f64::NAN }
}

pub fn gaps(outcome: &Outcome) -> Result<Table> {
    let comparison = &outcome.diagnosis.comparison;
    let after =
        if outcome.diagnosis.added.is_empty() { &[][..] } else { &comparison.gaps_after[..] };
    let rows: Vec<(&str, &Gap)> = comparison
        .gaps_before
        .iter()
        .map(|g| ("before", g))
        .chain(after.iter().map(|g| ("after", g)))
        .collect();
    let number = |of: fn(&Gap) -> f64| rows.iter().map(|r| finite(of(r.1))).collect::<Vec<f64>>();
    Table::build("gaps")
        .repeat("diagnosis", &outcome.config.name())
        .strings("when", rows.iter().map(|r| r.0))
        .opt_strings("segment", rows.iter().map(|r| name(outcome, r.1.segment)))
        .strings("output", rows.iter().map(|r| &r.1.output))
        .strings("by", rows.iter().map(|r| &r.1.by))
        .f64("from", number(|g| g.from))
        .f64("to", number(|g| g.to))
        .i64("n", rows.iter().map(|r| r.1.n as i64).collect::<Vec<_>>())
        .f64("mean", number(|g| g.mean))
        .f64("rms", number(|g| g.rms))
        .f64(
            "noise",
            rows.iter()
                .map(|r| if r.1.noise.is_finite() { r.1.noise } else { 0.0 })
                .collect::<Vec<_>>(),
        )
        .f64("ratio", number(|g| g.rms / g.noise))
        .finish()
}

pub fn closures(outcome: &Outcome) -> Result<Table> {
    let rows: Vec<&Channel> = outcome.diagnosis.comparison.channels.iter().collect();
    let number = |which: fn(&Channel) -> Match, of: fn(Match) -> f64| {
        rows.iter().map(|c| of(which(c))).collect::<Vec<f64>>()
    };
    let before = |c: &Channel| c.before;
    let after = |c: &Channel| c.after;
    Table::build("closures")
        .repeat("diagnosis", &outcome.config.name())
        .strings("set", rows.iter().map(|c| if c.held_out { "held out" } else { "training" }))
        .opt_strings("segment", rows.iter().map(|c| name(outcome, c.segment)))
        .opt_strings("output", rows.iter().map(|c| c.output.clone()))
        .strings("unit", rows.iter().map(|c| &c.unit))
        .i64("n", rows.iter().map(|c| c.n as i64).collect::<Vec<_>>())
        .f64("rms_before", number(before, |m| m.rms))
        .f64("rms_after", number(after, |m| m.rms))
        .f64("theil_before", number(before, |m| m.theil))
        .f64("theil_after", number(after, |m| m.theil))
        .f64("chi2_before", number(before, |m| m.chi2))
        .f64("chi2_after", number(after, |m| m.chi2))
        .finish()
}

pub fn shifts(outcome: &Outcome) -> Result<Table> {
    let rows = &outcome.diagnosis.comparison.shifts;
    let column = |of: fn(&crate::diagnose::Shift) -> f64| rows.iter().map(of).collect::<Vec<f64>>();
    Table::build("shifts")
        .repeat("diagnosis", &outcome.config.name())
        .strings("parameter", rows.iter().map(|r| &r.name))
        .strings("unit", rows.iter().map(|r| &r.unit))
        .f64("before", column(|r| r.before))
        .f64("before_sd", column(|r| r.before_sd.unwrap_or(f64::NAN)))
        .f64("after", column(|r| r.after))
        .f64("after_sd", column(|r| r.after_sd.unwrap_or(f64::NAN)))
        .f64("shift", column(|r| r.before_sd.map_or(f64::NAN, |sd| (r.after - r.before) / sd)))
        .finish()
}

pub fn overlays(outcome: &Outcome) -> Result<Table> {
    let added = !outcome.diagnosis.added.is_empty();
    let all = outcome.diagnosis.comparison.overlays.iter().filter(|_| added);
    let rows: Vec<_> = all.flat_map(|o| (0..o.before.t.len()).map(move |k| (o, k))).collect();
    Table::build("overlays")
        .repeat("diagnosis", &outcome.config.name())
        .strings(
            "segment",
            rows.iter().map(|(o, _)| outcome.names.get(o.segment).map_or("", String::as_str)),
        )
        .strings("output", rows.iter().map(|(o, _)| &o.before.name))
        .strings("unit", rows.iter().map(|(o, _)| &o.before.unit))
        .f64("t_s", rows.iter().map(|(o, k)| o.before.t[*k]).collect::<Vec<_>>())
        .f64(
            "measured",
            rows.iter().map(|(o, k)| finite(o.before.measured[*k])).collect::<Vec<_>>(),
        )
        .f64("before", rows.iter().map(|(o, k)| finite(o.before.modelled[*k])).collect::<Vec<_>>())
        .f64("after", rows.iter().map(|(o, k)| finite(o.after[*k])).collect::<Vec<_>>())
        .finish()
}

pub fn relations(outcome: &Outcome) -> Result<Table> {
    let rows = &outcome.diagnosis.comparison.lacking.relations;
    let column = |of: fn(&Relation) -> f64| rows.iter().map(of).collect::<Vec<f64>>();
    Table::build("relations")
        .repeat("diagnosis", &outcome.config.name())
        .strings("output", rows.iter().map(|r| &r.output))
        .strings("source", rows.iter().map(|r| &r.source))
        .f64("correlation", column(|r| r.correlation))
        .f64("lag", column(|r| r.lag))
        .f64("limit", column(|r| r.limit))
        .f64("coherence", column(|r| r.coherence))
        .f64("from", column(|r| r.from))
        .f64("to", column(|r| r.to))
        .f64("coherence_limit", column(|r| r.coherence_limit))
        .finish()
}

pub fn driven(outcome: &Outcome) -> Result<Table> {
    let all = &outcome.diagnosis.comparison.driven;
    let free = |output: &str| {
        all.iter().find(|d| d.state.is_none() && d.output == output).map_or(f64::NAN, |d| d.rms)
    };
    // A state that cannot have it is left out.
    let rows: Vec<&Driven> = all.iter().filter(|d| d.rms.is_finite()).collect();
    Table::build("driven")
        .repeat("diagnosis", &outcome.config.name())
        .opt_strings("state", rows.iter().map(|d| d.state.clone()))
        .strings("output", rows.iter().map(|d| &d.output))
        .strings("unit", rows.iter().map(|d| &d.unit))
        .f64("rms", rows.iter().map(|d| d.rms).collect::<Vec<_>>())
        .f64("noise", rows.iter().map(|d| finite(d.noise)).collect::<Vec<_>>())
        .f64("share", rows.iter().map(|d| finite(d.rms / free(&d.output))).collect::<Vec<_>>())
        .finish()
}

pub fn equation_errors(outcome: &Outcome) -> Result<Table> {
    let rows: Vec<_> = outcome
        .diagnosis
        .comparison
        .lacking
        .equations
        .iter()
        .filter(|e| e.rms.is_finite())
        .collect();
    Table::build("equation_errors")
        .repeat("diagnosis", &outcome.config.name())
        .strings(
            "equation",
            rows.iter()
                .map(|e| if e.is_rate { format!("rate of {}", e.name) } else { e.name.clone() }),
        )
        .strings("kind", rows.iter().map(|e| if e.is_rate { "rate" } else { "coefficient" }))
        .opt_strings("segment", rows.iter().map(|e| name(outcome, e.segment)))
        .strings("unit", rows.iter().map(|e| &e.unit))
        .f64("rms", rows.iter().map(|e| e.rms).collect::<Vec<_>>())
        .f64("noise", rows.iter().map(|e| finite(e.noise)).collect::<Vec<_>>())
        .f64("ratio", rows.iter().map(|e| finite(e.rms / e.noise)).collect::<Vec<_>>())
        .finish()
}
