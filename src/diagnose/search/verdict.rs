//! The rounds of a search in; the verdict and what it rests on, out.

use super::judged::{Judged, Round};
use super::stability::Stability;
use super::turbulence::Turbulence;
use super::unseen::Missed;
use crate::diagnose::effect;
use crate::diagnose::gap::comparison::Comparison;
use crate::diagnose::gap::left::Left;
use crate::diagnose::gap::varying::Varying;
use crate::diagnose::residual::located::Located;
use crate::diagnose::subject::Trouble;
use crate::estimate::LeftOut;

/// An effect that is missing: the round that tested it, and its place there.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    pub round: usize,
    /// The candidate that was added.
    pub added: usize,
    /// Places in the round of all that explain the flights as well, that one included.
    pub class: Vec<usize>,
    /// How often it is chosen when other maneuvers train and others are held out.
    pub stability: Stability,
}

/// What is known in the end.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Every effect added stands alone; what is left is noise, or little against what was explained
    /// (`Diagnosis::complete`).
    Named,
    /// The same, but at least one is not distinguishable from others.
    OneOfThese,
    /// Outputs respond to inputs, or are left with more than noise, and no candidate explains it, or
    /// not all of it.
    Located,
    NothingMissing,
    /// The same but for small movements that records of inputs show and that did not happen: the
    /// model lacks nothing.
    ButRecords,
    /// The sensors' noise and turbulence, which the model does not have, account for what is left.
    ButTurbulence,
    /// No verdict.
    None(Trouble),
}

impl Verdict {
    /// The stable text that tables carry.
    pub fn as_str(&self) -> &'static str {
        match self {
            Verdict::Named => "named",
            Verdict::OneOfThese => "one of these",
            Verdict::Located => "located but unexplained",
            Verdict::NothingMissing => "nothing missing",
            Verdict::ButRecords => "nothing missing but noise of records",
            Verdict::ButTurbulence => "nothing missing but turbulence",
            Verdict::None(_) => "no verdict",
        }
    }
}

/// The result.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    pub verdict: Verdict,
    /// Nothing is left that responds to an input.
    pub complete: bool,
    pub rounds: Vec<Round>,
    /// One per effect named.
    pub findings: Vec<Finding>,
    /// Candidates that are in the model and explain most of something, but are contradicted, and
    /// why.
    pub doubts: Vec<(String, String)>,
    /// Candidates that gain more than chance beside everything that was named, and whose full fit did not
    /// end; in words.
    pub unsettled: Vec<String>,
    /// Alternatives to what was found that gain a little more beside it, in words.
    pub beside: Vec<String>,
    /// Those among the doubts that other choices of the maneuvers do not choose, with the votes.
    pub unstable: Vec<(String, Stability)>,
    /// What was added, in order: the candidates as they stand in the model.
    pub added: Vec<effect::Candidate>,
    /// Values of the added parameters in the last fit, with everything free.
    pub values: Vec<(String, f64)>,
    /// Whether an output responds to a source, of every pair: before anything is added, and in the end. Of what
    /// is nothing but noise of records both are of the model without it.
    pub before: Vec<Located>,
    pub after: Vec<Located>,
    /// Parameters of the base that differ from maneuver to maneuver, in the end.
    pub varying: Vec<Varying>,
    /// What speaks against the model with everything that was named, as a whole.
    pub unphysical: Vec<String>,
    /// Derivatives that turned their signs with everything that was named, in words.
    pub turned: Vec<String>,
    /// Held-out maneuvers that show more than the training ones do, in the end.
    pub missed: Vec<Missed>,
    /// Maneuvers that the model cannot use, by index among the segments, and why.
    pub left_out: Vec<LeftOut>,
    /// Outputs whose noise, as the base leaves it, could not be modelled as far as it asks for, and
    /// to which order it is; none where nothing was left to model, and the output takes no part.
    pub unsure_noise: Vec<(String, Option<usize>)>,
    /// Effects of the library that could not be attached to this model, and why.
    pub skipped: Vec<(String, String)>,
    pub comparison: Comparison,
    /// What the model leaves of each output in the end.
    pub left: Vec<Left>,
    /// The base driven by noise; none where it was not asked for.
    pub turbulence: Option<Turbulence>,
}

impl Diagnosis {
    /// Outputs that still respond to a source in the end.
    pub fn located(&self) -> impl Iterator<Item = &Located> {
        self.after.iter().filter(|l| l.is_real())
    }

    /// Whether effects are named: what is only located makes no model.
    pub fn is_named(&self) -> bool {
        let nothing = matches!(self.verdict, Verdict::Located | Verdict::None(_));
        !self.findings.is_empty() && !nothing
    }

    /// Whether a candidate of this name takes small movements out of the record of an input, or is what they
    /// make, as the last round has it that fitted it.
    pub fn is_of_record(&self, name: &str) -> bool {
        let fitted = |j: &&Judged| j.name == name && j.refit.is_some();
        let last = self.rounds.iter().rev().find_map(|round| round.judged.iter().find(fitted));
        last.is_some_and(Judged::is_of_record)
    }
}
