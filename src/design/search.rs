//! A study with the traces of its designs in; durations of alternating steps that give a smaller
//! trace within the limits, or the number of tries that found none, out.

use super::judged::{Judged, Outcome};
use super::rows::{Design, SEARCHED};
use super::settings::Search;
use super::study::Study;
use super::work::{Tried, Watch, fly_all, judge_all};
use crate::error::Errors;
use crate::simulate::{Maneuver, Stream};

/// Designs that are flown together, then the best so far is the middle of the next ones: a fixed
/// number, so that the search takes the same way on any number of threads.
const TOGETHER: usize = 8;
/// A search is worth a word where the trace is smaller by this share.
const WORTH: f64 = 0.1;

/// Durations of steps, s, and the sign of the first one.
type Steps = (Vec<f64>, i8);

/// What a search found.
#[derive(Debug)]
pub struct Found {
    pub tries: usize,
    /// Tries that kept the limits and were determined.
    pub allowed: usize,
    /// Name and trace of the best 3211 of the study that keeps the limits.
    pub reference: Option<(String, f64)>,
    /// The durations of the best try, s, the sign of its first step, and its trace in recordings of
    /// its own.
    pub durations: Vec<f64>,
    pub polarity: i8,
    pub trace: f64,
    /// The best try, recorded again.
    pub best: Option<(Design, Tried)>,
}

impl Found {
    /// Whether the trace is at least 10 % below that of the best 3211.
    pub fn is_better(&self) -> bool {
        self.reference.as_ref().is_some_and(|(_, trace)| self.trace <= (1.0 - WORTH) * trace)
    }

    /// What was found, in one sentence.
    pub fn words(&self) -> String {
        let tries = format!("{} tries, {} of them within the limits", self.tries, self.allowed);
        let sign = if self.polarity < 0 { "negative first" } else { "positive first" };
        let steps: Vec<String> = self.durations.iter().map(|d| format!("{d:.2}")).collect();
        let steps = steps.join(", ");
        match &self.reference {
            None => format!("search: no 3211 of the study keeps the limits ({tries})"),
            Some((name, _)) if self.best.is_none() => {
                format!(
                    "search: none was found that keeps the limits and is determined, to hold against {name} ({tries})"
                )
            }
            Some((name, trace)) => {
                let share = 100.0 * (self.trace / trace - 1.0);
                let said = if self.is_better() {
                    "found"
                } else {
                    "none was found 10 % below the best 3211"
                };
                format!(
                    "search: {said}: steps of {steps} s, {sign}, have a trace of {:.3e}, {share:+.0} % against {name} ({tries})",
                    self.trace
                )
            }
        }
    }
}

/// Searches: a first half of tries anywhere, a second around the best so far.
///
/// # Errors
/// As `fly_all`.
pub fn search(
    study: &Study,
    settings: &Search,
    judged: &[Vec<Judged>],
    watch: Watch,
) -> Result<Found, Errors> {
    let at = study.estimates.iter().position(|e| e.name == settings.estimate).unwrap_or(0);
    let reference = best_3211(study, settings, &judged[at]);
    let mut stream = Stream::new(study.settings.seed, &["design", "search"]);
    let (mut best, mut allowed, mut tries) = (None::<(f64, Steps)>, 0, 0);
    let most = settings.tries as usize;
    while tries < most {
        let n = TOGETHER.min(most - tries);
        let wide = 2 * tries < most;
        // narrower and narrower, from 50 % to 5 % of a duration
        let spread = 0.5 * libm::pow(0.1, (2.0 * tries as f64 / most as f64 - 1.0).max(0.0));
        let mut designs = Vec::new();
        for k in 0..n {
            let near = best.as_ref().filter(|_| !wide).map(|(_, steps)| steps);
            let steps = candidate(settings, near, spread, study, &mut stream);
            designs.push((design(study, settings, &steps, &format!("try-{}", tries + k)), steps));
        }
        let flown: Vec<Design> = designs.iter().map(|d| d.0.clone()).collect();
        let tried = fly_all(study, &flown, settings.seeds, &|_, _| {})?;
        let results = &judge_all(study, &flown, &tried)[at];
        for (result, (_, steps)) in results.iter().zip(designs) {
            if !keeps(study, settings, result) {
                continue;
            }
            allowed += 1;
            if best.as_ref().is_none_or(|(trace, _)| result.trace < *trace) {
                best = Some((result.trace, steps));
            }
        }
        tries += n;
        watch(tries, most);
    }
    let (durations, polarity, trace) = (Vec::new(), 1, f64::NAN);
    let mut found = Found { tries, allowed, reference, durations, polarity, trace, best: None };
    if let Some((_, steps)) = best {
        // The best of many noisy traces is too good: it is recorded again.
        let design = design(study, settings, &steps, SEARCHED);
        let mut tried = fly_all(study, std::slice::from_ref(&design), study.settings.seeds, watch)?;
        found.trace = judge_all(study, std::slice::from_ref(&design), &tried)[at][0].trace;
        found.best = tried.pop().map(|tried| (design, tried));
        (found.durations, found.polarity) = steps;
    }
    Ok(found)
}

/// Whether a design is determined and keeps the limits.
fn keeps(study: &Study, settings: &Search, judged: &Judged) -> bool {
    let within = |f: &super::flown::Facts| f.excursions.within(&study.settings, &settings.limits);
    judged.outcome == Outcome::Determined && judged.facts.as_ref().is_some_and(within)
}

/// Name and trace of the best 3211 of equal steps that keeps the limits.
fn best_3211(study: &Study, settings: &Search, judged: &[Judged]) -> Option<(String, f64)> {
    judged
        .iter()
        .filter(|j| j.design.maneuver.kind == "3211" && j.design.repeats == 1)
        .filter(|j| keeps(study, settings, j))
        .min_by(|a, b| a.trace.total_cmp(&b.trace))
        .map(|j| (j.design.name.clone(), j.trace))
}

/// Durations anywhere between the ends (evenly in their logarithm) and a sign, or durations around
/// others; too long ones are shortened alike. On the grid of the truth.
fn candidate(
    settings: &Search,
    near: Option<&Steps>,
    spread: f64,
    study: &Study,
    stream: &mut Stream,
) -> Steps {
    let [low, high] = settings.step_s;
    let drawn = if stream.uniform() < 0.5 { -1 } else { 1 };
    let one = |k: usize, stream: &mut Stream| match near {
        Some((near, _)) => near[k] * libm::exp(spread * stream.normal()),
        None => low * libm::pow(high / low, stream.uniform()),
    };
    let mut durations: Vec<f64> =
        (0..settings.steps as usize).map(|k| one(k, stream).clamp(low, high)).collect();
    let rate = study.campaign.settings.rate_hz;
    let long = durations.iter().sum::<f64>() / settings.total_s;
    for d in &mut durations {
        *d = ((*d / long.max(1.0)).max(low) * rate).floor().max(1.0) / rate;
    }
    (durations, near.map_or(drawn, |(_, polarity)| *polarity))
}

/// Steps of these durations with alternating signs, as a profile: the level changes just before a
/// grid point of the truth, which then has the new one.
fn design(study: &Study, settings: &Search, (durations, polarity): &Steps, name: &str) -> Design {
    const BEFORE: [f64; 2] = [2e-6, 1e-6];
    let (mut times, mut values) = (vec![0.0], vec![settings.amplitude]);
    let (mut end, mut level) = (0.0, settings.amplitude);
    for (k, duration) in durations.iter().enumerate() {
        end += duration;
        if k + 1 == durations.len() {
            times.push(end);
            values.push(level);
        } else {
            times.extend(BEFORE.map(|before| end - before));
            values.extend([level, -level]);
            level = -level;
        }
    }
    let maneuver = Maneuver {
        input: study.settings.input.clone(),
        kind: "profile".to_string(),
        unit_time_s: None,
        amplitude: None,
        amplitudes: None,
        polarity: *polarity,
        edge_s: 0.0,
        duration_s: None,
        band_hz: None,
        period_s: None,
        cycles: None,
        times_s: Some(times),
        values: Some(values),
        with: Vec::new(),
    };
    Design { name: name.to_string(), key: "search".to_string(), maneuver, repeats: 1 }
}
