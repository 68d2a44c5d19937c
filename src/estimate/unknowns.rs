//! A model, what is free in it, and the segments used in; the unknowns of an estimation and their layout out.

use super::choice::Chosen;
use super::segment::{CAMPAIGN, Grouping, SEGMENT, Segment, instants};
use super::{Label, NoiseKind, Settings};
use crate::dynamics::{Propagator, Record};
use crate::least_squares::{Layout, Part, Structure};
use crate::model::{Model, Scope};
use std::ops::Range;

/// A variance is never taken smaller than this share of the mean square of the measurements; the
/// second where outputs may be correlated, since a combination of outputs can vanish altogether.
const FLOOR: f64 = 1e-20;
const FLOOR_FULL: f64 = 1e-12;

/// One unknown.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Unknown {
    pub name: String,
    pub unit: String,
    /// Place among the segments used.
    pub segment: Option<usize>,
    pub group: Option<Label>,
}

/// The unknowns of an estimation, and where each stands.
pub(super) struct Unknowns {
    pub layout: Layout,
    /// In the order of the parameter vector.
    pub all: Vec<Unknown>,
}

/// What is known of an unknown before.
#[derive(Debug, Clone, Copy)]
struct Before {
    start: f64,
    lower: f64,
    upper: f64,
    /// Centre and sd of the prior.
    centre: f64,
    prior_sd: f64,
}

impl Before {
    /// Nothing but where to start.
    fn free(start: f64) -> Before {
        let (lower, upper) = (f64::NEG_INFINITY, f64::INFINITY);
        Before { start, lower, upper, centre: start, prior_sd: f64::INFINITY }
    }
}

/// Unknowns as they are listed.
struct List<'a> {
    model: &'a Model,
    chosen: &'a Chosen,
    propagator: &'a Propagator,
    /// Whether priors of the model count.
    priors: bool,
    /// Start values of the model's parameters, as it declares them.
    declared: Vec<f64>,
    before: Vec<Before>,
    all: Vec<Unknown>,
}

impl Unknowns {
    /// `given`: start values of the states that the propagator wants from outside, per segment.
    pub fn new(
        (model, chosen, propagator): (&Model, &Chosen, &Propagator),
        (segments, scored): (&[&Segment], &[Record]),
        settings: &Settings,
        given: &[Vec<f64>],
    ) -> Unknowns {
        let mut list = List {
            model,
            chosen,
            propagator,
            priors: settings.priors,
            declared: model.parameter_starts(),
            before: Vec::new(),
            all: Vec::new(),
        };
        let mut seen: Vec<Vec<usize>> = vec![Vec::new(); segments.len()];
        list.shared(segments, &mut seen);
        list.slopes(&mut seen);
        list.records(segments, given, &mut seen);
        let shared = list.all.len();
        let noise = Grouping::by(&settings.noise_per, segments);
        let full = settings.noise == NoiseKind::Full;
        let mut parts = Vec::with_capacity(segments.len());
        for (s, segment) in segments.iter().enumerate() {
            let alone = segment.stretch.is_none();
            let range = if alone { list.own(&given[s], Some(s), None) } else { shared..shared };
            let instants = if full { instants(&scored[s]) } else { Vec::new() };
            let shared = std::mem::take(&mut seen[s]);
            let (offset, own, group) = (range.start, range.len(), noise.of[s]);
            parts.push(Part { shared, offset, own, group, instants });
        }
        let floors = propagator.outputs.iter().map(|&o| floor(model, segments, o, settings));
        let noise = Structure {
            outputs: propagator.outputs.len(),
            groups: noise.values.len().max(1),
            full,
            floor: floors.collect(),
            known: model.covariance.is_some(),
        };
        list.tried(settings);
        let column = |of: fn(&Before) -> f64| list.before.iter().map(of).collect();
        let layout = Layout {
            shared,
            parts,
            start: column(|b| b.start),
            lower: column(|b| b.lower),
            upper: column(|b| b.upper),
            centre: column(|b| b.centre),
            prior_sd: column(|b| b.prior_sd),
            squares: Vec::new(),
            noise,
        };
        Unknowns { layout, all: list.all }
    }
}

impl List<'_> {
    fn push(&mut self, unknown: Unknown, before: Before) {
        self.all.push(unknown);
        self.before.push(before);
    }

    /// Parameter `p` of the model. A prior is the model's: where an iteration starts says nothing about
    /// the parameter. Where both bounds are one value there is nothing to estimate.
    fn parameter(&mut self, p: usize, segment: Option<usize>, group: Option<Label>) {
        let q = &self.model.parameters[p];
        let declared = self.declared[p];
        let is_held = group.as_ref().is_some_and(|group| q.held_in.as_ref() == Some(&group.value));
        let before = match is_held {
            true => Before { lower: declared, upper: declared, ..Before::free(declared) },
            false => Before {
                start: self.chosen.parameters[p],
                lower: q.min,
                upper: q.max,
                centre: declared,
                prior_sd: if self.priors { q.prior_sd } else { f64::INFINITY },
            },
        };
        let (name, unit) = (q.quantity.name.clone(), q.quantity.unit.clone());
        self.push(Unknown { name, unit, segment, group }, before);
    }

    /// What segments share: one value for all, or one per group.
    fn shared(&mut self, segments: &[&Segment], seen: &mut [Vec<usize>]) {
        for &p in &self.chosen.shared {
            let column = match &self.chosen.scopes[p] {
                Scope::Column(column) => column,
                _ => CAMPAIGN,
            };
            let grouping = Grouping::by(column, segments);
            let first = self.all.len();
            seen.iter_mut().zip(&grouping.of).for_each(|(seen, group)| seen.push(first + group));
            // A campaign's value is there even without segments.
            let groups = if column == CAMPAIGN {
                vec![None]
            } else {
                grouping.values.into_iter().map(Some).collect()
            };
            for value in groups {
                let label = value.map(|value| Label { column: column.to_string(), value });
                self.parameter(p, None, label);
            }
        }
    }

    /// Slopes of the lines that parameters follow.
    fn slopes(&mut self, seen: &mut [Vec<usize>]) {
        for (at, line) in &self.chosen.lines {
            let q = &self.model.parameters[self.chosen.shared[*at]].quantity;
            let (name, unit) = (line.slope(&q.name), line.slope_unit(&q.unit));
            seen.iter_mut().for_each(|seen| seen.push(self.all.len()));
            self.push(Unknown { name, unit, segment: None, group: None }, Before::free(0.0));
        }
    }

    /// What belongs to a segment is common to the stretches of one record, and stands among the
    /// shared ones then.
    fn records(&mut self, segments: &[&Segment], given: &[Vec<f64>], seen: &mut [Vec<usize>]) {
        let mut records: Vec<(&str, Range<usize>)> = Vec::new();
        for (s, segment) in segments.iter().enumerate() {
            let Some(stretch) = &segment.stretch else { continue };
            let known = records.iter().find(|(of, _)| *of == stretch.of);
            let range = known.map(|(_, range)| range.clone()).unwrap_or_else(|| {
                let label = Label { column: SEGMENT.to_string(), value: stretch.of.clone() };
                let range = self.own(&given[s], None, Some(label));
                records.push((&stretch.of, range.clone()));
                range
            });
            seen[s].extend(range);
        }
    }

    /// What belongs to one segment, or record: parameters and start values of states.
    fn own(&mut self, given: &[f64], place: Option<usize>, group: Option<Label>) -> Range<usize> {
        let from = self.all.len();
        for &p in &self.chosen.own {
            self.parameter(p, place, group.clone());
        }
        for (state, value) in self.propagator.given().iter().zip(given) {
            if self.chosen.initial.contains(state) {
                let q = &self.model.states[*state].quantity;
                let (name, unit) = (format!("{}(0)", q.name), q.unit.clone());
                let unknown = Unknown { name, unit, segment: place, group: group.clone() };
                self.push(unknown, Before::free(*value));
            }
        }
        from..self.all.len()
    }

    /// Starts that are tried instead of the model's.
    fn tried(&mut self, settings: &Settings) {
        for (before, unknown) in self.before.iter_mut().zip(&self.all) {
            if let Some(tried) = settings.tried.get(&unknown.name) {
                before.start = tried.clamp(before.lower, before.upper);
            }
        }
    }
}

/// The smallest variance of an output: what the settings say, and not less than rounding errors
/// make.
fn floor(model: &Model, segments: &[&Segment], output: usize, settings: &Settings) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for channel in segments.iter().flat_map(|s| &s.record.channels).filter(|c| c.output == output) {
        for z in channel.z.iter().filter(|z| z.is_finite()) {
            sum += z * z;
            n += 1.0;
        }
    }
    let share = if settings.noise == NoiseKind::Full { FLOOR_FULL } else { FLOOR };
    let least = if sum > 0.0 { share * sum / n } else { share };
    let sd = settings.floor.get(&model.outputs[output].name).copied().unwrap_or(0.0);
    least.max(sd * sd)
}
