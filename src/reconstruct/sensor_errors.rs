//! Smoothed sensor errors in; lines about what the data say of them, out.

use super::consistency::Row;
use super::found::{Found, Held};
use super::path::Bias;
use super::plausible;
use super::smoother::Smoothed;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::survey::{SIGNIFICANT, UNKNOWN};
use crate::math::distribution::INTERVAL_95;
use crate::model::{Parameter, Quantity};

/// Lines about the sensor errors of a stretch: what the data say of them.
pub fn estimated(
    kinematics: &Kinematics,
    found: &Found,
    levels: &Levels,
    smoothed: &Smoothed,
    stretch: usize,
) -> Vec<Row> {
    let (nx, n) = (kinematics.states(), kinematics.size());
    let m = smoothed.p.len() / n.max(1);
    let mut rows = Vec::new();
    for (k, &i) in kinematics.free.iter().enumerate() {
        let parameter = &kinematics.model.parameters[i];
        let (value, sd) = (
            smoothed.x[nx + k] + found.offset(kinematics.model, i),
            smoothed.p[(nx + k) * m + nx + k].max(0.0).sqrt(),
        );
        let known = sd < UNKNOWN * levels.start_sd[nx + k];
        let Quantity { name, unit, .. } = &parameter.quantity;
        if let Some(sensor) = sensor(kinematics, name) {
            rows.extend(plausible::bias_row(&sensor, unit, (value, sd)));
        }
        rows.extend(plausible::error_row(name, parameter.start, unit, (value, sd)));
        let verdict = match (known, (value - parameter.start).abs() > SIGNIFICANT * sd) {
            (false, _) => "not observable",
            (true, true) => "significant",
            (true, false) => "not significant",
        };
        let text = format!(
            "{} {value:.4e} +- {:.1e} (95%), stretch {stretch}",
            parameter.quantity.doc,
            INTERVAL_95 * sd
        );
        rows.push(line(parameter, (value, sd), verdict, text));
    }
    rows
}

/// The inertial sensor whose bias this is.
fn sensor(kinematics: &Kinematics, bias: &str) -> Option<String> {
    let name = format!("{}_imu", bias.strip_prefix("b_")?);
    kinematics.model.inputs.iter().any(|input| input.name == name).then_some(name)
}

/// Lines about the sensor errors that were held because the data do not support them.
pub fn held(kinematics: &Kinematics, found: &Found) -> Vec<Row> {
    let one = |held: &Held| {
        let parameter = &kinematics.model.parameters[held.parameter];
        let verdict = if held.known { "not significant" } else { "not observable" };
        let text = format!(
            "{} {:.4e} +- {:.1e} (95%) if it were estimated: held at {}",
            parameter.quantity.doc,
            held.value,
            INTERVAL_95 * held.sd,
            parameter.start
        );
        line(parameter, (held.value, held.sd), verdict, text)
    };
    found.held.iter().map(one).collect()
}

/// A sensor error with the limits within which it is none.
fn line(
    parameter: &Parameter,
    (value, sd): (f64, f64),
    verdict: &'static str,
    text: String,
) -> Row {
    Row {
        channel: parameter.quantity.name.clone(),
        check: "sensor error",
        value,
        low: parameter.start - SIGNIFICANT * sd,
        high: parameter.start + SIGNIFICANT * sd,
        unit: parameter.quantity.unit.clone(),
        verdict,
        text,
    }
}

/// The smoothed parameters of a stretch.
pub fn biases(
    kinematics: &Kinematics,
    found: &Found,
    smoothed: &Smoothed,
    window: usize,
    [t_start_s, t_end_s]: [f64; 2],
) -> Vec<Bias> {
    let (nx, n) = (kinematics.states(), kinematics.size());
    let m = smoothed.p.len() / n.max(1);
    let row = |(k, &i): (usize, &usize)| {
        let quantity = &kinematics.model.parameters[i].quantity;
        let at = nx + k;
        Bias {
            window,
            t_start_s,
            t_end_s,
            parameter: quantity.name.clone(),
            unit: quantity.unit.clone(),
            value: smoothed.x[at] + found.offset(kinematics.model, i),
            sd: Some(smoothed.p[at * m + at].max(0.0).sqrt()),
        }
    };
    let mut rows: Vec<(usize, &usize)> = kinematics.free.iter().enumerate().collect();
    rows.sort_by_key(|(_, parameter)| **parameter);
    rows.into_iter().map(row).collect()
}
