//! `budget`, `doubts`, `separability`, `repeats`, `profiles` and `estimates` in, what a reader should know of
//! the uncertainties out.

use super::columns::Columns;
use super::doubts::doubts;
use super::format::{bracketed, count, number, plus_minus, shorts};
use super::grid::{Cell, Grid, Level};
use super::maneuvers::name;
use super::place::On;
use super::repeats::repeats;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;

pub const SECTION: Section = Section {
    id: "uncertainty",
    heading: "What the uncertainties are made of",
    on: On::Index,
    tables: &["budget", "doubts", "separability", "repeats", "profiles", "estimates"],
    build,
};

fn build(given: &Given) -> Result<Option<Body>> {
    let (mut section, mut profiles) = uncertainty(|table| given.get(table));
    section.left = profiles.len().saturating_sub(given.room().rows);
    profiles.truncate(given.room().rows);
    section.profiles.truncate(given.room().rows);
    Body::new(include_str!("html/uncertainty.html"), section).plot("profiles", &profiles).map(Some)
}

/// The section of the page.
#[derive(Debug, Serialize)]
pub struct Uncertainty {
    pub budget: Grid,
    pub assumed: Grid,
    pub doubts: Grid,
    pub separability: Grid,
    pub repeats: Grid,
    pub profiles: Vec<Caption>,
    /// Profiles that are not drawn.
    pub left: usize,
}

#[derive(Debug, Serialize)]
pub struct Caption {
    pub index: usize,
    pub text: String,
}

/// What the plot of one profile is drawn from (JSON).
#[derive(Debug, Serialize)]
pub struct ProfilePlot {
    pub index: usize,
    pub parameter: String,
    pub unit: String,
    pub value: Vec<Option<f64>>,
    pub rise: Vec<Option<f64>>,
    pub limit: f64,
}

/// Contributors shown per parameter.
const SHOWN: usize = 3;
/// The section and its plots.
fn uncertainty<'a>(get: impl Fn(&str) -> Option<&'a Columns>) -> (Uncertainty, Vec<ProfilePlot>) {
    let (profiles, plots) = profiles(get("profiles"), get("estimates"));
    (
        Uncertainty {
            budget: budget(get("budget")),
            assumed: assumed(get("budget")),
            doubts: doubts(get("doubts")),
            separability: separability(get("separability")),
            repeats: repeats(get("repeats")),
            profiles,
            left: 0,
        },
        plots,
    )
}

/// Per model and parameter (mean over its estimates, since a constant's share hardly changes from
/// one to the next) who contributes most.
fn budget(table: Option<&Columns>) -> Grid {
    let none = "No assumed constant with a standard deviation moves these estimates (or none was given one).";
    let Some(table) = table.filter(|t| t.rows() > 0) else { return Grid::missing(none) };
    let mut grid =
        Grid::new(["model", "parameter", "#noise", "~largest assumed constants", "#sd_total / sd"]);
    for ([model, parameter], rows) in table.groups(["model", "parameter"]) {
        if parameter.ends_with("(0)") {
            continue;
        }
        let mut shares: Vec<(String, f64)> = Vec::new();
        let mut estimates = 0.0;
        for &row in &rows {
            let constant = table.text("constant", row);
            estimates += if constant.is_empty() { 1.0 } else { 0.0 };
            match shares.iter_mut().find(|(name, _)| *name == constant) {
                Some(share) => share.1 += table.number("share", row),
                None => shares.push((constant, table.number("share", row))),
            }
        }
        shares.iter_mut().for_each(|share| share.1 /= f64::max(estimates, 1.0));
        let noise = shares.iter().find(|s| s.0.is_empty()).map_or(0.0, |s| s.1);
        shares.retain(|s| !s.0.is_empty());
        shares.sort_by(|a, b| b.1.total_cmp(&a.1));
        let largest: Vec<String> = shares
            .iter()
            .take(SHOWN)
            .map(|(name, share)| format!("{} {name} {}", bar(*share), percent(*share)))
            .collect();
        let ratio = 1.0 / noise.sqrt();
        grid.push(vec![
            model.into(),
            parameter.into(),
            Cell::new(percent(noise)),
            Cell::new(largest.join("   ")),
            Cell::new(number(ratio, 2)).level_if(ratio > 2.0, Level::Warn),
        ]);
    }
    grid.note = Some(
        "Shares of the square of sd_total, mean over the estimates. An error of a constant is the same in all maneuvers: more flights do \
         not reduce it, and the scatter of repeats does not show it. What the flight path was reconstructed with (places of vanes) and what \
         conditions are made of is not in it."
            .into(),
    );
    grid.or_missing(none)
}

/// The assumed constants, each once per value, and where they come from.
fn assumed(table: Option<&Columns>) -> Grid {
    let mut grid = Grid::new(["constant", "#value", "unit", "~where it comes from"]);
    let Some(table) = table else { return grid };
    let mut seen: Vec<[String; 2]> = Vec::new();
    let mut order: Vec<usize> = (0..table.rows()).collect();
    order.sort_by_key(|&row| table.text("constant", row));
    for row in order {
        let (name, source) = (table.text("constant", row), table.text("constant_source", row));
        let (value, sd) = (table.number("constant_value", row), table.number("constant_sd", row));
        if !sd.is_finite() || seen.contains(&[name.clone(), source.clone()]) {
            continue;
        }
        grid.push(vec![
            name.as_str().into(),
            Cell::new(plus_minus(value, sd)),
            table.text("constant_unit", row).into(),
            if source.is_empty() { "the model's file".into() } else { source.as_str().into() },
        ]);
        seen.push([name, source]);
    }
    grid
}

/// A share as a bar of up to ten blocks.
fn bar(share: f64) -> String {
    "█".repeat(((10.0 * share).round().clamp(0.0, 10.0) as usize).max(1))
}

fn percent(share: f64) -> String {
    let value = 100.0 * share;
    if value > 0.0 && value < 0.1 { "< 0.1 %".into() } else { format!("{value:.1} %") }
}

/// Verdicts that are not simply "separable".
fn separability(table: Option<&Columns>) -> Grid {
    let Some(table) = table.filter(|t| t.rows() > 0) else {
        return Grid::missing("Nothing was estimated.");
    };
    let mut grid = Grid::new(["model", "maneuvers", "verdict", "~what it says", "#condition"]);
    let mut good = 0;
    for ([model, group, _, verdict], rows) in table.groups(["model", "group", "number", "verdict"])
    {
        let Some(&row) = rows.first() else { continue };
        if verdict == "separable" {
            good += 1;
            continue;
        }
        // What is said of a segment, not of a parameter, names it.
        let about = if table.text("parameter", row).is_empty() {
            table.text("segment", row)
        } else {
            String::new()
        };
        let level = match verdict.as_str() {
            "significant" | "not significant" | "not observable" => Level::Info,
            "not reached" | "not determined" | "at a bound" | "hardly separable"
            | "doubtful output" | "stuck throughout" => Level::Warn,
            _ => Level::Bad,
        };
        let condition = table.number("condition", row);
        let shown = if condition.is_finite() { format!("{condition:.1e}") } else { String::new() };
        grid.push(vec![
            model.into(),
            name(&group, &about).into(),
            Cell::new(verdict).level(level),
            table.text("text", row).into(),
            shown.into(),
        ]);
    }
    grid.note =
        Some(format!("In {} the data determine all parameters.", count(good, "estimation")));
    let all =
        if good == 1 { "the estimation".to_string() } else { format!("all {good} estimations") };
    grid.or_missing(&format!("In {all} the data determine all parameters."))
}

fn profiles(
    table: Option<&Columns>,
    estimates: Option<&Columns>,
) -> (Vec<Caption>, Vec<ProfilePlot>) {
    let (mut captions, mut plots) = (Vec::new(), Vec::new());
    let Some(table) = table.filter(|t| t.rows() > 0) else { return (captions, plots) };
    for ([model, group, of, parameter], rows) in table.groups(["model", "group", "of", "parameter"])
    {
        let Some(&first) = rows.first() else { continue };
        let index = plots.len();
        let column = |name: &str| shorts(rows.iter().map(|&r| table.number(name, r)), 1.0);
        let unit = table.unit_in("unit", first);
        let key = [&model, &group, &of, &parameter];
        let same = |t: &Columns, row: usize| {
            ["model", "group", "of", "parameter"].iter().zip(key).all(|(c, k)| t.text(c, row) == *k)
        };
        let interval = estimates
            .and_then(|t| (0..t.rows()).find(|&row| same(t, row)).map(|row| interval(t, row)))
            .unwrap_or_default();
        captions.push(Caption {
            index,
            text: format!("{parameter} of {} ({model}): {interval}", name(&group, &of)),
        });
        plots.push(ProfilePlot {
            index,
            parameter,
            unit,
            value: column("value"),
            rise: column("rise"),
            limit: table.number("limit", first),
        });
    }
    (captions, plots)
}

fn interval(estimates: &Columns, row: usize) -> String {
    let end = |name: &str| {
        Some(estimates.number(name, row))
            .filter(|v| v.is_finite())
            .map_or("open".to_string(), |v| number(v, 4))
    };
    let words = estimates.text("interval", row);
    let value = number(estimates.number("value", row), 4);
    let open = if words == "closed" { String::new() } else { format!(" ({words})") };
    format!(
        "{value}, 95% interval {} to {}{open}{}",
        end("lower"),
        end("upper"),
        bracketed(&estimates.unit_in("unit", row))
    )
}
