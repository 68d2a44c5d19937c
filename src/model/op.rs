//! The operations that a graph and a program are made of.

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Op {
    Add,
    Sub,
    Mul,
    Div,
    Neg,
    /// a b + c, rounded once.
    Fma,
    /// a b - c, rounded once.
    Fms,
    /// c - a b, rounded once.
    Fnma,
    Sqrt,
    /// Sine and cosine of one argument become one instruction with two results when a program is
    /// lowered.
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
