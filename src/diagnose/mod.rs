//! Where a model and flights disagree, and which missing effect explains it: a base model,
//! maneuvers and candidate effects in; a verdict with its evidence out. Numbers in, numbers out;
//! how the flights were made is never known here.
//!
//! # How a verdict comes about
//!
//! 0. *Together*: what a pipeline estimates maneuver by maneuver, or flight by flight, becomes one
//!    estimation over all of them that claims the same: lines where the pipeline fits lines, one
//!    value each where it does not.
//! 1. *Base fit* of the training maneuvers by the estimator; an autoregressive model per output of
//!    what is left. `W` makes residuals and sensitivities white, segment by segment;
//!    `J = |W (z - y)|^2 / 2` is the cost everything below is measured in, so that differences of
//!    `J` are gains in log-likelihood. Constants that the model assumes with an sd, and that the
//!    flights see, are free from here on, that sd being their prior.
//! 2. *Screening*: every candidate adds parameters `b` that are nothing at their null. With
//!    `H = W dy/db` and `G = W dy/dtheta` of all that is free in the base (shared parameters and
//!    what belongs to a maneuver), `H~ = (1 - G (G'G)^-1 G') H`, `u = H~'e`, `F = H~'H~`: the gain
//!    is `u'F^-1 u / 2` (score test), within the candidate's bounds. Where `H~` vanishes, the base
//!    is collinear with the effect, which is no candidate then.
//! 3. *Chance*: surrogate campaigns in which nothing is missing have `u ~ N(0, F)` for all
//!    candidates at once, drawn on sums of samples (`search::projected`). The best candidate of
//!    each is noted; the 99% quantile is what a real one must exceed (gains less half the 99% quantile of chi-square for its number of parameters).
//! 4. *Refits* in full of the few best, with everything free; held-out maneuvers then, all
//!    derivatives frozen: the effect predicts the gain `d'd/2` from the whitened difference `d` of
//!    the two predictions, and has to bring it.
//! 5. *Evidence* of a candidate: gain of the training less what chance gives one alone, plus the
//!    gain realised on held-out maneuvers. Those that pass every test and come within `apart` of
//!    the best are not distinguishable from it (further, where the difference scatters more than
//!    noise lets it). Errors of sensors come before physics among equals.
//! 6. *Addition*: the best is added to the model, and all of it begins again, until nothing passes;
//!    then each one is taken out again and tested with everything else in place.
//! 7. *What is left* is asked without any candidate: does an output still respond to an input? Is a
//!    held-out maneuver missed by more than all others? Then something is located, not explained.
//! 8. *Adequacy*: "nothing missing" is said only where what is left of every output is its sensor's
//!    noise, or turbulence in the model accounts for the rest.
//!
//! | file | what it does |
//! |---|---|
//! | `subject` | what is diagnosed |
//! | `settings` | how a diagnosis is run |
//! | `thresholds` | all numbers that decide |
//! | `together` | what a pipeline estimates one by one, as one estimation over all maneuvers |
//! | `held_out` | which maneuvers are held out |
//! | `effect` | the library of candidate effects and their attachment to a model |
//!
//! Four wings; each imports only from those above it and from the files above:
//!
//! | wing | file | what it does |
//! |---|---|---|
//! | `residual` | | **what a fit leaves** |
//! | | `sensor` | the noise on a measured signal |
//! | | `timescale` | how fast the motion is: what lags, windows and bands are counted in |
//! | | `noise` | the noise of the base's residuals, and whitening by it |
//! | | `evaluation` | residuals and sensitivities at one point, for many who ask |
//! | | `absorbed` | what the fit took of it |
//! | | `joint` | what several outputs' residuals have in common |
//! | | `colour` | the noise that a fit leaves |
//! | | `sources` | what an output may respond to |
//! | | `gain` | the most that a log-likelihood gains within bounds |
//! | | `sums` | the response of residuals to a source |
//! | | `responses` | what the residuals demonstrably respond to, and is no noise |
//! | | `innovation` | whether a source foretells what is new in an output at each instant |
//! | | `located` | whether an output still responds to a source |
//! | `base` | | **the base as it stands with what was added** |
//! | | `training` | maximum of the likelihood of the whitened residuals, bounds kept |
//! | | `stand` | the base as it stands, its fit |
//! | | `frozen` | held-out maneuvers with the derivatives of the training |
//! | | `constants` | assumed constants that the flights see, free with their sd for a prior |
//! | | `found` | the base fitted as it stands, with the noise it leaves |
//! | `gap` | | **how large the gap is, and where** |
//! | | `looks` | windows and bands of the description of the gap |
//! | | `gaps` | how large the gap is, and where |
//! | | `driven` | what goes away when a loop is closed by its measurement; what each rate equation lacks |
//! | | `coefficient` | what each force and moment coefficient lacks, with its uncertainty |
//! | | `relation` | correlation, lag and coherence of the residuals with what moves them |
//! | | `evidence` | the equation that lacks most, and what it goes with |
//! | | `varying` | parameters that differ from maneuver to maneuver |
//! | | `left` | whether what is left of each output is its sensor's noise |
//! | | `before_after`, `comparison` | the gap before and after, and what the addition did to the other parameters |
//! | `search` | | **which effect explains it** |
//! | | `ground` | what candidates are screened against |
//! | | `probe` | a model's sensitivities to what candidates add, where the base stands |
//! | | `probes` | those of all candidates, many in one run |
//! | | `projected` | what the base leaves of their columns, and sums of samples to draw noise on |
//! | | `settled` | columns of a trial that are told apart |
//! | | `tried` | what is tried of every candidate, and what is said of it |
//! | | `screen` | score tests of all candidates |
//! | | `screening` | what they say, and what noise would say |
//! | | `surrogate` | what chance gives |
//! | | `value` | a parameter and a maneuver's gain after a full fit |
//! | | `refit` | a candidate in full, and on held-out maneuvers |
//! | | `judged` | a round's candidates, each with its standing |
//! | | `decide` | the tests that a candidate must pass, and the class of those that pass alike |
//! | | `round` | all candidates held against a base |
//! | | `turbulence` | whether noise that drives the model accounts for what is left |
//! | | `variants` | other choices of the maneuvers that train and that are held out |
//! | | `stability` | how often an effect is chosen over them |
//! | | `unphysical` | what speaks against the model with everything added, as a whole |
//! | | `unseen` | held-out maneuvers that show what no other does |
//! | | `verdict` | what is known in the end |
//! | | `ending` | what is left with everything that was named, and the verdict |
//! | | `diagnose` | round after round, forward and back |

mod base;
pub mod effect;
#[cfg(test)]
mod flight_tests;
mod gap;
mod held_out;
#[cfg(test)]
mod hinge_tests;
#[cfg(test)]
mod record_tests;
mod residual;
mod search;
mod settings;
mod subject;
#[cfg(test)]
mod tests;
pub mod thresholds;
mod together;
#[cfg(test)]
mod turbulence_tests;

pub use base::stand::free_of_predictions;
pub use gap::before_after::{Channel, Match, Overlay, Shift};
pub use gap::comparison::Comparison;
pub use gap::driven::{Driven, EquationError};
pub use gap::evidence::{Evidence, strongest};
pub use gap::gaps::Gap;
pub use gap::left::Left;
pub use gap::relation::Relation;
pub use gap::varying::Varying;
pub use held_out::{Rule, cut, held_out};
pub use residual::located::Located;
pub use search::diagnose::diagnose;
pub use search::judged::{Judged, Round, Standing};
pub use search::refit::{Heterogeneity, Refit};
pub use search::stability::{Count, Stability, Vote, Weighed};
pub use search::surrogate::chance;
pub use search::tried::{Imitator, Screened};
pub use search::turbulence::{Accounted, Density, Turbulence};
pub use search::unseen::Missed;
pub use search::value::{Gain, Value};
pub use search::verdict::{Diagnosis, Finding, Verdict};
pub use settings::{Base, Settings};
pub use subject::{Subject, Trouble};
pub use thresholds::Thresholds;
pub use together::{Claim, Fitted, together};
