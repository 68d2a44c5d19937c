//! A model, maneuvers and which of them are held out, in; the same as one thing to be diagnosed,
//! and why it cannot be, out.

use super::effect;
use super::settings::Settings;
use crate::estimate::{self, Prepared, Segment};
use crate::model::Model;

/// What is diagnosed.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// The base model, as its file says it (without the shifts that `method` asks for).
    pub model: &'a Model,
    pub segments: &'a [Segment],
    /// Which of them are held out.
    pub held_out: &'a [bool],
    /// How the base is estimated.
    pub method: &'a estimate::Settings,
    /// Who plays which role in the model.
    pub context: &'a effect::Context,
    pub settings: &'a Settings,
}

/// Which segments train and which are held out, by place among those that a model can use.
#[derive(Debug, Clone, PartialEq)]
pub struct Places {
    pub training: Vec<usize>,
    pub held_out: Vec<usize>,
}

impl Places {
    pub fn of(prepared: &Prepared, held_out: &[bool]) -> Places {
        let (held_out, training) =
            (0..prepared.used.len()).partition(|&at| held_out[prepared.used[at]]);
        Places { training, held_out }
    }
}

/// Why a diagnosis could not be carried through.
#[derive(Debug, Clone, PartialEq)]
pub enum Trouble {
    /// The base does not run or cannot be fitted; why.
    Base(String),
    /// There are no maneuvers to hold out, or none to train on.
    Segments(String),
}
