//! Products and sums joined: values of a model in, the same values with fused multiply-adds out.
//!
//! This is done once, on the values, before any derivative is taken: so every program and every
//! tier computes a value by the same operations. A product that only one sum reads becomes part of
//! that sum.

use std::collections::BTreeMap;

use super::Model;
use super::graph::{Graph, Node, Op, View, depends};

impl Model {
    /// Fuses rates and outputs, then everything else.
    pub(super) fn fuse(&mut self) {
        let graph = &mut self.graph;
        let moving = self.moving.iter().flat_map(|m| [Some(m.free), m.friction]).flatten();
        let roots: Vec<Node> =
            self.rates.iter().chain(&self.output_nodes).copied().chain(moving).collect();
        let mut map = BTreeMap::new();
        fuse(graph, &roots, &mut map);
        let others: Vec<Node> =
            (self.equations.values().copied()).chain(self.trim.zero.iter().map(|z| z.1)).collect();
        fuse(graph, &others, &mut map);
        let nodes = (self.rates.iter_mut())
            .chain(&mut self.output_nodes)
            .chain(self.equations.values_mut());
        let moving =
            self.moving.iter_mut().flat_map(|m| [Some(&mut m.free), m.friction.as_mut()]).flatten();
        for node in nodes.chain(self.trim.zero.iter_mut().map(|z| &mut z.1)).chain(moving) {
            *node = map[node];
        }
    }
}

/// Adds to `map` what every node that `roots` need becomes.
fn fuse(graph: &mut Graph, roots: &[Node], map: &mut BTreeMap<Node, Node>) {
    let mut needed = std::collections::BTreeSet::new();
    let mut stack = roots.to_vec();
    while let Some(n) = stack.pop() {
        if !map.contains_key(&n)
            && needed.insert(n)
            && let View::Op(_, a, b, c) = graph.view(n)
        {
            stack.extend([a, b, c]);
        }
    }
    let mut uses: BTreeMap<Node, usize> = BTreeMap::new();
    for &n in &needed {
        if let View::Op(_, a, b, c) = graph.view(n) {
            let mut operands = vec![a, b, c];
            operands.sort_unstable();
            operands.dedup();
            for m in operands {
                *uses.entry(m).or_default() += 1;
            }
        }
    }
    // operands have smaller numbers: they come first
    for n in needed {
        let View::Op(op, a, b, c) = graph.view(n) else {
            map.insert(n, n);
            continue;
        };
        let product = |graph: &Graph, m: Node| match graph.view(m) {
            View::Op(Op::Mul, p, q, _)
                if uses.get(&m) == Some(&1) && graph.depends(m) & depends::TRAJECTORY != 0 =>
            {
                Some((map[&p], map[&q]))
            }
            _ => None,
        };
        let (to_a, to_b, to_c) = (map[&a], map[&b], map[&c]);
        let fused = match (op, product(graph, a), product(graph, b)) {
            (Op::Add, _, Some((p, q))) => graph.fused(Op::Fma, p, q, to_a),
            (Op::Add, Some((p, q)), _) => graph.fused(Op::Fma, p, q, to_b),
            (Op::Sub, _, Some((p, q))) => graph.fused(Op::Fnma, p, q, to_a),
            (Op::Sub, Some((p, q)), _) => graph.fused(Op::Fms, p, q, to_b),
            _ => graph.rebuild(op, to_a, to_b, to_c),
        };
        map.insert(n, fused);
    }
}
