//! The checked configuration of a campaign: what the stages run on. The pipeline makes it from the
//! files a person wrote.

use super::{Stage, Told, derive, diagnose, estimate, fit, reconstruct, segment};
use crate::config::Doc;
use crate::log::ChannelMap;
use crate::units::Unit;
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

/// The channel map and where its entries stand.
#[derive(Debug, Clone)]
pub struct Channels {
    pub map: ChannelMap,
    pub doc: Doc,
}

impl Channels {
    /// SI unit of a signal's values: empty where there is no such signal.
    pub fn unit(&self, signal: &str) -> String {
        self.map.signal.get(signal).map(|s| si(&s.unit)).unwrap_or_default()
    }

    /// Whether two names are one measurement: the same signal, or signals of the same field of the
    /// log.
    pub fn same(&self, a: &str, b: &str) -> bool {
        let source = |name: &str| self.map.signal.get(name).map(|s| (&s.topic, &s.field));
        a == b || source(a).is_some_and(|of_a| source(b) == Some(of_a))
    }

    /// What a signal is, in the words of the channel map.
    pub fn doc(&self, signal: &str) -> &str {
        self.map.signal.get(signal).map_or("", |s| &s.doc)
    }
}

/// The SI unit that values of `unit` are converted to, as text: `deg/s` becomes `rad/s`, `kt`
/// becomes `m/s`.
fn si(unit: &str) -> String {
    let is_si = |text: &str| Unit::parse(text).is_ok_and(|u| u.is_si());
    // The dimension alone would lose the radian.
    let radians = ["degrees", "degree", "°", "deg", "radians", "radian"]
        .iter()
        .fold(unit.to_string(), |text, word| text.replace(word, "rad"));
    match Unit::parse(unit) {
        _ if is_si(&radians) => radians,
        _ if is_si(unit) => unit.to_string(),
        Ok(parsed) => {
            let named = ["Pa", "N", "W", "V"]
                .into_iter()
                .find(|name| Unit::parse(name).is_ok_and(|u| u.dim == parsed.dim));
            named.map_or_else(|| parsed.dim.to_string(), str::to_string)
        }
        Err(_) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_logs_become_si() {
        for (unit, expected) in [
            ("deg", "rad"),
            ("deg/s", "rad/s"),
            ("kt", "m/s"),
            ("m/s^2", "m/s^2"),
            ("degC", "K"),
            ("degrees/s", "rad/s"),
            ("knots", "m/s"),
            ("hPa", "Pa"),
            ("lbf", "N"),
            ("mV", "V"),
            ("ft lbf", "kg m^2/s^2"),
        ] {
            assert_eq!(si(unit), expected);
        }
    }
}
