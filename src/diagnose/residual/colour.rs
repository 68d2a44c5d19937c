//! A fit, as the noise sees it, in; the colour of its residuals, output by output and of outputs together, out.

use super::absorbed::{Fitted, Series};
use super::joint::{Joint, Lagged, together};
use super::whitening::Noise;
use crate::noise::{Filter, Products, burg};
use rayon::prelude::*;

/// Of the residuals of a fit, with what it absorbed (as far as `fitted` knows) put back. A group that the fit has nothing of has the
/// noise of the first one.
pub fn noise_of(fitted: &Fitted) -> Noise {
    let case = fitted.case;
    let groups: Vec<usize> = case.layout.parts.iter().map(|part| part.group).collect();
    let count = groups.iter().copied().max().map_or(1, |g| g + 1);
    let mut noise = Noise { filters: vec![Vec::new(); count], joint: vec![Vec::new(); count], groups };
    let own: Vec<Vec<(usize, Products)>> = (0..fitted.segments.len()).into_par_iter().map(|at| products(fitted, at)).collect();
    for group in 0..count {
        noise.filters[group] =
            (0..case.outputs.len()).map(|output| filter_of(fitted, members(&noise, fitted, &own, group), output)).collect();
    }
    let sets = together(case, fitted.segments);
    let sums: Vec<Vec<Lagged>> = (0..fitted.segments.len()).into_par_iter().map(|at| lagged(&noise, fitted, at, &sets)).collect();
    for group in 0..count {
        for (k, set) in sets.iter().enumerate() {
            let mut all = Lagged::zero(set.len());
            members(&noise, fitted, &sums, group).for_each(|sums| all.add(&sums[k]));
            noise.joint[group].extend(Joint::new(set.clone(), all));
        }
    }
    let known = |g: &usize| fitted.segments.iter().any(|&s| noise.groups[s] == *g);
    let (first, unknown) = ((0..count).find(known), (0..count).filter(|g| !known(g)).collect::<Vec<_>>());
    for (first, group) in unknown.into_iter().filter_map(|g| Some((first?, g))) {
        noise.filters[group] = noise.filters[first].clone();
        noise.joint[group] = noise.joint[first].clone();
    }
    noise
}

/// Those of `of` (one per segment of the fit) that belong to a group.
fn members<'t, T>(noise: &'t Noise, fitted: &'t Fitted, of: &'t [T], group: usize) -> impl Iterator<Item = &'t T> {
    fitted.segments.iter().zip(of).filter(move |(s, _)| noise.groups[**s] == group).map(|(_, t)| t)
}

/// Products of one segment's white series, for every set of outputs that are sampled together.
fn lagged(noise: &Noise, fitted: &Fitted, at: usize, sets: &[Vec<usize>]) -> Vec<Lagged> {
    let s = fitted.segments[at];
    let mut series = fitted.series(at);
    for one in &mut series {
        match noise.filter(s, one.output) {
            Some(filter) => one.columns.iter_mut().for_each(|column| filter.whiten(column, &one.masked)),
            None => one.columns.clear(),
        }
    }
    let of = |set: &Vec<usize>| {
        let find = |&o: &usize| series.iter().find(|one| one.output == o && !one.columns.is_empty());
        let all: Option<Vec<&Series>> = set.iter().map(find).collect();
        let all = all.filter(|all| all.iter().all(|one| one.masked.len() == all[0].masked.len()));
        let mut sums = Lagged::zero(set.len());
        let Some(all) = all else { return sums };
        sums.count = all[0].masked.len();
        for column in 0..all[0].columns.len() {
            sums.take(&all.iter().map(|one| &one.columns[column][..]).collect::<Vec<_>>());
        }
        sums
    };
    sets.iter().map(of).collect()
}

/// Products of every output's series in one segment.
fn products(fitted: &Fitted, at: usize) -> Vec<(usize, Products)> {
    let one = |series: Series| {
        let mut products = Products::new(fitted.rule.highest);
        products.take_all(&series.columns);
        (series.output, products)
    };
    fitted.series(at).into_iter().map(one).collect()
}

/// The filter of one output's noise from the products of its segments; none where nothing was measured.
fn filter_of<'t>(fitted: &Fitted, segments: impl Iterator<Item = &'t Vec<(usize, Products)>>, output: usize) -> Option<Filter> {
    let mut all = Products::new(fitted.rule.highest);
    segments.flatten().filter(|one| one.0 == output).for_each(|one| all.add(&one.1));
    Some(Filter::new(&burg::fit(&all, fitted.rule.criterion).model)).filter(Filter::is_definite)
}
