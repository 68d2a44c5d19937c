//! A problem whose states noise drives in; the start that its iteration is better begun at, out.
//!
//! The noise of a sensor starts at the fast part of what was measured. A start value of the motion
//! that is off by many times that makes squares of innovations over their variances in the hundreds,
//! and the first step of a scoring method goes anywhere: into a noise that swallows the motion, for
//! one. So what moves is fitted first, with the noise held as large as the first innovations say, which
//! is output error; the noise then begins where it would have begun.

use super::case::Case;
use super::{Settings, Unknown};
use crate::least_squares::{Evaluate, Layout, Method, cost, minimise};
use crate::model::noise_of;

/// Innovations of so many standard deviations, as a root mean square, call for it.
const LARGE: f64 = 2.0;
/// Iterations with the noise held, at most.
const ITERATIONS: usize = 10;

impl Case {
    /// The layout with the start that costs less: its own, or where the motion leads to.
    pub(super) fn begun<F: Evaluate>(
        &self,
        layout: Layout,
        evaluate: &F,
        settings: &Settings,
    ) -> Layout {
        let sensors = match settings.max_iterations {
            0 => Vec::new(),
            _ => self.sensors(),
        };
        let Some(sizes) = self.sizes(&layout, &layout.start).filter(|_| !sensors.is_empty()) else {
            return layout;
        };
        if sizes.iter().all(|size| *size <= LARGE) {
            return layout;
        }
        let held: Vec<usize> =
            sensors.iter().map(|sensor| sensor.0).chain(self.densities()).collect();
        let mut first = layout.clone();
        for &(place, output) in &sensors {
            first.start[place] *= sizes[output].max(1.0);
        }
        for &place in &held {
            (first.lower[place], first.upper[place]) = (first.start[place], first.start[place]);
        }
        let method = Method { max_iterations: ITERATIONS, ..settings.method() };
        let mut start = minimise(&first, evaluate, &method).theta;
        held.iter().for_each(|&place| start[place] = layout.start[place]);
        let Some(sizes) = self.sizes(&layout, &start) else { return layout };
        for &(place, output) in &sensors {
            start[place] *= if sizes[output] > LARGE { sizes[output] } else { 1.0 };
        }
        let [given, found] = [&layout.start, &start].map(|theta| cost(&layout, evaluate, theta));
        match found.is_some_and(|found| given.is_none_or(|given| found < given)) {
            true => Layout { start, ..layout },
            false => layout,
        }
    }

    /// Places of the noise of sensors, and which of the scored outputs each belongs to.
    fn sensors(&self) -> Vec<(usize, usize)> {
        let name = |output: &usize| noise_of(&self.model.outputs[*output].name);
        let names: Vec<String> = self.outputs.iter().map(name).collect();
        let of = |(place, unknown): (usize, &Unknown)| {
            names.iter().position(|name| *name == unknown.name).map(|output| (place, output))
        };
        self.unknowns.iter().enumerate().filter_map(of).collect()
    }

    /// Root mean square of the innovations over their standard deviations, per scored output; none
    /// where the filter is lost.
    fn sizes(&self, layout: &Layout, theta: &[f64]) -> Option<Vec<f64>> {
        let mut sums = vec![[0.0; 2]; self.outputs.len()];
        for s in 0..self.records.len() {
            for block in self.evaluate(s, &layout.local(s, theta), false)? {
                for e in block.e.iter().filter(|e| block.instead.is_none() && e.is_finite()) {
                    sums[block.output][0] += 1.0;
                    sums[block.output][1] += e * e;
                }
            }
        }
        Some(
            sums.into_iter().map(|[n, sum]| if n > 0.0 { (sum / n).sqrt() } else { 0.0 }).collect(),
        )
    }
}
