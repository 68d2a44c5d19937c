//! Which programs a trajectory needs: values alone, or values with exact Jacobians for chosen
//! directions.

use std::collections::BTreeMap;

use super::graph::{Graph, Leaf, Node, depends};
use super::program::Program;
use super::{Model, StartKind};
use crate::error::{Error, Result};

/// One non-zero entry of a Jacobian: row, column, number of the program's output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    pub row: usize,
    pub column: usize,
    pub output: usize,
}

/// A program computing the non-zero entries of a set of derivatives: `value = d(row)/d(column)`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sparse {
    /// With respect to states.
    pub states: Vec<Entry>,
    /// With respect to the free parameters (columns count directions).
    pub parameters: Vec<Entry>,
    /// With respect to delayed values.
    pub delayed: Vec<Entry>,
}

/// Programs for values and derivatives of one model and one choice of free parameters.
#[derive(Debug, Clone)]
pub struct Linear {
    /// Rates and their Jacobian entries.
    pub rates: Sparse,
    pub rates_program: Program,
    /// Jacobian entries of the outputs; rows count the chosen outputs.
    pub outputs: Sparse,
    pub outputs_program: Program,
    /// Delay times (first) and their Jacobian entries.
    pub delays: Sparse,
    pub delays_program: Program,
    /// Jacobian entries of the states' limits, row by row as in `Model::limits_program`.
    pub limits: Sparse,
    pub limits_program: Program,
    /// Jacobian entries of what would move the `Moving` states and of their frictions, in turn.
    pub moving: Sparse,
    pub moving_program: Program,
}

/// Start values as functions of parameters, inputs at the start and values given from outside.
#[derive(Debug, Clone)]
pub struct Starts {
    /// One output per state, then the derivative entries.
    pub program: Program,
    /// Columns count directions: free parameters first, then the given states in order.
    pub entries: Vec<Entry>,
    /// States whose start is given from outside (measured or free).
    pub given: Vec<usize>,
}

impl Model {
    /// Values of the rates.
    pub fn rates_program(&self) -> Program {
        Program::lower(&self.graph, &self.rates, &self.layout)
    }

    /// Values of the chosen outputs (indices).
    pub fn outputs_program(&self, outputs: &[usize]) -> Program {
        Program::lower(&self.graph, &self.chosen(outputs), &self.layout)
    }

    fn chosen(&self, outputs: &[usize]) -> Vec<Node> {
        outputs.iter().filter_map(|&k| self.output_nodes.get(k)).copied().collect()
    }

    /// Values of the delay times.
    pub fn delays_program(&self) -> Program {
        let taus: Vec<Node> = self.delays.iter().map(|d| d.tau).collect();
        Program::lower(&self.graph, &taus, &self.layout)
    }

    /// Values of the limits of the states: `min` and `max` of each state in turn, then how fast the
    /// stops of each may take it along (infinite where there is none).
    pub fn limits_program(&self) -> Program {
        let mut graph = self.graph.clone();
        let nodes = self.limit_nodes(&mut graph);
        Program::lower(&graph, &nodes, &self.layout)
    }

    fn limit_nodes(&self, graph: &mut Graph) -> Vec<Node> {
        let (low, high) = (graph.c(f64::NEG_INFINITY), graph.c(f64::INFINITY));
        let stops = self.states.iter().flat_map(|s| [s.min.unwrap_or(low), s.max.unwrap_or(high)]);
        let fastest = (0..self.states.len()).map(|i| self.taken_along(i).unwrap_or(high));
        stops.chain(fastest).collect()
    }

    /// How fast the stops of state i may take it along; none where they stand still, or do so as
    /// fast as they move.
    pub fn taken_along(&self, i: usize) -> Option<Node> {
        let state = &self.states[i];
        let moves = |node: Node| self.graph.depends(node) & depends::TRAJECTORY != 0;
        state.rate_max.filter(|_| [state.min, state.max].into_iter().flatten().any(moves))
    }

    /// States with limits in the order in which they are put on them, and where in it each level
    /// ends: limits of a level depend on the states of those before it at most. States whose limits
    /// depend on each other in a circle are left out.
    pub fn limited_in_order(&self) -> (Vec<usize>, Vec<usize>) {
        let of = |i: &usize| {
            let nodes = [self.states[*i].min, self.states[*i].max, self.states[*i].rate_max];
            self.graph.leaves(&nodes.into_iter().flatten().collect::<Vec<_>>())
        };
        let is_limited = |i: &usize| self.states[*i].min.or(self.states[*i].max).is_some();
        let mut left: Vec<usize> = (0..self.states.len()).filter(is_limited).collect();
        let (mut order, mut ends) = (Vec::new(), Vec::new());
        loop {
            let waits = |i: &usize| {
                of(i).iter().any(|leaf| matches!(leaf, Leaf::State(j) if left.contains(j)))
            };
            let (later, level): (Vec<usize>, Vec<usize>) = left.iter().partition(|i| waits(i));
            if level.is_empty() {
                return (order, ends);
            }
            order.extend(level);
            ends.push(order.len());
            left = later;
        }
    }

    /// Whether a limit depends on a delayed value.
    pub fn limits_are_late(&self) -> bool {
        let nodes: Vec<Node> = self.states.iter().flat_map(|s| [s.min, s.max]).flatten().collect();
        self.graph.leaves(&nodes).iter().any(|leaf| matches!(leaf, Leaf::Delayed(_)))
    }

    /// Whether a limit changes along a trajectory.
    pub fn limits_move(&self) -> bool {
        let nodes = self.states.iter().flat_map(|s| [s.min, s.max]).flatten();
        nodes.into_iter().any(|node| self.graph.depends(node) & depends::TRAJECTORY != 0)
    }

    /// Per `Moving` what its rate would be, and its friction (zero where it has none).
    pub fn moving_program(&self) -> Program {
        let mut graph = self.graph.clone();
        let nodes = self.moving_nodes(&mut graph);
        Program::lower(&graph, &nodes, &self.layout)
    }

    fn moving_nodes(&self, graph: &mut Graph) -> Vec<Node> {
        let nothing = graph.c(0.0);
        self.moving.iter().flat_map(|m| [m.free, m.friction.unwrap_or(nothing)]).collect()
    }

    /// The programs of the sensitivities of the chosen outputs with respect to `free` parameters
    /// (indices).
    pub fn linearize(&self, free: &[usize], outputs: &[usize]) -> Linear {
        let mut g = self.graph.clone();
        let taus: Vec<Node> = self.delays.iter().map(|d| d.tau).collect();
        let (rates, nodes) = self.sparse(&mut g, &self.rates, free, 0);
        let rates_program = Program::lower(&g, &nodes, &self.layout);
        let (outputs, nodes) = self.sparse(&mut g, &self.chosen(outputs), free, 0);
        let outputs_program = Program::lower(&g, &nodes, &self.layout);
        let (delays, nodes) = self.sparse(&mut g, &taus, free, taus.len());
        let delays_program = Program::lower(&g, &[&taus[..], &nodes].concat(), &self.layout);
        let bounds = self.limit_nodes(&mut g);
        let (limits, nodes) = self.sparse(&mut g, &bounds, free, 0);
        let limits_program = Program::lower(&g, &nodes, &self.layout);
        let pushes = self.moving_nodes(&mut g);
        let (moving, nodes) = self.sparse(&mut g, &pushes, free, 0);
        let moving_program = Program::lower(&g, &nodes, &self.layout);
        Linear {
            rates,
            rates_program,
            outputs,
            outputs_program,
            delays,
            delays_program,
            limits,
            limits_program,
            moving,
            moving_program,
        }
    }

    /// Values of `nodes` of a graph that has the model's leaves, and behind them their non-zero
    /// derivatives.
    pub fn differentiated(
        &self,
        g: &mut Graph,
        nodes: &[Node],
        free: &[usize],
    ) -> (Sparse, Program) {
        let (sparse, slopes) = self.sparse(g, nodes, free, nodes.len());
        (sparse, Program::lower(g, &[nodes, &slopes].concat(), &self.layout))
    }

    /// Non-zero derivatives of `rows`; outputs are numbered from `first`.
    fn sparse(
        &self,
        g: &mut Graph,
        rows: &[Node],
        free: &[usize],
        first: usize,
    ) -> (Sparse, Vec<Node>) {
        let (mut sparse, mut nodes) = (Sparse::default(), Vec::new());
        let present = |g: &Graph, row: Node| g.leaves(&[row]);
        for (row, &node) in rows.iter().enumerate() {
            let leaves = present(g, node);
            let mut put = |g: &mut Graph, leaf: Leaf, column: usize, list: &mut Vec<Entry>| {
                if !leaves.contains(&leaf) {
                    return;
                }
                let d = g.derivative(node, leaf);
                if g.constant(d) != Some(0.0) {
                    list.push(Entry { row, column, output: first + nodes.len() });
                    nodes.push(d);
                }
            };
            for i in 0..self.states.len() {
                put(g, Leaf::State(i), i, &mut sparse.states);
            }
            for (column, &p) in free.iter().enumerate() {
                put(g, Leaf::Parameter(p), column, &mut sparse.parameters);
            }
            for k in 0..self.delays.len() {
                put(g, Leaf::Delayed(k), k, &mut sparse.delayed);
            }
        }
        (sparse, nodes)
    }

    /// What stands for delayed values where nothing has changed for long: the present ones.
    pub fn steady(&self, graph: &mut Graph) -> BTreeMap<Leaf, Node> {
        self.delays
            .iter()
            .enumerate()
            .map(|(k, delay)| (Leaf::Delayed(k), graph.leaf(delay.of.now())))
            .collect()
    }

    /// The program of the start values. `given` states (ascending) start at values from outside,
    /// `free` parameters give directions.
    ///
    /// # Errors
    /// A start that depends on itself through other starts.
    pub fn starts(&self, given: &[usize], free: &[usize]) -> Result<Starts> {
        let mut g = self.graph.clone();
        let steady = self.steady(&mut g);
        let mut known: BTreeMap<Leaf, Node> = BTreeMap::new();
        for &i in given {
            let node = g.leaf(Leaf::StartValue(i));
            known.insert(Leaf::State(i), node);
        }
        // each round resolves every start whose states are all known
        loop {
            let open: Vec<usize> =
                (0..self.states.len()).filter(|&i| !known.contains_key(&Leaf::State(i))).collect();
            if open.is_empty() {
                break;
            }
            let mut progress = false;
            for i in open {
                let node = match self.states[i].start {
                    StartKind::Measured => g.leaf(Leaf::StartValue(i)),
                    StartKind::Expression(node) => {
                        let node = g.substitute(node, &steady);
                        let ready = g
                            .leaves(&[node])
                            .iter()
                            .all(|l| !matches!(l, Leaf::State(_)) || known.contains_key(l));
                        if !ready {
                            continue;
                        }
                        g.substitute(node, &known)
                    }
                };
                known.insert(Leaf::State(i), node);
                progress = true;
            }
            if !progress {
                let names: Vec<&str> = (0..self.states.len())
                    .filter(|&i| !known.contains_key(&Leaf::State(i)))
                    .map(|i| self.states[i].quantity.name.as_str())
                    .collect();
                return Err(Error::new(format!(
                    "model {}: the start values of {} depend on each other",
                    self.name,
                    names.join(", ")
                )));
            }
        }
        let starts: Vec<Node> = (0..self.states.len()).map(|i| known[&Leaf::State(i)]).collect();
        let given: Vec<usize> = (0..self.states.len())
            .filter(|i| given.contains(i) || self.states[*i].start == StartKind::Measured)
            .collect();
        let directions: Vec<Leaf> = free
            .iter()
            .map(|&p| Leaf::Parameter(p))
            .chain(given.iter().map(|&i| Leaf::StartValue(i)))
            .collect();
        let (mut entries, mut nodes) = (Vec::new(), starts.clone());
        for (row, &node) in starts.iter().enumerate() {
            for (column, &leaf) in directions.iter().enumerate() {
                let d = g.derivative(node, leaf);
                if g.constant(d) != Some(0.0) {
                    entries.push(Entry { row, column, output: nodes.len() });
                    nodes.push(d);
                }
            }
        }
        Ok(Starts { program: Program::lower(&g, &nodes, &self.layout), entries, given })
    }
}
