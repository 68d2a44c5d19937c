//! A flat list of operations from a graph.
//!
//! Registers are `[f64; W]`: lane i of every register belongs to evaluation i (another segment,
//! another time point). All lanes do the same operations in the same order, so a result does not
//! depend on `W`. Operations that depend on parameters alone are a prologue, run once for many
//! evaluations of the body. `interpret` runs a list, `machine` makes machine code of it.

use std::collections::HashMap;

use super::graph::{Graph, Leaf, Node, Op, View, depends};
use super::instruction::{Code, Instruction};
use super::interpret::execute;
use super::tables::Tables;
use crate::math::simd::Width;

/// Where the leaves of every program of a model stand in the register file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Layout {
    pub states: usize,
    pub inputs: usize,
    pub delayed: usize,
    /// States that friction or a stop may hold.
    pub moving: usize,
    pub parameters: usize,
}

impl Layout {
    pub fn input(&self) -> usize {
        self.states
    }
    pub fn input_rate(&self) -> usize {
        self.input() + self.inputs
    }
    pub fn delayed(&self) -> usize {
        self.input_rate() + self.inputs
    }
    pub fn held(&self) -> usize {
        self.delayed() + self.delayed
    }
    pub fn side(&self) -> usize {
        self.held() + self.moving
    }
    pub fn time(&self) -> usize {
        self.side() + self.moving
    }
    pub fn parameter(&self) -> usize {
        self.time() + 1
    }
    /// Start values given from outside stand behind the parameters.
    pub fn start_value(&self) -> usize {
        self.parameter() + self.parameters
    }
    pub fn len(&self) -> usize {
        self.start_value() + self.states
    }

    pub fn slot(&self, leaf: Leaf) -> usize {
        match leaf {
            Leaf::State(i) => i,
            Leaf::Input(i) => self.input() + i,
            Leaf::InputRate(i) => self.input_rate() + i,
            Leaf::Delayed(i) => self.delayed() + i,
            Leaf::Held(k) => self.held() + k,
            Leaf::Side(k) => self.side() + k,
            Leaf::Time => self.time(),
            Leaf::Parameter(i) => self.parameter() + i,
            Leaf::StartValue(i) => self.start_value() + i,
        }
    }
}

/// A compiled list of operations with its outputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// All register numbers of the instructions are below this: what the interpreter's unchecked
    /// access relies on.
    registers: usize,
    constants: Vec<(u32, f64)>,
    prologue: Vec<Instruction>,
    body: Vec<Instruction>,
    outputs: Vec<u32>,
    /// Vectors the interpreter uses.
    width: Width,
}

impl Program {
    /// Lowers the nodes `outputs` of `graph`, depth first. Registers of temporaries are reused, so
    /// the register file stays in cache.
    pub fn lower(graph: &Graph, outputs: &[Node], layout: &Layout) -> Program {
        let order = ordered(graph, outputs);
        let in_body = |n: Node| graph.depends(n) & depends::TRAJECTORY != 0;
        // where in the order a node is read last
        let mut last = vec![0usize; graph.len()];
        for (at, &n) in order.iter().enumerate() {
            if let View::Op(_, a, b, c) = graph.view(n) {
                for m in [a, b, c] {
                    last[m as usize] = at;
                }
            }
        }
        for &n in outputs {
            last[n as usize] = usize::MAX;
        }
        let partners = partners(graph, &order);
        let mut program = Program {
            registers: layout.len(),
            constants: Vec::new(),
            prologue: Vec::new(),
            body: Vec::new(),
            outputs: Vec::new(),
            width: Width::detect(),
        };
        const NONE: u32 = u32::MAX;
        let mut slot = vec![NONE; graph.len()];
        let mut free: Vec<u32> = Vec::new();
        for (at, &n) in order.iter().enumerate() {
            let (op, a, b, c) = match graph.view(n) {
                View::Leaf(leaf) => {
                    slot[n as usize] = layout.slot(leaf) as u32;
                    continue;
                }
                View::Const(x) => {
                    slot[n as usize] = program.new_register();
                    program.constants.push((slot[n as usize], x));
                    continue;
                }
                View::Op(op, a, b, c) => (op, a, b, c),
            };
            let body = in_body(n);
            // a value without further readers leaves its register, and perhaps the result takes it
            if body {
                for (i, &m) in [a, b, c].iter().enumerate() {
                    let again = [a, b, c][..i].contains(&m);
                    if !again
                        && last[m as usize] == at
                        && in_body(m)
                        && matches!(graph.view(m), View::Op(..))
                    {
                        free.push(slot[m as usize]);
                    }
                }
            }
            if slot[n as usize] != NONE {
                continue; // came with its partner
            }
            let [sa, mut sb, sc] = [a, b, c].map(|m| slot[m as usize]);
            let mut take = |program: &mut Program| match free.pop() {
                Some(register) if body => register,
                other => {
                    free.extend(other);
                    program.new_register()
                }
            };
            let mut to = take(&mut program);
            slot[n as usize] = to;
            let mut code = Code::Op(op);
            if let Some(&partner) = partners.get(&n) {
                sb = take(&mut program);
                slot[partner as usize] = sb;
                code = Code::SinCos;
                if op == Op::Cos {
                    (to, sb) = (sb, to);
                }
            }
            let list = if body { &mut program.body } else { &mut program.prologue };
            list.push(Instruction { code, to, a: sa, b: sb, c: sc });
        }
        program.outputs = outputs.iter().map(|&n| slot[n as usize]).collect();
        program
    }

    fn new_register(&mut self) -> u32 {
        self.registers += 1;
        (self.registers - 1) as u32
    }

    /// A register file for this program with its constants set; leaves are for the caller to fill.
    pub fn registers<const W: usize>(&self) -> Vec<[f64; W]> {
        let mut file = vec![[0.0; W]; self.registers];
        self.constants_into(&mut file);
        file
    }

    /// Sets the constants of a register file.
    pub fn constants_into<const W: usize>(&self, file: &mut [[f64; W]]) {
        self.constants.iter().for_each(|&(slot, x)| file[slot as usize] = [x; W]);
    }

    /// Number of registers.
    pub fn file_len(&self) -> usize {
        self.registers
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs.len()
    }

    /// The register of output k.
    pub fn register(&self, k: usize) -> usize {
        self.outputs[k] as usize
    }

    /// Operations per evaluation (without the prologue).
    pub fn operations(&self) -> usize {
        self.body.len()
    }

    /// The operations of one evaluation.
    pub fn body(&self) -> &[Instruction] {
        &self.body
    }

    /// The operations that are run once for many evaluations.
    #[cfg(feature = "internals")]
    pub fn prologue(&self) -> &[Instruction] {
        &self.prologue
    }

    /// Registers that hold constants.
    pub fn constants(&self) -> &[(u32, f64)] {
        &self.constants
    }

    /// The registers below `n` that the body or an output reads, ascending.
    pub fn reads(&self, n: usize) -> Vec<usize> {
        let mut read = vec![false; n];
        let operands = self.body.iter().flat_map(|i| [i.a, i.b, i.c]);
        operands
            .chain(self.outputs.iter().copied())
            .filter(|&r| (r as usize) < n)
            .for_each(|r| read[r as usize] = true);
        (0..n).filter(|&r| read[r]).collect()
    }

    /// The same program run with other vectors than the widest (which changes no bit).
    #[cfg(feature = "internals")]
    pub fn with_width(mut self, width: Width) -> Program {
        if Width::available().contains(&width) {
            self.width = width;
        }
        self
    }

    /// Runs what depends on parameters and start values alone. Call after setting those, before
    /// `run`.
    pub fn prepare<const W: usize>(&self, file: &mut [[f64; W]], tables: &Tables) {
        self.execute(&self.prologue, file, tables);
    }

    /// Runs the body. Call after setting states, inputs, delayed values and time.
    #[inline]
    pub fn run<const W: usize>(&self, file: &mut [[f64; W]], tables: &Tables) {
        self.execute(&self.body, file, tables);
    }

    #[inline]
    fn execute<const W: usize>(
        &self,
        list: &[Instruction],
        file: &mut [[f64; W]],
        tables: &Tables,
    ) {
        assert!(file.len() >= self.registers, "a register file of another program");
        // SAFETY: the file holds all registers the lists name (they were numbered by `lower`, no
        // other code makes instructions), and the width is one of this machine's.
        unsafe { execute(self.width, list, file.as_mut_ptr(), tables) }
    }

    /// Output k of the last run.
    #[inline]
    pub fn output<'f, const W: usize>(&self, file: &'f [[f64; W]], k: usize) -> &'f [f64; W] {
        &file[self.outputs[k] as usize]
    }
}

/// The nodes that `outputs` need, operands before what reads them, depth first.
fn ordered(graph: &Graph, outputs: &[Node]) -> Vec<Node> {
    let mut order = Vec::new();
    // 0 not met, 1 waiting for its operands, 2 done
    let mut state = vec![0u8; graph.len()];
    let mut stack: Vec<Node> = Vec::new();
    for &root in outputs {
        stack.push(root);
        while let Some(&n) = stack.last() {
            let seen = state[n as usize];
            if seen == 0 {
                state[n as usize] = 1;
                if let View::Op(_, a, b, c) = graph.view(n) {
                    stack.extend([c, b, a].into_iter().filter(|&m| state[m as usize] == 0));
                }
                continue;
            }
            stack.pop();
            if seen == 1 {
                state[n as usize] = 2;
                order.push(n);
            }
        }
    }
    order
}

/// Sines and cosines that share their argument, each pointing at the other.
fn partners(graph: &Graph, order: &[Node]) -> HashMap<Node, Node> {
    let mut open: HashMap<Node, Node> = HashMap::new();
    let mut pairs = HashMap::new();
    for &n in order {
        if let View::Op(Op::Sin | Op::Cos, a, ..) = graph.view(n) {
            if let Some(&other) = open.get(&a) {
                pairs.insert(n, other);
                pairs.insert(other, n);
            }
            open.insert(a, n);
        }
    }
    pairs
}
