//! The model language: a text file in, a compiled model out (`docs/model-language.md` is the reference).

/// A named quantity of a model with its SI unit and meaning.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    pub name: String,
    pub unit: String,
    pub doc: String,
}

/// Where one value of a parameter holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// One value for all segments of an estimation.
    Campaign,
    /// One value per segment.
    Segment,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    pub quantity: Quantity,
    pub start: f64,
    pub min: f64,
    pub max: f64,
    pub scope: Scope,
    /// Held at `start` unless an estimation frees it.
    pub fixed: bool,
    /// Standard deviation of a prior centred at `start`; infinite without one.
    pub prior_sd: f64,
}

/// How a state begins.
#[derive(Debug, Clone, PartialEq)]
pub enum Start {
    /// An expression of parameters and constants (compiled).
    Expression,
    /// The first measured value of the output of the same name.
    Measured,
}
