//! An input channel in, the multistep maneuvers flown on it out (3211, 2211, 211, doublet, step) and
//! the sweeps, with hand edits applied.
//!
//! A maneuver is a sequence of levels on alternating sides of the local trim, reached by quick
//! changes, with quiet before it. Nothing but the signal itself is used: no labels, no unit time,
//! no polarity. Working principle: wherever the signal leaves the spread of the second before
//! (`scan`), the following alternating excursions are collected, their edges and levels measured
//! (`measure`) and their pattern of durations named and scored (`kind`); of overlapping candidates
//! the best stays. Sweeps are sought by their turning points (`sweep`) where they are asked for.

mod by_hand;
mod cells;
mod edits;
mod kind;
mod maneuver;
mod measure;
mod scan;
mod settings;
mod sweep;

pub use by_hand::Source;
pub use edits::{Edits, apply};
pub use kind::Kind;
pub use maneuver::{Maneuver, NO_RISES, Step};
pub use settings::{Seek, Settings};

/// What is found on a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// In order of time and not overlapping.
    pub maneuvers: Vec<Maneuver>,
    /// Sequences of steps about as large as these that are cut off.
    pub cut: Vec<CutOff>,
}

/// A sequence of steps that a gap or the end of the record cuts off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutOff {
    /// When it begins, and when samples end, s.
    pub from: f64,
    pub to: f64,
    /// Steps of it that are there, the last one in part.
    pub steps: usize,
    pub by_gap: bool,
}

/// What there is in the samples `u` (SI) at ascending times `t` (s; equal lengths).
///
/// NaN samples are skipped; times that do not ascend are skipped as well.
pub fn search(t: &[f64], u: &[f64], settings: &Settings) -> Found {
    let pieces = scan::Work::pieces(t, u, settings);
    let sought = |what: Seek| pieces.iter().filter(move |_| settings.seek.contains(&what));
    let best = |mut all: Vec<Maneuver>| {
        all.retain(|m| m.score >= settings.min_score && m.amplitude >= settings.min_amplitude);
        best_without_overlap(all)
    };
    let sweeps = sought(Seek::Sweep).flat_map(|work| sweep::candidates(work, settings));
    let sweeps = best(sweeps.collect());
    let scanned: Vec<_> =
        sought(Seek::Multistep).map(|work| (work, scan::sequences(work, settings))).collect();
    let steps = scanned.iter().flat_map(|(work, (all, _))| candidates(work, all, settings));
    // What fits a sweep's lines is no sequence of steps.
    let mut steps = large(best(steps.collect()), settings);
    steps.retain(|m| sweeps.iter().all(|s| m.t_end <= s.t_start || m.onset >= s.t_end));
    let mut maneuvers = [sweeps, steps].concat();
    maneuvers.sort_by(|a, b| a.t_start.total_cmp(&b.t_start));
    let amplitudes: Vec<f64> = maneuvers.iter().map(|m| m.amplitude).collect();
    let typical = if amplitudes.is_empty() { 0.0 } else { crate::math::median(&amplitudes) };
    let least = settings.min_amplitude.max(settings.relative_amplitude * typical);
    let cut = scanned.iter().enumerate().filter_map(|(k, (work, (_, cut)))| {
        let cut = cut.filter(|cut| cut.peak >= least)?;
        let (from, to) = (work.time(cut.start as f64), work.time(work.v.len() as f64 - 1.0));
        // The last edge of a maneuver that is whole begins nothing.
        let is_edge =
            |m: &Maneuver| m.kind != Kind::Step && (from - m.t_end).abs() <= 0.5 * m.unit_time;
        if maneuvers.iter().any(is_edge) {
            return None;
        }
        Some(CutOff { from, to, steps: cut.count, by_gap: k + 1 < pieces.len() })
    });
    let cut = cut.collect();
    Found { maneuvers, cut }
}

/// The multisteps that are not much smaller than what is usual in the record.
fn large(kept: Vec<Maneuver>, settings: &Settings) -> Vec<Maneuver> {
    let several: Vec<f64> =
        kept.iter().filter(|m| m.steps.len() > 1).map(|m| m.amplitude).collect();
    let largest = kept.iter().map(|m| m.amplitude).fold(0.0, f64::max);
    let typical = if several.is_empty() { largest } else { crate::math::median(&several) };
    let least = settings.relative_amplitude * typical;
    kept.into_iter().filter(|m| m.amplitude >= least).collect()
}

/// All that might be a maneuver in one piece; candidates may overlap.
fn candidates(
    work: &scan::Work,
    sequences: &[Vec<scan::Excursion>],
    settings: &Settings,
) -> Vec<Maneuver> {
    let mut candidates: Vec<Maneuver> = vec![];
    for sequence in sequences {
        let whole = measure::maneuver(work, sequence, settings);
        // A recovery input right behind (or a twitch before) a maneuver hides its pattern: look at
        // the parts, too.
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

/// Of overlapping candidates the one that explains most; more steps weigh more, since chance seldom
/// makes them. A part of a sweep has no rest around it, so that its score is enough.
fn best_without_overlap(mut candidates: Vec<Maneuver>) -> Vec<Maneuver> {
    let rank = |m: &Maneuver| match m.kind {
        Kind::Sweep => m.score,
        Kind::Multistep => 0.7 * m.score * m.steps.len() as f64,
        _ => m.score * m.steps.len() as f64,
    };
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
