//! An estimation comes in; what is known to move its values and is not in their standard deviations goes
//! out, each cause as a note and as rows of `doubts`.
//!
//! Nothing here is a matter of the data's noise, which `sd` is about: a record that is late, a grid that is
//! coarse or noise of an input moves a value and leaves its `sd` small.

use super::batch::{Batch, Done};
use super::config::Config;
use crate::error::Result;
use crate::estimate::{Estimation, Late};
use crate::stage::{Note, Severity};
use crate::table::Table;

/// Parameters that are named in a note at most.
const NAMED: usize = 4;

/// One cause.
pub struct Doubt {
    /// What the table calls it.
    cause: &'static str,
    /// What the note is about: the group, or a segment.
    subject: String,
    text: String,
    /// Parameters with the standard deviations by which they are moved, those that are moved most first.
    moved: Vec<(String, f64)>,
}

impl Doubt {
    pub fn note(self, config: &Config, batch: &Batch) -> Note {
        let text = format!("{}: {}", batch.group, self.text);
        config.note("", Severity::Warning, self.subject, self.moved.len(), text)
    }
}

/// All that would move an estimate.
pub fn of(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Doubt> {
    let group = |(cause, text, moved): (&'static str, String, Vec<(String, f64)>)| Doubt {
        cause,
        subject: batch.group.clone(),
        text,
        moved,
    };
    let all = [
        coarse(estimation),
        edges(config, estimation),
        chords(estimation),
        noisy(estimation),
        skewed(estimation),
        ramps(estimation),
        regressors(estimation),
    ];
    let one = influential(batch, estimation);
    one.into_iter().chain(all.into_iter().flatten().map(group)).collect()
}

pub fn table(config: &Config, done: &[Done]) -> Result<Table> {
    let mut rows = Vec::new();
    for (batch, estimation) in done {
        for doubt in of(config, batch, estimation) {
            let of = |(parameter, by): (String, f64)| (&batch.group, doubt.cause, parameter, by);
            rows.extend(doubt.moved.into_iter().map(of));
        }
    }
    rows.sort_by(|a, b| (a.0, a.1, &a.2).cmp(&(b.0, b.1, &b.2)));
    Table::build("doubts")
        .repeat("model", &config.name())
        .strings("group", rows.iter().map(|row| row.0))
        .strings("cause", rows.iter().map(|row| row.1))
        .strings("parameter", rows.iter().map(|row| &row.2))
        .f64("by_sd", rows.iter().map(|row| row.3).collect::<Vec<_>>())
        .finish()
}

/// A cause as the table calls it, its sentence, and what it moves.
type Cause = Option<(&'static str, String, Vec<(String, f64)>)>;

/// Parameters with the sd by which they move.
fn words(all: &[(String, f64)]) -> String {
    let of = |(name, by): &(String, f64)| format!("{name} by {by:.1} sd");
    let words: Vec<String> = all.iter().take(NAMED).map(of).collect();
    match all.len().saturating_sub(NAMED) {
        0 => words.join(", "),
        more => format!("{} and {more} others", words.join(", ")),
    }
}

/// The sample on which the estimate hangs.
fn influential(batch: &Batch, estimation: &Estimation) -> Option<Doubt> {
    let sample = estimation.influential.as_ref()?;
    let (row, segment) =
        (estimation.rows.get(sample.row)?, batch.segments.get(sample.segment)?.clone());
    let text = format!(
        "{} hangs on one sample: without {} of {segment} at {:.3} s, {:.0} sd of the others' noise off the model, it would be {:.2} sd {}",
        row.name,
        sample.output,
        sample.t,
        sample.residual.abs(),
        sample.shift.abs(),
        if sample.shift > 0.0 { "larger" } else { "smaller" },
    );
    let moved = vec![(row.name.clone(), sample.shift.abs())];
    Some(Doubt { cause: "one sample", subject: segment, text, moved })
}

/// Estimates that depend on how fine the integration steps are.
fn coarse(estimation: &Estimation) -> Cause {
    let coarse = estimation.coarse.as_ref()?;
    let text = format!(
        "where a state meets its limit inside a step the motion is off: integration steps {} times finer would move {}: say `substeps` in [[estimate]]",
        coarse.finer,
        words(&coarse.moved)
    );
    Some(("coarse steps", text, coarse.moved.clone()))
}

/// Estimates that hang on when inputs stepped between two of their samples, unless the pipeline file says
/// how each of them runs there.
fn edges(config: &Config, estimation: &Estimation) -> Cause {
    let edges = estimation.edges.as_ref()?;
    let said: Vec<&str> = config.settings.interpolation.named().collect();
    if edges.inputs.iter().all(|(name, _)| said.contains(&name.as_str())) {
        return None;
    }
    let each = |(name, spacing): &(String, f64)| format!("{name} ({spacing:.3} s)");
    let names: Vec<String> = edges.inputs.iter().map(each).collect();
    let text = format!(
        "{} step between two samples, a straight line is drawn there, and steps at the later sample would move {}: record faster, or say `interpolation` in [[estimate]] (\"hold\" for a command that is held)",
        names.join(", "),
        words(&edges.moved)
    );
    Some(("edges between samples", text, edges.moved.clone()))
}

/// Estimates that straight lines between the points of the grid move.
fn chords(estimation: &Estimation) -> Cause {
    let chords = estimation.chords.as_ref()?;
    // Noise is not on the curve through its neighbours either: what it moves is told beside.
    let by_noise = |name: &String| {
        let noisy = estimation.noisy_inputs.iter().flat_map(|noisy| &noisy.moved);
        noisy.filter(|(moved, _)| moved == name).map(|(_, by)| *by).fold(0.0, f64::max)
    };
    let mut chords = chords.clone();
    chords.moved.retain(|(name, by)| *by > 2.0 * by_noise(name));
    if chords.moved.is_empty() || estimation.ramps.is_some() {
        return None;
    }
    let (points, remedy) = match chords.finer {
        true => ("points of the grid", "the record has more samples: a finer grid (`rate_hz`)"),
        false => ("samples of the record", "nothing but a faster record"),
    };
    let (curve, smooth) = match chords.smooth {
        true => ("smooth curves", ""),
        false => (
            "straight lines",
            "; where inputs have no edges, `interpolation = \"cubic\"` in [[estimate]]",
        ),
    };
    let [least, largest] = chords.spacing;
    let spacing = match largest - least > 0.1 * least {
        true => format!("{least:.3} to {largest:.3} s"),
        false => format!("{largest:.3} s"),
    };
    let text = format!(
        "inputs run on {curve} between {points} ({spacing}), which moves {}: {remedy} tells more, and half the spacing leaves a quarter of it{smooth}",
        words(&chords.moved)
    );
    Some(("curves between samples", text, chords.moved))
}

/// Estimates that noise of the inputs moves; of what it alone determines a note of its own tells.
fn noisy(estimation: &Estimation) -> Cause {
    let noisy = estimation.noisy_inputs.as_ref()?;
    let moved: Vec<(String, f64)> =
        noisy.moved.iter().filter(|(name, _)| !noisy.alone.contains(name)).cloned().collect();
    let text = format!(
        "the model is driven by measured inputs, and their noise (SI: {}) is expected to have moved {}: smooth them (`koehler` reconstructs the flight path), or make a state of what is noisy",
        noisy.words(),
        words(&moved)
    );
    (!moved.is_empty()).then_some(("noise of inputs", text, moved))
}

/// Records that look late against the others.
fn skewed(estimation: &Estimation) -> Cause {
    let skewed = estimation.skewed.as_ref()?;
    let each = |late: &Late| {
        let side = if late.by > 0.0 { "late" } else { "early" };
        let of = late.flight.iter().map(|flight| format!(" of {flight}")).collect::<String>();
        format!("{}{of} {:.4} +- {:.4} s {side}", late.record, late.by.abs(), late.sd)
    };
    let records: Vec<String> = skewed.records.iter().map(each).collect();
    let text = format!(
        "records look shifted in time against the others: {}. Put right, that would move {}: if it is the record, say `delay` of the signal in the channels file; if a lag lies between what is recorded and what acts, give the model one; what the model lacks otherwise may look so, too (`koehler diagnose` tells which fits)",
        records.join(", "),
        words(&skewed.moved)
    );
    Some(("records shifted in time", text, skewed.moved.clone()))
}

/// Delays of inputs that run along straight lines.
fn ramps(estimation: &Estimation) -> Cause {
    let ramps = estimation.ramps.as_ref()?;
    let each = |name: &String| format!("{name} = \"ramps\"");
    let settings: Vec<String> = ramps.inputs.iter().map(each).collect();
    let text = format!(
        "a delay() reads a smooth curve through the samples of {}; straight lines leave less (log-likelihood {:.1}), and move {}: say `interpolation = {{ {} }}` in [[estimate]]",
        ramps.inputs.join(", "),
        ramps.less,
        words(&ramps.moved),
        settings.join(", ")
    );
    Some(("curves that a delay reads", text, ramps.moved.clone()))
}

/// Estimates by equation error that the noise of the regressors is expected to have moved.
fn regressors(estimation: &Estimation) -> Cause {
    let regression = estimation.regression.as_ref().filter(|r| r.is_estimate)?;
    let of = |r: &crate::estimate::regression::Regressed| {
        let (row, shift, sd) = (estimation.rows.get(r.row)?, r.shift?, r.sd?);
        Some((row.name.clone(), shift, shift.abs() / sd))
    };
    let moved: Vec<_> = regression.rows.iter().filter(|r| r.is_moved()).filter_map(of).collect();
    let each = |(name, shift, _): &(String, f64, f64)| format!("{name} by {shift:.2e}");
    let text = format!(
        "noise in the regressors is expected to have moved these by more than their sd: {} (`shift` in the table regressions)",
        moved.iter().map(each).collect::<Vec<_>>().join(", ")
    );
    let moved: Vec<(String, f64)> = moved.into_iter().map(|(name, _, by)| (name, by)).collect();
    (!moved.is_empty()).then_some(("noise of regressors", text, moved))
}
