//! The checked configuration of a campaign: what the stages run on. The pipeline makes it from the
//! files a person wrote.

use super::channels::Channels;
use super::{Stage, Told, derive, diagnose, estimate, fit, reconstruct, segment};
use std::collections::BTreeMap;

/// The checked configuration of a campaign: names resolved, models compiled, units agreed.
#[derive(Debug)]
pub struct Campaign {
    pub title: String,
    /// Flight ids in alphabetical order.
    pub flights: Vec<String>,
    pub channels: Channels,
    pub reconstruct: Option<reconstruct::Config>,
    pub derive: derive::Config,
    pub segment: Option<segment::Config>,
    pub estimates: Vec<estimate::Config>,
    pub fits: Vec<fit::Config>,
    pub diagnoses: Vec<diagnose::Config>,
    /// What the pipeline file says under the names of stages.
    pub told: Told,
    /// The stages that are run, in this order: [`super::STAGES`].
    pub stages: &'static [Stage],
}

// What these give belongs into the slice of the stage that asks: a stage's code does not count what
// another stage's settings are made of.
impl Campaign {
    /// Columns of the samples table that drive each model, by the model's name in the tables.
    pub fn inputs_of_models(&self) -> BTreeMap<String, Vec<String>> {
        let again = self
            .diagnoses
            .iter()
            .filter_map(|d| Some((d.settings.next(), self.estimates.get(d.estimate)?)));
        self.estimates
            .iter()
            .map(|e| (e.name(), e))
            .chain(again)
            .map(|(name, e)| (name, e.columns()))
            .collect()
    }

    /// The signal in which each input of the segments is searched.
    pub fn searched(&self) -> BTreeMap<String, String> {
        let inputs = self.segment.iter().flat_map(|s| &s.settings.input);
        inputs.map(|i| (i.name().to_string(), i.signal.clone())).collect()
    }
}
