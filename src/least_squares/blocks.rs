//! What a segment hands over: residuals and sensitivities per output, instant by instant where
//! outputs are correlated.

use super::covariance::{Covariance, Scatter};
use super::layout::Layout;
use super::rows::add_scaled;
use crate::math::pool;

/// Residuals of one channel of one segment, and the sensitivities of its prediction.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// Which of the scored outputs.
    pub output: usize,
    /// Residuals `z - y`, one per sample; NaN marks a masked sample.
    pub e: Vec<f64>,
    /// `dy/dtheta`, `[sample][direction]` row by row; empty where no sensitivities were asked for.
    pub g: Vec<f64>,
    /// What the cost takes in place of the sum of `e^2`, where there is something: these rows are of
    /// a likelihood whose variances depend on the parameters, and count no samples.
    pub instead: Option<f64>,
}

impl Block {
    /// Residuals of an output and their sensitivities.
    pub fn new(output: usize, e: Vec<f64>, g: Vec<f64>) -> Block {
        Block { output, e, g, instead: None }
    }

    /// Samples and sum of squares that the cost takes, of those that the rows themselves have.
    pub fn costs(&self, count: usize, square: f64) -> (usize, f64) {
        self.instead.map_or((count, square), |instead| (0, instead))
    }
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

/// The residuals of a segment.
pub fn scatter_of(layout: &Layout, s: usize, blocks: &[Block]) -> Scatter {
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
            let (count, square) = block.costs(scored.clone().count(), scored.map(|e| e * e).sum());
            scatter.add_alone(block.output, count, square);
        }
    }
    scatter
}

/// All rows of a segment, made of covariance one: `C^-1 G_m`, `C^-1 e_m` with `R_m = C C'`, instant
/// by instant.
pub fn whiten(layout: &Layout, s: usize, blocks: &[Block], r: &Covariance) -> Option<Block> {
    let nd = layout.parts[s].directions();
    let samples: usize = blocks.iter().map(|block| block.e.len()).sum();
    let [mut e, mut g] = [samples, samples * nd].map(pool::take);
    e.clear();
    g.clear();
    let mut white = Block::new(0, e, g);
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
