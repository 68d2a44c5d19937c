//! A compiled model over segments in; its maximum-likelihood estimate, with segments that cannot be
//! used left out and named, out.

use super::budget::influences;
use super::case::{Case, plan};
use super::choice::{Chosen, choose};
use super::extend::prepare;
use super::rank::{NONE, weak_words};
use super::result::{Further, name};
use super::segment::Segment;
use super::selection::select;
use super::solution::Solution;
use super::{Doubtful, Estimation, InitialFrom, LeftOut, Line, Settings, Stop};
use crate::dynamics::{Channel, Plan, Record};
use crate::error::{Error, Errors};
use crate::model::{Model, StartKind};

/// Estimates the free parameters of `model` jointly over `records`, one segment each, without
/// labels.
///
/// # Errors
/// As `estimate_segments`.
pub fn estimate(
    model: &Model,
    records: &[Record],
    settings: &Settings,
) -> Result<Estimation, Errors> {
    let segments: Vec<Segment> = records.iter().cloned().map(Segment::from).collect();
    estimate_segments(model, &segments, settings)
}

/// Estimates the free parameters of `model` jointly over `segments`.
///
/// `R` and the colour of the residuals are shared by all segments, or by those of a group
/// (`settings.noise_per`), and so are parameters. Initial states are those of the model
/// ("measured": the first measured value of the output of the state's name, in that segment), or
/// free per segment (`settings.initial`; they then start from the same value).
///
/// A segment that cannot take part is left out, with the reason, and the others go on: one without
/// a single measured sample, without the label that a free parameter is `per`, where the model is
/// not finite at the start, or whose own parameters (or those of its group) its data cannot
/// determine. Candidates that the data do not support are held (`selection`).
///
/// # Errors
/// Names that the model does not have, labels that no segment has, starts that are not finite or
/// outside their bounds, a measured start without a measured output: all at once. What the data do
/// is never an error: see `Estimation::stop`.
pub fn estimate_segments(
    model: &Model,
    segments: &[Segment],
    settings: &Settings,
) -> Result<Estimation, Errors> {
    select(settings, |settings| once(model, segments, settings))
}

/// Estimates all that is free, candidates included.
fn once(model: &Model, segments: &[Segment], settings: &Settings) -> Result<Estimation, Errors> {
    let base = model;
    let (model, segments) = prepare(base, segments, settings)?;
    let (model, segments) = (&*model, &*segments);
    let chosen = choose(model, segments, settings)?;
    let mut plan = plan(model, &chosen, segments)?;
    plan.compile(settings.tier, segments.iter().map(|s| s.record.n).sum());
    let given = starts(model, &plan, segments, &chosen, settings)?;
    let mut left_out: Vec<LeftOut> = Vec::new();
    let mut used: Vec<usize> = Vec::new();
    for s in 0..segments.len() {
        match unusable(model, &chosen, &segments[s], &given[s]) {
            Some(why) => left_out.push(LeftOut { segment: s, why }),
            None => used.push(s),
        }
    }
    if used.is_empty() {
        // The outcome is told over all that could be run.
        used = (0..segments.len()).filter(|&s| given[s].is_ok()).collect();
        left_out.retain(|left| !used.contains(&left.segment));
    }
    loop {
        let these: Vec<&Segment> = used.iter().map(|&s| &segments[s]).collect();
        let values = used.iter().filter_map(|&s| given[s].as_ref().ok().cloned()).collect();
        let mut case = Case::new(model, &chosen, &plan, &these, values, settings);
        let regression = case.start_by_regression(settings)?;
        let solution = case.solve(settings);
        let useless = useless(&case, &solution);
        if useless.is_empty() || useless.len() == used.len() {
            left_out.sort_by_key(|left| left.segment);
            let values = used.iter().filter_map(|&s| given[s].as_ref().ok().cloned()).collect();
            let budget = influences(base, &these, values, &case, &solution, settings)?;
            let further =
                Further { budget, profiles: case.profiles(&solution, settings), regression };
            let named = name(model, &case, &used, segments.len(), solution, further);
            return Ok(Estimation { left_out, doubtful: doubtful(model, segments), ..named });
        }
        left_out.extend(
            useless.iter().map(|(at, why)| LeftOut { segment: used[*at], why: why.clone() }),
        );
        used.retain(|s| left_out.iter().all(|left| left.segment != *s));
    }
}

/// Start values of the states that need one from outside, per segment, or why there is none.
///
/// # Errors
/// A state starts "measured", and its output is measured nowhere.
pub(super) fn starts(
    model: &Model,
    plan: &Plan,
    segments: &[Segment],
    chosen: &Chosen,
    settings: &Settings,
) -> Result<Vec<Result<Vec<f64>, String>>, Errors> {
    let mut errors = Errors::default();
    let measured = |name: &str| {
        let output = model.output(name);
        output.is_some_and(|o| {
            segments.iter().any(|s| s.record.channels.iter().any(|c| c.output == o))
        })
    };
    for state in
        model.states.iter().filter(|s| s.start == StartKind::Measured && !segments.is_empty())
    {
        let name = &state.quantity.name;
        if !measured(name) {
            let what = format!(
                "state \"{name}\" starts at its first measured value, but there is no measured output \"{name}\""
            );
            errors.push(
                Error::new(what)
                    .help("map a measured signal to that output, or give the state a start value"),
            );
        }
    }
    errors.or(())?;
    let values = |s: &Segment| {
        let first = match settings.initial_from {
            InitialFrom::Own => s,
            InitialFrom::First => segments.first().unwrap_or(s),
        };
        plan.first_values_of(model, &chosen.parameters, &s.record, &first.record)
            .map_err(|e| e.what)
    };
    Ok(segments.iter().map(values).collect())
}

/// Why a segment cannot take part, as far as its data and labels tell.
pub(super) fn unusable(
    model: &Model,
    chosen: &Chosen,
    segment: &Segment,
    given: &Result<Vec<f64>, String>,
) -> Option<String> {
    let record = &segment.record;
    let scored = |c: &Channel| {
        c.t.iter().zip(&c.z).any(|(t, z)| z.is_finite() && record.weights(*t).is_some())
    };
    if !record.channels.iter().any(scored) {
        return Some("it has no measured sample that is not masked".into());
    }
    let nu = model.inputs.len();
    for (i, input) in model.inputs.iter().enumerate() {
        let missing = (0..record.n)
            .filter(|k| record.inputs.get(k * nu + i).is_none_or(|u| !u.is_finite()))
            .count();
        if missing > 0 {
            return Some(format!("input {} has no value at {missing} of its samples", input.name));
        }
    }
    if let Some(column) = chosen.columns().find(|column| !segment.labels.contains_key(*column)) {
        return Some(format!("it has no \"{column}\", by which parameters differ"));
    }
    let known = |line: &Line| segment.conditions.get(&line.against).is_some_and(|x| x.is_finite());
    if let Some((_, line)) = chosen.lines.iter().find(|(_, line)| !known(line)) {
        return Some(format!("its \"{}\" is not known, which parameters follow", line.against));
    }
    given.as_ref().err().cloned()
}

/// Measured outputs that say little.
fn doubtful(model: &Model, segments: &[Segment]) -> Vec<Doubtful> {
    let mut found = Vec::new();
    for (segment, channel) in segments
        .iter()
        .enumerate()
        .flat_map(|(s, seg)| seg.record.channels.iter().map(move |c| (s, c)))
    {
        let mut finite = channel.z.iter().filter(|z| z.is_finite());
        let why = match finite.next() {
            None => "it has no sample that is not masked",
            Some(first) if channel.z.len() > 1 && finite.all(|z| z == first) => {
                "all its samples have the same value"
            }
            Some(_) => continue,
        };
        let output = model.outputs.get(channel.output).map(|o| o.name.clone()).unwrap_or_default();
        found.push(Doubtful { segment, output, why: why.to_string() });
    }
    found
}

/// Segments (places among those used) that keep the others from being estimated, and why: of a
/// model that is not finite at the start, those where it is not; of parameters that the data cannot
/// determine, those that they belong to. All of them, or none, means that leaving some out would
/// not help.
fn useless(case: &Case, solution: &Solution) -> Vec<(usize, String)> {
    let all = case.layout.parts.len();
    if solution.fit.stop == Stop::NotFinite {
        let finite = |s: &usize| is_finite(case, *s);
        return (0..all)
            .filter(|s| !finite(s))
            .map(|s| (s, "the model is not finite there at the start values".into()))
            .collect();
    }
    let mut found: Vec<(usize, String)> = Vec::new();
    for weak in solution.weak.iter().filter(|weak| solution.singular && weak.information <= NONE) {
        let segments = case.segments_of(weak.terms.iter().map(|t| t.0));
        if segments.len() == all {
            // Nothing that a segment could be blamed for.
            continue;
        }
        let names: Vec<&str> =
            weak.terms.iter().map(|t| case.unknowns[t.0].name.as_str()).collect();
        for s in segments {
            if found.iter().all(|(at, _)| *at != s) {
                found.push((s, weak_words(&names)));
            }
        }
    }
    found
}

fn is_finite(case: &Case, s: usize) -> bool {
    let blocks = case.evaluate(s, &case.layout.local(s, &case.layout.start), true);
    blocks.is_some_and(|blocks| {
        let finite = |v: &f64| (v * v).is_finite();
        blocks
            .iter()
            .all(|b| b.e.iter().filter(|e| !e.is_nan()).all(finite) && b.g.iter().all(finite))
    })
}
