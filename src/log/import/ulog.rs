//! A PX4 log (ULog) in; the rows of topics that are messages of it out.
//!
//! `px4-ulog` takes the records apart. They are handed to it one by one, so that a mistake has a
//! place, and records that nobody asks for (texts, parameters) cannot be one.

use super::clock::Clock;
use super::rows::{Read, Rows, Wanted};
use super::settings::{Column, Import, Topic};
use super::ulog_field::{number, whole};
use super::values::Rounded;
use crate::config::Doc;
use crate::error::{Error, Errors, Place};
use crate::log::words::nearest_first;
use px4_ulog::stream_parser::model::FlattenedField;
use px4_ulog::stream_parser::{DataMessage, LogParser};
use std::collections::BTreeSet;

/// The time of a message, us, unless the description names another field.
const TIMESTAMP: &str = "timestamp";

const HEADER: usize = 16;

/// Is this a ULog?
pub fn is_ulog(bytes: &[u8]) -> bool {
    bytes.starts_with(b"ULog\x01\x12\x35")
}

/// Reads the fields that the description names.
///
/// # Errors
/// Messages and fields that the log does not have; a damaged record, with the byte where it begins.
/// A log that ends inside a record is read as far as it goes, with a note.
pub fn read(settings: &Import, doc: &Doc, file: &str, bytes: &[u8]) -> Result<Read, Errors> {
    let mut sinks = Vec::new();
    for (i, topic) in settings.topic.iter().enumerate() {
        sinks.push(Sink::new(settings, doc, i, topic)?);
    }
    let mut seen: BTreeSet<(String, u8)> = BTreeSet::new();
    let mut hear = |message: &DataMessage| {
        let (name, instance) = (message.flattened_format.message_name(), message.multi_id.value());
        if !seen.contains(&(name.to_string(), instance)) {
            seen.insert((name.to_string(), instance));
        }
        for sink in sinks.iter_mut().filter(|s| s.name == name && s.instance == instance) {
            sink.take(message);
        }
    };
    let mut parser = LogParser::default();
    parser.set_data_message_callback(&mut hear);
    let notes = walk(&mut parser, bytes).map_err(|(at, what)| {
        Error::at(Place::file(file), format!("damaged at byte {at}: {what}"))
            .help("cut the log there, or have it written again")
    });
    drop(parser);
    let mut errors = Errors::default();
    let mut notes = errors.take(notes).unwrap_or_default();
    notes.extend(sinks.iter().flat_map(Sink::said));
    // What a damaged log lacks may stand behind the damage.
    let sound = errors.is_empty();
    let known: Vec<String> = seen.iter().map(|(name, n)| format!("{name} {n}")).collect();
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    let mut topics = Vec::new();
    for sink in sinks {
        if sink.rows.stamp.is_empty() && sink.errors.is_empty() && sound {
            let name = format!("{} {}", sink.name, sink.instance);
            let has = nearest_first(&name, &known);
            let what = format!(
                "{file} has no message \"{}\" of instance {}; it has {has}",
                sink.name, sink.instance
            );
            errors.push(doc.error(&format!("topic.{}.from", sink.index), what));
        }
        errors.0.extend(sink.errors);
        topics.push(sink.rows);
    }
    errors.or(Read { topics, notes })
}

/// Where the messages of one topic go.
struct Sink<'a> {
    doc: &'a Doc,
    /// Number of the topic.
    index: usize,
    topic: &'a Topic,
    name: &'a str,
    instance: u8,
    /// The field of time, and the clock it is read on.
    time: &'a str,
    clock: Clock,
    /// The field of time and the others, once the first message has told what it holds.
    layout: Option<Option<(FlattenedField, Vec<FlattenedField>)>>,
    rows: Rows,
    /// By field.
    rounded: Vec<Rounded>,
    errors: Vec<Error>,
}

impl<'a> Sink<'a> {
    fn new(
        settings: &'a Import,
        doc: &'a Doc,
        index: usize,
        topic: &'a Topic,
    ) -> Result<Sink<'a>, Errors> {
        let from = topic.from.as_deref().ok_or_else(|| {
            let what =
                format!("topic \"{}\" does not say which messages it is made from", topic.name);
            doc.error(&format!("topic.{index}.name"), what).help("from = \"vehicle_attitude\"")
        })?;
        let time = settings.time_of(topic).0;
        let column = time.and_then(|time| time.column.as_ref());
        let start_s = time.map_or(0.0, |time| time.start_s);
        let unit = time.and_then(|time| time.unit.as_deref());
        let at = format!("topic.{index}.time");
        Ok(Sink {
            doc,
            index,
            topic,
            name: from,
            instance: topic.instance,
            time: match column {
                Some(Column::Name(name)) => name,
                _ => TIMESTAMP,
            },
            clock: Clock::new(unit.unwrap_or("us"), start_s).map_err(|e| doc.error(&at, e))?,
            layout: None,
            rows: Rows::default(),
            rounded: vec![Rounded::default(); topic.fields.len()],
            errors: Vec::new(),
        })
    }

    fn take(&mut self, message: &DataMessage) {
        let mut layout = self.layout.take();
        if layout.is_none() {
            layout = Some(self.find(message));
        }
        if let Some(Some((time, fields))) = &layout {
            match self.stamp(time, message.data) {
                Ok(stamp) => {
                    self.rows.push(stamp, fields.iter().map(|f| number(f, message.data)));
                    let place = || format!("message {}", self.rows.stamp.len());
                    for (field, rounded) in fields.iter().zip(&mut self.rounded) {
                        let n = whole(field, message.data);
                        n.into_iter().for_each(|n| rounded.see(n, place));
                    }
                }
                Err(e) if self.errors.is_empty() => {
                    let n = self.rows.stamp.len() + 1;
                    let what = format!("message {n} of \"{}\": {e}", self.name);
                    self.errors.push(self.doc.error(&format!("topic.{}.from", self.index), what));
                }
                Err(_) => {}
            }
        }
        self.layout = layout;
    }

    /// Finds the fields in the format of the messages; none where one is not there.
    fn find(&mut self, message: &DataMessage) -> Option<(FlattenedField, Vec<FlattenedField>)> {
        let format = message.flattened_format;
        let known: Vec<&str> =
            format.fields.iter().map(|f| f.flattened_field_name.as_str()).collect();
        let mut find = |name: &str, key: String| {
            let found = format.fields.iter().find(|f| f.flattened_field_name == name).cloned();
            if found.is_none() {
                let has = nearest_first(name, &known);
                let what = format!("\"{}\" has no field \"{name}\"; it has {has}", self.name);
                self.errors.push(self.doc.error(&key, what));
            }
            found
        };
        let time = find(self.time, format!("topic.{}.from", self.index));
        let fields: Vec<Option<FlattenedField>> = (self.topic.fields.iter().enumerate())
            .map(|(k, field)| match &field.column {
                Column::Name(name) => find(name, format!("topic.{}.fields.{k}.column", self.index)),
                Column::Number(_) => None,
            })
            .collect();
        Some((time?, fields.into_iter().collect::<Option<_>>()?))
    }

    /// The stamp of a message, ns. Whole numbers stay exact.
    fn stamp(&self, time: &FlattenedField, data: &[u8]) -> Result<u64, String> {
        match whole(time, data) {
            Some(t) => self.clock.whole(t),
            None => self.clock.stamp(number(time, data)),
        }
    }

    /// What is said of whole numbers that lose digits.
    fn said(&self) -> impl Iterator<Item = String> {
        let fields = self.topic.fields.iter().zip(&self.rounded);
        fields.filter_map(move |(field, rounded)| {
            let column = Wanted { column: &field.column, matrix: None }.words();
            rounded.words(&self.topic.name, &column, self.rows.stamp.len())
        })
    }
}

/// Hands the records to the parser; notes of what was lost. Data that were saved after a crash stand
/// behind the others, where the flags at the beginning say.
///
/// # Errors
/// The byte where a damaged record begins, and what is wrong with it.
fn walk(parser: &mut LogParser, bytes: &[u8]) -> Result<Vec<String>, (usize, String)> {
    let mut notes = Vec::new();
    let (mut dropouts, mut lost_ms) = (0, 0);
    let header =
        bytes.get(..HEADER).ok_or((bytes.len(), "it ends inside its header".to_string()))?;
    parser.consume_bytes(header).map_err(|e| (0, words(&e.description)))?;
    let mut starts = vec![HEADER];
    let mut section = 0;
    while let Some(&start) = starts.get(section) {
        let mut at = start;
        // Up to where the appended data begin, which the first record says.
        let end = |starts: &[usize]| starts.get(section + 1).copied().unwrap_or(bytes.len());
        while at < end(&starts) {
            let whole = end(&starts);
            let Some((kind, record)) = record(bytes.get(at..whole).unwrap_or_default()) else {
                if whole == bytes.len() {
                    notes.push(format!(
                        "it ends inside a record at byte {at}: what stands before it is taken"
                    ));
                }
                break;
            };
            let size = record.len() - 3;
            match kind {
                // The parser takes these for sound without looking.
                b'A' if size < 4 => return Err((at, "a subscription without a name".into())),
                b'P' if size < 1 || record.get(3).is_none_or(|n| usize::from(*n) + 1 > size) => {
                    return Err((at, "a parameter without its value".into()));
                }
                b'B' | b'F' | b'I' | b'P' | b'A' | b'D' => {
                    parser.consume_bytes(record).map_err(|e| (at, words(&e.description)))?;
                }
                b'O' => {
                    let ms = record.get(3..5).and_then(|b| b.try_into().ok());
                    dropouts += 1;
                    lost_ms += u64::from(ms.map_or(0, u16::from_le_bytes));
                }
                b'A'..=b'Z' => {}
                other => return Err((at, format!("there is no record of type {other}"))),
            }
            if kind == b'B' && starts.len() == 1 {
                starts.extend(appended(parser, bytes.len()).map_err(|what| (at, what))?);
            }
            at += record.len();
        }
        section += 1;
    }
    if dropouts > 0 {
        notes.push(format!("{dropouts} dropouts of the logger, {lost_ms} ms in all"));
    }
    Ok(notes)
}

/// Where the appended data begin.
fn appended(parser: &LogParser, size: usize) -> Result<Vec<usize>, String> {
    let at = parser.appended_offsets().iter().filter(|at| **at != 0);
    let at: Vec<usize> = at.map(|at| usize::try_from(*at).unwrap_or(usize::MAX)).collect();
    match at.iter().find(|at| **at > size) {
        Some(far) => {
            Err(format!("appended data at byte {far} are wanted, the file has {size} bytes"))
        }
        None if !at.is_sorted() => Err("appended data are not in order".into()),
        None => Ok(at),
    }
}

/// The type of the first record, and the record with its head of 3 bytes; none where it is cut off.
fn record(bytes: &[u8]) -> Option<(u8, &[u8])> {
    let size = u16::from_le_bytes(bytes.get(..2)?.try_into().ok()?);
    Some((*bytes.get(2)?, bytes.get(..usize::from(size) + 3)?))
}

/// The beginning of what the parser says, which may go on for pages.
fn words(description: &str) -> String {
    let line = description.lines().next().unwrap_or_default();
    let line = line.split(", format: ").next().unwrap_or_default();
    line.chars().take(120).collect()
}
