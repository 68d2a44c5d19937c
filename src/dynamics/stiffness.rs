//! How fast the fastest mode is: the spectral radius of the compiled Jacobian at a point, and the sub-steps it asks for.

use super::Record;
use super::evaluate::{Many, Single};
use super::plan::Plan;
use super::propagate::{MOST_SUBSTEPS, Run, STIFF, evaluate_starts};
use crate::model::Delayed;

pub struct Stiffness<'p> {
    plan: &'p Plan,
    jacobian: Many<'p>,
    entries: Vec<f64>,
}

impl<'p> Stiffness<'p> {
    pub fn new(plan: &'p Plan, parameters: &[f64]) -> Self {
        let program = &plan.linear.rates_program;
        Stiffness { plan, jacobian: Many::new(program, plan, parameters), entries: vec![0.0; program.outputs()] }
    }

    /// Sub-steps per grid step `dt` so that |lambda| h stays below the limit; more than the most allowed if it cannot.
    pub fn substeps(&mut self, point: &[f64], dt: f64) -> usize {
        let nx = self.plan.layout.states;
        self.jacobian.over(point, &mut self.entries);
        let mut a = vec![0.0; nx * nx];
        for e in &self.plan.linear.rates.states {
            a[e.row * nx + e.column] = self.entries[e.output];
        }
        let needed = spectral_radius(&a, nx) * dt / STIFF;
        if needed.is_nan() { 1 } else { (needed.ceil() as usize).clamp(1, MOST_SUBSTEPS + 1) }
    }
}

/// Integration steps per grid step: the largest that the Jacobian asks for at the start state over inputs along the record, and where each of them is
/// at its extremes: what is stiff only where an input has passed a threshold (the end of a play) shows there. A threshold between two states does
/// not.
pub fn substeps(plan: &Plan, parameters: &[f64], given: &[f64], record: &Record) -> usize {
    let n = record.n.saturating_sub(record.start);
    if n == 0 || record.inputs.len() < record.n * plan.layout.inputs {
        return 1;
    }
    let x = evaluate_starts(&plan.starts, plan.layout, &plan.tables, parameters, given, record);
    let mut taus = Single::new(&plan.delay_values, plan, parameters);
    let mut run = Run::new(plan, record, Vec::new(), &mut taus);
    let mut stiffness = Stiffness::new(plan, parameters);
    let mut most = 1;
    for k in looks(plan, record) {
        let chunk = run.at_rest(k, &x, &mut taus);
        most = most.max(stiffness.substeps(&chunk.points, record.dt));
        // a delayed state is read from finished steps where the delay is not absurdly short
        for (k, d) in plan.delays.iter().enumerate() {
            let tau = taus.get(k);
            if matches!(d.of, Delayed::State(_)) && tau > 0.0 {
                most = most.max(((record.dt / tau).ceil() as usize).min(16));
            }
        }
    }
    most.min(MOST_SUBSTEPS)
}

/// Grid points after the start: five along the record, and those with the least and the most of every input; each once.
fn looks(plan: &Plan, record: &Record) -> Vec<usize> {
    let (n, nu) = (record.n - record.start, plan.layout.inputs);
    let mut looks: Vec<usize> = (0..5).map(|i| i * (n - 1) / 4).collect();
    for input in 0..nu {
        let value = |k: &usize| record.inputs[(record.start + k) * nu + input];
        looks.extend((0..n).min_by(|a, b| value(a).total_cmp(&value(b))));
        looks.extend((0..n).max_by(|a, b| value(a).total_cmp(&value(b))));
    }
    looks.sort_unstable();
    looks.dedup();
    looks
}

/// Spectral radius by Gelfand's formula, |A^k|^(1/k), with k = 1024 by repeated squaring (scaled, so nothing overflows).
pub fn spectral_radius(a: &[f64], n: usize) -> f64 {
    let mut power = a.to_vec();
    let mut log_scale = 0.0;
    let mut exponent = 1.0;
    for _ in 0..10 {
        let norm = power.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        if norm == 0.0 {
            return 0.0;
        }
        if !norm.is_finite() {
            return f64::NAN;
        }
        for v in &mut power {
            *v /= norm;
        }
        // A^(2k) = (norm B)^2 = norm^2 B^2
        log_scale = 2.0 * (log_scale + libm::log(norm));
        exponent *= 2.0;
        let mut square = vec![0.0; n * n];
        for i in 0..n {
            for k in 0..n {
                let f = power[i * n + k];
                if f != 0.0 {
                    for j in 0..n {
                        square[i * n + j] += f * power[k * n + j];
                    }
                }
            }
        }
        power = square;
    }
    let norm = power.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    if norm == 0.0 { 0.0 } else { libm::exp((log_scale + libm::log(norm)) / exponent) }
}

#[cfg(test)]
mod tests {
    use super::spectral_radius;
    use crate::dynamics::{Directions, Plan, Record};
    use crate::model::{Constants, Model};

    /// A surface with play: nothing pushes it until the input has taken the play up, and then within 10 ms.
    const PLAY: &str = r#"title = "play"
[inputs]
de = "rad"
[parameters]
b = { unit = "rad", start = 0.02 }
[constants]
follow = { unit = "s", value = 0.01 }
[states]
z = { unit = "rad", rate = "deadband(de - z, b)/follow", start = "de" }
[outputs]
z = { unit = "rad", value = "z" }
"#;

    #[test]
    fn what_is_stiff_beyond_a_threshold_only_is_found_wherever_the_input_passes_it() {
        let model = Model::parse("play", PLAY, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
        let plan = Plan::new(&model, Directions::default()).expect("a plan");
        // Between the points that are looked at along the record.
        let inputs: Vec<f64> = (0..400).map(|k| if (130..150).contains(&k) { 0.05 } else { 0.0 }).collect();
        let record = Record { dt: 0.04, n: 400, inputs, ..Record::default() };
        let steps = plan.substeps(&model.parameter_starts(), &[], &record);
        assert!((8..=9).contains(&steps), "a rate of 100 1/s over 0.04 s, half of one in a step: {steps}");
        let grid = plan.run(&model.parameter_starts(), &[], &Record { substeps: steps, ..record }, false);
        assert!((grid.y[149] - 0.03).abs() < 1e-6 && (grid.y[399] - 0.02).abs() < 1e-6, "{} {}", grid.y[149], grid.y[399]);
    }

    #[test]
    fn the_spectral_radius_is_that_of_known_matrices() {
        // real -3, complex pair of modulus 5, a nilpotent block, badly scaled states
        let close = |a: &[f64], n: usize, r: f64| {
            let got = spectral_radius(a, n);
            assert!((got - r).abs() < 0.02 * r, "{got} instead of {r}");
        };
        close(&[-3.0, 1e4, 0.0, 1.0], 2, 3.0);
        close(&[0.0, 1.0, -25.0, -6.0], 2, 5.0);
        close(&[-2.0, 1e6, -1e-6, -2.0], 2, 5.0f64.sqrt());
        assert_eq!(spectral_radius(&[0.0, 1.0, 0.0, 0.0], 2), 0.0);
    }
}
