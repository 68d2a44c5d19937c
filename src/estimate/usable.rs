//! Segments in; the start values of their states, and why one cannot take part in an estimation, as
//! far as its data and labels tell, out.

use super::choice::Chosen;
use super::segment::Segment;
use super::{InitialFrom, Line, Settings};
use crate::dynamics::{Channel, Propagator};
use crate::error::{Error, Errors};
use crate::model::{Model, StartKind};

/// Start values of the states that need one from outside, per segment, or why there is none.
///
/// # Errors
/// A state starts "measured", and its output is measured nowhere.
pub(super) fn starts(
    model: &Model,
    propagator: &Propagator,
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
        propagator
            .first_values(model, &chosen.parameters, &s.record, &first.record)
            .map_err(|e| e.what)
    };
    Ok(segments.iter().map(values).collect())
}

/// Why a segment cannot take part.
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
