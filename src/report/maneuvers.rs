//! `responses`, `segments` and `samples` in, the time histories of every maneuver and the table of how well each one fits out.

use super::columns::Columns;
use super::format::{count, display_unit, number, plain, short, shorts, thin};
use super::grid::{Cell, Grid, Level, Row};
use serde::Serialize;
use std::collections::BTreeMap;

/// What one maneuver's plot is drawn from (JSON). Times are seconds of the flight.
#[derive(Debug, Serialize)]
pub struct Maneuver {
    pub label: String,
    pub caption: String,
    pub start: Option<f64>,
    pub end: Option<f64>,
    pub outputs: Vec<Output>,
    pub inputs: Vec<Input>,
}

#[derive(Debug, Serialize)]
pub struct Output {
    pub name: String,
    pub unit: String,
    pub t: Vec<Option<f64>>,
    pub measured: Vec<Option<f64>>,
    pub modelled: Vec<Option<f64>>,
}

#[derive(Debug, Serialize)]
pub struct Input {
    pub name: String,
    pub unit: String,
    pub t: Vec<Option<f64>>,
    pub value: Vec<Option<f64>>,
}

/// The text around the plot (template).
#[derive(Debug, Default, Serialize)]
pub struct Maneuvers {
    pub missing: Option<String>,
    /// How the drawn samples relate to the recorded ones.
    pub shown: String,
    pub table: Grid,
}

/// What the checks say about the match of one output of one maneuver.
#[derive(Debug, Clone)]
pub struct Match {
    pub name: String,
    /// Residual r.m.s. over the standard deviation of the measured output.
    pub misfit: f64,
}

/// The tables the time histories come from.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    pub responses: Option<&'a Columns>,
    pub segments: Option<&'a Columns>,
    pub samples: Option<&'a Columns>,
    pub estimates: Option<&'a Columns>,
    pub residuals: Option<&'a Columns>,
    /// Sample columns that drive each model.
    pub inputs: &'a BTreeMap<String, Vec<String>>,
}

/// Numbers drawn in all maneuvers together, at most about: keeps the page below some 10 MB however large the campaign is.
const BUDGET: usize = 600_000;
/// Seconds of inputs drawn before and after a maneuver's own span when the responses do not say more.
const MARGIN: f64 = 1.0;

/// Time histories in the order of `responses`, their table, and the match of every output.
pub fn maneuvers(from: Sources) -> (Maneuvers, Vec<Maneuver>, Vec<Match>) {
    let Some(responses) = from.responses.filter(|r| r.rows() > 0) else {
        let missing = Some("No time history: no maneuver has been estimated.".into());
        return (Maneuvers { missing, ..Maneuvers::default() }, Vec::new(), Vec::new());
    };
    let groups = responses.groups(&["model", "group", "segment"]);
    let limit = (BUDGET / (3 * groups.len().max(1))).clamp(150, 1200);
    let mut table =
        Grid::new(["model", "group", "segment", "output", "#samples", "#residual r.m.s.", "#of measured variation|%", "#colour"]);
    let (mut all, mut matches, mut thinned) = (Vec::new(), Vec::new(), false);
    for (key, rows) in &groups {
        let pick = format!("m{}", all.len());
        let (maneuver, was_thinned) = maneuver(from, responses, key, rows, limit);
        thinned |= was_thinned;
        for (output, rows) in by_output(responses, rows) {
            let residual = from.residuals.and_then(|table| residual_row(table, key, &output).map(|row| (table, row)));
            let (row, found) = match_of(responses, key, &output, &rows, residual, &pick);
            table.rows.push(row);
            matches.push(found);
        }
        all.push(maneuver);
    }
    table.note = Some("Click a row to see its time history. The r.m.s. is over all samples. Colour is the residuals' variance at frequency zero over their variance: 1 is white.".into());
    let shown = if thinned {
        format!(
            "Long records are thinned for display to about {limit} samples a curve, extremes kept; nothing else on this page is thinned."
        )
    } else {
        "Every sample is drawn.".into()
    };
    (Maneuvers { missing: None, shown, table }, all, matches)
}

fn by_output(responses: &Columns, rows: &[usize]) -> Vec<(String, Vec<usize>)> {
    let mut outputs: Vec<(String, Vec<usize>)> = Vec::new();
    for &row in rows {
        let name = responses.text("output", row);
        match outputs.iter_mut().find(|(n, _)| *n == name) {
            Some((_, rows)) => rows.push(row),
            None => outputs.push((name, vec![row])),
        }
    }
    outputs
}

fn maneuver(from: Sources, responses: &Columns, key: &[String], rows: &[usize], limit: usize) -> (Maneuver, bool) {
    let [model, group, segment] = [0, 1, 2].map(|i| key.get(i).cloned().unwrap_or_default());
    let found = from.segments.and_then(|s| (0..s.rows()).find(|&row| s.text("segment", row) == segment).map(|row| (s, row)));
    let flight = found.map_or(String::new(), |(s, row)| s.text("flight", row));
    let [start, end] = ["t_start_s", "t_end_s"].map(|name| found.map_or(f64::NAN, |(s, row)| s.number(name, row)));
    let mut thinned = false;
    let mut outputs = Vec::new();
    let mut span = (start - MARGIN, end + MARGIN);
    for (name, rows) in by_output(responses, rows) {
        let [t, measured, modelled] = ["t_s", "measured", "modelled"].map(|c| pick(responses.column(c), &rows));
        let keep = thin(t.len(), &[&measured, &modelled], limit);
        thinned |= keep.len() < t.len();
        span = (t.iter().copied().fold(span.0, f64::min), t.iter().copied().fold(span.1, f64::max));
        let (factor, unit) = display_unit(
            &from.residuals.and_then(|r| residual_row(r, key, &name).map(|row| r.text("unit", row))).unwrap_or_default(),
        );
        let drawn = |v: &[f64], factor| shorts(keep.iter().filter_map(|&i| v.get(i).copied()), factor);
        outputs.push(Output {
            name,
            unit,
            t: times(&pick(&t, &keep)),
            measured: drawn(&measured, factor),
            modelled: drawn(&modelled, factor),
        });
    }
    let mut names = from.inputs.get(&model).cloned().unwrap_or_default();
    if let Some((s, row)) = found.filter(|_| names.is_empty()) {
        names.push(s.text("input", row));
    }
    let inputs = from.samples.map_or(Vec::new(), |samples| inputs(samples, &flight, span, &names, limit));
    let kind = found.map_or(String::new(), |(s, row)| s.text("kind", row));
    let label: Vec<&str> =
        [&model, &group, &flight, &segment, &kind].into_iter().map(String::as_str).filter(|s| !s.is_empty()).collect();
    let caption = caption(from.estimates, &model, &group, &segment, &label.join(" / "));
    (Maneuver { label: label.join(" / "), caption, start: short(start), end: short(end), outputs, inputs }, thinned)
}

/// The row of `residuals` about one output of one segment, or of the whole group.
fn residual_row(residuals: &Columns, key: &[String], output: &str) -> Option<usize> {
    let [model, group, segment] = [0, 1, 2].map(|i| key.get(i).map_or("", String::as_str));
    let own = |row: &usize| {
        residuals.text("model", *row) == model && residuals.text("group", *row) == group && residuals.text("output", *row) == output
    };
    let rows: Vec<usize> = (0..residuals.rows()).filter(own).collect();
    rows.iter().find(|&&row| residuals.text("segment", row) == segment).or(rows.first()).copied()
}

fn caption(estimates: Option<&Columns>, model: &str, group: &str, segment: &str, label: &str) -> String {
    let stop = estimates.and_then(|e| {
        let own = |row: &usize| e.text("model", *row) == model && e.text("group", *row) == group;
        let rows: Vec<usize> = (0..e.rows()).filter(own).collect();
        let row = rows.iter().find(|&&row| e.text("segment", row) == segment).or(rows.first())?;
        Some(e.text("stop", *row))
    });
    stop.filter(|s| !s.is_empty()).map_or(label.to_string(), |stop| format!("{label}: {stop}"))
}

fn inputs(samples: &Columns, flight: &str, span: (f64, f64), names: &[String], limit: usize) -> Vec<Input> {
    let time = samples.column("t_s");
    let inside =
        |row: &usize| time.get(*row).is_some_and(|t| *t >= span.0 && *t <= span.1) && samples.text("flight", *row) == flight;
    let rows: Vec<usize> = (0..samples.rows()).filter(inside).collect();
    let t = pick(time, &rows);
    let curve = |name: &String| {
        let value = pick(samples.column(name), &rows);
        if !value.iter().any(|v| v.is_finite()) {
            return None;
        }
        let keep = thin(t.len(), &[&value], limit / 2);
        let (factor, unit) = display_unit(samples.unit(name));
        Some(Input { name: name.clone(), unit, t: times(&pick(&t, &keep)), value: shorts(pick(&value, &keep), factor) })
    };
    names.iter().filter_map(curve).collect()
}

fn pick(values: &[f64], rows: &[usize]) -> Vec<f64> {
    rows.iter().map(|&i| values.get(i).copied().unwrap_or(f64::NAN)).collect()
}

/// Times to the millisecond: six digits would not do for a long flight.
pub fn times(t: &[f64]) -> Vec<Option<f64>> {
    t.iter().map(|t| t.is_finite().then(|| (t * 1e3).round() / 1e3)).collect()
}

/// A row of the table of matches; `residual` is the row of `residuals` about the same output.
fn match_of(
    responses: &Columns,
    key: &[String],
    output: &str,
    rows: &[usize],
    residual: Option<(&Columns, usize)>,
    picked: &str,
) -> (Row, Match) {
    let [measured, modelled] = ["measured", "modelled"].map(|c| pick(responses.column(c), rows));
    let pairs: Vec<(f64, f64)> = measured.iter().copied().zip(modelled).filter(|(z, y)| z.is_finite() && y.is_finite()).collect();
    let n = pairs.len() as f64;
    let mean = pairs.iter().map(|(z, _)| z).sum::<f64>() / n;
    let rms = (pairs.iter().map(|(z, y)| (z - y) * (z - y)).sum::<f64>() / n).sqrt();
    let variation = (pairs.iter().map(|(z, _)| (z - mean) * (z - mean)).sum::<f64>() / n).sqrt();
    let misfit = rms / variation;
    let [model, group, segment] = [0, 1, 2].map(|i| key.get(i).cloned().unwrap_or_default());
    let unit = residual.map_or(String::new(), |(table, row)| table.text("unit", row));
    let name = format!("{output} of {segment}");
    let cells = vec![
        model.into(),
        group.into(),
        segment.into(),
        output.into(),
        plain(n, 0).into(),
        Cell::new(format!("{} {unit}", number(rms, 3))),
        Cell::new(plain(100.0 * misfit, 1)).level_if(misfit > POOR, Level::Warn),
        number(residual.map_or(f64::NAN, |(table, row)| table.number("colour", row)), 3).into(),
    ];
    (Row { pick: Some(picked.into()), cells, level: None }, Match { name, misfit })
}

/// A residual above this part of the measured variation is a poor match.
pub const POOR: f64 = 0.25;

/// The sentence of the checks about the match of the time histories.
pub fn summary(matches: &[Match]) -> Option<(Level, String)> {
    let worst = matches.iter().filter(|m| m.misfit.is_finite()).max_by(|a, b| a.misfit.total_cmp(&b.misfit))?;
    let poor = matches.iter().filter(|m| m.misfit > POOR).count();
    let worst = format!("the worst is {} with {:.1}%", worst.name, 100.0 * worst.misfit);
    Some(if poor == 0 {
        (
            Level::Good,
            format!("Modelled and measured outputs differ by less than {:.0}% of the measured variation; {worst}.", 100.0 * POOR),
        )
    } else {
        (
            Level::Warn,
            format!(
                "{} differ from the measured by more than {:.0}% of its variation; {worst}.",
                count(poor, "modelled output"),
                100.0 * POOR
            ),
        )
    })
}
