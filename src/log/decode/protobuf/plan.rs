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
    /// Of each of `fields`, key and slot where it is a double whose key is one byte.
    doubles: Vec<Option<(u8, usize)>>,
    /// Place in `fields` by field number, for the small ones; `NONE` for fields that nobody wants.
    small: Vec<u8>,
}

const NONE: u8 = u8::MAX;

/// Bytes of a double with a key of one byte in front.
const DOUBLE: usize = 9;

struct Field {
    number: u32,
    /// The key as writers write it, where that is one byte.
    lead: Option<u8>,
    form: Form,
    take: Take,
}

enum Take {
    Number(Number, usize),
    /// A number, and what a whole one is above it.
    Whole(Number, usize, usize),
    /// A list of numbers: its count, and what is wanted of them.
    Numbers(Number, usize, paths::Numbers),
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
                match paths::rest_here(&below) {
                    Some(rest) => Take::Whole(*number, slot, rest),
                    None => Take::Number(*number, slot),
                }
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
        let double = |field: &Field| match field.take {
            Take::Number(Number::Double, slot) => Some((field.lead?, slot)),
            _ => None,
        };
        self.doubles = self.fields.iter().map(double).collect();
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
        let (mut rest, mut next, mut in_order) = (message, 0, true);
        while let [first, tail @ ..] = rest {
            // Fields mostly come in the order of the schema.
            if let Some(field) = self.fields.get(next).filter(|field| field.lead == Some(*first)) {
                let met = self.row(next, rest, out);
                if met > 0 {
                    (rest, next) = (rest.get(met * DOUBLE..)?, next + met);
                    continue;
                }
                let mut ahead = Bytes(tail);
                // What is frequent is read here: a call for each number would cost more than it does.
                match &field.take {
                    Take::Number(number, slot) => {
                        *out.get_mut(*slot)? = number.read(field.form, &mut ahead)?;
                    }
                    Take::Message(node) => node.read(wire::stretch(&mut ahead)?, counts, out)?,
                    take => take.read(field.form, &mut ahead, counts, out)?,
                }
                (rest, next) = (ahead.0, next + 1);
                continue;
            }
            let mut ahead = Bytes(rest);
            let (number, form) = wire::key(&mut ahead)?;
            match self.place(number) {
                Some(place) => {
                    (next, in_order) = (place + 1, false);
                    self.fields.get(place)?.take.read(form, &mut ahead, counts, out)?;
                }
                None => wire::skip(&mut ahead, number, form)?,
            }
            rest = ahead.0;
        }
        if !in_order || next < self.fields.len() {
            self.fill_in(out);
        }
        Some(())
    }

    /// Reads the doubles that stand here one behind the other; how many there were. Where one of them
    /// stands does not hang on what was read before: the processor reads several side by side.
    #[inline(always)]
    fn row(&self, from: usize, bytes: &[u8], out: &mut [f64]) -> usize {
        let (mut met, mut rest) = (0, bytes);
        for double in self.doubles.iter().skip(from) {
            let Some(([first, bits @ ..], tail)) = rest.split_first_chunk::<DOUBLE>() else {
                break;
            };
            let Some((_, slot)) = double.filter(|(lead, _)| lead == first) else { break };
            let Some(x) = out.get_mut(slot) else { break };
            *x = finite(f64::from_le_bytes(*bits));
            (met, rest) = (met + 1, tail);
        }
        met
    }

    /// Says what the message left out. It may come in several pieces: what one of them said stays.
    fn fill_in(&self, out: &mut [f64]) {
        for &(slot, value) in &self.absent {
            if let Some(x) = out.get_mut(slot).filter(|x| is_unreadable(**x)) {
                *x = value;
            }
        }
    }
}

impl Field {
    fn new(number: u32, take: Take) -> Field {
        let form = match &take {
            Take::Number(number, _) | Take::Whole(number, ..) => number.form(),
            Take::Numbers(..) | Take::Message(_) | Take::Messages(..) => Form::Stretch,
        };
        let lead = (number < 16).then_some((number as u8) << 3 | form as u8);
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
            (Take::Whole(number, slot, above), form) => {
                (*out.get_mut(*slot)?, *out.get_mut(*above)?) = number.read_whole(form, rest)?;
            }
            (Take::Numbers(number, list, wanted), Form::Stretch) => {
                number.packed(wire::stretch(rest)?, counts.get_mut(*list)?, wanted, out)?;
            }
            (Take::Numbers(number, list, wanted), form) => {
                number.next(form, rest, counts.get_mut(*list)?, wanted, out)?;
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
