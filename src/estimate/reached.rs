//! A case and a parameter vector in; which limits of its states the motion reaches there and where, how near it comes
//! to the others, and whether what was measured follows it there, out.

use super::case::Case;
use super::plateaus::{Along, Piece};
use super::watched::{Seen, Watch, conditions, parameters, watched};
use crate::error::Result;
use crate::model::graph::Node;

/// The motion is near its extreme within this share of its range.
const NEAR: f64 = 0.2;
/// Fewer samples there say nothing.
const FEWEST: usize = 10;
/// Residuals near the extreme that are larger than elsewhere by more than so many standard deviations of their mean
/// square.
const SURE: f64 = 5.0;
/// What is left near an extreme is noise where less than this share of it goes one way.
const ONE_WAY: f64 = 0.7;

/// One limit of one state.
#[derive(Debug, Clone, PartialEq)]
pub struct Reached {
    pub state: String,
    /// `min`, `max` or `rate_max`.
    pub limit: &'static str,
    /// SI unit of the limit.
    pub unit: String,
    /// Parameters of the model that it depends on.
    pub parameters: Vec<String>,
    /// Segments (indices of the records) in which it is active, and for how many seconds.
    pub active: Vec<(usize, f64)>,
    /// Segments looked at (indices of the records).
    pub segments: Vec<usize>,
    /// What drives the model and limits depend on; all that drives it where none does.
    pub inputs: Vec<Over>,
    /// What the motion reaches towards it: the largest value, of `min` the smallest; of `rate_max` the largest
    /// absolute rate. NaN without a segment.
    pub extreme: f64,
    /// The segment in which it does.
    pub segment: Option<usize>,
    /// Where it is never active: whether what was measured of the state follows the motion near its extreme as well
    /// as elsewhere; none where too few samples tell.
    pub follows: Option<Follows>,
    /// Stretches on a `min` or `max`, piece by piece.
    pub pieces: Vec<Piece>,
}

/// One input of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Over {
    pub name: String,
    pub unit: String,
    /// Least and largest value while the limit is active; NaN where it never is.
    pub lower: f64,
    pub upper: f64,
    /// Its value where the motion has its extreme.
    pub at: f64,
}

/// R.m.s. residuals of what was measured of a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Follows {
    pub near: f64,
    pub elsewhere: f64,
    /// Mean by which the measurement stays behind near the extreme; 0 for a rate.
    pub behind: f64,
    /// Samples near the extreme.
    pub count: usize,
}

impl Follows {
    /// Whether residuals near the extreme are no larger than chance makes them, and are not for the
    /// most part what a measurement stays behind that stops earlier.
    pub fn agrees(self) -> bool {
        let more = (self.near / self.elsewhere).powi(2) - 1.0;
        more <= SURE * (2.0 / self.count as f64).sqrt() && self.behind <= ONE_WAY * self.near
    }
}

impl Case {
    /// Parameters that times of delays depend on.
    pub fn delaying(&self) -> Vec<String> {
        let taus: Vec<Node> = self.model.delays.iter().map(|d| d.tau).collect();
        parameters(&self.model, &taus)
    }

    /// The limits of the states at `theta`; `used`: the records that the segments are.
    ///
    /// # Errors
    /// Start values that depend on each other, which would have ended an estimation before.
    pub fn reached(&self, theta: &[f64], used: &[usize]) -> Result<Vec<Reached>> {
        let (model, watches) = watched(&self.model);
        if watches.is_empty() {
            return Ok(Vec::new());
        }
        let segments = self.seen_all(&model, &watches, theta)?;
        let told = conditions(&self.model, &watches);
        let of = |(w, watch): (usize, &Watch)| {
            let seen: Vec<&Seen> = segments.iter().map(|all| &all[w]).collect();
            self.told((watch, &told), &seen, theta, used)
        };
        Ok(watches.iter().enumerate().map(of).collect())
    }

    fn told(
        &self,
        (watch, told): (&Watch, &[usize]),
        seen: &[&Seen],
        theta: &[f64],
        used: &[usize],
    ) -> Reached {
        let all = || {
            seen.iter()
                .enumerate()
                .flat_map(|(s, seen)| (0..seen.motion.len()).map(move |k| (s, k)))
        };
        let motion = |(s, k): (usize, usize)| seen[s].motion[k];
        let place = all()
            .filter(|at| motion(*at).is_finite())
            .reduce(|best, at| if motion(at) > motion(best) { at } else { best });
        let sign = if watch.limit == "min" { -1.0 } else { 1.0 };
        let input = |(s, k): (usize, usize), j: usize| self.driven(s, k, j);
        let over = |&j: &usize| {
            let quantity = &self.model.inputs[j];
            let values = || all().filter(|(s, k)| seen[*s].active[*k]).map(|at| input(at, j));
            Over {
                name: quantity.name.clone(),
                unit: quantity.unit.clone(),
                lower: values().fold(f64::NAN, f64::min),
                upper: values().fold(f64::NAN, f64::max),
                at: place.map_or(f64::NAN, |at| input(at, j)),
            }
        };
        let seconds = |(s, seen): (usize, &&Seen)| {
            let count = seen.active.iter().filter(|active| **active).count();
            (count > 0).then(|| (used[s], count as f64 * self.records[s].dt))
        };
        let active: Vec<(usize, f64)> = seen.iter().enumerate().filter_map(seconds).collect();
        let along = |(place, seen): (usize, &&Seen)| {
            let (state, active, bound) = (watch.state, &seen.active[..], &seen.bound[..]);
            self.plateaus(&Along { state, place, active, bound, inputs: told })
        };
        let pieces = match watch.limit {
            "rate_max" => Vec::new(),
            _ => seen.iter().enumerate().flat_map(along).collect(),
        };
        Reached {
            state: self.model.states[watch.state].quantity.name.clone(),
            limit: watch.limit,
            unit: watch.unit.clone(),
            parameters: parameters(&self.model, &[watch.bound]),
            follows: if active.is_empty() { self.follows(watch, seen, theta) } else { None },
            active,
            segments: used.to_vec(),
            inputs: told.iter().map(over).collect(),
            extreme: place.map_or(f64::NAN, |at| sign * motion(at)),
            segment: place.map(|(s, _)| used[s]),
            pieces,
        }
    }

    /// Residuals near the extreme of the motion, and elsewhere.
    fn follows(&self, watch: &Watch, seen: &[&Seen], theta: &[f64]) -> Option<Follows> {
        let motions =
            || seen.iter().flat_map(|seen| &seen.motion).copied().filter(|x| x.is_finite());
        let (low, high) = (motions().fold(f64::NAN, f64::min), motions().fold(f64::NAN, f64::max));
        let near = |x: f64| x >= high - NEAR * (high - low);
        let name = &self.model.states[watch.state].quantity.name;
        let beyond = match watch.limit {
            "max" => 1.0,
            "min" => -1.0,
            _ => 0.0,
        };
        let (mut squares, mut counts, mut behind) = ([0.0; 2], [0_usize; 2], 0.0);
        for (s, seen) in seen.iter().enumerate() {
            let record = &self.records[s];
            for trace in self.traces(s, theta).iter().filter(|trace| trace.name == *name) {
                for ((t, z), y) in trace.t.iter().zip(&trace.measured).zip(&trace.modelled) {
                    let k = ((t - record.t0) / record.dt).round() - record.start as f64;
                    let Some(x) = seen.motion.get(k.max(0.0) as usize) else { continue };
                    if (z - y).is_finite() {
                        let place = usize::from(!near(*x));
                        squares[place] += (z - y) * (z - y);
                        behind += if place == 0 { beyond * (y - z) } else { 0.0 };
                        counts[place] += 1;
                    }
                }
            }
        }
        let rms = |place: usize| (squares[place] / counts[place] as f64).sqrt();
        (counts[0] >= FEWEST && counts[1] >= FEWEST).then(|| Follows {
            near: rms(0),
            elsewhere: rms(1),
            behind: behind / counts[0] as f64,
            count: counts[0],
        })
    }
}
