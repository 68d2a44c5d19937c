//! An input channel in, the multistep maneuvers flown on it out (3211, 2211, 211, doublet, step), with hand edits applied.
//!
//! A maneuver is a sequence of levels on alternating sides of the local trim, reached by quick changes, with quiet before it.
//! Nothing but the signal itself is used: no labels, no unit time, no polarity. Working principle: wherever the signal leaves
//! the spread of the second before (`scan`), the following alternating excursions are collected, their edges and levels measured
//! (`measure`) and their pattern of durations named and scored (`kind`); of overlapping candidates the best stays.

mod edits;
mod kind;
mod measure;
mod scan;

pub use edits::{Edits, Exclude, Include, Move, Source, apply};
pub use kind::Kind;

/// How maneuvers are found. The defaults suit unit times of 0.25 s to some seconds.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Shortest step, s.
    pub min_step_s: f64,
    /// Longest step, s; a level held longer is a new trim, not a step.
    pub max_step_s: f64,
    /// Length of the quiet windows before and after a maneuver, s.
    pub quiet_s: f64,
    /// A maneuver begins where the signal leaves its quiet level by this many MAD standard deviations of the quiet window.
    pub threshold: f64,
    /// Smallest amplitude of a maneuver, in the channel's SI unit.
    pub min_amplitude: f64,
    /// Smallest amplitude of a maneuver as a share of the median amplitude of the record's maneuvers of two or more steps
    /// (of the largest step where there are none).
    pub relative_amplitude: f64,
    /// Most steps in one maneuver; more is an oscillation or a sweep.
    pub max_steps: usize,
    /// Largest rms deviation of the step durations from a pattern, in unit times, that still has the pattern's name.
    pub timing_tolerance: f64,
    /// Least score, 0 to 1.
    pub min_score: f64,
    /// A gap between samples longer than this splits the record, s.
    pub max_gap_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            min_step_s: 0.2,
            max_step_s: 20.0,
            quiet_s: 1.0,
            threshold: 5.0,
            min_amplitude: 0.0,
            relative_amplitude: 0.25,
            max_steps: 8,
            timing_tolerance: 0.3,
            min_score: 0.4,
            max_gap_s: 0.5,
        }
    }
}

/// One level of a maneuver. Times are those where the signal is half way between neighbouring levels, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    pub start: f64,
    pub end: f64,
    /// Deviation from the local trim, in the channel's SI unit.
    pub level: f64,
}

/// A maneuver found on an input channel, or included by hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Maneuver {
    pub kind: Kind,
    /// Half-way time of the first edge, s.
    pub t_start: f64,
    /// Half-way time of the last edge, s.
    pub t_end: f64,
    /// When the signal leaves the trim, s: at or before `t_start`.
    pub onset: f64,
    /// Duration of the pattern's unit, s, by least squares over the steps; of a multistep the shortest step.
    pub unit_time: f64,
    /// Mean absolute deviation of the levels from trim, in the channel's SI unit.
    pub amplitude: f64,
    /// +1 or -1: the sign of the first step.
    pub polarity: f64,
    /// Level of the signal in the quiet window before the maneuver, in the channel's SI unit.
    pub trim: f64,
    pub steps: Vec<Step>,
    /// 0 to 1: regular timing, consistent levels, sharp edges, small noise, quiet before and after. 0 for an interval given by
    /// hand, which nothing was found out about.
    pub score: f64,
    /// False for a maneuver excluded by hand.
    pub included: bool,
    /// The reason of the hand edit; empty without one.
    pub reason: String,
}

impl Maneuver {
    /// The window of `length_s` seconds before the signal leaves trim, for trim conditions: `(from, to)` in s.
    pub fn pre_window(&self, length_s: f64) -> (f64, f64) {
        (self.onset - length_s, self.onset)
    }
}

/// The maneuvers in the samples `u` (SI) at ascending times `t` (s; equal lengths), in order of time and not overlapping.
///
/// NaN samples are skipped; times that do not ascend are skipped as well.
pub fn find(t: &[f64], u: &[f64], settings: &Settings) -> Vec<Maneuver> {
    let pieces = scan::Work::pieces(t, u, settings);
    let mut candidates: Vec<Maneuver> = pieces.iter().flat_map(|work| candidates(work, settings)).collect();
    candidates.retain(|m| m.score >= settings.min_score && m.amplitude >= settings.min_amplitude);
    let kept = best_without_overlap(candidates);
    let several: Vec<f64> = kept.iter().filter(|m| m.steps.len() > 1).map(|m| m.amplitude).collect();
    let largest = kept.iter().map(|m| m.amplitude).fold(0.0, f64::max);
    let typical = if several.is_empty() { largest } else { crate::math::median(&several) };
    let least = settings.relative_amplitude * typical;
    kept.into_iter().filter(|m| m.amplitude >= least).collect()
}

/// All that might be a maneuver in one piece; candidates may overlap.
fn candidates(work: &scan::Work, settings: &Settings) -> Vec<Maneuver> {
    let mut candidates: Vec<Maneuver> = vec![];
    for sequence in scan::sequences(work, settings) {
        let whole = measure::maneuver(work, &sequence, settings);
        // A recovery input right behind (or a twitch before) a maneuver hides its pattern: look at the parts, too.
        if whole.as_ref().is_none_or(|m| m.kind == Kind::Multistep) {
            for first in 0..sequence.len() {
                for last in first + 1..=sequence.len() {
                    candidates.extend(measure::maneuver(work, &sequence[first..last], settings));
                }
            }
        }
        candidates.extend(whole);
    }
    candidates
}

/// Of overlapping candidates the one that explains most; more steps weigh more, since chance seldom makes them.
fn best_without_overlap(mut candidates: Vec<Maneuver>) -> Vec<Maneuver> {
    let rank = |m: &Maneuver| m.score * m.steps.len() as f64 * if m.kind == Kind::Multistep { 0.7 } else { 1.0 };
    candidates.sort_by(|a, b| rank(b).total_cmp(&rank(a)).then(a.t_start.total_cmp(&b.t_start)));
    let mut kept: Vec<Maneuver> = vec![];
    for m in candidates {
        if kept.iter().all(|k| m.t_end <= k.onset || m.onset >= k.t_end) {
            kept.push(m);
        }
    }
    kept.sort_by(|a, b| a.t_start.total_cmp(&b.t_start));
    kept
}

#[cfg(test)]
mod tests;
