//! An equation and the values of its parameters come in; points of it with both bands go out.

use super::config::Config;
use super::values::Values;
use crate::dynamics::{Directions, Propagator, Record};
use crate::error::Result;
use crate::math::distribution::{INTERVAL_95, chi2_quantile};
use indexmap::IndexMap;

/// A point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub equation: usize,
    pub x: f64,
    pub value: f64,
    pub sd: f64,
    /// With the errors of assumed constants.
    pub sd_total: f64,
    /// Standard deviations from the curve to its simultaneous band.
    factor: f64,
}

impl Point {
    /// Ends of the interval that holds this point of the truth in 95 of 100 cases.
    pub fn pointwise(&self) -> [f64; 2] {
        [-INTERVAL_95, INTERVAL_95].map(|of| self.value + of * self.sd)
    }

    /// Ends of the band that holds the whole curve in 95 of 100 cases at least: Scheffe's, with as many degrees of freedom
    /// as parameters move it. `(c'(theta - theta_0))^2 <= c' C c (theta - theta_0)' C^-1 (theta - theta_0)` for every
    /// gradient `c` along the curve, and the second factor is chi-squared. Assumed constants are in it: it is what another
    /// source is held against.
    pub fn simultaneous(&self) -> [f64; 2] {
        [-self.factor, self.factor].map(|of| self.value + of * self.sd_total)
    }
}

/// All equations at the values `x` of the input along which they are drawn, `at` giving the others.
pub fn points(
    config: &Config,
    values: &Values,
    at: &IndexMap<String, f64>,
    x: &[f64],
) -> Result<Vec<Point>> {
    // A file may predict nothing under the conditions of one curve.
    if x.is_empty() {
        return Ok(Vec::new());
    }
    let (along, model) = (&config.settings.along, &config.model);
    let directions = Directions { parameters: values.estimated.clone(), starts: Vec::new() };
    let propagator = Propagator::new(model, directions)?;
    let (n, ny, nd) = (x.len(), model.outputs.len(), values.estimated.len());
    let input = |k: usize, name: &str| match name == along {
        true => x[k],
        false => at.get(name).copied().unwrap_or(0.0),
    };
    let row = |k: usize| model.inputs.iter().map(move |q| input(k, &q.name));
    let record =
        Record { dt: 1.0, n, inputs: (0..n).flat_map(row).collect(), ..Default::default() };
    let grid = propagator.run(&values.parameters, &[], &record, true);
    let slopes = |equation: usize, k: usize| &grid.dy[(k * ny + equation) * nd..][..nd];
    let mut points = Vec::new();
    for equation in 0..ny {
        let moves = |p: &usize| (0..n).any(|k| slopes(equation, k)[*p] != 0.0);
        let movers = (0..nd).filter(moves).count();
        let factor = if movers == 0 { 0.0 } else { chi2_quantile(0.95, movers as f64).sqrt() };
        points.extend((0..n).map(|k| {
            let variance = |of: &[f64]| quadratic(of, slopes(equation, k)).max(0.0);
            let (noise, assumed) = (variance(&values.covariance), variance(&values.assumed));
            Point {
                equation,
                x: x[k],
                value: grid.y[k * ny + equation],
                sd: noise.sqrt(),
                sd_total: (noise + assumed).sqrt(),
                factor,
            }
        }));
    }
    Ok(points)
}

/// `g' C g`
fn quadratic(covariance: &[f64], g: &[f64]) -> f64 {
    let rows = covariance.chunks_exact(g.len().max(1)).zip(g);
    rows.map(|(row, gi)| gi * row.iter().zip(g).map(|(c, gj)| c * gj).sum::<f64>()).sum()
}
