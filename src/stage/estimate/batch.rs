//! Maneuvers that are estimated together, and the names of what came of them.

use crate::estimate::{Estimation, Row, Segment};

/// The maneuvers that are estimated together.
pub struct Batch {
    pub group: String,
    /// Segment ids.
    pub segments: Vec<String>,
    /// Flight of each.
    pub flights: Vec<String>,
    pub labelled: Vec<Segment>,
}

/// A batch and its estimation.
pub type Done<'a> = (&'a Batch, &'a Estimation);

/// A segment's id, for a quantity of one segment.
pub fn segment(batch: &Batch, index: Option<usize>) -> Option<&str> {
    index.and_then(|i| batch.segments.get(i)).map(String::as_str)
}

/// Where one value holds, and which segment or group of segments this one belongs to.
pub fn per(batch: &Batch, row: &Row) -> (String, Option<String>) {
    match (&row.group, segment(batch, row.segment)) {
        (Some(label), _) => (label.column.clone(), Some(label.value.clone())),
        (None, Some(segment)) => ("segment".to_string(), Some(segment.to_string())),
        (None, None) => ("campaign".to_string(), None),
    }
}
