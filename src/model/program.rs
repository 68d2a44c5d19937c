//! A flat list of operations from a graph, and the interpreter that runs it over lanes of `W` independent evaluations.
//!
//! Registers are `[f64; W]`: lane i of every register belongs to evaluation i (another segment, another time point). All lanes do the
//! same operations in the same order, so a result does not depend on `W`. Operations that depend on parameters alone are a prologue,
//! run once for many evaluations of the body.

use super::graph::{Graph, Leaf, Node, Op, View, apply, depends};
use super::tables::Tables;

/// Where the leaves of every program of a model stand in the register file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Layout {
    pub states: usize,
    pub inputs: usize,
    pub delayed: usize,
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
    pub fn time(&self) -> usize {
        self.delayed() + self.delayed
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
    pub fn is_empty(&self) -> bool {
        false
    }

    pub fn slot(&self, leaf: Leaf) -> usize {
        match leaf {
            Leaf::State(i) => i,
            Leaf::Input(i) => self.input() + i,
            Leaf::InputRate(i) => self.input_rate() + i,
            Leaf::Delayed(i) => self.delayed() + i,
            Leaf::Time => self.time(),
            Leaf::Parameter(i) => self.parameter() + i,
            Leaf::StartValue(i) => self.start_value() + i,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Instruction {
    op: Op,
    to: u32,
    a: u32,
    b: u32,
    c: u32,
}

/// A compiled list of operations with its outputs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Program {
    registers: usize,
    constants: Vec<(u32, f64)>,
    prologue: Vec<Instruction>,
    body: Vec<Instruction>,
    outputs: Vec<u32>,
}

impl Program {
    /// Lowers the nodes `outputs` of `graph`. Registers of temporaries are reused, so the register file stays in cache.
    pub fn lower(graph: &Graph, outputs: &[Node], layout: &Layout) -> Program {
        let mut wanted = vec![false; graph.len()];
        let mut stack: Vec<Node> = outputs.to_vec();
        while let Some(n) = stack.pop() {
            if std::mem::replace(&mut wanted[n as usize], true) {
                continue;
            }
            if let View::Op(_, a, b, c) = graph.view(n) {
                stack.extend([a, b, c]);
            }
        }
        let in_body = |n: Node| graph.depends(n) & depends::TRAJECTORY != 0;
        // the last operation of the body that reads a node
        let mut last = vec![0u32; graph.len()];
        for n in (0..graph.len() as Node).filter(|&n| wanted[n as usize] && in_body(n)) {
            if let View::Op(_, a, b, c) = graph.view(n) {
                for m in [a, b, c] {
                    last[m as usize] = n;
                }
            }
        }
        for &n in outputs {
            last[n as usize] = u32::MAX;
        }
        let mut program = Program { registers: layout.len(), ..Default::default() };
        let mut slot = vec![u32::MAX; graph.len()];
        let mut free: Vec<u32> = Vec::new();
        for n in (0..graph.len() as Node).filter(|&n| wanted[n as usize]) {
            match graph.view(n) {
                View::Leaf(leaf) => slot[n as usize] = layout.slot(leaf) as u32,
                View::Const(x) => {
                    slot[n as usize] = program.new_register();
                    program.constants.push((slot[n as usize], x));
                }
                View::Op(op, a, b, c) => {
                    let [sa, sb, sc] = [a, b, c].map(|m| slot[m as usize]);
                    if !in_body(n) {
                        let to = program.new_register();
                        program.prologue.push(Instruction { op, to, a: sa, b: sb, c: sc });
                        slot[n as usize] = to;
                        continue;
                    }
                    let mut released = Vec::new();
                    for m in [a, b, c] {
                        let temporary = matches!(graph.view(m), View::Op(..)) && in_body(m);
                        if temporary && last[m as usize] == n && !released.contains(&slot[m as usize]) {
                            released.push(slot[m as usize]);
                        }
                    }
                    free.extend(released);
                    let to = free.pop().unwrap_or_else(|| program.new_register());
                    program.body.push(Instruction { op, to, a: sa, b: sb, c: sc });
                    slot[n as usize] = to;
                }
            }
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
        for &(slot, x) in &self.constants {
            file[slot as usize] = [x; W];
        }
        file
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs.len()
    }

    /// Operations per evaluation (without the prologue).
    pub fn operations(&self) -> usize {
        self.body.len()
    }

    /// Runs what depends on parameters and start values alone. Call after setting those, before `run`.
    pub fn prepare<const W: usize>(&self, file: &mut [[f64; W]], tables: &Tables) {
        execute(&self.prologue, file, tables);
    }

    /// Runs the body. Call after setting states, inputs, delayed values and time.
    pub fn run<const W: usize>(&self, file: &mut [[f64; W]], tables: &Tables) {
        execute(&self.body, file, tables);
    }

    /// Output k of the last run.
    #[inline]
    pub fn output<'f, const W: usize>(&self, file: &'f [[f64; W]], k: usize) -> &'f [f64; W] {
        &file[self.outputs[k] as usize]
    }
}

/// Runs a list with the widest vectors this machine has. The same operations in the same order on every machine (nothing is fused), so
/// the width changes no bit.
fn execute<const W: usize>(list: &[Instruction], file: &mut [[f64; W]], tables: &Tables) {
    #[cfg(target_arch = "x86_64")]
    if W >= 4 && std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the feature was just found on this machine.
        return unsafe { execute_avx2(list, file, tables) };
    }
    execute_plain(list, file, tables)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn execute_avx2<const W: usize>(list: &[Instruction], file: &mut [[f64; W]], tables: &Tables) {
    execute_plain(list, file, tables)
}

#[inline(always)]
fn execute_plain<const W: usize>(list: &[Instruction], file: &mut [[f64; W]], tables: &Tables) {
    for i in list {
        let (a, b) = (file[i.a as usize], file[i.b as usize]);
        let mut out = [0.0; W];
        macro_rules! lanes {
            ($f:expr) => {
                for l in 0..W {
                    out[l] = $f(a[l], b[l]);
                }
            };
        }
        match i.op {
            Op::Add => lanes!(|x: f64, y: f64| x + y),
            Op::Sub => lanes!(|x: f64, y: f64| x - y),
            Op::Mul => lanes!(|x: f64, y: f64| x * y),
            Op::Div => lanes!(|x: f64, y: f64| x / y),
            Op::Neg => lanes!(|x: f64, _: f64| -x),
            Op::Sqrt => lanes!(|x: f64, _: f64| x.sqrt()),
            Op::Select => {
                let c = file[i.c as usize];
                for l in 0..W {
                    out[l] = if a[l] > 0.0 { b[l] } else { c[l] };
                }
            }
            Op::Table | Op::TableSlope => {
                for l in 0..W {
                    out[l] = tables.one(b[l], a[l], i.op == Op::TableSlope);
                }
            }
            Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY => {
                let c = file[i.c as usize];
                let part = [Op::Table2, Op::Table2SlopeX, Op::Table2SlopeY].iter().position(|&o| o == i.op).unwrap_or(0);
                for l in 0..W {
                    out[l] = tables.two(c[l], a[l], b[l])[part];
                }
            }
            op => {
                let c = file[i.c as usize];
                for l in 0..W {
                    out[l] = apply(op, a[l], b[l], c[l]);
                }
            }
        }
        file[i.to as usize] = out;
    }
}
