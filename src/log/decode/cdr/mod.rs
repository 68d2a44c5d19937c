//! ROS 2 messages (CDR) and their definition in, the numbers at the wanted paths out.
//!
//! A message is four bytes that name its form, then its fields in the order of the definition, each
//! number aligned to its own size. Both byte orders of plain CDR are read; texts are passed over.

mod fields;
mod plan;
mod ros2idl;
mod ros2msg;
mod schema;
#[cfg(test)]
mod tests;
mod types;

use super::encoding::{DAMAGED, Encoding, Prepared, Reader, UNREADABLE};
use super::paths;
use crate::log::channel::Channel;
use plan::{Cursor, Flow, Planner, Step};
use std::sync::Arc;
use types::Kind;

pub const ENCODING: Encoding =
    Encoding { message: "cdr", schemas: &["ros2msg", "ros2idl"], fields: fields::among, prepare };

/// Writers may fill a message up to a multiple of eight bytes; more behind its last field means
/// that it is not what the definition says.
const FILLED_UP: usize = 7;

fn prepare(channel: &Channel, wanted: &[String]) -> Result<Prepared, String> {
    let types = Arc::new(schema::types(channel)?);
    let wanted: Arc<[String]> = wanted.into();
    Ok(Box::new(move || {
        let split = paths::split(&wanted);
        let root = Kind::Struct(types.root);
        let steps = Planner::new(&types).steps(&root, &paths::all(&split));
        reader(steps)
    }))
}

fn reader(steps: Vec<Step>) -> Reader {
    Box::new(move |message, out| {
        out.fill(UNREADABLE);
        if read(&steps, message, out).is_none() {
            out.fill(DAMAGED);
        }
    })
}

/// None where the message is not what the steps say.
fn read(steps: &[Step], message: &[u8], out: &mut [f64]) -> Option<()> {
    let (form, body) = message.split_first_chunk::<4>()?;
    match form[..2] {
        [0, 1] => walk(Cursor::<false> { body, at: 0 }, steps, out),
        [0, 0] => walk(Cursor::<true> { body, at: 0 }, steps, out),
        _ => None,
    }
}

fn walk<const BIG: bool>(mut cursor: Cursor<BIG>, steps: &[Step], out: &mut [f64]) -> Option<()> {
    match cursor.take(steps, out)? {
        Flow::Stop => Some(()),
        Flow::On => (cursor.body.len() - cursor.at <= FILLED_UP).then_some(()),
    }
}
