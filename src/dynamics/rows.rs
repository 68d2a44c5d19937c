//! Sparse Jacobians over lanes of directions: `J_x S + J_p + J_d D`, and with it Runge-Kutta steps
//! of S, eight directions at a time.
//!
//! The rows of S and, behind them, those of D (sensitivities of delayed values) stand in one list,
//! so that a row of the result is one sum. Some vectors of directions go through all points of a
//! call before the next ones begin: directions do not see each other, and their part of S stays in
//! the nearest cache.

use crate::math::simd::{Aligned, Eight, by_width};
use crate::model::Program;
use crate::model::linear::Sparse;
use std::ops::Range;

/// Points of one evaluation side by side.
pub(super) const LANES: usize = 16;

/// One product of a row: where the entry of the Jacobian stands in a file of registers (`LANES`
/// points each), and where the row that it multiplies.
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
    /// The end of each row's products in `products`.
    ends: Vec<u32>,
    products: Vec<Product>,
    /// Where an entry stands, and the row and direction that it acts on by itself.
    direct: Vec<(u32, u32)>,
    /// Registers of the program that computes the entries.
    registers: usize,
    /// Numbers of S and D that are read.
    reach: usize,
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
        let mut out = Rows { rows, lanes, registers: program.file_len(), ..Default::default() };
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
            out.direct.push((place(e.output), (e.row * lanes + e.column) as u32));
        }
        out
    }

    /// Numbers of one result.
    pub fn size(&self) -> usize {
        self.rows * self.lanes
    }

    /// Writes what acts by itself, `J_p`, at `LANES` points; other numbers of `direct` stay zero.
    pub fn spread(&self, registers: &[[f64; LANES]], direct: &mut Aligned) {
        let size = self.size();
        for &(entry, at) in &self.direct {
            for (l, value) in registers[entry as usize / LANES].iter().enumerate() {
                direct[l * size + at as usize] = *value;
            }
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
    fn fits(&self, points: &Range<usize>) -> bool {
        self.rows.lanes.is_multiple_of(8)
            && self.registers.len() >= self.rows.registers
            && points.end <= LANES
            && self.direct.len() >= points.end * self.rows.size()
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

/// A row of the result at one point: the sum that begins with its direct part.
///
/// # Safety
/// The machine has the width; `products` are some of `block`'s, which fits; from `source` on as
/// many numbers can be read as they reach.
#[inline(always)]
unsafe fn row_of<V: Eight, const K: usize>(
    values: *const f64,
    direct: *const f64,
    products: &[Product],
    source: *const f64,
) -> [V; K] {
    // SAFETY: the caller's promises.
    unsafe {
        let mut sum: [V; K] = std::array::from_fn(|i| V::load(direct.add(8 * i)));
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
            block.direct.as_ptr().add(point * rows.size() + v),
        );
        for (row, &end) in rows.ends.iter().enumerate() {
            let products = rows.products.get_unchecked(from..end as usize);
            let sum = row_of::<V, K>(values, direct.add(row * rows.lanes), products, s.add(v));
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
            let list = to.lists.get_unchecked_mut(row).as_mut_ptr().add(to.k * to.directions + v);
            for (k, point) in points.clone().enumerate() {
                let values = block.registers.as_ptr().cast::<f64>().add(point);
                let direct = block.direct.as_ptr().add(point * rows.size() + row * rows.lanes + v);
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

/// Runge-Kutta steps of S: `k = J_x S + J_p + J_d D`, `sum += weight k`, next `S = s + ahead k`;
/// the last stage `s += ahead (sum + k)`.
pub struct Steps<'a> {
    /// S at the start of a step; after its last stage at its end.
    pub s: &'a mut [f64],
    /// The weighed sum of rates.
    pub sum: &'a mut [f64],
    /// S and D at the stages: the first stage reads `between[1]` (or `s`, see `plain`) and writes
    /// `between[0]`, the second reads that and writes `between[1]`, and so on.
    pub between: [&'a mut [f64]; 2],
    /// The rates themselves, where somebody wants them.
    pub k: Option<&'a mut [f64]>,
    /// Per stage its weight, and how far its rates lead to the next stage (after the last one: what
    /// the sum is multiplied by).
    pub weights: [[f64; 2]; 4],
    /// Whether the first stage is simply the start of the step.
    pub plain: bool,
    /// Where S at the start of every `every`th step of the call is kept, `[step][rows of S]`; none
    /// if it is zero.
    pub kept: &'a mut [f64],
    pub every: usize,
    /// Steps since the last one that was kept.
    pub phase: usize,
}

by_width! {
    /// Takes S through some stages of a block, each the one of its step that its number modulo four
    /// tells.
    ///
    /// # Safety
    /// The machine has the width.
    pub fn steps(block: Block, stages: Range<usize>, job: &mut Steps) = steps_body
}

#[inline(always)]
unsafe fn steps_body<V: Eight>(block: Block, stages: Range<usize>, job: &mut Steps) {
    let (size, reach) = (block.rows.size(), block.rows.reach);
    assert!(block.fits(&stages) && job.s.len() >= size && job.sum.len() >= size);
    assert!(
        job.k.as_ref().is_none_or(|k| k.len() >= size)
            && job.between.iter().all(|b| b.len() >= size.max(reach))
    );
    assert!(!job.plain || job.s.len() >= reach);
    let started = stages.clone().filter(|n| n % 4 == 0).count();
    if job.every > 0 {
        let kept = (job.phase + started).div_ceil(job.every) - usize::from(job.phase > 0);
        assert!(job.phase < job.every && job.kept.len() >= kept * size);
    }
    // SAFETY: the sizes were just checked.
    unsafe { each_chunk!(block.rows.lanes, v, steps_chunk, &block, &stages, job) }
}

/// # Safety
/// As `steps_body`, sizes checked.
#[inline(always)]
unsafe fn steps_chunk<V: Eight, const K: usize>(
    v: usize,
    block: &Block,
    stages: &Range<usize>,
    job: &mut Steps,
) {
    let size = block.rows.size();
    let (mut phase, mut kept) = (job.phase, job.kept.as_mut_ptr());
    // SAFETY: the caller's promises.
    unsafe {
        for n in stages.clone() {
            if n % 4 == 0 && job.every > 0 {
                if phase == 0 {
                    copy_rows::<V, K>(v, block.rows, job.s.as_ptr(), kept);
                    kept = kept.add(size);
                }
                phase = (phase + 1) % job.every;
            }
            match n % 4 {
                0 => stage::<V, K, 0>(v, block, n, job),
                1 => stage::<V, K, 1>(v, block, n, job),
                2 => stage::<V, K, 2>(v, block, n, job),
                _ => stage::<V, K, 3>(v, block, n, job),
            }
        }
    }
}

/// # Safety
/// The machine has the width; both have the size of `rows`.
#[inline(always)]
unsafe fn copy_rows<V: Eight, const K: usize>(
    v: usize,
    rows: &Rows,
    from: *const f64,
    to: *mut f64,
) {
    for row in 0..rows.rows {
        for i in 0..K {
            let at = row * rows.lanes + v + 8 * i;
            // SAFETY: the caller's promises.
            unsafe { V::load(from.add(at)).store(to.add(at)) };
        }
    }
}

/// # Safety
/// As `steps_body`, sizes checked; `N` is `n % 4`.
#[inline(always)]
unsafe fn stage<V: Eight, const K: usize, const N: usize>(
    v: usize,
    block: &Block,
    n: usize,
    job: &mut Steps,
) {
    let rows = block.rows;
    let [a, b] = [job.between[0].as_mut_ptr(), job.between[1].as_mut_ptr()];
    let (s, sum) = (job.s.as_mut_ptr(), job.sum.as_mut_ptr());
    let from: *const f64 = if N == 0 && job.plain { s } else { [b, a, b, a][N] };
    let to = [a, b, a, s][N];
    let mut first = 0;
    // SAFETY: the caller's promises.
    unsafe {
        let (weight, ahead) = (V::splat(job.weights[N][0]), V::splat(job.weights[N][1]));
        let (values, direct) = (
            block.registers.as_ptr().cast::<f64>().add(n),
            block.direct.as_ptr().add(n * rows.size() + v),
        );
        for (row, &end) in rows.ends.iter().enumerate() {
            let products = rows.products.get_unchecked(first..end as usize);
            first = end as usize;
            let k = row_of::<V, K>(values, direct.add(row * rows.lanes), products, from.add(v));
            for (i, k) in k.into_iter().enumerate() {
                let at = row * rows.lanes + v + 8 * i;
                if let Some(list) = &mut job.k {
                    k.store(list.as_mut_ptr().add(at));
                }
                let led = match N {
                    0 => {
                        weight.fma(k, V::splat(0.0)).store(sum.add(at));
                        k
                    }
                    3 => k.add(V::load(sum.add(at))),
                    _ => {
                        weight.fma(k, V::load(sum.add(at))).store(sum.add(at));
                        k
                    }
                };
                ahead.fma(led, V::load(s.add(at))).store(to.add(at));
            }
        }
    }
}
