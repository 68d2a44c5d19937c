//! How a diagnosis is run: the settings, every one with a default.

use super::thresholds::{Thresholds, defaults};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a diagnosis is run. Every field has a default.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Whether the base model's parameters are estimated from the flights, or predicted and held.
    pub base: Base,
    /// Ids of the maneuvers that are held out, or of flights of which all are: never touched by estimation
    /// and screening, they decide. Without any: every `hold_every`-th maneuver of each input, in the order of flights
    /// and time, beginning with the last of the first `hold_every`.
    pub held_out: Vec<String>,
    /// Every how many-th maneuver of an input is held out (2 or more).
    pub hold_every: usize,
    /// Where there are fewer maneuvers than that, records are cut into blocks of at least this
    /// length, s (at most 48 of them): shorter than what is flown in them, so that those held out
    /// see a part of it.
    pub block_s: f64,
    /// Surrogate campaigns in which nothing is missing; at most 100000.
    #[schemars(range(max = 100000))]
    pub surrogates: usize,
    /// Seed of the surrogates' random numbers.
    pub seed: u64,
    /// Share of the surrogate campaigns whose best candidate stays below what a real one must gain.
    pub quantile: f64,
    /// Candidates refitted in full, at most (at most 10000).
    #[schemars(range(max = 10000))]
    pub refits: usize,
    /// Effects added one after the other, at most (at most 100).
    #[schemars(range(max = 100))]
    pub effects: usize,
    /// A held-out maneuver decides where the effect predicts a gain in log-likelihood above this.
    pub decisive: f64,
    /// Candidates whose evidence (log-likelihood) comes this near to the best one's are not
    /// distinguishable from it. 4.6 is a ratio of 100: the wrong one of two leads by so much in at
    /// most 1 of 100 campaigns. Where both leave more than noise, it is taken as many times more.
    pub apart: f64,
    /// The numbers behind the rules: not for users, and in no file.
    #[serde(skip)]
    pub thresholds: Thresholds,
    /// Votes by fits that go to their end instead of one step: for the test that both choose alike.
    #[serde(skip)]
    pub whole_votes: bool,
}

/// Whether the base model's parameters are estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Base {
    /// They are free: what they can imitate cannot be found, and the findings say which candidates
    /// that concerns.
    #[default]
    Estimated,
    /// They are held at the values of the model file (and `starts` of the method), for example
    /// those of a wind tunnel: errors of theirs are candidates too. What belongs to one maneuver
    /// (initial states, zero shifts) is free all the same.
    Predicted,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            base: Base::default(),
            held_out: Vec::new(),
            hold_every: defaults::HOLD_EVERY,
            block_s: defaults::BLOCK_S,
            surrogates: defaults::SURROGATES,
            seed: defaults::SEED,
            quantile: defaults::QUANTILE,
            refits: defaults::REFITS,
            effects: defaults::EFFECTS,
            decisive: defaults::DECISIVE,
            apart: defaults::APART,
            thresholds: Thresholds::default(),
            whole_votes: false,
        }
    }
}

impl Settings {
    /// Settings that make no sense: name, and what is wanted and what is there.
    pub fn faults(&self) -> Vec<(&'static str, String)> {
        let mut all = Vec::new();
        let mut ask = |fits: bool, name: &'static str, what: String| {
            if !fits {
                all.push((name, what));
            }
        };
        let (q, n) = (self.quantile, self.surrogates);
        ask(q > 0.0 && q < 1.0, "quantile", format!("a quantile is between 0 and 1, not {q}"));
        ask(
            self.hold_every >= 2,
            "hold_every",
            format!("every second maneuver at most is held out, not every {}", self.hold_every),
        );
        let block = self.block_s;
        ask(
            block > 0.0 && block.is_finite(),
            "block_s",
            format!("blocks have a positive length in seconds, not {block}"),
        );
        // Fewer have no such quantile.
        let enough = !(q < 1.0) || n as f64 * (1.0 - q) >= 1.0;
        ask(
            enough,
            "surrogates",
            format!("{n} campaigns do not tell what one in {:.0} gains by chance", 1.0 / (1.0 - q)),
        );
        ask(self.refits >= 1, "refits", "without a refit nothing can be named: at least 1".into());
        ask(
            self.effects >= 1,
            "effects",
            "without an effect nothing can be named: at least 1".into(),
        );
        for (name, gain) in [("decisive", self.decisive), ("apart", self.apart)] {
            ask(
                gain >= 0.0 && gain.is_finite(),
                name,
                format!("a gain in log-likelihood is not negative, but this is {gain}"),
            );
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_settings_without_sense_are_all_told() {
        assert!(Settings::default().faults().is_empty());
        let wrong = Settings {
            hold_every: 0,
            block_s: -2.5,
            surrogates: 50,
            refits: 0,
            effects: 0,
            decisive: f64::NAN,
            apart: -1.0,
            ..Settings::default()
        };
        let names: Vec<&str> = wrong.faults().iter().map(|f| f.0).collect();
        assert_eq!(
            names,
            ["hold_every", "block_s", "surrogates", "refits", "effects", "decisive", "apart"]
        );
        assert_eq!(Settings { quantile: 1.0, ..Settings::default() }.faults().len(), 1);
    }
}
