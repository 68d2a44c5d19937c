//! The least-squares problem over segments: a parameter vector in; residual sums and normal
//! equations, added in segment order, out.
//!
//! With one diagonal `R` one pass is enough: sums are kept per output and weighed once all
//! residuals are known. Otherwise `R` comes first (a pass without sensitivities), and every segment
//! then weighs its own rows, so that a segment costs the same however many groups there are.

use super::blocks::{Block, give_back, scatter_of, whiten};
use super::covariance::{Covariance, Scatter};
use super::layout::Layout;
use super::sums::{Sums, Totals, sum_block};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::Range;

/// Segments evaluated at a time. Fixed, so that memory is bounded and sums never depend on the
/// number of threads.
const CHUNK: usize = 64;

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
        Wanted::Weighed(r) => {
            whiten(layout, s, &blocks, &r[layout.parts[s].group]).and_then(|white| {
                let sums = sum_block(&white, nd);
                give_back(vec![white]);
                sums.map(SegmentSums::Weighed)
            })
        }
    };
    give_back(blocks);
    sums
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
            totals.add(&layout.parts[s], sums);
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
            totals.add(&layout.parts[s], vec![sum]);
        }
    })?;
    Some(totals)
}
