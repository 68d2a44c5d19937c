//! A case and values of its unknowns in; the residuals of a segment with their sensitivities, and what was
//! measured and modelled of it, out.

use super::Trace;
use super::case::{Case, PASSES};
use super::trace::Filtered;
use crate::dynamics::{Channel, Directions, Filter, Innovation, Propagator, Record, Tier};
use crate::least_squares::Block;

impl Case {
    /// Residuals per channel; a measurement that is not finite, or outside the grid, is masked.
    /// `None` where the model is not finite.
    pub fn evaluate(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>> {
        if let Some(filter) = &self.filter {
            return self.innovations(filter, s, local, sensitivities);
        }
        self.evaluate_as(&self.records[s], s, local, sensitivities)
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

    /// Residuals per channel of a record in the place of that of segment `s`, of a case without process noise.
    pub(super) fn evaluate_as(
        &self,
        record: &Record,
        s: usize,
        local: &[f64],
        sensitivities: bool,
    ) -> Option<Vec<Block>> {
        let (parameters, starts) = self.place(s, local);
        let of = (&parameters[..], &starts[..]);
        let mut blocks = self.from(&self.propagator, record, of, sensitivities)?;
        blocks.iter_mut().for_each(|b| b.g = self.with_slopes(s, std::mem::take(&mut b.g)));
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
        self.from(propagator, &self.records[s], (&parameters, &starts), sensitivities)
    }

    /// Residuals where a start value from outside (by its place) is so much larger.
    pub(super) fn started(
        &self,
        s: usize,
        local: &[f64],
        (place, by): (usize, f64),
    ) -> Option<Vec<Block>> {
        let (parameters, mut starts) = self.place(s, local);
        starts[place] += by;
        self.from(&self.propagator, &self.records[s], (&parameters, &starts), false)
    }

    fn from(
        &self,
        propagator: &Propagator,
        record: &Record,
        (parameters, starts): (&[f64], &[f64]),
        sensitivities: bool,
    ) -> Option<Vec<Block>> {
        let response = propagator.respond(parameters, starts, record, sensitivities);
        if !response.finite {
            return None;
        }
        let mut sensitivities = response.dy.into_iter();
        let channels = record.channels.iter().zip(response.y);
        let block = |(channel, mut e): (&Channel, Vec<f64>)| {
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
                noise: None,
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
}
