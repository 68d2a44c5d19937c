//! Records of maneuvers, of which columns were made by the model of `[derive]`, in; the same with what the
//! assumed constants of that model change of them, out.

use super::config::Config;
use super::names::Driver;
use super::ready::Ready;
use crate::dynamics::{Numbers, Record};
use crate::error::{Errors, Result};
use crate::estimate::Made;
use crate::model::graph::Leaf;
use crate::model::{Assumed, Model};
use crate::signal::resample::Grid;
use crate::stage::Inputs;
use crate::stage::derive::{self, looks_at_its_own_sample, outputs};
use std::collections::BTreeSet;

/// The share of its sd by which a constant is made larger: the change of a column is a line there.
const STEP: f64 = 0.01;
/// Points around a maneuver that its rates are taken from.
const AROUND: usize = 2;

/// A model that makes columns of an estimate's records, with assumed constants as parameters.
struct Making<'a> {
    model: Model,
    inputs: &'a [String],
    /// Each with its place among the parameters.
    constants: Vec<(Assumed, usize)>,
    /// What the estimate uses of its outputs.
    wanted: Vec<usize>,
}

/// Adds to each record what the constants change of it.
///
/// # Errors
/// A table that cannot be read.
pub fn add(
    config: &Config,
    derive: &derive::Config,
    inputs: &Inputs,
    ready: &mut [Ready],
) -> std::result::Result<(), Errors> {
    let Some(making) = Making::of(config, derive)? else { return Ok(()) };
    for of_flight in ready.chunk_by_mut(|a, b| a.flight == b.flight) {
        making.add(config, inputs, of_flight)?;
    }
    Ok(())
}

/// The model of the columns that an estimate uses, where it assumes constants: asked for every unit, without
/// looking which of them reach what is used.
pub fn model<'a>(config: &Config, derive: &'a derive::Config) -> Option<&'a Model> {
    let model = derive.model.as_ref()?;
    let is_assumed = model.constants.iter().any(|c| c.sd > 0.0);
    (is_assumed && !used(config, model).is_empty()).then_some(model)
}

/// The outputs of a model that are columns of an estimate.
fn used(config: &Config, model: &Model) -> Vec<usize> {
    let mut names: BTreeSet<String> = config.columns().into_iter().collect();
    names.extend(config.outputs.iter().map(|scored| scored.measured.clone()));
    (0..model.outputs.len()).filter(|&o| names.contains(&model.outputs[o].name)).collect()
}

impl<'a> Making<'a> {
    fn of(
        config: &Config,
        derive: &'a derive::Config,
    ) -> std::result::Result<Option<Making<'a>>, Errors> {
        let Some(model) = self::model(config, derive) else { return Ok(None) };
        // An input whose place an output of its name has taken is not there any more.
        let is_lost = derive.inputs.iter().any(|input| model.output(input).is_some());
        if is_lost {
            return Ok(None);
        }
        let model = model.opened()?;
        let wanted = used(config, &model);
        let mut nodes: Vec<_> = wanted.iter().map(|&o| model.output_nodes[o]).collect();
        nodes.extend(model.delays.iter().map(|delay| delay.tau));
        let leaves = model.graph.leaves(&nodes);
        let reaches = |c: &Assumed| {
            let at = model.parameter(&c.quantity.name)?;
            leaves.contains(&Leaf::Parameter(at)).then(|| (c.clone(), at))
        };
        let constants: Vec<(Assumed, usize)> =
            model.constants.iter().filter(|c| c.sd > 0.0).filter_map(reaches).collect();
        if wanted.is_empty() || constants.is_empty() {
            return Ok(None);
        }
        Ok(Some(Making { model, inputs: &derive.inputs, constants, wanted }))
    }

    /// The same for the maneuvers of one flight.
    fn add(&self, config: &Config, inputs: &Inputs, ready: &mut [Ready]) -> Result<()> {
        let Some(first) = ready.first() else { return Ok(()) };
        let Some(samples) = inputs.samples(&first.flight, self.inputs)? else { return Ok(()) };
        let t = samples.f64("t_s")?;
        let grid = Grid { t0: t[0], dt: t[1] - t[0], n: t.len() };
        let mut driving: Vec<Vec<f64>> = self
            .inputs
            .iter()
            .map(|name| Ok(samples.f64(name)?.to_vec()))
            .collect::<Result<_>>()?;
        if looks_at_its_own_sample(&self.model) {
            let mut is_flown = vec![false; grid.n];
            for one in ready.iter() {
                let from = place(&grid, one.labelled.record.t0);
                let to = (from + one.labelled.record.n + AROUND).min(grid.n);
                is_flown[from.saturating_sub(AROUND)..to].fill(true);
            }
            for column in &mut driving {
                column
                    .iter_mut()
                    .zip(&is_flown)
                    .filter(|(_, f)| !**f)
                    .for_each(|(x, _)| *x = f64::NAN);
            }
        }
        let driving: Vec<&[f64]> = driving.iter().map(Vec::as_slice).collect();
        for (constant, at) in &self.constants {
            let by = STEP * constant.sd;
            let mut parameters = self.model.parameter_starts();
            parameters[*at] += by;
            let columns = outputs(&self.model, &parameters, &driving, &grid)?;
            for one in ready.iter_mut() {
                let made = self.made(config, &one.labelled.record, (&grid, &columns));
                let (inputs, channels) = made;
                if !(inputs.is_empty() && channels.is_empty()) {
                    one.labelled.made.push(Made {
                        constant: constant.clone(),
                        by,
                        inputs,
                        channels,
                    });
                }
            }
        }
        Ok(())
    }

    /// The columns of a record that are others now.
    fn made(
        &self,
        config: &Config,
        record: &Record,
        (grid, columns): (&Grid, &[Vec<f64>]),
    ) -> Changed {
        let column = |name: &str| {
            let of = |o: &&usize| self.model.outputs[**o].name == name;
            self.wanted.iter().find(of).map(|&o| &columns[o][..])
        };
        let first = place(grid, record.t0);
        let nu = config.inputs.len();
        let mut inputs = Vec::new();
        for (j, driver) in config.inputs.iter().enumerate() {
            let Driver::Column(name) = driver else { continue };
            let Some(values) = column(name).and_then(|c| c.get(first..first + record.n)) else {
                continue;
            };
            if (0..record.n).any(|k| record.inputs[k * nu + j] != values[k]) {
                inputs.push((j, values.to_vec().into()));
            }
        }
        let mut channels = Vec::new();
        for (k, channel) in record.channels.iter().enumerate() {
            let scored = config.outputs.iter().find(|s| s.output == channel.output && !s.is_signal);
            let Some(values) = scored.and_then(|s| column(&s.measured)) else { continue };
            let at = |(t, z): (&f64, &f64)| if z.is_nan() { *z } else { values[place(grid, *t)] };
            let z: Vec<f64> = channel.t.iter().zip(channel.z.iter()).map(at).collect();
            if z.iter().zip(channel.z.iter()).any(|(a, b)| a != b && !b.is_nan()) {
                channels.push((k, z.into()));
            }
        }
        (inputs, channels)
    }
}

/// By input, and by channel.
type Changed = (Vec<(usize, Numbers)>, Vec<(usize, Numbers)>);

/// The point of the grid at a time.
fn place(grid: &Grid, t: f64) -> usize {
    (((t - grid.t0) / grid.dt).round().max(0.0) as usize).min(grid.n.saturating_sub(1))
}
