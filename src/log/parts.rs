//! A log and what is wanted of its topics in; the numbers of every part of the file out, as columns.

use super::chunk::Buffer;
use super::counts::Counts;
use super::decode::{self, FieldInfo, Prepared, Reader};
use super::file::LogFile;
use crate::error::{Error, Errors};
use rayon::prelude::*;

/// What is read from one topic.
pub(super) struct TopicPlan {
    pub topic: String,
    pub channels: Vec<u16>,
    /// Paths of fields, each once: signals and field time stamps.
    pub paths: Vec<String>,
    /// What the topic has, for messages to people.
    pub fields: Vec<FieldInfo>,
}

/// The messages of one topic in one part of the file, in file order.
pub(super) struct Columns {
    pub log: Vec<u64>,
    pub publish: Vec<u64>,
    /// `[n][paths]`, row by row.
    pub values: Vec<f64>,
    /// The channel of the last one, and how often a message is of another channel than the one before.
    last: Option<u16>,
    pub alternates: u64,
}

impl Columns {
    /// None yet, and room for so many.
    fn of(rows: usize, plan: &TopicPlan) -> Columns {
        let times = || Vec::with_capacity(rows);
        Columns {
            log: times(),
            publish: times(),
            values: Vec::with_capacity(rows * plan.paths.len()),
            last: None,
            alternates: 0,
        }
    }
}

/// What one part after the other is read with.
#[derive(Default)]
struct Scratch {
    buffer: Buffer,
    /// Messages of each topic in the part before: the next one mostly has as many.
    rows: Vec<usize>,
}

/// What was read of one part of the file.
pub(super) struct PartData {
    pub topics: Vec<Columns>,
    pub earliest: Option<u64>,
    pub counts: Counts,
    pub damage: Option<String>,
}

/// Per channel: the place of its topic's plan, and how its messages are read.
type Ready = Vec<(u16, usize, Prepared)>;

/// The parts of a log, in file order.
///
/// # Errors
/// A schema that is none; the log cannot be read any more.
pub(super) fn decode_parts(log: &LogFile, plans: &[TopicPlan]) -> Result<Vec<PartData>, Errors> {
    let ready = ready(log, plans)?;
    let parts: Vec<Result<PartData, Error>> = (0..log.parts())
        .into_par_iter()
        .map_init(Scratch::default, |scratch, part| decode_part(log, plans, &ready, part, scratch))
        .collect();
    // The first error in file order, whichever thread met one first.
    Ok(parts.into_iter().collect::<Result<_, _>>()?)
}

fn ready(log: &LogFile, plans: &[TopicPlan]) -> Result<Ready, Errors> {
    let (mut ready, mut errors) = (Vec::new(), Errors::default());
    for (i, plan) in plans.iter().enumerate() {
        for (&id, channel) in plan.channels.iter().filter_map(|id| log.channels.get_key_value(id)) {
            let Some(prepared) = decode::prepare(channel, &plan.paths) else { continue };
            let what = |e| {
                Error::new(format!("topic \"{}\" of {}: {e}", plan.topic, log.name()))
                    .help("take the topic out of the channel map, or convert the log")
            };
            ready.extend(errors.take(prepared.map_err(what)).map(|p| (id, i, p)));
        }
    }
    errors.or(ready)
}

fn decode_part(
    log: &LogFile,
    plans: &[TopicPlan],
    ready: &Ready,
    part: usize,
    scratch: &mut Scratch,
) -> Result<PartData, Error> {
    let Scratch { buffer, rows } = scratch;
    let mut readers: Vec<Option<(usize, Reader)>> = Vec::new();
    for (id, i, prepared) in ready {
        let at = usize::from(*id);
        if readers.len() <= at {
            readers.resize_with(at + 1, || None);
        }
        readers[at] = Some((*i, prepared()));
    }
    rows.resize(plans.len(), 0);
    let room = plans.iter().zip(&*rows);
    let mut topics: Vec<Columns> = room.map(|(plan, n)| Columns::of(*n, plan)).collect();
    let mut row = vec![0.0; plans.iter().map(|p| p.paths.len()).max().unwrap_or(0)];
    let (mut earliest, mut counts): (Option<u64>, _) = (None, Counts::default());
    let damage = log.messages(part, buffer, |m| {
        counts.add(m.channel);
        if log.channels.contains_key(&m.channel) {
            earliest = Some(earliest.map_or(m.log_time, |e| e.min(m.log_time)));
        }
        if let Some(Some((i, reader))) = readers.get_mut(usize::from(m.channel)) {
            let (columns, row) = (&mut topics[*i], &mut row[..plans[*i].paths.len()]);
            reader(m.data, row);
            columns.log.push(m.log_time);
            columns.publish.push(m.publish_time);
            columns.values.extend_from_slice(row);
            columns.alternates += u64::from(columns.last.is_some_and(|last| last != m.channel));
            columns.last = Some(m.channel);
        }
    })?;
    rows.iter_mut().zip(&topics).for_each(|(n, columns)| *n = columns.log.len());
    Ok(PartData { topics, earliest, counts, damage })
}
