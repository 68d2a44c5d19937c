//! Signals and samples of a flight come in; the maneuvers flown in it, and the trimmed condition
//! before each, go out.

mod config;

use super::{Campaign, Inputs, Note, Output, Read, Severity, Stage, Unit, series, slice_of};
use crate::error::{Errors, Result};
use crate::segment::{self, CutOff, Maneuver, Source, Step};
use crate::table::Table;
use serde_json::{Value, json};

pub use config::{Config, InputSettings, Settings};

pub const STAGE: Stage = Stage {
    name: "segment",
    about: "find maneuvers",
    units: |campaign| if campaign.segment.is_some() { Unit::flights(campaign) } else { Vec::new() },
    writes: &["segments", "steps", "conditions"],
    reads: |_, unit| Read::flight(&["signals", "samples"], &unit.name),
    slice,
    run,
    ..Stage::PLAIN
};

/// A maneuver with the input it was found in.
struct Found<'a> {
    input: &'a InputSettings,
    maneuver: Maneuver,
}

fn slice(campaign: &Campaign, unit: &Unit) -> Value {
    let Some(config) = &campaign.segment else { return Value::Null };
    // Only the edits of this flight: one of another flight changes nothing here.
    let mut edits = config.settings.edits.clone();
    edits.include.retain(|e| e.flight == unit.name);
    edits.exclude.retain(|e| e.flight == unit.name);
    edits.moves.retain(|e| e.flight == unit.name);
    json!({ "input": slice_of(&config.settings.input), "edits": slice_of(&edits) })
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let Some(config) = &campaign.segment else { return Ok(Output::default()) };
    let flight = unit.name.as_str();
    let searched: Vec<String> =
        config.settings.input.iter().map(|input| input.signal.clone()).collect();
    let signals = inputs.signals(flight, &searched)?.unwrap_or(Table::empty("signals")?);
    let (samples, signals) = (&inputs.of("samples", flight)?, series(&signals)?);
    let mut errors = Errors::default();
    let (mut found, mut notes) = (Vec::new(), Vec::new());
    for input in &config.settings.input {
        let (t, u) = match signals.get(input.signal.as_str()) {
            Some(series) => *series,
            None if samples.has(&input.signal) => {
                (samples.f64("t_s")?, samples.f64(&input.signal)?)
            }
            None => {
                notes.push(lacking(flight, input));
                continue;
            }
        };
        let segment::Found { maneuvers, cut } = segment::search(t, u, &input.method);
        notes.extend(cut.iter().map(|cut| cut_note(flight, input, cut)));
        let source = Source { flight, input: input.name(), t, u };
        let edited = segment::apply(
            maneuvers,
            &config.settings.edits,
            &source,
            &input.method,
            &config.edits,
        );
        let maneuvers = errors.take(edited).unwrap_or_default();
        notes.extend(note(flight, input, &maneuvers));
        found.extend(maneuvers.into_iter().map(|maneuver| Found { input, maneuver }));
    }
    errors.or(())?;
    found.sort_by(|a, b| {
        a.maneuver.t_start.total_cmp(&b.maneuver.t_start).then(a.input.name().cmp(b.input.name()))
    });
    let tables = vec![
        ("segments", segments(flight, &found)?),
        ("steps", steps(flight, &found)?),
        ("conditions", conditions(flight, &found, samples)?),
    ];
    Ok(Output { tables, files: Vec::new(), notes })
}

/// A maneuver's id, unique in the campaign: the flight and a number in order of time.
fn id(flight: &str, index: usize) -> String {
    format!("{flight}.{:02}", index + 1)
}

/// What to say about the maneuvers of one input: that there are none, or that some were left out by
/// hand.
fn note(flight: &str, input: &InputSettings, maneuvers: &[Maneuver]) -> Option<Note> {
    let used = maneuvers.iter().filter(|m| m.included).count();
    let (severity, count, text) = match (used, maneuvers.len()) {
        (0, 0) if input.optional => return None,
        (0, n) if !input.optional => (
            Severity::Missing,
            1,
            format!("no maneuver in `{}`; {n} were excluded by hand", input.signal),
        ),
        (used, n) if used < n => (
            Severity::Info,
            n - used,
            format!("{} of {n} maneuvers in `{}` excluded by hand", n - used, input.signal),
        ),
        _ => return None,
    };
    let text = text.replace("; 0 were excluded by hand", "");
    let (flight, stage) = (flight.to_string(), STAGE.name.to_string());
    Some(Note {
        flight,
        stage,
        severity,
        subject: input.name().to_string(),
        count: count as u64,
        text,
    })
}

/// What to say where nothing can be searched.
fn lacking(flight: &str, input: &InputSettings) -> Note {
    Note {
        flight: flight.to_string(),
        stage: STAGE.name.to_string(),
        severity: if input.optional { Severity::Info } else { Severity::Missing },
        subject: input.name().to_string(),
        count: 1,
        text: format!("no maneuver in `{}`: this flight has no sample of it", input.signal),
    }
}

/// What to say about steps that a gap or the end of the record cuts off. One step alone that is there
/// when the record ends may be a new trim.
fn cut_note(flight: &str, input: &InputSettings, cut: &CutOff) -> Note {
    let certain = cut.by_gap || cut.steps > 1;
    let by = if cut.by_gap { "a gap" } else { "the end of the record" };
    Note {
        flight: flight.to_string(),
        stage: STAGE.name.to_string(),
        severity: if certain { Severity::Warning } else { Severity::Info },
        subject: input.name().to_string(),
        count: 1,
        text: format!(
            "steps of `{}` from {:.1} s on are cut off by {by} at {:.1} s: no maneuver as it was flown",
            input.signal, cut.from, cut.to
        ),
    }
}

fn segments(flight: &str, found: &[Found]) -> Result<Table> {
    let number =
        |of: fn(&Maneuver) -> f64| found.iter().map(|f| of(&f.maneuver)).collect::<Vec<f64>>();
    let by_hand = |m: &Maneuver| m.score == 0.0 && !m.reason.is_empty();
    Table::build("segments")
        .repeat("flight", flight)
        .strings("segment", (0..found.len()).map(|i| id(flight, i)))
        .strings("kind", found.iter().map(|f| f.maneuver.kind.name()))
        .strings("input", found.iter().map(|f| f.input.name()))
        .f64("t_start_s", number(|m| m.t_start))
        .f64("t_end_s", number(|m| m.t_end))
        .f64(
            "unit_time_s",
            number(|m| if m.kind == segment::Kind::Step { f64::NAN } else { m.unit_time }),
        )
        .f64("amplitude", number(|m| m.amplitude))
        .i64(
            "polarity",
            found
                .iter()
                .map(|f| if f.maneuver.polarity < 0.0 { -1 } else { 1 })
                .collect::<Vec<i64>>(),
        )
        .f64(
            "score",
            found
                .iter()
                .map(|f| if by_hand(&f.maneuver) { f64::NAN } else { f.maneuver.score })
                .collect::<Vec<_>>(),
        )
        .bools("included", found.iter().map(|f| f.maneuver.included).collect::<Vec<_>>())
        .opt_strings(
            "reason",
            found.iter().map(|f| Some(f.maneuver.reason.as_str()).filter(|r| !r.is_empty())),
        )
        .finish()
}

/// The levels of every maneuver, one by one.
fn steps(flight: &str, found: &[Found]) -> Result<Table> {
    let all: Vec<(usize, usize, &Step)> = (found.iter().enumerate())
        .flat_map(|(i, f)| f.maneuver.steps.iter().enumerate().map(move |(k, s)| (i, k + 1, s)))
        .collect();
    let number = |of: fn(&Step) -> f64| all.iter().map(|(_, _, s)| of(s)).collect::<Vec<f64>>();
    Table::build("steps")
        .repeat("flight", flight)
        .strings("segment", all.iter().map(|(i, ..)| id(flight, *i)))
        .i64("step", all.iter().map(|(_, k, _)| *k as i64).collect::<Vec<i64>>())
        .f64("t_start_s", number(|s| s.start))
        .f64("t_end_s", number(|s| s.end))
        .f64("level", number(|s| s.level))
        .f64("rise_s", number(|s| s.rises.0))
        .f64("fall_s", number(|s| s.rises.1))
        .finish()
}

/// Means of every column of the samples over the quiet time before each maneuver.
fn conditions(flight: &str, found: &[Found], samples: &Table) -> Result<Table> {
    let t = samples.f64("t_s")?;
    let columns: Vec<_> = samples
        .columns()
        .iter()
        .filter(|c| !["flight", "t_s"].contains(&c.name.as_str()))
        .collect();
    let (mut segment, mut signal, mut unit, mut value) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (i, f) in found.iter().enumerate() {
        let (from, to) = f.maneuver.pre_window(f.input.method.quiet_s);
        let rows = t.partition_point(|t| *t < from)..t.partition_point(|t| *t <= to);
        for column in &columns {
            let values = samples.f64(&column.name)?.get(rows.clone()).unwrap_or_default();
            segment.push(id(flight, i));
            signal.push(column.name.as_str());
            unit.push(column.unit.as_str());
            value.push(mean(values));
        }
    }
    let order: Vec<usize> = sorted(&segment, &signal);
    Table::build("conditions")
        .repeat("flight", flight)
        .strings("segment", order.iter().map(|i| &segment[*i]))
        .strings("signal", order.iter().map(|i| signal[*i]))
        .strings("unit", order.iter().map(|i| unit[*i]))
        .f64("value", order.iter().map(|i| value[*i]).collect::<Vec<_>>())
        .finish()
}

fn sorted(segment: &[String], signal: &[&str]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..segment.len()).collect();
    order.sort_by_key(|i| (&segment[*i], signal[*i]));
    order
}

/// Mean of the values that are there; NaN where there is none.
fn mean(values: &[f64]) -> f64 {
    let finite = values.iter().filter(|v| v.is_finite());
    finite.clone().sum::<f64>() / finite.count() as f64
}
