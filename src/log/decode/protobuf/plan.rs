//! A schema and the wanted paths in; a plan out, which takes a message to the numbers at the paths.

use super::schema::{Kind, Number, Schema};
use super::wire::{self, Form};
use crate::log::bytes::Bytes;
use crate::log::decode::encoding::{finite, is_unreadable};
use crate::log::decode::paths::{self, Wanted};

/// Messages nested deeper than this are not read.
const DEEPEST: usize = 64;

/// What is read of a message.
pub(super) struct Plan {
    root: Node,
    /// How many lists need a count of the items that were met.
    pub lists: usize,
}

/// What is read of one message type at one place.
#[derive(Default)]
struct Node {
    /// Slots of the fields that are a number where the message does not have them.
    absent: Vec<(usize, f64)>,
    fields: Vec<Field>,
    /// Place in `fields` by field number, for the small ones; `NONE` for fields that nobody wants.
    small: Vec<u8>,
}

const NONE: u8 = u8::MAX;

struct Field {
    number: u32,
    /// How writers write it: the key where that is one byte, 0 where it is longer.
    lead: u8,
    form: Form,
    take: Take,
}

enum Take {
    Number(Number, usize),
    /// A list of numbers: its count, and slots by place, ascending.
    Numbers(Number, usize, Vec<(usize, usize)>),
    Message(Node),
    /// A list of messages: its count, and what is read of some, ascending.
    Messages(usize, Vec<(usize, Node)>),
}

impl Plan {
    /// # Errors
    /// In words: a message type that the schema does not have.
    pub fn new(schema: &Schema, name: &str, paths: &[String]) -> Result<Plan, String> {
        let split = paths::split(paths);
        let mut lists = 0;
        let root = node(schema, name, &paths::all(&split), &mut lists, 0)?;
        Ok(Plan { root, lists })
    }

    /// Reads a message into slots that are all `UNREADABLE`; `counts` are 0. None where the bytes
    /// are no such message.
    pub fn read(&self, message: &[u8], counts: &mut [usize], out: &mut [f64]) -> Option<()> {
        self.root.read(message, counts, out)
    }
}

fn node(
    schema: &Schema,
    name: &str,
    wanted: &[Wanted],
    lists: &mut usize,
    depth: usize,
) -> Result<Node, String> {
    let message = schema
        .message(name)
        .ok_or_else(|| format!("the schema does not define the message \"{name}\""))?;
    if depth > DEEPEST {
        return Ok(Node::default());
    }
    let mut made = Node::default();
    for field in &message.fields {
        let below = paths::below(wanted, &field.name);
        if below.is_empty() {
            continue;
        }
        let take = match (&field.kind, field.repeated) {
            (Kind::Number(number), false) => {
                let Some(slot) = paths::here(&below) else { continue };
                made.absent.extend(field.absent.map(|value| (slot, value)));
                Take::Number(*number, slot)
            }
            (Kind::Number(number), true) => {
                *lists += 1;
                Take::Numbers(*number, *lists - 1, paths::numbers(&below))
            }
            (Kind::Message(inner), false) => {
                Take::Message(node(schema, inner, &below, lists, depth + 1)?)
            }
            (Kind::Message(inner), true) => {
                *lists += 1;
                let list = *lists - 1;
                let mut items = Vec::new();
                for (place, wanted) in paths::items(&below) {
                    items.push((place, node(schema, inner, &wanted, lists, depth + 1)?));
                }
                Take::Messages(list, items)
            }
            (Kind::Other, _) => continue,
        };
        made.fields.push(Field::new(field.number, take));
    }
    made.index();
    Ok(made)
}

impl Node {
    fn index(&mut self) {
        let small = self.fields.iter().map(|f| f.number as usize + 1).filter(|n| *n <= 64);
        self.small = vec![NONE; small.max().unwrap_or(0)];
        for (i, field) in self.fields.iter().enumerate() {
            if let Some(at) = self.small.get_mut(field.number as usize) {
                *at = u8::try_from(i).unwrap_or(NONE);
            }
        }
    }

    /// Where in `fields` a number is.
    #[inline]
    fn place(&self, number: u32) -> Option<usize> {
        match self.small.get(number as usize) {
            Some(&NONE) => None,
            Some(&at) => Some(usize::from(at)),
            None => self.fields.iter().position(|f| f.number == number),
        }
    }

    fn read(&self, message: &[u8], counts: &mut [usize], out: &mut [f64]) -> Option<()> {
        for &(slot, value) in &self.absent {
            // A message may come in several pieces: what an earlier one said stays.
            if let Some(x) = out.get_mut(slot).filter(|x| is_unreadable(**x)) {
                *x = value;
            }
        }
        let (mut rest, mut next) = (Bytes(message), 0);
        while !rest.0.is_empty() {
            // Fields mostly come in the order of the schema.
            if let (Some(field), [first, tail @ ..]) = (self.fields.get(next), rest.0)
                && field.lead == *first
            {
                (rest.0, next) = (tail, next + 1);
                if let Take::Number(number, slot) = &field.take {
                    *out.get_mut(*slot)? = number.read(field.form, &mut rest)?;
                } else {
                    field.take.read(field.form, &mut rest, counts, out)?;
                }
                continue;
            }
            let (number, form) = wire::key(&mut rest)?;
            match self.place(number) {
                Some(place) => {
                    next = place + 1;
                    self.fields.get(place)?.take.read(form, &mut rest, counts, out)?;
                }
                None => wire::skip(&mut rest, number, form)?,
            }
        }
        Some(())
    }
}

impl Field {
    fn new(number: u32, take: Take) -> Field {
        let form = match &take {
            Take::Number(number, _) => number.form(),
            Take::Numbers(..) | Take::Message(_) | Take::Messages(..) => Form::Stretch,
        };
        let lead = if number < 16 { (number as u8) << 3 | form as u8 } else { 0 };
        Field { number, lead, form, take }
    }
}

impl Take {
    fn read(
        &self,
        form: Form,
        rest: &mut Bytes,
        counts: &mut [usize],
        out: &mut [f64],
    ) -> Option<()> {
        match (self, form) {
            (Take::Number(number, slot), form) => *out.get_mut(*slot)? = number.read(form, rest)?,
            (Take::Numbers(number, list, wanted), Form::Stretch) => {
                number.packed(wire::stretch(rest)?, counts.get_mut(*list)?, wanted, out)?;
            }
            (Take::Numbers(number, list, wanted), form) => {
                set(counts.get_mut(*list)?, wanted, number.read(form, rest)?, out);
            }
            (Take::Message(node), Form::Stretch) => {
                node.read(wire::stretch(rest)?, counts, out)?;
            }
            (Take::Messages(list, items), Form::Stretch) => {
                let inner = wire::stretch(rest)?;
                let count = counts.get_mut(*list)?;
                let item = items.iter().find(|item| item.0 == *count);
                *count += 1;
                if let Some((_, node)) = item {
                    node.read(inner, counts, out)?;
                }
            }
            _ => return None,
        }
        Some(())
    }
}

/// The next number of a list: goes to its slot, if anybody wants it.
#[inline]
fn set(count: &mut usize, wanted: &[(usize, usize)], value: f64, out: &mut [f64]) {
    let slot = wanted.iter().find(|w| w.0 == *count).and_then(|w| out.get_mut(w.1));
    *count += 1;
    if let Some(x) = slot {
        *x = value;
    }
}

impl Number {
    /// None where such a number is not written so.
    #[inline(always)]
    fn read(self, form: Form, rest: &mut Bytes) -> Option<f64> {
        let x = match (self, form) {
            (Number::Double, Form::Eight) => f64::from_bits(rest.u64()?),
            (Number::Float, Form::Four) => f64::from(f32::from_bits(rest.u32()?)),
            (Number::Signed, Form::Varint) => wire::varint(rest)? as i64 as f64,
            (Number::Unsigned, Form::Varint) => wire::varint(rest)? as f64,
            (Number::Zigzag, Form::Varint) => {
                let n = wire::varint(rest)?;
                ((n >> 1) as i64 ^ -((n & 1) as i64)) as f64
            }
            (Number::Bool, Form::Varint) => f64::from(u8::from(wire::varint(rest)? != 0)),
            (Number::Fixed32, Form::Four) => f64::from(rest.u32()?),
            (Number::Sfixed32, Form::Four) => f64::from(rest.u32()? as i32),
            (Number::Fixed64, Form::Eight) => rest.u64()? as f64,
            (Number::Sfixed64, Form::Eight) => rest.u64()? as i64 as f64,
            _ => return None,
        };
        Some(finite(x))
    }

    fn form(self) -> Form {
        match self.size() {
            Some(8) => Form::Eight,
            Some(_) => Form::Four,
            None => Form::Varint,
        }
    }

    /// Bytes of one, where all are of the same size.
    pub fn size(self) -> Option<usize> {
        match self {
            Number::Double | Number::Fixed64 | Number::Sfixed64 => Some(8),
            Number::Float | Number::Fixed32 | Number::Sfixed32 => Some(4),
            Number::Signed | Number::Unsigned | Number::Zigzag | Number::Bool => None,
        }
    }

    /// Numbers in a row.
    fn packed(
        self,
        packed: &[u8],
        count: &mut usize,
        wanted: &[(usize, usize)],
        out: &mut [f64],
    ) -> Option<()> {
        let mut rest = Bytes(packed);
        let Some(size) = self.size() else {
            while !rest.0.is_empty() {
                set(count, wanted, self.read(Form::Varint, &mut rest)?, out);
            }
            return Some(());
        };
        if !packed.len().is_multiple_of(size) {
            return None;
        }
        let (n, form) = (packed.len() / size, self.form());
        for &(place, slot) in wanted {
            let Some(i) = place.checked_sub(*count).filter(|&i| i < n) else { continue };
            *out.get_mut(slot)? = self.read(form, &mut Bytes(packed.get(i * size..)?))?;
        }
        *count += n;
        Some(())
    }
}
