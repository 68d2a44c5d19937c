//! A compiled model in; the programs a smoother runs (rates, chosen outputs, their exact
//! derivatives) with their register files out.

use crate::dynamics::{AHEAD, Lead, WEIGHT};
use crate::error::{Error, Result};
use crate::math::simd::Width;
use crate::model::graph::{Leaf, Node};
use crate::model::machine::{Chain, Points};
use crate::model::{Model, Program, StartKind};
use std::sync::Arc;

/// Values of some nodes and their non-zero derivatives: the program's first outputs are the values,
/// the others the `entries`.
#[derive(Debug, Clone)]
pub struct Derivatives {
    pub program: Program,
    pub rows: usize,
    /// (row, column): the derivative of node `row` with respect to leaf `column`.
    pub entries: Vec<(usize, usize)>,
    /// The columns of the entries.
    pub columns: Vec<usize>,
}

impl Derivatives {
    /// `leaves` are the columns.
    pub fn new(model: &Model, nodes: &[Node], leaves: &[Leaf]) -> Derivatives {
        let mut graph = model.graph.clone();
        let (mut entries, mut all) = (Vec::new(), nodes.to_vec());
        for (row, &node) in nodes.iter().enumerate() {
            let present = graph.leaves(&[node]);
            for (column, leaf) in
                leaves.iter().enumerate().filter(|(_, leaf)| present.contains(leaf))
            {
                let d = graph.derivative(node, *leaf);
                if graph.constant(d) != Some(0.0) {
                    entries.push((row, column));
                    all.push(d);
                }
            }
        }
        Derivatives {
            program: Program::lower(&graph, &all, &model.layout),
            rows: nodes.len(),
            columns: entries.iter().map(|&(_, column)| column).collect(),
            entries,
        }
    }
}

/// A program and its register file for `W` points at a time.
#[derive(Debug, Clone)]
pub struct Evaluator<'m, const W: usize> {
    model: &'m Model,
    program: &'m Program,
    file: Vec<[f64; W]>,
    /// A parameter or a start value has changed since the prologue was run.
    stale: bool,
    /// Rates of a stage.
    rates: Vec<f64>,
}

impl<'m, const W: usize> Evaluator<'m, W> {
    /// All parameters at their start values.
    pub fn new(model: &'m Model, program: &'m Program) -> Self {
        let mut file = program.registers::<W>();
        for (i, p) in model.parameters.iter().enumerate() {
            file[model.layout.parameter() + i] = [p.start; W];
        }
        Evaluator { model, program, file, stale: true, rates: Vec::new() }
    }

    /// States, inputs and their time derivatives of one lane.
    #[inline]
    pub fn point(&mut self, lane: usize, x: &[f64], u: &[f64], slope: &[f64], time: f64) {
        let l = &self.model.layout;
        for (slot, x) in self.file.iter_mut().zip(x) {
            slot[lane] = *x;
        }
        for (slot, u) in self.file[l.input()..].iter_mut().zip(u) {
            slot[lane] = *u;
        }
        for (slot, s) in self.file[l.input_rate()..].iter_mut().zip(slope) {
            slot[lane] = *s;
        }
        self.file[l.time()][lane] = time;
    }

    /// Start values of the states given from outside.
    pub fn starts(&mut self, lane: usize, values: &[f64]) {
        for (slot, x) in self.file[self.model.layout.start_value()..].iter_mut().zip(values) {
            slot[lane] = *x;
        }
        self.stale = true;
    }

    /// Values of the parameters `free` in one lane.
    #[inline]
    pub fn parameters(&mut self, lane: usize, free: &[usize], values: &[f64]) {
        let first = self.model.layout.parameter();
        for (&i, v) in free.iter().zip(values) {
            let slot = &mut self.file[first + i][lane];
            self.stale |= *slot != *v;
            *slot = *v;
        }
    }

    /// Values of the parameters `free` in all lanes, which have never been given others.
    #[inline]
    pub fn parameters_of_all(&mut self, free: &[usize], values: &[f64]) {
        let first = self.model.layout.parameter();
        for (&i, v) in free.iter().zip(values) {
            let slot = &mut self.file[first + i];
            if slot[0] != *v {
                *slot = [*v; W];
                self.stale = true;
            }
        }
    }

    /// A point as the program's first registers have it: states, inputs, their rates and time.
    #[inline]
    pub fn registers(&mut self, lane: usize, point: &[f64]) {
        for (slot, value) in self.file.iter_mut().zip(point) {
            slot[lane] = *value;
        }
    }

    #[inline]
    pub fn run(&mut self) {
        self.prepare();
        self.program.run(&mut self.file, &self.model.tables);
    }

    #[inline]
    fn prepare(&mut self) {
        if std::mem::take(&mut self.stale) {
            self.program.prepare(&mut self.file, &self.model.tables);
        }
    }

    /// Output `k` of lane `lane`.
    #[inline]
    pub fn get(&self, k: usize, lane: usize) -> f64 {
        self.program.output(&self.file, k)[lane]
    }
}

impl Evaluator<'_, 1> {
    /// All outputs at `points` (rows of registers) into rows of `out`.
    pub fn at_each(&mut self, code: Option<&Points>, points: (&[f64], usize), out: &mut [f64]) {
        if let Some(code) = code {
            self.prepare();
            return code.run(&self.file, points.0, out, &self.model.tables);
        }
        let outputs = self.program.outputs();
        for (point, out) in points.0.chunks_exact(points.1).zip(out.chunks_exact_mut(outputs)) {
            self.registers(0, point);
            self.run();
            out.iter_mut().enumerate().for_each(|(k, out)| *out = self.get(k, 0));
        }
    }

    /// A Runge-Kutta step of `h` s (the program's outputs are the rates of `x`): `points` has a row
    /// of registers per stage, whose states are filled in; `sum` is scratch.
    pub fn step(
        &mut self,
        code: Option<&Chain>,
        points: &mut [f64],
        x: &mut [f64],
        sum: &mut [f64],
        h: f64,
    ) {
        if let Some(code) = code {
            self.prepare();
            let [a, b, c, d] = AHEAD.map(|ahead| ahead * h);
            let [p, q, r, s] = WEIGHT;
            let weights = [p, a, q, b, r, c, s, d, h / 6.0];
            return code.march(&self.file, points, x, &weights, &self.model.tables);
        }
        sum.fill(0.0);
        let (lead, width) = (Lead::new(), points.len() / 4);
        points[..x.len()].copy_from_slice(x);
        for stage in 0..4 {
            let (row, next) = points[stage * width..].split_at_mut(width);
            self.registers(0, row);
            self.run();
            let rates = (0..x.len()).map(|i| self.program.output(&self.file, i)[0]);
            self.rates.clear();
            self.rates.extend(rates);
            // the last stage leads to the end of the step only
            let next = &mut next[..if stage < 3 { x.len() } else { 0 }];
            lead.stage(&self.rates, [WEIGHT[stage], AHEAD[stage] * h], x, sum, next);
        }
        lead.end(sum, h, x);
    }
}

/// The programs of one model for one choice of free parameters and of inputs whose noise drives the
/// states.
#[derive(Debug, Clone)]
pub struct Kinematics<'m> {
    pub model: &'m Model,
    /// Indices of the parameters that are part of the smoothed vector, behind the states: first
    /// those that move the states.
    pub free: Vec<usize>,
    /// States and the parameters that move them.
    pub moving: usize,
    pub rates: Program,
    /// Runge-Kutta steps of the rates as machine code, where there is code for this machine.
    pub steps: Option<Arc<Chain>>,
    /// Start values of the states; measured ones are given from outside.
    pub starts: Program,
    /// d(rate)/d(states, free parameters, inputs).
    pub jacobian: Derivatives,
    /// The same at some points as machine code.
    pub slopes: Option<Arc<Points>>,
    /// All outputs.
    pub outputs: Program,
    /// All outputs and d(output)/d(states, free parameters, inputs, input rates).
    pub output_jacobian: Derivatives,
}

impl<'m> Kinematics<'m> {
    /// # Errors
    /// A model with delays: delayed states are not Markov. Known sensor delays belong in the time
    /// stamps.
    pub fn new(model: &'m Model, mut free: Vec<usize>) -> Result<Kinematics<'m>> {
        model.without_noise("the flight path")?;
        if !model.delays.is_empty() {
            return Err(Error::new(format!(
                "the smoother cannot run model {}: it has a delay()",
                model.name
            ))
            .help("put known sensor delays into the channel map, or use method = \"windows\""));
        }
        let moved = model.graph.leaves(&model.rates);
        let moves = |i: &usize| moved.contains(&Leaf::Parameter(*i));
        free.sort_by_key(|i| (!moves(i), *i));
        let moving = model.states.len() + free.iter().filter(|i| moves(i)).count();
        let mut columns: Vec<Leaf> = (0..model.states.len()).map(Leaf::State).collect();
        columns.extend(free.iter().map(|&i| Leaf::Parameter(i)));
        columns.extend((0..model.inputs.len()).map(Leaf::Input));
        let jacobian = Derivatives::new(model, &model.rates, &columns);
        let mut graph = model.graph.clone();
        let start = |(i, state): (usize, &crate::model::State)| match state.start {
            StartKind::Expression(node) => node,
            StartKind::Measured => graph.leaf(Leaf::StartValue(i)),
        };
        let starts: Vec<Node> = model.states.iter().enumerate().map(start).collect();
        columns.extend((0..model.inputs.len()).map(Leaf::InputRate));
        let rates = Derivatives::new(model, &model.rates, &[]).program;
        let (width, vectors) = (model.layout.time() + 1, Width::detect());
        Ok(Kinematics {
            steps: Chain::compile(&rates, width, vectors).map(Arc::new),
            slopes: Points::compile(&jacobian.program, width, vectors).map(Arc::new),
            rates,
            starts: Program::lower(&graph, &starts, &model.layout),
            jacobian,
            outputs: Derivatives::new(model, &model.output_nodes, &[]).program,
            output_jacobian: Derivatives::new(model, &model.output_nodes, &columns),
            model,
            free,
            moving,
        })
    }

    /// States of the model.
    pub fn states(&self) -> usize {
        self.model.states.len()
    }

    /// States and free parameters: what is smoothed.
    pub fn size(&self) -> usize {
        self.states() + self.free.len()
    }

    /// Where a state or a free parameter stands in what is smoothed.
    pub fn place(&self, name: &str) -> Option<usize> {
        let parameter =
            || self.free.iter().position(|&i| self.model.parameters[i].quantity.name == name);
        self.model.state(name).or_else(|| parameter().map(|k| self.states() + k))
    }

    /// The chosen outputs and their derivatives with respect to what is smoothed.
    pub fn measured(&self, outputs: &[usize]) -> Derivatives {
        let mut columns: Vec<Leaf> = (0..self.states()).map(Leaf::State).collect();
        columns.extend(self.free.iter().map(|&i| Leaf::Parameter(i)));
        let nodes: Vec<Node> = outputs.iter().map(|&k| self.model.output_nodes[k]).collect();
        Derivatives::new(self.model, &nodes, &columns)
    }
}
