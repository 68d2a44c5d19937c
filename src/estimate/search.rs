//! A model with terms that it may have in; which of them its equations ask for, with the history of
//! the search, out.
//!
//! The candidates are parameters of the model that multiply their terms; a term that is not taken is
//! held at its start, which is zero as a rule. Each equation is searched by itself, from the terms
//! that are no candidates (`terms`).

use super::prepared::Prepared;
use super::regressors::Problem;
use super::terms::{Step, Sums};
use super::{Search, Segment, Settings};
use crate::error::Errors;
use crate::model::Model;
use crate::model::graph::Leaf;

/// What became of the candidates.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Searched {
    pub steps: Vec<Step>,
    /// Candidates that are taken.
    pub taken: Vec<String>,
    /// Name, unit and start of all.
    candidates: Vec<(String, String, f64)>,
}

impl Searched {
    /// The unit of a candidate.
    pub fn unit(&self, name: &str) -> &str {
        self.candidates.iter().find(|c| c.0 == name).map_or("", |c| &c.1)
    }

    /// Where a candidate is held that is not taken.
    pub fn start(&self, name: &str) -> f64 {
        self.candidates.iter().find(|c| c.0 == name).map_or(f64::NAN, |c| c.2)
    }
}

/// Searches the equations of a model over segments.
///
/// # Errors
/// As an estimation's.
pub(super) fn searched(
    model: &Model,
    segments: &[Segment],
    settings: &Settings,
) -> Result<Searched, Errors> {
    let prepared = Prepared::new(model, segments, settings)?;
    let case = prepared.compiled().case();
    let (problem, _) = Problem::new(&case, settings)?;
    let known = case.unknowns.iter().zip(&case.layout.start);
    let candidates = known.filter(|(u, _)| settings.candidates.contains(&u.name));
    let candidates = candidates.map(|(u, start)| (u.name.clone(), u.unit.clone(), *start));
    let mut all = Searched { candidates: candidates.collect(), ..Searched::default() };
    for equation in 0..problem.sides.len() {
        let sums = Sums::new(&problem, equation, settings);
        if sums.candidates.is_empty() {
            continue;
        }
        let found = match settings.search {
            Search::Orthogonal => sums.orthogonal(),
            _ => sums.stepwise(settings.limit_f),
        };
        all.steps.extend(found.0);
        all.taken.extend(found.1);
    }
    Ok(all)
}

/// What keeps candidates from being searched for: a sentence each. `outputs`: those that are
/// measured.
pub fn unsearchable(model: &Model, outputs: &[usize], settings: &Settings) -> Vec<String> {
    let mut graph = model.graph.clone();
    let rate = |i: usize| (format!("rate of {}", model.states[i].quantity.name), model.rates[i]);
    let output = |o: usize| (model.outputs[o].name.clone(), model.output_nodes[o]);
    let is_state = |o: usize| model.state(&model.outputs[o].name);
    let equations: Vec<_> =
        outputs.iter().map(|&o| is_state(o).map_or_else(|| output(o), rate)).collect();
    let candidate = |name: &str| settings.candidates.iter().any(|c| c == name);
    let mut faults = Vec::new();
    for name in &settings.candidates {
        let Some(p) = model.parameter(name) else { continue };
        let leaf = Leaf::Parameter(p);
        let mut has = equations.iter().filter(|(_, node)| graph.leaves(&[*node]).contains(&leaf));
        let names: Vec<&str> = has.by_ref().map(|(name, _)| name.as_str()).collect();
        match names[..] {
            [] => faults.push(format!("candidate \"{name}\" is in no equation that is measured")),
            [_] => {}
            _ => faults.push(format!(
                "candidate \"{name}\" is in several equations ({}), and each is searched by itself",
                names.join(", ")
            )),
        }
    }
    for (equation, node) in &equations {
        let leaves = graph.leaves(&[*node]);
        let of = |p: usize| Leaf::Parameter(p);
        let there: Vec<usize> =
            (0..model.parameters.len()).filter(|&p| leaves.contains(&of(p))).collect();
        let name = |p: usize| model.parameters[p].quantity.name.as_str();
        if !there.iter().any(|&p| candidate(name(p))) {
            continue;
        }
        let free = |p: &usize| !model.parameters[*p].fixed || candidate(name(*p));
        for &p in there.iter().filter(|p| free(p)) {
            let slope = graph.derivative(*node, of(p));
            let inside = graph.leaves(&[slope]);
            if there.iter().filter(|p| free(p)).any(|&p| inside.contains(&of(p))) {
                faults.push(format!(
                    "the equation \"{equation}\" is not linear in \"{}\", and a search needs that",
                    name(p)
                ));
            }
        }
    }
    faults
}
