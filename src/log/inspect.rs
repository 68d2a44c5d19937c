//! A log file in; what is in it (topics, fields, rates, gaps, ranges) out, as data and as a table
//! for a person.

use super::channel::Channel;
use super::counts::Counts;
use super::decode::{self, FieldInfo, Prepared, Reader, is_unreadable};
use super::file::LogFile;
use super::series::Spacing;
use super::{Buffer, Note, listing};
use crate::error::{Errors, Result};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

pub(super) use super::shown::Short;

/// What is in a log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Survey {
    /// The file's name.
    pub name: String,
    pub chunks: usize,
    pub messages: u64,
    /// First and last log time, ns.
    pub start_ns: u64,
    pub end_ns: u64,
    /// In the order of their names.
    pub topics: Vec<TopicSurvey>,
    pub notes: Vec<Note>,
}

/// One topic of a log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicSurvey {
    pub topic: String,
    pub message_encoding: String,
    pub schema_encoding: String,
    pub schema_name: String,
    /// Whether the messages can be decoded; without, there are no fields.
    pub decodable: bool,
    pub messages: u64,
    /// From the log times: one over the median spacing, gaps, the longest spacing.
    pub rate_hz: f64,
    pub gaps: u64,
    pub longest_gap_s: f64,
    /// Messages that stand in the file after one with a later log time.
    pub out_of_order: u64,
    /// Whether any message has a publish time of its own.
    pub has_publish_time: bool,
    pub fields: Vec<FieldSurvey>,
    /// Items of lists that are not listed one by one, with `*` for their places.
    pub items: Vec<String>,
}

/// One field of a topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldSurvey {
    #[serde(flatten)]
    pub info: FieldInfo,
    pub count: u64,
    pub nan: u64,
    pub unreadable: u64,
    /// In the unit of the log; NaN without a sample.
    pub min: f64,
    pub max: f64,
}

#[derive(Clone)]
struct Tally {
    log: Vec<u64>,
    published: bool,
    fields: Vec<(u64, u64, u64, f64, f64)>,
}

/// A channel: the place of its topic, and how its messages are read where they can be.
struct Source {
    topic: usize,
    prepared: Option<Prepared>,
}

/// Reads a whole log and says what is in it.
///
/// # Errors
/// The file cannot be read, is empty or is no MCAP.
pub fn survey(path: &Path) -> std::result::Result<Survey, Errors> {
    let log = LogFile::open(path)?;
    let mut topics: BTreeMap<&str, Vec<u16>> = BTreeMap::new();
    for (&id, channel) in &log.channels {
        topics.entry(&channel.topic).or_default().push(id);
    }
    let listed = listing::throughout(&log, &log.channels.keys().copied().collect::<Vec<_>>())?;
    let one_by_one = |f: &FieldInfo| !f.path.contains('*');
    let (fields, others): (Vec<Vec<FieldInfo>>, Vec<Vec<FieldInfo>>) = topics
        .values()
        .map(|ids: &Vec<u16>| listing::together(ids, &listed).into_iter().partition(one_by_one))
        .unzip();
    let mut notes = log.notes.clone();
    let mut index: BTreeMap<u16, Source> = BTreeMap::new();
    for (topic, (name, ids)) in topics.iter().enumerate() {
        let paths: Vec<String> = fields[topic].iter().map(|f| f.path.clone()).collect();
        for &id in ids {
            let prepared = log.channels.get(&id).and_then(|c| decode::prepare(c, &paths));
            let prepared = prepared.transpose().unwrap_or_else(|e| {
                notes.push(Note::warning(*name, 1, format!("topic \"{name}\": {e}")));
                None
            });
            index.insert(id, Source { topic, prepared });
        }
    }

    let parts: Vec<Result<Read>> = (0..log.parts())
        .into_par_iter()
        .map_init(Buffer::default, |buffer, part| tally(&log, &fields, &index, part, buffer))
        .collect();
    let parts: Vec<Read> = parts.into_iter().collect::<Result<_>>()?;

    let damaged = parts.iter().enumerate().filter_map(|(i, p)| Some((i, p.2.as_ref()?)));
    notes.extend(damaged.map(|(i, why)| {
        Note::warning("file", 1, format!("the chunk at byte {} is damaged: {why}", log.offset(i)))
    }));
    let mut counts = Counts::default();
    parts.iter().for_each(|part| counts.merge(&part.1));
    notes.extend(log.counted(&counts));
    let all_times = || parts.iter().flat_map(|p| p.0.iter().flat_map(|t| t.log.iter().copied()));
    let make = |(i, (topic, ids)): (usize, (&&str, &Vec<u16>))| {
        let tallies: Vec<&Tally> = parts.iter().filter_map(|p| p.0.get(i)).collect();
        let items = others[i].iter().map(|f| f.path.clone()).collect();
        TopicSurvey { items, ..topic_survey(&log, topic, ids, &tallies, &fields[i]) }
    };
    Ok(Survey {
        name: log.name(),
        chunks: log.parts(),
        messages: all_times().count() as u64,
        start_ns: all_times().min().unwrap_or(0),
        end_ns: all_times().max().unwrap_or(0),
        topics: topics.iter().enumerate().map(make).collect(),
        notes,
    })
}

/// What one part holds: by topic, by channel, and its damage.
type Read = (Vec<Tally>, Counts, Option<String>);

fn tally(
    log: &LogFile,
    fields: &[Vec<FieldInfo>],
    index: &BTreeMap<u16, Source>,
    part: usize,
    buffer: &mut Buffer,
) -> Result<Read> {
    let empty = |f: &Vec<FieldInfo>| Tally {
        log: Vec::new(),
        published: false,
        fields: vec![(0, 0, 0, f64::NAN, f64::NAN); f.len()],
    };
    let mut tallies: Vec<Tally> = fields.iter().map(empty).collect();
    let mut readers: BTreeMap<u16, Reader> =
        index.iter().filter_map(|(&id, source)| Some((id, source.prepared.as_ref()?()))).collect();
    let (mut row, mut counts) = (Vec::new(), Counts::default());
    let damage = log.messages(part, buffer, |m| {
        counts.add(m.channel);
        let tally = index.get(&m.channel).and_then(|source| tallies.get_mut(source.topic));
        let Some(tally) = tally else { return };
        tally.log.push(m.log_time);
        tally.published |= m.publish_time != 0 && m.publish_time != m.log_time;
        let Some(reader) = readers.get_mut(&m.channel) else { return };
        row.resize(tally.fields.len(), 0.0);
        reader(m.data, &mut row);
        for ((count, nan, unreadable, min, max), &x) in tally.fields.iter_mut().zip(&row) {
            *unreadable += u64::from(is_unreadable(x));
            *nan += u64::from(x.is_nan() && !is_unreadable(x));
            *count += u64::from(!x.is_nan());
            (*min, *max) = (min.min(x), max.max(x));
        }
    })?;
    Ok((tallies, counts, damage))
}

fn topic_survey(
    log: &LogFile,
    topic: &str,
    ids: &[u16],
    tallies: &[&Tally],
    fields: &[FieldInfo],
) -> TopicSurvey {
    let channel = ids.first().and_then(|id| log.channels.get(id));
    let text = |f: fn(&Channel) -> &String| channel.map(|c| f(c).clone()).unwrap_or_default();
    let mut times: Vec<i64> = tallies
        .iter()
        .flat_map(|t| t.log.iter().map(|&ns| i64::try_from(ns).unwrap_or(i64::MAX)))
        .collect();
    let mut latest = i64::MIN;
    let mut out_of_order = 0;
    for &t in &times {
        out_of_order += u64::from(t < latest);
        latest = latest.max(t);
    }
    times.sort_unstable();
    let spacing = Spacing::of(times.iter().copied());
    let field = |(k, info): (usize, &FieldInfo)| {
        let mut f = FieldSurvey {
            info: info.clone(),
            count: 0,
            nan: 0,
            unreadable: 0,
            min: f64::NAN,
            max: f64::NAN,
        };
        for (count, nan, unreadable, min, max) in tallies.iter().filter_map(|t| t.fields.get(k)) {
            f.count += count;
            f.nan += nan;
            f.unreadable += unreadable;
            (f.min, f.max) = (f.min.min(*min), f.max.max(*max));
        }
        f
    };
    TopicSurvey {
        topic: topic.to_string(),
        message_encoding: text(|c| &c.message_encoding),
        schema_encoding: text(|c| &c.schema_encoding),
        schema_name: text(|c| &c.schema_name),
        decodable: channel.is_some_and(|c| decode::encoding_of(c).is_some()),
        messages: times.len() as u64,
        rate_hz: spacing.rate_hz,
        gaps: spacing.gaps,
        longest_gap_s: spacing.longest_s,
        out_of_order,
        has_publish_time: tallies.iter().any(|t| t.published),
        fields: fields.iter().enumerate().map(field).collect(),
        items: Vec::new(),
    }
}
