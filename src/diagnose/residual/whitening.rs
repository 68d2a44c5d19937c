//! The noise of a base fit and what its segments leave in; residuals and sensitivities made white,
//! segment by segment, out.
//!
//! Every output has an autoregressive model (`crate::noise`), restarted at each segment. What the
//! white residuals of outputs that are sampled together still have in common (a gust moves all of
//! them) is taken out by a joint model. The same linear map makes sensitivities comparable with the
//! residuals.

use super::joint::{Joint, Rows};
use crate::estimate::Block;
use crate::math::products::dot;
use crate::noise::Filter;
use std::collections::BTreeMap;
use std::ops::Range;

/// The noise of a base fit: a filter per group of segments and output.
#[derive(Debug, Clone, PartialEq)]
pub struct Noise {
    /// `[group][scored output]`; none where nothing is known of it.
    pub(super) filters: Vec<Vec<Option<Filter>>>,
    /// `[group]`: joint models of the white residuals, each of other outputs, and where they hold.
    pub(super) joint: Vec<Vec<Joint>>,
    /// Group of each segment.
    pub(super) groups: Vec<usize>,
    /// Outputs, by their place among the scored ones, whose model ended below the order that the
    /// criterion asked for, and that order.
    pub(super) cut: Vec<(usize, usize)>,
}

impl Noise {
    /// Residuals and sensitivities of a segment's blocks, made white: a column for each of the
    /// directions `wanted`, then the residuals; rows block by block. Outputs of unknown noise are
    /// left out; rows of samples that were not measured are 0.
    pub fn whiten(&self, segment: usize, blocks: &[Block], wanted: &[usize]) -> Vec<Vec<f64>> {
        let known = |block: &&Block| self.filter(segment, block.output).is_some();
        let samples: usize = blocks.iter().filter(known).map(|b| b.e.len()).sum();
        let mut columns = vec![vec![0.0; samples]; wanted.len() + 1];
        let mut rows: Vec<Option<Rows>> = Vec::new();
        let mut from = 0;
        for block in blocks {
            let Some(filter) = self.filter(segment, block.output) else { continue };
            let masked: Vec<bool> = block.e.iter().map(|e| !e.is_finite()).collect();
            let to = from + masked.len();
            columns_of(&block.g, wanted, from..to, &mut columns);
            columns[wanted.len()][from..to].copy_from_slice(&block.e);
            filter.whiten_all(columns.iter_mut().map(|column| &mut column[from..to]), &masked);
            rows.resize(rows.len().max(block.output + 1), None);
            rows[block.output] = Some(Rows { from, masked });
            from = to;
        }
        let joint = self.groups.get(segment).and_then(|&g| self.joint.get(g));
        for joint in joint
            .into_iter()
            .flatten()
            .filter(|joint| joint.set.segments.binary_search(&segment).is_ok())
        {
            joint.apply(&mut columns, &rows);
        }
        columns
    }

    /// Outputs whose noise is modelled no further than to some order, with the least such order.
    pub fn cut(&self) -> BTreeMap<usize, usize> {
        let mut least = BTreeMap::new();
        for &(output, order) in &self.cut {
            let known = least.entry(output).or_insert(order);
            *known = order.min(*known);
        }
        least
    }

    /// Outputs that leave nothing to model in any group: they take no part.
    pub fn unknown(&self) -> Vec<usize> {
        let outputs = self.filters.first().map_or(0, Vec::len);
        (0..outputs).filter(|&o| self.filters.iter().all(|of| of[o].is_none())).collect()
    }

    pub fn filter(&self, segment: usize, output: usize) -> Option<&Filter> {
        self.filters.get(*self.groups.get(segment)?)?.get(output)?.as_ref()
    }

    /// Half the sum of squares of a segment's white residuals: its part of the cost.
    pub fn cost(&self, segment: usize, blocks: &[Block]) -> f64 {
        let columns = self.whiten(segment, blocks, &[]);
        columns.last().map_or(0.0, |e| 0.5 * dot(e, e))
    }
}

/// Rows of sensitivities `[sample][direction]` into the rows `to` of columns, those wanted.
fn columns_of(g: &[f64], wanted: &[usize], to: Range<usize>, columns: &mut [Vec<f64>]) {
    let directions = g.len().checked_div(to.len()).unwrap_or(0);
    // Samples in pieces that stay in the cache while every column takes its own.
    for (piece, rows) in g.chunks(PIECE * directions.max(1)).enumerate() {
        let from = to.start + piece * PIECE;
        for (&k, column) in wanted.iter().zip(columns.iter_mut()) {
            let row = rows.chunks_exact(directions.max(1));
            column[from..to.end].iter_mut().zip(row).for_each(|(x, row)| *x = row[k]);
        }
    }
}

/// Samples that are turned at a time.
const PIECE: usize = 64;

/// Columns as rows `[sample][column]`.
pub fn rows_of(columns: &[Vec<f64>]) -> Vec<f64> {
    let (n, samples) = (columns.len(), columns.first().map_or(0, Vec::len));
    let mut rows = vec![0.0; n * samples];
    for (piece, rows) in rows.chunks_mut(PIECE * n.max(1)).enumerate() {
        for (k, column) in columns.iter().enumerate() {
            let of = rows.chunks_exact_mut(n);
            of.zip(&column[piece * PIECE..]).for_each(|(row, x)| row[k] = *x);
        }
    }
    rows
}
