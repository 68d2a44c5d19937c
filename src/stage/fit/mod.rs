//! Estimates per maneuver and the trimmed conditions come in; straight lines through them, bands
//! and the points go out.

mod config;

use super::correlations::Correlations;
use super::estimate::{WITH, reads_of};
use super::{Campaign, Inputs, Note, Output, Read, Severity, Stage, Unit, slice_of};
use crate::config::list;
use crate::error::{Errors, Result};
use crate::fit::{self, Band, LineFit, Points, Shared, Unfit};
use crate::table::{Table, campaign};
use serde_json::Value;
use std::collections::BTreeMap;

pub use config::{Config, Settings};

pub const STAGE: Stage = Stage {
    name: "fit",
    about: "fit straight lines",
    units: |campaign| Unit::entries(campaign.fits.iter().map(Config::name)),
    writes: &["fits", "bands", "points", "line_correlations"],
    reads,
    slice,
    run,
    ..Stage::PLAIN
};

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    campaign.fits.get(unit.index).map(|f| slice_of(&f.settings)).unwrap_or_default()
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let estimate = campaign.fits.get(unit.index).map_or(0, |f| f.estimate);
    let mut all = reads_of(&["estimates", "budget", "correlations"], campaign, estimate);
    // Of an estimate over all flights there is one part, and without it no line.
    let whole = campaign.estimates.get(estimate).is_some_and(|config| !config.is_by_flight());
    let needed = all.iter_mut().filter(|read| whole && read.table == "estimates");
    needed.for_each(|read| read.optional = false);
    all.extend(Read::flights(&["segments", "conditions"], campaign));
    all
}

/// A line through the points of one parameter.
struct Line<'a> {
    parameter: &'a str,
    unit: &'a str,
    points: Table,
    /// What the points have in common.
    shared: Vec<Shared>,
    fit: std::result::Result<LineFit, Unfit>,
    /// Variances of slope and intercept by assumed constants.
    assumed: (f64, f64),
    bands: Vec<Band>,
}

impl Line<'_> {
    fn places(&self) -> Result<Points<'_>> {
        let (x, sd) = (self.points.f64("x")?, self.points.f64("sd")?);
        Ok(Points { x, sd, shared: &self.shared })
    }
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = campaign.fits.get(unit.index) else { return Ok(Output::default()) };
    let settings = &config.settings;
    let Some(estimates) = inputs.numbered("estimates", config.estimate)? else {
        return Ok(Output::default());
    };
    let (segments, conditions) = (inputs.all("segments")?, inputs.all("conditions")?);
    let known = inputs.numbered("correlations", config.estimate)?;
    let known = known.as_ref().map(Correlations::read).transpose()?.unwrap_or_default();
    let budget = inputs.numbered("budget", config.estimate)?;
    let mut lines = Vec::new();
    let mut notes = Vec::new();
    for (parameter, unit) in settings.parameters.iter().zip(&config.units) {
        let (model, against) = (&settings.estimate, &settings.against);
        let wanted = campaign::Line { model, parameter, against, fit: &config.name() };
        let found =
            campaign::points(std::slice::from_ref(&estimates), &segments, &conditions, wanted)?;
        let mut line = line(config, parameter, unit, found.table, &known)?;
        if let (Ok(fit), Some(budget)) = (&line.fit, &budget) {
            line.assumed = assumed(budget, &line, fit)?;
        }
        notes.extend(note(config, &line, &found.left_out));
        lines.push(line);
    }
    let points = Table::concat("points", &lines.iter().map(|l| &l.points).collect::<Vec<_>>())?;
    let tables = vec![
        ("fits", fits(config, &lines)?),
        ("bands", bands(config, &lines)?),
        ("points", points),
        ("line_correlations", together(config, &lines, &known)?),
    ];
    Ok(Output { tables, files: Vec::new(), notes })
}

fn line<'a>(
    config: &Config,
    parameter: &'a str,
    unit: &'a str,
    points: Table,
    known: &Correlations,
) -> Result<Line<'a>> {
    let (x, sd) = (points.f64("x")?, points.f64("sd")?);
    let shared = known.shared(parameter, &points.strings("segment")?, sd);
    let places = Points { x, sd, shared: &shared };
    let fit = fit::line(places, points.f64("value")?, &config.settings.method);
    let (low, high) = range(x);
    let last = config.settings.points.saturating_sub(1).max(1) as f64;
    let xs: Vec<f64> =
        (0..config.settings.points).map(|i| low + (high - low) * i as f64 / last).collect();
    let bands =
        fit.as_ref().map(|fit| fit::bands(fit, &xs, config.settings.level)).unwrap_or_default();
    Ok(Line { parameter, unit, points, shared, fit, assumed: (0.0, 0.0), bands })
}

/// What the assumed constants add to the variances of slope and intercept. A constant's error is
/// one and the same at all points; two that another pipeline estimated together have correlated ones.
fn assumed(budget: &Table, line: &Line, fit: &LineFit) -> Result<(f64, f64)> {
    let (names, constants) = (budget.strings("parameter")?, budget.opt_strings("constant")?);
    let (groups, segments) = (budget.strings("group")?, budget.opt_strings("segment")?);
    let (slopes, sds) = (budget.f64("sensitivity")?, budget.f64("constant_sd")?);
    let values = budget.f64("constant_value")?;
    let mine: Vec<usize> = (0..names.len())
        .filter(|&i| names[i] == line.parameter && constants[i].is_some())
        .collect();
    // How far an error of one sd of each constant moves slope and intercept.
    let mut moved: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    let mut pairs: BTreeMap<(&str, &str), f64> = BTreeMap::new();
    for &i in &mine {
        let Some(constant) = constants[i] else { continue };
        if let Some(pair) = constant.split_once(WITH) {
            pairs.insert(pair, values[i]);
            continue;
        }
        if moved.contains_key(constant) {
            continue;
        }
        let at = |segment: &&str| {
            let of = |i: &&usize| {
                constants[**i] == Some(constant) && segments[**i].unwrap_or(groups[**i]) == *segment
            };
            mine.iter().find(of).map_or(0.0, |&i| slopes[i] * sds[i])
        };
        let change: Vec<f64> = line.points.strings("segment")?.iter().map(at).collect();
        moved.insert(constant, fit::carried(fit, line.places()?, &change));
    }
    let mut added = moved.values().fold((0.0, 0.0), |sum, (a, b)| (sum.0 + a * a, sum.1 + b * b));
    for ((one, other), r) in pairs {
        if let (Some(one), Some(other)) = (moved.get(one), moved.get(other)) {
            added.0 += 2.0 * r * one.0 * other.0;
            added.1 += 2.0 * r * one.1 * other.1;
        }
    }
    Ok((added.0.max(0.0), added.1.max(0.0)))
}

/// Correlations of the lines of different parameters, whose points are estimated together.
fn together(config: &Config, lines: &[Line], known: &Correlations) -> Result<Table> {
    let mut rows: Vec<(&str, &str, &str, &str, f64)> = Vec::new();
    for (i, one) in lines.iter().enumerate() {
        for other in &lines[i + 1..] {
            let (Ok(a), Ok(b)) = (&one.fit, &other.fit) else { continue };
            let pairs =
                known.pairs((one.parameter, &one.points), (other.parameter, &other.points))?;
            let found = fit::correlations((a, one.places()?), (b, other.places()?), &pairs);
            for (term, of) in ["slope", "intercept"].into_iter().zip(found) {
                for (other_term, value) in ["slope", "intercept"].into_iter().zip(of) {
                    rows.push((one.parameter, term, other.parameter, other_term, value));
                }
            }
        }
    }
    rows.sort_by(|a, b| (a.0, a.1, a.2, a.3).cmp(&(b.0, b.1, b.2, b.3)));
    Table::build("line_correlations")
        .repeat("model", &config.settings.estimate)
        .repeat("against", &config.settings.against)
        .repeat("fit", &config.name())
        .strings("parameter", rows.iter().map(|r| r.0))
        .strings("term", rows.iter().map(|r| r.1))
        .strings("other", rows.iter().map(|r| r.2))
        .strings("other_term", rows.iter().map(|r| r.3))
        .f64("value", rows.iter().map(|r| r.4).collect::<Vec<_>>())
        .finish()
}

fn range(x: &[f64]) -> (f64, f64) {
    (x.iter().copied().fold(f64::NAN, f64::min), x.iter().copied().fold(f64::NAN, f64::max))
}

fn note(config: &Config, line: &Line, left_out: &[(String, String)]) -> Option<Note> {
    let of = format!("{} of {}", line.parameter, config.settings.estimate);
    let reasons: Vec<String> =
        left_out.iter().map(|(segment, why)| format!("{segment}: {why}")).collect();
    let (severity, count, text) = match &line.fit {
        Err(why) => (
            Severity::Missing,
            1,
            format!("{of}: no line against {}: {why}", config.settings.against),
        ),
        Ok(_) if left_out.is_empty() => return None,
        Ok(_) => (
            Severity::Warning,
            left_out.len() as u64,
            format!("{of}: not in the line are {}", list(&reasons)),
        ),
    };
    let stage = STAGE.name.to_string();
    Some(Note {
        flight: String::new(),
        stage,
        severity,
        subject: line.parameter.to_string(),
        count,
        text,
    })
}

/// Median of sd over value of the points: how well one maneuver tells the parameter.
fn relative(line: &Line) -> Result<f64> {
    let of =
        line.points.f64("value")?.iter().zip(line.points.f64("sd")?).map(|(v, sd)| sd / v.abs());
    Ok(crate::math::median(&of.filter(|r| r.is_finite()).collect::<Vec<f64>>()))
}

fn fits(config: &Config, lines: &[Line]) -> Result<Table> {
    let settings = &config.settings;
    let number = |of: fn(&LineFit) -> f64| {
        lines.iter().map(|l| l.fit.as_ref().map_or(f64::NAN, of)).collect::<Vec<f64>>()
    };
    let total = |of: fn(&LineFit) -> f64, by: fn(&(f64, f64)) -> f64| {
        let of = |l: &Line| {
            l.fit.as_ref().map_or(f64::NAN, |fit| (of(fit) * of(fit) + by(&l.assumed)).sqrt())
        };
        lines.iter().map(of).collect::<Vec<f64>>()
    };
    let relative = lines.iter().map(relative).collect::<Result<Vec<f64>>>()?;
    let ranges = lines.iter().map(|l| Ok(range(l.points.f64("x")?))).collect::<Result<Vec<_>>>()?;
    Table::build("fits")
        .repeat("model", &settings.estimate)
        .strings("parameter", lines.iter().map(|l| l.parameter))
        .repeat("against", &settings.against)
        .repeat("fit", &config.name())
        .strings("unit", lines.iter().map(|l| l.unit))
        .repeat("unit_x", &config.unit_x)
        .f64("slope", number(|f| f.slope))
        .f64("intercept", number(|f| f.intercept))
        .f64("slope_sd", number(|f| f.slope_sd))
        .f64("intercept_sd", number(|f| f.intercept_sd))
        .f64("slope_sd_total", total(|f| f.slope_sd, |assumed| assumed.0))
        .f64("intercept_sd_total", total(|f| f.intercept_sd, |assumed| assumed.1))
        .f64("covariance", number(|f| f.covariance))
        .i64("n", lines.iter().map(|l| l.points.rows() as i64).collect::<Vec<_>>())
        .f64("scatter_sd", number(|f| f.tau))
        .f64("relative_sd", relative.clone())
        .bools("poor", relative.iter().map(|r| *r > settings.poor).collect::<Vec<_>>())
        .f64("chi2", number(|f| f.reduced_chi_square * f.dof))
        .f64("x_min", ranges.iter().map(|r| r.0).collect::<Vec<_>>())
        .f64("x_max", ranges.iter().map(|r| r.1).collect::<Vec<_>>())
        .f64("level", vec![settings.level; lines.len()])
        .strings(
            "stop",
            lines.iter().map(|l| l.fit.as_ref().err().map_or("converged", |why| why.name())),
        )
        .finish()
}

fn bands(config: &Config, lines: &[Line]) -> Result<Table> {
    let rows: Vec<(&str, &Band)> =
        lines.iter().flat_map(|l| l.bands.iter().map(|b| (l.parameter, b))).collect();
    let column = |of: fn(&Band) -> f64| rows.iter().map(|(_, b)| of(b)).collect::<Vec<f64>>();
    Table::build("bands")
        .repeat("model", &config.settings.estimate)
        .strings("parameter", rows.iter().map(|(parameter, _)| parameter))
        .repeat("against", &config.settings.against)
        .repeat("fit", &config.name())
        .f64("x", column(|b| b.x))
        .f64("value", column(|b| b.value))
        .f64("pointwise_lower", column(|b| b.pointwise.0))
        .f64("pointwise_upper", column(|b| b.pointwise.1))
        .f64("simultaneous_lower", column(|b| b.simultaneous.0))
        .f64("simultaneous_upper", column(|b| b.simultaneous.1))
        .f64("prediction_lower", column(|b| b.prediction.0))
        .f64("prediction_upper", column(|b| b.prediction.1))
        .finish()
}
