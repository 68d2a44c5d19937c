//! What a model consists of: quantities, parameters, states, delays, assumed constants. Plain data.

use super::graph::{Leaf, Node};
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A named quantity of a model with its SI unit and meaning.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Quantity {
    pub name: String,
    pub unit: String,
    pub doc: String,
}

/// Where one value of a parameter holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Scope {
    /// One value for all segments of an estimation.
    Campaign,
    /// One value per segment.
    Segment,
    /// One value for all segments that are alike in this column of the segments.
    Column(String),
}

impl Scope {
    /// `campaign`, `segment`, or the name of a column.
    pub fn parse(text: &str) -> Scope {
        match text {
            "campaign" => Scope::Campaign,
            "segment" => Scope::Segment,
            column => Scope::Column(column.to_string()),
        }
    }

    pub fn name(&self) -> &str {
        match self {
            Scope::Campaign => "campaign",
            Scope::Segment => "segment",
            Scope::Column(column) => column,
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    pub quantity: Quantity,
    pub start: f64,
    /// Bounds; infinite where there are none.
    pub min: f64,
    pub max: f64,
    pub scope: Scope,
    /// The value of the scope's column in which it is held at `start`.
    pub held_in: Option<String>,
    /// Held at `start` unless an estimation frees it.
    pub fixed: bool,
    /// Standard deviation of a prior centred at `start`; infinite without one.
    pub prior_sd: f64,
}

/// A constant that models assume: value and its standard deviation in SI.
#[derive(Debug, Clone, PartialEq)]
pub struct Assumed {
    pub quantity: Quantity,
    pub value: f64,
    pub sd: f64,
    /// Where the value comes from; empty for one that stands in the model's file.
    pub source: String,
    /// The pipeline that estimated it, if one did.
    pub origin: Option<Origin>,
}

/// How a state begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StartKind {
    /// The first measured value of the output of the same name.
    Measured,
    /// An expression of parameters, constants, other states' starts and the inputs at the start.
    Expression(Node),
}

#[derive(Debug, Clone, PartialEq)]
pub struct State {
    pub quantity: Quantity,
    pub start: StartKind,
    pub min: Option<Node>,
    pub max: Option<Node>,
    /// Limit of the absolute rate; the rate itself is limited already.
    pub rate_max: Option<Node>,
    /// Root of the spectral density of the white noise that drives it.
    pub noise: Option<Node>,
    /// Standard deviation of the start, in a model driven by noise.
    pub start_sd: Option<Node>,
    /// Its rate is zero: it moves where its limits take it.
    pub rests: bool,
    /// Made by the compiler for a `lag()`.
    pub hidden: bool,
}

/// A state that friction holds, or that is the velocity of a state with stops: it is zero while
/// held. Its rate is `select(held, 0, free - side*friction)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moving {
    /// The state: a velocity.
    pub velocity: usize,
    /// The state with stops whose rate it is.
    pub position: Option<usize>,
    /// What its rate would be without friction and stop.
    pub free: Node,
    /// Friction, in the unit of the rate; none where only a stop holds it.
    pub friction: Option<Node>,
}

/// What a `delay()` or a `smooth()` is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delayed {
    Input(usize),
    State(usize),
    /// An input without its small movements: `tau` is the reach of the filter, `Within` stands
    /// behind it.
    Smooth(usize),
    /// How small these movements are (`tau`, in the input's unit); no value of its own.
    Within(usize),
    /// How long ago the input without its small movements is read (`tau`), where that is not now: it stands
    /// behind `Within`, and has no value of its own.
    Ago(usize),
}

impl Delayed {
    /// What it is of, at the present time.
    pub fn now(self) -> Leaf {
        match self {
            Delayed::Input(i) | Delayed::Smooth(i) | Delayed::Within(i) | Delayed::Ago(i) => {
                Leaf::Input(i)
            }
            Delayed::State(i) => Leaf::State(i),
        }
    }

    /// The place of the time before at which a `smooth()` at place `k` of all delays is read; none where it is
    /// of the present.
    pub fn ago(k: usize, of: impl Fn(usize) -> Option<Delayed>) -> Option<usize> {
        matches!(of(k + 2), Some(Delayed::Ago(_))).then_some(k + 2)
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delay {
    pub of: Delayed,
    /// Node of the delay time, s.
    pub tau: Node,
}

/// What `[trim]` says: quantities solved for, and named nodes that must vanish.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trim {
    pub free: Vec<(String, Leaf)>,
    pub zero: Vec<(String, Node)>,
}

/// One entry of an aircraft file.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Given {
    /// The assumed value, in SI.
    pub value: f64,
    /// Its coherent SI unit.
    pub unit: String,
    /// Standard deviation of the assumed value.
    #[schemars(range(min = 0.0))]
    pub sd: f64,
    /// Where the value comes from.
    pub source: String,
    /// The pipeline that estimated it; none for a value that a person wrote, who cannot say this.
    #[serde(default)]
    #[schemars(skip)]
    pub origin: Option<Origin>,
}

/// Where a value was estimated.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, Serialize)]
pub struct Origin {
    /// The other pipeline file, as the pipeline file names it.
    pub from: String,
    /// Correlation of its error with those of other values that were estimated with it.
    pub with: IndexMap<String, f64>,
}

/// An aircraft file (`aircraft.toml`): constants by name, which override those of the models.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, Serialize, JsonSchema)]
#[serde(transparent)]
pub struct Constants(pub IndexMap<String, Given>);
