//! Estimates per maneuver and the trimmed conditions come in; straight lines through them, bands and the points go out.

use super::{Campaign, Inputs, Note, Output, Part, Per, Read, Severity, Stage, Unit, slice_of};
use crate::error::{Errors, Result};
use crate::fit::{self, Band, LineFit, Unfit};
use crate::table::Table;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

pub const STAGE: Stage = Stage {
    name: "fit",
    about: "fit straight lines",
    per: Per::Fit,
    wanted: |_| true,
    writes: &["fits", "bands", "points"],
    reads,
    reads_log: false,
    slice,
    run,
};

/// Straight lines through the estimates per maneuver.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Name of the fit; `<estimate>-<against>` unless given.
    #[serde(default)]
    pub name: Option<String>,
    /// Name of the `[[estimate]]`, which must give one estimate per maneuver.
    pub estimate: String,
    /// Parameters of its model, each of which gets a line.
    pub parameters: Vec<String>,
    /// Column of the samples table whose mean in the quiet time before the maneuver is the abscissa.
    pub against: String,
    /// Confidence level of the bands.
    #[serde(default = "default_level")]
    pub level: f64,
    /// Points of each band, from the smallest to the largest abscissa.
    #[serde(default = "default_points")]
    pub points: usize,
    /// How a line is fitted.
    #[serde(default)]
    pub method: fit::Settings,
}

fn default_level() -> f64 {
    0.95
}

fn default_points() -> usize {
    61
}

/// The checked settings of one fit.
#[derive(Debug)]
pub struct Config {
    pub settings: Settings,
    /// Place of the estimate in the list of estimates.
    pub estimate: usize,
    /// SI units of the parameters, in the order of the settings.
    pub units: Vec<String>,
    /// SI unit of the abscissa.
    pub unit_x: String,
}

impl Config {
    pub fn name(&self) -> String {
        self.settings.name()
    }
}

impl Settings {
    /// Name of the fit.
    pub fn name(&self) -> String {
        self.name.clone().unwrap_or_else(|| format!("{}-{}", self.estimate, self.against))
    }
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    campaign.fits.get(unit.index).map(|f| slice_of(&f.settings)).unwrap_or_default()
}

fn reads(campaign: &Campaign, unit: &Unit) -> Vec<Read> {
    let estimate = campaign.fits.get(unit.index).map_or(0, |f| f.estimate);
    let mut all = vec![Read { table: "estimates", part: Part::Number(estimate), optional: false }];
    all.extend(Read::flights(&["segments", "conditions"], campaign));
    all
}

/// One estimate with its abscissa.
struct Point<'a> {
    flight: &'a str,
    segment: &'a str,
    x: f64,
    value: f64,
    sd: f64,
}

/// A line through the points of one parameter.
struct Line<'a> {
    parameter: &'a str,
    unit: &'a str,
    points: Vec<Point<'a>>,
    fit: std::result::Result<LineFit, Unfit>,
    bands: Vec<Band>,
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = campaign.fits.get(unit.index) else { return Ok(Output::default()) };
    let abscissas = abscissas(inputs, &config.settings.against)?;
    let Some(estimates) = inputs.get("estimates", Part::Number(config.estimate)) else { return Ok(Output::default()) };
    let mut lines = Vec::new();
    let mut notes = Vec::new();
    for (parameter, unit) in config.settings.parameters.iter().zip(&config.units) {
        let (points, left_out) = points(estimates, parameter, &abscissas)?;
        let line = line(config, parameter, unit, points);
        notes.extend(note(config, &line, left_out));
        lines.push(line);
    }
    let tables = vec![("fits", fits(config, &lines)?), ("bands", bands(config, &lines)?), ("points", point_table(config, &lines)?)];
    Ok(Output { tables, files: Vec::new(), notes })
}

/// The mean of the abscissa's column before each maneuver, with its flight, by segment.
fn abscissas<'a>(inputs: &'a Inputs, against: &str) -> Result<BTreeMap<&'a str, (&'a str, f64)>> {
    let mut all = BTreeMap::new();
    for conditions in inputs.all("conditions") {
        let columns = (conditions.strings("flight")?, conditions.strings("segment")?, conditions.strings("signal")?);
        let values = conditions.f64("value")?;
        for (i, value) in values.iter().enumerate() {
            if columns.2[i] == against {
                all.insert(columns.1[i], (columns.0[i], *value));
            }
        }
    }
    Ok(all)
}

/// The usable estimates of one parameter, by flight and segment, and how many had to be left out.
fn points<'a>(estimates: &Table, parameter: &str, abscissas: &BTreeMap<&'a str, (&'a str, f64)>) -> Result<(Vec<Point<'a>>, u64)> {
    let (parameters, groups) = (estimates.strings("parameter")?, estimates.strings("group")?);
    let (values, sds) = (estimates.f64("value")?, estimates.f64("sd")?);
    let mut points = Vec::new();
    let mut left_out = 0;
    for i in (0..estimates.rows()).filter(|i| parameters[*i] == parameter) {
        let (value, sd) = (values[i], sds[i]);
        match abscissas.get_key_value(groups[i]) {
            Some((segment, (flight, x))) if x.is_finite() && value.is_finite() && sd > 0.0 && sd.is_finite() => {
                points.push(Point { flight, segment, x: *x, value, sd });
            }
            _ => left_out += 1,
        }
    }
    points.sort_by_key(|p| (p.flight, p.segment));
    Ok((points, left_out))
}

fn line<'a>(config: &Config, parameter: &'a str, unit: &'a str, points: Vec<Point<'a>>) -> Line<'a> {
    let column = |of: fn(&Point) -> f64| points.iter().map(of).collect::<Vec<f64>>();
    let x = column(|p| p.x);
    let fit = fit::line(&x, &column(|p| p.value), &column(|p| p.sd), &config.settings.method);
    let (low, high) = range(&x);
    let last = config.settings.points.saturating_sub(1).max(1) as f64;
    let xs: Vec<f64> = (0..config.settings.points).map(|i| low + (high - low) * i as f64 / last).collect();
    let bands = fit.as_ref().map(|fit| fit::bands(fit, &xs, config.settings.level)).unwrap_or_default();
    Line { parameter, unit, points, fit, bands }
}

fn range(x: &[f64]) -> (f64, f64) {
    (x.iter().copied().fold(f64::NAN, f64::min), x.iter().copied().fold(f64::NAN, f64::max))
}

fn note(config: &Config, line: &Line, left_out: u64) -> Option<Note> {
    let of = format!("{} of {}", line.parameter, config.settings.estimate);
    let (severity, count, text) = match (&line.fit, left_out) {
        (Err(why), _) => (Severity::Missing, 1, format!("{of}: no line against {}: {why}", config.settings.against)),
        (Ok(_), 0) => return None,
        (Ok(_), n) => (Severity::Warning, n, format!("{of}: {n} estimates without a standard deviation are not in the line")),
    };
    let stage = STAGE.name.to_string();
    Some(Note { flight: String::new(), stage, severity, subject: line.parameter.to_string(), count, text })
}

fn fits(config: &Config, lines: &[Line]) -> Result<Table> {
    let settings = &config.settings;
    let number = |of: fn(&LineFit) -> f64| lines.iter().map(|l| l.fit.as_ref().map_or(f64::NAN, of)).collect::<Vec<f64>>();
    let ranges: Vec<(f64, f64)> = lines.iter().map(|l| range(&l.points.iter().map(|p| p.x).collect::<Vec<_>>())).collect();
    Table::build("fits")
        .repeat("model", &settings.estimate)
        .strings("parameter", lines.iter().map(|l| l.parameter))
        .repeat("against", &settings.against)
        .strings("unit", lines.iter().map(|l| l.unit))
        .repeat("unit_x", &config.unit_x)
        .f64("slope", number(|f| f.slope))
        .f64("intercept", number(|f| f.intercept))
        .f64("slope_sd", number(|f| f.slope_sd))
        .f64("intercept_sd", number(|f| f.intercept_sd))
        .f64("covariance", number(|f| f.covariance))
        .i64("n", lines.iter().map(|l| l.points.len() as i64).collect::<Vec<_>>())
        .f64("scatter_sd", number(|f| f.tau))
        .f64("chi2", number(|f| f.reduced_chi_square * f.dof))
        .f64("x_min", ranges.iter().map(|r| r.0).collect::<Vec<_>>())
        .f64("x_max", ranges.iter().map(|r| r.1).collect::<Vec<_>>())
        .f64("level", vec![settings.level; lines.len()])
        .strings("stop", lines.iter().map(|l| l.fit.as_ref().err().map_or("converged", |why| why.name())))
        .finish()
}

fn bands(config: &Config, lines: &[Line]) -> Result<Table> {
    let rows: Vec<(&str, &Band)> = lines.iter().flat_map(|l| l.bands.iter().map(|b| (l.parameter, b))).collect();
    let column = |of: fn(&Band) -> f64| rows.iter().map(|(_, b)| of(b)).collect::<Vec<f64>>();
    Table::build("bands")
        .repeat("model", &config.settings.estimate)
        .strings("parameter", rows.iter().map(|(parameter, _)| parameter))
        .repeat("against", &config.settings.against)
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

fn point_table(config: &Config, lines: &[Line]) -> Result<Table> {
    let rows: Vec<(&Line, &Point)> = lines.iter().flat_map(|l| l.points.iter().map(move |p| (l, p))).collect();
    let column = |of: fn(&Point) -> f64| rows.iter().map(|(_, p)| of(p)).collect::<Vec<f64>>();
    Table::build("points")
        .repeat("model", &config.settings.estimate)
        .strings("parameter", rows.iter().map(|(l, _)| l.parameter))
        .repeat("against", &config.settings.against)
        .strings("unit", rows.iter().map(|(l, _)| l.unit))
        .repeat("unit_x", &config.unit_x)
        .strings("flight", rows.iter().map(|(_, p)| p.flight))
        .strings("segment", rows.iter().map(|(_, p)| p.segment))
        .f64("x", column(|p| p.x))
        .f64("value", column(|p| p.value))
        .f64("sd", column(|p| p.sd))
        .finish()
}
