//! How an iteration steps, and when it stops.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How steps are kept from going too far. Both ways take a step only if it does not raise the
/// concentrated cost.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StepControl {
    /// The Gauss-Newton step, halved until it is good.
    #[default]
    Halving,
    /// Damped by a share of the information of every parameter, which follows from the gain of the
    /// last step: shorter and turned to the steepest descent. Helps where starts are poor or
    /// parameters hardly separable.
    LevenbergMarquardt,
}

/// When to stop and how to step.
#[derive(Debug, Clone, Copy)]
pub struct Method {
    pub control: StepControl,
    /// Stops where `det R` changes by less than this share of it in one iteration (where `R` is
    /// known: the mean square of the residuals), and the two conditions below hold.
    pub tolerance: f64,
    /// ... and the whole step is shorter than so many standard deviations, `sqrt(d' M d)`: it
    /// promises to lower the cost by half the square of that. 0 asks for nothing.
    pub step_tolerance: f64,
    /// ... and the steepest slope is below this. 0 asks for nothing.
    pub gradient_tolerance: f64,
    pub max_iterations: usize,
    pub max_halvings: usize,
    /// Stops, too, where two short steps in a row together lower the cost by less than this: kinks of the
    /// cost promise more than is to be had. 0 asks for nothing.
    pub creep: f64,
    /// Whether the last step, the one shorter than `step_tolerance`, is not taken.
    pub spares_last: bool,
    pub undetermined: Undetermined,
    /// Whether a step that a kink of the cost stops is tried with one shared parameter after the
    /// other held, too.
    pub turns: bool,
}

impl Default for Method {
    fn default() -> Method {
        Method {
            control: StepControl::default(),
            tolerance: 1e-6,
            step_tolerance: 0.01,
            gradient_tolerance: 0.01,
            max_iterations: 50,
            max_halvings: 20,
            creep: 0.0,
            spares_last: false,
            undetermined: Undetermined::Refused,
            turns: true,
        }
    }
}

/// What becomes of a parameter that depends on those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Undetermined {
    /// The iteration ends: `Stop::Singular`.
    Refused,
    /// A common one that nothing shows here (a limit that is not reached) stays where it is until
    /// something does; any other ends the iteration.
    SetAside,
    /// It stays where it is while the others move.
    Held,
}
