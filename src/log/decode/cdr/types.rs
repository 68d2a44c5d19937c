//! Declared message types, as a definition text gives them, in; types that refer to each other by
//! number, with the size of what has a fixed one, out.

use std::collections::BTreeMap;

/// Types nested deeper than this are refused.
const DEEPEST: usize = 64;
/// Longer lists of fixed length are not laid out in advance, unless their items are numbers.
const LAID_OUT: u64 = 64;

/// A number on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Number {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    /// What one of 64 bits is above its nearest `f64`; no type of a definition.
    RestOfU64,
    RestOfI64,
}

impl Number {
    /// Bytes, which is also what it is aligned to.
    pub fn size(self) -> usize {
        match self {
            Number::Bool | Number::U8 | Number::I8 => 1,
            Number::U16 | Number::I16 => 2,
            Number::U32 | Number::I32 | Number::F32 => 4,
            Number::U64 | Number::I64 | Number::F64 | Number::RestOfU64 | Number::RestOfI64 => 8,
        }
    }

    /// How what a number is above its nearest `f64` is read, where that can be anything.
    pub fn rest(self) -> Option<Number> {
        match self {
            Number::U64 => Some(Number::RestOfU64),
            Number::I64 => Some(Number::RestOfI64),
            _ => None,
        }
    }
}

/// A type as it is written in a definition.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Written {
    Number(Number),
    Text,
    /// By name: the full names that it may have, the nearest first.
    Named(Vec<String>),
    Array(Box<Written>, u64),
    Sequence(Box<Written>),
    /// Nothing behind it can be read.
    Opaque,
}

/// A field as it is written in a definition.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WrittenMember {
    pub name: String,
    pub kind: Written,
    pub unit: String,
    pub doc: String,
}

/// What a name stands for.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Declared {
    Struct(Vec<WrittenMember>),
    Alias(Written),
}

/// A type whose names are resolved.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Kind {
    Number(Number),
    Text,
    /// A place in `Types::structs`.
    Struct(usize),
    Array(Box<Kind>, u64),
    Sequence(Box<Kind>),
    Opaque,
}

#[derive(Debug, PartialEq)]
pub(super) struct Member {
    pub name: String,
    pub kind: Kind,
    pub unit: String,
    pub doc: String,
}

/// Bytes that something takes, by where it starts: the place modulo 8, because numbers are aligned.
pub(super) type Sizes = [usize; 8];

#[derive(Debug, Default)]
pub(super) struct Struct {
    pub members: Vec<Member>,
    /// None where it depends on the message.
    pub sizes: Option<Sizes>,
}

/// All types that a message is made of.
#[derive(Debug, Default)]
pub(super) struct Types {
    pub structs: Vec<Struct>,
    pub root: usize,
}

impl Types {
    /// Resolves the type of the given name and all that it names.
    ///
    /// # Errors
    /// In words: a name that is not declared, a type that contains itself, one too deep.
    pub fn link(declared: &BTreeMap<String, Declared>, root: &str) -> Result<Types, String> {
        let mut linker =
            Linker { declared, types: Types::default(), known: BTreeMap::new(), open: Vec::new() };
        match linker.named(&[root.to_string()])? {
            Kind::Struct(root) => Ok(Types { root, ..linker.types }),
            _ => Err(format!("\"{root}\" is no message type")),
        }
    }

    /// The sizes of a type that every message has alike.
    pub fn sizes(&self, kind: &Kind) -> Option<Sizes> {
        let repeated = |one: &Sizes, n: u64| {
            let run = |start: usize| {
                (0..n).try_fold(0usize, |at, _| at.checked_add(one[start.wrapping_add(at) % 8]))
            };
            let runs: Vec<usize> = (0..8).map(run).collect::<Option<_>>()?;
            Sizes::try_from(runs).ok()
        };
        match kind {
            Kind::Number(n) => Some(number_sizes(*n, 1)),
            Kind::Struct(i) => self.structs.get(*i)?.sizes,
            Kind::Array(item, n) => match **item {
                Kind::Number(number) => Some(number_sizes(number, *n)),
                _ if *n <= LAID_OUT => repeated(&self.sizes(item)?, *n),
                _ => None,
            },
            Kind::Text | Kind::Sequence(_) | Kind::Opaque => None,
        }
    }
}

/// The sizes of `n` numbers in a row.
fn number_sizes(number: Number, n: u64) -> Sizes {
    let size = number.size();
    let n = usize::try_from(n).unwrap_or(usize::MAX);
    std::array::from_fn(|start| padding(start, size).saturating_add(size.saturating_mul(n)))
}

/// Bytes from a place to the next multiple of a power of two.
pub(super) fn padding(at: usize, align: usize) -> usize {
    at.wrapping_neg() & (align - 1)
}

/// The sizes of one thing after the other.
pub(super) fn followed(first: &Sizes, then: &Sizes) -> Sizes {
    std::array::from_fn(|start| {
        first[start].saturating_add(then[start.wrapping_add(first[start]) % 8])
    })
}

struct Linker<'a> {
    declared: &'a BTreeMap<String, Declared>,
    types: Types,
    known: BTreeMap<String, Kind>,
    /// Names that are being resolved.
    open: Vec<String>,
}

impl Linker<'_> {
    fn named(&mut self, names: &[String]) -> Result<Kind, String> {
        let found = names.iter().find_map(|name| self.declared.get_key_value(name));
        let Some((name, declared)) = found else {
            let name = names.last().map_or("", String::as_str);
            return Err(format!("the schema does not define the type \"{name}\""));
        };
        if let Some(kind) = self.known.get(name) {
            return Ok(kind.clone());
        }
        if self.open.contains(name) {
            return Err(format!("the type \"{name}\" of the schema contains itself"));
        }
        if self.open.len() >= DEEPEST {
            return Err(format!("the types of the schema are nested deeper than {DEEPEST}"));
        }
        self.open.push(name.clone());
        let kind = match declared {
            Declared::Alias(written) => self.kind(written, 0)?,
            Declared::Struct(members) => self.structure(members)?,
        };
        self.open.pop();
        self.known.insert(name.clone(), kind.clone());
        Ok(kind)
    }

    fn kind(&mut self, written: &Written, depth: usize) -> Result<Kind, String> {
        if depth > DEEPEST {
            return Err(format!("the types of the schema are nested deeper than {DEEPEST}"));
        }
        Ok(match written {
            Written::Number(n) => Kind::Number(*n),
            Written::Text => Kind::Text,
            Written::Named(names) => self.named(names)?,
            Written::Array(_, 0) => return Err("the schema has a list of length 0".into()),
            Written::Array(item, n) => Kind::Array(Box::new(self.kind(item, depth + 1)?), *n),
            Written::Sequence(item) => Kind::Sequence(Box::new(self.kind(item, depth + 1)?)),
            Written::Opaque => Kind::Opaque,
        })
    }

    fn structure(&mut self, written: &[WrittenMember]) -> Result<Kind, String> {
        let mut members = Vec::new();
        for m in written {
            let kind = self.kind(&m.kind, 0)?;
            let (name, unit, doc) = (m.name.clone(), m.unit.clone(), m.doc.clone());
            members.push(Member { name, kind, unit, doc });
        }
        // A message without fields takes one byte.
        let start = if members.is_empty() { [1; 8] } else { [0; 8] };
        let sizes = members
            .iter()
            .try_fold(start, |at, m| Some(followed(&at, &self.types.sizes(&m.kind)?)));
        self.types.structs.push(Struct { members, sizes });
        Ok(Kind::Struct(self.types.structs.len() - 1))
    }
}
