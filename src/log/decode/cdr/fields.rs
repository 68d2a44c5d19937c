//! The types of a message and one message in; its numeric fields out.

use super::plan::{Cursor, Flow, Planner};
use super::schema;
use super::types::{Kind, Member, Types};
use crate::log::channel::Channel;
use crate::log::decode::encoding::{FieldInfo, Gathered, MOST_FIELDS, MOST_ITEMS};
use crate::log::decode::paths::joined;

/// The fields in the order of the definition. The messages say how long its lists are, the longest of each;
/// without one their places are `*`, as are those behind the first `MOST_ITEMS`. Damaged ones say nothing.
pub(super) fn among(channel: &Channel, messages: &[&[u8]]) -> Vec<FieldInfo> {
    let Ok(types) = schema::types(channel) else { return Vec::new() };
    let told = |message: &&[u8]| match message.split_first_chunk::<4>()? {
        ([0, 1, ..], body) => of_message(&types, Cursor::<false> { body, at: 0 }),
        ([0, 0, ..], body) => of_message(&types, Cursor::<true> { body, at: 0 }),
        _ => None,
    };
    let mut all = Gathered::default();
    messages.iter().filter_map(told).for_each(|fields| all.add(fields));
    if all.fields.is_empty() {
        all.add(of_types(&types));
    }
    all.fields
}

fn of_types(types: &Types) -> Vec<FieldInfo> {
    let mut lister = Lister::<false> { types, cursor: None, visits: 0, out: Vec::new() };
    let root = Member::unnamed(Kind::Struct(types.root));
    let _ = lister.value(&root.kind, "", &root);
    lister.out
}

fn of_message<const BIG: bool>(types: &Types, cursor: Cursor<BIG>) -> Option<Vec<FieldInfo>> {
    let mut lister = Lister { types, cursor: Some(cursor), visits: 0, out: Vec::new() };
    let root = Member::unnamed(Kind::Struct(types.root));
    lister.value(&root.kind, "", &root)?;
    Some(lister.out)
}

impl Member {
    fn unnamed(kind: Kind) -> Member {
        Member { name: String::new(), kind, unit: String::new(), doc: String::new() }
    }
}

struct Lister<'a, const BIG: bool> {
    types: &'a Types,
    cursor: Option<Cursor<'a, BIG>>,
    /// Values that were looked at.
    visits: usize,
    out: Vec<FieldInfo>,
}

impl<const BIG: bool> Lister<'_, BIG> {
    /// Lists a value and passes over it; none where the message ends too early.
    fn value(&mut self, kind: &Kind, path: &str, of: &Member) -> Option<Flow> {
        self.visits += 1;
        if self.out.len() >= MOST_FIELDS || self.visits > 10 * MOST_FIELDS {
            return Some(Flow::Stop);
        }
        match kind {
            Kind::Number(_) => {
                let (unit, doc) = (of.unit.clone(), of.doc.clone());
                self.out.push(FieldInfo { path: path.to_string(), unit, doc });
                self.pass(kind)
            }
            Kind::Struct(i) => {
                let types = self.types;
                let members = types.structs.get(*i).map_or(&[][..], |s| &s.members);
                if members.is_empty() {
                    return self.pass(kind);
                }
                for member in members {
                    let path = joined(path, &member.name);
                    if let Flow::Stop = self.value(&member.kind, &path, member)? {
                        return Some(Flow::Stop);
                    }
                }
                Some(Flow::On)
            }
            Kind::Array(item, n) => self.list(item, Some(*n), path, of),
            Kind::Sequence(item) => self.list(item, None, path, of),
            Kind::Text => self.pass(kind),
            Kind::Opaque => Some(Flow::Stop),
        }
    }

    fn list(&mut self, item: &Kind, fixed: Option<u64>, path: &str, of: &Member) -> Option<Flow> {
        let n = match (&mut self.cursor, fixed) {
            (Some(cursor), _) => Some(cursor.count(fixed)?),
            (None, fixed) => fixed,
        };
        for i in 0..n.unwrap_or(0).min(MOST_ITEMS) {
            if let Flow::Stop = self.value(item, &joined(path, &i.to_string()), of)? {
                return Some(Flow::Stop);
            }
        }
        match n {
            Some(n) if n <= MOST_ITEMS => Some(Flow::On),
            n => self.rest(item, n.map_or(0, |n| n - MOST_ITEMS), path, of),
        }
    }

    /// Lists an item at any place, and passes over those that are left.
    fn rest(&mut self, item: &Kind, left: u64, path: &str, of: &Member) -> Option<Flow> {
        let cursor = self.cursor.take();
        let any = self.value(item, &joined(path, "*"), of);
        self.cursor = cursor;
        any?;
        let Some(cursor) = &mut self.cursor else { return Some(Flow::On) };
        let steps = Planner::new(self.types).steps(item, &[]);
        for _ in 0..left {
            if let Flow::Stop = cursor.take(&steps, &mut [])? {
                return Some(Flow::Stop);
            }
        }
        Some(Flow::On)
    }

    fn pass(&mut self, kind: &Kind) -> Option<Flow> {
        match &mut self.cursor {
            Some(cursor) => cursor.take(&Planner::new(self.types).steps(kind, &[]), &mut []),
            None => Some(Flow::On),
        }
    }
}
