//! The closing words of a run: its result and its tables come in, a page of text on the screen goes out.

use super::say;
use crate::error::Result;
use crate::pipeline::{Plan, RunResult, Store};
use crate::stage::{Note, Part, Severity};
use crate::table::Table;
use std::path::Path;

/// Half width of the 95% interval in standard deviations: what stands behind +- wherever the program writes it.
const INTERVAL: f64 = 1.96;
/// Groups of notes shown before the rest is left to the table.
const GROUPS_SHOWN: usize = 10;

/// Prints stages, flights, estimates, lines, notes, and where the report is.
///
/// # Errors
/// A table cannot be read back.
pub fn print(plan: &Plan, store: &Store, out: &Path, result: &RunResult) -> Result<()> {
    stages(result);
    flights(plan, store)?;
    estimates(plan, store)?;
    lines(plan, store)?;
    notes(&result.notes);
    let report = "report/index.html";
    if result.files.iter().any(|f| f == report) {
        say(&format!("\nreport: {}", out.join(report).display()));
    }
    say(&format!("tables: {}", out.display()));
    Ok(())
}

fn stages(result: &RunResult) {
    if result.nothing_done() {
        return;
    }
    let rows = result.stages.iter().map(|s| {
        let count = |n: usize| if n == 0 { "-".to_string() } else { n.to_string() };
        [s.name.to_string(), count(s.ran), count(s.fresh), count(s.failed), count(s.blocked)]
    });
    table(&["stage", "run", "fresh", "failed", "not possible"], rows.map(|r| r.to_vec()).collect());
    for unit in &result.removed {
        say(&format!("removed: {unit}"));
    }
}

/// The part of a table, where there is one.
fn read(store: &Store, table: &str, part: Part) -> Result<Option<Table>> {
    if store.path(&part.path(table)).exists() { store.table(table, &part).map(Some) } else { Ok(None) }
}

fn flights(plan: &Plan, store: &Store) -> Result<()> {
    let mut rows = Vec::new();
    for flight in &plan.campaign.flights {
        let part = Part::Flight(flight.clone());
        let signals = read(store, "channels", part.clone())?.map(|t| t.rows());
        let (mut found, mut used, mut kinds) = (0, 0, Vec::new());
        if let Some(segments) = read(store, "segments", part)? {
            let included = segments.bools("included")?;
            found = segments.rows();
            used = included.iter().filter(|b| **b).count();
            kinds = tally(&segments.strings("kind")?);
        }
        let signals = signals.map_or("none: not read".to_string(), |n| n.to_string());
        rows.push(vec![flight.clone(), signals, found.to_string(), used.to_string(), kinds.join(", ")]);
    }
    table(&["flight", "signals", "maneuvers", "used", "kinds"], rows);
    Ok(())
}

/// `["2 x 211", "8 x 3211"]`
fn tally(words: &[&str]) -> Vec<String> {
    let mut sorted = words.to_vec();
    sorted.sort_unstable();
    sorted.chunk_by(|a, b| a == b).map(|run| format!("{} x {}", run.len(), run[0])).collect()
}

fn estimates(plan: &Plan, store: &Store) -> Result<()> {
    let mut rows = Vec::new();
    let names = plan.campaign.estimates.iter().map(|e| e.name()).enumerate();
    for (i, name) in names.chain(crate::stage::rerun::units(&plan.campaign)) {
        let Some(t) = read(store, "estimates", Part::Number(i))? else { continue };
        let (groups, stops) = (t.strings("group")?, t.strings("stop")?);
        let mut each: Vec<(&str, &str)> = groups.into_iter().zip(stops).collect();
        each.dedup();
        let converged = each.iter().filter(|(_, stop)| *stop == "converged").count();
        let others: Vec<&str> = each.iter().map(|(_, stop)| *stop).filter(|stop| *stop != "converged").collect();
        rows.push(vec![name, each.len().to_string(), converged.to_string(), tally(&others).join(", ")]);
    }
    if !rows.is_empty() {
        table(&["estimate", "runs", "converged", "others"], rows);
    }
    Ok(())
}

fn lines(plan: &Plan, store: &Store) -> Result<()> {
    let mut rows = Vec::new();
    for i in 0..plan.campaign.fits.len() {
        let Some(t) = read(store, "fits", Part::Number(i))? else { continue };
        let (models, parameters, against) = (t.strings("model")?, t.strings("parameter")?, t.strings("against")?);
        let (slope, intercept) = ((t.f64("slope")?, t.f64("slope_sd")?), (t.f64("intercept")?, t.f64("intercept_sd")?));
        let n = t.i64("n")?;
        for k in 0..t.rows() {
            let value = |(value, sd): (&[f64], &[f64])| format!("{} +- {}", number(value[k]), number(INTERVAL * sd[k]));
            let name = format!("{}: {}", models[k], parameters[k]);
            rows.push(vec![name, against[k].to_string(), value(slope), value(intercept), n[k].to_string()]);
        }
    }
    if !rows.is_empty() {
        table(&["line", "against", "slope +- 95%", "intercept +- 95%", "points"], rows);
    }
    Ok(())
}

/// Four significant digits.
fn number(value: f64) -> String {
    match value {
        v if !v.is_finite() => "-".to_string(),
        v if v == 0.0 || (1e-4..1e5).contains(&v.abs()) => {
            let before_point = if v == 0.0 { 1 } else { libm::floor(libm::log10(v.abs())) as i32 + 1 };
            format!("{v:.*}", (4 - before_point).max(0) as usize)
        }
        v => format!("{v:.3e}"),
    }
}

fn notes(notes: &[Note]) {
    for (severity, heading) in [(Severity::Missing, "missing"), (Severity::Warning, "warning")] {
        let all: Vec<&Note> = notes.iter().filter(|n| n.severity == severity).collect();
        if all.is_empty() {
            continue;
        }
        say(&format!("\n{heading}:"));
        // Many notes of one stage about one flight tend to say the same thing of several signals: the first one stands for them.
        let groups: Vec<&[&Note]> = all.chunk_by(|a, b| (&a.stage, &a.flight) == (&b.stage, &b.flight)).collect();
        for group in groups.iter().take(GROUPS_SHOWN) {
            let flight = if group[0].flight.is_empty() { String::new() } else { format!("{}: ", group[0].flight) };
            let more = if group.len() > 1 { format!(" (and {} more of this kind)", group.len() - 1) } else { String::new() };
            say(&format!("  {}: {flight}{}{more}", group[0].stage, group[0].text.replace('\n', " ")));
        }
        let hidden: usize = groups.iter().skip(GROUPS_SHOWN).map(|g| g.len()).sum();
        if hidden > 0 || groups.len() < all.len() {
            say("  all of them are in the table `notes`");
        }
    }
}

/// Prints columns, the first one flush left.
fn table(head: &[&str], rows: Vec<Vec<String>>) {
    let width = |i: usize| rows.iter().map(|r| r[i].chars().count()).chain([head[i].len()]).max().unwrap_or(0);
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: Vec<&str>| {
        let padded = cells.iter().zip(&widths).enumerate();
        let text: Vec<String> = padded.map(|(i, (c, w))| if i == 0 { format!("{c:<w$}") } else { format!("{c:>w$}") }).collect();
        text.join("  ").trim_end().to_string()
    };
    say("");
    say(&line(head.to_vec()));
    for row in &rows {
        say(&line(row.iter().map(String::as_str).collect()));
    }
}

/// `3 flights`, `1 flight`
pub fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        for (value, text) in [(-0.37171, "-0.3717"), (12.3456, "12.35"), (0.0, "0.000"), (1.5e-7, "1.500e-7"), (f64::NAN, "-")] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn kinds_are_tallied() {
        assert_eq!(tally(&["3211", "211", "3211"]), ["1 x 211", "2 x 3211"]);
    }
}
