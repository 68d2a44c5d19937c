//! `figures` in, the figures that the pipeline file asks for, each with a sentence computed from its
//! numbers, out.

use super::columns::Columns;
use super::format::{count, display_unit, number, plain, thin};
use super::packed::Packed;
use super::place::On;
use super::section::{Body, Given, Section};
use crate::error::Result;
use crate::math::interpolate::held;
use serde::Serialize;
use std::collections::BTreeMap;

pub const SECTION: Section =
    Section { id: "figures", heading: "Figures", on: On::Index, tables: &["figures"], build };

/// Points drawn of one series, at most about.
const LIMIT: usize = 2000;
/// And at least.
const LEAST: usize = 40;

/// One figure (JSON).
#[derive(Debug, Serialize)]
struct Figure {
    x: Axis,
    y: Axis,
    series: Vec<Drawn>,
}

#[derive(Debug, Serialize)]
struct Axis {
    title: String,
    unit: String,
}

#[derive(Debug, Serialize)]
struct Drawn {
    label: String,
    kind: String,
    x: Packed,
    y: Packed,
    /// Ends of bars or bands; empty where there are none.
    lower: Packed,
    upper: Packed,
}

#[derive(Debug, Serialize)]
struct Caption {
    title: String,
    facts: Vec<String>,
}

#[derive(Debug, Serialize)]
struct Shown {
    figures: Vec<Caption>,
}

/// One series as it stands in the table.
struct Series {
    label: String,
    kind: String,
    x: Vec<f64>,
    y: Vec<f64>,
    ends: [Vec<f64>; 2],
}

fn build(given: &Given) -> Result<Option<Body>> {
    let template = include_str!("html/figures.html");
    let Some(table) = given.get("figures").filter(|table| table.rows() > 0) else {
        return Ok(Some(Body::new(template, Shown { figures: Vec::new() })));
    };
    let (mut captions, mut figures) = (Vec::new(), Vec::new());
    // Packed numbers take a third of the room.
    let limit = shared(given.room().count(12, 1), &table.rows_by(["figure", "series"]));
    for ([_], rows) in table.groups(["figure"]) {
        let all = series(table, &rows);
        let text = |name: &str| table.text(name, rows[0]);
        let (fx, x_unit) = display_unit(&text("x_unit"));
        let (fy, y_unit) = display_unit(&text("y_unit"));
        let mut facts = facts(&all, (fx, &x_unit), (fy, &y_unit));
        facts.extend(thinned(&all, limit));
        captions.push(Caption { title: text("title"), facts });
        figures.push(Figure {
            x: Axis { title: text("x_title"), unit: x_unit },
            y: Axis { title: text("y_title"), unit: y_unit },
            series: all.iter().map(|one| drawn(one, fx, fy, limit)).collect(),
        });
    }
    Body::new(template, Shown { figures: captions }).plot("figures", &figures).map(Some)
}

/// What is said where not all points are drawn.
fn thinned(all: &[Series], limit: usize) -> Option<String> {
    let longest = all.iter().map(|one| one.x.len()).max().filter(|n| *n > limit)?;
    Some(format!(
        "Of the {longest} points of the longest series about {limit} are drawn, smallest and largest kept; the table figures has all."
    ))
}

/// Points drawn of every series where all of them share room for so many numbers: those of short ones are
/// left to the long ones.
fn shared(room: usize, series: &BTreeMap<[String; 2], Vec<usize>>) -> usize {
    let mut lengths: Vec<usize> = series.values().map(|rows| rows.len().min(LIMIT)).collect();
    lengths.sort_unstable();
    // At most four numbers a point.
    let (mut left, mut others) = (room / 4, lengths.len());
    for length in lengths {
        let each = left / others;
        if each < length {
            return each.max(LEAST);
        }
        (left, others) = (left - length, others - 1);
    }
    LIMIT
}

fn series(table: &Columns, rows: &[usize]) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for of in rows.chunk_by(|a, b| table.number("series", *a) == table.number("series", *b)) {
        let column = |name: &str| of.iter().map(|&row| table.number(name, row)).collect();
        all.push(Series {
            label: table.text("label", of[0]),
            kind: table.text("kind", of[0]),
            x: column("x"),
            y: column("y"),
            ends: [column("lower"), column("upper")],
        });
    }
    all
}

fn drawn(one: &Series, fx: f64, fy: f64, limit: usize) -> Drawn {
    let keep = thin(one.x.len(), &[&one.y], limit);
    let of = |values: &[f64], factor| Packed::of(keep.iter().map(|&k| values[k]), factor);
    let ends = |values: &[f64]| match values.iter().any(|v| v.is_finite()) {
        true => of(values, fy),
        false => Packed::default(),
    };
    Drawn {
        label: one.label.clone(),
        kind: one.kind.clone(),
        x: of(&one.x, fx),
        y: of(&one.y, if one.kind == "strips" { fx } else { fy }),
        lower: ends(&one.ends[0]),
        upper: ends(&one.ends[1]),
    }
}

/// What the numbers say: how many points and where, and how far they are from each reference.
fn facts(all: &[Series], (fx, x_unit): (f64, &str), (fy, y_unit): (f64, &str)) -> Vec<String> {
    let points: Vec<&Series> = all.iter().filter(|s| s.kind == "points").collect();
    let n: usize = points.iter().map(|s| s.x.len()).sum();
    let range = |of: &dyn Fn(&Series) -> Vec<f64>, factor: f64, unit: &str| {
        let values: Vec<f64> = all.iter().filter(|s| is_own(s)).flat_map(of).collect();
        let low = values.iter().copied().fold(f64::NAN, f64::min);
        let high = values.iter().copied().fold(f64::NAN, f64::max);
        format!("{} to {} {unit}", number(factor * low, 3), number(factor * high, 3))
    };
    let curves = all.iter().filter(|s| is_own(s)).count();
    let what = if n > 0 { count(n, "point") } else { count(curves, "curve") };
    let mut facts = vec![format!(
        "{what}, {} over {}.",
        range(&|s| s.y.clone(), fy, y_unit).trim_end(),
        range(&|s| s.x.clone(), fx, x_unit).trim_end()
    )];
    for reference in all.iter().filter(|s| s.kind == "reference" && s.x.len() > 1) {
        facts.extend(distance(&points, reference, fy, y_unit));
        let bands = all.iter().filter(|s| s.kind == "line");
        facts.extend(bands.filter_map(|band| held_by(band, reference, (fx, x_unit))));
    }
    let measured = all.iter().filter(|s| s.label == "measured");
    for one in measured {
        let others = all.iter().filter(|s| is_own(s) && s.label != one.label);
        facts.extend(others.filter_map(|other| difference(one, other, fy, y_unit)));
    }
    facts
}

/// Whether a series has values of the figure's own, along its ordinate.
fn is_own(series: &Series) -> bool {
    !["reference", "strips"].contains(&series.kind.as_str())
}

/// Whether a band holds a reference, and where it misses it by most.
fn held_by(band: &Series, reference: &Series, (fx, x_unit): (f64, &str)) -> Option<String> {
    let [low, high] = &band.ends;
    let ratio = |k: usize| {
        let off = held(&reference.x, &reference.y, band.x[k]) - band.y[k];
        let half = if off > 0.0 { high[k] - band.y[k] } else { band.y[k] - low[k] };
        off.abs() / half
    };
    let all = (0..band.x.len()).filter(|k| ratio(*k).is_finite());
    let farthest = all.max_by(|a, b| ratio(*a).total_cmp(&ratio(*b)))?;
    let (ratio, x) = (plain(ratio(farthest), 2), number(fx * band.x[farthest], 3));
    let at = format!("{ratio} half-widths from its middle at {x} {x_unit}").replace(" -", " ");
    let (band, of) = (&band.label, &reference.label);
    Some(match ratio_is_inside(&ratio) {
        true => format!("The band of {band} holds {of} everywhere, at most {at}."),
        false => format!("The band of {band} does not hold {of} everywhere: it is {at}."),
    })
}

/// As it is written, so that sentence and number agree.
fn ratio_is_inside(ratio: &str) -> bool {
    ratio.parse::<f64>().is_ok_and(|ratio| ratio <= 1.0)
}

/// How far what is modelled is from what was measured, where both have the same abscissae.
fn difference(measured: &Series, other: &Series, factor: f64, unit: &str) -> Option<String> {
    let there = |k: &usize| (measured.y[*k] - other.y[*k]).is_finite();
    let same = measured.x == other.x;
    let all: Vec<usize> = (0..measured.x.len()).filter(|k| same && there(k)).collect();
    let square = |k: &usize| (measured.y[*k] - other.y[*k]) * (measured.y[*k] - other.y[*k]);
    let rms = (all.iter().map(square).sum::<f64>() / all.len() as f64).sqrt();
    let text =
        format!("r.m.s. of measured less {}: {} {unit}", other.label, number(factor * rms, 2));
    (!all.is_empty()).then(|| format!("{}.", text.trim_end()))
}

/// How far points are from a reference, and how many of their bars hold it.
fn distance(points: &[&Series], reference: &Series, factor: f64, unit: &str) -> Option<String> {
    let (mut square, mut n, mut bars, mut holding) = (0.0, 0usize, 0usize, 0usize);
    for one in points {
        for k in 0..one.x.len() {
            let there = held(&reference.x, &reference.y, one.x[k]);
            square += (one.y[k] - there) * (one.y[k] - there);
            n += 1;
            let [low, high] = [one.ends[0][k], one.ends[1][k]];
            bars += usize::from(low.is_finite() && high.is_finite());
            holding += usize::from(low <= there && there <= high);
        }
    }
    let rms = factor * (square / n as f64).sqrt();
    let bars = (bars > 0).then(|| {
        let percent = plain(100.0 * holding as f64 / bars as f64, 0);
        format!(", which {holding} of {bars} intervals hold ({percent}%)")
    });
    (n > 0).then(|| {
        format!(
            "r.m.s. distance from {}: {} {unit}{}.",
            reference.label,
            number(rms, 2),
            bars.unwrap_or_default()
        )
        .replace(" ,", ",")
        .replace(" .", ".")
    })
}
