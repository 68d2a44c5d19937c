//! Sparse Jacobians over lanes of directions in; `J_x S + J_p + J_d D`, eight directions at a time,
//! out (`steps` and `few` take S through Runge-Kutta steps with it).
//!
//! The rows of S and, behind them, those of D (sensitivities of delayed values) stand in one list,
//! so that a row of the result is one sum. Some vectors of directions go through all points of a
//! call before the next ones begin: directions do not see each other, and their part of S stays in
//! the nearest cache. What acts by itself, `J_p`, is kept for the vectors of directions that have
//! any; the others share one vector of zeros.

use crate::math::simd::{Aligned, Eight, by_width};
use crate::model::Program;
use crate::model::linear::Sparse;
use std::ops::Range;

/// Points of one evaluation side by side.
pub(super) use crate::model::machine::LANES;

/// One product of a row: where the entry of the Jacobian stands in a file of registers (`LANES`
/// points each), and where the row that it multiplies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Product {
    pub(super) entry: u32,
    pub(super) source: u32,
}

/// An entry that acts on a direction by itself; `entry` as in `Product`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Act {
    pub(super) row: usize,
    pub(super) column: usize,
    pub(super) entry: u32,
}

/// The entries of a Jacobian, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rows {
    pub(super) rows: usize,
    /// Directions, padded to whole vectors.
    pub(super) lanes: usize,
    /// The end of each row's products in `products`.
    pub(super) ends: Vec<u32>,
    pub(super) products: Vec<Product>,
    /// Where an entry stands, and where the direction that it acts on by itself stands in a point's
    /// direct parts.
    direct: Vec<(u32, u32)>,
    /// Per row and vector of directions where its direct part stands; zero, where the zeros are, if
    /// it has none.
    places: Vec<u32>,
    /// Numbers of the direct parts of one point.
    pub(super) stride: usize,
    /// The entries that act by themselves.
    pub(super) acts: Vec<Act>,
    /// Where entries stand that are always one.
    ones: Vec<u32>,
    /// Registers of the program that computes the entries.
    pub(super) registers: usize,
    /// Numbers of S and D that are read.
    pub(super) reach: usize,
}

impl Rows {
    /// `program` computes the entries; `states`: rows of S; `lanes`: directions, padded to a
    /// multiple of eight.
    pub fn new(
        sparse: &Sparse,
        program: &Program,
        rows: usize,
        states: usize,
        lanes: usize,
    ) -> Rows {
        let (places, stride) = (vec![0; rows * lanes / 8], 8);
        let registers = program.file_len();
        let mut out = Rows { rows, lanes, registers, places, stride, ..Default::default() };
        let place = |output: usize| (program.register(output) * LANES) as u32;
        for row in 0..rows {
            for (list, first) in [(&sparse.states, 0), (&sparse.delayed, states)] {
                for e in list.iter().filter(|e| e.row == row) {
                    let source = (first + e.column) * lanes;
                    out.products.push(Product { entry: place(e.output), source: source as u32 });
                    out.reach = out.reach.max(source + lanes);
                }
            }
            out.ends.push(out.products.len() as u32);
        }
        for e in sparse.parameters.iter().filter(|e| e.row < rows && e.column < lanes) {
            let vector = &mut out.places[(e.row * lanes + e.column) / 8];
            if *vector == 0 {
                *vector = out.stride as u32;
                out.stride += 8;
            }
            let entry = place(e.output);
            out.direct.push((entry, *vector + (e.column % 8) as u32));
            out.acts.push(Act { row: e.row, column: e.column, entry });
        }
        let ones = program.constants().iter().filter(|(_, x)| *x == 1.0);
        out.ones = ones.map(|&(register, _)| register * LANES as u32).collect();
        out
    }

    /// Vectors of eight directions that a stage multiplies.
    pub(super) fn operations(&self) -> usize {
        (self.products.len() + 2 * self.rows) * self.lanes / 8
    }

    /// The products of a row.
    pub(super) fn products_of(&self, row: usize) -> &[Product] {
        let first = if row == 0 { 0 } else { self.ends[row - 1] };
        &self.products[first as usize..self.ends[row] as usize]
    }

    /// Whether an entry is always one.
    pub(super) fn is_one(&self, entry: u32) -> bool {
        self.ones.contains(&entry)
    }

    /// Numbers of one result.
    pub fn size(&self) -> usize {
        self.rows * self.lanes
    }

    /// Numbers of the direct parts of a block.
    pub fn direct_size(&self) -> usize {
        LANES * self.stride
    }

    /// Where the direct parts of a row stand, by vectors from direction `v` on.
    #[inline(always)]
    pub(super) fn places(&self, row: usize, v: usize) -> *const u32 {
        self.places.as_ptr().wrapping_add((row * self.lanes + v) / 8)
    }

    /// Writes what acts by itself, `J_p`, at `LANES` points; other numbers of `direct` stay zero.
    pub fn spread(&self, registers: &[[f64; LANES]], direct: &mut Aligned) {
        let direct = &mut direct[..self.direct_size()];
        for &(entry, at) in &self.direct {
            let points = direct[at as usize..].iter_mut().step_by(self.stride);
            points.zip(&registers[entry as usize / LANES]).for_each(|(to, value)| *to = *value);
        }
    }
}

/// The Jacobian at a block of points: the registers of its program run for them, and the direct
/// parts that `Rows::spread` wrote.
#[derive(Clone, Copy)]
pub struct Block<'a> {
    pub rows: &'a Rows,
    pub registers: &'a [[f64; LANES]],
    pub direct: &'a [f64],
}

impl Block<'_> {
    /// Whether the block and `points` of it are large enough for what the kernels read.
    pub(super) fn fits(&self, points: &Range<usize>) -> bool {
        self.rows.lanes.is_multiple_of(8)
            && self.registers.len() >= self.rows.registers
            && points.end <= LANES
            && self.direct.len() >= points.end * self.rows.stride
    }
}

/// Calls `$of::<V, K>($v, ...)` for all vectors of lanes, `K` of them from lane `v` on at a time,
/// so that sums do not wait for each other.
macro_rules! each_chunk {
    ($lanes:expr, $v:ident, $of:ident, $($a:expr),*) => {{
        let mut $v = 0;
        while $v + 32 <= $lanes {
            $of::<V, 4>($v, $($a),*);
            $v += 32;
        }
        while $v + 16 <= $lanes {
            $of::<V, 2>($v, $($a),*);
            $v += 16;
        }
        while $v + 8 <= $lanes {
            $of::<V, 1>($v, $($a),*);
            $v += 8;
        }
    }};
}
pub(super) use each_chunk;

/// The direct part of a row.
///
/// # Safety
/// As `row_of`.
#[inline(always)]
pub(super) unsafe fn begin<V: Eight, const K: usize>(
    direct: *const f64,
    places: *const u32,
) -> [V; K] {
    // SAFETY: the caller's promises.
    std::array::from_fn(|i| unsafe { V::load(direct.add(*places.add(i) as usize)) })
}

/// A row of the result at one point: the sum that begins with its direct part.
///
/// # Safety
/// The machine has the width; `places` and `products` are those of a row of `block`, which fits;
/// from `source` on as many numbers can be read as they reach.
#[inline(always)]
pub(super) unsafe fn row_of<V: Eight, const K: usize>(
    values: *const f64,
    (direct, places): (*const f64, *const u32),
    products: &[Product],
    source: *const f64,
) -> [V; K] {
    // SAFETY: the caller's promises.
    unsafe {
        let mut sum: [V; K] = begin(direct, places);
        for p in products {
            let (x, source) =
                (V::splat(*values.add(p.entry as usize)), source.add(p.source as usize));
            for (i, sum) in sum.iter_mut().enumerate() {
                *sum = x.fma(V::load(source.add(8 * i)), *sum);
            }
        }
        sum
    }
}

by_width! {
    /// `out = J_x s + J_p + J_d delayed` at one point of a block, rows of lanes; `s`: rows of S,
    /// then of D.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn product(block: Block, point: usize, s: &[f64], out: &mut [f64]) = product_body
}

#[inline(always)]
unsafe fn product_body<V: Eight>(block: Block, point: usize, s: &[f64], out: &mut [f64]) {
    assert!(
        block.fits(&(point..point + 1))
            && s.len() >= block.rows.reach
            && out.len() >= block.rows.size()
    );
    // SAFETY: the sizes were just checked.
    unsafe {
        each_chunk!(block.rows.lanes, v, product_chunk, &block, point, s.as_ptr(), out.as_mut_ptr())
    }
}

/// # Safety
/// As `product_body`, sizes checked.
#[inline(always)]
unsafe fn product_chunk<V: Eight, const K: usize>(
    v: usize,
    block: &Block,
    point: usize,
    s: *const f64,
    out: *mut f64,
) {
    let rows = block.rows;
    let mut from = 0;
    // SAFETY: the caller's promises.
    unsafe {
        let (values, direct) = (
            block.registers.as_ptr().cast::<f64>().add(point),
            block.direct.as_ptr().add(point * rows.stride),
        );
        for (row, &end) in rows.ends.iter().enumerate() {
            let products = rows.products.get_unchecked(from..end as usize);
            let sum = row_of::<V, K>(values, (direct, rows.places(row, v)), products, s.add(v));
            for (i, sum) in sum.into_iter().enumerate() {
                sum.store(out.add(row * rows.lanes + v + 8 * i));
            }
            from = end as usize;
        }
    }
}

/// Where rows at points go.
pub struct Append<'a> {
    /// Per row a list `[k][directions]`.
    pub lists: &'a mut [Vec<f64>],
    pub directions: usize,
    /// The place of the first point in the lists.
    pub k: usize,
    /// Zero times everything that was written is added to these: they tell whether it is finite.
    pub zeros: &'a mut [f64; 8],
}

by_width! {
    /// The rows at some points of a block, each with its own S and D, which stand `stride` numbers
    /// apart.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn append(block: Block, points: Range<usize>, s: &[f64], stride: usize, to: Append) = append_body
}

#[inline(always)]
unsafe fn append_body<V: Eight>(
    block: Block,
    points: Range<usize>,
    s: &[f64],
    stride: usize,
    mut to: Append,
) {
    let (rows, n) = (block.rows, points.len());
    assert!(block.fits(&points) && to.lists.len() == rows.rows && to.directions <= rows.lanes);
    assert!(n == 0 || s.len() >= (n - 1) * stride + rows.reach);
    assert!(to.lists.iter().all(|list| list.len() >= (to.k + n) * to.directions));
    // SAFETY: the sizes were just checked.
    unsafe {
        each_chunk!(rows.lanes, v, append_chunk, &block, &points, s.as_ptr(), stride, &mut to)
    }
}

/// # Safety
/// As `append_body`, sizes checked.
#[inline(always)]
unsafe fn append_chunk<V: Eight, const K: usize>(
    v: usize,
    block: &Block,
    points: &Range<usize>,
    s: *const f64,
    stride: usize,
    to: &mut Append,
) {
    let rows = block.rows;
    let mut from = 0;
    // SAFETY: the caller's promises; of a last vector only the directions that are there are
    // written.
    unsafe {
        let zero = V::splat(0.0);
        let mut zeros = [zero; K];
        for (row, &end) in rows.ends.iter().enumerate() {
            let products = rows.products.get_unchecked(from..end as usize);
            from = end as usize;
            let places = rows.places(row, v);
            let list = to.lists.get_unchecked_mut(row).as_mut_ptr().add(to.k * to.directions + v);
            for (k, point) in points.clone().enumerate() {
                let values = block.registers.as_ptr().cast::<f64>().add(point);
                let direct = (block.direct.as_ptr().add(point * rows.stride), places);
                let sum = row_of::<V, K>(values, direct, products, s.add(k * stride + v));
                for (i, sum) in sum.into_iter().enumerate() {
                    zeros[i] = zero.fma(sum, zeros[i]);
                    let (to, left) = (
                        list.add(k * to.directions + 8 * i),
                        to.directions.saturating_sub(v + 8 * i),
                    );
                    if left >= 8 { sum.store(to) } else { sum.store_first(to, left) }
                }
            }
        }
        let all = zeros.into_iter().fold(V::load(to.zeros.as_ptr()), |all, zeros| all.add(zeros));
        all.store(to.zeros.as_mut_ptr());
    }
}
