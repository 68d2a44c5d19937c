//! A candidate, the base fit and both sets of maneuvers in; its full fit, and what it gains where
//! it was never fitted, out.
//!
//! Held-out maneuvers keep all derivatives as the training found them, of base and candidate alike;
//! only what belongs to the maneuver (initial states, zero shifts) is found again. The two
//! predictions then differ by `d` (whitened), and if the candidate is true and its parameters
//! right, the gain in log-likelihood is normal with mean `d'd/2` and variance `d'd`: that is the
//! gain predicted.

use super::value::{Gain, Value};
use crate::diagnose::base::frozen::{Frozen, frozen};
use crate::diagnose::base::spread::Spread;
use crate::diagnose::base::stand::{Known, Stand, fitted, settle_steps};
use crate::diagnose::base::training::{Task, Trained};
use crate::diagnose::effect::{Added, Candidate};
use crate::diagnose::residual::whitening::Noise;
use crate::diagnose::subject::Places;
use crate::diagnose::thresholds::Thresholds;
use crate::error::Errors;
use crate::estimate::{Block, Case, Prepared};
use crate::math::distribution::chi2_cdf;
use crate::math::products::dot;
use crate::model::Scope;
use rayon::prelude::*;

/// The base where candidates are held against it.
pub struct Ground<'a> {
    pub stand: &'a Stand,
    pub prepared: &'a Prepared,
    pub case: &'a Case,
    pub noise: &'a Noise,
    pub places: &'a Places,
    pub fit: &'a Trained,
    /// Costs and parameters of the held-out maneuvers with the base frozen.
    pub frozen: &'a [Option<Frozen>],
    pub thresholds: &'a Thresholds,
}

/// A candidate after its full fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Refit {
    /// Gain in log-likelihood over the training maneuvers.
    pub gain: f64,
    pub converged: bool,
    /// The added parameters.
    pub values: Vec<Value>,
    /// Held-out maneuvers, in the order of the places.
    pub held_out: Vec<Gain>,
    /// How the sizes added scatter from maneuver to maneuver; none where one maneuver alone tells.
    pub heterogeneity: Option<Heterogeneity>,
    /// Probability that a size which may differ from flight to flight scatters so much if it does not; the
    /// least of several, none where it has no such size or one flight alone.
    pub alike: Option<f64>,
    /// The training maneuvers' gains.
    pub training: Vec<Gain>,
    /// Everything that the fit found.
    pub known: Known,
}

/// What a fit leaves: white residuals, maneuver by maneuver, those of the training first.
pub type Left = Vec<Vec<f64>>;

/// Scatter of a size from maneuver to maneuver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heterogeneity {
    /// Probability of so much, if it is one number.
    pub p: f64,
    /// What is more than its uncertainty explains, as a share of the size.
    pub share: f64,
}

/// Fits a candidate from where the screening saw it best with its switch held, or with smaller
/// sizes where the model is better there.
///
/// # Errors
/// Its model does not fit the settings of the base's estimation.
pub fn refit(
    ground: &Ground,
    candidate: &Candidate,
    at: &[f64],
) -> Result<Option<(Refit, Left)>, Errors> {
    let known = Known::of(ground.case, ground.prepared, &ground.fit.theta);
    let Some(Attached { stand, prepared, mut case, theta }) =
        attached(ground, (candidate, at), &known)?
    else {
        return Ok(None);
    };
    let names: Vec<String> = candidate.added.iter().map(|a| a.name.clone()).collect();
    let theta = nearest(ground, &case, candidate, &theta);
    let (mut free, mut fit) =
        fitted(&case, ground.noise, ground.places, theta, &names, ground.thresholds);
    // What is stiffer where the fit ended than where it began (a play that became smaller) was not
    // integrated well on the way.
    if let Some(found) =
        fit.as_ref().filter(|found| case.stiffen(&found.theta)).map(|found| found.theta.clone())
    {
        (free, fit) = fitted(&case, ground.noise, ground.places, found, &names, ground.thresholds);
    }
    // Where parts stick or stop, kinks cut steps short: what gains without having settled goes on, and has settled
    // where no step brings anything, whatever a parabola promises.
    for _ in 0..ground.thresholds.further {
        let gains = |found: &&Trained| !found.converged && found.cost() < ground.fit.cost();
        let Some(found) = fit.as_ref().filter(gains) else { break };
        let (from, before) = (found.theta.clone(), found.cost());
        (free, fit) = fitted(&case, ground.noise, ground.places, from, &names, ground.thresholds);
        fit.iter_mut().for_each(|found| found.converged |= !(found.cost() < before));
    }
    let Some(fit) = fit else { return Ok(None) };
    let k = free.iter().filter(|&&i| names.contains(&case.unknowns[i].name)).count();
    let task = Task {
        case: &case,
        noise: ground.noise,
        segments: &ground.places.training,
        free: &free,
        thresholds: ground.thresholds,
    };
    let spread = task.spread(&fit.theta, k);
    let held_out =
        frozen(&case, ground.noise, ground.places, &fit.theta, (&stand.nulls, ground.thresholds));
    let gains = ground.frozen.iter().zip(&held_out).zip(&ground.places.held_out);
    let gains = gains
        .map(|((base, with), &s)| {
            held_out_gain(ground.noise, base.as_ref(), with.as_ref(), (s, prepared.used[s]))
        })
        .collect();
    let training = ground.places.training.iter().zip(ground.fit.costs.iter().zip(&fit.costs));
    let training = training.map(|(&s, (base, with))| Gain {
        segment: prepared.used[s],
        predicted: f64::NAN,
        realised: base - with,
    });
    let values =
        values(&case, (candidate, at), (&free, k), &fit, spread.as_ref(), ground.thresholds);
    let left = left(ground, &case, &fit.theta, &held_out);
    let refit = Refit {
        heterogeneity: spread
            .as_ref()
            .and_then(|spread| heterogeneity(spread, &values, ground.thresholds.telling_share)),
        alike: spread.as_ref().and_then(|s| alike(&case, candidate, (&free, k), &fit.theta, s)),
        gain: ground.fit.cost() - fit.cost(),
        converged: fit.converged,
        values: values.into_iter().map(|v| v.0).collect(),
        held_out: gains,
        training: training.collect(),
        known: Known::of(&case, &prepared, &fit.theta),
    };
    Ok(Some((refit, left)))
}

/// The base with a candidate, over all maneuvers.
pub struct Attached {
    pub stand: Stand,
    pub prepared: Prepared,
    pub case: Case,
    pub theta: Vec<f64>,
}

/// Attaches a candidate whose parameters start at `at`, all else where it is `known`; none where its model
/// does not run over all maneuvers.
///
/// # Errors
/// Its model does not fit the settings of the base's estimation.
pub fn attached(
    ground: &Ground,
    (candidate, at): (&Candidate, &[f64]),
    known: &Known,
) -> Result<Option<Attached>, Errors> {
    let stand = joined(ground.stand, candidate, at);
    let prepared =
        Prepared::new(&stand.model, &ground.prepared.segments, &stand.method)?.compiled();
    if prepared.used != ground.prepared.used {
        return Ok(None);
    }
    let mut case = prepared.case();
    let theta = known.placed(&case, &prepared);
    let least: Vec<usize> = ground.case.records.iter().map(|r| r.substeps).collect();
    settle_steps(&mut case, &theta, &least);
    Ok(Some(Attached { stand, prepared, case, theta }))
}

/// What the base leaves, before anything is added.
pub fn left_by_base(ground: &Ground) -> Left {
    left(ground, ground.case, &ground.fit.theta, ground.frozen)
}

/// The share of what one effect explains that another one explains as well: the square of the cosine
/// between the two differences that they make to what the base leaves. Where it is small, neither takes the
/// other's gain away: both may be missing.
pub fn shared(base: &Left, one: &Left, other: &Left) -> f64 {
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for ((e, a), b) in base.iter().zip(one).zip(other) {
        for ((e, a), b) in e.iter().zip(a).zip(b) {
            let (a, b) = (e - a, e - b);
            (aa, bb, ab) = (aa + a * a, bb + b * b, ab + a * b);
        }
    }
    if aa > 0.0 && bb > 0.0 { ab * ab / (aa * bb) } else { 0.0 }
}

fn left(ground: &Ground, case: &Case, theta: &[f64], held_out: &[Option<Frozen>]) -> Left {
    let white = |s: usize, blocks: &[Block]| ground.noise.whiten(s, blocks, &[]).pop();
    let trained = |&s: &usize| white(s, &case.evaluate(s, &case.layout.local(s, theta), false)?);
    let unseen = |(&s, with): (&usize, &Option<Frozen>)| white(s, &with.as_ref()?.blocks);
    let trained = ground.places.training.par_iter().map(trained).map(Option::unwrap_or_default);
    let unseen =
        ground.places.held_out.par_iter().zip(held_out).map(unseen).map(Option::unwrap_or_default);
    trained.chain(unseen).collect()
}

/// The best of the starts in which a share of the screening's sizes is taken: those were found with
/// everything else moving along.
fn nearest(ground: &Ground, case: &Case, candidate: &Candidate, theta: &[f64]) -> Vec<f64> {
    let task = Task {
        case,
        noise: ground.noise,
        segments: &ground.places.training,
        free: &[],
        thresholds: ground.thresholds,
    };
    let shared = |share: f64| -> Vec<f64> {
        let mut theta = theta.to_vec();
        for (unknown, value) in case.unknowns.iter().zip(&mut theta) {
            let null = candidate.added.iter().find(|a| a.name == unknown.name).and_then(|a| a.null);
            null.iter().for_each(|null| *value = null + share * (*value - null));
        }
        theta
    };
    let cost =
        |theta: &Vec<f64>| task.costs(theta).map_or(f64::INFINITY, |costs| costs.iter().sum());
    let starts = ground.thresholds.start_shares.map(shared);
    let costs: Vec<f64> = starts.iter().map(cost).collect();
    let best = (0..starts.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap_or_default();
    starts.into_iter().nth(best).unwrap_or_else(|| theta.to_vec())
}

/// The base with a candidate whose parameters start at `at`.
pub fn joined(stand: &Stand, candidate: &Candidate, at: &[f64]) -> Stand {
    let inside = |added: &Added, value: f64| match added.hold {
        Some(hold) => hold,
        None => value.clamp(added.min, added.max),
    };
    let one = |(added, value): (&Added, &f64)| {
        (added.name.clone(), inside(added, *value), added.is_held(), added.null)
    };
    stand.with(&candidate.model, &candidate.added.iter().zip(at).map(one).collect::<Vec<_>>())
}

/// What a held-out maneuver gains: its place among those used, and its index among all.
pub fn held_out_gain(
    noise: &Noise,
    base: Option<&Frozen>,
    with: Option<&Frozen>,
    (s, segment): (usize, usize),
) -> Gain {
    let (Some(base), Some(with)) = (base, with) else {
        return Gain { segment, predicted: f64::NAN, realised: f64::NEG_INFINITY };
    };
    let difference = |(a, b): (&Block, &Block)| {
        Block::new(a.output, a.e.iter().zip(&b.e).map(|(a, b)| a - b).collect(), Vec::new())
    };
    let blocks: Vec<Block> = base.blocks.iter().zip(&with.blocks).map(difference).collect();
    let white = noise.whiten(s, &blocks, &[]);
    let predicted = white.last().map_or(f64::NAN, |d| 0.5 * dot(d, d));
    Gain { segment, predicted, realised: base.cost - with.cost }
}

/// The added parameters as they were found, each with its place among the last `k` free ones (none
/// for one that is held). `tried`: the candidate, and the values of its parameters from which it
/// was fitted.
fn values(
    case: &Case,
    tried: (&Candidate, &[f64]),
    (free, k): (&[usize], usize),
    fit: &Trained,
    spread: Option<&Spread>,
    thresholds: &Thresholds,
) -> Vec<(Value, Option<usize>)> {
    let last = &free[free.len() - k..];
    let sd = |at: usize| spread.and_then(|s| s.sd.get(at).copied().flatten());
    let model = &tried.0.model;
    let doc = |name: &str| {
        model.parameter(name).map(|i| model.parameters[i].quantity.doc.clone()).unwrap_or_default()
    };
    let one = |(added, start): (&Added, &f64)| {
        // Of a parameter that differs from flight to flight the value that is furthest from null,
        // in its sd: there, if anywhere, it is seen.
        let far = |at: usize| {
            (fit.theta[last[at]] - added.null.unwrap_or_default()).abs()
                / sd(at).unwrap_or(f64::INFINITY)
        };
        let these = (0..k).filter(|&at| case.unknowns[last[at]].name == added.name);
        let at = these.max_by(|&a, &b| far(a).total_cmp(&far(b)).then(b.cmp(&a)));
        let value = match (at, added.hold) {
            (Some(at), _) => fit.theta[last[at]],
            (None, Some(hold)) => hold,
            (None, None) => *start,
        };
        let bound = |i: usize| value <= case.layout.lower[i] || value >= case.layout.upper[i];
        let value = Value {
            name: added.name.clone(),
            unit: added.unit.clone(),
            doc: doc(&added.name),
            value,
            sd: at.and_then(sd),
            null: added.null,
            span: added.span,
            at_bound: at.is_some_and(|at| bound(last[at])),
            held: added.is_held(),
            own: added.scope == Scope::Segment,
            of: at.and_then(|at| case.unknowns[last[at]].group.clone()),
            from: added.held_in.clone(),
            left: at.and_then(|at| spread.and_then(|s| s.left.get(at).copied())),
            check: added.check.as_ref().map(|c| (c.text.clone(), c.value, c.within)),
            is_determined: false,
        };
        (value.judged(thresholds), at)
    };
    tried.0.added.iter().zip(tried.1).map(one).collect()
}

/// How likely it is that sizes per flight (or another column) scatter so much about one number: with
/// values `v` of information `F`, `Q = v'F v - (1'F v)^2/(1'F 1)` against chi-square; where they are
/// differences from one of them, `Q = v'F v`.
fn alike(
    case: &Case,
    candidate: &Candidate,
    (free, k): (&[usize], usize),
    theta: &[f64],
    spread: &Spread,
) -> Option<f64> {
    let last = &free[free.len() - k..];
    let per_column = |added: &&Added| matches!(added.scope, Scope::Column(_));
    let one = |added: &Added| {
        let these: Vec<usize> =
            (0..k).filter(|&at| case.unknowns[last[at]].name == added.name).collect();
        let common = usize::from(added.held_in.is_none());
        let dof = these.len().checked_sub(common).filter(|dof| *dof > 0)? as f64;
        let f = |a: usize, b: usize| spread.information[a * k + b];
        let sum = |of: &dyn Fn(usize, usize) -> f64| -> f64 {
            these
                .iter()
                .flat_map(|&a| these.iter().map(move |&b| (a, b)))
                .map(|(a, b)| of(a, b))
                .sum()
        };
        let v = |at: usize| theta[last[at]];
        let all = sum(&|a, b| f(a, b));
        let mean = common as f64 * sum(&|a, b| f(a, b) * v(b)) / all;
        let q = sum(&|a, b| v(a) * f(a, b) * v(b)) - mean * mean * all;
        (all > 0.0 && q.is_finite()).then(|| 1.0 - chi2_cdf(q.max(0.0), dof))
    };
    candidate.added.iter().filter(per_column).filter_map(one).min_by(f64::total_cmp)
}

/// Scatter of what each maneuver asks for, about the common value: `Q = sum u_s^2/F_s` against
/// chi-square; its excess over the uncertainties by DerSimonian and Laird. The worst of the sizes.
fn heterogeneity(
    spread: &Spread,
    values: &[(Value, Option<usize>)],
    telling_share: f64,
) -> Option<Heterogeneity> {
    let one = |(v, at): &(Value, Option<usize>)| {
        let (null, at) = (v.null?, (*at)?);
        let all: Vec<(f64, f64)> =
            spread.by_segment.iter().filter_map(|s| s.get(at).copied()).collect();
        let total: f64 = all.iter().map(|s| s.1).sum();
        let telling: Vec<(f64, f64)> =
            all.into_iter().filter(|s| s.1 > telling_share * total).collect();
        let dof = telling.len().checked_sub(1).filter(|dof| *dof > 0)? as f64;
        let q: f64 = telling.iter().map(|(slope, information)| slope * slope / information).sum();
        let (sum, squares) = telling.iter().fold((0.0, 0.0), |s, t| (s.0 + t.1, s.1 + t.1 * t.1));
        let excess = ((q - dof) / (sum - squares / sum)).max(0.0).sqrt();
        Some(Heterogeneity { p: 1.0 - chi2_cdf(q, dof), share: excess / (v.value - null).abs() })
    };
    values
        .iter()
        .filter_map(one)
        .min_by(|a, b| a.p.total_cmp(&b.p).then(b.share.total_cmp(&a.share)))
}
