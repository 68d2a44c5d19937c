//! What an effect file says of a parameter in; the parameter that a candidate adds out.

use crate::model::Scope;

/// A parameter that an effect adds.
#[derive(Debug, Clone, PartialEq)]
pub struct Added {
    pub name: String,
    pub unit: String,
    /// Of a size: where the candidate is the base model, whatever the shapes are. A shape (delay,
    /// threshold) has none.
    pub null: Option<f64>,
    /// Of a switch: the value at which it is held, and not estimated, once the effect is in the
    /// model.
    pub hold: Option<f64>,
    /// Of a size: the values at which it is tried, row by row like starts; empty where the
    /// derivative at null tells.
    pub steps: Vec<f64>,
    /// Of a shape: it is one of its starts, and not estimated.
    pub chosen: bool,
    /// Of a shape: the values tried. Several shapes go together: row i has start i of each (its
    /// last one where it has fewer).
    pub starts: Vec<f64>,
    pub min: f64,
    pub max: f64,
    /// How wide an interval its bounds and, for a shape counted from the middle of a signal, the
    /// range of that signal allow.
    pub span: f64,
    /// A step that is worth seeing.
    pub typical: f64,
    pub scope: Scope,
    /// The value of the scope's column in which it stays at null, and from which the others differ; none
    /// where nothing in the base moves all of them at once.
    pub held_in: Option<String>,
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
    /// Of a size: the value at which row `row` of the starts tries it.
    pub fn step(&self, row: usize) -> Option<f64> {
        self.steps.get(row).or(self.steps.last()).copied()
    }

    /// Whether it is not estimated once the effect is in the model.
    pub fn is_held(&self) -> bool {
        self.hold.is_some() || self.chosen
    }
}
