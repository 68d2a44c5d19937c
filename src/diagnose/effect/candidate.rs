//! One binding of an effect to a base model in; the model with it, where its parameters start, and
//! its text, out.

use std::collections::BTreeMap;

use super::added::Added;
use super::block::Block;
use super::file::Family;
use crate::error::Errors;
use crate::model::Model;

/// Between an effect's name and what it is bound to.
pub const OF: char = ':';

/// The effect of which a candidate of this name is a binding.
pub fn effect_of(name: &str) -> &str {
    name.split(OF).next().unwrap_or_default()
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
    /// The model has what the effect speaks of, and cannot be had with it: a mistake of its file.
    pub wrong: bool,
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
    /// It takes noise out of a record.
    pub noise: bool,
    /// A term of a series.
    pub series: bool,
    /// The cause that it is a form of.
    pub form: Option<String>,
    /// The base model with the effect: same inputs and outputs, the parameters of the effect behind
    /// its own, sizes at null, shapes at their first start, none fixed.
    pub model: Model,
    /// The parameters of the effect, in the order of the model.
    pub added: Vec<Added>,
    pub(super) block: Block,
}

impl Candidate {
    /// Whether it is another form of the same cause, of the same thing: only one of them can be true.
    pub fn is_form_of(&self, other: &Candidate) -> bool {
        let thing = |c: &Candidate| c.name.split_once(OF).map(|(_, bound)| bound.to_string());
        self.form.is_some() && self.form == other.form && thing(self) == thing(other)
    }

    /// How many rows of starts the shapes have, or of steps the sizes; 1 without both.
    pub fn rows(&self) -> usize {
        self.added.iter().map(|a| a.starts.len().max(a.steps.len())).max().unwrap_or(0).max(1)
    }

    /// The added parameters at row `row` of the starts, sizes at null.
    pub fn start(&self, row: usize) -> Vec<f64> {
        let of_shape = |a: &Added| a.starts.get(row).or(a.starts.last()).copied().unwrap_or(0.0);
        self.added.iter().map(|a| a.null.unwrap_or_else(|| of_shape(a))).collect()
    }

    /// The same with size `size` at null where its scope's column has this value, `base` being the model
    /// that it was bound to.
    ///
    /// # Errors
    /// The model is none: it was one before.
    pub fn held_in(&self, base: &Model, size: usize, value: &str) -> Result<Candidate, Errors> {
        let mut held = self.clone();
        held.added[size].held_in = Some(value.to_string());
        let text = held.block.text(&held.added, &BTreeMap::new(), false, &[], "");
        held.model = base.amended(&format!("\n{text}"))?;
        Ok(held)
    }

    /// Names that it declares besides constants, which several may share.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.block.names().chain(self.added.iter().map(|a| a.name.as_str()))
    }

    /// The base model with this effect and others, sizes at null.
    ///
    /// # Errors
    /// Names that two of them declare; effects that read one another in a circle.
    pub fn with(&self, others: &[&Candidate]) -> Result<Model, Errors> {
        let mut constants = self.block.constants.clone();
        let mut text = String::new();
        for other in others {
            let mut block = other.block.clone();
            block.constants.retain(|constant| !constants.contains(constant));
            constants.extend(block.constants.iter().cloned());
            let nulls = block.text(&other.added, &BTreeMap::new(), false, &[], "");
            text += &format!("\n{nulls}");
        }
        self.model.amended(&text)
    }

    /// The text of the base model's own file with the effect behind it. `values`: by name, what the
    /// added parameters are (absent ones stay at their starts); switches are held, and `held`.
    /// `provenance`: lines for a comment above the effect.
    pub fn text(
        &self,
        base: &Model,
        values: &BTreeMap<String, f64>,
        held: &[&str],
        provenance: &str,
    ) -> String {
        let own = base.own_text();
        let gap = if own.ends_with('\n') { "\n" } else { "\n\n" };
        format!("{own}{gap}{}", self.block.text(&self.added, values, true, held, provenance))
    }
}
