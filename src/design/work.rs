//! Designs in; each flown and every recording of it estimated, in parallel, out. The results are in
//! the order of the designs, whatever the number of threads.

use super::columns::Samples;
use super::estimated::{Run, estimated};
use super::flown::{Facts, fly};
use super::judged::{Judged, judge};
use super::rows::Design;
use super::study::Study;
use crate::error::{Error, Errors};
use crate::simulate::Campaign;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A design that was flown, with the estimates of its recordings, per estimate.
pub type Tried = Result<(Facts, Vec<Vec<Run>>), Error>;

/// Hears how many flights and recordings are done, of how many.
pub type Watch<'a> = &'a (dyn Fn(usize, usize) + Sync);

/// Flies designs and estimates `seeds` recordings of each; one that cannot be flown leaves the
/// others.
///
/// # Errors
/// Settings of an estimate that do not fit its model, which the check of the study tells before.
pub fn fly_all(
    study: &Study,
    designs: &[Design],
    seeds: u32,
    watch: Watch,
) -> Result<Vec<Tried>, Errors> {
    let campaign = study.flying(designs);
    let all = designs.len() * seeds as usize;
    let done = AtomicUsize::new(0);
    let step = |n: usize| watch(done.fetch_add(n, Ordering::Relaxed) + n, all);
    designs
        .par_iter()
        .map(|design| match fly(study, &campaign, design) {
            Err(e) => {
                step(seeds as usize);
                Ok(Err(e))
            }
            Ok(flown) => {
                let runs: Vec<Vec<Run>> = (0..u64::from(seeds))
                    .into_par_iter()
                    .map(|k| {
                        let runs = one(study, &campaign, &flown.truth, k);
                        step(1);
                        runs
                    })
                    .collect::<Result<_, Errors>>()?;
                let of = |i: usize| runs.iter().map(|all| all[i].clone()).collect();
                Ok(Ok((flown.facts, (0..study.estimates.len()).map(of).collect())))
            }
        })
        .collect()
}

/// Recording `k` of a flight, estimated by every estimate.
fn one(
    study: &Study,
    campaign: &Campaign,
    truth: &crate::simulate::Truth,
    k: u64,
) -> Result<Vec<Run>, Errors> {
    // The recorder's clock does not matter here: the first flight's, for all of them.
    let start_ns = campaign.settings.start_unix_s.saturating_mul(1_000_000_000);
    let seed = study.settings.seed.wrapping_add(k);
    let recording = crate::simulate::record(&campaign.settings, truth, seed, start_ns);
    let samples = Samples::of(study, &recording, start_ns, truth.duration())?;
    study.estimates.iter().map(|e| estimated(study, e, truth, &samples)).collect()
}

/// The designs under each estimate, not ranked yet.
pub fn judge_all(study: &Study, designs: &[Design], tried: &[Tried]) -> Vec<Vec<Judged>> {
    let of = |i: usize, design: &Design, tried: &Tried| {
        let flown = match tried {
            Ok((facts, runs)) => Ok((facts, runs[i].as_slice())),
            Err(e) => Err(e.what.as_str()),
        };
        judge(&study.estimates[i].name, design, flown)
    };
    (0..study.estimates.len())
        .map(|i| designs.iter().zip(tried).map(|(d, t)| of(i, d, t)).collect())
        .collect()
}
