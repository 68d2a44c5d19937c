//! A solution by parameter index in; the estimation with names, units and correlations out.

use super::budget::{Influence, added};
use super::case::Case;
use super::chords::Chords;
use super::coarse::Coarse;
use super::edges::Edges;
use super::influential::Influential;
use super::noisy_inputs::NoisyInputs;
use super::preroll::TooShort;
use super::profile::Profile;
use super::ramps::Ramps;
use super::rank::{Combination, Term, Verdict, Weak};
use super::reached::Reached;
use super::regression::Regression;
use super::regressors::Problem;
use super::sides::Side;
use super::skewed::Skewed;
use super::solution::Solution;
use super::{Correlation, Estimation, OutputScatter, Row, Settings, Trace};
use crate::error::Result;
use crate::least_squares::{Arrow, Layout};

/// What is known of a solution beyond its values and covariances.
pub struct Further {
    pub told: Told,
    pub regression: Option<Regression>,
}

/// What is told of a solution, each as the estimation has it; nothing where that is not asked for.
#[derive(Default)]
pub struct Told {
    pub budget: Vec<Influence>,
    pub profiles: Vec<Profile>,
    pub stuck: Vec<(usize, String)>,
    pub reached: Vec<Reached>,
    pub crossed: Vec<String>,
    pub too_short: Vec<TooShort>,
    pub influential: Option<Influential>,
    pub coarse: Option<Coarse>,
    pub edges: Option<Edges>,
    pub chords: Option<Chords>,
    pub noisy_inputs: Option<NoisyInputs>,
    pub skewed: Option<Skewed>,
    pub ramps: Option<Ramps>,
    pub together: Vec<(String, f64)>,
}

/// What was compared with measurements: the outputs of the model, or its equations.
pub struct Traced {
    /// Number (as in a trace), name and unit.
    compared: Vec<(usize, String, String)>,
    /// Per segment used.
    traces: Vec<Vec<Trace>>,
}

impl Traced {
    /// The outputs along the motion.
    pub fn of_motion(case: &Case, solution: &Solution) -> Traced {
        let of = |o: usize| {
            let quantity = &case.model.outputs[o];
            (o, quantity.name.clone(), quantity.unit.clone())
        };
        let traces = (0..case.records.len()).map(|s| case.traces(s, &solution.fit.theta)).collect();
        Traced { compared: case.outputs.iter().copied().map(of).collect(), traces }
    }

    /// Both sides of the equations.
    ///
    /// # Errors
    /// The smoothing cannot be built.
    pub fn of_equations(case: &Case, solution: &Solution, settings: &Settings) -> Result<Traced> {
        let (problem, _) = Problem::new(case, settings)?;
        let of = |side: &Side| (side.number(&case.model), side.name.clone(), side.unit.clone());
        let compared = problem.sides.iter().map(of).collect();
        let theta = &solution.fit.theta;
        let traces = (0..case.records.len()).map(|s| problem.traces(s, theta)).collect();
        Ok(Traced { compared, traces })
    }
}

/// Puts names to a solution over the segments `used`, of `segments` in all; what is wrong with
/// segments is not known here.
pub fn name(
    case: &Case,
    used: &[usize],
    segments: usize,
    solution: Solution,
    traced: Traced,
    further: Further,
) -> Estimation {
    let Further { told, regression } = further;
    let rows = rows(case, used, &solution, &told);
    let combinations = solution.weak.iter().map(|weak| combination(&rows, weak)).collect();
    let (mut responses, mut noise_groups) = (vec![Vec::new(); segments], vec![None; segments]);
    for ((at, &s), traces) in used.iter().enumerate().zip(traced.traces) {
        responses[s] = traces;
        noise_groups[s] = Some(case.layout.parts[at].group);
    }
    Estimation {
        stop: solution.fit.stop,
        correlations: correlations(&case.layout, &solution),
        noisy_starts: solution.noisy_starts.clone(),
        det_r: libm::exp(solution.fit.ln_det),
        outputs: scatter(case, &solution, &traced.compared, &responses, &noise_groups),
        settled: solution.settled,
        noise_groups,
        responses,
        verdict: Verdict {
            condition: solution.condition,
            singular: solution.singular,
            combinations,
        },
        iterations: solution.fit.iterations,
        rows,
        budget: told.budget,
        profiles: told.profiles,
        regression,
        modes: Vec::new(),
        searched: Vec::new(),
        decisions: Vec::new(),
        left_out: Vec::new(),
        doubtful: Vec::new(),
        stuck: told.stuck,
        reached: told.reached,
        crossed: told.crossed,
        too_short: told.too_short,
        influential: told.influential,
        coarse: told.coarse,
        edges: told.edges,
        chords: told.chords,
        noisy_inputs: told.noisy_inputs,
        skewed: told.skewed,
        ramps: told.ramps,
        together: told.together,
        delaying: Vec::new(),
        elsewhere: None,
        tried: Vec::new(),
        why: None,
    }
}

fn rows(case: &Case, used: &[usize], solution: &Solution, told: &Told) -> Vec<Row> {
    let row = |i: usize| {
        let (sd, sd_crlb) = solution.deviation(i).unzip();
        let assumed = added(&told.budget, i);
        let profile = told.profiles.iter().find(|p| p.row == i);
        let unknown = &case.unknowns[i];
        Row {
            name: unknown.name.clone(),
            unit: unknown.unit.clone(),
            segment: unknown.segment.map(|at| used[at]),
            group: unknown.group.clone(),
            value: solution.fit.theta[i],
            sd,
            sd_crlb,
            sd_total: sd.map(|sd| (sd * sd + assumed).sqrt()),
            lower: profile.and_then(|p| p.lower),
            upper: profile.and_then(|p| p.upper),
            start: case.layout.start[i],
            at_bound: solution.fit.held[i]
                && !solution.fit.idle[i]
                && case.layout.lower[i] < case.layout.upper[i],
            idle: solution.fit.idle[i],
        }
    };
    (0..case.unknowns.len()).map(row).collect()
}

/// Standard deviations in the order of the parameter vector; empty without a covariance.
fn deviations(covariance: Option<&Arrow>) -> Vec<f64> {
    let Some(c) = covariance else { return Vec::new() };
    let own = c.own.iter().flat_map(|own| (0..own.n).map(|i| own.ss[i * own.n + i]));
    (0..c.shared).map(|i| c.cc[i * c.shared + i]).chain(own).map(f64::sqrt).collect()
}

fn correlations(layout: &Layout, solution: &Solution) -> Vec<Correlation> {
    let (Some(c), Some(m)) = (&solution.covariance, &solution.crlb) else { return Vec::new() };
    let (sd, crlb) = (deviations(Some(c)), deviations(Some(m)));
    let nc = layout.shared;
    let mut out = Vec::new();
    let mut push = |a: usize, b: usize, ca: f64, cm: f64| {
        if !solution.fit.held[a] && !solution.fit.held[b] {
            out.push(Correlation {
                a,
                b,
                value: ca / (sd[a] * sd[b]),
                crlb: cm / (crlb[a] * crlb[b]),
            });
        }
    };
    for a in 0..nc {
        (a + 1..nc).for_each(|b| push(a, b, c.cc[a * nc + b], m.cc[a * nc + b]));
    }
    for ((part, own), bound) in layout.parts.iter().zip(&c.own).zip(&m.own) {
        for i in 0..own.n {
            own.columns
                .iter()
                .enumerate()
                .for_each(|(k, &a)| push(a, part.offset + i, own.row(i)[k], bound.row(i)[k]));
            for j in i + 1..own.n {
                push(
                    part.offset + i,
                    part.offset + j,
                    own.ss[i * own.n + j],
                    bound.ss[i * own.n + j],
                );
            }
        }
    }
    out
}

fn combination(rows: &[Row], weak: &Weak) -> Combination {
    let term = |&(i, change): &(usize, f64)| {
        rows.get(i).map(|row| Term {
            name: row.name.clone(),
            segment: row.segment,
            group: row.group.clone(),
            change,
        })
    };
    Combination {
        information: weak.information,
        terms: weak.terms.iter().filter_map(term).collect(),
    }
}

fn scatter(
    case: &Case,
    solution: &Solution,
    compared: &[(usize, String, String)],
    responses: &[Vec<Trace>],
    groups: &[Option<usize>],
) -> Vec<OutputScatter> {
    let n = compared.len();
    let mut all = Vec::new();
    for (group, r) in solution.fit.noise.iter().enumerate() {
        for (j, (output, name, unit)) in compared.iter().enumerate() {
            let mine = groups
                .iter()
                .zip(responses)
                .filter(|(g, _)| **g == Some(group))
                .flat_map(|(_, traces)| traces);
            let first = groups.iter().flatten().position(|g| *g == group).unwrap_or(0);
            let known = case.noise_variance(j, first, &solution.fit.theta);
            let samples: usize = mine.filter(|t| t.output == *output).map(|t| t.t.len()).sum();
            let colour = solution.colour.get(group * n + j);
            all.push(OutputScatter {
                name: name.clone(),
                unit: unit.clone(),
                group,
                r: known.unwrap_or(r.variances()[j]),
                count: r.count[j],
                masked: samples - r.count[j],
                correlation: if case.layout.noise.full {
                    (0..n).map(|i| r.correlation(j, i)).collect()
                } else {
                    Vec::new()
                },
                colour: colour.cloned(),
            });
        }
    }
    all
}
