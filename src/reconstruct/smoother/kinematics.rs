//! A compiled model in; the programs a smoother runs (rates, chosen outputs, their exact
//! derivatives) with their register files out.

use crate::error::{Error, Result};
use crate::model::graph::{Leaf, Node};
use crate::model::{Model, Program, StartKind};

/// Values of some nodes and their non-zero derivatives: the program's first outputs are the values,
/// the others the `entries`.
#[derive(Debug, Clone)]
pub struct Derivatives {
    pub program: Program,
    pub rows: usize,
    /// (row, column): the derivative of node `row` with respect to leaf `column`.
    pub entries: Vec<(usize, usize)>,
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
}

impl<'m, const W: usize> Evaluator<'m, W> {
    /// All parameters at their start values.
    pub fn new(model: &'m Model, program: &'m Program) -> Self {
        let mut file = program.registers::<W>();
        for (i, p) in model.parameters.iter().enumerate() {
            file[model.layout.parameter() + i] = [p.start; W];
        }
        Evaluator { model, program, file }
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
    }

    /// Values of the parameters `free` in one lane.
    #[inline]
    pub fn parameters(&mut self, lane: usize, free: &[usize], values: &[f64]) {
        let first = self.model.layout.parameter();
        for (&i, v) in free.iter().zip(values) {
            self.file[first + i][lane] = *v;
        }
    }

    #[inline]
    pub fn run(&mut self) {
        self.program.prepare(&mut self.file, &self.model.tables);
        self.program.run(&mut self.file, &self.model.tables);
    }

    /// Output `k` of all lanes.
    #[inline]
    pub fn lanes(&self, k: usize) -> [f64; W] {
        *self.program.output(&self.file, k)
    }

    /// Output `k` of lane `lane`.
    #[inline]
    pub fn get(&self, k: usize, lane: usize) -> f64 {
        self.program.output(&self.file, k)[lane]
    }
}

/// The programs of one model for one choice of free parameters and of inputs whose noise drives the
/// states.
#[derive(Debug, Clone)]
pub struct Kinematics<'m> {
    pub model: &'m Model,
    /// Indices of the parameters that are part of the smoothed vector, behind the states.
    pub free: Vec<usize>,
    pub rates: Program,
    /// Start values of the states; measured ones are given from outside.
    pub starts: Program,
    /// d(rate)/d(states, free parameters, inputs).
    pub jacobian: Derivatives,
    /// All outputs.
    pub outputs: Program,
    /// All outputs and d(output)/d(states, free parameters, inputs, input rates).
    pub output_jacobian: Derivatives,
    /// The inputs whose time derivative the model asks for.
    pub differentiated: Vec<bool>,
    /// The inputs that drive anything: others are read at the start alone.
    pub driving: Vec<bool>,
}

impl<'m> Kinematics<'m> {
    /// # Errors
    /// A model with delays: delayed states are not Markov. Known sensor delays belong in the time
    /// stamps.
    pub fn new(model: &'m Model, free: Vec<usize>) -> Result<Kinematics<'m>> {
        model.without_noise("the flight path")?;
        if !model.delays.is_empty() {
            return Err(Error::new(format!(
                "the smoother cannot run model {}: it has a delay()",
                model.name
            ))
            .help("put known sensor delays into the channel map, or use method = \"windows\""));
        }
        let nodes: Vec<Node> = model.rates.iter().chain(&model.output_nodes).copied().collect();
        let leaves = model.graph.leaves(&nodes);
        let differentiated =
            (0..model.inputs.len()).map(|i| leaves.contains(&Leaf::InputRate(i))).collect();
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
        Ok(Kinematics {
            rates: Derivatives::new(model, &model.rates, &[]).program,
            starts: Program::lower(&graph, &starts, &model.layout),
            jacobian,
            outputs: Derivatives::new(model, &model.output_nodes, &[]).program,
            output_jacobian: Derivatives::new(model, &model.output_nodes, &columns),
            differentiated,
            driving: (0..model.inputs.len())
                .map(|i| leaves.contains(&Leaf::Input(i)) || leaves.contains(&Leaf::InputRate(i)))
                .collect(),
            model,
            free,
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
