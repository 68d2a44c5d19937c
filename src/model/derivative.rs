//! Exact symbolic derivatives: a node and a leaf in, the node of its derivative out.

use super::graph::{Graph, Leaf, Node, Op, View};

impl Graph {
    /// d(n)/d(leaf), a node. Derivatives of switches are those of the active branch.
    pub fn derivative(&mut self, n: Node, leaf: Leaf) -> Node {
        if let Some(&d) = self.derivatives.get(&(n, leaf)) {
            return d;
        }
        // operands first, without recursion over the depth of the graph: nodes are in topological
        // order
        let mut needed = vec![n];
        let mut seen = std::collections::BTreeSet::new();
        while let Some(m) = needed.pop() {
            if self.derivatives.contains_key(&(m, leaf)) || !seen.insert(m) {
                continue;
            }
            if let View::Op(_, a, b, c) = self.view(m) {
                needed.extend([a, b, c]);
            }
        }
        for m in seen {
            let d = self.derive(m, leaf);
            self.derivatives.insert((m, leaf), d);
        }
        self.derivatives[&(n, leaf)]
    }

    /// The derivative of one node, given those of its operands.
    fn derive(&mut self, n: Node, leaf: Leaf) -> Node {
        let (op, a, b, c) = match self.view(n) {
            View::Const(_) => return self.c(0.0),
            View::Leaf(l) => return self.c(if l == leaf { 1.0 } else { 0.0 }),
            View::Op(op, a, b, c) => (op, a, b, c),
        };
        let of = |g: &Graph, m: Node| g.derivatives[&(m, leaf)];
        let (da, db, dc) = (of(self, a), of(self, b), of(self, c));
        let zero = self.c(0.0);
        if da == zero && db == zero && dc == zero {
            return zero;
        }
        match op {
            Op::Add => self.add(da, db),
            Op::Sub => self.sub(da, db),
            Op::Neg => self.neg(da),
            Op::Mul => {
                let x = self.mul(a, db);
                self.fma(da, b, x)
            }
            Op::Fma | Op::Fms | Op::Fnma => {
                let (first, second) = match op {
                    Op::Fms => (Op::Fms, Op::Fma),
                    other => (other, other),
                };
                let x = self.fused(first, a, db, dc);
                self.fused(second, da, b, x)
            }
            // (1/b)' = -(1/b)^2 b'; (a/b)' = (a' - (a/b) b')/b
            Op::Div if da == zero && self.constant(a) == Some(1.0) => {
                let square = self.mul(n, n);
                let x = self.mul(square, db);
                self.neg(x)
            }
            Op::Div => {
                let x = self.mul(n, db);
                let y = self.sub(da, x);
                self.div(y, b)
            }
            Op::Sqrt => {
                let half = self.c(0.5);
                let x = self.div(half, n);
                self.mul(x, da)
            }
            Op::Sin => {
                let x = self.unary(Op::Cos, a);
                self.mul(x, da)
            }
            Op::Cos => {
                let x = self.unary(Op::Sin, a);
                let x = self.mul(x, da);
                self.neg(x)
            }
            Op::Tan | Op::Tanh => {
                let one = self.c(1.0);
                let x = self.mul(n, n);
                let x = if op == Op::Tan { self.add(one, x) } else { self.sub(one, x) };
                self.mul(x, da)
            }
            Op::Asin | Op::Acos => {
                let one = self.c(1.0);
                let x = self.mul(a, a);
                let x = self.sub(one, x);
                let x = self.unary(Op::Sqrt, x);
                let d = self.div(da, x);
                if op == Op::Asin { d } else { self.neg(d) }
            }
            Op::Atan => {
                let one = self.c(1.0);
                let x = self.mul(a, a);
                let x = self.add(one, x);
                self.div(da, x)
            }
            // atan2(a, b): (a' b - a b')/(a^2 + b^2)
            Op::Atan2 => {
                let (x, y) = (self.mul(da, b), self.mul(a, db));
                let up = self.sub(x, y);
                let (x, y) = (self.mul(a, a), self.mul(b, b));
                let down = self.add(x, y);
                self.div(up, down)
            }
            Op::Exp => self.mul(n, da),
            Op::Log => self.div(da, a),
            Op::Abs => {
                let s = self.unary(Op::Sign, a);
                self.mul(s, da)
            }
            Op::Sign => zero,
            Op::Pow => {
                let e = self.constant(b).unwrap_or(f64::NAN);
                let x = self.pow(a, e - 1.0);
                let k = self.c(e);
                let x = self.mul(k, x);
                self.mul(x, da)
            }
            Op::Min => {
                let first = self.sub(b, a);
                self.select(first, da, db)
            }
            Op::Max => {
                let first = self.sub(a, b);
                self.select(first, da, db)
            }
            Op::Select => self.select(a, db, dc),
            Op::Table => {
                let slope = self.op(Op::TableSlope, a, b, c);
                self.mul(slope, da)
            }
            Op::Table2 => {
                let (sx, sy) =
                    (self.op(Op::Table2SlopeX, a, b, c), self.op(Op::Table2SlopeY, a, b, c));
                let x = self.mul(sy, db);
                self.fma(sx, da, x)
            }
            // slopes of piecewise linear tables: constant between break points
            Op::TableSlope => zero,
            // z = z0 + x.. + x y..: the mixed second derivative is dropped nowhere in first-order
            // use
            Op::Table2SlopeX | Op::Table2SlopeY => zero,
        }
    }
}
