//! What the kernels that take S through Runge-Kutta steps are asked: where S stands, what is kept of it on the way.

/// Runge-Kutta steps of S: `k = J_x S + J_p + J_d D`, `sum += weight k`, next `S = s + ahead k`;
/// the last stage `s += ahead (sum + k)`.
pub struct Steps<'a> {
    /// S at the start of a step; after its last stage at its end.
    pub s: &'a mut [f64],
    /// The weighed sum of rates.
    pub sum: &'a mut [f64],
    /// S and D at the stages: the first stage reads `between[1]` (or `s`, see `plain`) and writes
    /// `between[0]`, the second reads that and writes `between[1]`, and so on.
    pub between: [&'a mut [f64]; 2],
    /// The rates themselves, where somebody wants them.
    pub k: Option<&'a mut [f64]>,
    /// Per stage its weight, and how far its rates lead to the next stage (after the last one: what
    /// the sum is multiplied by).
    pub weights: [[f64; 2]; 4],
    /// Whether the first stage is simply the start of the step.
    pub plain: bool,
    /// Where S at the start of every `every`th step of the call is kept, `[step][rows of S]`; none
    /// if it is zero.
    pub kept: &'a mut [f64],
    pub every: usize,
    /// Steps since the last one that was kept.
    pub phase: usize,
}
