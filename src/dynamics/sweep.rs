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
    /// Delayed values, numbers of a row, registers of the times' entries, and numbers of the rates
    /// that are kept.
    delays: usize,
    lanes: usize,
    delay_registers: usize,
    kept: usize,
}

/// What the code of a model with delays needs besides.
#[derive(Clone, Copy)]
pub struct Late<'a> {
    /// The Jacobian of the delay times.
    pub times: &'a Rows,
    /// States that are read later, ascending.
    pub kept: &'a [usize],
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

/// Where an entry stands: stages side by side, of which the present one is where `base` points.
fn entry(base: Base, register: u32, stage: usize) -> Place {
    Place { base, at: 8 * (register as usize + stage) as i32 }
}

impl Sweep {
    /// The functions take the number of steps, where the entries of the first stage stand, S before
    /// the first step and behind it, the bytes from there to S behind the next one, and the weights.
    /// With delays they take one step: behind S before it stand, stage by stage, the sensitivities of
    /// the past values themselves; behind S after it go the rates of the states that are kept, at the
    /// first stage; in place of the bytes where the entries of the delay times stand; and behind the
    /// weights, stage by stage, minus the slopes of the delayed values.
    ///
    /// `None` where there is no code of this width, or it would be too long for the caches.
    pub fn compile(rows: &Rows, late: Option<Late>, width: Width) -> Option<Sweep> {
        let delays = late.map_or(0, |late| late.times.rows);
        let plain = rows.reach <= rows.size() + delays * rows.lanes && rows.size() > 0;
        let short = rows.products.len() <= MOST;
        let mut builder = Builder::new(width, false).filter(|_| plain && short)?;
        // with more, S of so many rows finds no place in 32 registers; with 16 it finds none anyway
        let side_by_side = if rows.rows > 8 && builder.vector() == 8 { 1 } else { 2 };
        let groups = Group::all(rows.lanes, builder.vector(), side_by_side);
        for group in &groups {
            let list = step(rows, late, *group);
            let next = |asm: &mut Assembler| {
                asm.copy(Base::Rdx, Base::Rcx);
                asm.add_register(Base::Rcx, Base::R8);
                asm.add(Base::Rsi, 4 * 8);
            };
            builder.function(single_lanes, &list, next, Base::Rdi);
        }
        Some(Sweep {
            code: builder.finish()?,
            groups: groups.len(),
            size: rows.size(),
            registers: rows.registers,
            delays,
            lanes: rows.lanes,
            delay_registers: late.map_or(0, |late| late.times.registers),
            kept: late.map_or(0, |late| late.kept.len() * rows.lanes),
        })
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
        assert!(self.delays == 0 && self.kept == 0);
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

    /// One step of a model with delays, whose first stage is `stage` of both lists of registers; what
    /// stands where is said at `compile`.
    pub fn late_step(
        &self,
        [registers, times]: [&[[f64; LANES]]; 2],
        stage: usize,
        numbers: &[f64],
        from: &[f64],
        to: &mut [f64],
    ) {
        assert!(registers.len() >= self.registers && times.len() >= self.delay_registers);
        assert!(stage + 4 <= LANES && numbers.len() >= SLOPES + 4 * self.delays);
        assert!(to.len() >= self.size + self.kept);
        assert!(from.len() >= self.size + 4 * self.delays * self.lanes);
        let at = |of: &[[f64; LANES]]| of.as_flattened().as_ptr().wrapping_add(stage) as usize;
        let arguments = [
            1,
            at(registers),
            from.as_ptr() as usize,
            to.as_mut_ptr() as usize,
            at(times),
            numbers.as_ptr() as usize,
        ];
        for group in 0..self.groups {
            // SAFETY: the function reads entries of four stages, numbers, S and past values, and
            // writes S and rates.
            unsafe { self.code.call(group, arguments) };
        }
    }
}

/// Numbers before the slopes: the weights.
pub(super) const SLOPES: usize = 8;

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
    late: Option<Late<'a>>,
    group: Group,
}

/// One Runge-Kutta step.
fn step(rows: &Rows, late: Option<Late>, group: Group) -> List {
    let mut writer = Writer { list: List::default(), rows, late, group };
    let start = writer.states(Base::Rdx);
    let (mut at, mut sum): (_, Vec<Vec<Value>>) = (start.clone(), Vec::new());
    for stage in 0..4 {
        let [weight, ahead] = [0, 8].map(|k| {
            let place = Place { base: Base::R9, at: 16 * stage as i32 + k };
            writer.list.push(Step::Number(place))
        });
        let delayed = writer.delayed(stage, &at);
        let mut next = Vec::new();
        for (row, start) in start.iter().enumerate() {
            let k = writer.row(row, stage, &at, &delayed);
            if stage == 0 {
                writer.keep(row, &k);
            }
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

    /// `d` stands behind `s`.
    fn row(&mut self, row: usize, stage: usize, s: &[Vec<Value>], d: &[Vec<Value>]) -> Vec<Value> {
        let of = |_: &mut List, column: usize, i: usize| match column.checked_sub(s.len()) {
            Some(delay) => d[delay][i],
            None => s[column][i],
        };
        row_of(&mut self.list, self.rows, self.group, row, (Base::Rsi, stage), of)
    }

    /// Sensitivities of the delayed values, `dX(t - tau) = S(t - tau) - X'(t - tau) dtau`, at a stage
    /// where those of the states are `s`.
    fn delayed(&mut self, stage: usize, s: &[Vec<Value>]) -> Vec<Vec<Value>> {
        let Some(Late { times, .. }) = self.late else { return Vec::new() };
        let (group, lanes, delays) = (self.group, self.rows.lanes, times.rows);
        let of = |(writer, delay): (&mut Self, usize)| {
            let list = &mut writer.list;
            let time =
                row_of(list, times, group, delay, (Base::R8, stage), |_, column, i| s[column][i]);
            let at = stage * delays + delay;
            let slope = Place { base: Base::R9, at: 8 * (SLOPES + at) as i32 };
            let slope = list.push(Step::Number(slope));
            let past = |(i, time): (usize, Value)| {
                let past = group.place(Base::Rdx, writer.rows.rows + at, lanes, i);
                let past = writer.list.push(Step::Vector(past));
                writer.list.fused(time, slope, past)
            };
            time.into_iter().enumerate().map(past).collect()
        };
        (0..delays).map(|delay| of((&mut *self, delay))).collect()
    }

    /// The rates of a state that is read later go behind S.
    fn keep(&mut self, row: usize, k: &[Value]) {
        let kept = self.late.map_or(&[][..], |late| late.kept);
        if let Ok(slot) = kept.binary_search(&row) {
            self.store(self.rows.rows + slot, k);
        }
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

/// A row of `J_x S + J_p` as vectors, its entries where `base` points; `source`: S of a column,
/// vector `i`.
pub(super) fn row_of(
    list: &mut List,
    rows: &Rows,
    group: Group,
    row: usize,
    (base, stage): (Base, usize),
    mut source: impl FnMut(&mut List, usize, usize) -> Value,
) -> Vec<Value> {
    let mut sums: Vec<Value> =
        (0..group.vectors).map(|i| direct(list, rows, group, row, (base, stage), i)).collect();
    for product in rows.products_of(row) {
        let column = product.source as usize / rows.lanes;
        let one = rows.is_one(product.entry);
        let x = list.push(Step::Number(entry(base, product.entry, stage)));
        for (i, sum) in sums.iter_mut().enumerate() {
            let s = source(list, column, i);
            *sum = if one { list.push(Step::Two(ADD, s, *sum)) } else { list.fused(x, s, *sum) };
        }
    }
    sums
}

/// What acts by itself on a row, vector `i`.
fn direct(
    list: &mut List,
    rows: &Rows,
    group: Group,
    row: usize,
    (base, stage): (Base, usize),
    i: usize,
) -> Value {
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
        before = Some(list.push(Step::Insert(before, lane as u8, entry(base, register, stage))));
    }
    before.unwrap_or_else(|| list.push(Step::Zero))
}
