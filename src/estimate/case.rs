//! A model and the segments used in; the least-squares problem over them, its layout and its
//! solution, out.

use super::choice::Chosen;
use super::segment::{CAMPAIGN, Grouping, SEGMENT, Segment, instants};
use super::trace::Filtered;
use super::{Label, Line, NoiseKind, Settings, Trace};
use crate::dynamics::{Channel, Directions, Filter, Innovation, Lost, Propagator, Record, Tier};
use crate::error::Result;
use crate::least_squares::{Block, Layout, Part, Structure};
use crate::model::graph::Leaf;
use crate::model::{Model, Scope};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// A variance is never taken smaller than this share of the mean square of the measurements; the
/// second where outputs may be correlated, since a combination of outputs can vanish altogether.
const FLOOR: f64 = 1e-20;
const FLOOR_FULL: f64 = 1e-12;

/// Passes over the records that an estimation usually makes.
pub(super) const PASSES: usize = 20;

/// One unknown.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Unknown {
    pub name: String,
    pub unit: String,
    /// Place among the segments used.
    pub segment: Option<usize>,
    pub group: Option<Label>,
}

/// A propagator with fewer directions, made when it is first asked for; none where the model has none.
pub(super) type Narrow = Arc<OnceLock<Option<Propagator>>>;

/// The segments that are used together.
#[derive(Clone)]
pub struct Case {
    pub model: Arc<Model>,
    pub(super) chosen: Arc<Chosen>,
    pub propagator: Arc<Propagator>,
    /// The same with the directions of what belongs to a segment alone.
    pub(super) narrow: Narrow,
    /// Of a model whose states are driven by noise.
    filter: Option<Filter>,
    pub records: Vec<Record>,
    /// Which of them ask for integration steps by the model's fastest mode.
    automatic: Vec<bool>,
    /// Start values of the states that need one from outside, per segment.
    pub given: Vec<Vec<f64>>,
    /// Per segment how far its conditions are from the centres of the lines that parameters follow.
    away: Vec<Vec<f64>>,
    /// Scored outputs of the model.
    pub outputs: Vec<usize>,
    pub layout: Layout,
    /// In the order of the parameter vector.
    pub unknowns: Vec<Unknown>,
}

impl Case {
    /// `given`: start values of the states that the propagator wants from outside, per segment.
    pub fn new(
        model: Arc<Model>,
        chosen: Arc<Chosen>,
        propagator: Arc<Propagator>,
        segments: &[&Segment],
        given: Vec<Vec<f64>>,
        settings: &Settings,
    ) -> Case {
        let records: Vec<Record> = segments.iter().map(|s| s.scored()).collect();
        let automatic = records.iter().map(|r| r.substeps == 0).collect();
        let outputs = propagator.outputs.clone();
        let (layout, unknowns) =
            layout(&model, &propagator, (segments, &records), settings, &chosen, &given);
        let away = |s: &&Segment| {
            let of = |(_, line): &(usize, Line)| {
                s.conditions.get(&line.against).map_or(f64::NAN, |x| x - line.centre)
            };
            chosen.lines.iter().map(of).collect()
        };
        let away = segments.iter().map(away).collect();
        let mut case = Case {
            filter: Filter::new(&model, &propagator),
            model,
            chosen,
            propagator,
            narrow: Narrow::default(),
            records,
            automatic,
            given,
            away,
            outputs,
            layout,
            unknowns,
        };
        case.layout.squares = case.squares();
        case
    }

    /// Whether noise drives its states.
    pub(super) fn is_filtered(&self) -> bool {
        self.filter.is_some()
    }

    /// Free parameters of the model, in the order of a segment's directions.
    pub fn free(&self) -> Vec<usize> {
        self.chosen.shared.iter().chain(&self.chosen.own).copied().collect()
    }

    /// Places of parameters that are one and the same of different segments, where the model has
    /// friction: then the cost of a segment has several minima.
    pub fn alike(&self) -> Vec<Vec<usize>> {
        let mut all: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        if !self.model.moving.is_empty() {
            for (i, unknown) in self.unknowns.iter().enumerate() {
                if unknown.segment.is_some() {
                    all.entry(&unknown.name).or_default().push(i);
                }
            }
        }
        all.into_values().collect()
    }

    /// Places of the parameters that are nothing but densities of noise.
    pub fn densities(&self) -> Vec<usize> {
        let Some(covariance) = &self.model.covariance else { return Vec::new() };
        let (model, motion) = (&self.model, covariance.motion);
        let noise: Vec<_> = model.states[..motion].iter().filter_map(|s| s.noise).collect();
        let others = model.rates[..motion].iter().chain(&model.output_nodes).copied();
        let others = model.graph.leaves(&others.collect::<Vec<_>>());
        let of = |name: &str| model.parameter(name).map(Leaf::Parameter);
        let noise = model.graph.leaves(&noise);
        let is = |leaf: Leaf| noise.contains(&leaf) && !others.contains(&leaf);
        (0..self.unknowns.len()).filter(|&i| of(&self.unknowns[i].name).is_some_and(is)).collect()
    }

    /// Places of the parameters that act by their squares: densities, and what the noise of a filter's
    /// measurements is.
    fn squares(&self) -> Vec<usize> {
        let sds = self.model.covariance.iter().flat_map(|c| &c.sd).flatten();
        let names: Vec<&str> =
            sds.map(|&p| self.model.parameters[p].quantity.name.as_str()).collect();
        let sds = (0..self.unknowns.len()).filter(|&i| names.contains(&&*self.unknowns[i].name));
        let mut all: Vec<usize> = sds.chain(self.densities()).collect();
        all.sort_unstable();
        all
    }

    /// The integration steps of every segment.
    pub fn steps(&self) -> Vec<usize> {
        self.records.iter().map(|r| r.substeps).collect()
    }

    /// With these integration steps.
    pub fn with_steps(mut self, steps: &[usize]) -> Case {
        self.records.iter_mut().zip(steps).for_each(|(record, steps)| record.substeps = *steps);
        self
    }

    /// Whether the number of integration steps of segment `s` is left to the program.
    pub fn is_automatic(&self, s: usize) -> bool {
        self.automatic[s]
    }

    /// Raises the integration steps that are left to the program to what the model asks for at
    /// `theta`; whether any rose.
    pub fn stiffen(&mut self, theta: &[f64]) -> bool {
        let mut rose = false;
        for s in 0..self.records.len() {
            if self.automatic[s] {
                let steps = self.substeps(s, theta);
                rose |= steps > self.records[s].substeps;
                self.records[s].substeps = self.records[s].substeps.max(steps);
            }
        }
        rose
    }

    /// Integration steps per step of the grid that the model asks for in segment `s`.
    pub fn substeps(&self, s: usize, theta: &[f64]) -> usize {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        self.propagator.substeps(&parameters, &starts, &self.records[s])
    }

    /// Why the trajectory of segment `s` is given up, if it is.
    pub fn lost(&self, s: usize, theta: &[f64]) -> Option<Lost> {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        self.propagator.run(&parameters, &starts, &self.records[s], false).lost
    }

    /// States that friction holds all along segment `s`.
    pub fn stuck(&self, s: usize, theta: &[f64]) -> Vec<usize> {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        self.propagator.run(&parameters, &starts, &self.records[s], false).stuck
    }

    /// Residuals per channel; a measurement that is not finite, or outside the grid, is masked.
    /// `None` where the model is not finite.
    pub fn evaluate(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>> {
        if let Some(filter) = &self.filter {
            return self.innovations(filter, s, local, sensitivities);
        }
        let mut blocks = self.residuals(&self.propagator, s, local, sensitivities)?;
        blocks.iter_mut().for_each(|b| b.g = self.with_slopes(s, std::mem::take(&mut b.g)));
        Some(blocks)
    }

    /// The same with sensitivities to what belongs to the segment alone.
    pub fn evaluate_own(&self, s: usize, local: &[f64]) -> Option<Vec<Block>> {
        let made = || {
            let directions = Directions {
                parameters: self.chosen.own.clone(),
                starts: self.chosen.initial.clone(),
            };
            let narrow = Propagator::of_outputs(&self.model, directions, self.outputs.clone());
            let mut narrow = narrow.ok()?;
            if self.propagator.is_compiled() {
                let points = self.records.iter().map(|r| r.n).sum();
                narrow.compile(Tier::Auto, PASSES, points);
            }
            Some(narrow)
        };
        if let (None, Some(narrow)) = (&self.filter, self.narrow.get_or_init(made)) {
            return self.residuals(narrow, s, local, true);
        }
        let part = &self.layout.parts[s];
        let (shared, all) = (part.shared.len(), part.directions());
        let mut blocks = self.evaluate(s, local, true)?;
        for block in &mut blocks {
            block.g =
                block.g.chunks_exact(all.max(1)).flat_map(|row| row[shared..].to_vec()).collect();
        }
        Some(blocks)
    }

    /// Residuals per channel, with sensitivities to the propagator's directions.
    fn residuals(
        &self,
        propagator: &Propagator,
        s: usize,
        local: &[f64],
        sensitivities: bool,
    ) -> Option<Vec<Block>> {
        let (parameters, starts) = self.place(s, local);
        let response = propagator.respond(&parameters, &starts, &self.records[s], sensitivities);
        if !response.finite {
            return None;
        }
        let mut sensitivities = response.dy.into_iter();
        let channels = self.records[s].channels.iter().zip(response.y);
        let block = |(channel, mut e): (&crate::dynamics::Channel, Vec<f64>)| {
            let output = self.outputs.iter().position(|&o| o == channel.output)?;
            // what was predicted becomes the residual
            e.iter_mut()
                .zip(&channel.z)
                .for_each(|(e, z)| *e = if z.is_finite() { z - *e } else { f64::NAN });
            Some(Block::new(output, e, sensitivities.next().unwrap_or_default()))
        };
        channels.map(block).collect()
    }

    /// The innovations of a filter as rows of least squares. The likelihood's gradient is
    /// `sum (nu/s dnu + 1/2 (1 - nu^2/s) ds/s)`, its information `sum (dnu dnu'/s + 1/2 ds ds'/s^2)`
    /// (scoring): so each sample gives a row `(nu/sqrt(s), -dnu/sqrt(s))`, and another one
    /// `((nu^2/s - 1)/sqrt(2), ds/(s sqrt(2)))`, for which the cost takes `ln s`.
    fn innovations(
        &self,
        filter: &Filter,
        s: usize,
        local: &[f64],
        slopes: bool,
    ) -> Option<Vec<Block>> {
        let (parameters, starts) = self.place(s, local);
        let record = &self.records[s];
        let filtered = filter.run(&self.propagator, &parameters, &starts, record, slopes);
        if filtered.lost.is_some() {
            return None;
        }
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let mut blocks = Vec::with_capacity(2 * filtered.channels.len());
        for (channel, innovation) in record.channels.iter().zip(filtered.channels) {
            let output = self.outputs.iter().position(|&o| o == channel.output)?;
            let logs = innovation.s.iter().filter(|s| s.is_finite()).map(|s| libm::log(*s)).sum();
            let spread = innovation.e.iter().map(|e| half * (e * e - 1.0)).collect();
            let ds = innovation.ds.iter().map(|ds| half * ds).collect();
            blocks.push(Block::new(output, innovation.e, self.with_slopes(s, innovation.dy)));
            let spread = Block::new(output, spread, self.with_slopes(s, ds));
            blocks.push(Block { instead: Some(logs), ..spread });
        }
        Some(blocks)
    }

    /// Sensitivities with those to the slopes of lines behind those to the shared parameters: as
    /// those to the line's parameter, times how far the segment is from its centre.
    fn with_slopes(&self, s: usize, g: Vec<f64>) -> Vec<f64> {
        let lines = &self.chosen.lines;
        if lines.is_empty() || g.is_empty() {
            return g;
        }
        let (plain, shared) =
            (self.layout.parts[s].directions() - lines.len(), self.chosen.shared.len());
        let mut wide = Vec::with_capacity(g.len() / plain * (plain + lines.len()));
        for row in g.chunks_exact(plain) {
            wide.extend_from_slice(&row[..shared]);
            wide.extend(lines.iter().zip(&self.away[s]).map(|((at, _), away)| row[*at] * away));
            wide.extend_from_slice(&row[shared..]);
        }
        wide
    }

    /// Measured and modelled values of segment `s`.
    pub fn traces(&self, s: usize, theta: &[f64]) -> Vec<Trace> {
        let (parameters, starts) = self.place(s, &self.layout.local(s, theta));
        let record = &self.records[s];
        let simulated = self.propagator.respond(&parameters, &starts, record, false).y;
        let all: Vec<(Vec<f64>, Option<Filtered>)> = match &self.filter {
            Some(filter) => {
                let at = (&parameters[..], &starts[..]);
                let filtered = filter.run(&self.propagator, at.0, at.1, record, false).channels;
                let alone = filter.alone(&self.propagator, at.0, at.1, record).channels;
                let of = |((channel, simulated), (ahead, alone)): (
                    (&Channel, Vec<f64>),
                    (Innovation, Innovation),
                )| {
                    let noise = self.sensor_variance(channel, &parameters);
                    // Rounding may leave less than the noise; what is not known stays unknown.
                    let sd = |s: &f64| if *s < noise { 0.0 } else { (s - noise).sqrt() };
                    let simulated_sd = alone.s.iter().map(sd).collect();
                    let sd = ahead.s.iter().map(|s| s.sqrt()).collect();
                    (ahead.y, Some(Filtered { sd, simulated, simulated_sd }))
                };
                let channels = record.channels.iter().zip(simulated);
                channels.zip(filtered.into_iter().zip(alone)).map(of).collect()
            }
            None => simulated.into_iter().map(|y| (y, None)).collect(),
        };
        let channels = record.channels.iter().zip(all);
        let trace = |(channel, (modelled, filtered)): (&Channel, (Vec<f64>, Option<Filtered>))| {
            let quantity = self.model.outputs.get(channel.output)?;
            Some(Trace {
                output: channel.output,
                name: quantity.name.clone(),
                unit: quantity.unit.clone(),
                t: channel.t.clone(),
                measured: channel.z.clone(),
                modelled,
                filtered,
            })
        };
        channels.filter_map(trace).collect()
    }

    /// Variance of the noise of a channel, where it is a parameter; else none.
    fn sensor_variance(&self, channel: &Channel, parameters: &[f64]) -> f64 {
        let sd = self.model.covariance.as_ref().and_then(|c| c.sd[channel.output]);
        sd.map_or(0.0, |sd| parameters[sd] * parameters[sd])
    }

    /// Variance of the noise of output `j` (a place among the scored ones) in segment `s`, where it
    /// is a parameter.
    pub fn noise_variance(&self, j: usize, s: usize, theta: &[f64]) -> Option<f64> {
        let sd = self.model.covariance.as_ref()?.sd[self.outputs[j]]?;
        let (parameters, _) = self.place(s, &self.layout.local(s, theta));
        Some(parameters[sd] * parameters[sd])
    }

    /// A segment's directions back in the model: all parameters, and the start values from outside.
    pub fn place(&self, s: usize, local: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let chosen = &*self.chosen;
        let mut parameters = chosen.parameters.clone();
        let mut starts = self.given[s].clone();
        let mut values = local.iter().copied();
        for (&p, value) in chosen.shared.iter().zip(&mut values) {
            parameters[p] = value;
        }
        for (((at, _), away), slope) in chosen.lines.iter().zip(&self.away[s]).zip(&mut values) {
            parameters[chosen.shared[*at]] += slope * away;
        }
        for (&p, value) in chosen.own.iter().zip(&mut values) {
            parameters[p] = value;
        }
        for (state, start) in self.propagator.given().iter().zip(&mut starts) {
            if chosen.initial.contains(state) {
                *start = values.next().unwrap_or(*start);
            }
        }
        (parameters, starts)
    }

    /// Segments without which the parameters of a combination (indices) would not be: those of its
    /// groups and its own ones.
    pub fn segments_of(&self, parameters: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut found = Vec::new();
        for i in parameters {
            let sees = |part: &Part| {
                part.shared.contains(&i) || (part.offset..part.offset + part.own).contains(&i)
            };
            found.extend((0..self.layout.parts.len()).filter(|&s| sees(&self.layout.parts[s])));
        }
        found.sort_unstable();
        found.dedup();
        found
    }
}

/// The directions of a propagator: as `Case` wants them.
pub fn propagator(model: &Model, chosen: &Chosen, segments: &[Segment]) -> Result<Propagator> {
    let parameters = chosen.shared.iter().chain(&chosen.own).copied().collect();
    let outputs = scored(model, segments);
    Propagator::of_outputs(
        model,
        Directions { parameters, starts: chosen.initial.clone() },
        outputs,
    )
}

/// Model outputs measured in any record, ascending.
fn scored(model: &Model, segments: &[Segment]) -> Vec<usize> {
    let measured =
        |o: usize| segments.iter().any(|s| s.record.channels.iter().any(|c| c.output == o));
    (0..model.outputs.len()).filter(|&o| measured(o)).collect()
}

fn layout(
    model: &Model,
    propagator: &Propagator,
    (segments, scored): (&[&Segment], &[Record]),
    settings: &Settings,
    chosen: &Chosen,
    given: &[Vec<f64>],
) -> (Layout, Vec<Unknown>) {
    // Start, lower, upper, prior sd, centre of the prior of each unknown. A prior is the model's: where an
    // iteration starts says nothing about the parameter.
    let declared = model.parameter_starts();
    let bounds = |p: usize| {
        let q = &model.parameters[p];
        [
            chosen.parameters[p],
            q.min,
            q.max,
            if settings.priors { q.prior_sd } else { f64::INFINITY },
            declared[p],
        ]
    };
    let unknown = |p: usize, segment: Option<usize>, group: Option<Label>| {
        let q = &model.parameters[p].quantity;
        Unknown { name: q.name.clone(), unit: q.unit.clone(), segment, group }
    };
    let (mut values, mut unknowns) = (Vec::new(), Vec::new());
    let mut seen: Vec<Vec<usize>> = vec![Vec::new(); segments.len()];
    for &p in &chosen.shared {
        let column = match &chosen.scopes[p] {
            Scope::Column(column) => column,
            _ => CAMPAIGN,
        };
        let grouping = Grouping::by(column, segments);
        seen.iter_mut().zip(&grouping.of).for_each(|(seen, group)| seen.push(values.len() + group));
        // A campaign's value is there even without segments.
        let names = if column == CAMPAIGN {
            vec![None]
        } else {
            grouping.values.into_iter().map(Some).collect()
        };
        for value in names {
            values.push(bounds(p));
            unknowns.push(unknown(
                p,
                None,
                value.map(|value| Label { column: column.to_string(), value }),
            ));
        }
    }
    for (at, line) in &chosen.lines {
        let q = &model.parameters[chosen.shared[*at]].quantity;
        seen.iter_mut().for_each(|seen| seen.push(values.len()));
        values.push([0.0, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY, 0.0]);
        let (name, unit) = (line.slope(&q.name), line.slope_unit(&q.unit));
        unknowns.push(Unknown { name, unit, segment: None, group: None });
    }
    let shared = values.len();
    // What belongs to a segment is common to the stretches of one record, and stands among the
    // shared ones then.
    let mut own = |s: usize, place: Option<usize>, group: Option<Label>| {
        let from = values.len();
        values.extend(chosen.own.iter().map(|&p| bounds(p)));
        unknowns.extend(chosen.own.iter().map(|&p| unknown(p, place, group.clone())));
        for (state, value) in propagator
            .given()
            .iter()
            .zip(&given[s])
            .filter(|(state, _)| chosen.initial.contains(state))
        {
            let q = &model.states[*state].quantity;
            values.push([*value, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY, *value]);
            unknowns.push(Unknown {
                name: format!("{}(0)", q.name),
                unit: q.unit.clone(),
                segment: place,
                group: group.clone(),
            });
        }
        from..values.len()
    };
    let mut records: Vec<(&str, Range<usize>)> = Vec::new();
    for (s, stretch) in
        segments.iter().enumerate().filter_map(|(s, segment)| Some((s, segment.stretch.as_ref()?)))
    {
        let range = match records.iter().find(|(of, _)| *of == stretch.of) {
            Some((_, range)) => range.clone(),
            None => {
                let range = own(
                    s,
                    None,
                    Some(Label { column: SEGMENT.to_string(), value: stretch.of.clone() }),
                );
                records.push((&stretch.of, range.clone()));
                range
            }
        };
        seen[s].extend(range);
    }
    let shared = records.last().map_or(shared, |(_, range)| range.end);
    let noise = Grouping::by(&settings.noise_per, segments);
    let full = settings.noise == NoiseKind::Full;
    let mut parts = Vec::with_capacity(segments.len());
    for (s, segment) in segments.iter().enumerate() {
        let alone = segment.stretch.is_none();
        let range = if alone { own(s, Some(s), None) } else { shared..shared };
        let instants = if full { instants(&scored[s]) } else { Vec::new() };
        let shared = std::mem::take(&mut seen[s]);
        parts.push(Part {
            shared,
            offset: range.start,
            own: range.len(),
            group: noise.of[s],
            instants,
        });
    }
    let floor = propagator.outputs.iter().map(|&o| floor(model, segments, o, settings)).collect();
    let noise = Structure {
        outputs: propagator.outputs.len(),
        groups: noise.values.len().max(1),
        full,
        floor,
        known: model.covariance.is_some(),
    };
    let column = |k: usize| values.iter().map(|u| u[k]).collect();
    let mut start: Vec<f64> = column(0);
    for ((start, unknown), value) in start.iter_mut().zip(&unknowns).zip(&values) {
        if let Some(tried) = settings.tried.get(&unknown.name) {
            *start = tried.clamp(value[1], value[2]);
        }
    }
    (
        Layout {
            shared,
            parts,
            start,
            lower: column(1),
            upper: column(2),
            centre: column(4),
            prior_sd: column(3),
            squares: Vec::new(),
            noise,
        },
        unknowns,
    )
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
