//! Random programs in; the bits of the machine code beside the interpreter's, out.

use super::{Chain, LANES, Lanes, Points};
use crate::math::simd::Width;
use crate::model::graph::{Graph, Leaf, Node, Op};
use crate::model::program::{Layout, Program};
use crate::model::tables::{Table, Tables};

/// Numbers without a pattern.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n
    }

    /// Small as a rule, with zeros of both signs, and what is hard on sines.
    fn number(&mut self) -> f64 {
        let sign = if self.below(2) == 0 { 1.0 } else { -1.0 };
        sign * match self.below(40) {
            0 | 1 => 0.0,
            2 => 1e-310,
            3 => 1.3e5,
            4 => f64::INFINITY,
            5 => f64::NAN,
            6..10 => self.below(100_000) as f64,
            10..20 => self.below(1000) as f64 / 100.0,
            _ => self.below(1000) as f64 / 1500.0,
        }
    }
}

const LAYOUT: Layout = Layout { states: 5, inputs: 3, delayed: 2, moving: 0, parameters: 6 };

const OPS: &[(Op, usize)] = &[
    (Op::Add, 8),
    (Op::Sub, 5),
    (Op::Mul, 10),
    (Op::Div, 3),
    (Op::Neg, 1),
    (Op::Fma, 8),
    (Op::Fms, 4),
    (Op::Fnma, 4),
    (Op::Sqrt, 1),
    (Op::Sin, 3),
    (Op::Cos, 3),
    (Op::Tan, 1),
    (Op::Asin, 1),
    (Op::Acos, 1),
    (Op::Atan, 1),
    (Op::Atan2, 1),
    (Op::Exp, 1),
    (Op::Log, 1),
    (Op::Tanh, 1),
    (Op::Abs, 2),
    (Op::Sign, 2),
    (Op::Pow, 1),
    (Op::Min, 2),
    (Op::Max, 2),
    (Op::Select, 3),
    (Op::Table, 1),
    (Op::TableSlope, 1),
    (Op::Table2, 1),
    (Op::Table2SlopeX, 1),
    (Op::Table2SlopeY, 1),
];

fn tables() -> Tables {
    let one = Table { x: vec![-1.0, 0.0, 3.0], x2: vec![], y: vec![1.0, 3.0, 3.5] };
    let two = Table { x: vec![0.0, 2.0], x2: vec![0.0, 1.0], y: vec![0.0, 1.0, 4.0, 9.0] };
    Tables(vec![one, two])
}

/// `count` outputs of a graph with `n` operations.
fn program(random: &mut Random, n: usize, count: usize) -> Program {
    let mut g = Graph::default();
    let mut nodes: Vec<Node> = Vec::new();
    for i in 0..5 {
        let leaf = [Leaf::State(i), Leaf::Input(i % 3), Leaf::Delayed(i % 2), Leaf::Parameter(i)];
        nodes.extend(leaf.map(|leaf| g.leaf(leaf)));
    }
    for _ in 0..3 {
        let number = random.number();
        nodes.push(g.c(if number.is_nan() { 0.5 } else { number }));
    }
    let numbers = [0.0, 1.0].map(|x| g.c(x));
    // without calls, which empty all registers, more of them are wanted at once
    let most = if random.below(2) == 0 { OPS.len() } else { 9 };
    let kinds: Vec<Op> =
        OPS[..most].iter().flat_map(|&(op, often)| std::iter::repeat_n(op, often)).collect();
    // how often something old is read: many values wait then
    let old = random.below(5);
    for _ in 0..n {
        let op = kinds[random.below(kinds.len())];
        let [a, mut b, mut c] = [(); 3].map(|()| {
            let back = if random.below(4) < old { nodes.len() } else { nodes.len().min(12) };
            nodes[nodes.len() - 1 - random.below(back)]
        });
        match op {
            Op::Table | Op::TableSlope => b = numbers[0],
            Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY => c = numbers[1],
            Op::Fma | Op::Fms | Op::Fnma => {
                nodes.push(g.fused(op, a, b, c));
                continue;
            }
            _ => {}
        }
        nodes.push(g.op(op, a, b, c));
    }
    let outputs: Vec<Node> = (0..count).map(|_| nodes[random.below(nodes.len())]).collect();
    Program::lower(&g, &outputs, &LAYOUT)
}

/// The same bits, but for those of a NaN.
fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

#[test]
fn random_programs_have_the_interpreters_bits() {
    let (mut random, tables) = (Random(1), tables());
    for round in 0..600 {
        let n = 1 + random.below(if round % 10 == 0 { 400 } else { 60 });
        let count = 1 + random.below(40);
        let program = program(&mut random, n, count);
        let mut file = program.registers::<LANES>();
        for (slot, row) in file[..LAYOUT.len()].iter_mut().enumerate() {
            let common = random.number();
            let changes = slot < LAYOUT.parameter();
            *row = [(); LANES].map(|()| if changes { random.number() } else { common });
        }
        program.prepare(&mut file, &tables);
        let before = file.clone();
        program.run(&mut file, &tables);
        for &width in &Width::available()[1..] {
            let lanes = Lanes::compile(&program, width).expect("code for this machine");
            let mut ours = before.clone();
            lanes.run(&mut ours, &tables);
            for k in 0..program.outputs() {
                let (got, want) = (program.output(&ours, k), program.output(&file, k));
                for (got, want) in got.iter().zip(want) {
                    assert!(same(*got, *want), "{round}, {width:?}, {k}: {got:e}, not {want:e}");
                }
            }
        }
    }
}

/// Steps by the interpreter, as `dynamics` does them.
fn by_interpreter(
    program: &Program,
    file: &mut [[f64; 1]],
    points: &mut [f64],
    x: &mut [f64],
    (weights, tables): (&[f64; 9], &Tables),
) {
    for step in points.chunks_exact_mut(4 * WIDTH) {
        let (mut at, mut sum) = (x.to_vec(), vec![0.0; x.len()]);
        for (stage, row) in step.chunks_exact_mut(WIDTH).enumerate() {
            row[..x.len()].copy_from_slice(&at);
            file.iter_mut().zip(row.iter()).for_each(|(slot, x)| *slot = [*x]);
            program.run(file, tables);
            for k in 0..x.len() {
                let rate = program.output(file, k)[0];
                at[k] = weights[2 * stage + 1].mul_add(rate, x[k]);
                sum[k] = weights[2 * stage].mul_add(rate, sum[k]);
            }
        }
        x.iter_mut().zip(&sum).for_each(|(x, sum)| *x = weights[8].mul_add(*sum, *x));
    }
}

const WIDTH: usize = 14;

#[test]
fn random_rates_lead_to_the_interpreters_bits() {
    assert_eq!(LAYOUT.time() + 1, WIDTH);
    let (mut random, tables) = (Random(2), tables());
    let h = 0.01;
    let weights = [1.0, 0.5 * h, 2.0, 0.5 * h, 2.0, h, 1.0, 0.0, h / 6.0];
    for round in 0..600 {
        let n = 1 + random.below(if round % 10 == 0 { 400 } else { 60 });
        let program = program(&mut random, n, LAYOUT.states);
        let mut file = program.registers::<1>();
        file[LAYOUT.parameter()..LAYOUT.len()].iter_mut().for_each(|p| *p = [random.number()]);
        program.prepare(&mut file, &tables);
        let steps = 1 + random.below(4);
        let points: Vec<f64> = (0..steps * 4 * WIDTH).map(|_| random.number()).collect();
        let x: Vec<f64> = (0..LAYOUT.states).map(|_| random.number()).collect();
        let mut ours = (points.clone(), x.clone());
        let mut want = (points, x);
        let chain = Chain::compile(&program, WIDTH, Width::detect()).expect("code");
        chain.march(&file, &mut ours.0, &mut ours.1, &weights, &tables);
        by_interpreter(&program, &mut file, &mut want.0, &mut want.1, (&weights, &tables));
        for (got, want) in [(ours.0, want.0), (ours.1, want.1)] {
            for (k, (got, want)) in got.iter().zip(&want).enumerate() {
                assert!(same(*got, *want), "program {round}, {k}: {got:e}, interpreter {want:e}");
            }
        }
    }
}

#[test]
fn at_single_points_they_have_them_as_well() {
    let (mut random, tables) = (Random(3), tables());
    for round in 0..300 {
        let (n, count) = (1 + random.below(60), random.below(9));
        let program = program(&mut random, n, count);
        let mut file = program.registers::<1>();
        file[LAYOUT.parameter()..LAYOUT.len()].iter_mut().for_each(|p| *p = [random.number()]);
        program.prepare(&mut file, &tables);
        let points: Vec<f64> = (0..5 * WIDTH).map(|_| random.number()).collect();
        let mut out = vec![0.0; 5 * program.outputs()];
        let ours = Points::compile(&program, WIDTH, Width::detect()).expect("code");
        ours.run(&file, &points, &mut out, &tables);
        for (i, point) in points.chunks_exact(WIDTH).enumerate() {
            file.iter_mut().zip(point).for_each(|(slot, x)| *slot = [*x]);
            program.run(&mut file, &tables);
            for k in 0..program.outputs() {
                let (got, want) = (out[i * program.outputs() + k], program.output(&file, k)[0]);
                assert!(same(got, want), "program {round}, {k}: {got:e}, interpreter {want:e}");
            }
        }
    }
}
