//! The least-squares problem over segments: a parameter vector in; residual sums and normal equations, added in segment order, out.

use super::arrow::{Arrow, Own};
use rayon::prelude::*;

/// Segments evaluated at a time. Fixed, so that memory is bounded and sums never depend on the number of threads.
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
    pub start: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Standard deviation of a prior centred at the start; infinite without one.
    pub prior_sd: Vec<f64>,
    /// Number of noise classes: residuals of one class share one variance (and one colour).
    pub classes: usize,
    /// Smallest variance a class may be given, so that data without noise do not divide by zero.
    pub floor: Vec<f64>,
}

impl Layout {
    /// Every segment sees all `shared` parameters and has `own[s]` of its own; unbounded, no priors.
    #[cfg(test)]
    pub fn plain(shared: usize, own: &[usize], classes: usize, start: Vec<f64>) -> Layout {
        let mut offset = shared;
        let parts = own
            .iter()
            .map(|&own| {
                let part = Part { shared: (0..shared).collect(), offset, own };
                offset += own;
                part
            })
            .collect();
        let n = start.len();
        Layout {
            shared,
            parts,
            start,
            lower: vec![f64::NEG_INFINITY; n],
            upper: vec![f64::INFINITY; n],
            prior_sd: vec![f64::INFINITY; n],
            classes,
            floor: vec![1e-30; classes],
        }
    }

    /// Information of the prior of parameter `i`: `1/sd^2`, 0 without one.
    pub fn prior_weight(&self, i: usize) -> f64 {
        let sd = self.prior_sd[i];
        if sd.is_finite() { 1.0 / (sd * sd) } else { 0.0 }
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
    pub class: usize,
    /// Residuals `z - y`, one per sample; NaN marks a masked sample.
    pub e: Vec<f64>,
    /// `dy/dtheta`, `[sample][direction]` row by row.
    pub g: Vec<f64>,
}

/// Sums over one or all segments of one noise class.
#[derive(Debug, Clone, PartialEq, Default)]
struct Sums {
    class: usize,
    count: usize,
    /// Sum of e^2.
    square: f64,
    /// `G'G` over the segment's directions, lower triangle, `[nd][nd]`.
    gram: Vec<f64>,
    /// `G'e`.
    gradient: Vec<f64>,
}

/// What remains of all segments once they are added: enough for any weights.
#[derive(Debug, Clone)]
pub struct Totals {
    /// Scored samples per class.
    pub count: Vec<usize>,
    /// Sum of squared residuals per class.
    pub square: Vec<f64>,
    shared: usize,
    /// Per class `[shared][shared]` and `[shared]`.
    gram: Vec<Vec<f64>>,
    gradient: Vec<Vec<f64>>,
    /// Per segment and class: the rows of its own parameters.
    own: Vec<Vec<OwnSums>>,
}

#[derive(Debug, Clone)]
struct OwnSums {
    class: usize,
    ss: Vec<f64>,
    sc: Vec<f64>,
    gradient: Vec<f64>,
}

/// One pass over all segments at `theta`; `None` where any segment is not finite. `evaluate(segment, local parameters)` gives the
/// blocks of one segment (shared parameters it sees, then its own), or `None` where its model is not finite.
pub fn pass<F>(layout: &Layout, evaluate: &F, theta: &[f64]) -> Option<Totals>
where
    F: Fn(usize, &[f64]) -> Option<Vec<Block>> + Sync,
{
    let nc = layout.shared;
    let mut totals = Totals {
        count: vec![0; layout.classes],
        square: vec![0.0; layout.classes],
        shared: nc,
        gram: vec![vec![0.0; nc * nc]; layout.classes],
        gradient: vec![vec![0.0; nc]; layout.classes],
        own: Vec::with_capacity(layout.parts.len()),
    };
    for from in (0..layout.parts.len()).step_by(CHUNK) {
        let to = (from + CHUNK).min(layout.parts.len());
        let chunk: Vec<Option<Vec<Sums>>> = (from..to)
            .into_par_iter()
            .map(|s| {
                let blocks = evaluate(s, &layout.local(s, theta))?;
                let nd = layout.parts[s].directions();
                let sums: Option<Vec<Sums>> = blocks.iter().map(|b| sum_block(b, nd)).collect();
                sums
            })
            .collect();
        for (s, sums) in (from..to).zip(chunk) {
            let own = sums?.iter().map(|sum| totals.add(&layout.parts[s], sum)).collect();
            totals.own.push(own);
        }
    }
    Some(totals)
}

impl Totals {
    /// Adds the shared part of a segment's sums and hands back the rest.
    fn add(&mut self, part: &Part, sum: &Sums) -> OwnSums {
        let (nl, nd, nc) = (part.shared.len(), part.directions(), self.shared);
        self.count[sum.class] += sum.count;
        self.square[sum.class] += sum.square;
        let gram = &mut self.gram[sum.class];
        for (i, &gi) in part.shared.iter().enumerate() {
            self.gradient[sum.class][gi] += sum.gradient[i];
            for (j, &gj) in part.shared[..=i].iter().enumerate() {
                let value = sum.gram[i * nd + j];
                gram[gi * nc + gj] += value;
                if i != j {
                    gram[gj * nc + gi] += value;
                }
            }
        }
        let mut own = OwnSums {
            class: sum.class,
            ss: vec![0.0; part.own * part.own],
            sc: vec![0.0; part.own * nc],
            gradient: sum.gradient[nl..].to_vec(),
        };
        for i in 0..part.own {
            let row = &sum.gram[(nl + i) * nd..(nl + i + 1) * nd];
            for (j, &gj) in part.shared.iter().enumerate() {
                own.sc[i * nc + gj] += row[j];
            }
            for j in 0..=i {
                own.ss[i * part.own + j] = row[nl + j];
                own.ss[j * part.own + i] = row[nl + j];
            }
        }
        own
    }

    /// The normal matrix `M = sum G' R^-1 G` and gradient `G' R^-1 e` for the given variances per class.
    pub fn weigh(&self, layout: &Layout, r: &[f64]) -> (Arrow, Vec<f64>) {
        let nc = self.shared;
        let mut matrix = Arrow { shared: nc, cc: vec![0.0; nc * nc], own: Vec::with_capacity(self.own.len()) };
        let mut gradient = vec![0.0; layout.start.len()];
        for (class, &r) in r.iter().enumerate() {
            add_scaled(&mut matrix.cc, 1.0 / r, &self.gram[class]);
            add_scaled(&mut gradient[..nc], 1.0 / r, &self.gradient[class]);
        }
        for (part, sums) in layout.parts.iter().zip(&self.own) {
            let mut own = Own { n: part.own, ss: vec![0.0; part.own * part.own], sc: vec![0.0; part.own * nc] };
            for sum in sums {
                let w = 1.0 / r[sum.class];
                add_scaled(&mut own.ss, w, &sum.ss);
                add_scaled(&mut own.sc, w, &sum.sc);
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

/// Sums of one block, or `None` where a scored sample has a value or a sensitivity that is not finite.
fn sum_block(block: &Block, nd: usize) -> Option<Sums> {
    let mut sums = Sums { class: block.class, count: 0, square: 0.0, gram: vec![0.0; nd * nd], gradient: vec![0.0; nd] };
    let mut rows: [&[f64]; 4] = [&[]; 4];
    let mut pending = 0;
    for (k, &e) in block.e.iter().enumerate() {
        if e.is_nan() {
            continue;
        }
        let row = &block.g[k * nd..(k + 1) * nd];
        sums.count += 1;
        sums.square += e * e;
        add_scaled(&mut sums.gradient, e, row);
        rows[pending] = row;
        pending += 1;
        if pending == 4 {
            add_four(&mut sums.gram, &rows, nd);
            pending = 0;
        }
    }
    for row in &rows[..pending] {
        for i in 0..nd {
            add_scaled(&mut sums.gram[i * nd..i * nd + i + 1], row[i], row);
        }
    }
    let finite = sums.square.is_finite() && (0..nd).all(|i| sums.gradient[i].is_finite() && sums.gram[i * nd + i].is_finite());
    finite.then_some(sums)
}

/// Adds the outer products of four rows to the lower triangle.
fn add_four(gram: &mut [f64], rows: &[&[f64]; 4], nd: usize) {
    let [a, b, c, d] = rows;
    for i in 0..nd {
        let (ai, bi, ci, di) = (a[i], b[i], c[i], d[i]);
        let out = &mut gram[i * nd..i * nd + i + 1];
        for (j, m) in out.iter_mut().enumerate() {
            *m += (ai * a[j] + bi * b[j]) + (ci * c[j] + di * d[j]);
        }
    }
}
