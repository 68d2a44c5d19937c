//! Normal equations: sums over one segment, and over all of them for any weights of the outputs.

use super::arrow::{Arrow, Own};
use super::blocks::Block;
use super::layout::{Layout, Part};
use super::rows::{self, add_scaled};
use serde::{Deserialize, Serialize};

/// Sums over one segment of rows of equal weight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sums {
    /// The output, or 0 where the rows have been weighed already.
    pub kind: usize,
    pub count: usize,
    /// Sum of e^2.
    pub square: f64,
    /// `G'G` over the segment's directions, lower triangle, `[nd][nd]`.
    gram: Vec<f64>,
    /// `G'e`.
    gradient: Vec<f64>,
}

/// What remains of all segments once they are added: enough for any weights of the kinds of rows.
#[derive(Debug, Clone)]
pub struct Totals {
    shared: usize,
    /// Per kind `[shared][shared]` and `[shared]`.
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
    pub fn add(&mut self, part: &Part, sums: &[Sums]) {
        let own = sums.iter().map(|sum| self.split(part, sum)).collect();
        self.own.push(own);
    }

    fn split(&mut self, part: &Part, sum: &Sums) -> OwnSums {
        let (nl, nd, nc) = (part.shared.len(), part.directions(), self.shared);
        let gram = &mut self.gram[sum.kind];
        for (i, &gi) in part.shared.iter().enumerate() {
            self.gradient[sum.kind][gi] += sum.gradient[i];
            for (j, &gj) in part.shared[..=i].iter().enumerate() {
                let value = sum.gram[i * nd + j];
                gram[gi * nc + gj] += value;
                if i != j {
                    gram[gj * nc + gi] += value;
                }
            }
        }
        let mut own = Own::empty(part.own, &part.shared);
        for i in 0..part.own {
            let row = &sum.gram[(nl + i) * nd..(nl + i + 1) * nd];
            own.sc[i * nl..(i + 1) * nl].copy_from_slice(&row[..nl]);
            for j in 0..=i {
                own.ss[i * part.own + j] = row[nl + j];
                own.ss[j * part.own + i] = row[nl + j];
            }
        }
        OwnSums { kind: sum.kind, sums: own, gradient: sum.gradient[nl..].to_vec() }
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
    let mut sums = Sums {
        kind: block.output,
        count: 0,
        square: 0.0,
        gram: vec![0.0; nd * nd],
        gradient: vec![0.0; nd],
    };
    (sums.count, sums.square) =
        rows::add(&block.e, &block.g, nd, &mut sums.gram, &mut sums.gradient);
    (sums.count, sums.square) = block.costs(sums.count, sums.square);
    let finite = sums.square.is_finite()
        && (0..nd).all(|i| sums.gradient[i].is_finite() && sums.gram[i * nd + i].is_finite());
    finite.then_some(sums)
}
