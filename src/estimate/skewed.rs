//! A solution in; the records that look late against the others, by how much, and what that moves, out.
//!
//! A record that is late by `tau` has `u(t - tau)` where the model is driven by `u(t)`, and what is measured
//! of an output is `y(t - tau)`. `tau` of every input and every output is a further unknown whose
//! sensitivities are differences over a step of the grid. One pass at the solution gives the
//! normal equations of all of them together with the parameters; those that lower the cost by more than
//! chance are chosen one after the other, the largest first (forward selection: a shift of everything is
//! none, so that they are never all determined), and estimated together with the parameters, with honest
//! standard deviations. Of several flights it is asked as well whether a record is late in one of them alone: one
//! recorder that was set up otherwise is no fault of all. A record is told where it is late beyond chance and that moves an estimate.
//!
//! A lag between what is recorded and what acts looks like it (an input that is early, an output that is
//! late): what it is tells a diagnosis, in which all of them are rivals.

use super::case::Case;
use super::coarse::MOVES;
use super::scores::Scores;
use super::shifted::{Of, Shift, Shifted};
use super::solution::{Solution, judged};
use super::{Settings, Stop};
use crate::least_squares::{Layout, Method, minimise, normal_equations};
use crate::math::median;
use crate::model::Delayed;

/// A record is late beyond chance by so many standard deviations.
const BEYOND: f64 = 5.0;
/// Longer than this, s, no record is late against another by its clock or its filter: what looks so is something
/// else that is slow. *Convention*.
const LONGEST: f64 = 0.5;
/// What takes this share of all that is left is asked as well: a record that is very late colours the residuals
/// by itself, and what colour makes of chance can be more than there is. *Convention*.
const MUCH: f64 = 0.1;
/// So many records are asked flight by flight at most. *Convention*.
const MOST_ASKED: usize = 400;
/// Records that are told at most.
const MOST: usize = 4;
/// Iterations with them, and how often a step is halved: a share of a standard deviation more or less changes
/// nothing that is told. Where an input is held between its samples the cost has kinks at every point of the
/// grid, and at one of them no step brings anything, however short.
const FEW: usize = 10;
const HALVINGS: usize = 6;
/// The whole step is shorter than so many standard deviations.
const NEAR: f64 = 0.1;

/// Records that look late.
#[derive(Debug, Clone, PartialEq)]
pub struct Skewed {
    pub records: Vec<Late>,
    /// Parameters with the standard deviations by which they move, those that move most first.
    pub moved: Vec<(String, f64)>,
}

/// A record that looks late, or early where it is negative.
#[derive(Debug, Clone, PartialEq)]
pub struct Late {
    /// Name of the input or output.
    pub record: String,
    /// The flight, where it is not late in all of them.
    pub flight: Option<String>,
    /// s.
    pub by: f64,
    pub sd: f64,
}

impl Case {
    /// Records that look late; none where none does, or nothing moves by its sd.
    pub(super) fn skewed(&self, solution: &Solution, settings: &Settings) -> Option<Skewed> {
        if self.is_filtered() || solution.fit.stop != Stop::Converged {
            return None;
        }
        // Without standard deviations nothing is beyond chance.
        solution.covariance.as_ref()?;
        let all = self.recorded();
        let chosen = self.chosen_of(&all, solution)?;
        if chosen.is_empty() {
            return None;
        }
        let (nc, k) = (self.layout.shared, chosen.len());
        let shifted = Shifted { case: self, of: &chosen, both: true };
        let evaluate = |s: usize, local: &[f64], slopes: bool| shifted.evaluate(s, local, slopes);
        let layout = self.layout.widened_where(k, |s, j| chosen[j].is_in(self, s));
        let layout = Layout { start: wide(&solution.fit.theta, nc, k), ..layout };
        let method = settings.method();
        let method = Method {
            max_iterations: FEW,
            max_halvings: method.max_halvings.min(HALVINGS),
            step_tolerance: method.step_tolerance.max(NEAR),
            gradient_tolerance: 0.0,
            turns: false,
            ..method
        };
        let later = judged(&layout, &evaluate, settings, minimise(&layout, &evaluate, &method));
        let late = |j: usize| {
            let (sd, _) = later.deviation(nc + j)?;
            let by = later.fit.theta[nc + j];
            let record = self.name_of(chosen[j].of);
            let flight = chosen[j].flight.map(|flight| self.flights[flight].clone());
            let is_late = by.abs() > BEYOND * sd && by.abs() < LONGEST;
            is_late.then_some(Late { record, flight, by, sd })
        };
        let records: Vec<Late> = (0..k).filter_map(late).collect();
        if records.is_empty() {
            return None;
        }
        let there = |i: usize| later.fit.theta[if i < nc { i } else { i + k }];
        let moved = |(i, unknown): (usize, &super::unknowns::Unknown)| {
            let (sd, _) = solution.deviation(i)?;
            let by = (there(i) - solution.fit.theta[i]).abs() / sd;
            (by > MOVES).then(|| (unknown.name.clone(), by))
        };
        let mut moved: Vec<(String, f64)> =
            self.unknowns[..nc].iter().enumerate().filter_map(moved).collect();
        moved.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        (!moved.is_empty()).then_some(Skewed { records, moved })
    }

    /// The records that may be late: not those whose delay the model itself has.
    fn recorded(&self) -> Vec<Of> {
        let is_free = !self.delaying().is_empty();
        let is_delayed = |i: &usize| {
            is_free && self.model.delays.iter().any(|delay| delay.of == Delayed::Input(*i))
        };
        let inputs = (0..self.model.inputs.len()).filter(|i| !is_delayed(i)).map(Of::Input);
        inputs.chain((0..self.outputs.len()).map(Of::Output)).collect()
    }

    fn name_of(&self, of: Of) -> String {
        match of {
            Of::Input(i) => self.model.inputs[i].name.clone(),
            Of::Output(j) => self.model.outputs[self.outputs[j]].name.clone(),
        }
    }

    /// Those whose shifts lower the cost by more than chance, one after the other: of several flights, those of one
    /// alone, too.
    fn chosen_of(&self, all: &[Of], solution: &Solution) -> Option<Vec<Shift>> {
        let flights = match self.flights.len() {
            count if count > 1 && count * all.len() <= MOST_ASKED => count,
            _ => 1,
        };
        let of_flight = |flight: usize| (flights > 1).then_some(flight);
        let asked: Vec<Shift> = (0..flights)
            .flat_map(|flight| all.iter().map(move |&of| Shift { of, flight: of_flight(flight) }))
            .collect();
        let (nc, k) = (self.layout.shared, asked.len());
        let shifted = Shifted { case: self, of: &asked, both: false };
        let evaluate = |s: usize, local: &[f64], slopes: bool| shifted.evaluate(s, local, slopes);
        let layout = self.layout.widened_where(k, |s, j| asked[j].is_in(self, s));
        let theta = wide(&solution.fit.theta, nc, k);
        let (matrix, gradient) = normal_equations(&layout, &evaluate, &theta)?;
        let held = wide(&solution.fit.held, nc, k);
        let is_base = |i: usize| !held[i] && !(nc..nc + k).contains(&i);
        // Those of one flight first: of two that gain alike the last one is taken.
        let mut candidates: Vec<(Shift, Vec<usize>)> =
            asked.iter().enumerate().map(|(j, shift)| (*shift, vec![nc + j])).collect();
        if flights > 1 {
            let everywhere = |(j, &of): (usize, &Of)| {
                let places = (0..flights).map(|flight| nc + flight * all.len() + j);
                (Shift { of, flight: None }, places.collect())
            };
            candidates.extend(all.iter().enumerate().map(everywhere));
        }
        let places: Vec<Vec<usize>> = candidates.iter().map(|(_, places)| places.clone()).collect();
        let mut scores = Scores::of((&matrix, &gradient), &is_base, &places)?;
        let chance = self.chance(solution);
        let mut chosen = Vec::new();
        while chosen.len() < MOST {
            let gains = (0..candidates.len()).filter_map(|j| Some((j, scores.gain(j)?)));
            match gains.max_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((j, gain)) if gain > chance => {
                    chosen.push(candidates[j].0);
                    scores.take(j);
                }
                _ => break,
            }
        }
        Some(chosen)
    }

    /// By how much chance lowers the cost: what colour of the residuals makes of it.
    fn chance(&self, solution: &Solution) -> f64 {
        let wider = |i: usize| solution.deviation(i).map(|(sd, crlb)| sd / crlb);
        let wider: Vec<f64> = (0..self.layout.shared).filter_map(wider).collect();
        let by_chance = |wider: f64| 0.5 * (BEYOND * wider).powi(2);
        let samples: usize = solution.fit.noise.iter().flat_map(|group| &group.count).sum();
        let much = (MUCH * 0.5 * samples as f64).max(by_chance(1.0));
        by_chance(median(&wider).max(1.0)).min(much)
    }
}

/// A vector of the problem with `k` further shared places.
fn wide<T: Clone + Default>(theta: &[T], nc: usize, k: usize) -> Vec<T> {
    [&theta[..nc], &vec![T::default(); k], &theta[nc..]].concat()
}
