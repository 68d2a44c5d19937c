//! A solution by parameter index in; the estimation with names, units and correlations out.

use super::arrow::Arrow;
use super::choice::Chosen;
use super::problem::Layout;
use super::rank::{Combination, Verdict, Weak};
use super::solution::Solution;
use super::{Correlation, Estimation, OutputScatter, Row, Trace};
use crate::model::Model;

/// Puts names to a solution. `outputs` are the model's outputs of the noise classes.
pub fn name(
    model: &Model,
    chosen: &Chosen,
    layout: &Layout,
    outputs: &[usize],
    solution: Solution,
    responses: Vec<Vec<Trace>>,
) -> Estimation {
    let rows = rows(model, chosen, layout, &solution);
    let combinations = solution.weak.iter().map(|weak| combination(&rows, weak)).collect();
    Estimation {
        stop: solution.fit.stop,
        correlations: correlations(layout, &solution),
        det_r: libm::exp(solution.fit.ln_det),
        outputs: scatter(model, outputs, &solution, &responses),
        responses,
        verdict: Verdict { condition: solution.condition, singular: solution.singular, combinations },
        iterations: solution.fit.iterations,
        rows,
    }
}

fn rows(model: &Model, chosen: &Chosen, layout: &Layout, solution: &Solution) -> Vec<Row> {
    let (sd, crlb) = (deviations(solution.covariance.as_ref()), deviations(solution.crlb.as_ref()));
    let known = |sd: &[f64], i: usize| if solution.fit.held[i] { None } else { sd.get(i).copied() };
    let row = |(i, (name, unit, segment)): (usize, (String, String, Option<usize>))| Row {
        name,
        unit,
        segment,
        value: solution.fit.theta[i],
        sd: known(&sd, i),
        sd_crlb: known(&crlb, i),
        start: layout.start[i],
        at_bound: solution.fit.held[i],
    };
    names(model, chosen, layout.parts.len()).into_iter().enumerate().map(row).collect()
}

/// Name, unit and segment of every unknown, in the order of the parameter vector.
fn names(model: &Model, chosen: &Chosen, segments: usize) -> Vec<(String, String, Option<usize>)> {
    let parameter = |p: usize, segment: Option<usize>| {
        let q = &model.parameters[p].quantity;
        (q.name.clone(), q.unit.clone(), segment)
    };
    let mut names: Vec<_> = chosen.shared.iter().map(|&p| parameter(p, None)).collect();
    for s in 0..segments {
        names.extend(chosen.own.iter().map(|&p| parameter(p, Some(s))));
        let initial = chosen.initial.iter().map(|&i| &model.states[i].quantity);
        names.extend(initial.map(|q| (format!("{}(0)", q.name), q.unit.clone(), Some(s))));
    }
    names
}

/// Standard deviations in the order of the parameter vector; empty without a covariance.
fn deviations(covariance: Option<&Arrow>) -> Vec<f64> {
    let Some(c) = covariance else { return Vec::new() };
    let own = c.own.iter().flat_map(|own| (0..own.n).map(|i| own.ss[i * own.n + i]));
    (0..c.shared).map(|i| c.cc[i * c.shared + i]).chain(own).map(f64::sqrt).collect()
}

fn correlations(layout: &Layout, solution: &Solution) -> Vec<Correlation> {
    let (Some(c), Some(m)) = (&solution.covariance, &solution.crlb) else { return Vec::new() };
    let (sd, crlb) = (deviations(Some(c)), deviations(Some(m)));
    let nc = layout.shared;
    let mut out = Vec::new();
    let mut push = |a: usize, b: usize, ca: f64, cm: f64| {
        if !solution.fit.held[a] && !solution.fit.held[b] {
            out.push(Correlation { a, b, value: ca / (sd[a] * sd[b]), crlb: cm / (crlb[a] * crlb[b]) });
        }
    };
    for a in 0..nc {
        (a + 1..nc).for_each(|b| push(a, b, c.cc[a * nc + b], m.cc[a * nc + b]));
    }
    for ((part, own), bound) in layout.parts.iter().zip(&c.own).zip(&m.own) {
        for i in 0..own.n {
            (0..nc).for_each(|a| push(a, part.offset + i, own.sc[i * nc + a], bound.sc[i * nc + a]));
            for j in i + 1..own.n {
                push(part.offset + i, part.offset + j, own.ss[i * own.n + j], bound.ss[i * own.n + j]);
            }
        }
    }
    out
}

fn combination(rows: &[Row], weak: &Weak) -> Combination {
    let term = |&(i, change): &(usize, f64)| rows.get(i).map(|row| (row.name.clone(), row.segment, change));
    Combination { information: weak.information, terms: weak.terms.iter().filter_map(term).collect() }
}

fn scatter(model: &Model, outputs: &[usize], solution: &Solution, responses: &[Vec<Trace>]) -> Vec<OutputScatter> {
    let one = |(class, &output): (usize, &usize)| {
        let traces = responses.iter().flatten().filter(|t| t.output == output);
        let all: usize = traces.map(|t| t.t.len()).sum();
        let count = solution.fit.count[class];
        OutputScatter {
            name: model.outputs[output].name.clone(),
            unit: model.outputs[output].unit.clone(),
            r: solution.fit.r[class],
            count,
            masked: all - count,
            ar: solution.colour.get(class).map(|ar| ar.coefficients.clone()).unwrap_or_default(),
        }
    };
    outputs.iter().enumerate().map(one).collect()
}
