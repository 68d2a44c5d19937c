//! The sections of a model file as they stand in the text, before any name is looked up.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A model file (`<name>.model.toml`) or a fragment.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// One line saying what the model describes.
    pub title: String,
    /// Where the equations come from.
    #[serde(default)]
    pub source: String,
    /// Fragments pulled in: names of embedded ones, or paths beginning with "./" beside this file.
    #[serde(default, rename = "use")]
    pub uses: Vec<String>,
    /// What drives the model: columns of the samples table with the unit the equations expect.
    #[serde(default)]
    pub inputs: IndexMap<String, Input>,
    /// Assumed values; those without a value here come from the aircraft file.
    #[serde(default)]
    pub constants: IndexMap<String, Constant>,
    /// What may be estimated.
    #[serde(default)]
    pub parameters: IndexMap<String, ParameterEntry>,
    /// Named expressions, in any order.
    #[serde(default)]
    pub equations: IndexMap<String, String>,
    /// What is integrated.
    #[serde(default)]
    pub states: IndexMap<String, State>,
    /// What is compared with measurements.
    #[serde(default)]
    pub outputs: IndexMap<String, Output>,
    /// Tables for `table(name, x)`.
    #[serde(default)]
    pub tables: IndexMap<String, TableEntry>,
    /// What is solved for, and what must vanish, in steady flight.
    pub trim: Option<Trim>,
    /// Effects added to the equations above, or to those of the fragments used, in this order.
    #[serde(default)]
    pub effect: Vec<Effect>,
}

/// An addition to a model that leaves its lines as they stand: what is new, and where it acts.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Effect {
    /// One line saying what the effect is.
    pub title: String,
    /// Assumed values that the effect needs.
    #[serde(default)]
    pub constants: IndexMap<String, Constant>,
    /// What may be estimated.
    #[serde(default)]
    pub parameters: IndexMap<String, ParameterEntry>,
    /// Named expressions of the effect's own.
    #[serde(default)]
    pub equations: IndexMap<String, String>,
    /// What is integrated besides the model's own states.
    #[serde(default)]
    pub states: IndexMap<String, State>,
    /// Terms added to an equation, to the rate of a state (`"rate(q)"`), to its friction
    /// (`"friction(q)"`), to a limit that it has (`"min(delta)"`, `"max(delta)"`) or to an output
    /// (`"output(alpha)"`).
    #[serde(default)]
    pub add: IndexMap<String, String>,
    /// What everything else reads instead of an input, constant, parameter, equation or state, of a
    /// state's rate (`"rate(q)"`), friction (`"friction(q)"`) or limits (`"min(delta)"`,
    /// `"max(delta)"`; it may have had none), or of an output (`"output(alpha)"`). The effect
    /// itself still
    /// reads what was there before it.
    #[serde(default)]
    pub replace: IndexMap<String, String>,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Input {
    /// The SI unit.
    Unit(String),
    Full(InputFull),
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InputFull {
    pub unit: String,
    #[serde(default)]
    pub doc: String,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Constant {
    /// The SI unit; the value comes from the aircraft file.
    Unit(String),
    Full(ConstantFull),
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConstantFull {
    pub unit: String,
    /// The value, unless the aircraft file gives one.
    pub value: Option<f64>,
    /// Standard deviation of the assumed value.
    #[serde(default)]
    #[schemars(range(min = 0.0))]
    pub sd: f64,
    #[serde(default)]
    pub doc: String,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterEntry {
    pub unit: String,
    /// Starting value of an estimation, and the value where the parameter is fixed.
    pub start: f64,
    /// Lower bound.
    pub min: Option<f64>,
    /// Upper bound.
    pub max: Option<f64>,
    /// Where one value holds: "campaign" (one value for all segments), "segment" (one for each), or
    /// a column that describes segments, such as "flight" (one for all segments that are alike
    /// there).
    #[serde(default = "campaign")]
    pub per: String,
    /// Of a parameter that is `per` a column: the value of that column (a flight) in which it is held at
    /// `start`. Where another parameter can move all values at once, the others are differences from
    /// that one.
    pub held_in: Option<String>,
    /// Held at `start` unless an estimation frees it.
    #[serde(default)]
    pub fixed: bool,
    /// Standard deviation of a prior centred at `start`.
    #[schemars(range(min = 0.0))]
    pub sd: Option<f64>,
    #[serde(default)]
    pub doc: String,
}

fn campaign() -> String {
    "campaign".to_string()
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct State {
    pub unit: String,
    /// Its time derivative, an expression.
    pub rate: String,
    /// Start value: a number, an expression, or "measured".
    pub start: Value,
    /// The state stays above this: a number, or an expression of inputs, other states, constants
    /// and parameters.
    pub min: Option<Value>,
    /// The state stays below this, likewise.
    pub max: Option<Value>,
    /// The rate stays within plus and minus this, likewise.
    pub rate_max: Option<Value>,
    /// Coulomb friction: what the rate has to overcome before the state leaves zero, and what acts
    /// against it while it moves, in the unit of the rate; a number or an expression, not negative.
    pub friction: Option<Value>,
    /// White noise that drives it (gusts): the root of its spectral density, in the state's unit
    /// per root of a second; a number or an expression, a parameter as a rule. A model with such a
    /// state is estimated by filter error.
    pub noise: Option<Value>,
    /// In a model driven by noise: how uncertain the start is, a standard deviation in the state's
    /// unit; a number or an expression. A start that is "measured" is as uncertain as that
    /// measurement without it, another one is known.
    pub start_sd: Option<Value>,
    #[serde(default)]
    pub doc: String,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Value {
    Number(f64),
    Text(String),
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Output {
    pub unit: String,
    /// An expression.
    pub value: String,
    #[serde(default)]
    pub doc: String,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableEntry {
    /// Break points of the first argument, ascending.
    pub x: Vec<f64>,
    pub unit_x: String,
    /// Break points of a second argument, ascending.
    pub x2: Option<Vec<f64>>,
    pub unit_x2: Option<String>,
    /// Values: one per break point, or one row of `x2` values per break point of `x`.
    pub y: Values,
    pub unit_y: String,
    #[serde(default)]
    pub doc: String,
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum Values {
    Row(Vec<f64>),
    Rows(Vec<Vec<f64>>),
}

#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Trim {
    /// States, inputs or parameters that are solved for.
    pub free: Vec<String>,
    /// Equations, outputs or state rates (`rate(w)`) that must vanish.
    pub zero: Vec<String>,
}
