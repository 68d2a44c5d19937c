//! A model, segments and settings in; the model as it would be estimated, over the segments that
//! can be used, out: for those who evaluate it themselves.

use super::case::{Case, Narrow, PASSES, propagator};
use super::choice::{Chosen, choose};
use super::extend::prepare;
use super::segment::Segment;
use super::usable::{starts, unusable};
use super::{LeftOut, Settings};
use crate::dynamics::Propagator;
use crate::error::Errors;
use crate::model::Model;
use std::sync::Arc;

/// A model with its shifts and feedback, what is free in it, and the segments that feed it.
#[derive(Debug, Clone)]
pub struct Prepared {
    pub model: Arc<Model>,
    /// All segments, used or not.
    pub segments: Vec<Segment>,
    /// Indices of the segments that can be used, ascending.
    pub used: Vec<usize>,
    /// The others, and why they cannot.
    pub left_out: Vec<LeftOut>,
    chosen: Arc<Chosen>,
    propagator: Arc<Propagator>,
    narrow: Narrow,
    /// Of all segments.
    given: Vec<Result<Vec<f64>, String>>,
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
        let propagator = propagator(&model, &chosen, &segments)?;
        let given = starts(&model, &propagator, &segments, &chosen, settings)?;
        let why: Vec<Option<String>> = (0..segments.len())
            .map(|s| unusable(&model, &chosen, &segments[s], &given[s]))
            .collect();
        let used: Vec<usize> = (0..segments.len()).filter(|&s| why[s].is_none()).collect();
        let left_out = why
            .into_iter()
            .enumerate()
            .filter_map(|(segment, why)| Some(LeftOut { segment, why: why? }))
            .collect();
        Ok(Prepared {
            model: Arc::new(model),
            segments,
            used,
            left_out,
            chosen: Arc::new(chosen),
            propagator: Arc::new(propagator),
            narrow: Narrow::default(),
            given,
            settings: settings.clone(),
        })
    }

    /// The problem over the segments used, in their order.
    pub fn case(&self) -> Case {
        self.case_of(&self.used)
    }

    /// The problem over these segments (indices), which have to be usable.
    pub fn case_of(&self, used: &[usize]) -> Case {
        let these: Vec<&Segment> = used.iter().map(|&s| &self.segments[s]).collect();
        let given = used.iter().filter_map(|&s| self.given[s].as_ref().ok().cloned()).collect();
        let (model, chosen, propagator) =
            (self.model.clone(), self.chosen.clone(), self.propagator.clone());
        let mut case = Case::new(model, chosen, propagator, &these, given, &self.settings);
        case.narrow = self.narrow.clone();
        case
    }

    /// Whether a segment (index) has start values for all states that need one from outside.
    pub fn has_starts(&self, s: usize) -> bool {
        self.given.get(s).is_some_and(Result::is_ok)
    }

    /// With machine code where the settings say so.
    pub fn compiled(mut self) -> Prepared {
        let points = self.segments.iter().map(|s| s.record.n).sum();
        Arc::make_mut(&mut self.propagator).compile(self.settings.tier, PASSES, points);
        self
    }
}
