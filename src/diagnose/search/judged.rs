//! Everything that is known of a candidate in; the rows of a round, with the standing that each
//! ended with, out.

use super::refit::Refit;
use super::tried::Screened;
use crate::diagnose::effect;

/// What became of a candidate in a round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// The base's free parameters imitate it: no candidate, or one that says next to nothing more.
    Collinear,
    /// Nothing in these flights moves it.
    Silent,
    /// Its gain is what chance gives.
    Chance,
    /// Above chance, but not among the few that were refitted.
    NotRefitted,
    /// Its full fit did not end.
    FitFailed,
    /// A parameter sits on a physical bound, or disagrees with what physics expects.
    Bounds,
    /// The flights do not determine its parameters.
    Unidentifiable,
    /// Held-out maneuvers contradict it.
    HeldOut,
    /// Held-out maneuvers cannot tell: it predicts next to nothing there.
    Untold,
    /// Its size differs from maneuver to maneuver by more than its uncertainty.
    Inconsistent,
    /// It grows with the noise of the inputs, which may be all it is.
    ByNoise,
    /// It passes, but with little more evidence than chance gives where the noise is what it is
    /// taken for.
    Faint,
    /// It passes, another one is better by more than chance.
    Beaten,
    /// It passes, and is not distinguishable from the one chosen.
    Alike,
    /// It passes, and is added.
    Chosen,
}

impl Standing {
    /// Whether it explains something, and may not be named all the same.
    pub fn is_doubt(self) -> bool {
        matches!(
            self,
            Standing::HeldOut
                | Standing::Inconsistent
                | Standing::Unidentifiable
                | Standing::ByNoise
        )
    }

    /// The stable text that tables carry.
    pub fn as_str(self) -> &'static str {
        match self {
            Standing::Collinear => "collinear with the base",
            Standing::Silent => "not excited",
            Standing::Chance => "within chance",
            Standing::NotRefitted => "not refitted",
            Standing::FitFailed => "fit failed",
            Standing::Bounds => "against physics",
            Standing::Unidentifiable => "not identifiable",
            Standing::HeldOut => "fails held out",
            Standing::Untold => "nothing predicted held out",
            Standing::Inconsistent => "inconsistent",
            Standing::ByNoise => "by noise of inputs",
            Standing::Faint => "faint",
            Standing::Beaten => "beaten",
            Standing::Alike => "alike",
            Standing::Chosen => "chosen",
        }
    }
}

/// One candidate in one round.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    pub name: String,
    pub effect: String,
    pub family: effect::Family,
    /// It takes noise out of a record.
    pub noise: bool,
    /// A term of a series, which names no cause.
    pub series: bool,
    pub sentence: String,
    pub signature: String,
    /// The maneuver that would distinguish it from its rivals, in words.
    pub separate: String,
    pub screened: Screened,
    /// Gain of the screening less what chance gives it alone: what is compared with the round's
    /// limit.
    pub score: f64,
    pub refit: Option<Refit>,
    /// Log-likelihood for it, training and held out, less what chance gives it alone; NaN without a
    /// refit.
    pub evidence: f64,
    /// The share of what the round's tested effect explains that this one explains as well, where that
    /// one may not be believed and this one may.
    pub instead: Option<f64>,
    /// It explains what the best one of its round explains.
    pub replaces: bool,
    pub standing: Standing,
    /// The standing in words, with its figures.
    pub why: String,
}

impl Judged {
    /// Whether it takes noise out of a record, or is what such noise makes.
    pub fn is_of_record(&self) -> bool {
        self.noise || self.standing == Standing::ByNoise
    }
}

/// One round: a base fit and all candidates held against it.
#[derive(Debug, Clone, PartialEq)]
pub struct Round {
    /// What the best candidate's score must exceed.
    pub limit: f64,
    pub judged: Vec<Judged>,
    /// Those that pass alike, best evidence first; the first one is added.
    pub class: Vec<usize>,
    /// Candidates that this round's base has already.
    pub base: Vec<String>,
    /// It tests one effect with all others in place; otherwise it looks for the next.
    pub strict: bool,
}
