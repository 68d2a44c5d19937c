//! The noise of a base fit and what its segments leave in; residuals and sensitivities made white,
//! segment by segment, out.
//!
//! Every output has an autoregressive model (`crate::noise`), restarted at each segment. What the
//! white residuals of outputs that are sampled together still have in common (a gust moves all of
//! them) is taken out by a joint model. The same linear map makes sensitivities comparable with the
//! residuals.

use super::joint::{Joint, Rows};
use crate::estimate::Block;
use crate::math::pool;
use crate::math::products::dot;
use crate::math::turned::columns_of;
use crate::noise::Filter;
use std::borrow::Cow;
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
        self.whiten_less(segment, blocks, wanted, &|_| None)
    }

    /// The same with something taken out of the residuals of an output.
    pub fn whiten_less<'r>(
        &self,
        segment: usize,
        blocks: &[Block],
        wanted: &[usize],
        less: &dyn Fn(usize) -> Option<&'r [f64]>,
    ) -> Vec<Vec<f64>> {
        let known = |block: &&Block| self.filter(segment, block.output).is_some();
        let samples: usize = blocks.iter().filter(known).map(|b| b.e.len()).sum();
        let mut columns: Vec<Vec<f64>> = (0..=wanted.len()).map(|_| pool::take(samples)).collect();
        let mut rows: Vec<Option<Rows>> = Vec::new();
        let mut from = 0;
        for block in blocks {
            let Some(filter) = self.filter(segment, block.output) else { continue };
            let masked: Vec<bool> = block.e.iter().map(|e| !e.is_finite()).collect();
            let to = from + masked.len();
            columns_of(&block.g, wanted, from..to, &mut columns);
            let e = &mut columns[wanted.len()][from..to];
            e.copy_from_slice(&block.e);
            if let Some(less) = less(block.output) {
                e.iter_mut().zip(less).for_each(|(e, less)| *e -= less);
            }
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

    /// Sensitivities of a segment's blocks to the directions `wanted`, made white: rows
    /// `[sample][direction]`, block by block. None where a sample was not measured: `whiten` bridges
    /// gaps.
    pub fn whiten_rows(
        &self,
        segment: usize,
        blocks: &[Block],
        wanted: &[usize],
    ) -> Option<Vec<f64>> {
        if wanted.is_empty() {
            return Some(Vec::new());
        }
        if blocks.iter().any(|block| block.e.iter().any(|e| !e.is_finite())) {
            return None;
        }
        let known = |block: &&Block| self.filter(segment, block.output).is_some();
        let samples: usize = blocks.iter().filter(known).map(|block| block.e.len()).sum();
        let n = wanted.len();
        let mut single = pool::take(samples * n);
        let mut rows: Vec<Option<Rows>> = Vec::new();
        let mut from = 0;
        for block in blocks {
            let Some(filter) = self.filter(segment, block.output) else { continue };
            let to = from + block.e.len();
            let g = directions_of(block, wanted);
            filter.whiten_rows(&g, n, &mut single[from * n..to * n]);
            if let Cow::Owned(g) = g {
                pool::give(g);
            }
            rows.resize(rows.len().max(block.output + 1), None);
            rows[block.output] = Some(Rows { from, masked: vec![false; to - from] });
            from = to;
        }
        let joint = self.groups.get(segment).and_then(|&g| self.joint.get(g));
        let here = |joint: &&Joint| joint.set.segments.binary_search(&segment).is_ok();
        let joint: Vec<&Joint> = joint.into_iter().flatten().filter(here).collect();
        if joint.is_empty() {
            return Some(single);
        }
        let mut white = pool::take(samples * n);
        let is_alone = |o: &usize| joint.iter().all(|joint| !joint.set.outputs.contains(o));
        for Rows { from, masked } in
            (0..rows.len()).filter(is_alone).filter_map(|o| rows[o].as_ref())
        {
            let rows = from * n..(from + masked.len()) * n;
            white[rows.clone()].copy_from_slice(&single[rows]);
        }
        let mut joint = joint.into_iter();
        let done: Option<()> =
            joint.try_for_each(|joint| joint.apply_rows(&single, &mut white, n, &rows));
        pool::give(single);
        done.map(|()| white)
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
        let e = self.whiten(segment, blocks, &[]).pop().unwrap_or_default();
        let cost = 0.5 * dot(&e, &e);
        pool::give(e);
        cost
    }
}

/// The sensitivities of a block to some directions, `[sample][direction]`.
fn directions_of<'b>(block: &'b Block, wanted: &[usize]) -> Cow<'b, [f64]> {
    let all = block.g.len().checked_div(block.e.len()).unwrap_or(0);
    if all == wanted.len() && wanted.iter().enumerate().all(|(i, k)| i == *k) {
        return Cow::Borrowed(&block.g);
    }
    let mut some = pool::take(block.e.len() * wanted.len());
    let rows = block.g.chunks_exact(all.max(1));
    let runs = runs(wanted);
    for (some, row) in some.chunks_exact_mut(wanted.len().max(1)).zip(rows) {
        for (from, of) in &runs {
            some[*from..from + of.len()].copy_from_slice(&row[of.clone()]);
        }
    }
    Cow::Owned(some)
}

/// Directions that follow each other: where the first of them stands among those wanted, and which they are.
fn runs(wanted: &[usize]) -> Vec<(usize, Range<usize>)> {
    let mut runs: Vec<(usize, Range<usize>)> = Vec::new();
    for (place, &k) in wanted.iter().enumerate() {
        match runs.last_mut() {
            Some((_, of)) if of.end == k => of.end += 1,
            _ => runs.push((place, k..k + 1)),
        }
    }
    runs
}
