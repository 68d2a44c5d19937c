//! A compiled model over segments in; its maximum-likelihood estimate, with segments that cannot be
//! used left out and named, out.

use super::budget::{Influence, influences, together};
use super::case::{Case, PASSES, propagator};
use super::choice::choose;
use super::equations::Origin;
use super::extend::prepare;
use super::made;
use super::profile::profiles;
use super::rank::{NONE, weak_words};
use super::regression::{Regression, estimated};
use super::regressors::Problem;
use super::result::{Further, Told, Traced, name};
use super::search::searched;
use super::segment::Segment;
use super::selection::select;
use super::solution::Solution;
use super::tries::best_of;
use super::usable::{starts, unusable};
use super::{Asked, By, Doubtful, Elsewhere, Estimation, LeftOut, Settings, Stop};
use crate::dynamics::{Lost, Record};
use crate::engine::{Here, Kept, Threads};
use crate::error::{Error, Errors};
use crate::model::Model;
use std::sync::Arc;

/// Estimates the free parameters of `model` jointly over `records`, one segment each, without
/// labels.
///
/// # Errors
/// As `estimate_segments`.
pub fn estimate(
    model: &Model,
    records: &[Record],
    settings: &Settings,
) -> Result<Estimation, Errors> {
    let segments: Vec<Segment> = records.iter().cloned().map(Segment::from).collect();
    estimate_segments(model, &segments, settings)
}

/// Estimates the free parameters of `model` jointly over `segments`.
///
/// `R` and the colour of the residuals are shared by all segments, or by those of a group
/// (`settings.noise_per`), and so are parameters. Initial states are those of the model
/// ("measured": the first measured value of the output of the state's name, in that segment), or
/// free per segment (`settings.initial`; they then start from the same value).
///
/// A segment that cannot take part is left out, with the reason, and the others go on: one without
/// a single measured sample, without the label that a free parameter is `per`, where the model is
/// not finite at the start, or whose own parameters (or those of its group) its data cannot
/// determine. Candidates that the data do not support are held (`selection`).
///
/// # Errors
/// Names that the model does not have, labels that no segment has, starts that are not finite or
/// outside their bounds, a measured start without a measured output: all at once. What the data do
/// is never an error: see `Estimation::stop`.
pub fn estimate_segments(
    model: &Model,
    segments: &[Segment],
    settings: &Settings,
) -> Result<Estimation, Errors> {
    let kept = Kept::default();
    let here = Here { engine: &Threads, kept: &kept, hear: &|_, _| {} };
    estimate_where(&here, model, segments, settings)
}

/// The same, the normal equations of the segments being left to an engine.
///
/// # Errors
/// As `estimate_segments`.
pub fn estimate_where(
    here: &Here,
    model: &Model,
    segments: &[Segment],
    settings: &Settings,
) -> Result<Estimation, Errors> {
    best_of(settings, &|settings| {
        select(
            settings,
            |settings| once(here, model, segments, settings),
            |settings| searched(model, segments, settings),
        )
    })
}

/// Estimates all that is free, candidates included.
fn once(
    here: &Here,
    base: &Model,
    all: &[Segment],
    settings: &Settings,
) -> Result<Estimation, Errors> {
    let (model, segments) = prepare(base, all, settings)?;
    let (model, segments) = (Arc::new(model.into_owned()), &*segments);
    let chosen = Arc::new(choose(&model, segments, settings)?);
    let mut propagator = propagator(&model, &chosen, segments)?;
    propagator.compile(settings.tier, PASSES, segments.iter().map(|s| s.record.n).sum());
    let propagator = Arc::new(propagator);
    let given = starts(&model, &propagator, segments, &chosen, settings)?;
    let mut left_out: Vec<LeftOut> = Vec::new();
    let mut used: Vec<usize> = Vec::new();
    for s in 0..segments.len() {
        match unusable(&model, &chosen, &segments[s], &given[s]) {
            Some(why) => left_out.push(LeftOut { segment: s, why }),
            None => used.push(s),
        }
    }
    if used.is_empty() {
        // The outcome is told over all that could be run.
        used = (0..segments.len()).filter(|&s| given[s].is_ok()).collect();
        left_out.retain(|left| !used.contains(&left.segment));
    }
    loop {
        let these: Vec<&Segment> = used.iter().map(|&s| &segments[s]).collect();
        let values = used.iter().filter_map(|&s| given[s].as_ref().ok().cloned()).collect();
        let mut case =
            Case::new(model.clone(), chosen.clone(), propagator.clone(), &these, values, settings);
        if settings.asked != Asked::Nothing {
            case.check_limits()?;
        }
        let origin = Origin::new(base, all, settings, &used);
        let (regression, solution, elsewhere) = match settings.by {
            By::Motion => by_motion(&mut case, settings, (&origin, here))?,
            By::EquationError => {
                let (regression, solution) = by_equations(&case, settings)?;
                (regression, solution, None)
            }
        };
        let useless = useless(&case, &solution);
        if useless.is_empty() || useless.len() == used.len() {
            left_out.sort_by_key(|left| left.segment);
            let why = match solution.fit.stop {
                Stop::NotFinite => useless.into_iter().next().map(|(_, why)| why),
                Stop::RunsAway => Some(RUNS_AWAY.to_string()),
                _ => None,
            };
            let told = match settings.asked {
                Asked::Minimum | Asked::Nothing => Told::default(),
                Asked::All => {
                    let values = used.iter().filter_map(|&s| given[s].as_ref().ok().cloned());
                    let budget =
                        influences(base, &these, values.collect(), &case, &solution, settings)?;
                    let made = made::influences(base, (all, &used), &case, &solution, settings)?;
                    let budget = together(budget, made);
                    told(&case, &solution, (settings, &used), budget, (&origin, here))?
                }
            };
            let traced = match settings.by {
                By::Motion => Traced::of_motion(&case, &solution),
                By::EquationError => Traced::of_equations(&case, &solution, settings)?,
            };
            let further = Further { told, regression };
            let modes = match settings.asked {
                Asked::All => case.modes(&solution, &used),
                Asked::Minimum | Asked::Nothing => Vec::new(),
            };
            let named = name(&case, &used, segments.len(), solution, traced, further);
            return Ok(Estimation {
                left_out,
                doubtful: doubtful(&model, segments),
                delaying: case.delaying(),
                elsewhere,
                modes,
                why,
                ..named
            });
        }
        left_out.extend(
            useless.iter().map(|(at, why)| LeftOut { segment: used[*at], why: why.clone() }),
        );
        used.retain(|s| left_out.iter().all(|left| left.segment != *s));
    }
}

fn told(
    case: &Case,
    solution: &Solution,
    (settings, used): (&Settings, &[usize]),
    budget: Vec<Influence>,
    (origin, here): (&Origin, &Here),
) -> Result<Told, Errors> {
    let theta = &solution.fit.theta;
    let too_short = case.short_of_preroll(theta, used)?;
    Ok(match settings.by {
        By::Motion => Told {
            budget,
            profiles: case.profiles(solution, settings, origin, here),
            stuck: stuck(case, solution, used),
            reached: case.reached(theta, used)?,
            crossed: case.crossed(theta)?,
            too_short,
            influential: case.influential(solution, used),
            coarse: case.coarse(solution, settings),
            edges: case.edges(solution, settings),
            chords: case.chords(solution, settings),
            noisy_inputs: case.noisy_inputs(solution, settings),
            skewed: case.skewed(solution, settings),
            ramps: case.ramps(solution, settings),
            together: case.together(solution),
        },
        // Nothing moves: there are no limits, and nothing that friction could hold.
        By::EquationError => {
            let (problem, _) = Problem::new(case, settings)?;
            let layout = problem.layout(settings);
            let asked = |i: &usize| settings.profile.contains(&case.unknowns[*i].name);
            let which: Vec<usize> = (0..case.unknowns.len()).filter(asked).collect();
            let profiles = profiles(&layout, &problem, solution, &which, settings);
            Told { budget, profiles, too_short, ..Told::default() }
        }
    })
}

/// The estimate by the motion, with where another start ended if it is elsewhere.
fn by_motion(
    case: &mut Case,
    settings: &Settings,
    (origin, here): (&Origin, &Here),
) -> Result<(Option<Regression>, Solution, Option<Elsewhere>), Error> {
    let regression = case.start_by_regression(settings)?;
    let solution = case.solve(settings, origin, here);
    let (solution, elsewhere) =
        case.elsewhere(solution, regression.as_ref(), settings, (origin, here));
    let (mut solution, by_friction) = case.rubbed(solution, settings, (origin, here));
    let elsewhere = by_friction.or(elsewhere);
    if settings.asked != Asked::Nothing {
        solution = case.with_noise_of_starts(solution, settings);
    }
    if settings.stabilise.values().any(|gain| *gain != 0.0) {
        // Noise of the measured states drives the model: what residuals tell is not how far off it is.
        solution.covariance = None;
    }
    Ok((regression, solution, elsewhere))
}

/// The estimate by the equations of the model.
fn by_equations(case: &Case, settings: &Settings) -> Result<(Option<Regression>, Solution), Error> {
    let (problem, considered) = Problem::new(case, settings)?;
    let (regression, solution) = estimated(&problem, considered, settings);
    Ok((Some(regression), solution))
}

/// Segments in which friction holds a state all along.
fn stuck(case: &Case, solution: &Solution, used: &[usize]) -> Vec<(usize, String)> {
    if case.model.moving.is_empty() {
        return Vec::new();
    }
    let of = |(place, &segment): (usize, &usize)| {
        let states = case.stuck(place, &solution.fit.theta);
        states.into_iter().map(move |i| (segment, case.model.states[i].quantity.name.clone()))
    };
    used.iter().enumerate().flat_map(of).collect()
}

/// Measured outputs that say little.
fn doubtful(model: &Model, segments: &[Segment]) -> Vec<Doubtful> {
    let mut found = Vec::new();
    for (segment, channel) in segments
        .iter()
        .enumerate()
        .flat_map(|(s, seg)| seg.record.channels.iter().map(move |c| (s, c)))
    {
        let mut finite = channel.z.iter().filter(|z| z.is_finite());
        let why = match finite.next() {
            None => "it has no sample that is not masked",
            Some(first) if channel.z.len() > 1 && finite.all(|z| z == first) => {
                "all its samples have the same value"
            }
            Some(_) => continue,
        };
        let output = model.outputs.get(channel.output).map(|o| o.name.clone()).unwrap_or_default();
        found.push(Doubtful { segment, output, why: why.to_string() });
    }
    found
}

/// What it is to a user that a fit runs away.
const RUNS_AWAY: &str = "it leads to motions that are far too fast for the samples to show them; bounds of parameters are missing, or something holds the motion that the model does not know (a stop)";

/// Segments (places among those used) that keep the others from being estimated, and why: of a
/// model that is not finite at the start, those where it is not; of parameters that the data cannot
/// determine, those that they belong to. All of them, or none, means that leaving some out would
/// not help.
fn useless(case: &Case, solution: &Solution) -> Vec<(usize, String)> {
    let all = case.layout.parts.len();
    if solution.fit.stop == Stop::NotFinite {
        let finite = |s: &usize| is_finite(case, *s);
        return (0..all).filter(|s| !finite(s)).map(|s| (s, given_up(case, s))).collect();
    }
    let mut found: Vec<(usize, String)> = Vec::new();
    for weak in solution.weak.iter().filter(|weak| solution.singular && weak.information <= NONE) {
        let segments = case.segments_of(weak.terms.iter().map(|t| t.0));
        if segments.len() == all {
            // Nothing that a segment could be blamed for.
            continue;
        }
        let names: Vec<&str> =
            weak.terms.iter().map(|t| case.unknowns[t.0].name.as_str()).collect();
        for s in segments {
            if found.iter().all(|(at, _)| *at != s) {
                found.push((s, weak_words(&names)));
            }
        }
    }
    found
}

/// Why a segment cannot be run at the start values.
fn given_up(case: &Case, s: usize) -> String {
    match case.lost(s, &case.layout.start) {
        None | Some(Lost::Diverges) => "the model is not finite there at the start values (other ones, or `start = \"equation error\"`?)".into(),
        Some(lost) => format!("{} at the start values", lost.words(&case.model.states)),
    }
}

fn is_finite(case: &Case, s: usize) -> bool {
    let blocks = case.evaluate(s, &case.layout.local(s, &case.layout.start), true);
    blocks.is_some_and(|blocks| {
        let finite = |v: &f64| (v * v).is_finite();
        blocks
            .iter()
            .all(|b| b.e.iter().filter(|e| !e.is_nan()).all(finite) && b.g.iter().all(finite))
    })
}
