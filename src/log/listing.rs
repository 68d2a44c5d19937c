//! A log in; the fields that the messages of its channels have out.
//!
//! A message without a schema has what it has: a field may begin late, a list may be empty at first.
//! So many messages are asked, but never all where a schema names every field.

use super::Buffer;
use super::channel::Channel;
use super::decode::{self, FieldInfo, Gathered};
use super::file::LogFile;
use crate::error::Error;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// By channel.
pub(super) type Fields = BTreeMap<u16, Vec<FieldInfo>>;

/// Messages of a channel that are asked, in all or in each part of the log.
const ASKED: usize = 100;
/// Bytes of messages that are kept to be asked at a time, besides those that are asked for sure.
const KEPT: usize = 16 << 20;
/// A larger message is a picture or a cloud of points, whose lists are too long to be listed.
const LARGE: usize = 64 << 10;
/// Parts whose fields are kept before they are put together.
const AT_ONCE: usize = 64;

/// Which messages of a channel are asked.
#[derive(Clone, Copy)]
struct Want {
    /// So many of any size.
    sure: usize,
    /// So many in all, of those that are no larger.
    count: usize,
    largest: usize,
}

/// By channel.
type Wants = BTreeMap<u16, Want>;

/// By channel.
type Messages = BTreeMap<u16, Vec<Vec<u8>>>;

/// The fields that the schemas name.
pub(super) fn of_schemas(known: &BTreeMap<u16, Channel>, ids: &[u16]) -> Fields {
    let none = ids.iter().map(|id| (*id, Vec::new())).collect();
    asked(known, &none)
}

/// The fields of the first intact messages of channels, from as many parts of the log as it takes to
/// meet each of them; those of the schema where a channel has no message.
///
/// # Errors
/// The log cannot be read any more.
pub(super) fn at_first(log: &LogFile, ids: &[u16]) -> Result<Fields, Error> {
    let mut wants = wants(log, ids, &complete(log, ids));
    wants.values_mut().for_each(|want| (want.sure, want.count) = (1, want.count.min(ASKED)));
    let mut messages: Messages = ids.iter().map(|id| (*id, Vec::new())).collect();
    let (mut buffer, mut bytes) = (Buffer::default(), 0);
    for part in 0..log.parts() {
        if messages.values().all(|of| !of.is_empty()) {
            break;
        }
        for (id, more) in first(log, part, &wants, &mut buffer)? {
            bytes += more.iter().map(Vec::len).sum::<usize>();
            let met = |want: &mut Want| (want.sure, want.count) = (0, want.count - more.len());
            wants.entry(id).and_modify(met);
            messages.entry(id).or_default().extend(more);
        }
        if bytes > KEPT {
            wants.values_mut().for_each(|want| want.count = want.sure);
        }
    }
    Ok(asked(&log.channels, &messages))
}

/// The fields of messages of every part of the log, the first ones first.
///
/// # Errors
/// The log cannot be read any more.
pub(super) fn throughout(log: &LogFile, ids: &[u16]) -> Result<Fields, Error> {
    let mut all: BTreeMap<u16, Gathered> = BTreeMap::new();
    let complete = complete(log, ids);
    let open: Vec<u16> = ids.iter().filter(|id| !complete.contains(id)).copied().collect();
    let wants = wants(log, &open, &complete);
    add(&mut all, at_first(log, ids)?);
    let parts: Vec<usize> = (0..if wants.is_empty() { 0 } else { log.parts() }).collect();
    for parts in parts.chunks(AT_ONCE) {
        let of_part = |buffer: &mut Buffer, part: &usize| {
            Ok(asked(&log.channels, &first(log, *part, &wants, buffer)?))
        };
        let read: Vec<Result<Fields, Error>> =
            parts.par_iter().map_init(Buffer::default, of_part).collect();
        for fields in read {
            add(&mut all, fields?);
        }
    }
    Ok(all.into_iter().map(|(id, of)| (id, of.fields)).collect())
}

fn add(all: &mut BTreeMap<u16, Gathered>, fields: Fields) {
    fields.into_iter().for_each(|(id, more)| all.entry(id).or_default().add(more));
}

/// The fields of all channels of a topic together.
pub(super) fn together(ids: &[u16], fields: &Fields) -> Vec<FieldInfo> {
    let mut all = Gathered::default();
    ids.iter().filter_map(|id| fields.get(id)).for_each(|of| all.add(of.clone()));
    all.fields
}

/// What is asked of one part. JSON names its fields in every message, and one laid out as the one before
/// costs next to nothing; what needs a schema has only lists of other lengths, or nothing new at all.
fn wants(log: &LogFile, ids: &[u16], complete: &[u16]) -> Wants {
    let one = |id: &u16| {
        let want = if is_json(log, *id) {
            Want { sure: 1, count: usize::MAX, largest: usize::MAX }
        } else {
            let count = if complete.contains(id) { 1 } else { ASKED };
            Want { sure: 0, count, largest: LARGE }
        };
        (*id, want)
    };
    ids.iter().map(one).collect()
}

fn is_json(log: &LogFile, id: u16) -> bool {
    log.channels.get(&id).is_some_and(|channel| channel.message_encoding == "json")
}

/// Channels whose schema names every field: its messages have these and no lists beside them.
fn complete(log: &LogFile, ids: &[u16]) -> Vec<u16> {
    let schemas = of_schemas(&log.channels, ids);
    let of = schemas.into_iter().filter(|(id, _)| !is_json(log, *id));
    of.filter(|(_, f)| f.iter().all(|f| !f.path.contains('*'))).map(|(id, _)| id).collect()
}

fn asked(known: &BTreeMap<u16, Channel>, messages: &Messages) -> Fields {
    let one = |(id, messages): (&u16, &Vec<Vec<u8>>)| {
        let channel = known.get(id)?;
        let messages: Vec<&[u8]> = messages.iter().map(Vec::as_slice).collect();
        Some((*id, (decode::encoding_of(channel)?.fields)(channel, &messages)))
    };
    messages.iter().filter_map(one).collect()
}

/// The messages of one part that are wanted, in the order in which they stand there.
fn first(
    log: &LogFile,
    part: usize,
    wants: &Wants,
    buffer: &mut Buffer,
) -> Result<Messages, Error> {
    let (mut found, mut bytes) = (Messages::new(), 0);
    log.messages(part, buffer, |m| {
        let Some(want) = wants.get(&m.channel) else { return };
        let (met, size) = (found.get(&m.channel).map_or(0, Vec::len), m.data.len());
        let has_room = met < want.count && size <= want.largest && bytes + size <= KEPT;
        if met < want.sure || has_room {
            bytes += size;
            found.entry(m.channel).or_default().push(m.data.to_vec());
        }
    })?;
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::super::channel_map::ChannelMap;
    use super::super::inspect::survey;
    use super::super::tests::{START, one_signal, raw, read, texts};
    use super::super::{look, starter};
    use crate::config;
    use std::path::{Path, PathBuf};

    /// A log of many chunks; from the second message on a list has items and an object a field, and
    /// from the middle on there is one field more.
    fn written(folder: &Path) -> PathBuf {
        let path = folder.join("a.mcap");
        let text = |k: u64| match k {
            0 => "{\"x\":0,\"list\":[],\"at\":null}".to_string(),
            1..200 => format!("{{\"x\":{k},\"list\":[1,{k}],\"at\":{{\"y\":{k}}}}}"),
            _ => format!("{{\"x\":{k},\"list\":[1],\"late\":{k}}}"),
        };
        let message = |k: u64| ("/t", START + 10_000_000 * k, START, text(k));
        raw(&path, "json", &(0..400).map(message).collect::<Vec<_>>(), 4000);
        path
    }

    #[test]
    fn fields_that_the_first_message_lacks_are_surveyed_and_offered() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = written(folder.path());
        let survey = survey(&path).expect("surveyed");
        let listed: Vec<(&str, u64)> =
            survey.topics[0].fields.iter().map(|f| (f.info.path.as_str(), f.count)).collect();
        let wanted =
            [("x", 400), ("at", 0), ("list.0", 399), ("list.1", 199), ("at.y", 199), ("late", 200)];
        assert_eq!(listed, wanted);
        let out = folder.path().join("campaign");
        starter::run(&[path], &out).expect("begun");
        let map = std::fs::read_to_string(out.join("channels.toml")).expect("a map");
        assert!(map.contains("field = \"late\"") && map.contains("field = \"at.y\""), "{map}");
    }

    #[test]
    fn a_field_that_is_not_there_is_told_with_all_that_are() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = written(folder.path());
        let of = |field: &str| one_signal("log").replace("\"x\"", &format!("\"{field}\""));
        let why = read(&path, &of("lade")).expect_err("no such field");
        assert!(why.contains("\"late\"") && why.contains("\"at.y\""), "{why}");
        let (map, doc) = config::parse::<ChannelMap>("channels.toml", &of("lade")).expect("a map");
        let look = look(&path, &map, &doc).expect("looked at");
        let said = look.mistakes[0].of("a.mcap").to_string();
        assert!(said.contains("\"late\"") && said.contains("\"at.y\""), "{said}");
        let log = read(&path, &of("late")).expect("read");
        assert_eq!(log.signals["x"].account.count, 200);
    }

    #[test]
    fn what_messages_do_not_have_is_not_called_unreadable() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = written(folder.path());
        let told = |field: &str| {
            let map = one_signal("log").replace("\"x\"", &format!("\"{field}\""));
            let log = read(&path, &map).expect("read");
            assert_eq!(log.signals["x"].account.dropped_unreadable, log.notes[0].count);
            texts(&log)[0].to_string()
        };
        let lacks = |n: u64, field: &str| {
            format!("/t {field}: {n} of 400 messages have no field {field}, or no number in it")
        };
        assert_eq!(told("late"), lacks(200, "late"));
        assert_eq!(told("list.1"), lacks(201, "list.1"));
    }
}
