//! What a step is taken with, and what may come of it: how every mover is, what happens to it, where
//! sensitivities jump, and why a trajectory is given up.

use super::tableau::MOST_SUBSTEPS;
use crate::model::State;

/// A part of grid step `k`: from `from` to `to` of its sub-step `s` of `m`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    pub k: usize,
    pub s: usize,
    pub m: usize,
    pub from: f64,
    pub to: f64,
}

impl Span {
    /// All of a sub-step.
    pub fn whole(k: usize, s: usize, m: usize) -> Span {
        Span { k, s, m, from: 0.0, to: 1.0 }
    }

    /// Whether it begins a grid step.
    pub fn begins(&self) -> bool {
        self.s == 0 && self.from == 0.0
    }

    /// The fraction of the grid step at `offset` of the span.
    pub fn at(&self, offset: f64) -> f64 {
        (self.s as f64 + self.from + offset * (self.to - self.from)) / self.m as f64
    }
}

/// Why a trajectory was given up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lost {
    /// A state or an output is not finite.
    Diverges,
    /// This state is too fast for the steps that are allowed: its time constant, s.
    Stiff { state: usize, time_constant: f64 },
    /// Friction or a stop lets go of this state and holds it again without end.
    Chatters { state: usize },
    /// The friction of this state is negative.
    Negative { state: usize },
}

impl Lost {
    /// In words, with the states' names.
    pub fn words(self, states: &[State]) -> String {
        let name = |state: usize| states.get(state).map_or("", |s| s.quantity.name.as_str());
        match self {
            Lost::Diverges => "the motion diverges".into(),
            Lost::Stiff { state, time_constant } => format!(
                "\"{}\" is too fast to be integrated, its time constant is {time_constant:.2e} s and \
                 {MOST_SUBSTEPS} steps to a sample are the most,",
                name(state)
            ),
            Lost::Chatters { state } => format!(
                "friction or a stop lets go of \"{}\" and holds it again without end",
                name(state)
            ),
            Lost::Negative { state } => format!("the friction of \"{}\" is negative", name(state)),
        }
    }
}

/// How a mover is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mode {
    /// It moves: which way against its friction; 0 where it has none.
    Free(i8),
    /// Friction holds it.
    Rests,
    /// Pushed against a stop.
    AtMin,
    AtMax,
}

impl Mode {
    /// As the model reads it: 1 where it is held.
    pub fn held(self) -> f64 {
        f64::from(u8::from(!matches!(self, Mode::Free(_))))
    }

    /// Which way it moves.
    pub fn side(self) -> f64 {
        if let Mode::Free(side) = self { f64::from(side) } else { 0.0 }
    }
}

/// What may happen to a mover.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Event {
    /// Its velocity passes zero.
    Turns,
    /// Its position passes its lower or its upper stop.
    Min,
    Max,
    /// It is no longer held as it was.
    Loose,
}

/// A jump of the sensitivities.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Jump {
    /// After so many steps of the chunk.
    pub after: usize,
    /// The mover, and what happens to it.
    pub moving: usize,
    pub event: Event,
    /// The rates of all states just before and just after.
    pub before: Vec<f64>,
    pub behind: Vec<f64>,
    /// The limit that its position meets or leaves: `2 i` the lower one of state i, `2 i + 1` the
    /// upper one.
    pub limit: Option<usize>,
    /// How fast that limit itself moves.
    pub drift: f64,
    /// How fast what holds it there grows.
    pub gap: f64,
}
