//! One recording of a design in; the estimate of one model from it, with the covariance that the
//! estimator gives, out.

use super::columns::Samples;
use super::prepared::Prepared;
use super::study::Study;
use crate::error::Result;
use crate::estimate::{Estimation, Row, Segment, Stop, estimate_segments};
use crate::math::dense::{cholesky, cholesky_log_det};
use crate::simulate::Truth;
use crate::stage::estimate::records::{Grid, Measured, Source, Window, record};

/// One estimated parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    pub name: String,
    pub unit: String,
    pub value: f64,
    /// Standard deviation that allows for coloured residuals, and the Cramer-Rao bound; neither
    /// unless converged inside the bounds.
    pub sd: Option<f64>,
    pub crlb: Option<f64>,
}

/// The estimate from one recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    pub stop: Stop,
    /// Parameters with one value for the whole flight.
    pub parameters: Vec<Parameter>,
    /// Trace and determinant of the Cramer-Rao bound of these parameters; neither where one of them
    /// has no standard deviation.
    pub trace: Option<f64>,
    pub determinant: Option<f64>,
    /// What the data leave undetermined, or why there is no estimate; empty where all is well.
    pub why: String,
}

/// Estimates a model from the maneuvers of a recording.
///
/// # Errors
/// The settings do not fit the model, which the check of the study tells before.
pub fn estimated(
    study: &Study,
    prepared: &Prepared,
    truth: &Truth,
    samples: &Samples,
) -> std::result::Result<Run, crate::error::Errors> {
    let mut segments = Vec::new();
    for maneuver in &truth.maneuvers {
        let times = [maneuver.t_start_s, maneuver.t_end_s];
        match segment(study, prepared, samples, times) {
            Ok(Ok(segment)) => segments.push(segment),
            Ok(Err(why)) => return Ok(nothing(why)),
            Err(e) => return Ok(nothing(e.what)),
        }
    }
    // A design that does not show a parameter does not determine it.
    let method = crate::estimate::Settings {
        without_effect: crate::estimate::WithoutEffect::Refuse,
        asked: crate::estimate::Asked::Minimum,
        ..prepared.settings.method.clone()
    };
    let estimation = estimate_segments(&prepared.model, &segments, &method)?;
    Ok(run(&estimation))
}

fn nothing(why: String) -> Run {
    Run { stop: Stop::NoData, parameters: Vec::new(), trace: None, determinant: None, why }
}

/// The record of one maneuver; why there is none.
fn segment(
    study: &Study,
    prepared: &Prepared,
    samples: &Samples,
    [start, end]: [f64; 2],
) -> Result<std::result::Result<Segment, String>> {
    let settings = &study.settings;
    let columns = samples.around(prepared, start, settings.quiet_s)?;
    let column = |name: &str| columns.get(name).map(|c| c.values.as_slice());
    let grid =
        Grid { t0: samples.grid.t0, dt: samples.grid.dt, n: samples.grid.n, column: &column };
    let inputs: Vec<Source> = prepared.inputs.iter().cloned().map(Source::Column).collect();
    let measured = prepared.scored.iter().filter_map(|(output, name)| {
        let one = samples.series.get(name)?;
        Some(Measured { output: *output, t: &one.t_s, z: &one.value })
    });
    let measured: Vec<Measured> = measured.collect();
    let (from, to) = (start - settings.pre_s, end + settings.post_s);
    let window = Window { from, to, preroll: 0.0, settle: 0.0 };
    Ok(match record(&grid, &inputs, &measured, window) {
        Err(why) => Err(why.to_string()),
        Ok(mut record) => {
            record.interpolation = vec![prepared.settings.interpolation; inputs.len()];
            Ok(Segment::from(record))
        }
    })
}

/// What an estimation says about the parameters that all of its maneuvers share.
fn run(estimation: &Estimation) -> Run {
    let shared: Vec<(usize, &Row)> = estimation
        .rows
        .iter()
        .enumerate()
        .filter(|(_, row)| row.segment.is_none() && row.group.is_none())
        .collect();
    let parameter = |row: &Row| Parameter {
        name: row.name.clone(),
        unit: row.unit.clone(),
        value: row.value,
        sd: row.sd,
        crlb: row.sd_crlb,
    };
    let parameters = shared.iter().map(|(_, row)| parameter(row)).collect();
    let deviations: Option<Vec<f64>> = shared.iter().map(|(_, row)| row.sd_crlb).collect();
    let deviations = deviations.filter(|sd| !sd.is_empty() && estimation.stop == Stop::Converged);
    Run {
        stop: estimation.stop,
        parameters,
        trace: deviations.as_ref().map(|sd| sd.iter().map(|s| s * s).sum()),
        determinant: deviations.and_then(|sd| determinant(estimation, &shared, &sd)),
        why: why(estimation, &shared),
    }
}

/// The determinant of the covariance `sd_i sd_j c_ij`, by Cholesky's factor of the correlations.
fn determinant(estimation: &Estimation, shared: &[(usize, &Row)], sd: &[f64]) -> Option<f64> {
    let n = sd.len();
    let mut c = vec![0.0; n * n];
    (0..n).for_each(|i| c[i * n + i] = 1.0);
    let place = |row: usize| shared.iter().position(|(i, _)| *i == row);
    for one in &estimation.correlations {
        if let (Some(a), Some(b)) = (place(one.a), place(one.b)) {
            c[a * n + b] = one.crlb;
            c[b * n + a] = one.crlb;
        }
    }
    let factor = cholesky(&c, n).ok()?;
    let scale: f64 = sd.iter().map(|s| s * s).product();
    Some(scale * libm::exp(cholesky_log_det(&factor, n)))
}

fn why(estimation: &Estimation, shared: &[(usize, &Row)]) -> String {
    let undetermined = estimation.verdict.undetermined();
    if !undetermined.is_empty() {
        return undetermined.join("; ");
    }
    if estimation.stop != Stop::Converged {
        return estimation.why.clone().unwrap_or_default();
    }
    let held: Vec<&str> =
        shared.iter().filter(|(_, row)| row.at_bound).map(|(_, row)| row.name.as_str()).collect();
    if held.is_empty() { String::new() } else { format!("{} at a bound", held.join(", ")) }
}
