//! Walks over the expression graph: which leaves nodes depend on, and nodes with leaves replaced.

use std::collections::{BTreeMap, HashMap};

use super::arithmetic::apply;
use super::graph::{Graph, Leaf, Node, Op, View};

impl Graph {
    /// The leaves that nodes depend on, in a fixed order.
    pub fn leaves(&self, nodes: &[Node]) -> Vec<Leaf> {
        let mut out = std::collections::BTreeSet::new();
        let mut seen = vec![false; self.len()];
        let mut stack = nodes.to_vec();
        while let Some(n) = stack.pop() {
            if std::mem::replace(&mut seen[n as usize], true) {
                continue;
            }
            match self.view(n) {
                View::Leaf(leaf) => {
                    out.insert(leaf);
                }
                View::Op(_, a, b, c) => stack.extend([a, b, c]),
                View::Const(_) => {}
            }
        }
        out.into_iter().collect()
    }

    /// Value of `node` where each of its leaves has one; none where one has not, or a table is read.
    pub fn value(&self, node: Node, leaf: &dyn Fn(Leaf) -> Option<f64>) -> Option<f64> {
        match self.view(node) {
            View::Const(value) => Some(value),
            View::Leaf(one) => leaf(one),
            View::Op(
                Op::Table | Op::TableSlope | Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY,
                ..,
            ) => None,
            View::Op(op, a, b, c) => {
                let [a, b, c] = [a, b, c].map(|n| self.value(n, leaf));
                Some(apply(op, a?, b?, c?))
            }
        }
    }

    /// `node` with leaves replaced.
    pub fn substitute(&mut self, node: Node, with: &BTreeMap<Leaf, Node>) -> Node {
        let mut seen = std::collections::BTreeSet::new();
        let mut stack = vec![node];
        while let Some(n) = stack.pop() {
            if seen.insert(n)
                && let View::Op(_, a, b, c) = self.view(n)
            {
                stack.extend([a, b, c]);
            }
        }
        let mut map: HashMap<Node, Node> = HashMap::new();
        for n in seen {
            let m = match self.view(n) {
                View::Const(_) => n,
                View::Leaf(leaf) => with.get(&leaf).copied().unwrap_or(n),
                View::Op(op, a, b, c) => self.rebuild(op, map[&a], map[&b], map[&c]),
            };
            map.insert(n, m);
        }
        map[&node]
    }

    pub(super) fn rebuild(&mut self, op: Op, a: Node, b: Node, c: Node) -> Node {
        match op {
            Op::Add => self.add(a, b),
            Op::Sub => self.sub(a, b),
            Op::Mul => self.mul(a, b),
            Op::Div => self.div(a, b),
            Op::Neg => self.neg(a),
            Op::Fma | Op::Fms | Op::Fnma => self.fused(op, a, b, c),
            Op::Select => self.select(a, b, c),
            op => self.op(op, a, b, c),
        }
    }
}
