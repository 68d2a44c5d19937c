//! What a fit leaves in; how its noise is coloured, and everything that follows from that, out.
//! There is one such model in the program, whoever asks: the estimator for its standard deviations,
//! the diagnosis for its likelihood, the checks of sensors for theirs.
//!
//! # The model
//!
//! Every output of a group of segments has an autoregressive process of its own, restarted at every
//! segment (`ar`). It is found by Burg's recursion with the errors of all segments summed (`burg`):
//! stationary whatever the data, and nearly unbiased where slow noise decides. Its order is chosen
//! by one criterion with one setting (`OrderCriterion`), up to one highest order.
//!
//! # What the fit absorbed
//!
//! Residuals are smaller and less coloured than the noise, because the fit followed a part of it:
//! slow noise most of all, through initial states, zero shifts and derivatives. `absorbed` puts it
//! back: with the noise as it is known so far, the residuals of the generalised least-squares step
//! and, beside them, the columns of `G P^(1/2)` have sums of products whose expectation is the
//! noise's own, `E[n n' | z]`. A new model is made of these, and so on until it stays the same.
//! That is expectation and maximisation of the restricted likelihood (Patterson & Thompson,
//! Biometrika 58, 1971), whose estimate of a variance is the unbiased one; every round is a sum of
//! squares, so nothing can break.
//!
//! | file | what it does |
//! |---|---|
//! | `ar` | an autoregressive model |
//! | `burg` | the model of given series, and its order |
//! | `filter` | series made white; products with the covariance matrix |
//! | `gaps` | the same where samples were not measured |
//! | `absorbed` | what the fit took of the noise, put back |
//! | `whiteness` | whether a series is white, and how well two match |

pub mod absorbed;
pub mod ar;
pub mod burg;
pub mod filter;
mod gaps;
pub mod whiteness;

#[cfg(test)]
mod tests;

pub use absorbed::{Absorbed, Direction, Part, Prior, Taken};
pub use ar::Ar;
pub use burg::{Modelled, OrderCriterion, Products};
pub use filter::Filter;
pub use whiteness::{Theil, Whiteness, theil, whiteness};

/// How the colour of noise is modelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// Highest order of the autoregressive model of one output.
    pub highest: usize,
    /// How its order is chosen.
    pub criterion: OrderCriterion,
}

impl Default for Rule {
    fn default() -> Self {
        Rule { highest: 24, criterion: OrderCriterion::White }
    }
}
