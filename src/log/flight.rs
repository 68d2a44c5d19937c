//! A log file and a channel map in; every signal as an SI series on the flight's time base, with
//! its account, out.
//!
//! Time base: `t_s` is seconds since the earliest log time of any intact message of the file, of
//! those that are not more than a day before the others; computed in integer nanoseconds, one zero
//! for all topics and signals of a flight, whichever time stamp a signal uses.

use super::channel_map::{ChannelMap, SignalMap, TimeSource};
use super::counts::Counts;
use super::decode::{FieldInfo, rest_of};
use super::file::LogFile;
use super::left_out::Seen;
use super::listing::{self, Fields};
use super::parts::{PartData, TopicPlan, decode_parts};
use super::pauses::{self, Recorded};
use super::series::{Account, DAY_NS, Series};
use super::signal::Context;
use super::{Mistake, Note, agree, clocks};
use crate::config::Doc;
use crate::error::{Error, Errors, Place};
use indexmap::IndexMap;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// One flight: the signals of the channel map, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightLog {
    /// The file's name.
    pub name: String,
    /// Log time of `t_s = 0`, ns (since 1970 for most recorders).
    pub start_ns: u64,
    pub signals: IndexMap<String, SignalLog>,
    /// What was lost or noticed, in a fixed order.
    pub notes: Vec<Note>,
}

/// One signal of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct SignalLog {
    pub series: Series,
    pub account: Account,
    /// Samples out of range and spikes, with their neighbours.
    pub left_out: Vec<Seen>,
}

/// Reads the signals of the map from one log.
///
/// # Errors
/// The file cannot be read; or, all at once and each at its place in the map: topics and fields
/// that the log does not have, encodings that cannot be decoded, time stamps that are not there.
pub fn read_flight(path: &Path, map: &ChannelMap, doc: &Doc) -> Result<FlightLog, Errors> {
    let log = LogFile::open(path)?;
    let (plans, remarks) = plan(&log, map, doc)?;
    let parts = decode_parts(&log, &plans)?;
    let start_ns = start(&parts);
    let mut notes = log.notes.clone();
    notes.extend(damage_note(&log, &parts));
    notes.extend(count_notes(&log, &plans, &parts));
    notes.extend(plans.iter().enumerate().filter_map(|(at, plan)| two_sources(at, plan, &parts)));
    notes.extend(remarks);

    let signals: Vec<(&String, &SignalMap)> = map.signal.iter().collect();
    let context = Context { log: &log, map, doc, plans: &plans, parts: &parts, start_ns };
    let read: Vec<_> =
        signals.par_iter().map(|(name, signal)| there(&context, name, signal)).collect();
    let mut errors = Errors::default();
    let mut out = IndexMap::new();
    for ((name, _), result) in signals.into_iter().zip(read) {
        if let Some((signal, more)) = errors.take(result) {
            notes.extend(more);
            out.insert(name.clone(), signal);
        }
    }
    // One clock of two is one mistake of all signals that it gives the times of.
    errors.0.dedup_by(|b, a| a.what == b.what && a.help.as_deref() == Some(clocks::HELP));
    notes.extend(pauses::notes(&out.iter().map(recorded).collect::<Vec<_>>()));
    errors.or(FlightLog { name: log.name(), start_ns, signals: out, notes })
}

fn recorded<'a>((name, signal): (&'a String, &'a SignalLog)) -> Recorded<'a> {
    let SignalLog { account, series, .. } = signal;
    let (topic, field, rate_hz) = (&account.topic, &account.field, account.rate_hz);
    Recorded { name, topic, field, rate_hz, t_s: &series.t_s }
}

/// The earliest log time of a flight. What stands more than a day before the middle one was given by a
/// clock that was wrong, and would put the whole flight a day late.
fn start(parts: &[PartData]) -> u64 {
    let earliest = parts.iter().filter_map(|part| part.earliest);
    let topics = parts.iter().flat_map(|part| &part.topics);
    let mut times: Vec<u64> = topics.flat_map(|topic| &topic.log).copied().collect();
    let middle = times.len() / 2;
    let first = match times.is_empty() {
        true => 0,
        false => times.select_nth_unstable(middle).1.saturating_sub(DAY_NS.unsigned_abs()),
    };
    earliest.chain(times).filter(|t| *t >= first).min().unwrap_or(0)
}

/// A signal of a flight; one that may be lacking, and is, has no sample, and a note says why.
fn there(
    context: &Context,
    name: &str,
    signal: &SignalMap,
) -> Result<(SignalLog, Vec<Note>), Errors> {
    let read = context.signal(name, signal);
    let Err(errors) = read.as_ref() else { return read };
    if !signal.optional {
        return read;
    }
    let account = Account {
        topic: signal.topic.clone(),
        field: signal.field.clone(),
        unit: signal.unit.clone(),
        ..Account::default()
    };
    let told = context.plans.iter().any(|plan| plan.topic == signal.topic);
    let why = errors.0.iter().filter(|_| told);
    let notes = why.map(|e| Note::warning(name, 1, format!("{name} has no sample: {}", e.what)));
    Ok((SignalLog { series: Series::default(), account, left_out: Vec::new() }, notes.collect()))
}

/// One plan per topic that the map asks for, in the order of the topics' names; notes of units that
/// cannot be compared with the log's.
fn plan(log: &LogFile, map: &ChannelMap, doc: &Doc) -> Result<(Vec<TopicPlan>, Vec<Note>), Errors> {
    let (mut errors, mut remarks) = (Errors::default(), Vec::new());
    let mut wanted: BTreeMap<&str, Vec<(&String, &SignalMap)>> = BTreeMap::new();
    for (name, signal) in &map.signal {
        let place = doc.place(&format!("signal.{name}.topic"));
        match topic_mistake(log, &signal.topic, place)? {
            Some(mistake) if signal.optional => {
                let why = mistake.of(&log.name()).what;
                remarks.push(Note::warning(name, 1, format!("{name} has no sample: {why}")));
            }
            Some(mistake) => errors.push(mistake.of(&log.name())),
            None => wanted.entry(&signal.topic).or_default().push((name, signal)),
        }
    }
    let ids = |topic: &str| {
        log.channels.iter().filter(|(_, c)| c.topic == topic).map(|(&id, _)| id).collect::<Vec<_>>()
    };
    let all: Vec<u16> = wanted.keys().flat_map(|t| ids(t)).collect();
    let first = listed(log, &all, &wanted, map)?;
    let make = |(topic, signals): (&str, Vec<(&String, &SignalMap)>)| {
        let channels = ids(topic);
        let fields = listing::together(&channels, &first);
        let mut paths: Vec<String> = Vec::new();
        for (name, signal) in signals {
            match agree::unit(name, signal, &fields, doc.place(&format!("signal.{name}.unit"))) {
                agree::Stated::Agrees => {}
                agree::Stated::Unknown(remark) => {
                    remarks.push(Note::warning(name, 1, remark.of(&log.name()).what))
                }
                agree::Stated::Other(mistake) => errors.push(mistake.of(&log.name())),
            }
            let stamps = match map.time_source(signal) {
                TimeSource::Field(path, unit, _) => {
                    let mut paths = stamp_paths(&path, unit, &fields);
                    paths.extend(rest_path(&path, unit));
                    paths
                }
                _ => Vec::new(),
            };
            for path in std::iter::once(signal.field.clone()).chain(stamps) {
                if !paths.contains(&path) {
                    paths.push(path);
                }
            }
        }
        TopicPlan { topic: topic.to_string(), channels, paths, fields }
    };
    let plans = wanted.into_iter().map(make).collect();
    errors.or((plans, remarks))
}

/// A topic that is not there, or cannot be decoded.
fn topic_mistake(log: &LogFile, topic: &str, place: Place) -> Result<Option<Mistake>, Error> {
    let Some(mistake) = agree::topic_mistake(&log.channels, topic, place) else { return Ok(None) };
    let is_named = log.channels.values().any(|channel| channel.topic == topic);
    // it may be there all the same, where what names it is damaged
    Ok(Some(match if is_named { 0 } else { log.unnamed()? } {
        0 => mistake,
        unnamed => agree::unnamed(mistake, topic, unnamed),
    }))
}

/// The fields of the channels: of their first messages, and of many where those lack one that the map
/// names and that is not optional, or that the schema has.
fn listed(
    log: &LogFile,
    ids: &[u16],
    wanted: &BTreeMap<&str, Vec<(&String, &SignalMap)>>,
    map: &ChannelMap,
) -> Result<Fields, Error> {
    let mut first = listing::at_first(log, ids)?;
    let mut lacking = Vec::new();
    for (topic, signals) in wanted {
        let is_of = |id: &&u16| log.channels.get(id).is_some_and(|c| c.topic == *topic);
        let channels: Vec<u16> = ids.iter().filter(is_of).copied().collect();
        let has = listing::together(&channels, &first);
        let schema = listing::together(&channels, &listing::of_schemas(&log.channels, &channels));
        let lacks = |path: &str, optional: bool| {
            agree::field(&has, path).is_none()
                && (!optional || agree::field(&schema, path).is_some())
        };
        let lacks_any = |(_, signal): &(&String, &SignalMap)| {
            let stamps = match map.time_source(signal) {
                TimeSource::Field(path, unit, _) => stamp_paths(&path, unit, &has),
                _ => Vec::new(),
            };
            lacks(&signal.field, signal.optional)
                || stamps.iter().any(|path| lacks(path, signal.optional))
        };
        if signals.iter().any(lacks_any) {
            lacking.extend(channels);
        }
    }
    if !lacking.is_empty() {
        first.extend(listing::throughout(log, &lacking)?);
    }
    Ok(first)
}

/// A stamp is one field, or (as ROS writes it) a pair of seconds and nanoseconds below the given
/// path.
pub(super) fn stamp_paths(path: &str, unit: Option<f64>, fields: &[FieldInfo]) -> Vec<String> {
    let has = |p: &str| fields.iter().any(|f| f.path == p);
    let pair = |s: &str, ns: &str| (format!("{path}.{s}"), format!("{path}.{ns}"));
    for (sec, nanosec) in [
        pair("sec", "nanosec"),
        pair("sec", "nsec"),
        pair("secs", "nsecs"),
        pair("seconds", "nanos"),
    ] {
        if unit.is_none() && has(&sec) && has(&nanosec) {
            return vec![sec, nanosec];
        }
    }
    vec![path.to_string()]
}

/// Where a stamp in whole ns has what an `f64` cannot hold of it.
pub(super) fn rest_path(path: &str, unit: Option<f64>) -> Option<String> {
    (unit == Some(1.0)).then(|| rest_of(path))
}

/// Where the messages of the topics that are read are not as many as the log counts.
fn count_notes(log: &LogFile, plans: &[TopicPlan], parts: &[PartData]) -> Vec<Note> {
    let mut counts = Counts::default();
    parts.iter().for_each(|part| counts.merge(&part.counts));
    let concerns = |n: &Note| n.subject == "file" || plans.iter().any(|p| p.topic == n.subject);
    log.counted(&counts).into_iter().filter(concerns).collect()
}

/// A topic that several channels write by turns. A recorder that begins a new channel does so once.
fn two_sources(at: usize, plan: &TopicPlan, parts: &[PartData]) -> Option<Note> {
    let count = plan.channels.len() as u64;
    let alternates: u64 = parts.iter().map(|part| part.topics[at].alternates).sum();
    let text = format!(
        "{}: {count} channels write to it by turns: several sources are read as if they were one",
        plan.topic
    );
    (alternates > 2 * count).then(|| Note::warning(&plan.topic, count, text))
}

fn damage_note(log: &LogFile, parts: &[PartData]) -> Option<Note> {
    let damaged: Vec<(usize, &String)> =
        parts.iter().enumerate().filter_map(|(i, p)| Some((i, p.damage.as_ref()?))).collect();
    let (first, why) = damaged.first()?;
    let text = format!(
        "{} of {} chunks are damaged and left out; the first, at byte {}: {why}",
        damaged.len(),
        parts.len(),
        log.offset(*first)
    );
    Some(Note::warning("file", damaged.len() as u64, text))
}
