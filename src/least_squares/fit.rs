//! Where an iteration ended: the point, its noise and normal matrix, and why.

use super::arrow::Arrow;
use super::covariance::Covariance;
use super::iteration::{Iteration, Stop};
use super::layout::Layout;
use super::method::{Method, Undetermined};
use super::point::{Point, idle};

/// Where the iteration ended.
#[derive(Debug, Clone)]
pub struct Fit {
    pub theta: Vec<f64>,
    pub stop: Stop,
    pub iterations: Vec<Iteration>,
    /// `R` per group of segments at `theta`; none where the model was not finite.
    pub noise: Vec<Covariance>,
    /// `ln|R|`; of several groups the mean, weighted with their samples.
    pub ln_det: f64,
    /// By how much a further step would lower the cost if that were a parabola; NaN where there is
    /// none.
    pub promise: f64,
    /// The normal matrix at `theta` with priors; none where the model was not finite or there was
    /// no data.
    pub matrix: Option<Arrow>,
    /// Parameters that sit on a bound and would leave it if they could, and those without effect.
    pub held: Vec<bool>,
    /// Common parameters that nothing shows at `theta` (`Undetermined::SetAside`).
    pub idle: Vec<bool>,
}

impl Fit {
    /// Negative log-likelihood at the end; NaN without one.
    pub fn cost(&self) -> f64 {
        self.iterations.last().map_or(f64::NAN, |i| i.cost)
    }

    /// A fit that went on from where this one ended, with the iterations of both.
    pub fn then(self, next: Fit) -> Fit {
        let before = self.iterations.len();
        let later = |i: Iteration| Iteration { iteration: before + i.iteration, ..i };
        let both = self.iterations.into_iter().chain(next.iterations.into_iter().map(later));
        Fit { iterations: both.collect(), ..next }
    }
}

pub fn failed(layout: &Layout, stop: Stop) -> Fit {
    Fit {
        theta: layout.start.clone(),
        stop,
        iterations: Vec::new(),
        noise: Vec::new(),
        ln_det: f64::NAN,
        promise: f64::NAN,
        matrix: None,
        held: vec![false; layout.start.len()],
        idle: vec![false; layout.start.len()],
    }
}

pub fn ended(
    layout: &Layout,
    method: &Method,
    point: Point,
    iterations: Vec<Iteration>,
    stop: Stop,
) -> Fit {
    let idle = match method.undetermined {
        Undetermined::SetAside => idle(layout, &point.matrix),
        _ => vec![false; point.theta.len()],
    };
    let held = point.held(layout).iter().zip(&idle).map(|(held, idle)| *held || *idle).collect();
    let promise = point.step(layout, method, None).map_or(f64::NAN, |step| point.promise(&step));
    let Point { theta, noise, ln_det, matrix, .. } = point;
    Fit {
        theta,
        stop,
        iterations,
        noise,
        ln_det,
        promise,
        matrix: (stop != Stop::NoData).then_some(matrix),
        held,
        idle,
    }
}
