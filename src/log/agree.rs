//! What a log says of its topics, fields and units, and the channel map, in; where they do not
//! agree out.
//!
//! `look` reads the summary section at the end of a log, and messages only where the summary cannot
//! tell whether a field is there. The same comparisons are made when a flight is read.

use super::channel::Channel;
use super::channel_map::{ChannelMap, SignalMap, TimeSource};
use super::decode::{self, FieldInfo, Gathered, is_unreadable};
use super::file::LogFile;
use super::flight::stamp_paths;
use super::{Buffer, listing, words};
use crate::config::Doc;
use crate::error::{Error, Place, Result};
use crate::units::Unit;
use std::collections::BTreeMap;
use std::path::Path;

/// What a log's schema says where it states no unit.
const NO_UNIT: [&str; 5] = ["", "?", "none", "unknown", "n/a"];

/// Something that a log and the channel map do not agree about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mistake {
    /// In the channel map.
    pub place: Place,
    /// The words before and after the log's name.
    pub what: [String; 2],
    pub help: Option<String>,
}

impl Mistake {
    /// The mistake as one of this log, or of these.
    pub fn of(&self, logs: &str) -> Error {
        let error =
            Error::at(self.place.clone(), format!("{}{logs}{}", self.what[0], self.what[1]));
        Error { help: self.help.clone(), ..error }
    }
}

/// What a look at a log found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Look {
    /// Whether the log has a sound summary section; without one nothing was looked at.
    pub summary: bool,
    /// Topics, fields and time stamps that are not there, and units that are others.
    pub mistakes: Vec<Mistake>,
    /// Units of the log that are not known, so that nothing can be said; optional signals that are
    /// not there.
    pub remarks: Vec<Mistake>,
}

impl Look {
    fn file(&mut self, mistake: Mistake, optional: bool) {
        if optional { &mut self.remarks } else { &mut self.mistakes }.push(mistake);
    }
}

/// Holds a channel map against the summary of a log.
///
/// # Errors
/// The file cannot be read, is empty or is no MCAP.
pub fn look(path: &Path, map: &ChannelMap, doc: &Doc) -> Result<Look> {
    let Some(channels) = LogFile::summary(path)? else { return Ok(Look::default()) };
    let mut eye = Eye { path, channels: &channels, log: None, asked: BTreeMap::new() };
    let mut look = Look { summary: true, ..Look::default() };
    let mut fields: BTreeMap<&str, Vec<FieldInfo>> = BTreeMap::new();
    for (name, signal) in &map.signal {
        let place = |key: &str| doc.place(&format!("signal.{name}.{key}"));
        let topic = signal.topic.as_str();
        if let Some(mistake) = topic_mistake(&channels, topic, place("topic")) {
            look.file(mistake, signal.optional);
            continue;
        }
        let known = fields.entry(topic).or_insert_with(|| eye.schema(topic));
        if eye.lacks(topic, &signal.field, known)? {
            let mistake = no_field(topic, &signal.field, known, place("field"));
            look.file(mistake, signal.optional);
        } else {
            match unit(name, signal, known, place("unit")) {
                Stated::Agrees => {}
                Stated::Unknown(remark) => look.remarks.push(remark),
                Stated::Other(mistake) => look.mistakes.push(mistake),
            }
        }
        let TimeSource::Field(path, unit, _) = map.time_source(signal) else { continue };
        let at = if signal.time.is_some() { place("time") } else { doc.place("defaults.time") };
        for stamp in stamp_paths(&path, unit, known) {
            let mistake = no_field(topic, &stamp, known, at.clone());
            if !look.mistakes.contains(&mistake) && eye.lacks(topic, &stamp, known)? {
                look.mistakes.push(mistake);
            }
        }
    }
    Ok(look)
}

/// A way to ask messages of some channels for their fields.
type Ask = fn(&LogFile, &[u16]) -> Result<listing::Fields>;
/// The quick one first.
const ASK: [Ask; 2] = [listing::at_first, listing::throughout];

/// A log whose messages are looked at only where that is needed.
struct Eye<'a> {
    path: &'a Path,
    channels: &'a BTreeMap<u16, Channel>,
    log: Option<LogFile>,
    /// How many of `ASK` a topic's messages were asked with.
    asked: BTreeMap<String, usize>,
}

impl Eye<'_> {
    fn ids(&self, topic: &str) -> Vec<u16> {
        self.channels.iter().filter(|(_, c)| c.topic == topic).map(|(&id, _)| id).collect()
    }

    /// The fields that the schemas of a topic name.
    fn schema(&self, topic: &str) -> Vec<FieldInfo> {
        let ids = self.ids(topic);
        listing::together(&ids, &listing::of_schemas(self.channels, &ids))
    }

    /// Whether no message of the topic has a value at this path. A schema that names the field is
    /// believed; one that does not need not be complete, so messages are asked. Then `known` holds
    /// what they have.
    fn lacks(&mut self, topic: &str, path: &str, known: &mut Vec<FieldInfo>) -> Result<bool> {
        if field(known, path).is_some() {
            return Ok(false);
        }
        let ids = self.ids(topic);
        if self.log.is_none() {
            self.log = LogFile::open(self.path).ok();
        }
        let Some(log) = &self.log else { return Ok(false) };
        let asked = self.asked.entry(topic.to_string()).or_default();
        while field(known, path).is_none()
            && let Some(ask) = ASK.get(*asked)
        {
            let mut all = Gathered::default();
            all.add(listing::together(&ids, &ask(log, &ids)?));
            all.add(std::mem::take(known));
            (*known, *asked) = (all.fields, *asked + 1);
        }
        Ok(field(known, path).is_none() && !anywhere(log, &ids, path)?)
    }
}

/// Whether any message of these channels has a number, or a NaN, at the path, or there is no message that
/// could say.
fn anywhere(log: &LogFile, ids: &[u16], path: &str) -> Result<bool> {
    let mut readers = BTreeMap::new();
    for &id in ids {
        let channel = log.channels.get(&id);
        let prepared = channel.and_then(|c| decode::prepare(c, &[path.to_string()])?.ok());
        readers.extend(prepared.map(|prepared| (id, prepared())));
    }
    let (mut buffer, mut found, mut met) = (Buffer::default(), false, false);
    for part in 0..log.parts() {
        let mut value = [0.0];
        log.messages(part, &mut buffer, |m| {
            if let Some(reader) = readers.get_mut(&m.channel).filter(|_| !found) {
                met = true;
                reader(m.data, &mut value);
                found = !is_unreadable(value[0]);
            }
        })?;
        if found {
            break;
        }
    }
    Ok(found || !met)
}

/// The field at a path.
pub(super) fn field<'f>(known: &'f [FieldInfo], path: &'f str) -> Option<&'f FieldInfo> {
    fields(known, path).next()
}

/// The field at a path as every channel has it; a schema has `*` where the path has a place in a list.
fn fields<'f>(known: &'f [FieldInfo], path: &'f str) -> impl Iterator<Item = &'f FieldInfo> {
    let place = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    let fits = move |f: &&FieldInfo| {
        let (mut of_field, mut of_path) = (f.path.split('.'), path.split('.'));
        loop {
            match (of_field.next(), of_path.next()) {
                (None, None) => return true,
                (Some(a), Some(b)) if a == b || (a == "*" && place(b)) => {}
                _ => return false,
            }
        }
    };
    known.iter().filter(fits)
}

/// A topic that is not in a log, or cannot be decoded.
pub(super) fn topic_mistake(
    channels: &BTreeMap<u16, Channel>,
    topic: &str,
    place: Place,
) -> Option<Mistake> {
    let of_topic: Vec<&Channel> = channels.values().filter(|c| c.topic == topic).collect();
    if of_topic.is_empty() {
        let mut topics: Vec<&str> = channels.values().map(|c| c.topic.as_str()).collect();
        topics.sort_unstable();
        topics.dedup();
        let what = [
            format!("topic \"{topic}\" is not in "),
            format!("; it has {}", words::near(topic, &topics)),
        ];
        return Some(Mistake { place, what, help: None });
    }
    let foreign = of_topic.iter().find(|c| decode::encoding_of(c).is_none())?;
    let schema = if foreign.schema_encoding.is_empty() { "no" } else { &foreign.schema_encoding };
    let what = [
        format!("topic \"{topic}\" of "),
        format!(
            " is encoded as {} with {schema} schema, which cannot be decoded; supported: {}",
            foreign.message_encoding,
            decode::supported()
        ),
    ];
    let help = Some(
        "convert the log, or take the signal from a topic with a supported encoding".to_string(),
    );
    Some(Mistake { place, what, help })
}

/// A topic that may be that of channels which a log does not name, because their records are damaged: so many
/// messages are of such.
pub(super) fn unnamed(mistake: Mistake, topic: &str, messages: u64) -> Mistake {
    let [_, has] = mistake.what;
    let what = [
        format!("topic \"{topic}\" cannot be found in "),
        format!(
            ", whose channel records are damaged: {messages} messages are of channels that it does not name{has}"
        ),
    ];
    Mistake { what, ..mistake }
}

/// A field that a topic does not have, the nearest names first.
pub(super) fn no_field(topic: &str, field: &str, known: &[FieldInfo], place: Place) -> Mistake {
    let names: Vec<&str> =
        known.iter().map(|f| f.path.as_str()).filter(|p| !p.contains('*')).collect();
    let has = words::nearest_first(field, &names);
    let what =
        [format!("field \"{field}\" is not in topic \"{topic}\" of "), format!("; it has {has}")];
    Mistake { place, what, help: None }
}

/// What a log states about a signal's unit, against the channel map.
pub(super) enum Stated {
    /// The same unit, none at all, or the one that the channel map says is wrong.
    Agrees,
    /// One that is not known.
    Unknown(Mistake),
    /// Another dimension, or another scale.
    Other(Mistake),
}

/// Holds the unit of the channel map against the one that the log states for the field.
pub(super) fn unit(name: &str, signal: &SignalMap, known: &[FieldInfo], place: Place) -> Stated {
    let of_field: Vec<&FieldInfo> = fields(known, &signal.field).collect();
    let all: Vec<Stated> = of_field.iter().map(|f| stated(name, signal, &f.unit, &place)).collect();
    let is_wrong = all.iter().any(|one| matches!(one, Stated::Other(_)));
    if let (true, Some(units)) = (is_wrong, several(&of_field)) {
        return Stated::Other(several_units(name, signal, &units, place));
    }
    // What is known to be wrong counts before what is not known.
    let worst = |one: &Stated| match one {
        Stated::Other(_) => 2,
        Stated::Unknown(_) => 1,
        Stated::Agrees => 0,
    };
    all.into_iter().rev().max_by_key(worst).unwrap_or(Stated::Agrees)
}

/// The units that several channels of a topic state for a field, where they are not the same.
fn several<'f>(of_field: &[&'f FieldInfo]) -> Option<Vec<&'f str>> {
    let mut units: Vec<(&str, Unit)> = Vec::new();
    for text in of_field.iter().map(|f| f.unit.trim()) {
        let is_none = NO_UNIT.contains(&text.to_lowercase().as_str());
        let Some(unit) = Unit::parse(text).ok().filter(|_| !is_none) else { continue };
        if units.iter().all(|(_, known)| !known.same(&unit)) {
            units.push((text, unit));
        }
    }
    (units.len() > 1).then(|| units.into_iter().map(|(text, _)| text).collect())
}

/// A field that several channels of a topic have in several units: no one unit is right for all.
fn several_units(name: &str, signal: &SignalMap, units: &[&str], place: Place) -> Mistake {
    let SignalMap { topic, field, unit, .. } = signal;
    let said = units.iter().map(|u| format!("\"{u}\"")).collect::<Vec<_>>().join(" and in ");
    let what = format!(
        "signal \"{name}\" is read in \"{unit}\", but several channels write topic \"{topic}\", and field \"{field}\" is in {said} by the schemas of "
    );
    let mine = Unit::parse(unit).ok();
    let is_other = |text: &&&str| {
        Unit::parse(text).ok().zip(mine).is_none_or(|(stated, mine)| !stated.same(&mine))
    };
    let others: Vec<&&str> = units.iter().filter(is_other).collect();
    let despite = match others[..] {
        [other] => format!(
            "; only where all numbers are in \"{unit}\", and the schema that says \"{other}\" is wrong, add despite = \"{other}\""
        ),
        _ => String::new(),
    };
    let help = format!(
        "no one unit is right for both: give each channel a topic of its own in the log{despite}"
    );
    Mistake { place, what: [what, String::new()], help: Some(help) }
}

/// The same of one channel's unit.
fn stated(name: &str, signal: &SignalMap, stated: &str, place: &Place) -> Stated {
    let (stated, place) = (stated.trim(), place.clone());
    let said = signal.despite.as_deref().map(str::trim);
    if NO_UNIT.contains(&stated.to_lowercase().as_str()) || said == Some(stated) {
        return Stated::Agrees;
    }
    let (SignalMap { topic, field, unit, .. }, Ok(wanted)) = (signal, Unit::parse(&signal.unit))
    else {
        return Stated::Agrees;
    };
    let Ok(has) = Unit::parse(stated) else {
        let what = [
            format!("field \"{field}\" of topic \"{topic}\" in "),
            format!(
                " is in \"{stated}\", which is no known unit: signal \"{name}\" is read in \"{unit}\" unchecked"
            ),
        ];
        let help = Some(format!("despite = \"{stated}\" says that this is meant"));
        return Stated::Unknown(Mistake { place, what, help });
    };
    if has.same(&wanted)
        || said.and_then(|said| Unit::parse(said).ok()).is_some_and(|said| said.same(&has))
    {
        return Stated::Agrees;
    }
    let of = if has.dim == wanted.dim { "" } else { ", another quantity" };
    let what = format!(
        "signal \"{name}\" is read in \"{unit}\", but field \"{field}\" of topic \"{topic}\" is in \"{stated}\"{of} by the schema of "
    );
    let help = format!(
        "write unit = \"{stated}\"; where the log is wrong, keep unit = \"{unit}\" and add despite = \"{stated}\""
    );
    Stated::Other(Mistake { place, what: [what, String::new()], help: Some(help) })
}
