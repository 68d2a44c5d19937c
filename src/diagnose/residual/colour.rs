//! A fit, as the noise sees it, in; the colour of its residuals, output by output and of outputs
//! together, out.

use super::absorbed::{Fitted, Series};
use super::instants::{Set, together};
use super::joint::Joint;
use super::lagged::Lagged;
use super::partly::runs;
use super::whitening::Noise;
use crate::diagnose::thresholds::Thresholds;
use crate::noise::{Filter, Modelled, Products, burg};
use rayon::prelude::*;
use std::ops::Range;

/// Of the residuals of a fit, with what it absorbed (as far as `fitted` knows) put back. An output
/// of which the fit has nothing in a group has the filter of the first group in which it has, and a
/// group of which it has nothing the joint models of the first one.
pub fn noise_of(fitted: &Fitted, thresholds: &Thresholds) -> Noise {
    let order = thresholds.joint_order;
    let case = fitted.at.case;
    let groups: Vec<usize> = case.layout.parts.iter().map(|part| part.group).collect();
    let count = groups.iter().copied().max().map_or(1, |g| g + 1);
    let mut noise = Noise {
        filters: vec![Vec::new(); count],
        joint: vec![Vec::new(); count],
        groups,
        cut: Vec::new(),
    };
    let own: Vec<Vec<(usize, Products)>> =
        (0..fitted.segments.len()).into_par_iter().map(|at| products(fitted, at)).collect();
    for group in 0..count {
        for output in 0..case.outputs.len() {
            let of = modelled(fitted, members(&noise, fitted, &own, group), output);
            noise.cut.extend(of.cut.map(|order| (output, order)));
            let filter = Some(Filter::new(&of.model)).filter(Filter::is_definite);
            noise.filters[group].push(filter);
        }
    }
    let sets: Vec<Vec<Set>> = (0..count).map(|group| sets(&noise, fitted, group)).collect();
    let sums =
        |at: usize| lagged(&noise, (fitted, at), &sets[noise.groups[fitted.segments[at]]], order);
    let sums: Vec<Vec<Lagged>> = (0..fitted.segments.len()).into_par_iter().map(sums).collect();
    for group in 0..count {
        for (k, set) in sets[group].iter().enumerate() {
            let mut all = Lagged::zero(set.outputs.len(), order);
            members(&noise, fitted, &sums, group).for_each(|sums| all.add(&sums[k]));
            noise.joint[group].extend(Joint::new(set.clone(), all, thresholds));
        }
    }
    fall_back(&mut noise.filters);
    let known = |g: &usize| fitted.segments.iter().any(|&s| noise.groups[s] == *g);
    let (first, unknown) =
        ((0..count).find(known), (0..count).filter(|g| !known(g)).collect::<Vec<_>>());
    for (first, group) in unknown.into_iter().filter_map(|g| Some((first?, g))) {
        noise.joint[group] = noise.joint[first].clone();
    }
    noise
}

/// Gives every output that has no filter in a group that of the first group in which it has one.
/// `[group][output]`.
fn fall_back(filters: &mut [Vec<Option<Filter>>]) {
    for output in 0..filters.first().map_or(0, Vec::len) {
        let first = filters.iter().find_map(|of| of[output].clone());
        filters
            .iter_mut()
            .filter(|of| of[output].is_none())
            .for_each(|of| of[output].clone_from(&first));
    }
}

/// Outputs whose noise a group knows, by how they are sampled in its segments.
fn sets(noise: &Noise, fitted: &Fitted, group: usize) -> Vec<Set> {
    let segments: Vec<usize> = members(noise, fitted, fitted.segments, group).copied().collect();
    let outputs: Vec<usize> =
        (0..fitted.at.case.outputs.len()).filter(|&o| noise.filters[group][o].is_some()).collect();
    together(fitted.at.case, &segments, &outputs)
}

/// Those of `of` (one per segment of the fit) that belong to a group.
fn members<'t, T>(
    noise: &'t Noise,
    fitted: &'t Fitted,
    of: &'t [T],
    group: usize,
) -> impl Iterator<Item = &'t T> {
    fitted.segments.iter().zip(of).filter(move |(s, _)| noise.groups[**s] == group).map(|(_, t)| t)
}

/// Products of one segment's white series, for every set of outputs that are sampled together, over
/// instants at which all of it were measured.
fn lagged(
    noise: &Noise,
    (fitted, at): (&Fitted, usize),
    sets: &[Set],
    order: usize,
) -> Vec<Lagged> {
    let s = fitted.segments[at];
    let mut series = fitted.series(at);
    for one in &mut series {
        match noise.filter(s, one.output) {
            Some(filter) => {
                filter.whiten_all(one.columns.iter_mut().map(|x| &mut x[..]), &one.masked)
            }
            None => one.columns.clear(),
        }
    }
    let of = |set: &Set| {
        let mut sums = Lagged::zero(set.outputs.len(), order);
        let find =
            |&o: &usize| series.iter().find(|one| one.output == o && !one.columns.is_empty());
        let all: Option<Vec<&Series>> = set.outputs.iter().map(find).collect();
        let Some(all) = all.filter(|_| set.segments.binary_search(&s).is_ok()) else { return sums };
        let there = |k: usize| all.iter().all(|one| !one.masked.get(k).copied().unwrap_or(true));
        let runs = runs(&(0..all[0].masked.len()).map(there).collect::<Vec<_>>());
        sums.count = runs.iter().map(Range::len).sum();
        for column in 0..all[0].columns.len() {
            sums.take(&all.iter().map(|one| &one.columns[column][..]).collect::<Vec<_>>(), &runs);
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

/// The model of one output's noise from the products of its segments; of variance 0 where nothing
/// was measured.
fn modelled<'t>(
    fitted: &Fitted,
    segments: impl Iterator<Item = &'t Vec<(usize, Products)>>,
    output: usize,
) -> Modelled {
    let mut all = Products::new(fitted.rule.highest);
    segments.flatten().filter(|one| one.0 == output).for_each(|one| all.add(&one.1));
    burg::fit(&all, fitted.rule.criterion)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::residual::evaluation::Evaluation;
    use crate::dynamics::{Channel, Record};
    use crate::estimate::{Prepared, Segment, Settings};
    use crate::model::{Constants, Model};
    use crate::noise::Rule;
    use crate::simulate::Stream;

    const N: usize = 600;

    /// Outputs 0 and 1 share most of their noise, 2 has its own. What is measured is said per
    /// segment, with how many samples lost from 1.
    fn segment(flight: &str, seed: u64, outputs: &[usize], lost: usize) -> Segment {
        let mut stream = Stream::new(seed, &["colour"]);
        let shared: Vec<f64> = (0..N).map(|_| stream.normal()).collect();
        let mut channel = |output: usize| {
            let share = if output == 2 { 0.0 } else { 0.95 };
            let mut z: Vec<f64> = shared
                .iter()
                .map(|x| share * x + (1.0f64 - share * share).sqrt() * stream.normal())
                .collect();
            let mut t: Vec<f64> = (0..N).map(|k| 0.02 * k as f64).collect();
            let lost = if output == 1 { lost } else { 0 };
            t.drain(100..100 + lost);
            z.drain(100..100 + lost);
            Channel { output, t: t.into(), z: z.into() }
        };
        let channels = outputs.iter().map(|&o| channel(o)).collect();
        let record = Record {
            dt: 0.02,
            n: N,
            inputs: vec![0.0; N].into(),
            channels,
            substeps: 1,
            ..Record::default()
        };
        Segment {
            record,
            labels: [("flight".to_string(), flight.to_string())].into(),
            ..Segment::default()
        }
    }

    #[test]
    fn a_lost_sample_costs_one_maneuver_and_a_held_out_output_borrows_its_noise() {
        let text = r#"title = "still"
[inputs]
u = "rad"
[parameters]
k = { unit = "1", start = 1.0 }
[states]
x = { unit = "rad", rate = "(k*u - x)/s", start = 0.0 }
[constants]
s = { unit = "s", value = 1.0 }
[outputs]
a = { unit = "rad", value = "x" }
b = { unit = "rad", value = "x" }
c = { unit = "rad", value = "x" }
"#;
        let model =
            Model::parse("still", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
        let all = [0, 1, 2];
        let segments = [
            segment("one", 1, &all, 1),
            segment("one", 2, &all, 0),
            segment("one", 3, &all, 0),
            segment("two", 4, &[0, 1], 0),
            segment("two", 5, &all, 0),
        ];
        let settings = Settings { noise_per: "flight".into(), ..Settings::default() };
        let prepared =
            Prepared::new(&model, &segments, &settings).unwrap_or_else(|e| panic!("{e}"));
        let case = prepared.case();
        let theta = case.layout.start.clone();
        // The last one is held out.
        let at = Evaluation::new(&case, &theta, &[0, 1, 2, 3]);
        let noise = noise_of(
            &Fitted::new(&at, &[0, 1, 2, 3], &[0], &[], Rule::default()),
            &Thresholds::default(),
        );
        let told = |group: usize| -> Vec<(&[usize], &[usize])> {
            noise.joint[group]
                .iter()
                .map(|joint| (&joint.set.outputs[..], &joint.set.segments[..]))
                .collect()
        };
        assert_eq!(told(0), [(&all[..], &[1, 2, 3, 4][..])]);
        assert_eq!(told(1), [(&all[..2], &[1, 2, 3, 4][..])]);
        assert!(noise.filter(4, 2).is_some() && noise.filter(4, 2) == noise.filter(1, 2));
        let cost = |s: usize| {
            2.0 * noise
                .cost(s, &case.evaluate(s, &case.layout.local(s, &theta), false).expect("finite"))
        };
        let samples = (3 * N) as f64;
        // The sd of a mean square of so many is 0.033.
        assert!(
            (1..5).filter(|s| *s != 3).all(|s| (cost(s) / samples - 1.0).abs() < 0.15),
            "{} {}",
            cost(1),
            cost(4)
        );
    }

    #[test]
    fn an_output_without_noise_of_its_own_has_that_of_another_group() {
        let filter = |variance: f64| Some(Filter::new(&crate::noise::Ar::white(variance)));
        let mut filters = vec![
            vec![filter(1.0), None, None],
            vec![None, filter(2.0), None],
            vec![None, filter(3.0), None],
        ];
        fall_back(&mut filters);
        let want = |second| vec![filter(1.0), filter(second), None];
        assert_eq!(filters, [want(2.0), want(2.0), want(3.0)]);
    }
}
