//! A log file in; what is in it (topics, fields, rates, gaps, ranges) out, as data and as a table
//! for a person.

use super::channel::Channel;
use super::counts::Counts;
use super::decode::{self, FieldInfo, Prepared, Reader, is_unreadable};
use super::file::LogFile;
use super::series::Spacing;
use super::{Buffer, Note, Severity, listing};
use crate::error::{Errors, Result};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

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
    let concrete = |f: &FieldInfo| !f.path.contains('*');
    let of = |ids| listing::together(ids, &listed).into_iter().filter(concrete).collect();
    let fields: Vec<Vec<FieldInfo>> = topics.values().map(|ids: &Vec<u16>| of(ids)).collect();
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
        topic_survey(&log, topic, ids, &tallies, &fields[i])
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
    }
}

impl std::fmt::Display for Survey {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let length = self.end_ns.saturating_sub(self.start_ns) as f64 / 1e9;
        writeln!(
            f,
            "{}: {} messages in {} topics, {} chunks, {length:.1} s{}",
            self.name,
            self.messages,
            self.topics.len(),
            self.chunks,
            date(self.start_ns)
        )?;
        for note in &self.notes {
            let word = if note.severity == Severity::Warning { "warning" } else { "note" };
            writeln!(f, "{word}: {}", note.text)?;
        }
        self.topics.iter().try_for_each(|t| t.fmt(f))
    }
}

impl std::fmt::Display for TopicSurvey {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let schema =
            if self.schema_encoding.is_empty() { "no schema" } else { &self.schema_encoding };
        write!(
            f,
            "\n{}  {} ({schema}{}{})",
            self.topic,
            self.message_encoding,
            if self.schema_name.is_empty() { "" } else { " " },
            self.schema_name
        )?;
        write!(f, "  {} messages", self.messages)?;
        if self.rate_hz > 0.0 {
            write!(f, ", {} Hz", Short(self.rate_hz))?;
        }
        match self.gaps {
            0 => write!(f, ", no gaps")?,
            n => write!(f, ", {n} gaps, the longest {:.3} s", self.longest_gap_s)?,
        }
        if self.out_of_order > 0 {
            write!(f, ", {} out of order", self.out_of_order)?;
        }
        writeln!(f, "{}", if self.has_publish_time { ", with publish times" } else { "" })?;
        if !self.decodable {
            return writeln!(
                f,
                "    its messages cannot be decoded; supported: {}",
                decode::supported()
            );
        }
        let wide = |head: &str, of: fn(&FieldSurvey) -> &String| {
            self.fields.iter().map(|x| of(x).chars().count()).max().unwrap_or(0).max(head.len())
        };
        let (path, unit) = (wide("field", |x| &x.info.path), wide("unit", |x| &x.info.unit));
        if !self.fields.is_empty() {
            writeln!(
                f,
                "    {:path$}  {:unit$}  {:>12}  {:>12}  {:>7}  about",
                "field", "unit", "min", "max", "missing"
            )?;
        }
        for x in &self.fields {
            let mut line = format!(
                "    {:path$}  {:unit$}  {:>12}  {:>12}  ",
                x.info.path,
                x.info.unit,
                Short(x.min).to_string(),
                Short(x.max).to_string()
            );
            let missing = x.nan + x.unreadable;
            let _ = match missing {
                0 => write!(line, "{:>7}  {}", "-", x.info.doc),
                n => write!(line, "{n:>7}  {}", x.info.doc),
            };
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

/// A number with six significant digits at most.
pub(super) struct Short(pub f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let x = self.0;
        if x.is_nan() {
            return write!(f, "-");
        }
        if x != 0.0 && !(1e-4..1e7).contains(&x.abs()) {
            return write!(f, "{x:.4e}");
        }
        let digits = 5 - (libm::floor(libm::log10(x.abs().max(1e-4))) as i64).clamp(-4, 5);
        let text = format!("{x:.*}", digits.max(0) as usize);
        let text = if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.')
        } else {
            &text
        };
        write!(f, "{text}")
    }
}

/// `, from 2025-11-13 10:20:30 UTC`, or nothing for a clock that does not count from 1970.
fn date(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    if seconds < 978_307_200 {
        return String::new();
    }
    // Days since 1970 to a date of the Gregorian calendar: years counted from 1 March, 400 years
    // have 146097 days.
    let (days, of_day) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!(
        ", from {year}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC",
        of_day / 3600,
        of_day / 60 % 60,
        of_day % 60
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(date(951_782_400_000_000_000), "");
        assert_eq!(date(1_709_210_096_000_000_000), ", from 2024-02-29 12:34:56 UTC");
        assert_eq!(date(1_735_689_599_000_000_000), ", from 2024-12-31 23:59:59 UTC");
    }

    #[test]
    fn numbers_are_short() {
        let text = |x: f64| Short(x).to_string();
        assert_eq!(
            [
                text(0.0),
                text(100.0),
                text(-0.012345678),
                text(99.5003),
                text(1e-9),
                text(123456789.0),
                text(f64::NAN)
            ],
            ["0", "100", "-0.0123457", "99.5003", "1.0000e-9", "1.2346e8", "-"]
        );
    }
}
