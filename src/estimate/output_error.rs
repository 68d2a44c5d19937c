//! A compiled model over records in; the problem over segments that the numerical core solves, and its named result, out.

use super::choice::{Chosen, choose};
use super::problem::{Block, Layout, Part};
use super::result::name;
use super::solution::{Solution, solve};
use super::{Estimation, Settings, Trace};
use crate::dynamics::{Directions, Plan, Record, Response};
use crate::error::Errors;
use crate::model::Model;

/// A variance is never taken smaller than this share of the mean square of the measurements.
const FLOOR: f64 = 1e-20;

/// Estimates the free parameters of `model` jointly over `records`, one segment each.
///
/// `R`, the colour of the residuals and the campaign's parameters are shared by all segments. Initial states are those of the model
/// ("measured": the first measured value of the output of the state's name, in that record), or free per segment
/// (`settings.initial`; they then start from the same value).
///
/// # Errors
/// Names that the model does not have, starts that are not finite or outside their bounds, a measured start without a measurement:
/// all at once. What the data do is never an error: see `Estimation::stop`.
pub fn estimate(model: &Model, records: &[Record], settings: &Settings) -> Result<Estimation, Errors> {
    let chosen = choose(model, settings)?;
    let starts = chosen.initial.clone();
    let parameters = chosen.shared.iter().chain(&chosen.own).copied().collect();
    let outputs = scored(model, records);
    let plan = Plan::of_outputs(model, Directions { parameters, starts }, outputs.clone())?;
    let given = given_starts(model, &plan, records, &chosen)?;
    let layout = layout(model, &plan, records, settings, &chosen, &given, &outputs);
    let (solution, records) = solve_with_steps(&plan, &chosen, &given, &layout, &outputs, records, settings);
    let respond = |s: usize, local: &[f64]| -> Response {
        let (parameters, starts) = place(&chosen, &plan, &given[s], local);
        plan.respond(&parameters, &starts, &records[s], false)
    };
    let responses =
        (0..records.len()).map(|s| traces(model, &records[s], respond(s, &layout.local(s, &solution.fit.theta)))).collect();
    Ok(name(model, &chosen, &layout, &outputs, solution, responses))
}

/// Solves with integration steps that stay the same during an iteration (a cost that changed its steps on the way would have jumps). They
/// are chosen at the start; where the solution turns out to be stiffer, the estimation is repeated with the steps that it asks for.
#[allow(clippy::type_complexity)]
fn solve_with_steps(
    plan: &Plan,
    chosen: &Chosen,
    given: &[Vec<f64>],
    layout: &Layout,
    outputs: &[usize],
    records: &[Record],
    settings: &Settings,
) -> (Solution, Vec<Record>) {
    let mut fixed = records.to_vec();
    let mut needed = layout.start.clone();
    loop {
        let mut changed = false;
        for (s, record) in fixed.iter_mut().enumerate().filter(|(s, _)| records[*s].substeps == 0) {
            let (parameters, starts) = place(chosen, plan, &given[s], &layout.local(s, &needed));
            let steps = plan.substeps(&parameters, &starts, record);
            changed |= steps > record.substeps;
            record.substeps = record.substeps.max(steps);
        }
        let evaluate = |s: usize, local: &[f64]| -> Option<Vec<Block>> {
            let (parameters, starts) = place(chosen, plan, &given[s], local);
            let response = plan.respond(&parameters, &starts, &fixed[s], true);
            response.finite.then(|| blocks(&fixed[s], outputs, response))
        };
        let solution = solve(layout, &evaluate, settings);
        let steps = |s: usize| {
            let (parameters, starts) = place(chosen, plan, &given[s], &layout.local(s, &solution.fit.theta));
            plan.substeps(&parameters, &starts, &fixed[s])
        };
        let stiffer = (0..fixed.len()).any(|s| records[s].substeps == 0 && steps(s) > fixed[s].substeps);
        if !stiffer || !changed {
            return (solution, fixed);
        }
        needed = solution.fit.theta;
    }
}

/// Start values of the states that need one from outside, per record.
fn given_starts(model: &Model, plan: &Plan, records: &[Record], chosen: &Chosen) -> Result<Vec<Vec<f64>>, Errors> {
    let mut errors = Errors::default();
    let mut given = Vec::with_capacity(records.len());
    for (s, record) in records.iter().enumerate() {
        let values = plan.first_values(model, &chosen.parameters, record).map_err(|mut e| {
            e.what = format!("segment {s}: {}", e.what);
            e
        });
        given.extend(errors.take(values));
    }
    errors.or(given)
}

/// Model outputs measured in any record, ascending: each is a noise class.
fn scored(model: &Model, records: &[Record]) -> Vec<usize> {
    (0..model.outputs.len()).filter(|&o| records.iter().any(|r| r.channels.iter().any(|c| c.output == o))).collect()
}

fn layout(
    model: &Model,
    plan: &Plan,
    records: &[Record],
    settings: &Settings,
    chosen: &Chosen,
    given: &[Vec<f64>],
    outputs: &[usize],
) -> Layout {
    let nc = chosen.shared.len();
    let own = chosen.own.len() + chosen.initial.len();
    let parts = (0..records.len()).map(|s| Part { shared: (0..nc).collect(), offset: nc + s * own, own }).collect();
    // Start, lower, upper, prior sd of each unknown.
    let parameter = |p: usize| {
        let q = &model.parameters[p];
        [chosen.parameters[p], q.min, q.max, if settings.priors { q.prior_sd } else { f64::INFINITY }]
    };
    let mut unknowns: Vec<[f64; 4]> = chosen.shared.iter().map(|&p| parameter(p)).collect();
    for given in given {
        unknowns.extend(chosen.own.iter().map(|&p| parameter(p)));
        let free = plan.given().iter().zip(given).filter(|(state, _)| chosen.initial.contains(state));
        unknowns.extend(free.map(|(_, value)| [*value, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY]));
    }
    let column = |k: usize| unknowns.iter().map(|u| u[k]).collect();
    Layout {
        shared: nc,
        parts,
        start: column(0),
        lower: column(1),
        upper: column(2),
        prior_sd: column(3),
        classes: outputs.len(),
        floor: outputs.iter().map(|&o| floor(records, o)).collect(),
    }
}

fn floor(records: &[Record], output: usize) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for channel in records.iter().flat_map(|r| &r.channels).filter(|c| c.output == output) {
        for z in channel.z.iter().filter(|z| z.is_finite()) {
            sum += z * z;
            n += 1.0;
        }
    }
    if sum > 0.0 { FLOOR * sum / n } else { FLOOR }
}

/// A segment's directions back in the model: all parameters, and the start values from outside.
fn place(chosen: &Chosen, plan: &Plan, given: &[f64], local: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut parameters = chosen.parameters.clone();
    let mut starts = given.to_vec();
    let mut values = local.iter().copied();
    for (&p, value) in chosen.shared.iter().chain(&chosen.own).zip(&mut values) {
        parameters[p] = value;
    }
    for (state, start) in plan.given().iter().zip(&mut starts) {
        if chosen.initial.contains(state) {
            *start = values.next().unwrap_or(*start);
        }
    }
    (parameters, starts)
}

/// Residuals per channel; a measurement that is not finite, or outside the grid, is masked.
fn blocks(record: &Record, outputs: &[usize], response: Response) -> Vec<Block> {
    let channels = record.channels.iter().zip(response.y.iter().zip(response.dy));
    channels
        .filter_map(|(channel, (y, g))| {
            let class = outputs.iter().position(|&o| o == channel.output)?;
            let e = channel.z.iter().zip(y).map(|(z, y)| if z.is_finite() { z - y } else { f64::NAN }).collect();
            Some(Block { class, e, g })
        })
        .collect()
}

fn traces(model: &Model, record: &Record, response: Response) -> Vec<Trace> {
    let channels = record.channels.iter().zip(response.y);
    channels
        .filter_map(|(channel, modelled)| {
            let quantity = model.outputs.get(channel.output)?;
            Some(Trace {
                output: channel.output,
                name: quantity.name.clone(),
                unit: quantity.unit.clone(),
                t: channel.t.clone(),
                measured: channel.z.clone(),
                modelled,
            })
        })
        .collect()
}
