//! The normal equations of a segment as a function: a problem, a parameter vector and a segment come
//! in, sums over the segment go out, wherever that is done.
//!
//! A process that does it for another one makes the problem from what it was made of there (the
//! text of the model, the records, the settings), once, and keeps it by the key of these bytes; then
//! every call carries a parameter vector and the covariance of the noise, and every item the place
//! of a segment.

use super::case::Case;
use super::neighbours::{Known, lowest};
use super::prepared::Prepared;
use super::profile::{Profile, profiles, upper_limit};
use super::segment::Segment;
use super::solution::{Solution, judged};
use super::{Line, Settings};
use crate::dynamics::MOST_SUBSTEPS;
use crate::engine::{self, Blobs, Function, Here, Key, Source, decode, encode};
use crate::error::{Error, Result};
use crate::least_squares::{
    Block, Evaluate, Layout, SegmentSums, Stop, Wanted, cost, segment_sums,
};
use crate::model::{Model, Text};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Mutex;

/// Sums over one segment of an estimation.
pub struct NormalEquations;

/// A problem at one parameter vector.
pub struct At<'a> {
    case: &'a Case,
    theta: &'a [f64],
    wanted: &'a Wanted<'a>,
    /// What the problem was made of; none where it was made again.
    origin: Option<&'a Origin<'a>>,
}

impl Function for NormalEquations {
    const NAME: &'static str = "normal equations of a segment";
    const VERSION: u32 = 1;
    type Parameters<'a> = At<'a>;
    /// The place of the segment among those used.
    type Item = usize;
    /// None where the model is not finite there.
    type Output = Option<SegmentSums>;

    fn run(at: &At, s: &usize, _: &Source) -> Result<Option<SegmentSums>> {
        Ok(at.here(*s))
    }

    fn pack(at: &At, blobs: &dyn Blobs) -> Result<Vec<u8>> {
        let origin = at.origin.ok_or_else(|| Error::new("a problem is passed on only once"))?;
        encode(&Packed {
            problem: origin.key(&at.case.steps(), blobs)?,
            theta: Cow::Borrowed(at.theta),
            wanted: at.wanted.clone(),
        })
    }

    fn lend(bytes: &[u8], source: &Source, to: &mut dyn FnMut(&At) -> Result<()>) -> Result<()> {
        let Packed { problem, theta, wanted } = decode(bytes)?;
        let case =
            source.kept.get(&problem, || decode::<Problem>(&source.blob(&problem)?)?.case())?;
        to(&At { case: &case, theta: &theta, wanted: &wanted, origin: None })
    }
}

impl At<'_> {
    fn here(&self, s: usize) -> Option<SegmentSums> {
        let case = self.case;
        let evaluate =
            |s: usize, local: &[f64], sensitivities: bool| case.evaluate(s, local, sensitivities);
        segment_sums(&case.layout, &evaluate, self.theta, self.wanted, s)
    }
}

/// The integration steps to a sample beyond which the estimation of a segment has run away, from
/// those that it began with. A motion with a time constant below a thirtieth of a sample shows in no
/// sample; one that was there from the beginning may become somewhat faster.
fn furthest(first: usize) -> usize {
    first.max((4 * first).clamp(64, MOST_SUBSTEPS - 1))
}

/// What is sent with every call.
#[derive(Serialize, Deserialize)]
struct Packed<'a> {
    problem: Key,
    theta: Cow<'a, [f64]>,
    wanted: Wanted<'a>,
}

/// What a problem is made of.
#[derive(Serialize, Deserialize)]
struct Problem<'a> {
    model: Text,
    segments: Cow<'a, [Segment]>,
    settings: Cow<'a, Settings>,
    /// Not among the settings of a file.
    lines: IndexMap<String, Line>,
    used: Cow<'a, [usize]>,
    steps: Cow<'a, [usize]>,
}

impl Problem<'_> {
    fn case(self) -> Result<Case> {
        let model = self.model.compile().map_err(|e| Error::new(e.to_string()))?;
        let settings = Settings { lines: self.lines, ..self.settings.into_owned() };
        let prepared = Prepared::new(&model, &self.segments, &settings)
            .map_err(|e| Error::new(e.to_string()))?;
        if self.used.iter().any(|&s| !prepared.has_starts(s)) {
            return Err(Error::new("a segment of the problem cannot be used here"));
        }
        Ok(prepared.compiled().case_of(&self.used).with_steps(&self.steps))
    }
}

/// What a problem was made of, for a process that has to make it again.
pub struct Origin<'a> {
    model: &'a Model,
    segments: &'a [Segment],
    settings: &'a Settings,
    used: &'a [usize],
    /// Integration steps, and the key of the problem with them.
    key: Mutex<Option<(Vec<usize>, Key)>>,
}

impl<'a> Origin<'a> {
    /// `used`: indices of the segments that the problem is over.
    pub fn new(
        model: &'a Model,
        segments: &'a [Segment],
        settings: &'a Settings,
        used: &'a [usize],
    ) -> Origin<'a> {
        Origin { model, segments, settings, used, key: Mutex::new(None) }
    }

    /// The problem, its sums left to the engine.
    pub fn spread<'b>(&'b self, case: &'b Case, here: &'b Here<'b>) -> Spread<'b> {
        Spread { case, origin: self, here }
    }

    /// The key of the problem, which is put into the blobs where it is not there yet.
    fn key(&self, steps: &[usize], blobs: &dyn Blobs) -> Result<Key> {
        let mut known = self.key.lock().unwrap_or_else(|p| p.into_inner());
        if let Some((_, key)) = known.as_ref().filter(|(of, _)| of == steps) {
            return Ok(key.clone());
        }
        let text = self.model.recipe_text();
        let key = blobs.put(&encode(&Problem {
            model: text.ok_or_else(|| Error::new("this model was not compiled from text"))?,
            segments: Cow::Borrowed(self.segments),
            settings: Cow::Borrowed(self.settings),
            lines: self.settings.lines.clone(),
            used: Cow::Borrowed(self.used),
            steps: Cow::Borrowed(steps),
        })?)?;
        *known = Some((steps.to_vec(), key.clone()));
        Ok(key)
    }
}

/// A problem whose sums are left to an engine.
pub struct Spread<'a> {
    case: &'a Case,
    origin: &'a Origin<'a>,
    here: &'a Here<'a>,
}

impl Evaluate for Spread<'_> {
    fn blocks(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>> {
        self.case.evaluate(s, local, sensitivities)
    }

    /// `layout` differs from the case's own by starts and bounds only: its parts and its noise are
    /// what the sums are made of.
    fn sums(
        &self,
        _: &Layout,
        theta: &[f64],
        wanted: &Wanted,
        segments: Range<usize>,
    ) -> Vec<Option<SegmentSums>> {
        let at = At { case: self.case, theta, wanted, origin: Some(self.origin) };
        let items: Vec<usize> = segments.collect();
        // One segment is not worth the way.
        if let [s] = items[..] {
            return vec![at.here(s)];
        }
        let sums = engine::map::<NormalEquations>(self.here, &at, &items);
        let taken = |(sums, s): (Result<Option<SegmentSums>>, usize)| match sums {
            Ok(Some(sums)) if sums.are(wanted) => Some(sums),
            Ok(None) => None,
            // Not done, or the answer to another question.
            _ => at.here(s),
        };
        sums.into_iter().zip(items).map(taken).collect()
    }
}

impl Case {
    /// Solves with integration steps that stay the same during an iteration (a cost that changed
    /// its steps on the way would have jumps). They are chosen at the start; where what is found
    /// turns out to be stiffer, the estimation goes on from there with the steps that it asks for,
    /// or begins again where that cost was owed to the larger steps alone. Where a segment asks for
    /// motions that no sample shows (`furthest`), it has run away: a surface that stands on a stop
    /// which the model does not know looks as if it were held by a spring without limit.
    pub fn solve(&mut self, settings: &Settings, origin: &Origin, here: &Here) -> Solution {
        let known = Known {
            alike: self.alike(),
            limits: self.measured_limits(),
            densities: self.densities(),
        };
        let method = settings.method();
        let first = match self.is_filtered() {
            true => self.begun(self.layout.clone(), &origin.spread(self, here), settings),
            false => self.layout.clone(),
        };
        let mut changed = self.stiffen(&first.start);
        let furthest: Vec<usize> = self.steps().into_iter().map(furthest).collect();
        let mut fit = lowest(&first, &origin.spread(self, here), &method, &known);
        while changed && self.is_stiffer(&fit.theta) {
            changed = self.stiffen(&fit.theta);
            let evaluate = origin.spread(self, here);
            let cost = |theta: &[f64]| cost(&first, &evaluate, theta).unwrap_or(f64::INFINITY);
            let goes_on = cost(&fit.theta) < cost(&first.start);
            let far = |(steps, furthest): (usize, &usize)| steps > *furthest;
            if goes_on && self.steps().into_iter().zip(&furthest).any(far) {
                fit.stop = Stop::RunsAway;
                break;
            }
            let start = if goes_on { &fit.theta } else { &first.start }.clone();
            let layout = Layout { start, ..first.clone() };
            let further = lowest(&layout, &evaluate, &method, &known);
            fit = fit.then(further);
        }
        judged(&first, &origin.spread(self, here), settings, fit)
    }

    /// Whether a segment is stiffer there than its integration steps are made for.
    fn is_stiffer(&self, theta: &[f64]) -> bool {
        let stiffer =
            |s: usize| self.is_automatic(s) && self.substeps(s, theta) > self.records[s].substeps;
        (0..self.records.len()).any(stiffer)
    }

    /// The profiles that the settings ask for, and the upper limits of densities that are zero.
    pub fn profiles(
        &self,
        solution: &Solution,
        settings: &Settings,
        origin: &Origin,
        here: &Here,
    ) -> Vec<Profile> {
        let asked = |i: &usize| settings.profile.contains(&self.unknowns[*i].name);
        let which: Vec<usize> = (0..self.unknowns.len()).filter(asked).collect();
        let evaluate = origin.spread(self, here);
        let mut all = profiles(&self.layout, &evaluate, solution, &which, settings);
        let nothing = |i: &usize| solution.fit.held[*i] && solution.fit.theta[*i] == 0.0;
        let densities = self.densities().into_iter().filter(nothing);
        let densities: Vec<usize> = densities.filter(|_| solution.crlb.is_some()).collect();
        let limits = densities.into_iter().filter_map(|i| {
            let first = 0.1 * self.layout.start[i].abs();
            upper_limit(&self.layout, &evaluate, solution, (i, first), settings)
        });
        all.extend(limits);
        all
    }
}
