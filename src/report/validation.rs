//! `validation`, `validation_traces` and `tolerances` in; how well held values tell maneuvers that
//! they were not found from, as tables and as time histories with the predicted interval, out.

use super::columns::Columns;
use super::format::{count, display_unit, number, plain, thin, times};
use super::grid::{Cell, Grid, Level, Row};
use super::packed::Packed;
use super::place::{Form, On};
use super::section::{Body, Given, Section};
use super::tolerances;
use crate::error::Result;
use crate::math::distribution::INTERVAL_95;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "validation",
    heading: "Validation: maneuvers that were not used",
    on: On::Both,
    tables: &["validation", "validation_traces", "tolerances"],
    build,
};

/// Samples drawn per curve, at most about.
const LIMIT: usize = 800;

/// One maneuver of one validation (JSON).
#[derive(Debug, Serialize)]
struct Maneuver {
    label: String,
    outputs: Vec<Output>,
}

/// `lower` and `upper`: ends of the interval in which the model expects the measurement.
#[derive(Debug, Serialize)]
struct Output {
    name: String,
    unit: String,
    t: Packed,
    measured: Packed,
    modelled: Packed,
    lower: Packed,
    upper: Packed,
    /// Predicted one sample ahead; none where no noise drives the states.
    ahead: Option<Packed>,
    /// First and last time of each stretch in which lines are taken outside their points.
    beyond: Vec<[Option<f64>; 2]>,
}

#[derive(Debug, Serialize)]
struct Shown {
    missing: bool,
    /// Whether there are histories to draw.
    drawn: bool,
    table: Grid,
    summary: String,
    /// What is used of tolerances, and the sentence about it; none without tolerances.
    tolerances: Option<Grid>,
    judged: Option<String>,
}

fn build(given: &Given) -> Result<Option<Body>> {
    let template = include_str!("html/validation.html");
    let (rows, traces) = (given.get("validation"), given.get("validation_traces"));
    let Some(rows) = rows.filter(|rows| rows.rows() > 0) else {
        // Of most flights nothing is to be validated.
        if let Form::Flight(_) = given.input.form {
            return Ok(None);
        }
        let table = Grid::new([] as [&str; 0]);
        let (tolerances, judged) = (None, None);
        let shown = Shown {
            missing: true,
            drawn: false,
            table,
            summary: String::new(),
            tolerances,
            judged,
        };
        return Ok(Some(Body::new(template, shown)));
    };
    let limit = given.room().samples(LIMIT, 1, 5 * rows.rows());
    let (mut table, mut all) = (grid(traces.is_some()), Vec::new());
    let mut good = 0;
    for ([validation, segment], of) in rows.groups(["validation", "segment"]) {
        let mut outputs = Vec::new();
        for row in of {
            good += usize::from(rows.text("verdict", row) == "good");
            table.rows.push(line(rows, row, traces.map(|_| format!("v{}", all.len()))));
            outputs.extend(traces.map(|traces| output(rows, row, traces, limit)));
        }
        all.extend(
            traces.map(|_| Maneuver { label: format!("{validation} / {segment}"), outputs }),
        );
    }
    let mut summary = format!("{good} of {} are good.", count(rows.rows(), "output"));
    summary.extend(noise(rows));
    let judged = given.get("tolerances").filter(|judged| judged.rows() > 0);
    let (tolerances, judged) =
        (judged.map(tolerances::grid), tolerances::summary(judged).map(|(_, text)| text));
    Body::new(
        template,
        Shown { missing: false, drawn: traces.is_some(), table, summary, tolerances, judged },
    )
    .plot("validations", &all)
    .map(Some)
}

/// How many outputs are told but for the sensor's noise, of those whose noise is known.
fn noise(rows: &Columns) -> Option<String> {
    let of = |verdict: &str| {
        (0..rows.rows()).filter(|&row| rows.text("noise_verdict", row) == verdict).count()
    };
    let (noise, left, more) = (of("noise"), of("as the estimate leaves"), of("more than noise"));
    let all = noise + left + more;
    let as_left = match left {
        0 => String::new(),
        _ => format!(
            " In {left} as much is left as the estimate leaves of its own maneuvers, which is more than the sensor's noise."
        ),
    };
    (all > 0).then(|| {
        format!(
            " In {noise} of {} nothing is left but the sensor's noise.{as_left}",
            count(all, "output")
        )
    })
}

fn grid(drawn: bool) -> Grid {
    let mut table = Grid::new([
        "validation",
        "~maneuver",
        "output",
        "~verdict",
        "#r.m.s.",
        "#fit|%",
        "#Theil",
        "#bias / variance / covariance",
        "#largest error",
        "#within|%",
        "smoothed residuals",
    ]);
    let click = if drawn { "Click a row to see its time history. " } else { "" };
    table.note = Some(format!(
        "{click}Fit is 1 - r.m.s./s with the standard deviation s of what was measured. Theil's coefficient is 0 \
         for equal signals, 1 for unrelated ones; its three parts say how much of the error is a shift, another size, another form. Within: \
         share of the samples inside the interval that the model predicts for them. Smoothed residuals: whether 95% of their moving averages are \
         within three standard deviations of what the noise of the estimate leaves of them. Under a maneuver: what was estimated in it. Grey in a time history: lines are taken outside the points \
         that they go through."
    ));
    table
}

fn line(rows: &Columns, row: usize, pick: Option<String>) -> Row {
    let (factor, unit) = display_unit(&rows.unit_in("unit", row));
    let of = |name: &str| rows.number(name, row);
    let with_unit = |value: f64| format!("{} {unit}", number(factor * value, 3));
    let percent = |value: f64| plain(100.0 * value, 0);
    let verdict = rows.text("verdict", row);
    let level = if verdict == "good" { Level::Good } else { Level::Warn };
    let parts = ["theil_bias", "theil_variance", "theil_covariance"].map(|name| percent(of(name)));
    let mut noise = format!(
        "noise {}, carried {}",
        number(factor * of("noise_sd"), 2),
        number(factor * of("carried_sd"), 2)
    );
    if of("driven_sd").is_finite() {
        noise += &format!(", driven {}", number(factor * of("driven_sd"), 2));
    }
    Row {
        level: None,
        pick,
        cells: vec![
            rows.text("validation", row).into(),
            Cell { text: rows.text("segment", row), sub: under(rows, row), level: None },
            rows.text("output", row).into(),
            Cell { text: verdict, sub: None, level: Some(level) },
            Cell { text: with_unit(of("rms")), sub: Some(noise), level: None },
            percent(of("fit")).into(),
            plain(of("theil"), 3).into(),
            parts.join(" / ").into(),
            with_unit(of("largest")).into(),
            percent(of("within")).into(),
            smoothed(rows, row),
        ],
    }
}

fn output(rows: &Columns, row: usize, traces: &Columns, limit: usize) -> Output {
    let key = ["validation", "segment", "output"];
    let own = key.map(|name| rows.text(name, row));
    let of = traces.rows_by(key).remove(&own).unwrap_or_default();
    let pick = |name: &str| of.iter().map(|&k| traces.number(name, k)).collect::<Vec<f64>>();
    let [t, measured, modelled, sd, band] =
        ["t_s", "measured", "modelled", "carried_sd", "band"].map(pick);
    let [driven, ahead] = ["driven_sd", "ahead"].map(pick);
    let noise = rows.number("noise_sd", row);
    let half = |k: usize| {
        let driven = if driven[k].is_finite() { driven[k] } else { 0.0 };
        band[k] + INTERVAL_95 * (sd[k] * sd[k] + driven * driven + noise * noise).sqrt()
    };
    let is_driven = ahead.iter().any(|y| y.is_finite());
    let keep = thin(t.len(), &[&measured, &modelled], limit);
    let (factor, unit) = display_unit(&rows.unit_in("unit", row));
    let drawn = |of: &dyn Fn(usize) -> f64| Packed::of(keep.iter().map(|&k| of(k)), factor);
    Output {
        name: own[2].clone(),
        unit,
        t: Packed::of(keep.iter().map(|&k| t[k]), 1.0),
        measured: drawn(&|k| measured[k]),
        modelled: drawn(&|k| modelled[k]),
        lower: drawn(&|k| modelled[k] - half(k)),
        upper: drawn(&|k| modelled[k] + half(k)),
        ahead: is_driven.then(|| drawn(&|k| ahead[k])),
        beyond: stretches(
            &t,
            &of.iter().map(|&k| traces.flag("beyond", k) == Some(true)).collect::<Vec<_>>(),
        ),
    }
}

/// First and last time of each stretch of true ones.
fn stretches(t: &[f64], those: &[bool]) -> Vec<[Option<f64>; 2]> {
    let ends = |range: &[usize]| times(&[t[range[0]], t[range[range.len() - 1]]]);
    let all: Vec<usize> = (0..t.len()).collect();
    all.chunk_by(|a, b| those[*a] == those[*b])
        .filter(|range| those[range[0]])
        .map(|range| [ends(range)[0], ends(range)[1]])
        .collect()
}

/// What was estimated in a maneuver, at the first of its outputs, and where lines were taken outside their
/// points.
fn under(rows: &Columns, row: usize) -> Option<String> {
    let own = |row: usize| ["validation", "segment"].map(|name| rows.text(name, row));
    if row > 0 && own(row - 1) == own(row) {
        return None;
    }
    let beyond = rows.flag("beyond", row) == Some(true);
    let beyond = beyond.then(|| outside(rows.number("outside", row)));
    let followed = Some(rows.text("followed", row)).filter(|text| !text.is_empty());
    let all: Vec<String> = beyond.into_iter().chain(followed).collect();
    (!all.is_empty()).then(|| all.join("; "))
}

/// Whether what is left is noise, and the share of it that is.
fn smoothed(rows: &Columns, row: usize) -> Cell {
    let verdict = rows.text("noise_verdict", row);
    let level = if verdict == "noise" { Level::Good } else { Level::Warn };
    match verdict.as_str() {
        "" => Cell::new("unknown"),
        _ => Cell::new(verdict)
            .under(format!("{}%", plain(100.0 * rows.number("smoothed", row), 0)))
            .level(level),
    }
}

/// Where lines were taken outside their points.
fn outside(share: f64) -> String {
    format!("{:.0}% of it outside the lines' points", 100.0 * share)
}
