//! Random patterns of Jacobians in; the bits of the machine code for S beside those of the kernels,
//! out.

use super::rows::{Append, Block, LANES, Rows, append};
use super::steps::{Steps, steps};
use super::sweep::Sweep;
use super::sweep_rows::{Goal, RowSweep};
use super::tangent::weights;
use super::{Directions, Propagator, Record, Tier};
use crate::math::simd::{Aligned, Width};
use crate::model::graph::{Graph, Leaf, Node, Op};
use crate::model::linear::{Entry, Sparse};
use crate::model::{Constants, Layout, Model, Program};

struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 33) as usize % n
    }

    /// Some are zeros of both signs.
    fn number(&mut self) -> f64 {
        match self.below(8) {
            0 => 0.0,
            1 => -0.0,
            _ => self.below(2000) as f64 / 1000.0 - 1.0,
        }
    }

    fn numbers(&mut self, n: usize) -> Vec<f64> {
        (0..n).map(|_| self.number()).collect()
    }
}

/// A Jacobian at sixteen points.
struct Case {
    rows: Rows,
    registers: Aligned,
    direct: Aligned,
}

impl Case {
    /// `states` columns and so many directions; entries are ones, other constants, or change.
    fn new(random: &mut Random, count: usize, states: usize, directions: usize) -> Case {
        let lanes = directions.div_ceil(8) * 8;
        let (mut graph, mut nodes, mut sparse) = (Graph::default(), vec![], Sparse::default());
        let mut node = |random: &mut Random| -> Node {
            let x = graph.leaf(Leaf::State(random.below(2)));
            match random.below(5) {
                0 => graph.c(1.0),
                1 => graph.c(0.3),
                k => {
                    let c = graph.c(k as f64);
                    graph.op(Op::Mul, x, c, c)
                }
            }
        };
        let density = 1 + random.below(9);
        for row in 0..count {
            for (list, columns, often) in
                [(&mut sparse.states, states, density), (&mut sparse.parameters, directions, 3)]
            {
                for column in 0..columns {
                    if random.below(10) < often {
                        list.push(Entry { row, column, output: nodes.len() });
                        nodes.push(node(random));
                    }
                }
            }
        }
        let layout = Layout { states: 2, ..Layout::default() };
        let program = Program::lower(&graph, &nodes, &layout);
        let mut file = program.registers::<LANES>();
        let fixed = |r: usize| program.constants().iter().any(|c| c.0 as usize == r);
        for (_, row) in file.iter_mut().enumerate().filter(|(r, _)| !fixed(*r)) {
            row.iter_mut().for_each(|x| *x = random.number());
        }
        let rows = Rows::new(&sparse, &program, count, states, lanes);
        let mut direct = Aligned::of_zeros(rows.direct_size());
        rows.spread(&file, &mut direct);
        let mut registers = Aligned::of_zeros(file.len() * LANES);
        registers.copy_from_slice(file.as_flattened());
        Case { rows, registers, direct }
    }

    fn block(&self) -> Block<'_> {
        Block { rows: &self.rows, registers: self.registers.rows_of(), direct: &self.direct }
    }
}

fn bits(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

/// S at every `every`th step of four and behind the last one, by the kernels.
fn by_kernels(case: &Case, start: &[f64], every: usize) -> Vec<f64> {
    let size = case.rows.size();
    let zeros = || Aligned::of_zeros(size);
    let (mut s, mut sum, mut a, mut b) = (zeros(), zeros(), zeros(), zeros());
    s.copy_from_slice(start);
    let mut kept = vec![0.0; 4usize.div_ceil(every) * size];
    let mut job = Steps {
        s: &mut s,
        sum: &mut sum,
        between: [&mut a, &mut b],
        k: None,
        weights: weights(0.1),
        plain: true,
        kept: &mut kept,
        every,
        phase: 0,
    };
    // SAFETY: every machine has this width.
    unsafe { steps(Width::Plain, case.block(), 0..LANES, &mut job) };
    kept.extend_from_slice(&s);
    kept
}

#[test]
fn s_has_the_kernels_bits() {
    let mut random = Random(7);
    for round in 0..150 {
        let states = 1 + random.below(13);
        let directions = 1 + random.below(40);
        let case = Case::new(&mut random, states, states, directions);
        let size = case.rows.size();
        let start = random.numbers(size);
        for every in 1..4 {
            let want = by_kernels(&case, &start, every);
            for &width in &Width::available()[1..] {
                let sweep = Sweep::compile(&case.rows, None, width).expect("code for this machine");
                let whole = 4usize.div_ceil(every);
                let between = (whole + 1) * size;
                let place = |step: usize| match (step, step % every) {
                    (4, _) => whole * size,
                    (_, 0) => step / every * size,
                    _ => between,
                };
                let mut got = [&start[..], &vec![0.0; between][..]].concat();
                let registers = case.registers.rows_of();
                for step in (0..4).filter(|_| every > 1) {
                    let (stages, places) = (4 * step..4 * step + 4, [place(step), place(step + 1)]);
                    sweep.steps(registers, stages, &weights(0.1), &mut got, places);
                }
                if every == 1 {
                    sweep.steps(registers, 0..LANES, &weights(0.1), &mut got, [0, size]);
                }
                got.truncate(between);
                assert_eq!(bits(&got), bits(&want), "case {round}, every {every}, {width:?}");
            }
        }
    }
}

#[test]
fn rows_have_the_kernels_bits() {
    let mut random = Random(11);
    for round in 0..150 {
        let (states, count) = (1 + random.below(9), 1 + random.below(9));
        let directions = 1 + random.below(32);
        let case = Case::new(&mut random, count, states, directions);
        let (n, first) = (1 + random.below(LANES), random.below(3));
        let stride = states * case.rows.lanes;
        let s = random.numbers(n * stride);
        let lists = || vec![vec![0.0; (first + n) * directions]; count];
        let (mut want, mut zeros) = (lists(), [0.0; 8]);
        let to = Append { lists: &mut want, directions, k: first, zeros: &mut zeros };
        // SAFETY: every machine has this width.
        unsafe { append(Width::Plain, case.block(), 0..n, &s, stride, to) };
        for &width in &Width::available()[1..] {
            let sweep = RowSweep::compile(&case.rows, directions, width).expect("code");
            let mut got = lists();
            let mut goal = Goal::new(&mut got);
            sweep.points(case.registers.rows_of(), n, (&s, stride), first, &mut goal);
            assert!(goal.is_finite());
            for (got, want) in got.iter().zip(&want) {
                assert_eq!(bits(got), bits(want), "case {round}, {width:?}");
            }
        }
    }
}

#[test]
fn what_is_not_finite_is_seen() {
    let mut random = Random(5);
    let case = Case::new(&mut random, 2, 3, 8);
    for &width in &Width::available()[1..] {
        for (at, bad) in [(0, f64::NAN), (9, f64::INFINITY), (23, f64::NEG_INFINITY)] {
            let mut s = vec![1.0; 24];
            s[at] = bad;
            let mut want = vec![vec![0.0; 8]; 2];
            let sweep = RowSweep::compile(&case.rows, 8, width).expect("code");
            let mut goal = Goal::new(&mut want);
            sweep.points(case.registers.rows_of(), 1, (&s, 24), 0, &mut goal);
            let finite = goal.is_finite();
            assert_eq!(finite, want.iter().flatten().all(|x| x.is_finite()), "{width:?} {at}");
        }
    }
}

/// A record with inputs that move.
fn record(model: &Model, n: usize, substeps: usize) -> Record {
    let inputs = (0..n * model.inputs.len()).map(|k| 0.05 * libm::sin(0.7 * k as f64));
    Record { dt: 0.02, n, inputs: inputs.collect(), substeps, ..Record::default() }
}

#[test]
fn a_whole_model_has_the_interpreters_bits() {
    let text = include_str!("../../benches/six_dof.model.toml");
    let model = Model::parse("six", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
    let parameters: Vec<f64> = model.parameters.iter().map(|p| p.start).collect();
    let directions = Directions {
        parameters: (0..parameters.len()).collect(),
        starts: (0..model.states.len()).collect(),
    };
    let mut propagator = Propagator::new(&model, directions).expect("a propagator");
    has_the_interpreters_bits(&model, &parameters, &mut propagator);
}

/// Runs of some lengths, interpreted and by machine code, which is made.
fn has_the_interpreters_bits(model: &Model, parameters: &[f64], propagator: &mut Propagator) {
    for (n, substeps) in [(1, 1), (33, 1), (70, 2), (40, 5)] {
        let record = record(model, n, substeps);
        let starts = propagator.first_values(model, parameters, &record, &record).expect("starts");
        let [want, got] = [Tier::Interpreter, Tier::Native].map(|tier| {
            propagator.compile(tier, 1, n);
            propagator.run(parameters, &starts, &record, true)
        });
        let made = Width::detect() == Width::Plain || propagator.native.sweep.is_some();
        assert!(made && want.finite && got.finite, "{n} points, {substeps} steps each");
        assert_eq!(bits(&got.y), bits(&want.y), "{n} points, {substeps} steps each");
        let differ = got.dy.iter().zip(&want.dy).position(|(a, b)| a.to_bits() != b.to_bits());
        assert_eq!(differ, None, "{n} points, {substeps} steps each");
    }
}

/// Delays of inputs and states: by a parameter, by a distance over a speed, and shorter than a step.
const LATE: &str = r#"title = "late"
[inputs]
u = "rad"
[parameters]
a = { unit = "1/s", start = -1.5 }
b = { unit = "1/s", start = 0.8 }
c = { unit = "1/s2", start = -3.0 }
d = { unit = "1/s", start = 0.4 }
tau = { unit = "s", start = TAU }
l = { unit = "m", start = 6.0 }
bias = { unit = "rad", start = 0.01 }
[states]
x = { unit = "rad", rate = "a*x + q + b*delay(u, tau)", start = 0.02 }
q = { unit = "rad/s", rate = "c*x - q/s + d*delay(x, tau)/s + d*delay(q, l/V)", start = -0.01 }
V = { unit = "m/s", rate = "-2.0*g*x", start = 60.0 }
[constants]
s = { unit = "s", value = 1.0 }
g = { unit = "m/s2", value = 9.81 }
[outputs]
x = { unit = "rad", value = "x + bias" }
q = { unit = "rad/s", value = "q*delay(x, l/V) + delay(q, tau)" }
u = { unit = "rad", value = "delay(u, tau) + sin(x)" }
"#;

#[test]
fn a_model_with_delays_has_the_interpreters_bits() {
    for tau in ["0.1", "0.013", "0.031"] {
        let text = LATE.replace("TAU", tau);
        let model =
            Model::parse("late", &text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
        let parameters: Vec<f64> = model.parameters.iter().map(|p| p.start).collect();
        for directions in [
            Directions { parameters: (0..parameters.len()).collect(), starts: vec![0, 1, 2] },
            Directions { parameters: vec![4], starts: vec![] },
        ] {
            let mut propagator = Propagator::new(&model, directions).expect("a propagator");
            has_the_interpreters_bits(&model, &parameters, &mut propagator);
        }
    }
}
