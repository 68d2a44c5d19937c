//! The pattern of a Jacobian in; machine code that takes S through Runge-Kutta steps with it, out.
//!
//! A function per group of directions: one turn is one step. S at the start of a step is read from
//! memory, S at its end is written there; in between it stays in registers. Entries are read where
//! the program of the Jacobian left them, each for all lanes; what is always zero is not read, what
//! is always one not multiplied, and what acts by itself goes into its lane. Sums and their order are
//! those of `steps`, and so are the bits.

use super::rows::{LANES, Rows};
use super::tableau::WEIGHT;
use crate::math::simd::Width;
use crate::model::machine::encode::{ADD, Assembler, Base, Place};
use crate::model::machine::list::{List, Step, Value};
use crate::model::machine::{Builder, Code};
use std::ops::Range;

/// Products of a stage at most.
const MOST: usize = 1000;

/// Takes S of a plain model through steps.
#[derive(Debug)]
pub struct Sweep {
    code: Code,
    /// Functions of the code.
    groups: usize,
    /// Numbers of S, and of the registers that hold entries.
    size: usize,
    registers: usize,
}

/// Vectors of directions that go side by side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    /// The first direction.
    pub(super) first: usize,
    pub(super) vectors: usize,
    /// Numbers of a vector.
    pub(super) vector: usize,
}

impl Group {
    /// All directions, `vectors` of them at a time where so many are left.
    pub(super) fn all(lanes: usize, vector: usize, vectors: usize) -> Vec<Group> {
        let whole = lanes / vector;
        (0..whole)
            .step_by(vectors)
            .map(|v| Group { first: v * vector, vectors: vectors.min(whole - v), vector })
            .collect()
    }

    /// Where vector `i` of a row stands.
    pub(super) fn place(&self, base: Base, row: usize, lanes: usize, i: usize) -> Place {
        Place { base, at: 8 * (row * lanes + self.first + i * self.vector) as i32 }
    }
}

/// Where an entry stands: stages side by side, of which the present one is where
/// `Base::Rsi` points.
pub(super) fn entry(register: u32, stage: usize) -> Place {
    Place { base: Base::Rsi, at: 8 * (register as usize + stage) as i32 }
}

impl Sweep {
    /// The functions take the number of steps, where the entries of the first stage stand, S before
    /// the first step and behind it, the bytes from there to S behind the next one, and the weights.
    ///
    /// `None` where there is no code of this width, S has delayed values behind it, or the code would
    /// be too long for the caches.
    pub fn compile(rows: &Rows, width: Width) -> Option<Sweep> {
        let plain = rows.reach <= rows.size() && rows.size() > 0;
        let short = rows.products.len() <= MOST;
        let mut builder = Builder::new(width, false).filter(|_| plain && short)?;
        // with more, S of so many rows finds no place in 32 registers; with 16 it finds none anyway
        let side_by_side = if rows.rows > 8 && builder.vector() == 8 { 1 } else { 2 };
        let groups = Group::all(rows.lanes, builder.vector(), side_by_side);
        for group in &groups {
            let list = step(rows, *group);
            let next = |asm: &mut Assembler| {
                asm.copy(Base::Rdx, Base::Rcx);
                asm.add_register(Base::Rcx, Base::R8);
                asm.add(Base::Rsi, 4 * 8);
            };
            builder.function(single_lanes, &list, next, Base::Rdi);
        }
        let (size, registers) = (rows.size(), rows.registers);
        Some(Sweep { code: builder.finish()?, groups: groups.len(), size, registers })
    }

    /// Steps whose stages stand in `registers` from `stages.start` on. S before the first step stands
    /// at `from` in `s`; S behind it goes to `to`, S behind the next one next to that, and so on.
    pub fn steps(
        &self,
        registers: &[[f64; LANES]],
        stages: Range<usize>,
        weights: &[[f64; 2]; 4],
        s: &mut [f64],
        [from, to]: [usize; 2],
    ) {
        let n = stages.len() / 4;
        assert!(registers.len() >= self.registers && stages.end <= LANES);
        assert!(from + self.size <= s.len() && to + n * self.size <= s.len());
        let entries = registers.as_flattened()[stages.start..].as_ptr() as usize;
        let [from, to] = [from, to].map(|at| s[at..].as_mut_ptr() as usize);
        let weights = weights.as_ptr() as usize;
        for group in 0..if n == 0 { 0 } else { self.groups } {
            // SAFETY: the function reads entries of the stages, weights and S, and writes S.
            unsafe { self.code.call(group, [n, entries, from, to, 8 * self.size, weights]) };
        }
    }
}

/// Mask `k` names lane `k` (AVX-512).
pub(super) fn single_lanes(asm: &mut Assembler) {
    if asm.wide() {
        (1..8).for_each(|k| asm.mask(k, 1 << k));
    }
}

/// Steps of one turn.
struct Writer<'a> {
    list: List,
    rows: &'a Rows,
    group: Group,
}

/// One Runge-Kutta step.
fn step(rows: &Rows, group: Group) -> List {
    let mut writer = Writer { list: List::default(), rows, group };
    let start = writer.states(Base::Rdx);
    let (mut at, mut sum): (_, Vec<Vec<Value>>) = (start.clone(), Vec::new());
    for stage in 0..4 {
        let [weight, ahead] = [0, 8].map(|k| {
            let place = Place { base: Base::R9, at: 16 * stage as i32 + k };
            writer.list.push(Step::Number(place))
        });
        let mut next = Vec::new();
        for (row, start) in start.iter().enumerate() {
            let k = writer.row(row, stage, &at);
            let led = |writer: &mut Writer, k: &[Value]| -> Vec<Value> {
                k.iter().zip(start).map(|(&k, &s)| writer.fused(ahead, k, s)).collect()
            };
            if stage == 3 {
                let k = writer.added(&k, &sum[row]);
                let out = led(&mut writer, &k);
                writer.store(row, &out);
                continue;
            }
            next.push(led(&mut writer, &k));
            if stage == 0 {
                sum.push(writer.weighed_first(weight, &k));
            } else {
                sum[row] =
                    k.iter().zip(&sum[row]).map(|(&k, &s)| writer.fused(weight, k, s)).collect();
            }
        }
        at = next;
    }
    writer.list
}

impl Writer<'_> {
    fn fused(&mut self, a: Value, b: Value, c: Value) -> Value {
        self.list.fused(a, b, c)
    }

    /// S, as vectors row by row.
    fn states(&mut self, base: Base) -> Vec<Vec<Value>> {
        let (group, lanes) = (self.group, self.rows.lanes);
        (0..self.rows.rows)
            .map(|row| {
                (0..group.vectors)
                    .map(|i| self.list.push(Step::Vector(group.place(base, row, lanes, i))))
                    .collect()
            })
            .collect()
    }

    fn row(&mut self, row: usize, stage: usize, s: &[Vec<Value>]) -> Vec<Value> {
        row_of(&mut self.list, self.rows, self.group, row, stage, |_, column, i| s[column][i])
    }

    fn added(&mut self, a: &[Value], b: &[Value]) -> Vec<Value> {
        a.iter().zip(b).map(|(&a, &b)| self.list.push(Step::Two(ADD, a, b))).collect()
    }

    /// `0 + weight k`.
    fn weighed_first(&mut self, weight: Value, k: &[Value]) -> Vec<Value> {
        let zero = self.list.push(Step::Zero);
        if WEIGHT[0] == 1.0 {
            return k.iter().map(|&k| self.list.push(Step::Two(ADD, k, zero))).collect();
        }
        k.iter().map(|&k| self.fused(weight, k, zero)).collect()
    }

    fn store(&mut self, row: usize, values: &[Value]) {
        for (i, &value) in values.iter().enumerate() {
            let place = self.group.place(Base::Rcx, row, self.rows.lanes, i);
            self.list.push(Step::Store(value, place));
        }
    }
}

/// A row of `J_x S + J_p` as vectors; `source`: S of a column, vector `i`.
pub(super) fn row_of(
    list: &mut List,
    rows: &Rows,
    group: Group,
    row: usize,
    stage: usize,
    mut source: impl FnMut(&mut List, usize, usize) -> Value,
) -> Vec<Value> {
    let mut sums: Vec<Value> =
        (0..group.vectors).map(|i| direct(list, rows, group, row, stage, i)).collect();
    for product in rows.products_of(row) {
        let column = product.source as usize / rows.lanes;
        let one = rows.is_one(product.entry);
        let x = list.push(Step::Number(entry(product.entry, stage)));
        for (i, sum) in sums.iter_mut().enumerate() {
            let s = source(list, column, i);
            *sum = if one { list.push(Step::Two(ADD, s, *sum)) } else { list.fused(x, s, *sum) };
        }
    }
    sums
}

/// What acts by itself on a row, vector `i`.
fn direct(list: &mut List, rows: &Rows, group: Group, row: usize, stage: usize, i: usize) -> Value {
    let first = group.first + i * group.vector;
    let mut acts: Vec<(usize, u32)> = rows
        .acts
        .iter()
        .filter(|act| act.row == row && (first..first + group.vector).contains(&act.column))
        .map(|act| (act.column - first, act.entry))
        .collect();
    acts.sort_unstable();
    let mut before = None;
    for (lane, register) in acts {
        before = Some(list.push(Step::Insert(before, lane as u8, entry(register, stage))));
    }
    before.unwrap_or_else(|| list.push(Step::Zero))
}
