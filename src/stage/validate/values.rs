//! Tables of estimates and lines come in; the values that a model is held at in one maneuver, with
//! their covariance, go out.

use super::config::Config;
use super::source::{Part, Source};
use crate::error::Result;
use crate::stage::inputs;
use crate::stage::{Campaign, Inputs};
use crate::table::Table;
use indexmap::IndexMap;
use std::collections::BTreeMap;

/// Values of parameters and how well they are known.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Values {
    /// By parameter of the model.
    pub at: IndexMap<String, f64>,
    /// Their covariance, `[n][n]`, without the errors of assumed constants: the same constants make
    /// the prediction, which then errs as little as the fit. Lines of different fits count as
    /// independent, and so do lines and estimates.
    pub covariance: Vec<f64>,
    /// Lines of which the abscissa lies outside the points that they go through.
    pub beyond: Vec<String>,
    /// Whether one does, at every grid point of the maneuver, or once for all of it.
    pub outside: Vec<bool>,
}

/// What is known of a maneuver by name.
pub struct Maneuver<'a> {
    pub flight: &'a str,
    pub labels: &'a IndexMap<String, String>,
    /// Means before it, by signal.
    pub conditions: BTreeMap<&'a str, f64>,
    /// Values along it of the inputs of the validated model, by name.
    pub along: BTreeMap<&'a str, Vec<f64>>,
}

/// One number, its variance, and what it belongs to: numbers of one owner are correlated.
struct Number {
    value: f64,
    variance: f64,
    owner: Owner,
}

#[derive(Clone, Copy, PartialEq)]
enum Owner {
    None,
    /// A row of `estimates`.
    Estimate(usize),
    /// A row of `fits`, of the part with this number.
    Line(usize, usize),
}

/// The values for one maneuver; why there are none, in words, where one is missing.
pub fn values(
    config: &Config,
    campaign: &Campaign,
    inputs: &Inputs,
    maneuver: &Maneuver,
) -> Result<std::result::Result<Values, String>> {
    let estimates = inputs.numbered("estimates", config.estimate)?;
    let correlations = inputs.numbered("correlations", config.estimate)?;
    let (estimates, correlations) = (estimates.as_ref(), correlations.as_ref());
    let mut found = Values::default();
    let mut numbers: Vec<Number> = Vec::new();
    let mut slopes: Vec<[f64; 2]> = Vec::new();
    for (name, source) in &config.sources {
        let mut weights = [0.0; 2];
        let number = match source {
            Source::Held(value) => Ok(Number { value: *value, variance: 0.0, owner: Owner::None }),
            Source::Estimate(parameter) => match estimates {
                Some(table) => estimated(table, parameter, maneuver)?,
                None => Err("there are no estimates".into()),
            },
            Source::Line { fit, parameter, part } => {
                let against = &campaign.fits[*fit].settings.against;
                let at = inputs.get("fits", inputs::Part::Number(*fit))?;
                let line = match &at {
                    Some(table) => Line::read(table, parameter)?,
                    None => Err(format!("there is no line of {parameter}")),
                };
                let x = maneuver.conditions.get(against.as_str()).copied().unwrap_or(f64::NAN);
                let of = match part {
                    Part::Slope => [1.0, 0.0],
                    Part::Intercept => [0.0, 1.0],
                    Part::Value => [x, 1.0],
                };
                weights = of;
                // A model that takes slope and intercept evaluates the line at every moment.
                let along = maneuver.along.get(against.as_str()).filter(|_| *part != Part::Value);
                let xs = along.map_or(std::slice::from_ref(&x), Vec::as_slice);
                if let Ok(line) = &line {
                    let outside: Vec<bool> = xs.iter().map(|x| line.is_outside(*x)).collect();
                    if outside.contains(&true) && !found.beyond.contains(parameter) {
                        found.beyond.push(parameter.clone());
                    }
                    found.outside = either(&found.outside, &outside);
                }
                line.and_then(|line| line.number(of, *fit, against))
            }
        };
        let number = match number {
            Ok(number) => number,
            Err(why) => return Ok(Err(why)),
        };
        found.at.insert(name.clone(), number.value);
        slopes.push(weights);
        numbers.push(number);
    }
    found.covariance = covariance(&numbers, &slopes, estimates, correlations, config, inputs)?;
    Ok(Ok(found))
}

/// Where one or the other is; one entry stands for all.
fn either(a: &[bool], b: &[bool]) -> Vec<bool> {
    let at = |of: &[bool], k: usize| of.get(k).or(of.last()).copied().unwrap_or(false);
    (0..a.len().max(b.len())).map(|k| at(a, k) || at(b, k)).collect()
}

/// A parameter of the estimate, for this maneuver's flight or labels.
fn estimated(
    table: &Table,
    parameter: &str,
    maneuver: &Maneuver,
) -> Result<std::result::Result<Number, String>> {
    let (names, groups) = (table.strings("parameter")?, table.strings("group")?);
    let (per, of) = (table.strings("per")?, table.opt_strings("of")?);
    let (values, stops) = (table.f64("value")?, table.strings("stop")?);
    let ours = |i: &usize| {
        names[*i] == parameter
            && (groups[*i] == "all" || groups[*i] == maneuver.flight)
            && of[*i].is_none_or(|of| maneuver.labels.get(per[*i]).is_some_and(|own| own == of))
    };
    let Some(row) = (0..names.len()).find(ours) else {
        return Ok(Err(format!("the estimate has no value of {parameter} for it")));
    };
    if stops[row] != "converged" || !values[row].is_finite() {
        return Ok(Err(format!("the estimate of {parameter} ended with \"{}\"", stops[row])));
    }
    let sd = Some(table.f64("sd")?[row]).filter(|sd| sd.is_finite()).unwrap_or(0.0);
    Ok(Ok(Number { value: values[row], variance: sd * sd, owner: Owner::Estimate(row) }))
}

/// A row of `fits`.
struct Line {
    row: usize,
    slope: f64,
    intercept: f64,
    /// Variances of slope and intercept, and their covariance.
    variances: [f64; 2],
    covariance: f64,
    range: [f64; 2],
}

impl Values {
    /// Whether a line is taken outside its points at a grid point.
    pub fn is_outside(&self, k: usize) -> bool {
        self.outside.get(k).or(self.outside.last()).copied().unwrap_or(false)
    }

    /// Share of the maneuver in which one is.
    pub fn share_outside(&self) -> f64 {
        let outside = self.outside.iter().filter(|outside| **outside).count();
        outside as f64 / self.outside.len().max(1) as f64
    }
}

impl Line {
    fn read(table: &Table, parameter: &str) -> Result<std::result::Result<Line, String>> {
        let names = table.strings("parameter")?;
        let row = names.iter().position(|name| *name == parameter);
        let column = |name: &str, row: usize| Ok::<f64, crate::error::Error>(table.f64(name)?[row]);
        let Some(row) = row else { return Ok(Err(format!("there is no line of {parameter}"))) };
        let stop = table.strings("stop")?[row];
        if stop != "converged" {
            return Ok(Err(format!("there is no line of {parameter}: {stop}")));
        }
        let square = |name: &str| column(name, row).map(|sd| sd * sd);
        Ok(Ok(Line {
            row,
            slope: column("slope", row)?,
            intercept: column("intercept", row)?,
            variances: [square("slope_sd")?, square("intercept_sd")?],
            covariance: column("covariance", row)?,
            range: [column("x_min", row)?, column("x_max", row)?],
        }))
    }

    fn is_outside(&self, x: f64) -> bool {
        x < self.range[0] || x > self.range[1]
    }

    /// `weights[0] slope + weights[1] intercept`.
    fn number(
        &self,
        weights: [f64; 2],
        fit: usize,
        against: &str,
    ) -> std::result::Result<Number, String> {
        let [a, b] = weights;
        let value = a * self.slope + b * self.intercept;
        if !value.is_finite() {
            return Err(format!("it has no {against}, which the lines need"));
        }
        let variance = self.between(weights, weights);
        Ok(Number { value, variance, owner: Owner::Line(fit, self.row) })
    }

    /// Covariance of two sums of slope and intercept.
    fn between(&self, one: [f64; 2], other: [f64; 2]) -> f64 {
        one[0] * other[0] * self.variances[0]
            + one[1] * other[1] * self.variances[1]
            + (one[0] * other[1] + one[1] * other[0]) * self.covariance
    }
}

fn covariance(
    numbers: &[Number],
    weights: &[[f64; 2]],
    estimates: Option<&Table>,
    correlations: Option<&Table>,
    config: &Config,
    inputs: &Inputs,
) -> Result<Vec<f64>> {
    let n = numbers.len();
    let mut all = vec![0.0; n * n];
    for i in 0..n {
        all[i * n + i] = numbers[i].variance;
        for j in 0..i {
            let between = match (numbers[i].owner, numbers[j].owner) {
                (Owner::Line(fit, row), Owner::Line(other, same))
                    if (fit, row) == (other, same) =>
                {
                    let table = inputs.get("fits", inputs::Part::Number(fit))?;
                    let Source::Line { parameter, .. } = &config.sources[i].1 else { continue };
                    let line =
                        table.as_ref().map(|table| Line::read(table, parameter)).transpose()?;
                    line.and_then(std::result::Result::ok)
                        .map_or(0.0, |line| line.between(weights[i], weights[j]))
                }
                (Owner::Line(fit, _), Owner::Line(other, _)) if fit == other => {
                    let of = |i: usize| (&config.sources[i].1, weights[i]);
                    lines(fit, inputs, [of(i), of(j)])?
                }
                (Owner::Estimate(a), Owner::Estimate(b)) => match (estimates, correlations) {
                    (Some(estimates), Some(table)) => correlated(estimates, table, [a, b])?,
                    _ => 0.0,
                },
                _ => 0.0,
            };
            (all[i * n + j], all[j * n + i]) = (between, between);
        }
    }
    Ok(all)
}

/// Covariance of weighted sums of slope and intercept of two lines of one fit.
fn lines(fit: usize, inputs: &Inputs, of: [(&Source, [f64; 2]); 2]) -> Result<f64> {
    let number = inputs::Part::Number(fit);
    let (Some(fits), Some(table)) =
        (inputs.get("fits", number.clone())?, inputs.get("line_correlations", number)?)
    else {
        return Ok(0.0);
    };
    let [Source::Line { parameter: a, .. }, Source::Line { parameter: b, .. }] = of.map(|o| o.0)
    else {
        return Ok(0.0);
    };
    let (Ok(one), Ok(other)) = (Line::read(&fits, a)?, Line::read(&fits, b)?) else {
        return Ok(0.0);
    };
    let names = ["parameter", "term", "other", "other_term"];
    let [p, t, q, u] = names.map(|name| table.strings(name));
    let (p, t, q, u, value) = (p?, t?, q?, u?, table.f64("value")?);
    let terms = ["slope", "intercept"];
    let mut sum = 0.0;
    for (i, term) in terms.iter().enumerate() {
        for (j, other_term) in terms.iter().enumerate() {
            let is = |k: usize| {
                (p[k], t[k], q[k], u[k]) == (a, term, b, other_term)
                    || (p[k], t[k], q[k], u[k]) == (b, other_term, a, term)
            };
            let Some(k) = (0..value.len()).find(|&k| is(k)) else { continue };
            let sd = (one.variances[i] * other.variances[j]).sqrt();
            sum += of[0].1[i] * of[1].1[j] * value[k] * sd;
        }
    }
    Ok(sum)
}

/// Covariance of two rows of `estimates`.
pub fn correlated(estimates: &Table, table: &Table, rows: [usize; 2]) -> Result<f64> {
    let (groups, names) = (estimates.strings("group")?, estimates.strings("parameter")?);
    let (of, sd) = (estimates.opt_strings("of")?, estimates.f64("sd")?);
    if rows[0] == rows[1] {
        return Ok(sd[rows[0]] * sd[rows[0]]);
    }
    let (group, one, other) =
        (table.strings("group")?, table.strings("parameter")?, table.strings("other")?);
    let (one_of, other_of) = (table.opt_strings("of")?, table.opt_strings("other_of")?);
    let value = table.f64("value")?;
    let is = |k: usize, [a, b]: [usize; 2]| {
        (group[k], one[k], one_of[k]) == (groups[a], names[a], of[a])
            && (groups[a], other[k], other_of[k]) == (groups[b], names[b], of[b])
    };
    let found = (0..value.len()).find(|&k| is(k, rows) || is(k, [rows[1], rows[0]]));
    let sd = rows.map(|row| if sd[row].is_finite() { sd[row] } else { 0.0 });
    Ok(found.map_or(0.0, |k| value[k] * sd[0] * sd[1]))
}
