//! Sparse Jacobians over lanes of directions: `J_x S + J_p + J_d D`, and with it the Runge-Kutta method, eight directions at a time.

use super::evaluate::LANES;
use crate::math::simd::{Aligned, Eight, by_width};
use crate::model::Program;
use crate::model::linear::Sparse;

/// Points whose direct parts are written at a time.
pub const SPREAD: usize = 4;

/// One product of a row: where the entry of the Jacobian stands in a file of registers (`LANES` points each), and where the row of S or D that it multiplies.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Product {
    entry: u32,
    source: u32,
}

/// The entries of a Jacobian, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Rows {
    rows: usize,
    /// Directions, padded to whole vectors.
    lanes: usize,
    /// Ends of each row's products with states, then of those with delayed values, in `products`.
    ends: Vec<[u32; 2]>,
    products: Vec<Product>,
    /// Where an entry stands, and the row and direction that it acts on by itself.
    direct: Vec<(u32, u32)>,
    /// Registers of the program that computes the entries.
    registers: usize,
    /// Numbers of S and of D that are read.
    reach: [usize; 2],
}

impl Rows {
    /// `program` computes the entries; `lanes`: directions, padded to a multiple of eight.
    pub fn new(sparse: &Sparse, program: &Program, rows: usize, lanes: usize) -> Rows {
        let mut out = Rows { rows, lanes, registers: program.file_len(), ..Default::default() };
        let place = |output: usize| (program.register(output) * LANES) as u32;
        for row in 0..rows {
            let mut ends = [0; 2];
            for (k, list) in [&sparse.states, &sparse.delayed].into_iter().enumerate() {
                for e in list.iter().filter(|e| e.row == row) {
                    out.products.push(Product { entry: place(e.output), source: (e.column * lanes) as u32 });
                    out.reach[k] = out.reach[k].max((e.column + 1) * lanes);
                }
                ends[k] = out.products.len() as u32;
            }
            out.ends.push(ends);
        }
        for e in sparse.parameters.iter().filter(|e| e.row < rows && e.column < lanes) {
            out.direct.push((place(e.output), (e.row * lanes + e.column) as u32));
        }
        out
    }

    /// Numbers of one result.
    pub fn size(&self) -> usize {
        self.rows * self.lanes
    }

    /// Writes what acts by itself, `J_p`, at `SPREAD` points from `first` on; other numbers of `direct` stay zero. Some points ahead, since
    /// a vector that is read right after one of its numbers was written has to wait. `block`: the registers of the program.
    pub fn spread(&self, block: &[[f64; LANES]], first: usize, direct: &mut Aligned) {
        let size = self.size();
        for &(entry, at) in &self.direct {
            let values = &block[entry as usize / LANES][first..first + SPREAD];
            for (l, value) in values.iter().enumerate() {
                direct[l * size + at as usize] = *value;
            }
        }
    }

    /// Whether a file of registers, the direct parts of one point, S and D are large enough for what the kernels read.
    fn fits(&self, block: &[[f64; LANES]], direct: &[f64], s: &[f64], delayed: &[f64]) -> bool {
        self.lanes.is_multiple_of(8)
            && block.len() >= self.registers
            && direct.len() >= self.size()
            && s.len() >= self.reach[0]
            && delayed.len() >= self.reach[1]
    }
}

/// The Jacobian at a point: the registers of its program run for a block of points, which of the points it is, and its direct part.
#[derive(Clone, Copy)]
pub struct At<'a> {
    pub rows: &'a Rows,
    pub block: &'a [[f64; LANES]],
    pub point: usize,
    pub direct: &'a [f64],
}

impl<'a> At<'a> {
    /// `direct`: as `Rows::spread` wrote them for the point and its neighbours.
    pub fn new(rows: &'a Rows, block: &'a [[f64; LANES]], point: usize, direct: &'a [f64]) -> At<'a> {
        At { rows, block, point, direct: &direct[point % SPREAD * rows.size()..][..rows.size()] }
    }
}

by_width! {
    /// `out = J_x s + J_p + J_d delayed`, rows of lanes.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn product(at: At, s: &[f64], delayed: &[f64], out: &mut [f64]) = product_body
}

#[inline(always)]
unsafe fn product_body<V: Eight>(at: At, s: &[f64], delayed: &[f64], out: &mut [f64]) {
    assert!(at.rows.fits(at.block, at.direct, s, delayed) && at.point < LANES && out.len() >= at.rows.size());
    // SAFETY: the sizes were just checked.
    unsafe { each_row::<V, _>(&at, s.as_ptr(), delayed.as_ptr(), &mut Store(out.as_mut_ptr())) }
}

/// Where eight numbers of a result go; a trait and not a closure, so that it is compiled for the width.
trait Sink<V> {
    /// # Safety
    /// The machine has the width of `V`; `at` is a row, its first lane, and the place `row lanes + lane` of a result.
    unsafe fn take(&mut self, at: (usize, usize, usize), value: V);
}

struct Store(*mut f64);

impl<V: Eight> Sink<V> for Store {
    #[inline(always)]
    unsafe fn take(&mut self, (_, _, place): (usize, usize, usize), value: V) {
        // SAFETY: handed on.
        unsafe { value.store(self.0.add(place)) }
    }
}

by_width! {
    /// The same, every row of `directions` numbers written to the place `k` of its list (`[k][directions]`).
    ///
    /// # Safety
    /// The machine has the width.
    pub fn append(at: At, s: &[f64], delayed: &[f64], directions: usize, k: usize, lists: &mut [Vec<f64>]) = append_body
}

#[inline(always)]
unsafe fn append_body<V: Eight>(at: At, s: &[f64], delayed: &[f64], directions: usize, k: usize, lists: &mut [Vec<f64>]) {
    assert!(at.rows.fits(at.block, at.direct, s, delayed) && at.point < LANES && lists.len() == at.rows.rows);
    assert!(directions <= at.rows.lanes && lists.iter().all(|list| list.len() >= (k + 1) * directions));
    let mut sink = Append { lists, first: k * directions, directions };
    // SAFETY: the sizes were just checked.
    unsafe { each_row::<V, _>(&at, s.as_ptr(), delayed.as_ptr(), &mut sink) }
}

struct Append<'a> {
    lists: &'a mut [Vec<f64>],
    first: usize,
    directions: usize,
}

impl<V: Eight> Sink<V> for Append<'_> {
    #[inline(always)]
    unsafe fn take(&mut self, (row, v, _): (usize, usize, usize), value: V) {
        // SAFETY: handed on; of a last vector only the directions that are there are written.
        unsafe {
            let to = self.lists.get_unchecked_mut(row).as_mut_ptr().add(self.first + v);
            if v + 8 <= self.directions { value.store(to) } else { value.store_first(to, self.directions.saturating_sub(v)) }
        }
    }
}

/// What a stage of the Runge-Kutta method does with its rates.
pub struct Stage<'a> {
    /// Sensitivities at the start of the step; after the last stage those at its end.
    pub s: &'a mut [f64],
    /// The weighed sum of rates.
    pub sum: &'a mut [f64],
    /// Sensitivities at the next stage.
    pub next: &'a mut [f64],
    /// The rates themselves, where somebody wants them.
    pub k: Option<&'a mut [f64]>,
    /// 0..4.
    pub number: usize,
    /// Per stage its weight, and how far its rates lead to the next stage (after the last one: what the sum is multiplied by). They lie
    /// in memory since the step before: read right after they are written, they would make every stage wait.
    pub weights: &'a [[f64; 2]; 4],
}

by_width! {
    /// One stage: `k = J_x at + J_p + J_d delayed`, `sum += weight k`, `next = s + ahead k`; the last one `s += ahead (sum + k)`. Where
    /// `from` is `None` the stage begins at `s` itself.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn stage(at: At, from: Option<&[f64]>, delayed: &[f64], stage: Stage) = stage_body
}

#[inline(always)]
unsafe fn stage_body<V: Eight>(at: At, from: Option<&[f64]>, delayed: &[f64], stage: Stage) {
    let size = at.rows.size();
    let Stage { s, sum, next, k, number, weights } = stage;
    let [weight, ahead] = &weights[number];
    let given = from.unwrap_or(s);
    assert!(at.rows.fits(at.block, at.direct, given, delayed) && at.point < LANES);
    assert!(s.len() >= size && sum.len() >= size && next.len() >= size && k.as_ref().is_none_or(|k| k.len() >= size));
    assert!(from.is_some() || number < 3, "the last stage must not read what it writes");
    let from = given.as_ptr();
    let (s, sum, next, k) = (s.as_mut_ptr(), sum.as_mut_ptr(), next.as_mut_ptr(), k.map(|k| k.as_mut_ptr()));
    // SAFETY: the sizes were just checked.
    unsafe {
        let mut sink = Advance { s, sum, next, k, number, weight: V::splat(*weight), ahead: V::splat(*ahead) };
        each_row::<V, _>(&at, from, delayed.as_ptr(), &mut sink);
    }
}

struct Advance<V> {
    s: *mut f64,
    sum: *mut f64,
    next: *mut f64,
    k: Option<*mut f64>,
    number: usize,
    weight: V,
    ahead: V,
}

impl<V: Eight> Sink<V> for Advance<V> {
    #[inline(always)]
    unsafe fn take(&mut self, (_, _, place): (usize, usize, usize), value: V) {
        // SAFETY: handed on.
        unsafe {
            if let Some(k) = self.k {
                value.store(k.add(place));
            }
            let (s, sum) = (self.s.add(place), self.sum.add(place));
            match self.number {
                0 => self.weight.fma(value, V::splat(0.0)).store(sum),
                1 | 2 => self.weight.fma(value, V::load(sum)).store(sum),
                _ => return self.ahead.fma(value.add(V::load(sum)), V::load(s)).store(s),
            }
            self.ahead.fma(value, V::load(s)).store(self.next.add(place));
        }
    }
}

/// Hands all rows to `sink`, some vectors of lanes at a time so that sums do not wait for each other.
///
/// # Safety
/// The machine has the width; `At` fits `s` and `delayed`.
#[inline(always)]
unsafe fn each_row<V: Eight, S: Sink<V>>(at: &At, s: *const f64, delayed: *const f64, sink: &mut S) {
    let mut v = 0;
    // SAFETY: handed on; `v` and what follows is below the lanes.
    unsafe {
        while v + 32 <= at.rows.lanes {
            vectors::<V, S, 4>(at, s, delayed, v, sink);
            v += 32;
        }
        while v + 16 <= at.rows.lanes {
            vectors::<V, S, 2>(at, s, delayed, v, sink);
            v += 16;
        }
        while v + 8 <= at.rows.lanes {
            vectors::<V, S, 1>(at, s, delayed, v, sink);
            v += 8;
        }
    }
}

/// # Safety
/// As `each_row`; `v + 8 K` lanes are there.
#[inline(always)]
unsafe fn vectors<V: Eight, S: Sink<V>, const K: usize>(at: &At, s: *const f64, delayed: *const f64, v: usize, sink: &mut S) {
    let rows = at.rows;
    let mut from = 0;
    // SAFETY: entries, sources and places are below what `fits` has checked; products end where the lists do.
    unsafe {
        let values = at.block.as_ptr().cast::<f64>().add(at.point);
        let (s, delayed) = (s.add(v), delayed.wrapping_add(v));
        for (row, ends) in rows.ends.iter().enumerate() {
            let place = row * rows.lanes + v;
            let mut sum: [V; K] = std::array::from_fn(|i| V::load(at.direct.as_ptr().add(place + 8 * i)));
            for (end, source) in [(ends[0] as usize, s), (ends[1] as usize, delayed)] {
                for p in rows.products.get_unchecked(from..end) {
                    let (x, source) = (V::splat(*values.add(p.entry as usize)), source.add(p.source as usize));
                    for (i, sum) in sum.iter_mut().enumerate() {
                        *sum = x.fma(V::load(source.add(8 * i)), *sum);
                    }
                }
                from = end;
            }
            for (i, sum) in sum.into_iter().enumerate() {
                sink.take((row, v + 8 * i, place + 8 * i), sum);
            }
        }
    }
}
