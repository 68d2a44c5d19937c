//! Estimates per maneuver and the trimmed conditions come in; straight lines through them, bands
//! and the points go out.

use super::check::{Columns, Given};
use super::{
    Campaign, Inputs, Note, Output, Part, Read, Severity, Stage, Unit, estimate, slice_of,
};
use crate::config::list;
use crate::error::{Errors, Result};
use crate::fit::{self, Band, LineFit, Unfit};
use crate::table::{Table, campaign};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub const STAGE: Stage = Stage {
    name: "fit",
    about: "fit straight lines",
    units: |campaign| Unit::entries(campaign.fits.iter().map(Config::name)),
    writes: &["fits", "bands", "points"],
    reads,
    slice,
    run,
    ..Stage::PLAIN
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
    /// Column of the samples table whose mean in the quiet time before the maneuver is the
    /// abscissa.
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
    /// Checks the settings of one fit, which stand at `key`, against the estimates (their names, and
    /// what is checked of them) and the columns; none where they have mistakes that matter to it.
    pub fn read(
        settings: Settings,
        (given, key): (&mut Given, &str),
        (names, estimates): (&[String], &[Option<estimate::Config>]),
        columns: &Columns,
    ) -> Option<Config> {
        let Some(index) = names.iter().position(|name| *name == settings.estimate) else {
            given.unknown(&format!("{key}.estimate"), "[[estimate]]", &settings.estimate, names);
            return None;
        };
        if !(settings.level > 0.0 && settings.level < 1.0) {
            given.push(
                &format!("{key}.level"),
                format!("a confidence level is between 0 and 1, not {}", settings.level),
                "95% is 0.95",
            );
        }
        let unit_x = given.look_up(columns, &settings.against, "column", &format!("{key}.against"));
        let estimate = estimates.get(index)?.as_ref()?;
        if estimate.settings.group != estimate::Group::Segment || estimate.settings.input.is_none()
        {
            given.push(
                &format!("{key}.estimate"),
                format!("estimate \"{}\" does not give one estimate per maneuver", settings.estimate),
                "a line goes through estimates per maneuver: give it `input`, and group = \"segment\"",
            );
        }
        let mut units = Vec::new();
        for (i, name) in settings.parameters.iter().enumerate() {
            let known: Vec<&str> =
                estimate.model.parameters.iter().map(|p| p.quantity.name.as_str()).collect();
            match estimate.model.parameters.iter().find(|p| p.quantity.name == *name) {
                Some(parameter) => units.push(parameter.quantity.unit.clone()),
                None => {
                    let key = format!("{key}.parameters.{i}");
                    given.unknown(&key, "parameter of the model", name, &known);
                }
            }
        }
        let complete = units.len() == settings.parameters.len();
        complete.then_some(Config { settings, estimate: index, units, unit_x: unit_x? })
    }

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
    all.push(Read { table: "budget", part: Part::Number(estimate), optional: true });
    all.extend(Read::flights(&["segments", "conditions"], campaign));
    all
}

/// A line through the points of one parameter.
struct Line<'a> {
    parameter: &'a str,
    unit: &'a str,
    points: Table,
    fit: std::result::Result<LineFit, Unfit>,
    /// Variances of slope and intercept by assumed constants.
    assumed: (f64, f64),
    bands: Vec<Band>,
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = campaign.fits.get(unit.index) else { return Ok(Output::default()) };
    let settings = &config.settings;
    let Some(estimates) = inputs.get("estimates", Part::Number(config.estimate)) else {
        return Ok(Output::default());
    };
    let (segments, conditions) = (inputs.all("segments"), inputs.all("conditions"));
    let mut lines = Vec::new();
    let mut notes = Vec::new();
    for (parameter, unit) in settings.parameters.iter().zip(&config.units) {
        let wanted =
            campaign::Line { model: &settings.estimate, parameter, against: &settings.against };
        let found = campaign::points(&[estimates], &segments, &conditions, wanted)?;
        let mut line = line(config, parameter, unit, found.table)?;
        if let (Ok(fit), Some(budget)) =
            (&line.fit, inputs.get("budget", Part::Number(config.estimate)))
        {
            line.assumed = assumed(budget, parameter, &line.points, fit)?;
        }
        notes.extend(note(config, &line, &found.left_out));
        lines.push(line);
    }
    let points = Table::concat("points", &lines.iter().map(|l| &l.points).collect::<Vec<_>>())?;
    let tables = vec![
        ("fits", fits(config, &lines)?),
        ("bands", bands(config, &lines)?),
        ("points", points),
    ];
    Ok(Output { tables, files: Vec::new(), notes })
}

fn line<'a>(config: &Config, parameter: &'a str, unit: &'a str, points: Table) -> Result<Line<'a>> {
    let x = points.f64("x")?;
    let fit = fit::line(x, points.f64("value")?, points.f64("sd")?, &config.settings.method);
    let (low, high) = range(x);
    let last = config.settings.points.saturating_sub(1).max(1) as f64;
    let xs: Vec<f64> =
        (0..config.settings.points).map(|i| low + (high - low) * i as f64 / last).collect();
    let bands =
        fit.as_ref().map(|fit| fit::bands(fit, &xs, config.settings.level)).unwrap_or_default();
    Ok(Line { parameter, unit, points, fit, assumed: (0.0, 0.0), bands })
}

/// What the assumed constants add to the variances of slope and intercept. A constant's error is
/// one and the same at all points.
fn assumed(budget: &Table, parameter: &str, points: &Table, fit: &LineFit) -> Result<(f64, f64)> {
    let (names, constants) = (budget.strings("parameter")?, budget.opt_strings("constant")?);
    let (groups, segments) = (budget.strings("group")?, budget.opt_strings("segment")?);
    let (slopes, sds) = (budget.f64("sensitivity")?, budget.f64("constant_sd")?);
    let mine: Vec<usize> =
        (0..names.len()).filter(|&i| names[i] == parameter && constants[i].is_some()).collect();
    let mut known: Vec<&str> = mine.iter().filter_map(|&i| constants[i]).collect();
    known.sort_unstable();
    known.dedup();
    let (mut slope, mut intercept) = (0.0, 0.0);
    for constant in known {
        let moved = |segment: &&str| {
            let of = |i: &&usize| {
                constants[**i] == Some(constant) && segments[**i].unwrap_or(groups[**i]) == *segment
            };
            mine.iter().find(of).map_or(0.0, |&i| slopes[i] * sds[i])
        };
        let change: Vec<f64> = points.strings("segment")?.iter().map(moved).collect();
        let (a, b) = fit::carried(fit, points.f64("x")?, points.f64("sd")?, &change);
        slope += a * a;
        intercept += b * b;
    }
    Ok((slope, intercept))
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
    let ranges = lines.iter().map(|l| Ok(range(l.points.f64("x")?))).collect::<Result<Vec<_>>>()?;
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
        .f64("slope_sd_total", total(|f| f.slope_sd, |assumed| assumed.0))
        .f64("intercept_sd_total", total(|f| f.intercept_sd, |assumed| assumed.1))
        .f64("covariance", number(|f| f.covariance))
        .i64("n", lines.iter().map(|l| l.points.rows() as i64).collect::<Vec<_>>())
        .f64("scatter_sd", number(|f| f.tau))
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
