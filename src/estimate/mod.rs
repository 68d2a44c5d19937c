//! Maximum-likelihood output error: a model and records in; estimates with honest standard
//! deviations, responses and a stop reason out.
//!
//! The cost is `J = 1/2 sum e' R^-1 e + N/2 ln|R|` (attas A4) with `R` re-estimated from the
//! residuals `e = z - y` of all segments together (or per group of segments), diagonal or full,
//! every output scored at its own time stamps. Steps of Gauss and Newton, or of Levenberg and
//! Marquardt, are accepted on the concentrated likelihood (`R` at its optimum for the trial point),
//! never on the cost at a fixed `R`.
//!
//! | file | what it does |
//! |---|---|
//! | `segment` | records with labels; groups of segments; which samples belong together |
//! | `rank` | which combinations of parameters the data cannot separate |
//! | `colour` | standard deviations under coloured residuals |
//! | `noise_covariance` | products of a segment's sensitivities with the covariance of coloured noise, and its rows made white |
//! | `neighbours` | the minimum from which no segment gets to a lower one by the values of the others |
//! | `watched` | limits of states as outputs of the model |
//! | `preroll` | delays that reach back to before a record |
//! | `crossed` | limits of states that cross each other |
//! | `measured_limits` | limits of states against what was measured |
//! | `densities` | densities of noise at zero |
//! | `elsewhere` | where another start leads to |
//! | `sizes` | parameters that only show from a certain size on |
//! | `solution` | the six together: estimates and covariances by parameter index |
//! | `budget`, `made` | how the constants move the estimates that a model assumes, or that columns were made with |
//! | `profile` | intervals from the likelihood's profile |
//! | `modes` | the modes of the linearised model |
//! | `selection` | candidates that the data do not support are held, one after the other |
//! | `terms` | one equation: its candidates gone through, one after the other |
//! | `search` | all equations so: candidates that they ask for |
//! | `decision` | what became of such a candidate |
//! | `sides` | the rate and output equations that the measurements allow |
//! | `regressors` | both sides of these equations, as such a problem |
//! | `regression` | its solution: the estimate by equation error, or starting values |
//! | `attenuation` | how far noise in the regressors has moved it |
//! | `start` | whether they fit better than those of the model |
//! | `settings` | how an estimation is run |
//! | `choice` | settings against the model: what is free, where it starts |
//! | `extend` | the model with shifts and feedback that the settings ask for, and records that feed it |
//! | `prepared` | the same without an estimation: a model over the segments that can be used, to be evaluated anywhere |
//! | `usable` | start values of the states; which segments can be used |
//! | `equations` | the sums over a segment, wherever they are taken; the solution and the profiles made from them |
//! | `output_error` | a compiled model over segments, as such a problem; segments that cannot be used left out |
//! | `case` | that problem for the segments used |
//! | `trace` | measured and modelled values of an output |
//! | `tries` | several starts, of which the best is kept |
//! | `plateaus` | what was measured of a state on its limit |
//! | `idle` | why nothing shows a parameter |
//! | `coarse` | what finer integration steps would move |
//! | `chords` | what the estimates owe to straight lines between the points of the grid |
//! | `noisy_inputs` | what the noise of measured inputs moves, and what it alone determines |
//! | `ramps` | what the estimates owe to the curve that a delay reads of its input |
//! | `skewed`, `shifted`, `scores` | records that look late against the others |
//! | `together` | standard deviations that are too small because several outputs are moved at once |
//! | `edges` | what the estimates owe to when inputs stepped between two samples |
//! | `influential` | the one sample on which an estimate hangs |
//! | `reached` | which limits of the states the motion reaches, and how near it comes to the others |
//! | `estimation` | the result |
//! | `result` | names put to the solution |

mod attenuation;
mod begin;
mod budget;
mod case;
mod choice;
mod chords;
mod coarse;
mod colour;
mod crossed;
mod decision;
mod densities;
mod edges;
mod elsewhere;
mod equations;
mod estimation;
mod extend;
mod idle;
mod influential;
mod made;
mod measured_limits;
mod modes;
mod neighbours;
mod noise_covariance;
mod noisy_inputs;
mod noisy_starts;
mod output_error;
mod plateaus;
mod prepared;
mod preroll;
mod profile;
mod ramps;
mod rank;
mod reached;
pub mod regression;
mod regressors;
mod residuals;
mod result;
mod rubbed;
mod sampled;
mod scores;
mod search;
mod segment;
mod selection;
mod settings;
mod shifted;
mod sides;
mod sizes;
mod skewed;
mod solution;
mod start;
mod terms;
#[cfg(test)]
mod tests;
mod together;
mod trace;
mod tries;
mod unknowns;
mod usable;
mod watched;

pub use crate::least_squares::{Block, Iteration, StepControl, Stop};
pub use budget::{Influence, covariance};
pub use case::Case;
pub use chords::Chords;
pub use coarse::Coarse;
pub use decision::{Decision, Support};
pub use edges::Edges;
pub use equations::NormalEquations;
pub use estimation::{
    Correlation, Doubtful, Elsewhere, Estimation, LeftOut, OutputScatter, Row, Tried,
};
pub use extend::{extended, not_filtered};
pub use idle::Idle;
pub use influential::Influential;
pub use modes::{Mode, Uncertain};
pub use noisy_inputs::NoisyInputs;
pub use output_error::{estimate, estimate_segments, estimate_where};
pub use plateaus::Piece;
pub use prepared::Prepared;
pub use preroll::TooShort;
pub use profile::{End, Point, Profile};
pub use ramps::Ramps;
pub use rank::{Combination, Term, Verdict};
pub use reached::{Follows, Over, Reached};
pub use search::unsearchable;
pub use segment::{Grouping, Label, Made, SEGMENT, Segment, Stretch};
pub use settings::{
    Asked, By, InitialFrom, Line, NoiseKind, Search, Settings, Shifts, StartFrom, WithoutEffect,
};
pub use skewed::{Late, Skewed};
pub use solution::NoisyStarts;
pub use terms::Step;
pub use trace::{Filtered, Trace};
pub use tries::too_many;
pub use unknowns::Unknown;
