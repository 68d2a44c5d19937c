//! A segment's sensitivities and the noise as modelled in; its part of `G' R^-1 Sigma R^-1 G`, and
//! its rows made white by `Sigma`, out.
//!
//! `Sigma = A^-1 D^1/2 c D^1/2 A^-T` over all samples of a segment (see `colour` for what it says),
//! so that with `V = A^-T R^-1 G` the first is `V' D^1/2 c D^1/2 V`; the second are
//! `c^-1/2 D^-1/2 A [G | e]`. Both take time linear in the number of samples.

use crate::least_squares::{Block, Covariance, Layout, Samples, at_instants};
use crate::math::dense::{cholesky, forward, symmetric_eigen};
use crate::math::pool;
use crate::math::turned::columns_of;
use crate::noise::{Ar, Filter};

/// The smallest eigenvalue that the correlation matrix of innovations is left with.
const LEAST: f64 = 1e-6;

/// The noise of all segments as modelled.
pub struct Sigma<'a> {
    layout: &'a Layout,
    noise: &'a [Covariance],
    /// Per class: `group * outputs + output`, and behind all of those the same of the innovations' sizes,
    /// where there are any.
    filters: Vec<Filter>,
    /// Per group `c`, `[outputs][outputs]`; empty where outputs are independent.
    mix: Vec<Vec<f64>>,
}

impl<'a> Sigma<'a> {
    /// `models` per class.
    pub fn new(layout: &'a Layout, noise: &'a [Covariance], models: &[Ar]) -> Sigma<'a> {
        let filters: Vec<Filter> = models.iter().map(Filter::new).collect();
        let groups = if layout.noise.full { noise } else { &[] };
        let mix = groups
            .iter()
            .enumerate()
            .map(|(g, r)| mix(r, &filters[g * r.n..(g + 1) * r.n]))
            .collect();
        Sigma { layout, noise, filters, mix }
    }

    /// The noise class of a block of segment `s`. The size of an innovation, `nu^2/s - 1`, has a colour of
    /// its own: where the innovations have the autocorrelation `r`, it has `r^2`.
    pub fn class(layout: &Layout, s: usize, block: &Block) -> usize {
        let class = layout.parts[s].group * layout.noise.outputs + block.output;
        match block.instead {
            None => class,
            Some(_) => layout.noise.groups * layout.noise.outputs + class,
        }
    }

    fn filter(&self, s: usize, block: &Block) -> &Filter {
        &self.filters[Sigma::class(self.layout, s, block)]
    }

    /// `A^-T R^-1 G`, per block.
    fn backward(&self, s: usize, blocks: &[Block]) -> Option<Vec<Vec<f64>>> {
        let (nd, r) = (self.layout.parts[s].directions(), &self.noise[self.layout.parts[s].group]);
        let mut weighed: Vec<Vec<f64>> = blocks.iter().map(|b| vec![0.0; b.g.len()]).collect();
        let (mut known, mut outputs) = (true, Vec::new());
        at_instants(self.layout, s, blocks, Samples::Scored, |present| {
            outputs.clear();
            outputs.extend(present.iter().map(|&(b, _)| blocks[b].output));
            let Some(weight) = r.weight(&outputs) else {
                known = false;
                return;
            };
            let w = &weight.inverse;
            for (i, &(b, k)) in present.iter().enumerate() {
                for (j, &(c, l)) in present.iter().enumerate() {
                    add_scaled(
                        &mut weighed[b][k * nd..(k + 1) * nd],
                        w[i * present.len() + j],
                        &blocks[c].g[l * nd..(l + 1) * nd],
                    );
                }
            }
        });
        known.then(|| {
            blocks.iter().zip(&weighed).map(|(b, g)| self.filter(s, b).backward(g, nd)).collect()
        })
    }

    /// `D^1/2 c D^1/2 V`, per block. Innovations run on through masked samples.
    fn couple(&self, s: usize, blocks: &[Block], v: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let (nd, n) = (self.layout.parts[s].directions(), self.layout.noise.outputs);
        let mut coupled: Vec<Vec<f64>> = blocks.iter().map(|b| vec![0.0; b.g.len()]).collect();
        let mix = self.mix.get(self.layout.parts[s].group);
        at_instants(self.layout, s, blocks, Samples::All, |present| {
            for &(b, k) in present {
                let mine = self.filter(s, &blocks[b]).variance(k);
                for &(c, l) in present {
                    let like = if b == c {
                        1.0
                    } else {
                        mix.map_or(0.0, |mix| mix[blocks[b].output * n + blocks[c].output])
                    };
                    let other = if b == c { mine } else { self.filter(s, &blocks[c]).variance(l) };
                    add_scaled(
                        &mut coupled[b][k * nd..(k + 1) * nd],
                        like * (mine * other).sqrt(),
                        &v[c][l * nd..(l + 1) * nd],
                    );
                }
            }
        });
        coupled
    }

    /// `G' R^-1 Sigma R^-1 G` of segment `s`, lower triangle `[nd][nd]`.
    pub fn spread(&self, s: usize, blocks: &[Block]) -> Option<Vec<f64>> {
        let nd = self.layout.parts[s].directions();
        let mut q = vec![0.0; nd * nd];
        let v = self.backward(s, blocks)?;
        for (v, u) in v.iter().zip(self.couple(s, blocks, &v)) {
            for (v, u) in v.chunks_exact(nd.max(1)).zip(u.chunks_exact(nd.max(1))) {
                (0..nd).for_each(|i| add_scaled(&mut q[i * nd..i * nd + i + 1], v[i], u));
            }
        }
        Some(q)
    }

    /// Whether every output that was measured has noise to divide by.
    pub fn is_definite(&self) -> bool {
        let counts = self.noise.iter().flat_map(|r| &r.count).cycle();
        self.filters.iter().zip(counts).all(|(filter, count)| *count == 0 || filter.is_definite())
    }

    /// Sensitivities and residuals of segment `s` made white: one column per direction, then the
    /// residuals, scored samples block by block.
    pub fn whiten(&self, s: usize, blocks: &[Block]) -> Vec<Vec<f64>> {
        let nd = self.layout.parts[s].directions();
        let samples = blocks.iter().map(|block| block.e.len()).sum();
        let mut columns: Vec<Vec<f64>> = (0..=nd).map(|_| pool::take(samples)).collect();
        let wanted: Vec<usize> = (0..nd).collect();
        let (mut begins, mut from) = (Vec::new(), 0);
        for block in blocks {
            begins.push(from);
            let rows = from..from + block.e.len();
            from = rows.end;
            let masked: Vec<bool> = block.e.iter().map(|e| e.is_nan()).collect();
            columns_of(&block.g, &wanted, rows.clone(), &mut columns);
            columns[nd][rows.clone()].copy_from_slice(&block.e);
            let series = columns.iter_mut().map(|column| &mut column[rows.clone()]);
            self.filter(s, block).whiten_all(series, &masked);
        }
        self.separate(s, blocks, &begins, &mut columns);
        let scored: Vec<bool> =
            blocks.iter().flat_map(|block| block.e.iter().map(|e| !e.is_nan())).collect();
        let some = scored.contains(&false);
        for column in columns.iter_mut().filter(|_| some) {
            let mut scored = scored.iter();
            column.retain(|_| scored.next().copied().unwrap_or(false));
        }
        columns
    }

    /// `c^-1/2` at every instant: what outputs share is taken out.
    fn separate(&self, s: usize, blocks: &[Block], begins: &[usize], columns: &mut [Vec<f64>]) {
        let Some(mix) = self.mix.get(self.layout.parts[s].group) else { return };
        let n = self.layout.noise.outputs;
        let mut roots: Vec<(Vec<usize>, Vec<f64>)> = Vec::new();
        at_instants(self.layout, s, blocks, Samples::Scored, |present| {
            let outputs: Vec<usize> = present.iter().map(|&(b, _)| blocks[b].output).collect();
            let m = outputs.len();
            let known = roots.iter().position(|(of, _)| *of == outputs).unwrap_or_else(|| {
                let c: Vec<f64> = outputs
                    .iter()
                    .flat_map(|&i| outputs.iter().map(move |&j| mix[i * n + j]))
                    .collect();
                // `mix` is positive definite, and so is every block of it.
                roots.push((outputs, cholesky(&c, m).unwrap_or_default()));
                roots.len() - 1
            });
            let root = &roots[known].1;
            for column in columns.iter_mut().filter(|_| root.len() == m * m) {
                let mut x: Vec<f64> = present.iter().map(|&(b, k)| column[begins[b] + k]).collect();
                forward(root, m, &mut x);
                present.iter().zip(x).for_each(|(&(b, k), x)| column[begins[b] + k] = x);
            }
        });
    }
}

/// Correlations of innovations that give samples of one instant the correlations of `r`.
fn mix(r: &Covariance, filters: &[Filter]) -> Vec<f64> {
    let n = r.n;
    let mut mix = vec![0.0; n * n];
    for i in 0..n {
        mix[i * n + i] = 1.0;
        for j in 0..i {
            let like = filters[i].likeness(&filters[j]);
            let c = if like > 0.0 { (r.correlation(i, j) / like).clamp(-1.0, 1.0) } else { 0.0 };
            (mix[i * n + j], mix[j * n + i]) = (c, c);
        }
    }
    // Eigenvalues are 1 + mu; off-diagonals times `share` have 1 + share mu.
    let least = symmetric_eigen(&mix, n).values.first().map_or(0.0, |v| v - 1.0);
    if 1.0 + least < LEAST {
        let share = (1.0 - LEAST) / -least;
        (0..n * n).filter(|k| k / n != k % n).for_each(|k| mix[k] *= share);
    }
    mix
}

fn add_scaled(to: &mut [f64], w: f64, from: &[f64]) {
    to.iter_mut().zip(from).for_each(|(t, f)| *t += w * f);
}
