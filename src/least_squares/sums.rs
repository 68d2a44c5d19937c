//! Normal equations: sums over one segment, and over all of them for any weights of the outputs.

use super::arrow::{Arrow, Own};
use super::blocks::Block;
use super::layout::{Layout, Part};
use super::rows::{self, add_scaled};
use crate::math::pool;
use serde::{Deserialize, Serialize};

/// Sums over one segment of rows of equal weight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sums {
    /// The output, or 0 where the rows have been weighed already.
    pub kind: usize,
    pub count: usize,
    /// Sum of e^2.
    pub square: f64,
    /// `G'G` over the segment's directions, lower triangle, row by row, and `G'e`.
    packed: Vec<f64>,
}

impl Sums {
    /// Row `i` of `G'G` as far as the diagonal.
    fn row(&self, i: usize) -> &[f64] {
        &self.packed[i * (i + 1) / 2..][..=i]
    }

    /// `G'e` of `nd` directions.
    fn gradient(&self, nd: usize) -> &[f64] {
        &self.packed[nd * (nd + 1) / 2..]
    }
}

/// What remains of all segments once they are added: enough for any weights of the kinds of rows.
#[derive(Debug, Clone)]
pub struct Totals {
    shared: usize,
    /// Per kind `[shared][shared]`, lower triangle, and `[shared]`.
    gram: Vec<Vec<f64>>,
    gradient: Vec<Vec<f64>>,
    /// Per segment and kind: the rows of its own parameters.
    own: Vec<Vec<OwnSums>>,
}

#[derive(Debug, Clone)]
struct OwnSums {
    kind: usize,
    sums: Own,
    gradient: Vec<f64>,
}

impl Totals {
    /// Nothing yet.
    pub fn new(shared: usize, kinds: usize) -> Totals {
        Totals {
            shared,
            gram: vec![vec![0.0; shared * shared]; kinds],
            gradient: vec![vec![0.0; shared]; kinds],
            own: Vec::new(),
        }
    }

    /// Adds a segment's sums: the shared part to the others', the rest by itself.
    pub fn add(&mut self, part: &Part, sums: Vec<Sums>) {
        let own = sums.iter().map(|sum| self.split(part, sum)).collect();
        self.own.push(own);
        sums.into_iter().for_each(|sum| pool::give(sum.packed));
    }

    fn split(&mut self, part: &Part, sum: &Sums) -> OwnSums {
        let (nl, nd, nc) = (part.shared.len(), part.directions(), self.shared);
        let (gram, slopes) = (&mut self.gram[sum.kind], sum.gradient(nd));
        for (i, &gi) in part.shared.iter().enumerate() {
            self.gradient[sum.kind][gi] += slopes[i];
            let (row, to) = (sum.row(i), &part.shared[..=i]);
            // A segment sees most of them, one after the other.
            if gi - to[0] == i && to.is_sorted() {
                let of = &mut gram[gi * nc + to[0]..=gi * nc + gi];
                of.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
                continue;
            }
            for (&gj, value) in to.iter().zip(row) {
                gram[gi.max(gj) * nc + gi.min(gj)] += value;
            }
        }
        let mut own = Own::empty(part.own, &part.shared);
        for i in 0..part.own {
            let row = sum.row(nl + i);
            own.sc[i * nl..(i + 1) * nl].copy_from_slice(&row[..nl]);
            for j in 0..=i {
                own.ss[i * part.own + j] = row[nl + j];
                own.ss[j * part.own + i] = row[nl + j];
            }
        }
        OwnSums { kind: sum.kind, sums: own, gradient: slopes[nl..].to_vec() }
    }

    /// The normal matrix `M = sum G' R^-1 G` and gradient `G' R^-1 e` for the given weights of the
    /// kinds.
    pub fn weigh(&self, layout: &Layout, weights: &[f64]) -> (Arrow, Vec<f64>) {
        let nc = self.shared;
        let mut matrix =
            Arrow { shared: nc, cc: vec![0.0; nc * nc], own: Vec::with_capacity(self.own.len()) };
        let mut gradient = vec![0.0; layout.start.len()];
        for (kind, &w) in weights.iter().enumerate() {
            add_scaled(&mut matrix.cc, w, &self.gram[kind]);
            add_scaled(&mut gradient[..nc], w, &self.gradient[kind]);
        }
        for i in 0..nc {
            (0..i).for_each(|j| matrix.cc[j * nc + i] = matrix.cc[i * nc + j]);
        }
        for (part, sums) in layout.parts.iter().zip(&self.own) {
            let mut own = Own::empty(part.own, &part.shared);
            for sum in sums {
                let w = weights[sum.kind];
                add_scaled(&mut own.ss, w, &sum.sums.ss);
                add_scaled(&mut own.sc, w, &sum.sums.sc);
                add_scaled(&mut gradient[part.offset..part.offset + part.own], w, &sum.gradient);
            }
            matrix.own.push(own);
        }
        (matrix, gradient)
    }
}

/// Sums of one block, or `None` where a scored sample has a value or a sensitivity that is not
/// finite.
pub fn sum_block(block: &Block, nd: usize) -> Option<Sums> {
    let mut sums = pool::take(rows::room(nd));
    let (count, square) = rows::add(&block.e, &block.g, nd, &mut sums);
    let (count, square) = block.costs(count, square);
    let mut packed = pool::take(nd * (nd + 1) / 2 + nd);
    packed.clear();
    for (i, row) in sums.chunks_exact(nd.next_multiple_of(8).max(1)).enumerate().take(nd + 1) {
        packed.extend_from_slice(&row[..(i + 1).min(nd)]);
    }
    pool::give(sums);
    let sums = Sums { kind: block.output, count, square, packed };
    let finite = sums.square.is_finite()
        && (0..nd).all(|i| sums.gradient(nd)[i].is_finite() && sums.row(i)[i].is_finite());
    finite.then_some(sums)
}
