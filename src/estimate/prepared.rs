//! A model, segments and settings in; the model as it would be estimated, over the segments that
//! can be used, out: for those who evaluate it themselves.

use super::case::{Case, plan};
use super::choice::{Chosen, choose};
use super::extend::prepare;
use super::output_error::{starts, unusable};
use super::segment::Segment;
use super::{LeftOut, Settings};
use crate::dynamics::Plan;
use crate::error::Errors;
use crate::model::Model;

/// A model with its shifts and feedback, what is free in it, and the segments that feed it.
#[derive(Debug, Clone)]
pub struct Prepared {
    pub model: Model,
    /// All segments, used or not.
    pub segments: Vec<Segment>,
    /// Indices of the segments that can be used, ascending.
    pub used: Vec<usize>,
    /// The others, and why they cannot.
    pub left_out: Vec<LeftOut>,
    chosen: Chosen,
    plan: Plan,
    given: Vec<Vec<f64>>,
    settings: Settings,
}

impl Prepared {
    /// Reads the settings against model and segments.
    ///
    /// # Errors
    /// As `estimate_segments`.
    pub fn new(
        model: &Model,
        segments: &[Segment],
        settings: &Settings,
    ) -> Result<Prepared, Errors> {
        let (model, segments) = prepare(model, segments, settings)?;
        let (model, segments) = (model.into_owned(), segments.into_owned());
        let chosen = choose(&model, &segments, settings)?;
        let plan = plan(&model, &chosen, &segments)?;
        let given = starts(&model, &plan, &segments, &chosen, settings)?;
        let why: Vec<Option<String>> = (0..segments.len())
            .map(|s| unusable(&model, &chosen, &segments[s], &given[s]))
            .collect();
        let used: Vec<usize> = (0..segments.len()).filter(|&s| why[s].is_none()).collect();
        let left_out = why
            .into_iter()
            .enumerate()
            .filter_map(|(segment, why)| Some(LeftOut { segment, why: why? }))
            .collect();
        let given = used.iter().filter_map(|&s| given[s].as_ref().ok().cloned()).collect();
        Ok(Prepared {
            model,
            segments,
            used,
            left_out,
            chosen,
            plan,
            given,
            settings: settings.clone(),
        })
    }

    /// The problem over the segments used, in their order.
    pub fn case(&self) -> Case<'_> {
        let these: Vec<&Segment> = self.used.iter().map(|&s| &self.segments[s]).collect();
        Case::new(&self.model, &self.chosen, &self.plan, &these, self.given.clone(), &self.settings)
    }

    /// States whose start value is free in every segment.
    pub fn initial(&self) -> &[usize] {
        &self.chosen.initial
    }
}
