//! A flight in; its stretches with a path, and the noise levels that parts of them say, out.

use rayon::prelude::*;

use super::found::Found;
use super::settings::Settings;
use super::smoother::flight::Flight;
use super::smoother::kinematics::Kinematics;
use super::smoother::levels::Levels;
use super::smoother::sums::Sums;
use super::smoother::{Nothing, Smoothed, Smoother};

/// A stretch shorter than this has no path, s.
pub const SHORTEST: f64 = 1.0;
/// Length of one part of the flight that noise is estimated from, s.
const PART: f64 = 60.0;
/// First guess of a gust's walk, m/s per square root of a second: light turbulence.
const GUST: f64 = 0.05;
/// Least length of such a part where the flight is longer than can be used, s: a part first has to
/// find where it is.
const LEAST_PART: f64 = 20.0;
/// Noise levels are good when none changes by more than this share.
const SETTLED: f64 = 0.03;
/// While they still change by more than this share, every `THIN`-th part tells them well enough.
const NEAR: f64 = 0.1;
const THIN: usize = 4;
/// Outliers are rejected after so many iterations of the noise levels and once none changes by more
/// than this share; in the last ones always.
const OPEN: usize = 3;
const ROUGH: f64 = 0.3;

/// Times with a path, each long enough.
pub fn stretches(flight: &Flight, settings: &Settings) -> Vec<[f64; 2]> {
    flight.stretches(settings.coast_s).into_iter().filter(|s| s[1] - s[0] >= SHORTEST).collect()
}

/// First noise levels, and the places of what gusts disturb.
pub fn guess(
    kinematics: &Kinematics,
    flight: &Flight,
    settings: &Settings,
) -> (Levels, Vec<usize>) {
    let mut guess = Levels::guess(kinematics, flight, &settings.walk, &settings.sd);
    let gusts = settings.gusts.iter().filter(|name| !settings.walk.contains_key(*name));
    let gusts: Vec<usize> = gusts.filter_map(|name| kinematics.place(name)).collect();
    gusts.iter().for_each(|&i| guess.walk[i] = GUST * GUST);
    (guess, gusts)
}

/// Noise levels of the flight, from a first guess.
pub fn levels(
    smoother: &Smoother,
    stretches: &[[f64; 2]],
    first: &Levels,
    gusts: &[usize],
    found: &Found,
    settings: &Settings,
) -> Levels {
    let mut levels = first.clone();
    if let Some((free, before)) = &found.levels {
        levels.begin(smoother.kinematics, before, free);
    }
    let open_first = if found.levels.is_some() { 0 } else { OPEN };
    let start_sd = found.narrow(smoother.kinematics, &mut levels);
    let known = start_sd.as_ref().map(|_| found.known(smoother.kinematics));
    let parts = parts(stretches, settings.noise_s);
    let mut starts: Vec<Vec<f64>> =
        parts.par_iter().map(|&part| smoother.begin(&levels, part, known.as_deref())).collect();
    let all = smoother.with_gate(f64::INFINITY);
    let mut change = if found.levels.is_some() { 0.0 } else { f64::INFINITY };
    let mut near = found.levels.is_some() || parts.len() < 2 * THIN;
    for iteration in 0..settings.noise_iterations {
        // levels that begin far too small would have everything rejected that says so
        let open = (iteration < open_first || change > ROUGH)
            && iteration + OPEN < settings.noise_iterations;
        let with = if open { &all } else { smoother };
        let every = if near { 1 } else { THIN };
        let used: Vec<usize> = (0..parts.len()).step_by(every).collect();
        let runs: Vec<Smoothed> = used
            .par_iter()
            .map(|&k| with.run(&levels, parts[k], &starts[k], &mut (), &mut Nothing))
            .collect();
        let mut sums: Option<Sums> = None;
        for (run, &k) in runs.into_iter().zip(&used).filter(|(run, _)| run.finite) {
            sums.get_or_insert_with(|| run.sums.zero()).add(&run.sums);
            starts[k] = run.x;
        }
        let Some(sums) = sums else { break };
        change = levels.improve(first, &sums, gusts);
        if near && change < SETTLED && !open {
            break;
        }
        near |= change < NEAR || iteration + OPEN >= settings.noise_iterations;
    }
    if let Some(start_sd) = start_sd {
        levels.start_sd = start_sd;
    }
    levels
}

/// Parts of the stretches, spread evenly, of together about `total` s; everything where there is
/// not more.
fn parts(stretches: &[[f64; 2]], total: f64) -> Vec<[f64; 2]> {
    let length: f64 = stretches.iter().map(|s| s[1] - s[0]).sum();
    let part = PART.max(LEAST_PART * length / total);
    let mut out = Vec::new();
    for &[from, to] in stretches {
        let count = ((to - from) / part).ceil().max(1.0) as usize;
        let each = (to - from) / count as f64;
        let used = each * (total / length).min(1.0);
        out.extend((0..count).map(|k| {
            let begin = from + each * k as f64;
            [begin, begin + used]
        }));
    }
    out
}
