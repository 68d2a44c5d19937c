//! The diagnosis' speed: ten made-up maneuvers of 1000 samples of seven outputs, flown with a late
//! elevator, and 48 candidates in; seconds for the whole diagnosis and for one round of it
//! (screening, 500 surrogate campaigns, refits, held-out maneuvers) out.
//! `cargo bench --bench diagnose`.
//!
//! Held against: at most 60 s on two cores for one round.

use koehler::diagnose::{self, Subject, effect};
use koehler::dynamics::{Channel, Directions, Interpolation, Propagator, Record};
use koehler::estimate::{self, Segment};
use koehler::model::{Constants, Model};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use std::time::Instant;

const DT: f64 = 0.02;
const POINTS: usize = 1000;
const CANDIDATES: usize = 48;
/// What the elevator is late by, in points.
const LATE: usize = 3;
/// Noise of V, alpha, theta, q, qdot, ax, az.
const NOISE: [f64; 7] = [0.1, 1e-3, 1e-3, 1e-3, 5e-3, 0.02, 0.05];

fn main() {
    let text = include_str!("../pipelines/hfb320/hfb320.model.toml");
    let model = Model::parse("hfb320", text, &Constants::default()).expect("a model");
    let segments: Vec<Segment> = (0..10).map(|i| maneuver(&model, i)).collect();
    let method = estimate::Settings {
        initial: ["V", "alpha", "theta", "q"].map(String::from).to_vec(),
        ..Default::default()
    };
    let settings = diagnose::Settings::default();
    let names: Vec<String> = (0..segments.len()).map(|i| format!("m{i}")).collect();
    let held_out = diagnose::held_out(&segments, &names, &settings).held_out;
    let library = effect::load(&[]).expect("the library");
    let context =
        effect::Context::of(&model, &segments.iter().map(|s| &s.record).collect::<Vec<_>>());
    let offer = |model: &Model, wanted: &effect::Wanted| {
        let mut candidates = effect::candidates(model, &context, &library).candidates;
        candidates.truncate(CANDIDATES);
        candidates.retain(|candidate| wanted(&candidate.effect));
        Ok((candidates, Vec::new()))
    };
    let subject = Subject {
        model: &model,
        segments: &segments,
        held_out: &held_out,
        method: &method,
        context: &context,
        settings: &settings,
    };
    let threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
    let clock = Instant::now();
    let found = threads
        .install(|| diagnose::diagnose(&subject, &offer, &|_| {}))
        .expect("settings that fit");
    let seconds = clock.elapsed().as_secs_f64();
    let rounds = found.rounds.len().max(1);
    let (count, round) =
        (found.rounds.first().map_or(0, |r| r.judged.len()), seconds / rounds as f64);
    let named: Vec<&str> = found.added.iter().map(|c| c.name.as_str()).collect();
    println!(
        "{count} candidates, 10 x {POINTS} samples x 7 outputs, two threads: {seconds:.1} s for {rounds} rounds, {round:.1} s each (60 wanted)"
    );
    println!("verdict: {} {named:?}", found.verdict.as_str());
}

/// A 3211 of the elevator and a step of thrust about a flight that is nearly trimmed.
fn maneuver(model: &Model, i: usize) -> Segment {
    let mut random = Pcg64::new(u128::from(7_u64), u128::try_from(i).unwrap_or_default());
    let sign = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
    let elevator = |k: usize| {
        let t = k as f64 * DT - 2.0;
        let step = [1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0];
        let now = if t < 0.0 { 0.0 } else { step.get((t / 0.7) as usize).copied().unwrap_or(0.0) };
        -0.007 + 0.01 * sign * now
    };
    let thrust = |k: usize| if k > 500 { 1600.0 + 40.0 * i as f64 } else { 1500.0 };
    let inputs = |late: usize| {
        (0..POINTS)
            .flat_map(|k| [elevator(k.saturating_sub(late)), thrust(k)])
            .collect::<Vec<f64>>()
    };
    let t: Vec<f64> = (0..POINTS).map(|k| k as f64 * DT).collect();
    let outputs = model.outputs.len();
    let channels: Vec<Channel> = (0..outputs)
        .map(|output| Channel { output, t: t.clone().into(), z: vec![f64::NAN; POINTS].into() })
        .collect();
    let mut record = Record {
        dt: DT,
        n: POINTS,
        inputs: inputs(LATE).into(),
        interpolation: vec![Interpolation::Cubic; 2],
        channels,
        substeps: 2,
        ..Record::default()
    };
    let propagator = Propagator::new(model, Directions::default()).expect("a propagator");
    let flown = propagator.respond(&model.parameter_starts(), &[], &record, false);
    for (channel, y) in record.channels.iter_mut().zip(flown.y) {
        let sd = NOISE[channel.output.min(NOISE.len() - 1)];
        let noise = || -> f64 { StandardNormal.sample(&mut random) };
        let drawn: Vec<f64> = std::iter::repeat_with(noise).take(POINTS).collect();
        channel.z = y.iter().zip(drawn).map(|(y, n)| y + sd * n).collect();
    }
    let record = Record { inputs: inputs(0).into(), substeps: 0, ..record };
    Segment {
        record,
        labels: [("input".to_string(), "elevator".to_string())].into(),
        ..Segment::default()
    }
}
