//! A base at its fit in; whether what it leaves of each output is its sensor's noise, and how much
//! of that its own past foretells, out.

use crate::diagnose::base::found::Found;
use crate::estimate::Trace;
use crate::noise::burg;
use crate::noise::{Products, Rule};
use crate::signal::adequacy::Adequacy;

/// What is left of one output, over all maneuvers.
#[derive(Debug, Clone, PartialEq)]
pub struct Left {
    pub output: String,
    pub unit: String,
    pub adequacy: Adequacy,
    /// Share of its mean square that an autoregressive model of it foretells from sample to sample:
    /// nothing of white noise. The white residuals by which everything else is measured are without
    /// it, so what is missing may be in it.
    pub foretold: f64,
}

/// Every scored output.
pub fn left(found: &Found) -> Vec<Left> {
    let case = found.case();
    let (mut all, mut records): (Vec<Trace>, Vec<Option<&str>>) = (Vec::new(), Vec::new());
    for s in 0..case.records.len() {
        let stretch = found.prepared.segments[found.prepared.used[s]].stretch.as_ref();
        let of = stretch.map(|stretch| stretch.of.as_str());
        for trace in case.traces(s, &found.theta(s)) {
            if !case.outputs.contains(&trace.output) {
                continue;
            }
            // Stretches of one record move about one mean.
            let same = |(t, r): (&Trace, &Option<&str>)| {
                of.is_some() && *r == of && t.output == trace.output
            };
            match all.iter().zip(&records).position(same) {
                Some(at) => {
                    all[at].t.append(&trace.t);
                    all[at].measured.append(&trace.measured);
                    all[at].modelled.extend(trace.modelled);
                }
                None => {
                    all.push(trace);
                    records.push(of);
                }
            }
        }
    }
    of_traces(&all, found.method.colour())
}

/// The same of traces, output by output in their order.
pub fn of_traces(traces: &[Trace], rule: Rule) -> Vec<Left> {
    let mut all: Vec<(Left, Products)> = Vec::new();
    for trace in traces {
        let e: Vec<f64> = trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).collect();
        let one = Adequacy::of(&trace.measured, &trace.modelled);
        let at = all.iter().position(|(l, _)| l.output == trace.name).unwrap_or(all.len());
        if at == all.len() {
            let (output, unit) = (trace.name.clone(), trace.unit.clone());
            let (adequacy, foretold) = (Adequacy::default(), 0.0);
            all.push((Left { output, unit, adequacy, foretold }, Products::new(rule.highest)));
        }
        all[at].0.adequacy.add(&one);
        let known = |e: f64| if e.is_finite() { e } else { f64::NAN };
        all[at].1.take(&e.into_iter().map(known).collect::<Vec<_>>());
    }
    let told = |(left, products): (Left, Products)| {
        let (whole, rest) =
            (products.variance(), burg::fit(&products, rule.criterion).model.variance);
        let foretold = if whole > 0.0 { (1.0 - rest / whole).clamp(0.0, 1.0) } else { 0.0 };
        Left { foretold, ..left }
    };
    all.into_iter().map(told).collect()
}
