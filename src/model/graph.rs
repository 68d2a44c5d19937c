//! The expression graph of a model: shared nodes, folded constants, factors that do not change
//! along a trajectory gathered.
//!
//! Nodes are hash-consed (the same operation on the same operands exists once) and built bottom-up,
//! so a node's operands always have smaller numbers. Derivatives are nodes of the same graph, which
//! is what makes common terms of a function and its Jacobian shared.

use std::collections::HashMap;

use super::arithmetic::apply;
pub use super::op::Op;

/// Index of a node.
pub type Node = u32;

/// What a graph cannot compute by itself: filled in by the caller at each evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Leaf {
    State(usize),
    Input(usize),
    /// Time derivative of an input's interpolated signal.
    InputRate(usize),
    /// Value of `Delay` k.
    Delayed(usize),
    Time,
    /// 1 while `Moving` k is held by friction or by a stop, 0 while it moves.
    Held(usize),
    /// Which way `Moving` k moves against its friction: -1 or 1; 0 where it has none.
    Side(usize),
    Parameter(usize),
    /// Start value of a state that is given from outside (measured, or free in an estimation).
    StartValue(usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Key {
    Const(u64),
    Leaf(Leaf),
    Op(Op, Node, Node, Node),
}

/// Bits of what a node depends on.
pub mod depends {
    pub const PARAMETER: u8 = 1;
    /// States, inputs, delayed values or time: changes along a trajectory.
    pub const TRAJECTORY: u8 = 2;
}

#[derive(Debug, Clone, Default)]
pub struct Graph {
    keys: Vec<Key>,
    depends: Vec<u8>,
    index: HashMap<Key, Node>,
    pub(super) derivatives: HashMap<(Node, Leaf), Node>,
}

/// A node as an evaluator sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    Const(f64),
    Leaf(Leaf),
    Op(Op, Node, Node, Node),
}

impl Graph {
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    pub fn view(&self, n: Node) -> View {
        match self.keys[n as usize] {
            Key::Const(bits) => View::Const(f64::from_bits(bits)),
            Key::Leaf(leaf) => View::Leaf(leaf),
            Key::Op(op, a, b, c) => View::Op(op, a, b, c),
        }
    }

    pub fn depends(&self, n: Node) -> u8 {
        self.depends[n as usize]
    }

    pub fn constant(&self, n: Node) -> Option<f64> {
        match self.view(n) {
            View::Const(x) => Some(x),
            _ => None,
        }
    }

    fn is(&self, n: Node, x: f64) -> bool {
        self.constant(n) == Some(x)
    }

    fn put(&mut self, key: Key) -> Node {
        if let Some(&n) = self.index.get(&key) {
            return n;
        }
        let bits = match key {
            Key::Const(_) => 0,
            Key::Leaf(Leaf::Parameter(_) | Leaf::StartValue(_)) => depends::PARAMETER,
            Key::Leaf(_) => depends::TRAJECTORY,
            Key::Op(_, a, b, c) => self.depends(a) | self.depends(b) | self.depends(c),
        };
        let n = self.keys.len() as Node;
        self.keys.push(key);
        self.depends.push(bits);
        self.index.insert(key, n);
        n
    }

    pub fn c(&mut self, x: f64) -> Node {
        // one zero: -0.0 and 0.0 are the same constant
        self.put(Key::Const(if x == 0.0 { 0.0f64 } else { x }.to_bits()))
    }

    pub fn leaf(&mut self, leaf: Leaf) -> Node {
        self.put(Key::Leaf(leaf))
    }

    /// A node for any operation, simplified where an operand is constant.
    pub fn op(&mut self, op: Op, a: Node, b: Node, c: Node) -> Node {
        if !matches!(
            op,
            Op::Table | Op::TableSlope | Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY
        ) && let (Some(x), Some(y), Some(z)) =
            (self.constant(a), self.constant(b), self.constant(c))
        {
            return self.c(apply(op, x, y, z));
        }
        self.put(Key::Op(op, a, b, c))
    }

    pub fn unary(&mut self, op: Op, a: Node) -> Node {
        if op == Op::Neg {
            return self.neg(a);
        }
        self.op(op, a, a, a)
    }

    pub fn neg(&mut self, a: Node) -> Node {
        match self.view(a) {
            View::Op(Op::Neg, inner, ..) => inner,
            View::Op(Op::Sub, p, q, _) => self.sub(q, p),
            View::Op(Op::Fms, p, q, r) => self.op(Op::Fnma, p, q, r),
            View::Op(Op::Fnma, p, q, r) => self.op(Op::Fms, p, q, r),
            _ => self.op(Op::Neg, a, a, a),
        }
    }

    pub fn add(&mut self, a: Node, b: Node) -> Node {
        if self.is(a, 0.0) {
            return b;
        }
        if self.is(b, 0.0) {
            return a;
        }
        if let View::Op(Op::Neg, inner, ..) = self.view(b) {
            return self.sub(a, inner);
        }
        if let View::Op(Op::Neg, inner, ..) = self.view(a) {
            return self.sub(b, inner);
        }
        let (a, b) = (a.min(b), a.max(b));
        self.op(Op::Add, a, b, b)
    }

    pub fn sub(&mut self, a: Node, b: Node) -> Node {
        if self.is(b, 0.0) {
            return a;
        }
        if self.is(a, 0.0) {
            return self.neg(b);
        }
        if a == b {
            return self.c(0.0);
        }
        if let View::Op(Op::Neg, inner, ..) = self.view(b) {
            return self.add(a, inner);
        }
        self.op(Op::Sub, a, b, b)
    }

    pub fn mul(&mut self, a: Node, b: Node) -> Node {
        for (x, y) in [(a, b), (b, a)] {
            match self.constant(x) {
                Some(0.0) => return self.c(0.0),
                Some(1.0) => return y,
                Some(-1.0) => return self.neg(y),
                _ => {}
            }
        }
        for (x, y) in [(a, b), (b, a)] {
            if let View::Op(Op::Neg, inner, ..) = self.view(x) {
                let product = self.mul(inner, y);
                return self.neg(product);
            }
            // factors that do not change along a trajectory are multiplied first, once for all its
            // points
            if self.fixed(x)
                && let View::Op(Op::Mul, p, q, _) = self.view(y)
                && !self.fixed(y)
            {
                for (p, q) in [(p, q), (q, p)] {
                    if self.fixed(p) {
                        let factor = self.mul(x, p);
                        return self.mul(factor, q);
                    }
                }
            }
        }
        let (a, b) = (a.min(b), a.max(b));
        self.op(Op::Mul, a, b, b)
    }

    /// Constants, parameters, and what is made of them alone.
    fn fixed(&self, n: Node) -> bool {
        self.depends(n) & depends::TRAJECTORY == 0
    }

    /// a b + c as one operation.
    pub fn fma(&mut self, a: Node, b: Node, c: Node) -> Node {
        self.fused(Op::Fma, a, b, c)
    }

    /// One of the three fused operations, simplified.
    pub fn fused(&mut self, op: Op, a: Node, b: Node, c: Node) -> Node {
        let simple = |x: Option<f64>| matches!(x, Some(0.0 | 1.0 | -1.0));
        if simple(self.constant(a)) || simple(self.constant(b)) || self.is(c, 0.0) {
            let product = self.mul(a, b);
            return match op {
                Op::Fms => self.sub(product, c),
                Op::Fnma => self.sub(c, product),
                _ => self.add(product, c),
            };
        }
        for (x, y) in [(a, b), (b, a)] {
            if let View::Op(Op::Neg, inner, ..) = self.view(x) {
                return match op {
                    Op::Fma => self.fused(Op::Fnma, inner, y, c),
                    Op::Fnma => self.fused(Op::Fma, inner, y, c),
                    // -(x y) - c
                    _ => {
                        let sum = self.fused(Op::Fma, inner, y, c);
                        self.neg(sum)
                    }
                };
            }
        }
        if let View::Op(Op::Neg, inner, ..) = self.view(c) {
            return match op {
                Op::Fma => self.fused(Op::Fms, a, b, inner),
                Op::Fms => self.fused(Op::Fma, a, b, inner),
                _ => {
                    let sum = self.fused(Op::Fma, a, b, inner);
                    self.neg(sum)
                }
            };
        }
        let (a, b) = (a.min(b), a.max(b));
        self.op(op, a, b, c)
    }

    pub fn div(&mut self, a: Node, b: Node) -> Node {
        if self.is(a, 0.0) {
            return a;
        }
        if self.is(b, 1.0) {
            return a;
        }
        if self.is(a, 1.0) || (self.constant(a).is_some() && self.constant(b).is_some()) {
            return self.op(Op::Div, a, b, b);
        }
        // one reciprocal serves all that is divided by b, and what does not change along a
        // trajectory is not divided by again
        let one = self.c(1.0);
        let r = self.div(one, b);
        self.mul(a, r)
    }

    /// a to the constant power e; small whole powers by multiplication.
    pub fn pow(&mut self, a: Node, e: f64) -> Node {
        if e == 0.0 {
            return self.c(1.0);
        }
        if e == 0.5 {
            return self.unary(Op::Sqrt, a);
        }
        if e.fract() == 0.0 && e.abs() <= 8.0 {
            let n = e.abs() as u32;
            let mut out = a;
            let mut square = a;
            let mut first = true;
            for bit in 0..4 {
                if bit > 0 {
                    square = if n >> bit > 0 { self.mul(square, square) } else { square };
                }
                if n >> bit & 1 == 1 {
                    out = if first { square } else { self.mul(out, square) };
                    first = false;
                }
            }
            if e > 0.0 {
                return out;
            }
            let one = self.c(1.0);
            return self.div(one, out);
        }
        let e = self.c(e);
        self.op(Op::Pow, a, e, e)
    }

    pub fn min(&mut self, a: Node, b: Node) -> Node {
        self.op(Op::Min, a, b, b)
    }

    pub fn max(&mut self, a: Node, b: Node) -> Node {
        self.op(Op::Max, a, b, b)
    }

    pub fn select(&mut self, c: Node, a: Node, b: Node) -> Node {
        match self.constant(c) {
            _ if a == b => a,
            Some(x) => {
                if x > 0.0 {
                    a
                } else {
                    b
                }
            }
            None => self.op(Op::Select, c, a, b),
        }
    }
}
