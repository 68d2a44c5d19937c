//! A case and its solution in; the modes of the linearised model, with standard deviations, out.
//!
//! The state matrix is the compiled Jacobian of the rates at the start of a segment, where a maneuver
//! begins from a trimmed condition, with everything steady: rates of inputs are zero, delays have
//! passed, friction and stops do not act. An eigenvalue moves with a parameter by
//!
//! ```text
//! d lambda / d theta = w' (d A / d theta) v / (w' v)
//! ```
//!
//! with its left and right eigenvectors (Nelson 1976, Eq. 11), derivatives of the Jacobian being
//! exact; the covariance of the estimates, coloured residuals allowed for, does the rest.

use super::case::Case;
use super::solution::Solution;
use crate::least_squares::{Arrow, Part};
use crate::math::complex::Complex;
use crate::math::eigen::{Eigen, eigen};
use crate::model::graph::{Leaf, Node};
use crate::model::{Program, Scope};

/// A number with its standard deviation; NaN where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertain {
    pub value: f64,
    pub sd: f64,
}

/// One mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// The segment (index of the record); none where the modes of all are the same.
    pub segment: Option<usize>,
    /// From 1, the fastest first.
    pub number: usize,
    /// States that take part, the one that does most first.
    pub states: Vec<String>,
    /// Real part, and imaginary part (zero or positive), 1/s.
    pub real: Uncertain,
    pub imag: Uncertain,
    /// Undamped frequency, rad/s, damping ratio and period, s; NaN without an oscillation.
    pub frequency: Uncertain,
    pub damping: Uncertain,
    pub period: Uncertain,
    /// `-1/real`, s; negative where it grows.
    pub time_constant: Uncertain,
}

/// States that do less than this share of a mode are not named.
const SHARE: f64 = 0.1;

/// An eigenvalue below this share of the largest is zero (that of a state that is integrated and moves nothing),
/// and what is left of it rounding.
const ROUNDING: f64 = 1e-12;

/// The Jacobian of the rates and its derivatives.
struct Matrix {
    /// States of the motion.
    n: usize,
    program: Program,
    /// Row, column, output of the program.
    entries: Vec<(usize, usize, usize)>,
    /// Direction (free parameter), row, column, output.
    slopes: Vec<(usize, usize, usize, usize)>,
    /// Whether it differs between segments.
    varies: bool,
}

impl Case {
    /// The modes at a solution; none where there is nothing to linearise, or no covariance.
    pub fn modes(&self, solution: &Solution, used: &[usize]) -> Vec<Mode> {
        let Some(covariance) = solution.covariance.as_ref() else { return Vec::new() };
        if self.model.states.is_empty() || !self.chosen.lines.is_empty() {
            return Vec::new();
        }
        let matrix = self.matrix();
        let segments = if matrix.varies { self.records.len() } else { 1 };
        let mut all = Vec::new();
        for s in 0..segments.min(used.len()) {
            let segment = matrix.varies.then_some(used[s]);
            all.extend(self.modes_of(&matrix, covariance, &solution.fit.theta, (s, segment)));
        }
        all
    }

    fn matrix(&self) -> Matrix {
        let model = &self.model;
        let n = model.covariance.as_ref().map_or(model.states.len(), |c| c.motion);
        let mut graph = model.graph.clone();
        let mut known = model.steady(&mut graph);
        let zero = graph.c(0.0);
        known.extend((0..model.inputs.len()).map(|i| (Leaf::InputRate(i), zero)));
        let free = self.free();
        let mut nodes: Vec<Node> = Vec::new();
        let (mut entries, mut slopes) = (Vec::new(), Vec::new());
        for row in 0..n {
            let rate = graph.substitute(model.rates[row], &known);
            for column in 0..n {
                let entry = graph.derivative(rate, Leaf::State(column));
                if graph.constant(entry) == Some(0.0) {
                    continue;
                }
                entries.push((row, column, nodes.len()));
                nodes.push(entry);
                let leaves = graph.leaves(&[entry]);
                for (direction, &p) in free.iter().enumerate() {
                    if leaves.contains(&Leaf::Parameter(p)) {
                        let slope = graph.derivative(entry, Leaf::Parameter(p));
                        slopes.push((direction, row, column, nodes.len()));
                        nodes.push(slope);
                    }
                }
            }
        }
        let of: Vec<Node> = entries.iter().map(|(.., output)| nodes[*output]).collect();
        let differs = |leaf: &Leaf| match leaf {
            Leaf::Parameter(p) => free.contains(p) && self.chosen.scopes[*p] != Scope::Campaign,
            _ => true,
        };
        let varies = graph.leaves(&of).iter().any(differs);
        let program = Program::lower(&graph, &nodes, &model.layout);
        Matrix { n, program, entries, slopes, varies }
    }

    fn modes_of(
        &self,
        matrix: &Matrix,
        covariance: &Arrow,
        theta: &[f64],
        (s, segment): (usize, Option<usize>),
    ) -> Vec<Mode> {
        let (model, record, n) = (&self.model, &self.records[s], matrix.n);
        let (parameters, given) = self.place(s, &self.layout.local(s, theta));
        let start = self.propagator.start(&parameters, &given, record);
        let mut file = matrix.program.registers::<1>();
        let layout = model.layout;
        let inputs = record.inputs.iter().skip(record.start * layout.inputs).take(layout.inputs);
        start.iter().enumerate().for_each(|(i, x)| file[i] = [*x]);
        inputs.enumerate().for_each(|(j, u)| file[layout.input() + j] = [*u]);
        file[layout.time()] = [record.t0 + record.start as f64 * record.dt];
        parameters.iter().enumerate().for_each(|(p, v)| file[layout.parameter() + p] = [*v]);
        matrix.program.prepare(&mut file, &model.tables);
        matrix.program.run(&mut file, &model.tables);
        let value = |output: usize| matrix.program.output(&file, output)[0];
        let mut a = vec![0.0; n * n];
        matrix.entries.iter().for_each(|&(i, j, output)| a[i * n + j] = value(output));
        let part = &self.layout.parts[s];
        let directions = self.free().len();
        let sd = |slopes: &[f64]| variance(covariance, part, s, slopes).max(0.0).sqrt();
        let mode = |(k, e): (usize, Eigen)| {
            let joint = (0..n).fold(Complex::ZERO, |sum, i| sum.plus(e.left[i].by(e.right[i])));
            let mut slopes = [vec![0.0; directions], vec![0.0; directions]];
            for &(direction, i, j, output) in &matrix.slopes {
                let moved = e.left[i].by(e.right[j]).times(value(output)).over(joint);
                slopes[0][direction] += moved.re;
                slopes[1][direction] += moved.im;
            }
            let states = self.taking_part(&e, n);
            let [re, im] = &slopes;
            let of = |value: f64, d_re: f64, d_im: f64| {
                let along: Vec<f64> = re.iter().zip(im).map(|(a, b)| d_re * a + d_im * b).collect();
                Uncertain { value, sd: sd(&along) }
            };
            told(e.value, of, (segment, k + 1, states))
        };
        let mut found = eigen(&a, n).unwrap_or_default();
        let largest = found.iter().map(|e| e.value.abs()).fold(0.0, f64::max);
        for e in found.iter_mut().filter(|e| e.value.abs() <= ROUNDING * largest) {
            e.value = Complex::ZERO;
        }
        found.into_iter().enumerate().map(mode).collect()
    }

    /// States by their share of a mode (participation factors, Perez-Arriaga et al. 1982).
    fn taking_part(&self, e: &Eigen, n: usize) -> Vec<String> {
        let shares: Vec<f64> = (0..n).map(|i| e.left[i].by(e.right[i]).abs()).collect();
        let all: f64 = shares.iter().sum();
        let mut order: Vec<usize> = (0..n).filter(|&i| shares[i] >= SHARE * all).collect();
        order.sort_by(|&i, &j| shares[j].total_cmp(&shares[i]));
        order.into_iter().map(|i| self.model.states[i].quantity.name.clone()).collect()
    }
}

/// A mode from its eigenvalue; `of` makes a number with sd from a value and its slopes with respect
/// to real and imaginary part.
fn told(
    value: Complex,
    of: impl Fn(f64, f64, f64) -> Uncertain,
    (segment, number, states): (Option<usize>, usize, Vec<String>),
) -> Mode {
    let (a, b) = (value.re, value.im);
    let none = Uncertain { value: f64::NAN, sd: f64::NAN };
    let w = value.abs();
    let oscillates = b > 0.0;
    let when = |shown: bool, number: Uncertain| if shown { number } else { none };
    Mode {
        segment,
        number,
        states,
        real: of(a, 1.0, 0.0),
        imag: if oscillates { of(b, 0.0, 1.0) } else { Uncertain { value: 0.0, sd: f64::NAN } },
        frequency: when(oscillates, of(w, a / w, b / w)),
        // zeta = -a/w
        damping: when(oscillates, of(-a / w, -b * b / (w * w * w), a * b / (w * w * w))),
        period: when(
            oscillates,
            of(2.0 * std::f64::consts::PI / b, 0.0, -2.0 * std::f64::consts::PI / (b * b)),
        ),
        time_constant: when(a != 0.0, of(-1.0 / a, 1.0 / (a * a), 0.0)),
    }
}

/// `g' P g` over the free parameters of segment `s`, with `P` the covariance.
fn variance(covariance: &Arrow, part: &Part, s: usize, slopes: &[f64]) -> f64 {
    let mut all =
        vec![0.0; covariance.shared + covariance.own.iter().map(|own| own.n).sum::<usize>()];
    let before: usize = covariance.own[..s].iter().map(|own| own.n).sum();
    for (direction, slope) in slopes.iter().enumerate() {
        match part.shared.get(direction) {
            Some(&i) => all[i] += slope,
            None => all[covariance.shared + before + direction - part.shared.len()] += slope,
        }
    }
    covariance.quadratic(&all)
}
