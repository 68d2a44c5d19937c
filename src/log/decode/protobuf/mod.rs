//! Protobuf messages and the descriptors of their files in, the numbers at the wanted paths out.
//!
//! The descriptors become a plan once; a message is then read field by field into the slots of the
//! plan. A field without presence (proto3 leaves it out where it is 0) is 0 where the message does
//! not have it; one with presence (`optional`, `oneof`, a message inside) is then not there, unless
//! its descriptor names a default.

mod fields;
mod number;
mod plan;
mod schema;
#[cfg(test)]
mod tests;
mod wire;

use super::encoding::{DAMAGED, Encoding, Prepared, UNREADABLE};
use crate::log::channel::Channel;
use plan::Plan;
use schema::Schema;
use std::sync::Arc;

pub const ENCODING: Encoding =
    Encoding { message: "protobuf", schemas: &["protobuf"], fields: fields::among, prepare };

fn prepare(channel: &Channel, paths: &[String]) -> Result<Prepared, String> {
    let schema = Schema::parse(&channel.schema)?;
    let plan = Arc::new(Plan::new(&schema, &channel.schema_name, paths)?);
    Ok(Box::new(move || {
        let plan = plan.clone();
        let mut counts = vec![0; plan.lists];
        Box::new(move |message, out| {
            out.fill(UNREADABLE);
            // To fill nothing is a slow call where there is nothing to fill.
            if !counts.is_empty() {
                counts.fill(0);
            }
            if plan.read(message, &mut counts, out).is_none() {
                out.fill(DAMAGED);
            }
        })
    }))
}
