//! What a filter did at a stretch of nodes in, node by node; the same for the backward pass out.

use super::matrix::{Size, padded};
use crate::math::pool;

/// One scalar update.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scalar {
    pub channel: usize,
    /// Innovation and its variance.
    pub nu: f64,
    pub s: f64,
}

/// What the backward pass needs of a stretch of nodes: flat, refilled for every stretch.
#[derive(Debug, Clone, Default)]
pub struct Tape {
    /// States are wanted at every node; without, only at the first.
    pub all: bool,
    pub t: Vec<f64>,
    /// `[node][n]`, `[node][n][m]` after the updates.
    pub x: Vec<f64>,
    pub p: Vec<f64>,
    /// Step to the next node: its length; `D` by rows, `[x][padded(k)]`, and `Gamma` by columns,
    /// `[q][y]` (see `matrix`); variances of the inputs over it.
    pub h: Vec<f64>,
    pub d: Vec<f64>,
    pub gamma: Vec<f64>,
    pub q: Vec<f64>,
    /// Index of the first scalar of each node.
    pub first: Vec<usize>,
    pub scalars: Vec<Scalar>,
    /// `[scalar][m]`.
    pub rows: Vec<f64>,
    pub gains: Vec<f64>,
}

impl Tape {
    /// An empty one with room for so many nodes.
    pub fn new(all: bool, size: Size, nodes: usize) -> Tape {
        let mut tape = Tape::default();
        let states = if all { nodes } else { 1 };
        let room = [
            (&mut tape.x, states * size.n),
            (&mut tape.p, states * size.square()),
            (&mut tape.d, nodes * size.x * padded(size.k)),
            (&mut tape.gamma, nodes * size.q * size.y),
            (&mut tape.q, nodes * size.q),
            (&mut tape.rows, nodes * size.m),
            (&mut tape.gains, nodes * size.m),
        ];
        for (list, room) in room {
            *list = pool::take(room);
            list.clear();
        }
        tape.all = all;
        tape
    }

    pub fn clear(&mut self) {
        for list in [
            &mut self.t,
            &mut self.x,
            &mut self.p,
            &mut self.h,
            &mut self.d,
            &mut self.gamma,
            &mut self.q,
            &mut self.rows,
            &mut self.gains,
        ] {
            list.clear();
        }
        self.first.clear();
        self.scalars.clear();
    }

    /// Bytes per node with one update.
    pub fn bytes(all: bool, size: Size) -> usize {
        let state = if all { size.n * (size.m + 1) } else { 0 };
        8 * (state + size.x * padded(size.k) + size.q * (size.y + 1) + 2 * size.m + 6)
    }

    /// Mean and covariance after a node's updates.
    pub fn state(&mut self, t: f64, x: &[f64], p: &[f64]) {
        if self.all || self.t.is_empty() {
            self.x.extend_from_slice(x);
            self.p.extend_from_slice(p);
        }
        self.t.push(t);
    }

    /// The step of `h` s to the next node, by columns, and the variances of the inputs over it.
    pub fn step(&mut self, size: Size, h: f64, step: &[f64], q: &[f64]) {
        let (from, wide) = (self.d.len(), padded(size.k));
        self.d.resize(from + size.x * wide, 0.0);
        let (d, gamma) = step.split_at(size.k * size.y);
        for (j, column) in d.chunks_exact(size.y).enumerate() {
            for (i, value) in column[..size.x].iter().enumerate() {
                self.d[from + i * wide + j] = *value;
            }
        }
        self.gamma.extend_from_slice(gamma);
        self.h.push(h);
        self.q.extend_from_slice(q);
    }

    /// An update with its row of derivatives and its gain.
    pub fn update(&mut self, scalar: Scalar, row: &[f64], gain: &[f64]) {
        self.scalars.push(scalar);
        self.rows.extend_from_slice(row);
        self.gains.extend_from_slice(gain);
    }
}

impl Drop for Tape {
    fn drop(&mut self) {
        for list in [
            &mut self.x,
            &mut self.p,
            &mut self.d,
            &mut self.gamma,
            &mut self.q,
            &mut self.rows,
            &mut self.gains,
        ] {
            pool::give(std::mem::take(list));
        }
    }
}
