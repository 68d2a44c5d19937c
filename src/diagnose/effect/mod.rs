//! Effect files and a base model in; candidates (what the model may lack, each one a compiled model of its own) out.
//!
//! `file` reads effect files, `roles` finds what of the model they speak of, `bind` makes each combination a candidate, `block` writes
//! the lines that a candidate adds to a model's text, `fill` puts names into placeholders. See `docs/effects.md`.

mod bind;
mod block;
pub mod file;
mod fill;
pub mod roles;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use indexmap::IndexMap;

use crate::dynamics::Record;
use crate::model::{Model, Scope};
pub use bind::candidates;
use block::Block;
pub use file::{Effect, Family, load, parse};

/// What is known about the campaign besides the model.
#[derive(Debug, Clone, Default)]
pub struct Context {
    /// Role to names of the model, where its names do not tell (`output(name)` for an output).
    pub roles: IndexMap<String, Vec<String>>,
    /// The outputs that are measured: no other has a sensor. Empty: all of them.
    pub measured: Vec<String>,
    /// Half the range of inputs and outputs in the data, by name, SI.
    pub sizes: BTreeMap<String, f64>,
    /// The middle of these ranges, by name.
    pub middles: BTreeMap<String, f64>,
}

impl Context {
    /// What the records of a campaign tell about the inputs and outputs of a model.
    pub fn of(model: &Model, records: &[&Record]) -> Context {
        let mut context = Context::default();
        for (i, input) in model.inputs.iter().enumerate() {
            let values = records.iter().flat_map(|r| r.inputs.iter().skip(i).step_by(model.inputs.len()));
            context.put(&input.name, values);
        }
        for (o, output) in model.outputs.iter().enumerate() {
            let channels = || records.iter().flat_map(|r| &r.channels).filter(|c| c.output == o);
            if channels().next().is_some() {
                context.measured.push(output.name.clone());
                // A state of the same name is measured by it; an input of that name is known already.
                if model.input(&output.name).is_none() {
                    context.put(&output.name, channels().flat_map(|c| &c.z));
                }
            }
        }
        context
    }

    fn put<'a>(&mut self, name: &str, values: impl Iterator<Item = &'a f64>) {
        let range = |(low, high): (f64, f64), &v: &f64| if v.is_finite() { (low.min(v), high.max(v)) } else { (low, high) };
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), range);
        if low <= high {
            self.sizes.insert(name.to_string(), (high - low) / 2.0);
            self.middles.insert(name.to_string(), (high + low) / 2.0);
        }
    }
}

/// All bindings of all effects, and what does not apply.
#[derive(Debug, Clone, Default)]
pub struct Offer {
    pub candidates: Vec<Candidate>,
    pub skipped: Vec<Skipped>,
}

/// An effect, or one binding of it, that is no candidate for this model.
#[derive(Debug, Clone, PartialEq)]
pub struct Skipped {
    /// Name of the effect, or of the candidate.
    pub effect: String,
    pub why: String,
}

/// One binding of an effect to a base model.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// `downwash-lag:eta`: the effect and what it is bound to.
    pub name: String,
    pub effect: String,
    /// The sentence that names it.
    pub sentence: String,
    pub signature: String,
    /// The maneuver that separates it from its rivals; empty where none is known.
    pub separate: String,
    pub family: Family,
    /// Names of effects that look alike.
    pub rivals: Vec<String>,
    /// The base model with the effect: same inputs and outputs, the parameters of the effect behind its own, sizes at null, shapes at
    /// their first start, none fixed.
    pub model: Model,
    /// The parameters of the effect, in the order of the model.
    pub added: Vec<Added>,
    block: Block,
}

/// A parameter that an effect adds.
#[derive(Debug, Clone, PartialEq)]
pub struct Added {
    pub name: String,
    pub unit: String,
    /// Of a size: where the candidate is the base model, whatever the shapes are. A shape (delay, threshold) has none.
    pub null: Option<f64>,
    /// Of a switch: the value at which it is held, and not estimated, once the effect is in the model.
    pub hold: Option<f64>,
    /// Of a shape: it is one of its starts, and not estimated.
    pub chosen: bool,
    /// Of a shape: the values tried. Several shapes go together: row i has start i of each (its last one where it has fewer).
    pub starts: Vec<f64>,
    pub min: f64,
    pub max: f64,
    /// How wide an interval its bounds and, for a shape counted from the middle of a signal, the range of that signal allow.
    pub span: f64,
    /// A step that is worth seeing.
    pub typical: f64,
    pub scope: Scope,
    pub check: Option<Check>,
}

/// A physical cross-check of an estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// Name of the constant.
    pub text: String,
    pub value: f64,
    /// Largest relative difference that agrees.
    pub within: f64,
}

impl Added {
    /// Whether it is not estimated once the effect is in the model.
    pub fn is_held(&self) -> bool {
        self.hold.is_some() || self.chosen
    }
}

impl Candidate {
    /// How many rows of starts the shapes have; 1 without shapes.
    pub fn rows(&self) -> usize {
        self.added.iter().map(|a| a.starts.len()).max().unwrap_or(0).max(1)
    }

    /// The added parameters at row `row` of the starts, sizes at null.
    pub fn start(&self, row: usize) -> Vec<f64> {
        let of_shape = |a: &Added| a.starts.get(row).or(a.starts.last()).copied().unwrap_or(0.0);
        self.added.iter().map(|a| a.null.unwrap_or_else(|| of_shape(a))).collect()
    }

    /// The text of the base model's own file with the effect behind it. `values`: by name, what the added parameters are (absent ones
    /// stay at their starts); switches are held, and `held`. `provenance`: lines for a comment above the effect.
    pub fn text(&self, base: &Model, values: &BTreeMap<String, f64>, held: &[&str], provenance: &str) -> String {
        let own = base.own_text();
        let gap = if own.ends_with('\n') { "\n" } else { "\n\n" };
        format!("{own}{gap}{}", self.block.text(&self.added, values, true, held, provenance))
    }
}
