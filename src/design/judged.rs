//! The estimates of all recordings of a design in; their means, errors, scatter and bounds, and the
//! place among the other designs, out.

use super::estimated::Run;
use super::flown::Facts;
use super::rows::Design;
use crate::estimate::Stop;
use crate::math::distribution::chi2_quantile;
use std::cmp::Ordering;

/// Errors that are larger than their bound count instead of it where chance makes them so large less often
/// than this.
const CHANCE: f64 = 0.05;

/// What became of a design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// Every recording gave an estimate with a covariance.
    Determined,
    /// Some did.
    Partly,
    /// None did.
    Unconverged,
    /// Some recording leaves a parameter undetermined.
    Undetermined,
    /// It could not be flown: there is nothing to rank.
    NotFlown,
}

impl Outcome {
    /// The stable text that tables carry.
    pub fn word(self) -> &'static str {
        match self {
            Outcome::Determined => "determined",
            Outcome::Partly => "partly determined",
            Outcome::Unconverged => "not converged",
            Outcome::Undetermined => "undetermined",
            Outcome::NotFlown => "not flown",
        }
    }
}

/// One parameter over all recordings that gave an estimate with a covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    pub name: String,
    pub unit: String,
    pub mean: f64,
    /// Mean less the true value; NaN where none is known.
    pub error: f64,
    /// Standard deviation between recordings; NaN for fewer than two.
    pub scatter: f64,
    /// Root mean square of the Cramer-Rao bounds.
    pub crlb: f64,
    /// Root mean square of the standard deviations that allow for coloured residuals.
    pub sd: f64,
}

/// A design under one estimate.
#[derive(Debug, Clone)]
pub struct Judged {
    pub estimate: String,
    pub design: Design,
    /// None where it could not be flown.
    pub facts: Option<Facts>,
    /// 1 for the smallest `expected`; none where it could not be flown.
    pub rank: Option<usize>,
    pub outcome: Outcome,
    /// Recordings, and those with a covariance.
    pub runs: usize,
    pub determined: usize,
    /// Means of trace and determinant of the Cramer-Rao bound; NaN where there is none.
    pub trace: f64,
    pub determinant: f64,
    /// Sum over the parameters of the mean squared error; NaN where a true value is not known.
    pub squared_error: f64,
    /// What it is ranked by: the trace; where the errors are beyond what it promises, with the squared errors
    /// of the parameters whose true values are known in the place of their bounds.
    pub expected: f64,
    pub parameters: Vec<Summary>,
    /// What went wrong, once each; empty where all is well.
    pub why: String,
}

/// Puts the recordings of one design together.
pub fn judge(
    estimate: &str,
    design: &Design,
    flown: std::result::Result<(&Facts, &[Run]), &str>,
) -> Judged {
    let (facts, runs) = match flown {
        Ok((facts, runs)) => (Some(facts.clone()), runs),
        Err(_) => (None, &[][..]),
    };
    let good: Vec<&Run> = runs.iter().filter(|run| run.trace.is_some()).collect();
    let outcome = match &flown {
        Err(_) => Outcome::NotFlown,
        _ if runs.iter().any(|run| run.stop == Stop::Singular) => Outcome::Undetermined,
        _ if good.is_empty() => Outcome::Unconverged,
        _ if good.len() < runs.len() => Outcome::Partly,
        _ => Outcome::Determined,
    };
    let parameters: Vec<Summary> = (0..good.first().map_or(0, |run| run.parameters.len()))
        .map(|p| summary(&good, p, facts.as_ref()))
        .collect();
    let mut reasons: Vec<String> = Vec::new();
    for run in runs.iter().filter(|run| run.trace.is_none()) {
        let reason = if run.why.is_empty() { run.stop.as_str() } else { run.why.as_str() };
        if !reasons.iter().any(|known| known == reason) {
            reasons.push(reason.to_string());
        }
    }
    reasons.extend(flown.err().map(str::to_string));
    // E (theta - truth)^2 = error^2 + variance of the recordings, summed over the parameters
    let mean_square = |p: usize| {
        let truth = parameters[p].mean - parameters[p].error;
        mean(good.iter().map(|run| (run.parameters[p].value - truth).powi(2)))
    };
    let squares: Vec<f64> = (0..parameters.len()).map(mean_square).collect();
    let trace = mean(good.iter().filter_map(|run| run.trace));
    let broken = broken(&squares, &parameters, good.len());
    reasons.extend(broken.as_ref().map(|b| {
        let times = b.error / b.bound;
        let digits = usize::from(times < 10.0);
        format!("the squared error is {times:.digits$} times what the bound promises: ranked by it")
    }));
    Judged {
        estimate: estimate.to_string(),
        design: design.clone(),
        rank: None,
        outcome,
        runs: runs.len(),
        determined: good.len(),
        trace,
        determinant: mean(good.iter().filter_map(|run| run.determinant)),
        squared_error: if good.is_empty() { f64::NAN } else { squares.iter().sum() },
        expected: broken.map_or(trace, |b| trace - b.bound + b.error),
        parameters,
        why: reasons.join("; "),
        facts,
    }
}

/// The squared errors of the parameters whose true values are known, and the bound of these.
struct Broken {
    error: f64,
    bound: f64,
}

/// Where errors are larger than the bound promises, and by more than so many recordings leave to chance.
fn broken(squares: &[f64], parameters: &[Summary], recordings: usize) -> Option<Broken> {
    let known = squares.iter().zip(parameters).filter(|(square, _)| square.is_finite());
    let (error, bound) = known
        .fold((0.0, 0.0), |(error, bound), (square, p)| (error + square, bound + p.crlb * p.crlb));
    // Most where one parameter is all of the sum: then it is a chi-square over its degrees of freedom.
    let n = recordings as f64;
    let most = chi2_quantile(1.0 - CHANCE, n) / n;
    (bound > 0.0 && error > most * bound).then_some(Broken { error, bound })
}

fn summary(good: &[&Run], p: usize, facts: Option<&Facts>) -> Summary {
    let first = &good[0].parameters[p];
    let values: Vec<f64> = good.iter().map(|run| run.parameters[p].value).collect();
    let middle = mean(values.iter().copied());
    let squares: f64 = values.iter().map(|v| (v - middle).powi(2)).sum();
    let truth = facts.and_then(|f| f.values.get(&first.name)).copied().unwrap_or(f64::NAN);
    let rms = |of: fn(&super::estimated::Parameter) -> Option<f64>| {
        mean(good.iter().filter_map(|run| of(&run.parameters[p])).map(|sd| sd * sd)).sqrt()
    };
    Summary {
        name: first.name.clone(),
        unit: first.unit.clone(),
        mean: middle,
        error: middle - truth,
        scatter: if values.len() < 2 {
            f64::NAN
        } else {
            (squares / (values.len() - 1) as f64).sqrt()
        },
        crlb: rms(|p| p.crlb),
        sd: rms(|p| p.sd),
    }
}

/// NaN for none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0usize), |(sum, n), v| (sum + v, n + 1));
    if n == 0 { f64::NAN } else { sum / n as f64 }
}

/// Ranks the designs of one estimate by the error that is expected: those that are determined first, those
/// that leave a parameter undetermined last; what could not be flown has no rank.
pub fn rank(judged: &mut [Judged]) {
    let mut order: Vec<usize> =
        (0..judged.len()).filter(|&i| judged[i].outcome != Outcome::NotFlown).collect();
    let compare = |a: &Judged, b: &Judged| match a.outcome.cmp(&b.outcome) {
        Ordering::Equal => a.expected.total_cmp(&b.expected),
        other => other,
    };
    order.sort_by(|&a, &b| compare(&judged[a], &judged[b]));
    for (place, i) in order.into_iter().enumerate() {
        judged[i].rank = Some(place + 1);
    }
}
