//! The pattern of the outputs' Jacobian in; machine code that makes rows of the outputs of S at grid
//! points, out. Sums are those of `rows`, and so are the bits.

use super::rows::{LANES, Rows};
use super::sweep::{Group, row_of, single_lanes};
use crate::math::simd::Width;
use crate::model::machine::encode::{ADD, Assembler, Base, Place};
use crate::model::machine::list::{List, Step};
use crate::model::machine::{Builder, Code, TAIL};

/// Rows at grid points.
#[derive(Debug)]
pub struct RowSweep {
    code: Code,
    groups: usize,
    rows: usize,
    directions: usize,
    registers: usize,
    reach: usize,
}

/// Where rows go: the bits of eight numbers to which zero times everything that is written is
/// added, and behind them the addresses of the lists `[point][direction]`, row by row.
pub struct Goal<'a> {
    words: Vec<u64>,
    lists: &'a mut [Vec<f64>],
}

impl<'a> Goal<'a> {
    pub fn new(lists: &'a mut [Vec<f64>]) -> Goal<'a> {
        let addresses = lists.iter_mut().map(|list| list.as_mut_ptr() as u64);
        Goal { words: std::iter::repeat_n(0, ZEROS).chain(addresses).collect(), lists }
    }

    /// Whether all that was written is finite.
    pub fn is_finite(&self) -> bool {
        self.words[..ZEROS].iter().all(|&bits| f64::from_bits(bits) == 0.0)
    }
}

const ZEROS: usize = 8;

impl RowSweep {
    /// The functions take the number of points, where the entries of the first one stand, and S, the
    /// bytes from there to the next S and from the begin of the lists, and the goal's words.
    ///
    /// `directions`: numbers of a row that is written. `None` where there is no code of this width.
    pub fn compile(rows: &Rows, directions: usize, width: Width) -> Option<RowSweep> {
        let mut builder = Builder::new(width, false).filter(|_| rows.size() > 0)?;
        let mut groups = Group::all(rows.lanes, builder.vector(), 1);
        groups.retain(|group| group.first < directions);
        for group in &groups {
            let list = point(rows, *group, directions);
            let tail = directions - group.first;
            let begin = |asm: &mut Assembler| {
                single_lanes(asm);
                if asm.wide() && tail < 8 {
                    asm.mask(TAIL, (1 << tail) - 1);
                }
            };
            let next = |asm: &mut Assembler| {
                asm.add(Base::Rsi, 8);
                asm.add_register(Base::Rdx, Base::Rcx);
                asm.add(Base::R8, 8 * directions as i32);
            };
            builder.function(begin, &list, next, Base::Rdi);
        }
        Some(RowSweep {
            code: builder.finish()?,
            groups: groups.len(),
            rows: rows.rows,
            directions,
            registers: rows.registers,
            reach: rows.reach,
        })
    }

    /// The rows at the first `n` points of `registers`, whose S stand `stride` numbers apart, as
    /// points `k`.. of the lists.
    pub fn points(
        &self,
        registers: &[[f64; LANES]],
        n: usize,
        (s, stride): (&[f64], usize),
        k: usize,
        goal: &mut Goal,
    ) {
        assert!(registers.len() >= self.registers && n <= LANES);
        assert!(n == 0 || s.len() >= (n - 1) * stride + self.reach);
        assert!(goal.lists.len() == self.rows);
        assert!(goal.lists.iter().all(|list| list.len() >= (k + n) * self.directions));
        for group in 0..if n == 0 { 0 } else { self.groups } {
            let arguments = [
                n,
                registers.as_ptr() as usize,
                s.as_ptr() as usize,
                8 * stride,
                8 * k * self.directions,
                goal.words.as_mut_ptr() as usize,
            ];
            // SAFETY: the function reads entries and S of `n` points, and writes so many rows into
            // the lists, which `goal` borrows.
            unsafe { self.code.call(group, arguments) };
        }
    }
}

/// The rows of one point.
fn point(rows: &Rows, group: Group, directions: usize) -> List {
    let mut list = List::default();
    let zero = list.push(Step::Zero);
    let mut zeros = zero;
    let left = directions - group.first;
    let mut seen: Vec<Option<u32>> = vec![None; rows.reach / rows.lanes];
    for row in 0..rows.rows {
        let sum = row_of(&mut list, rows, group, row, (Base::Rsi, 0), |list, column, i| {
            let place = group.place(Base::Rdx, column, rows.lanes, i);
            *seen[column].get_or_insert_with(|| list.push(Step::Vector(place)))
        });
        let goal = Place { base: Base::R9, at: 8 * (ZEROS + row) as i32 };
        list.push(Step::Fetch(Base::Rax, goal, Base::R8));
        for sum in sum {
            let to = Place { base: Base::Rax, at: 8 * group.first as i32 };
            zeros = list.fused(zero, sum, zeros);
            list.push(if left >= group.vector {
                Step::Store(sum, to)
            } else {
                Step::StoreFirst(sum, to, left as u8)
            });
        }
    }
    let kept = Place { base: Base::R9, at: 0 };
    let before = list.push(Step::Vector(kept));
    let after = list.push(Step::Two(ADD, before, zeros));
    list.push(Step::Store(after, kept));
    list
}
