//! How an iteration went, line by line, and why it ended.

/// Why the iteration ended. Only `Converged` comes with standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The stopping rule holds, or nothing is gained by a step, a damped one, or their opposite:
    /// the bottom of a kink.
    Converged,
    /// `max_iterations` reached before the stopping rule held.
    IterationLimit,
    /// The data cannot separate some parameters (see the verdict).
    Singular,
    /// It leads to motions that are far too fast for the samples to show them.
    RunsAway,
    /// No step length down to `2^-max_halvings` improves the likelihood.
    NoImprovement,
    /// The model is not finite at the start values.
    NotFinite,
    /// No finite measured sample, or nothing to estimate.
    NoData,
}

impl Stop {
    /// The stable text that tables carry.
    pub fn as_str(self) -> &'static str {
        match self {
            Stop::Converged => "converged",
            Stop::IterationLimit => "iteration limit",
            Stop::Singular => "singular",
            Stop::RunsAway => "runs away",
            Stop::NoImprovement => "no improvement",
            Stop::NotFinite => "not finite",
            Stop::NoData => "no data",
        }
    }
}

impl std::fmt::Display for Stop {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// One line of the iteration's history; iteration 0 is the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iteration {
    /// Its number; 0 is the start.
    pub iteration: usize,
    /// Negative log-likelihood without its constants (`sum_j N_j/2 ln R_jj` where `R` is diagonal),
    /// and half the squared deviations from priors.
    pub cost: f64,
    /// Determinant of `R`; of several groups of segments the geometric mean, weighted with their
    /// samples.
    pub det_r: f64,
    /// Relative change of `det_r`; 0 for the start.
    pub change: f64,
    /// Length of the full Gauss-Newton step that led here, in standard deviations: `sqrt(d' M d)`;
    /// 0 for the start.
    pub step: f64,
    /// Steepest slope here over the parameters that are free to move: `max |g_i| / sqrt(M_ii)`.
    pub gradient: f64,
    /// Trial points refused before this one (halvings of the step, or raises of the damping).
    pub halvings: usize,
    /// Share of the information's diagonal added to it (Levenberg-Marquardt); 0 without damping.
    pub damping: f64,
}
