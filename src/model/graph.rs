//! The expression graph of a model: shared nodes, folded constants, exact symbolic derivatives.
//!
//! Nodes are hash-consed (the same operation on the same operands exists once) and built bottom-up, so a node's operands always have
//! smaller numbers. Derivatives are nodes of the same graph, which is what makes common terms of a function and its Jacobian shared.

use std::collections::HashMap;

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
    Parameter(usize),
    /// Start value of a state that is given from outside (measured, or free in an estimation).
    StartValue(usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Op {
    Add,
    Sub,
    Mul,
    Div,
    Neg,
    Sqrt,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Atan2,
    Exp,
    Log,
    Tanh,
    Abs,
    Sign,
    /// a to the constant power b.
    Pow,
    Min,
    Max,
    /// b where a > 0, else c.
    Select,
    /// Table number `b` (a constant) at a.
    Table,
    /// Slope of table `b` at a.
    TableSlope,
    /// Table number c at (a, b).
    Table2,
    /// Partial derivatives of table c at (a, b).
    Table2SlopeX,
    Table2SlopeY,
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
    derivatives: HashMap<(Node, Leaf), Node>,
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

    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
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
        if !matches!(op, Op::Table | Op::TableSlope | Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY)
            && let (Some(x), Some(y), Some(z)) = (self.constant(a), self.constant(b), self.constant(c))
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
        if let View::Op(Op::Neg, inner, ..) = self.view(a) {
            return inner;
        }
        self.op(Op::Neg, a, a, a)
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
        let (a, b) = (a.min(b), a.max(b));
        self.op(Op::Mul, a, b, b)
    }

    pub fn div(&mut self, a: Node, b: Node) -> Node {
        if self.is(a, 0.0) {
            return a;
        }
        if self.is(b, 1.0) {
            return a;
        }
        // a constant divisor becomes a factor where that is exact
        if let Some(y) = self.constant(b)
            && y != 0.0
            && y.to_bits() & 0x000f_ffff_ffff_ffff == 0
        {
            let r = self.c(1.0 / y);
            return self.mul(a, r);
        }
        self.op(Op::Div, a, b, b)
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

    /// d(n)/d(leaf), a node. Derivatives of switches are those of the active branch.
    pub fn derivative(&mut self, n: Node, leaf: Leaf) -> Node {
        if let Some(&d) = self.derivatives.get(&(n, leaf)) {
            return d;
        }
        // operands first, without recursion over the depth of the graph: nodes are in topological order
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
                let (x, y) = (self.mul(da, b), self.mul(a, db));
                self.add(x, y)
            }
            // (a/b)' = (a' - (a/b) b')/b
            Op::Div => {
                let x = self.mul(n, db);
                let y = self.sub(da, x);
                self.div(y, b)
            }
            Op::Sqrt => {
                let half = self.c(0.5);
                let x = self.mul(half, da);
                self.div(x, n)
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
                let (sx, sy) = (self.op(Op::Table2SlopeX, a, b, c), self.op(Op::Table2SlopeY, a, b, c));
                let (x, y) = (self.mul(sx, da), self.mul(sy, db));
                self.add(x, y)
            }
            // slopes of piecewise linear tables: constant between break points
            Op::TableSlope => zero,
            // z = z0 + x.. + x y..: the mixed second derivative is dropped nowhere in first-order use
            Op::Table2SlopeX | Op::Table2SlopeY => zero,
        }
    }
}

/// One operation on numbers: the reference every evaluator follows. Tables are not numbers and are handled by the evaluator.
#[inline]
pub fn apply(op: Op, a: f64, b: f64, c: f64) -> f64 {
    match op {
        Op::Add => a + b,
        Op::Sub => a - b,
        Op::Mul => a * b,
        Op::Div => a / b,
        Op::Neg => -a,
        Op::Sqrt => a.sqrt(),
        Op::Sin => libm::sin(a),
        Op::Cos => libm::cos(a),
        Op::Tan => libm::tan(a),
        Op::Asin => libm::asin(a),
        Op::Acos => libm::acos(a),
        Op::Atan => libm::atan(a),
        Op::Atan2 => libm::atan2(a, b),
        Op::Exp => libm::exp(a),
        Op::Log => libm::log(a),
        Op::Tanh => libm::tanh(a),
        Op::Abs => a.abs(),
        Op::Sign => {
            if a > 0.0 {
                1.0
            } else if a < 0.0 {
                -1.0
            } else {
                0.0
            }
        }
        Op::Pow => libm::pow(a, b),
        Op::Min => {
            if b > a {
                a
            } else {
                b
            }
        }
        Op::Max => {
            if a > b {
                a
            } else {
                b
            }
        }
        Op::Select => {
            if a > 0.0 {
                b
            } else {
                c
            }
        }
        Op::Table | Op::TableSlope | Op::Table2 | Op::Table2SlopeX | Op::Table2SlopeY => f64::NAN,
    }
}
