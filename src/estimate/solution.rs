//! A problem over segments in; estimates, both covariances, colour and rank verdict, all by
//! parameter index, out.

use super::colour::{Source, coloured};
use super::neighbours::{Known, lowest};
use super::rank::{Weak, judge};
use super::{By, Settings};
use crate::least_squares::{Arrow, Evaluate, Fit, Layout, Stop};
use crate::noise::Modelled;

/// What the noise of samples that states start at does.
#[derive(Debug, Clone, PartialEq)]
pub struct NoisyStarts {
    /// The states that start at a sample.
    pub states: Vec<String>,
    /// Parameters with the factor by which their sd are larger, those with the largest first.
    pub larger: Vec<(String, f64)>,
}

/// What an estimation yields before names are put to it.
#[derive(Debug, Clone)]
pub struct Solution {
    pub fit: Fit,
    /// Cramer-Rao covariance (blocks of `M^-1`); none unless converged.
    pub crlb: Option<Arrow>,
    /// The same with coloured residuals allowed for; none unless converged.
    pub covariance: Option<Arrow>,
    /// Colour per group of segments and output (`group * outputs + output`); empty unless
    /// converged.
    pub colour: Vec<Modelled>,
    /// Whether that colour and what the fit absorbed of it agree with each other.
    pub settled: bool,
    /// What noise of the samples that states start at adds to the covariance.
    pub noisy_starts: Option<NoisyStarts>,
    pub condition: f64,
    pub singular: bool,
    pub weak: Vec<Weak>,
}

impl Solution {
    /// `sd` and the Cramer-Rao bound of parameter `i`; none without a covariance, or on a bound.
    pub fn deviation(&self, i: usize) -> Option<(f64, f64)> {
        if self.fit.held.get(i).copied().unwrap_or(true) {
            return None;
        }
        Some((
            self.covariance.as_ref()?.variance(i)?.sqrt(),
            self.crlb.as_ref()?.variance(i)?.sqrt(),
        ))
    }
}

/// Estimates and judges.
pub fn solve<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    settings: &Settings,
    known: &Known,
) -> Solution {
    judged(layout, evaluate, settings, lowest(layout, evaluate, &settings.method(), known))
}

/// What a fit is worth. Not converged or singular: no covariance.
pub fn judged<F: Evaluate>(
    layout: &Layout,
    evaluate: &F,
    settings: &Settings,
    mut fit: Fit,
) -> Solution {
    let none = |fit| Solution {
        fit,
        crlb: None,
        covariance: None,
        colour: Vec::new(),
        settled: true,
        noisy_starts: None,
        condition: f64::NAN,
        singular: false,
        weak: Vec::new(),
    };
    let Some(mut matrix) = fit.matrix.clone() else { return none(fit) };
    let mut nothing = vec![0.0; layout.start.len()];
    for (i, _) in fit.held.iter().enumerate().filter(|(_, held)| **held) {
        matrix.pin(&mut nothing, i, 0.0);
    }
    let (condition, mut singular, weak) = judge(&matrix);
    // Nothing that could be held for the sake of others.
    singular |= !fit.idle.is_empty() && fit.idle.iter().all(|idle| *idle);
    if singular && fit.stop == Stop::Converged {
        fit.stop = Stop::Singular;
    }
    let singular = singular || fit.stop == Stop::Singular;
    let mut solution = Solution { condition, singular, weak, ..none(fit) };
    if solution.fit.stop == Stop::Converged {
        let fit = &solution.fit;
        let source = Source::new(layout, evaluate, &fit.theta);
        let exact = settings.by != By::EquationError;
        let colour = coloured(&source, &matrix, &fit.held, &fit.noise, (settings.colour(), exact));
        if let Some(colour) = colour {
            solution.crlb = Some(colour.crlb);
            solution.covariance = Some(colour.covariance);
            solution.colour = colour.models;
            solution.settled = colour.settled;
        }
    }
    solution
}
