//! The least-squares problem over segments: a parameter vector in; residual sums and normal
//! equations, added in segment order, out.
//!
//! With one diagonal `R` one pass is enough: sums are kept per output and weighed once all
//! residuals are known. Otherwise `R` comes first (a pass without sensitivities), and every segment
//! then weighs its own rows, so that a segment costs the same however many groups there are.

use super::arrow::{Arrow, Own};
use super::covariance::{Covariance, Scatter, Structure};
use super::rows;
use crate::math::pool;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;

/// Segments evaluated at a time. Fixed, so that memory is bounded and sums never depend on the
/// number of threads.
const CHUNK: usize = 64;

/// Parameters of one segment: which shared ones it sees, and how many are its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Indices into the shared parameters, in the order of the segment's directions.
    pub shared: Vec<usize>,
    /// Where its own parameters begin in the parameter vector.
    pub offset: usize,
    /// Number of its own parameters; they follow the shared ones in the segment's directions.
    pub own: usize,
    /// The group of segments whose `R` it shares.
    pub group: usize,
    /// Where outputs may be correlated: the number of the instant of every sample of every block,
    /// ascending; samples of the same number belong together.
    pub instants: Vec<Vec<u32>>,
}

impl Part {
    /// Number of directions of this segment.
    pub fn directions(&self) -> usize {
        self.shared.len() + self.own
    }
}

/// The parameter vector: shared parameters first, then each segment's own.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Number of shared parameters.
    pub shared: usize,
    pub parts: Vec<Part>,
    /// Where the iteration begins.
    pub start: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Centre and standard deviation of a prior; infinite without one.
    pub centre: Vec<f64>,
    pub prior_sd: Vec<f64>,
    pub noise: Structure,
}

impl Layout {
    /// Every segment sees all `shared` parameters and has `own[s]` of its own; unbounded, no
    /// priors, one diagonal `R`.
    #[cfg(test)]
    pub fn plain(shared: usize, own: &[usize], outputs: usize, start: Vec<f64>) -> Layout {
        let mut offset = shared;
        let parts = own
            .iter()
            .map(|&own| {
                let part = Part {
                    shared: (0..shared).collect(),
                    offset,
                    own,
                    group: 0,
                    instants: Vec::new(),
                };
                offset += own;
                part
            })
            .collect();
        let n = start.len();
        Layout {
            shared,
            parts,
            centre: start.clone(),
            start,
            lower: vec![f64::NEG_INFINITY; n],
            upper: vec![f64::INFINITY; n],
            prior_sd: vec![f64::INFINITY; n],
            noise: Structure {
                outputs,
                groups: 1,
                full: false,
                floor: vec![1e-30; outputs],
                known: false,
            },
        }
    }

    /// Information of the prior of parameter `i`: `1/sd^2`, 0 without one.
    pub fn prior_weight(&self, i: usize) -> f64 {
        let sd = self.prior_sd[i];
        if sd.is_finite() { 1.0 / (sd * sd) } else { 0.0 }
    }

    /// What the prior of parameter `i` adds to the normal equations at `value`: its weight, and its
    /// pull downhill.
    pub fn prior(&self, i: usize, value: f64) -> (f64, f64) {
        let weight = self.prior_weight(i);
        (weight, if weight > 0.0 { weight * (self.centre[i] - value) } else { 0.0 })
    }

    /// The parameters as segment `s` sees them, in the order of its directions.
    pub fn local(&self, s: usize, theta: &[f64]) -> Vec<f64> {
        let part = &self.parts[s];
        let mut local: Vec<f64> = part.shared.iter().map(|&i| theta[i]).collect();
        local.extend_from_slice(&theta[part.offset..part.offset + part.own]);
        local
    }
}

/// Residuals of one channel of one segment, and the sensitivities of its prediction.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Which of the scored outputs.
    pub output: usize,
    /// Residuals `z - y`, one per sample; NaN marks a masked sample.
    pub e: Vec<f64>,
    /// `dy/dtheta`, `[sample][direction]` row by row; empty where no sensitivities were asked for.
    pub g: Vec<f64>,
}

/// A model over segments.
pub trait Evaluate: Sync {
    /// The blocks of one segment (parameters: the shared ones it sees, then its own; the same
    /// blocks in the same order at every parameter vector), or `None` where its model is not
    /// finite.
    fn blocks(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>>;

    /// Sums over each of these segments, in their order. This is the work that may be done
    /// elsewhere; here it is done by the threads of this process.
    fn sums(
        &self,
        layout: &Layout,
        theta: &[f64],
        wanted: &Wanted,
        segments: Range<usize>,
    ) -> Vec<Option<SegmentSums>>
    where
        Self: Sized,
    {
        segments.into_par_iter().map(|s| segment_sums(layout, self, theta, wanted, s)).collect()
    }
}

impl<F: Fn(usize, &[f64], bool) -> Option<Vec<Block>> + Sync> Evaluate for F {
    fn blocks(&self, s: usize, local: &[f64], sensitivities: bool) -> Option<Vec<Block>> {
        self(s, local, sensitivities)
    }
}

/// Which sums are wanted of every segment.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Wanted<'a> {
    /// Of residuals alone.
    Scatter,
    /// Of rows, per output.
    PerOutput,
    /// Of rows weighed with known `R` (per group).
    Weighed(Cow<'a, [Covariance]>),
}

/// Sums over one segment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum SegmentSums {
    Scatter(Scatter),
    PerOutput(Vec<Sums>),
    Weighed(Sums),
}

impl SegmentSums {
    /// Whether these are the sums that are wanted.
    pub fn are(&self, wanted: &Wanted) -> bool {
        matches!(
            (self, wanted),
            (SegmentSums::Scatter(_), Wanted::Scatter)
                | (SegmentSums::PerOutput(_), Wanted::PerOutput)
                | (SegmentSums::Weighed(_), Wanted::Weighed(_))
        )
    }
}

/// Sums over one segment; `None` where it is not finite.
pub fn segment_sums<E: Evaluate>(
    layout: &Layout,
    evaluate: &E,
    theta: &[f64],
    wanted: &Wanted,
    s: usize,
) -> Option<SegmentSums> {
    let sensitivities = !matches!(wanted, Wanted::Scatter);
    let blocks = evaluate.blocks(s, &layout.local(s, theta), sensitivities)?;
    let nd = layout.parts[s].directions();
    let sums = match wanted {
        Wanted::Scatter => {
            let scatter = scatter_of(layout, s, &blocks);
            scatter.is_finite().then_some(SegmentSums::Scatter(scatter))
        }
        Wanted::PerOutput => blocks
            .iter()
            .map(|block| sum_block(block, nd))
            .collect::<Option<_>>()
            .map(SegmentSums::PerOutput),
        Wanted::Weighed(r) => whiten(layout, s, &blocks, &r[layout.parts[s].group])
            .and_then(|white| sum_block(&white, nd))
            .map(SegmentSums::Weighed),
    };
    give_back(blocks);
    sums
}

/// Sums over one segment of rows of equal weight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sums {
    /// The output, or 0 where the rows have been weighed already.
    kind: usize,
    count: usize,
    /// Sum of e^2.
    square: f64,
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

/// Calls `one(segment, blocks)` for all segments and `take` in segment order; `None` where any
/// segment is not finite.
pub fn each<F: Evaluate, T: Send>(
    layout: &Layout,
    evaluate: &F,
    theta: &[f64],
    sensitivities: bool,
    one: impl Fn(usize, Vec<Block>) -> Option<T> + Sync,
    mut take: impl FnMut(usize, T),
) -> Option<()> {
    for from in (0..layout.parts.len()).step_by(CHUNK) {
        let to = (from + CHUNK).min(layout.parts.len());
        let chunk: Vec<Option<T>> = (from..to)
            .into_par_iter()
            .map(|s| one(s, evaluate.blocks(s, &layout.local(s, theta), sensitivities)?))
            .collect();
        for (s, value) in (from..to).zip(chunk) {
            take(s, value?);
        }
    }
    Some(())
}

/// Calls `take` with the sums of all segments in segment order; `None` where one is not finite.
fn gather<E: Evaluate>(
    layout: &Layout,
    evaluate: &E,
    theta: &[f64],
    wanted: &Wanted,
    mut take: impl FnMut(usize, SegmentSums),
) -> Option<()> {
    for from in (0..layout.parts.len()).step_by(CHUNK) {
        let these = from..(from + CHUNK).min(layout.parts.len());
        let sums = evaluate.sums(layout, theta, wanted, these.clone());
        for (s, sums) in these.zip(sums) {
            take(s, sums?);
        }
    }
    Some(())
}

/// Residuals of all segments at `theta`, per group; `None` where any segment is not finite.
pub fn scatter<E: Evaluate>(layout: &Layout, evaluate: &E, theta: &[f64]) -> Option<Vec<Scatter>> {
    let mut groups = vec![Scatter::default(); layout.noise.groups];
    gather(layout, evaluate, theta, &Wanted::Scatter, |s, sums| {
        if let SegmentSums::Scatter(scatter) = sums {
            groups[layout.parts[s].group].merge(&scatter);
        }
    })?;
    Some(groups)
}

/// One pass for one diagonal `R`: residuals, and sums per output.
pub fn pass<E: Evaluate>(
    layout: &Layout,
    evaluate: &E,
    theta: &[f64],
) -> Option<(Vec<Scatter>, Totals)> {
    let mut scatter = Scatter::default();
    let mut totals = Totals::new(layout.shared, layout.noise.outputs);
    gather(layout, evaluate, theta, &Wanted::PerOutput, |s, sums| {
        if let SegmentSums::PerOutput(sums) = sums {
            sums.iter().for_each(|sum| scatter.add_alone(sum.kind, sum.count, sum.square));
            totals.add(&layout.parts[s], &sums);
        }
    })?;
    Some((vec![scatter], totals))
}

/// Sums of rows weighed with known `R` (per group): one kind, of weight 1.
pub fn weighed<E: Evaluate>(
    layout: &Layout,
    evaluate: &E,
    theta: &[f64],
    r: &[Covariance],
) -> Option<Totals> {
    let mut totals = Totals::new(layout.shared, 1);
    gather(layout, evaluate, theta, &Wanted::Weighed(r.into()), |s, sums| {
        if let SegmentSums::Weighed(sum) = sums {
            totals.add(&layout.parts[s], &[sum]);
        }
    })?;
    Some(totals)
}

/// Keeps the memory of blocks for the next ones.
pub fn give_back(blocks: Vec<Block>) {
    for block in blocks {
        pool::give(block.g);
        pool::give(block.e);
    }
}

/// Which samples count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Samples {
    /// Those that are not masked.
    Scored,
    All,
}

/// Block and sample of everything measured at one instant, outputs ascending, handed to `f` instant
/// by instant. With `R` diagonal every sample is an instant.
pub fn at_instants(
    layout: &Layout,
    s: usize,
    blocks: &[Block],
    samples: Samples,
    mut f: impl FnMut(&[(usize, usize)]),
) {
    let instants = &layout.parts[s].instants;
    let counts = |b: usize, k: usize| samples == Samples::All || !blocks[b].e[k].is_nan();
    if !layout.noise.full {
        for (b, block) in blocks.iter().enumerate() {
            (0..block.e.len()).filter(|&k| counts(b, k)).for_each(|k| f(&[(b, k)]));
        }
        return;
    }
    let mut order: Vec<usize> = (0..blocks.len()).collect();
    order.sort_by_key(|&b| blocks[b].output);
    let mut next = vec![0; blocks.len()];
    let mut present = Vec::new();
    while let Some(now) = (0..blocks.len()).filter_map(|b| instants[b].get(next[b])).min().copied()
    {
        present.clear();
        for &b in &order {
            if instants[b].get(next[b]) == Some(&now) {
                if counts(b, next[b]) {
                    present.push((b, next[b]));
                }
                next[b] += 1;
            }
        }
        if !present.is_empty() {
            f(&present);
        }
    }
}

fn scatter_of(layout: &Layout, s: usize, blocks: &[Block]) -> Scatter {
    let mut scatter = Scatter::default();
    if layout.noise.full {
        let (mut outputs, mut e) = (Vec::new(), Vec::new());
        at_instants(layout, s, blocks, Samples::Scored, |present| {
            outputs.clear();
            outputs.extend(present.iter().map(|&(b, _)| blocks[b].output));
            e.clear();
            e.extend(present.iter().map(|&(b, k)| blocks[b].e[k]));
            scatter.add_together(&outputs, &e);
        });
    } else {
        for block in blocks {
            let scored = block.e.iter().filter(|e| !e.is_nan());
            scatter.add_alone(block.output, scored.clone().count(), scored.map(|e| e * e).sum());
        }
    }
    scatter
}

/// All rows of a segment, made of covariance one: `C^-1 G_m`, `C^-1 e_m` with `R_m = C C'`, instant
/// by instant.
fn whiten(layout: &Layout, s: usize, blocks: &[Block], r: &Covariance) -> Option<Block> {
    let nd = layout.parts[s].directions();
    let mut white = Block { output: 0, e: Vec::new(), g: Vec::new() };
    let (mut known, mut outputs) = (true, Vec::new());
    at_instants(layout, s, blocks, Samples::Scored, |present| {
        outputs.clear();
        outputs.extend(present.iter().map(|&(b, _)| blocks[b].output));
        let Some(weight) = r.weight(&outputs) else {
            known = false;
            return;
        };
        let m = outputs.len();
        for i in 0..m {
            let at = white.g.len();
            white.g.resize(at + nd, 0.0);
            let mut e = 0.0;
            for (&(b, k), w) in present.iter().zip(&weight.root[i * m..i * m + i + 1]) {
                e += w * blocks[b].e[k];
                add_scaled(&mut white.g[at..], *w, &blocks[b].g[k * nd..(k + 1) * nd]);
            }
            white.e.push(e);
        }
    });
    known.then_some(white)
}

impl Totals {
    fn new(shared: usize, kinds: usize) -> Totals {
        Totals {
            shared,
            gram: vec![vec![0.0; shared * shared]; kinds],
            gradient: vec![vec![0.0; shared]; kinds],
            own: Vec::new(),
        }
    }

    /// Adds a segment's sums: the shared part to the others', the rest by itself.
    fn add(&mut self, part: &Part, sums: &[Sums]) {
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

fn add_scaled(to: &mut [f64], w: f64, from: &[f64]) {
    for (t, f) in to.iter_mut().zip(from) {
        *t += w * f;
    }
}

/// Sums of one block, or `None` where a scored sample has a value or a sensitivity that is not
/// finite.
fn sum_block(block: &Block, nd: usize) -> Option<Sums> {
    let mut sums = Sums {
        kind: block.output,
        count: 0,
        square: 0.0,
        gram: vec![0.0; nd * nd],
        gradient: vec![0.0; nd],
    };
    (sums.count, sums.square) =
        rows::add(&block.e, &block.g, nd, &mut sums.gram, &mut sums.gradient);
    let finite = sums.square.is_finite()
        && (0..nd).all(|i| sums.gradient[i].is_finite() && sums.gram[i * nd + i].is_finite());
    finite.then_some(sums)
}
