//! A model with a `[trim]` section and inputs that are given in; the steady condition it asks for
//! out.

use crate::error::{Error, Result};
use crate::math::dense::solve;
use crate::model::graph::{Leaf, Node};
use crate::model::{Model, Program};

/// A steady condition: every state, input and parameter of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Steady {
    pub states: Vec<f64>,
    pub inputs: Vec<f64>,
    pub parameters: Vec<f64>,
}

/// Newton steps before the search is given up.
const MOST_STEPS: usize = 100;
/// A Newton step this small against the size of the unknowns ends the search.
const SMALL: f64 = 1e-11;

/// Solves `[trim]` for its free quantities: `inputs` are the values of all inputs (free ones: where
/// the search begins), states begin at their start values. A model without `[trim]` is in its start
/// condition.
///
/// Newton's method with exact derivatives; a step is shortened until the Newton correction at the
/// new point, with the old derivatives, is smaller than the step (the natural monotonicity test:
/// Deuflhard, Newton Methods for Nonlinear Problems, section 3.3).
///
/// # Errors
/// As many quantities must be free as have to vanish; the derivatives are singular; the search does
/// not converge.
pub fn trim(model: &Model, inputs: &[f64]) -> Result<Steady> {
    let parameters = model.parameter_starts();
    let states = start_states(model, inputs, &parameters)?;
    let mut steady = Steady { states, inputs: inputs.to_vec(), parameters };
    let n = model.trim.free.len();
    if n != model.trim.zero.len() {
        let what = format!(
            "{}: [trim] frees {n} quantities for {} that must vanish",
            model.name,
            model.trim.zero.len()
        );
        return Err(Error::new(what).help("free as many as must vanish"));
    }
    if n == 0 {
        return Ok(steady);
    }
    let mut search = Search::new(model);
    let mut z: Vec<f64> = model.trim.free.iter().map(|(_, leaf)| steady.get(*leaf)).collect();
    let size: Vec<f64> = z.iter().map(|x| x.abs().max(0.01)).collect();
    let norm = |step: &[f64]| step.iter().zip(&size).fold(0.0f64, |m, (d, s)| m.max((d / s).abs()));
    let mut damping = 1.0;
    for _ in 0..MOST_STEPS {
        let (residual, jacobian) = search.at(&steady);
        let newton = |r: &[f64]| scaled_solve(&jacobian, &size, r);
        let Some(step) = newton(&residual) else {
            return Err(singular(model, &steady, &jacobian, n));
        };
        let length = norm(&step);
        if length < SMALL {
            return Ok(steady);
        }
        loop {
            let trial: Vec<f64> = z.iter().zip(&step).map(|(x, d)| x + damping * d).collect();
            steady.set(model, &trial);
            let next = newton(&search.at(&steady).0).map_or(f64::NAN, |s| norm(&s));
            if next <= (1.0 - damping / 4.0) * length || (damping == 1.0 && next < SMALL) {
                z = trial;
                damping = f64::min(1.0, 2.0 * damping);
                break;
            }
            damping /= 2.0;
            if damping < 1e-6 {
                steady.set(model, &z);
                // Rounding alone can stop the last steps from shrinking.
                return if length < 1e-8 {
                    Ok(steady)
                } else {
                    Err(stuck(model, &steady, &residual))
                };
            }
        }
    }
    let residual = search.at(&steady).0;
    Err(stuck(model, &steady, &residual))
}

impl Steady {
    fn get(&self, leaf: Leaf) -> f64 {
        match leaf {
            Leaf::State(i) => self.states.get(i),
            Leaf::Input(i) => self.inputs.get(i),
            Leaf::Parameter(i) => self.parameters.get(i),
            _ => None,
        }
        .copied()
        .unwrap_or(0.0)
    }

    fn set(&mut self, model: &Model, values: &[f64]) {
        for ((_, leaf), value) in model.trim.free.iter().zip(values) {
            let slot = match leaf {
                Leaf::State(i) => self.states.get_mut(*i),
                Leaf::Input(i) => self.inputs.get_mut(*i),
                Leaf::Parameter(i) => self.parameters.get_mut(*i),
                _ => None,
            };
            if let Some(slot) = slot {
                *slot = *value;
            }
        }
    }
}

/// Start values of the states; one that starts "measured" begins at 0 (here nothing is measured).
fn start_states(model: &Model, inputs: &[f64], parameters: &[f64]) -> Result<Vec<f64>> {
    let starts = model.starts(&[], &[])?;
    let mut file = starts.program.registers::<1>();
    fill(&mut file, model, &[], inputs, parameters);
    starts.program.prepare(&mut file, &model.tables);
    starts.program.run(&mut file, &model.tables);
    Ok((0..model.states.len()).map(|i| starts.program.output(&file, i)[0]).collect())
}

fn fill(file: &mut [[f64; 1]], model: &Model, states: &[f64], inputs: &[f64], parameters: &[f64]) {
    let layout = &model.layout;
    for (first, values) in [(0, states), (layout.input(), inputs), (layout.parameter(), parameters)]
    {
        for (slot, value) in file.iter_mut().skip(first).zip(values) {
            *slot = [*value];
        }
    }
}

/// Residuals and their derivatives with respect to the free quantities.
struct Search<'m> {
    model: &'m Model,
    program: Program,
    file: Vec<[f64; 1]>,
}

impl<'m> Search<'m> {
    fn new(model: &'m Model) -> Self {
        let mut graph = model.graph.clone();
        // Steady: a delayed value is the present one, inputs do not change.
        let mut known = model.steady(&mut graph);
        let zero = graph.c(0.0);
        known.extend((0..model.inputs.len()).map(|i| (Leaf::InputRate(i), zero)));
        let mut nodes: Vec<Node> =
            model.trim.zero.iter().map(|(_, node)| graph.substitute(*node, &known)).collect();
        for row in nodes.clone() {
            nodes.extend(model.trim.free.iter().map(|(_, leaf)| graph.derivative(row, *leaf)));
        }
        let program = Program::lower(&graph, &nodes, &model.layout);
        let file = program.registers::<1>();
        Search { model, program, file }
    }

    /// Residuals `[n]` and Jacobian `[n][n]`.
    fn at(&mut self, steady: &Steady) -> (Vec<f64>, Vec<f64>) {
        fill(&mut self.file, self.model, &steady.states, &steady.inputs, &steady.parameters);
        self.program.prepare(&mut self.file, &self.model.tables);
        self.program.run(&mut self.file, &self.model.tables);
        let n = self.model.trim.zero.len();
        let value = |k: usize| self.program.output(&self.file, k)[0];
        ((0..n).map(value).collect(), (n..n + n * n).map(value).collect())
    }
}

/// The Newton step: solves `J step = -residual` with rows and columns brought to comparable sizes.
fn scaled_solve(jacobian: &[f64], size: &[f64], residual: &[f64]) -> Option<Vec<f64>> {
    let n = size.len();
    let mut a: Vec<f64> = jacobian.iter().enumerate().map(|(i, x)| x * size[i % n]).collect();
    let mut b: Vec<f64> = residual.iter().map(|r| -r).collect();
    for (row, b) in a.chunks_mut(n).zip(&mut b) {
        let largest = row.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if largest == 0.0 || !largest.is_finite() || !b.is_finite() {
            return None;
        }
        row.iter_mut().for_each(|x| *x /= largest);
        *b /= largest;
    }
    Some(solve(&a, n, &b)?.iter().zip(size).map(|(x, s)| x * s).collect())
}

fn state_of_search(model: &Model, steady: &Steady) -> String {
    let free: Vec<String> = model
        .trim
        .free
        .iter()
        .map(|(name, leaf)| format!("{name} = {:.6}", steady.get(*leaf)))
        .collect();
    format!("the search ended at {}", free.join(", "))
}

fn singular(model: &Model, steady: &Steady, jacobian: &[f64], n: usize) -> Error {
    let rows = (0..n).filter(|i| jacobian.iter().skip(i * n).take(n).all(|x| *x == 0.0));
    let columns = (0..n).filter(|j| jacobian.iter().skip(*j).step_by(n).all(|x| *x == 0.0));
    let mut why: Vec<String> =
        rows.map(|i| format!("\"{}\" depends on no free quantity", model.trim.zero[i].0)).collect();
    why.extend(columns.map(|j| format!("\"{}\" influences nothing", model.trim.free[j].0)));
    if why.is_empty() {
        why.push("the free quantities are not distinguishable".into());
    }
    Error::new(format!("{}: the trim is singular: {}", model.name, why.join("; ")))
        .help(state_of_search(model, steady))
}

fn stuck(model: &Model, steady: &Steady, residual: &[f64]) -> Error {
    let left: Vec<String> = model
        .trim
        .zero
        .iter()
        .zip(residual)
        .filter(|(_, r)| **r != 0.0)
        .map(|((name, _), r)| format!("{name} = {r:.3e}"))
        .collect();
    let what = format!(
        "{}: no steady condition was found; what should vanish is {}",
        model.name,
        left.join(", ")
    );
    Error::new(what).help(format!(
        "{}; give start values nearer to it, or look at the model's limits",
        state_of_search(model, steady)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Constants;

    fn model(trim: &str) -> Model {
        let text = format!(
            r#"
title = "Pendulum with a motor"
[inputs]
torque = "N m"
angle_cmd = "rad"
[parameters]
mgl = {{ unit = "N m", start = 2.0 }}
J = {{ unit = "kg m^2", start = 1.0 }}
[equations]
error = "angle_cmd - angle"
w_dot = "(torque - mgl*sin(delay(angle, 0.1*one_s)))/J"
[constants]
one_s = {{ unit = "s", value = 1.0 }}
[states]
angle = {{ unit = "rad", rate = "w", start = 0.1 }}
w = {{ unit = "rad/s", rate = "w_dot", start = 0.0 }}
[outputs]
angle = {{ unit = "rad", value = "angle" }}
{trim}
"#
        );
        Model::parse("pendulum", &text, &Constants::default()).unwrap()
    }

    #[test]
    fn a_steady_state_and_a_steady_input_are_found() {
        let state = model("[trim]\nfree = [\"angle\", \"w\"]\nzero = [\"w_dot\", \"rate(angle)\"]");
        let steady = trim(&state, &[1.5, 0.0]).unwrap();
        assert!((steady.states[0] - 0.75f64.asin()).abs() < 1e-12 && steady.states[1] == 0.0);
        let input =
            model("[trim]\nfree = [\"angle\", \"torque\"]\nzero = [\"rate(w)\", \"error\"]");
        let steady = trim(&input, &[0.0, 0.6]).unwrap();
        assert!(
            (steady.inputs[0] - 2.0 * 0.6f64.sin()).abs() < 1e-12
                && (steady.states[0] - 0.6).abs() < 1e-12
        );
    }

    #[test]
    fn what_cannot_be_trimmed_says_why() {
        let model = model("[trim]\nfree = [\"angle\", \"w\"]\nzero = [\"w_dot\", \"rate(angle)\"]");
        // 3 N m is more than the pendulum's largest moment.
        let error = trim(&model, &[3.0, 0.0]).unwrap_err();
        assert!(
            error.what.contains("no steady condition") && error.what.contains("w_dot"),
            "{error}"
        );
    }

    #[test]
    fn quantities_without_influence_are_named() {
        let model =
            model("[trim]\nfree = [\"angle\", \"torque\"]\nzero = [\"error\", \"rate(angle)\"]");
        let error = trim(&model, &[0.0, 0.0]).unwrap_err();
        assert!(error.what.contains("\"torque\" influences nothing"), "{error}");
        assert!(error.what.contains("\"rate(angle)\" depends on no free quantity"), "{error}");
    }
}
