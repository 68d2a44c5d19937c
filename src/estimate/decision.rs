//! What the data say of a parameter that may be left out, and what became of it.

/// What the data say of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Support {
    Significant,
    NotSignificant,
    /// A search through the equations did not take it.
    NotTaken,
    /// The data do not distinguish it from others.
    NotObservable,
}

impl Support {
    /// The stable text that tables carry.
    pub fn as_str(self) -> &'static str {
        match self {
            Support::Significant => "significant",
            Support::NotSignificant => "not significant",
            Support::NotTaken => "not taken",
            Support::NotObservable => "not observable",
        }
    }
}

/// One candidate and what became of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    pub parameter: String,
    pub unit: String,
    /// Estimate and standard deviation, before it was held; of several values the one farthest from
    /// its start. NaN where there is none.
    pub value: f64,
    pub sd: f64,
    pub start: f64,
    pub support: Support,
    /// What the data do not distinguish it from, where that is why it was held; empty where no
    /// output notices it at all.
    pub like: Vec<String>,
}

impl Decision {
    pub fn held(&self) -> bool {
        self.support != Support::Significant
    }
}
