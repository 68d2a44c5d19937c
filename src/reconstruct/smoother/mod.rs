//! Logged signals of one flight and a kinematic model in; its smoothed path with covariances, and
//! how well everything fits, out.
//!
//! # The model
//!
//! What is smoothed is `z = (x, theta)`: the states of any kinematic model file and chosen
//! parameters of it (biases, scales, wind).
//!
//! ```text
//! dx/dt     = f(x, theta, u + e_u) + w_x        e_u: noise of the measured inputs, white
//! dtheta/dt = w_theta                           density 0: a constant, which is then estimated as such
//! y_j(t)    = g_j(x, theta, u) + e_j            every channel at its own time stamps
//! ```
//!
//! *Inputs* drive as they were logged, straight between their samples. White sample noise of
//! variance `s^2` every `T` seconds is the same to the states as a continuous one of density
//! `s^2 T`: over a step of `h` seconds an error of the input with variance `s^2 T/h`, which enters
//! through `Gamma = dx(t+h)/du`. *Walks* `w` have a density in unit^2/s (the settings give its
//! root).
//!
//! # The filter
//!
//! Steps end wherever something was measured: no common grid. The mean goes by the classic
//! Runge-Kutta; its exact derivatives `[Phi | Gamma]` by the same Runge-Kutta on `S' = A S + B`
//! with the model's compiled Jacobian. Measurements are processed one scalar at a time in Joseph's
//! form, which keeps the covariance symmetric and positive whatever is rounded (Bierman 1977; a
//! square-root form would double the digits at twice the cost, and with variances spread over 8
//! decades, as here, double precision has 8 to spare). Where the prior is wide (the start, the end
//! of a gap) an update is iterated to the mode of its posterior (Bell and Cathey 1993). Innovations
//! beyond the gate are rejected and counted.
//!
//! # The smoother
//!
//! The fixed-interval solution is the modified Bryson-Frazier recursion (Bierman 1973; see
//! `backward`): the same result as Rauch, Tung and Striebel's, without inverting predicted
//! covariances, which are singular for constant parameters. The filter runs forward once and leaves
//! a checkpoint every `sqrt(N)` nodes; backwards, each stretch is run again from its checkpoint
//! onto a tape that only holds one stretch. Memory grows with the square root of the length
//! (besides logs and results), and the bits are those of a tape of everything, which is what a run
//! has that is short enough.
//!
//! # Noise levels
//!
//! The noise of inputs comes from the signals themselves (third differences). The variances of the
//! channels and the walks of gusts start there and are improved by maximum likelihood on parts of
//! the flight: a variance is multiplied by `sum u^2 / sum d` of the disturbance smoother (de Jong
//! 1988), whose fixed point is a stationary point of the likelihood.
//!
//! # The start
//!
//! States start measured or as the model says, with wide standard deviations (by unit: 30 m/s, 1
//! rad, 5000 m). The first seconds are smoothed a few times, each time linearised about the last
//! result (Gauss-Newton, Bell 1994), before the flight is filtered.
//!
//! # Gaps
//!
//! In a gap of an input the model coasts on a straight line between the ends, with the noise of a
//! signal that may be anywhere within its usual spread. Longer than the limit of the settings,
//! there is no path: what follows starts anew.

pub mod backward;
pub mod filter;
pub mod flight;
pub mod grid;
pub mod kinematics;
pub mod levels;
mod local;
mod matrix;
pub mod state;
mod step;
pub mod sums;
pub mod tape;
#[cfg(test)]
pub mod tests;
mod update;

pub use local::unwrap;

use crate::signal::resample::Grid;
use backward::{Backward, Visit};
use filter::{Filter, Watch, programs};
use flight::Flight;
use grid::{Outputs, Sampler};
use kinematics::{Derivatives, Evaluator, Kinematics};
use levels::Levels;
use state::{About, State};
use sums::Sums;
use tape::{Scalar, Tape};

/// Seconds that are smoothed to find a start, and how often.
const START_S: f64 = 3.0;
const STARTS: usize = 4;
/// The first seconds are linearised about their smoothed means: until then sensor errors and states
/// are hardly distinguishable.
const FAR: f64 = 120.0;
/// A run whose tape is not larger is taped the first time, bytes.
const TAPE: usize = 32 << 20;

/// One flight ready to be smoothed.
pub struct Smoother<'a> {
    pub kinematics: &'a Kinematics<'a>,
    pub flight: &'a Flight,
    programs: Vec<Derivatives>,
    /// Gate of the innovations, standard deviations.
    pub gate: f64,
    /// Nodes between two checkpoints; 0: the square root of their number.
    pub stretch: usize,
}

/// What one run found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Smoothed {
    /// Smoothed mean at the first node and its covariance `[n][m]`.
    pub x: Vec<f64>,
    pub p: Vec<f64>,
    pub sums: Sums,
    /// False where the filter did not stay finite: there is no path.
    pub finite: bool,
}

impl From<Backward> for Smoothed {
    fn from(backward: Backward) -> Smoothed {
        Smoothed { x: backward.x, p: backward.p, sums: backward.sums, finite: true }
    }
}

/// Nothing is done at the nodes.
#[derive(Debug)]
pub struct Nothing;

impl Visit for Nothing {
    const NODES: bool = false;
    fn node(&mut self, _: &Tape, _: usize, _: &[f64], _: &[f64], _: &mut dyn FnMut(&mut Vec<f64>)) {
    }
}

/// Smoothed means, latest first.
#[derive(Debug, Default)]
struct Means(Vec<Vec<f64>>);

impl Means {
    /// `[node][n]`, in the order of time.
    pub fn ordered(mut self) -> Vec<f64> {
        self.0.reverse();
        self.0.concat()
    }
}

impl Visit for Means {
    fn node(&mut self, _: &Tape, _: usize, x: &[f64], _: &[f64], _: &mut dyn FnMut(&mut Vec<f64>)) {
        self.0.push(x.to_vec());
    }
}

impl<'a> Smoother<'a> {
    pub fn new(kinematics: &'a Kinematics<'a>, flight: &'a Flight, gate: f64) -> Smoother<'a> {
        Smoother { programs: programs(kinematics, flight), kinematics, flight, gate, stretch: 0 }
    }

    /// The same with another gate.
    pub fn with_gate(&self, gate: f64) -> Smoother<'a> {
        Smoother { gate, programs: self.programs.clone(), ..*self }
    }

    /// Mean to begin from at time `t`: a state that is measured from its first finite sample after
    /// it, another one from the expression of its start with the inputs there; 0 where there is
    /// neither.
    fn guess(&self, t: f64) -> Vec<f64> {
        let model = self.kinematics.model;
        let first = |name: &str| {
            let output = model.output(name)?;
            let number = self.flight.channels.iter().position(|c| c.output == output)?;
            let packet = self.flight.packets.iter().find(|p| p.channels.contains(&number))?;
            let from = packet.t.partition_point(|&x| x < t);
            self.flight.channels[number].z[from..].iter().copied().find(|z| z.is_finite())
        };
        let measured: Vec<Option<f64>> =
            model.states.iter().map(|s| first(&s.quantity.name)).collect();
        let mut evaluator: Evaluator<1> = Evaluator::new(model, &self.kinematics.starts);
        let (mut u, mut slope) = (vec![0.0; model.inputs.len()], vec![0.0; model.inputs.len()]);
        self.flight.inputs_at(t, &self.flight.locate(t), &mut u, &mut slope);
        let known: Vec<f64> = measured.iter().map(|z| z.unwrap_or(0.0)).collect();
        evaluator.point(0, &known, &u, &slope, t);
        evaluator.starts(0, &known);
        evaluator.run();
        let states =
            measured.iter().enumerate().map(|(i, z)| z.unwrap_or_else(|| evaluator.get(i, 0)));
        states.chain(self.kinematics.free.iter().map(|&i| model.parameters[i].start)).collect()
    }

    /// A mean near the truth at the start of `[from, to]`; `known` are parameters found elsewhere.
    pub fn begin(&self, levels: &Levels, [from, to]: [f64; 2], known: Option<&[f64]>) -> Vec<f64> {
        let mut x = self.guess(from);
        if let Some(known) = known {
            let nx = self.kinematics.states();
            x[nx..].copy_from_slice(&known[nx..]);
        }
        // nothing is rejected before the filter knows where it is
        let open = self.with_gate(f64::INFINITY);
        for _ in 0..STARTS {
            let smoothed =
                open.run(levels, [from, to.min(from + START_S)], &x, &mut (), &mut Nothing);
            if !smoothed.finite {
                break;
            }
            x = smoothed.x;
        }
        x
    }

    /// Where to linearise `[from, to]`: its first seconds about their smoothed means after `passes`
    /// more runs, each linearised about the last one's (Gauss-Newton: Bell 1994); nothing is
    /// rejected in the first, which does not know the sensor errors yet. It ends early where a run
    /// does not stay finite. Whether the first seconds are all there is comes along.
    pub fn about(
        &self,
        levels: &Levels,
        [from, to]: [f64; 2],
        x: &[f64],
        passes: usize,
    ) -> (Option<About>, bool) {
        let far = to.min(from + FAR);
        let open = self.with_gate(f64::INFINITY);
        let mut about: Option<About> = None;
        for pass in 0..=passes {
            let mut collected = Means::default();
            let smoother = if pass == 0 { &open } else { self };
            if !smoother
                .run_about(about.as_ref(), levels, [from, far], x, &mut (), &mut collected)
                .finite
            {
                break;
            }
            about = Some(About { means: collected.ordered(), known: Vec::new() });
        }
        if far < to {
            // the last step there ends where no other run has a node
            let two = 2 * self.kinematics.size();
            about
                .iter_mut()
                .for_each(|about| about.means.truncate(about.means.len().saturating_sub(two)));
        }
        (about, far >= to)
    }

    /// Smooths `[from, to]` from the mean `x` at `from`.
    pub fn run(
        &self,
        levels: &Levels,
        part: [f64; 2],
        x: &[f64],
        watch: &mut impl Watch,
        visit: &mut impl Visit,
    ) -> Smoothed {
        self.run_about(None, levels, part, x, watch, visit)
    }

    /// The same, linearised elsewhere.
    #[allow(clippy::too_many_arguments)]
    pub fn run_about<V: Visit>(
        &self,
        about: Option<&About>,
        levels: &Levels,
        part: [f64; 2],
        x: &[f64],
        watch: &mut impl Watch,
        visit: &mut V,
    ) -> Smoothed {
        let mut filter = self.filter(about, levels, part[1]);
        let (nodes, size) = (self.nodes(part), filter.size);
        let stretch = if self.stretch > 0 { self.stretch } else { nodes.isqrt().max(16) };
        let whole = self.stretch == 0 && nodes * Tape::bytes(V::NODES, size) <= TAPE;
        let mut tape = Tape::new(V::NODES, size, if whole { nodes } else { stretch.min(nodes) });
        let mut state = filter.start(part[0], x);
        let mut checkpoints = Vec::<State>::new();
        let mut count = 0;
        loop {
            if !whole && count % stretch == 0 {
                checkpoints.push(state.clone());
            }
            count += 1;
            if !filter.node(&mut state, whole.then_some(&mut tape), watch) {
                break;
            }
        }
        let mut backward = Backward::new(&filter);
        if !state.finite() {
            return Smoothed { finite: false, ..backward.into() };
        }
        if whole {
            backward.over(&tape, visit);
        }
        for checkpoint in checkpoints.into_iter().rev() {
            tape.clear();
            state = checkpoint;
            for _ in 0..stretch {
                if !filter.node(&mut state, Some(&mut tape), &mut ()) {
                    break;
                }
            }
            backward.over(&tape, visit);
        }
        backward.into()
    }

    /// What `part` says of the parameters (the states stand for nothing). Of constants a filter
    /// knows at the end what a smoother knows at the start: there is no pass back unless some of
    /// them drift.
    pub fn parameters(
        &self,
        about: Option<&About>,
        levels: &Levels,
        part: [f64; 2],
        x: &[f64],
    ) -> Smoothed {
        if levels.walk[self.kinematics.states()..].iter().any(|walk| *walk > 0.0) {
            return self.run_about(about, levels, part, x, &mut (), &mut Nothing);
        }
        let mut filter = self.filter(about, levels, part[1]);
        let mut state = filter.start(part[0], x);
        while filter.node(&mut state, None, &mut ()) {}
        let finite = state.finite();
        Smoothed { x: state.x, p: state.p.to_vec(), finite, ..Smoothed::default() }
    }

    fn filter<'f>(&'f self, about: Option<&'f About>, levels: &'f Levels, end: f64) -> Filter<'f> {
        let (kinematics, flight) = (self.kinematics, self.flight);
        let mut filter = Filter::new(kinematics, flight, &self.programs, levels, self.gate, end);
        filter.about = about;
        filter
    }

    /// The path on the points of a grid within `[from, to]`.
    #[allow(clippy::too_many_arguments)]
    pub fn path(
        &self,
        about: Option<&About>,
        levels: &Levels,
        [from, to]: [f64; 2],
        x: &[f64],
        (grid, every): (Grid, usize),
        watch: &mut impl Watch,
        out: &mut Outputs,
    ) -> Smoothed {
        let first = (0..grid.n).find(|&k| grid.time(k) >= from - flight::SAME).unwrap_or(grid.n);
        let last =
            (0..grid.n).rev().find(|&k| grid.time(k) <= to + flight::SAME).map_or(0, |k| k + 1);
        let mut sampler = Sampler::new(self.kinematics, self.flight, grid, every, out);
        let smoothed = self.run_about(about, levels, [from, to], x, watch, &mut sampler);
        sampler.finish(first, last.max(first));
        smoothed
    }

    /// About how many nodes there are between two times.
    fn nodes(&self, [from, to]: [f64; 2]) -> usize {
        let within = |t: &[f64]| {
            t.partition_point(|&x| x <= to).saturating_sub(t.partition_point(|&x| x < from))
        };
        let clocks =
            self.flight.clocks.iter().filter(|c| c.steps).map(|c| within(&c.t)).max().unwrap_or(0);
        clocks + self.flight.packets.iter().map(|p| within(&p.t)).sum::<usize>()
    }
}

/// Sums of the innovations per channel.
#[derive(Debug, Clone, Default)]
pub struct Innovations {
    pub channels: Vec<Innovation>,
}

/// Innovations of one channel, normalised by their predicted standard deviations.
#[derive(Debug, Clone, Default)]
pub struct Innovation {
    pub count: usize,
    pub rejected: usize,
    /// Sum of squares and of products at lags 1.. of the accepted ones.
    pub square: f64,
    pub lagged: Vec<f64>,
    recent: Vec<f64>,
}

/// Lags at which the innovations are correlated.
pub const LAGS: usize = 24;

impl Innovations {
    pub fn new(channels: usize) -> Innovations {
        let one =
            Innovation { lagged: vec![0.0; LAGS], recent: vec![0.0; LAGS], ..Default::default() };
        Innovations { channels: vec![one; channels] }
    }
}

impl Watch for Innovations {
    fn innovation(&mut self, _: f64, scalar: &Scalar, accepted: bool) {
        let c = &mut self.channels[scalar.channel];
        if !accepted {
            c.rejected += 1;
            return;
        }
        let e = scalar.nu / scalar.s.sqrt();
        c.square += e * e;
        for (lag, sum) in c.lagged.iter_mut().enumerate() {
            if c.count > lag {
                *sum += e * c.recent[(c.count - 1 - lag) % LAGS];
            }
        }
        c.recent[c.count % LAGS] = e;
        c.count += 1;
    }
}
