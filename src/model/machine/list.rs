//! Steps of straight-line vector code, each naming earlier ones: what `assign` gives registers to.

use super::encode::{Base, Form, Place, Signs};
use crate::model::tables::Tables;

/// The step that made it.
pub type Value = u32;

/// A function over lanes: three vectors of arguments, 64 bytes each, the first two of which become
/// results; tables; how many lanes.
pub type Function = unsafe extern "C" fn(*mut [f64; 8], *const Tables, usize);

#[derive(Debug, Clone, Copy)]
pub enum Step {
    /// Memory that nothing changes as long as it is wanted: read wherever that is best.
    Vector(Place),
    /// The same, one number for all lanes.
    Number(Place),
    Zero,
    Two(Form, Value, Value),
    Root(Value),
    Fused(Signs, [Value; 3]),
    /// `yes` where `x > y`, else `no`.
    Choose {
        x: Value,
        y: Value,
        yes: Value,
        no: Value,
    },
    /// The number at a place in one lane, in others what was before (zeros if nothing).
    Insert(Option<Value>, u8, Place),
    /// Sine; the cosine is the next step, `Cosine`.
    Sine(Value),
    Cosine,
    Call(Function, [Value; 3]),
    Store(Value, Place),
    /// The first so many lanes.
    StoreFirst(Value, Place, u8),
    /// A general register from memory, and another one added to it.
    Fetch(Base, Place, Base),
}

impl Step {
    /// What it reads.
    pub fn operands(&self) -> ([Value; 4], usize) {
        match *self {
            Step::Two(_, a, b) => ([a, b, 0, 0], 2),
            Step::Fused(_, [a, b, c]) | Step::Call(_, [a, b, c]) => ([a, b, c, 0], 3),
            Step::Choose { x, y, yes, no } => ([x, y, yes, no], 4),
            Step::Insert(Some(a), ..)
            | Step::Root(a)
            | Step::Sine(a)
            | Step::Store(a, _)
            | Step::StoreFirst(a, ..) => ([a, 0, 0, 0], 1),
            _ => ([0; 4], 0),
        }
    }

    /// Whether its value can be had again without a register or a place for it.
    pub fn is_leaf(&self) -> bool {
        matches!(self, Step::Vector(_) | Step::Number(_) | Step::Zero)
    }
}

/// Steps in order.
#[derive(Debug, Default)]
pub struct List(pub Vec<Step>);

impl List {
    pub fn push(&mut self, step: Step) -> Value {
        self.0.push(step);
        (self.0.len() - 1) as Value
    }

    /// `a b + c`.
    pub fn fused(&mut self, a: Value, b: Value, c: Value) -> Value {
        self.push(Step::Fused(Signs::Plus, [a, b, c]))
    }
}
