//! How a diagnosis is run: the settings, every one with a default.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a diagnosis is run. Every field has a default.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Whether the base model's parameters are estimated from the flights, or predicted and held.
    pub base: Base,
    /// Ids of the maneuvers that are held out: never touched by estimation and screening, they decide. Without any: every `hold_every`-th
    /// maneuver of each input, in the order of flights and time, beginning with the last of the first `hold_every`.
    pub held_out: Vec<String>,
    /// Every how many-th maneuver of an input is held out (2 or more).
    pub hold_every: usize,
    /// Where there are fewer maneuvers than that, records are cut into blocks of at least this length, s (at most 48 of them): shorter than what
    /// is flown in them, so that those held out see a part of it.
    pub block_s: f64,
    /// Surrogate campaigns in which nothing is missing.
    pub surrogates: usize,
    /// Seed of the surrogates' random numbers.
    pub seed: u64,
    /// Share of the surrogate campaigns whose best candidate stays below what a real one must gain.
    pub quantile: f64,
    /// Candidates refitted in full, at most.
    pub refits: usize,
    /// Effects added one after the other, at most.
    pub effects: usize,
    /// A held-out maneuver decides where the effect predicts a gain in log-likelihood above this.
    pub decisive: f64,
    /// Candidates whose evidence (log-likelihood) comes this near to the best one's are not told from it. 4.6 is a ratio of 100: the
    /// wrong one of two leads by so much in at most 1 of 100 campaigns.
    pub apart: f64,
}

/// Whether the base model's parameters are estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Base {
    /// They are free: what they can imitate cannot be found, and the findings say which candidates that concerns.
    #[default]
    Estimated,
    /// They are held at the values of the model file (and `starts` of the method), for example those of a wind tunnel: errors of theirs
    /// are candidates too. What belongs to one maneuver (initial states, zero shifts) is free all the same.
    Predicted,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            base: Base::default(),
            held_out: Vec::new(),
            hold_every: 3,
            block_s: 5.0,
            surrogates: 500,
            seed: 1,
            quantile: 0.99,
            refits: 6,
            effects: 4,
            decisive: 3.0,
            apart: 4.6,
        }
    }
}
