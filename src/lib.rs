//! Koehler: flight-test logs in, identified aircraft models with honest uncertainty out.
//!
//! The modules are floors of one house: a module imports only modules named above it in this list,
//! and files inside a module do not import each other in circles (`tests/all/floors.rs` walks the
//! imports and fails on an upward one, and on a circle that its list does not name).
//!
//! | floor | what it does |
//! |---|---|
//! | `error` | the one error type: where, what was wanted, what was there, what to do |
//! | `guard` | what may be written over: no input, and without `--force` nothing that is not ours |
//! | `units` | unit strings, dimensions, conversions to SI |
//! | `config` | TOML files with positions, checked against the schema of their settings struct, all errors at once |
//! | `math` | small linear algebra, distributions |
//! | `least_squares` | Gauss-Newton over segments, each segment's own parameters eliminated first; covariance of the residuals |
//! | `noise` | the colour of residuals: autoregressive models, whitening, what a fit absorbed |
//! | `signal` | resampling, smoothing, differentiation of sampled signals |
//! | `table` | schemas, Parquet datasets, atomic writes, campaign-level joins |
//! | `engine` | where work runs: functions and their items, threads, other processes |
//! | `log` | MCAP in and out, channel map, decoders, imports |
//! | `model` | the model language: parse, check units, sort, differentiate, evaluate |
//! | `dynamics` | a compiled model over a record: trajectories, exact sensitivities, trim |
//! | `estimate` | maximum-likelihood output error |
//! | `reconstruct`, `segment`, `fit`, `simulate` | algorithms: numbers in, numbers out |
//! | `diagnose` | what a model lacks: candidate effects, and which of them the data ask for |
//! | `report` | tables to pages |
//! | `stage` | one file or folder per stage: tables <-> algorithms |
//! | `design` | input designs flown, recorded, estimated and ranked |
//! | `pipeline` | the pipeline file -> plan -> run; cache keys, provenance |
//! | `cli` | verbs, progress, the one place that prints errors |
//!
//! Other programs may use `cli` (the command), `engine` with [`FUNCTIONS`] (to run its work elsewhere),
//! `table` (its tables) and `error`: nothing else is public.

// A user's file is never a reason to panic: what can be wrong with it is an error with a place.
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo
    )
)]
#![deny(missing_docs)]
// What a folder hands on is used by the tests, or is a length that nobody asks whether it is 0.
#![cfg_attr(not(feature = "internals"), allow(unused_imports))]
#![cfg_attr(feature = "internals", allow(clippy::len_without_is_empty))]

// The interface to other programs.
pub mod cli;
pub mod engine;
pub mod error;
pub use pipeline::FUNCTIONS;
pub mod table;

// Everything else is private. The tests and benchmarks of the project see some of it through the
// feature `internals`, which other programs refuse (`default-features = false`): nothing is promised of
// it.
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod config;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod diagnose;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod dynamics;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod estimate;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod log;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod math;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod model;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod pipeline;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod reconstruct;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod report;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod simulate;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod stage;
#[cfg(feature = "internals")]
#[doc(hidden)]
pub mod units;

#[cfg(not(feature = "internals"))]
mod config;
#[cfg(not(feature = "internals"))]
mod diagnose;
#[cfg(not(feature = "internals"))]
mod dynamics;
#[cfg(not(feature = "internals"))]
mod estimate;
#[cfg(not(feature = "internals"))]
mod log;
#[cfg(not(feature = "internals"))]
mod math;
#[cfg(not(feature = "internals"))]
mod model;
#[cfg(not(feature = "internals"))]
mod pipeline;
#[cfg(not(feature = "internals"))]
mod reconstruct;
#[cfg(not(feature = "internals"))]
mod report;
#[cfg(not(feature = "internals"))]
mod simulate;
#[cfg(not(feature = "internals"))]
mod stage;
#[cfg(not(feature = "internals"))]
mod units;

mod design;
mod fit;
mod guard;
mod least_squares;
mod noise;
mod segment;
mod signal;
