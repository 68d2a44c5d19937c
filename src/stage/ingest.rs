//! A flight's log and the channel map come in; its signals in SI, an account of every channel, and
//! notes go out.

use super::{Campaign, Inputs, Key, Known, Note, Output, Severity, Stage, Told, Unit, slice_of};
use crate::error::{Error, Errors, Result};
use crate::log::{self, FlightLog};
use crate::table::Table;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

pub const STAGE: Stage = Stage {
    name: "ingest",
    about: "read the logs",
    key: Some(Key::of::<Settings>()),
    check,
    units: Unit::flights,
    writes: &["signals", "channels", "left_out"],
    reads_log: true,
    slice,
    run,
    ..Stage::PLAIN
};

/// How logs are read.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// What the chunks of all logs may take at a time, as they stand in the log and decompressed, over all threads, MiB. A
    /// larger chunk is left out, and a note says so. Default 1024, at most 1048576 (a TiB).
    #[serde(default = "chunk_memory")]
    #[schemars(range(max = 1048576))]
    pub chunk_memory_mib: u64,
}

fn chunk_memory() -> u64 {
    log::memory::DEFAULT_MIB
}

fn settings(told: &Told) -> Option<&Settings> {
    told.get("ingest")
}

fn check(told: &mut Told, known: &mut Known) {
    if settings(told).is_some_and(|s| s.chunk_memory_mib == 0) {
        known.given.push(
            "ingest.chunk_memory_mib",
            "chunks need some memory: 1 or more, not 0",
            "",
        );
    }
}

fn slice(campaign: &Campaign, _: &Unit) -> Value {
    slice_of(&(&campaign.channels.map, settings(&campaign.told)))
}

fn run(campaign: &Campaign, unit: &Unit, inputs: &Inputs) -> std::result::Result<Output, Errors> {
    let channels = &campaign.channels;
    let log = inputs.log.ok_or_else(|| Error::new(format!("flight {} has no log", unit.name)))?;
    log::memory::limit_chunks(
        settings(&campaign.told).map_or_else(chunk_memory, |s| s.chunk_memory_mib),
    );
    let mut flight = log::read_flight(log, &channels.map, &channels.doc)?;
    let accounts = accounts(campaign, &unit.name, &flight)?;
    let left_out = left_out(campaign, &unit.name, &flight)?;
    let notes = flight.notes.iter().map(|n| note(&unit.name, n)).collect();
    let signals = signals(&unit.name, &mut flight)?;
    let tables = vec![("signals", signals), ("channels", accounts), ("left_out", left_out)];
    Ok(Output { tables, files: Vec::new(), notes })
}

fn note(flight: &str, n: &log::Note) -> Note {
    let severity = match n.severity {
        log::Severity::Info => Severity::Info,
        log::Severity::Warning => Severity::Warning,
        log::Severity::Missing => Severity::Missing,
    };
    Note {
        flight: flight.to_string(),
        stage: STAGE.name.to_string(),
        severity,
        subject: n.subject.clone(),
        count: n.count,
        text: n.text.clone(),
    }
}

/// The long table of all signals, by signal and time. Of a long flight they are most of what there
/// is: each is let go as soon as it is in the table.
fn signals(id: &str, flight: &mut FlightLog) -> Result<Table> {
    let mut all: Vec<(&String, &mut log::Series)> =
        flight.signals.iter_mut().map(|(name, signal)| (name, &mut signal.series)).collect();
    all.sort_by_key(|(name, _)| *name);
    let runs: Vec<(&str, usize)> =
        all.iter().map(|(name, series)| (name.as_str(), series.t_s.len())).collect();
    let rows = runs.iter().map(|(_, rows)| rows).sum();
    let (mut t, mut values) = (Vec::with_capacity(rows), Vec::with_capacity(rows));
    for (_, series) in all {
        t.append(&mut std::mem::take(&mut series.t_s));
        values.append(&mut std::mem::take(&mut series.value));
    }
    Table::build("signals")
        .repeat("flight", id)
        .runs("signal", runs)
        .f64("t_s", t)
        .f64("value", values)
        .finish()
}

/// Samples that are left out, and those around them, by signal and time.
fn left_out(campaign: &Campaign, id: &str, flight: &FlightLog) -> Result<Table> {
    let mut order: Vec<&String> = flight.signals.keys().collect();
    order.sort();
    let of = |name: &String| &flight.signals[name].left_out;
    let all: Vec<(&String, &log::Seen)> =
        order.into_iter().flat_map(|name| of(name).iter().map(move |seen| (name, seen))).collect();
    Table::build("left_out")
        .repeat("flight", id)
        .strings("signal", all.iter().map(|(name, _)| name))
        .strings("unit", all.iter().map(|(name, _)| campaign.channels.unit(name)))
        .i64("place", all.iter().map(|(_, seen)| seen.place as i64).collect::<Vec<_>>())
        .f64("t_s", all.iter().map(|(_, seen)| seen.t_s).collect::<Vec<_>>())
        .f64("value", all.iter().map(|(_, seen)| seen.value).collect::<Vec<_>>())
        .strings("fate", all.iter().map(|(_, seen)| seen.fate.word()))
        .finish()
}

fn accounts(campaign: &Campaign, id: &str, flight: &FlightLog) -> Result<Table> {
    let mut order: Vec<&String> = flight.signals.keys().collect();
    order.sort();
    let accounts: Vec<_> = order.iter().map(|name| &flight.signals[*name].account).collect();
    let count =
        |of: fn(&log::Account) -> u64| accounts.iter().map(|a| of(a) as i64).collect::<Vec<i64>>();
    let number =
        |of: fn(&log::Account) -> f64| accounts.iter().map(|a| of(a)).collect::<Vec<f64>>();
    let still: Vec<[f64; 2]> = accounts.iter().map(|a| a.still.unwrap_or([f64::NAN; 2])).collect();
    Table::build("channels")
        .repeat("flight", id)
        .strings("signal", &order)
        .strings("topic", accounts.iter().map(|a| &a.topic))
        .strings("field", accounts.iter().map(|a| &a.field))
        .strings("unit", order.iter().map(|name| campaign.channels.unit(name)))
        .i64("count", count(|a| a.count))
        .f64("rate_hz", number(|a| if a.count > 1 { a.rate_hz } else { f64::NAN }))
        .i64("dropped_duplicate", count(|a| a.dropped_duplicate))
        .i64("reordered", count(|a| a.reordered))
        .i64("dropped_out_of_order", count(|_| 0))
        .i64("dropped_nan", count(|a| a.dropped_nan))
        .i64("dropped_unreadable", count(|a| a.dropped_unreadable))
        .i64("dropped_out_of_range", count(|a| a.dropped_out_of_range))
        .i64("dropped_spikes", count(|a| a.dropped_spikes))
        .i64("dropped_still", count(|a| a.dropped_still))
        .i64("dropped_times", count(|a| a.dropped_times))
        .f64("longest_gap_s", number(|a| if a.count > 1 { a.longest_gap_s } else { f64::NAN }))
        .f64("t_first_s", number(|a| a.t_first_s))
        .f64("t_last_s", number(|a| a.t_last_s))
        .f64("still_from_s", still.iter().map(|s| s[0]).collect::<Vec<_>>())
        .f64("still_to_s", still.iter().map(|s| s[1]).collect::<Vec<_>>())
        .f64("min", number(|a| a.min))
        .f64("max", number(|a| a.max))
        .finish()
}
