//! Message types and the paths that are wanted of them in; a list of steps that takes the numbers
//! out of a message out.
//!
//! What has a fixed size is one step, with the offset of every wanted number worked out for each of
//! the eight places modulo 8 at which it can start; what depends on the message is walked over.

use super::types::{Kind, Number, Sizes, Types, followed, padding};
use crate::log::decode::encoding::finite;
use crate::log::decode::paths::{self, Wanted};
use std::rc::Rc;

pub(super) enum Step {
    Fixed(Fixed),
    Text,
    /// A list of numbers, its length in front: what is wanted of them by place in the list.
    Numbers(Number, Vec<Listed>),
    /// A list of anything else; its length in front where it has none fixed.
    Items(Option<u64>, Items),
    /// A type with nothing wanted in it.
    Nested(Rc<Vec<Step>>),
    /// What follows cannot be read.
    Stop,
}

/// A run of bytes that has the same size in every message.
#[derive(Default)]
pub(super) struct Fixed {
    sizes: Sizes,
    loads: Vec<Load>,
}

struct Load {
    /// From the start of the run, by the place of that start modulo 8.
    at: Sizes,
    number: Number,
    slot: usize,
}

/// What is wanted of a number at a place of a list.
pub(super) struct Listed {
    place: usize,
    number: Number,
    slot: usize,
}

pub(super) struct Items {
    /// How an item is passed over.
    other: Vec<Step>,
    /// By place in the list, ascending: items of which something is wanted.
    wanted: Vec<(usize, Vec<Step>)>,
}

/// Makes steps from types.
pub(super) struct Planner<'a> {
    types: &'a Types,
    /// How each structure is passed over, once it was asked for.
    passing: Vec<Option<Rc<Vec<Step>>>>,
}

impl<'a> Planner<'a> {
    pub fn new(types: &'a Types) -> Planner<'a> {
        Planner { types, passing: types.structs.iter().map(|_| None).collect() }
    }

    /// The steps over one value of a type.
    pub fn steps(&mut self, kind: &Kind, wanted: &[Wanted]) -> Vec<Step> {
        let mut steps = Vec::new();
        self.value(kind, wanted, &mut steps);
        steps
    }

    fn value(&mut self, kind: &Kind, wanted: &[Wanted], steps: &mut Vec<Step>) {
        if wanted.is_empty() {
            return self.pass(kind, steps);
        }
        match kind {
            Kind::Number(number) => {
                load(*number, paths::here(wanted), paths::rest_here(wanted), steps);
            }
            Kind::Struct(i) => {
                let members = self.types.structs.get(*i).map_or(&[][..], |s| &s.members);
                if members.is_empty() {
                    return self.pass(kind, steps);
                }
                for member in members {
                    self.value(&member.kind, &paths::below(wanted, &member.name), steps);
                }
            }
            Kind::Array(item, n) => match **item {
                Kind::Number(number) => numbers(number, *n, listed(number, wanted), steps),
                _ => steps.push(Step::Items(Some(*n), self.items(item, wanted))),
            },
            Kind::Sequence(item) => match **item {
                Kind::Number(number) => steps.push(Step::Numbers(number, listed(number, wanted))),
                _ => steps.push(Step::Items(None, self.items(item, wanted))),
            },
            Kind::Text | Kind::Opaque => self.pass(kind, steps),
        }
    }

    fn items(&mut self, item: &Kind, wanted: &[Wanted]) -> Items {
        let of = paths::items(wanted).into_iter();
        let wanted = of.map(|(place, wanted)| (place, self.steps(item, &wanted))).collect();
        Items { other: self.steps(item, &[]), wanted }
    }

    fn pass(&mut self, kind: &Kind, steps: &mut Vec<Step>) {
        if let Some(sizes) = self.types.sizes(kind) {
            return fixed(steps, |run| run.sizes = followed(&run.sizes, &sizes));
        }
        match kind {
            Kind::Text => steps.push(Step::Text),
            Kind::Struct(i) => steps.push(Step::Nested(self.passing(*i))),
            Kind::Array(item, n) => steps.push(Step::Items(Some(*n), self.items(item, &[]))),
            Kind::Sequence(item) => match **item {
                Kind::Number(number) => steps.push(Step::Numbers(number, Vec::new())),
                _ => steps.push(Step::Items(None, self.items(item, &[]))),
            },
            Kind::Number(_) | Kind::Opaque => steps.push(Step::Stop),
        }
    }

    fn passing(&mut self, structure: usize) -> Rc<Vec<Step>> {
        if let Some(Some(known)) = self.passing.get(structure) {
            return known.clone();
        }
        let mut steps = Vec::new();
        let types = self.types;
        for member in types.structs.get(structure).map_or(&[][..], |s| &s.members) {
            self.pass(&member.kind, &mut steps);
        }
        let steps = Rc::new(steps);
        if let Some(known) = self.passing.get_mut(structure) {
            *known = Some(steps.clone());
        }
        steps
    }
}

/// Adds to the run of fixed size at the end of the steps.
fn fixed(steps: &mut Vec<Step>, add: impl FnOnce(&mut Fixed)) {
    if let Some(Step::Fixed(run)) = steps.last_mut() {
        return add(run);
    }
    let mut run = Fixed::default();
    add(&mut run);
    steps.push(Step::Fixed(run));
}

/// A number, and what a whole one is above it, each where it has a slot.
fn load(number: Number, slot: Option<usize>, rest: Option<usize>, steps: &mut Vec<Step>) {
    fixed(steps, |run| {
        let at = run.aligned(number);
        run.sizes = at.map(|at| at.saturating_add(number.size()));
        run.loads.extend(slot.map(|slot| Load { at, number, slot }));
        let rest = rest.zip(number.rest());
        run.loads.extend(rest.map(|(slot, number)| Load { at, number, slot }));
    });
}

/// What is wanted of a list of numbers, and of what whole ones are above them.
fn listed(number: Number, wanted: &[Wanted]) -> Vec<Listed> {
    let paths::Numbers { at, above } = paths::numbers(wanted);
    let of = |number: Number| move |(place, slot): (usize, usize)| Listed { place, number, slot };
    let above = number.rest().map(|rest| above.into_iter().map(of(rest)));
    at.into_iter().map(of(number)).chain(above.into_iter().flatten()).collect()
}

/// A list of `n` numbers, of which those at some places are wanted.
fn numbers(number: Number, n: u64, wanted: Vec<Listed>, steps: &mut Vec<Step>) {
    let n = usize::try_from(n).unwrap_or(usize::MAX);
    let after = |at: usize, n: usize| at.saturating_add(number.size().saturating_mul(n));
    fixed(steps, |run| {
        let first = run.aligned(number);
        let inside = wanted.into_iter().filter(|listed| listed.place < n);
        run.loads.extend(inside.map(|Listed { place, number, slot }| Load {
            at: first.map(|at| after(at, place)),
            number,
            slot,
        }));
        run.sizes = first.map(|at| after(at, n));
    });
}

impl Fixed {
    /// Where a number behind the run stands.
    fn aligned(&self, number: Number) -> Sizes {
        let at = |start: usize| {
            let end = self.sizes[start];
            end.saturating_add(padding(start.wrapping_add(end), number.size()))
        };
        std::array::from_fn(at)
    }
}

/// The bytes of a message behind its first four, and how far they are read.
pub(super) struct Cursor<'a, const BIG: bool> {
    pub body: &'a [u8],
    pub at: usize,
}

/// Whether a message can be read on.
pub(super) enum Flow {
    On,
    Stop,
}

impl<'a, const BIG: bool> Cursor<'a, BIG> {
    /// Takes the steps; none where the message ends too early.
    pub fn take(&mut self, steps: &[Step], out: &mut [f64]) -> Option<Flow> {
        for step in steps {
            match step {
                Step::Fixed(run) => self.fixed(run, out)?,
                Step::Text => {
                    let n = self.length()?;
                    self.skip(n)?;
                }
                Step::Numbers(number, wanted) => self.numbers(*number, wanted, out)?,
                Step::Nested(steps) => {
                    if let Flow::Stop = self.take(steps, out)? {
                        return Some(Flow::Stop);
                    }
                }
                Step::Items(count, items) => {
                    if let Flow::Stop = self.items(*count, items, out)? {
                        return Some(Flow::Stop);
                    }
                }
                Step::Stop => return Some(Flow::Stop),
            }
        }
        Some(Flow::On)
    }

    fn skip(&mut self, n: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(n)?;
        let bytes = self.body.get(self.at..end)?;
        self.at = end;
        Some(bytes)
    }

    #[inline]
    fn fixed(&mut self, run: &Fixed, out: &mut [f64]) -> Option<()> {
        let start = self.at % 8;
        let bytes = self.skip(run.sizes[start])?;
        for load in &run.loads {
            if let Some(value) = out.get_mut(load.slot) {
                *value = read::<BIG>(load.number, bytes.get(load.at[start]..)?)?;
            }
        }
        Some(())
    }

    /// The length that stands in front of texts and lists.
    pub fn length(&mut self) -> Option<usize> {
        self.skip(padding(self.at, 4))?;
        let bytes = self.skip(4)?.first_chunk()?;
        let n = if BIG { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) };
        usize::try_from(n).ok()
    }

    fn numbers(&mut self, number: Number, wanted: &[Listed], out: &mut [f64]) -> Option<()> {
        let n = self.length()?;
        if n == 0 {
            return Some(());
        }
        let size = number.size();
        self.skip(padding(self.at, size))?;
        let bytes = self.skip(n.checked_mul(size)?)?;
        for listed in wanted.iter().filter(|listed| listed.place < n) {
            if let Some(value) = out.get_mut(listed.slot) {
                *value = read::<BIG>(listed.number, bytes.get(listed.place * size..)?)?;
            }
        }
        Some(())
    }

    fn items(&mut self, count: Option<u64>, items: &Items, out: &mut [f64]) -> Option<Flow> {
        let n = self.count(count)?;
        let mut wanted = items.wanted.iter().peekable();
        for i in 0..usize::try_from(n).ok()? {
            let steps = match wanted.next_if(|w| w.0 == i) {
                Some((_, steps)) => steps,
                None => &items.other,
            };
            if let Flow::Stop = self.take(steps, out)? {
                return Some(Flow::Stop);
            }
        }
        Some(Flow::On)
    }

    /// How many items follow. Each takes a byte at least: a larger number is a lie.
    pub fn count(&mut self, fixed: Option<u64>) -> Option<u64> {
        let n = match fixed {
            Some(n) => n,
            None => self.length()? as u64,
        };
        (n <= (self.body.len() - self.at) as u64).then_some(n)
    }
}

/// The number at the start of some bytes; infinite ones are NaN.
#[inline]
fn read<const BIG: bool>(number: Number, bytes: &[u8]) -> Option<f64> {
    macro_rules! read {
        ($kind:ty) => {{
            let bytes = *bytes.first_chunk()?;
            if BIG { <$kind>::from_be_bytes(bytes) } else { <$kind>::from_le_bytes(bytes) }
        }};
    }
    let value = match number {
        Number::Bool => f64::from(read!(u8) != 0),
        Number::U8 => f64::from(read!(u8)),
        Number::I8 => f64::from(read!(i8)),
        Number::U16 => f64::from(read!(u16)),
        Number::I16 => f64::from(read!(i16)),
        Number::U32 => f64::from(read!(u32)),
        Number::I32 => f64::from(read!(i32)),
        Number::U64 => read!(u64) as f64,
        Number::I64 => read!(i64) as f64,
        Number::F32 => f64::from(read!(f32)),
        Number::F64 => read!(f64),
        Number::RestOfU64 => paths::rest(i128::from(read!(u64))),
        Number::RestOfI64 => paths::rest(i128::from(read!(i64))),
    };
    Some(finite(value))
}
