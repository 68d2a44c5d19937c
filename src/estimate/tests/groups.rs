//! Parameters per group of segments, noise per group, and segments that cannot take part.

use super::{normal, rng};
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{
    Estimation, Label, Line, NoiseKind, Row, Segment, Settings, StepControl, Stop, Stretch,
    estimate_segments,
};
use crate::model::{Constants, Model};

const TEXT: &str = r#"
title = "First-order lag with a gain per flap setting and a shift per flight"

[inputs]
u = "rad"

[parameters]
T = { unit = "s", start = 0.5, min = 0.05 }
K = { unit = "-", start = 1.0, per = "flap" }
y_0 = { unit = "rad", start = 0.0, per = "flight" }
x_0 = { unit = "rad", start = 0.0, per = "segment" }

[states]
x = { unit = "rad", rate = "(K*u - x)/T", start = "x_0" }

[outputs]
x = { unit = "rad", value = "x" }
y = { unit = "rad", value = "2*x + y_0" }
"#;

pub fn model() -> Model {
    Model::parse("lag", TEXT, &Constants::default()).unwrap()
}

fn label(s: usize) -> (&'static str, &'static str, f64, f64) {
    [("0", "f1", 1.2, 0.1), ("15", "f1", 1.5, 0.1), ("0", "f2", 1.2, -0.2), ("15", "f2", 1.5, -0.2)]
        [s % 4]
}

/// Truth: T 0.3, K 1.2 and 1.5 by flap, y_0 0.1 and -0.2 by flight, x_0 0.01 s; `sd` is the noise
/// of `x` and `y` in a segment.
pub fn segments(
    model: &Model,
    seed: u64,
    n: usize,
    sd: impl Fn(usize) -> [f64; 2],
) -> Vec<Segment> {
    let mut rng = rng(seed);
    let propagator = Propagator::new(model, Directions::default()).unwrap();
    (0..n)
        .map(|s| {
            let (flap, flight, gain, shift) = label(s);
            let samples = 300;
            let channel = |output: usize, dt: f64, n: usize| {
                let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
                Channel { output, z: vec![f64::NAN; n].into(), t: t.into() }
            };
            let inputs = (0..samples).map(|k| [0.0, 1.0, -1.0, 0.0][(k / 60).min(3)]).collect();
            // `y` at half the rate of `x`, on its stamps
            let channels = vec![channel(0, 0.02, samples), channel(1, 0.04, samples / 2)];
            let mut record =
                Record { dt: 0.02, n: samples, inputs, channels, substeps: 1, ..Record::default() };
            let response =
                propagator.respond(&[0.3, gain, shift, 0.01 * s as f64], &[], &record, false);
            for (k, (channel, y)) in record.channels.iter_mut().zip(response.y).enumerate() {
                channel.z = y.iter().map(|y| y + sd(s)[k] * normal(&mut rng)).collect();
            }
            let labels = [("flap", flap), ("flight", flight)]
                .map(|(a, b)| (a.to_string(), b.to_string()))
                .into();
            Segment { record, labels, ..Segment::default() }
        })
        .collect()
}

fn find<'a>(e: &'a Estimation, name: &str, of: &str) -> &'a Row {
    let is = |r: &&Row| r.name == name && r.group.as_ref().map_or(of.is_empty(), |g| g.value == of);
    e.rows.iter().find(is).unwrap()
}

fn within(row: &Row, truth: f64) {
    assert!(
        (row.value - truth).abs() < 4.0 * row.sd.unwrap() && row.sd.unwrap() < 0.03,
        "{row:?}, truth {truth}"
    );
}

#[test]
fn recovery_of_one_value_per_group() {
    let model = model();
    let e = estimate_segments(&model, &segments(&model, 1, 4, |_| [0.01; 2]), &Settings::default())
        .unwrap();
    assert_eq!(e.stop, Stop::Converged);
    let names: Vec<String> = e
        .rows
        .iter()
        .map(|r| r.group.as_ref().map_or(r.name.clone(), |g| format!("{} of {g}", r.name)))
        .collect();
    assert_eq!(
        names[..5],
        ["T", "K of flap 0", "K of flap 15", "y_0 of flight f1", "y_0 of flight f2"]
    );
    assert_eq!((names.len(), e.left_out.len()), (9, 0));
    within(find(&e, "T", ""), 0.3);
    within(find(&e, "K", "0"), 1.2);
    within(find(&e, "K", "15"), 1.5);
    within(find(&e, "y_0", "f1"), 0.1);
    within(find(&e, "y_0", "f2"), -0.2);
    // Pairs: 10 of the border; each segment's one with the three of the border that it sees.
    assert_eq!(e.correlations.len(), 10 + 4 * 3);
}

/// A shift of all flights and one of each: of a constant added to all of the latter nothing is seen. Held
/// in one flight they are differences from it.
#[test]
fn recovery_of_differences_from_one_group() {
    let with = |held: &str| {
        let text = TEXT.replace(
            "y_0 = { unit = \"rad\", start = 0.0, per = \"flight\" }",
            &format!(
                "y_0 = {{ unit = \"rad\", start = 0.0, per = \"flight\"{held} }}\ny_1 = {{ unit = \"rad\", start = 0.0 }}"
            ),
        );
        let wide =
            Model::parse("lag", &text.replace("+ y_0", "+ y_0 + y_1"), &Constants::default());
        let all = segments(&model(), 1, 4, |_| [0.01; 2]);
        estimate_segments(&wide.unwrap(), &all, &Settings::default()).unwrap()
    };
    assert!(!with("").verdict.combinations.is_empty());
    let e = with(", held_in = \"f1\"");
    assert_eq!(e.stop, Stop::Converged);
    assert!(e.verdict.combinations.is_empty(), "{:?}", e.verdict);
    within(find(&e, "y_1", ""), 0.1);
    within(find(&e, "y_0", "f2"), -0.3);
    let held = find(&e, "y_0", "f1");
    assert_eq!((held.value, held.sd, held.at_bound), (0.0, None, false));
}

/// The same problem with every group parameter written as a separate campaign parameter would be
/// two problems where flaps and flights do not mix: groups of segments that share nothing must not
/// see each other.
#[test]
fn groups_that_share_nothing_are_separate_estimates() {
    let model = model();
    let all = segments(&model, 2, 4, |_| [0.01; 2]);
    let per = ["T", "K", "y_0"].map(|p| (p.to_string(), "flight".to_string()));
    let settings = Settings {
        per: per.into(),
        noise_per: "flight".into(),
        tolerance: 1e-12,
        step_tolerance: 1e-7,
        ..Settings::default()
    };
    let joint = estimate_segments(&model, &all, &settings).unwrap();
    for (value, two) in [("f1", &all[..2]), ("f2", &all[2..])] {
        let alone = estimate_segments(&model, two, &settings).unwrap();
        assert_eq!((joint.stop, alone.stop), (Stop::Converged, Stop::Converged));
        for name in ["T", "K", "y_0"] {
            let (a, b) = (find(&joint, name, value), find(&alone, name, value));
            assert!((a.value - b.value).abs() < 1e-6 * b.sd.unwrap(), "{a:?} {b:?}");
            assert!((a.sd.unwrap() / b.sd.unwrap() - 1.0).abs() < 1e-4, "{a:?} {b:?}");
        }
    }
}

/// A gain that follows a condition: its value at the centre and its slope are found, and what a
/// maneuver needs is not known.
#[test]
fn recovery_of_a_line_in_a_condition() {
    let model = model();
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let mut all = segments(&model, 21, 6, |_| [0.01; 2]);
    let mut rng = rng(22);
    for (s, segment) in all.iter_mut().enumerate() {
        let speed = 60.0 + 11.0 * s as f64;
        let shift = label(s).3;
        let y = propagator
            .respond(
                &[0.3, 0.5 + 0.02 * speed, shift, 0.01 * s as f64],
                &[],
                &segment.record,
                false,
            )
            .y;
        for (channel, y) in segment.record.channels.iter_mut().zip(y) {
            channel.z = y.iter().map(|y| y + 0.01 * normal(&mut rng)).collect();
        }
        segment.conditions.insert("V".into(), speed);
    }
    let line = Line { against: "V".into(), unit: "m/s".into(), centre: 80.0 };
    let settings = Settings {
        lines: [("K".to_string(), line)].into(),
        per: [("K".to_string(), "campaign".to_string())].into(),
        ..Settings::default()
    };
    let e = estimate_segments(&model, &all, &settings).unwrap();
    assert_eq!((e.stop, e.left_out.len()), (Stop::Converged, 0));
    within(find(&e, "K", ""), 2.1);
    let slope = find(&e, "K per V", "");
    assert_eq!(slope.unit, "1/(m/s)");
    assert!(
        (slope.value - 0.02).abs() < 4.0 * slope.sd.unwrap() && slope.sd.unwrap() < 1e-3,
        "{slope:?}"
    );
    // Stretches of records have the same line.
    let piece = |(s, segment): (usize, &Segment)| -> Vec<Segment> {
        let edges = [f64::NEG_INFINITY, 2.5, f64::INFINITY];
        let stretch =
            |i: usize| Stretch { of: format!("record {s}"), from: edges[i], to: edges[i + 1] };
        (0..2).map(|i| Segment { stretch: Some(stretch(i)), ..segment.clone() }).collect()
    };
    let cut: Vec<Segment> = all.iter().enumerate().flat_map(piece).collect();
    let same = estimate_segments(&model, &cut, &settings).unwrap();
    assert!((find(&same, "K per V", "").value - slope.value).abs() < 1e-3 * slope.sd.unwrap());
    all[2].conditions.clear();
    let e = estimate_segments(&model, &all, &settings).unwrap();
    assert!(
        e.left_out[0].segment == 2 && e.left_out[0].why.contains("\"V\" is not known"),
        "{:?}",
        e.left_out
    );
}

/// Stretches of a record have its start and its own parameters in common: all of them together say
/// what the record says.
#[test]
fn stretches_of_a_record_are_the_record() {
    let model = model();
    let whole = segments(&model, 5, 4, |_| [0.01; 2]);
    let pieces = |(s, segment): (usize, &Segment)| -> Vec<Segment> {
        let edges = [f64::NEG_INFINITY, 1.5, 3.1, f64::INFINITY];
        let stretch =
            |i: usize| Stretch { of: format!("record {s}"), from: edges[i], to: edges[i + 1] };
        (0..3).map(|i| Segment { stretch: Some(stretch(i)), ..segment.clone() }).collect()
    };
    let cut: Vec<Segment> = whole.iter().enumerate().flat_map(pieces).collect();
    for noise in [NoiseKind::Diagonal, NoiseKind::Full] {
        let settings =
            Settings { noise, tolerance: 1e-12, step_tolerance: 1e-7, ..Settings::default() };
        let (whole, cut) = (
            estimate_segments(&model, &whole, &settings).unwrap(),
            estimate_segments(&model, &cut, &settings).unwrap(),
        );
        assert_eq!(
            (whole.stop, cut.stop, cut.left_out.len()),
            (Stop::Converged, Stop::Converged, 0)
        );
        assert_eq!(cut.rows.len(), whole.rows.len());
        for a in &whole.rows {
            let of = |b: &&Row| match a.segment {
                Some(s) => {
                    b.name == a.name
                        && b.group.as_ref().is_some_and(|g| g.value == format!("record {s}"))
                }
                None => b.name == a.name && b.group == a.group,
            };
            let b = cut.rows.iter().find(of).unwrap();
            assert!((a.value - b.value).abs() < 1e-5 * a.sd_crlb.unwrap(), "{a:?} {b:?}");
            assert!((a.sd_crlb.unwrap() / b.sd_crlb.unwrap() - 1.0).abs() < 1e-4, "{a:?} {b:?}");
        }
    }
}

/// Segments of another rate, another length, and with only one of the outputs.
#[test]
fn recovery_from_segments_of_unequal_rate_length_and_outputs() {
    let model = model();
    let propagator = Propagator::new(&model, Directions::default()).unwrap();
    let mut all = segments(&model, 13, 4, |_| [0.01; 2]);
    let mut rng = rng(14);
    for (s, dt, n, output) in [(1, 0.05, 90, 0), (2, 0.01, 450, 1)] {
        let (flap, flight, gain, shift) = label(s);
        let inputs = (0..n).map(|k| [0.0, 1.0, -1.0, 0.0][(k * 3 / n).min(3)]).collect();
        let channel =
            Channel { output, t: (0..n).map(|k| k as f64 * dt).collect(), z: vec![].into() };
        let mut record =
            Record { dt, n, inputs, channels: vec![channel], substeps: 1, ..Record::default() };
        let y = propagator.respond(&[0.3, gain, shift, 0.0], &[], &record, false).y;
        record.channels[0].z = y[0].iter().map(|y| y + 0.01 * normal(&mut rng)).collect();
        let labels = [("flap", flap), ("flight", flight)]
            .map(|(a, b)| (a.to_string(), b.to_string()))
            .into();
        all[s] = Segment { record, labels, ..Segment::default() };
    }
    for noise in [NoiseKind::Diagonal, NoiseKind::Full] {
        for noise_per in ["campaign", "segment"] {
            let settings = Settings { noise, noise_per: noise_per.into(), ..Settings::default() };
            let e = estimate_segments(&model, &all, &settings).unwrap();
            assert_eq!((e.stop, e.left_out.len()), (Stop::Converged, 0));
            within(find(&e, "T", ""), 0.3);
            within(find(&e, "K", "0"), 1.2);
            within(find(&e, "K", "15"), 1.5);
            within(find(&e, "y_0", "f1"), 0.1);
            assert!(
                e.outputs.iter().all(|o| o.count == 0 || (o.r.sqrt() - 0.01).abs() < 0.002),
                "{:?}",
                e.outputs
            );
            let x = e.scatter(1, "x").unwrap();
            assert_eq!(x.count, if noise_per == "segment" { 90 } else { 690 });
        }
    }
}

#[test]
fn noise_per_flight_weighs_the_calm_one_more() {
    let model = model();
    let all = segments(&model, 3, 4, |s| if s < 2 { [0.01, 0.02] } else { [0.1, 0.05] });
    let settings = Settings { noise_per: "flight".into(), ..Settings::default() };
    let split = estimate_segments(&model, &all, &settings).unwrap();
    let mixed = estimate_segments(&model, &all, &Settings::default()).unwrap();
    assert_eq!((split.stop, mixed.stop), (Stop::Converged, Stop::Converged));
    let sd: Vec<f64> = split.outputs.iter().map(|o| o.r.sqrt()).collect();
    let truth = [0.01, 0.02, 0.1, 0.05];
    assert!(sd.iter().zip(truth).all(|(a, b)| (a / b - 1.0).abs() < 0.1), "{sd:?}");
    assert_eq!(split.noise_groups, [Some(0), Some(0), Some(1), Some(1)]);
    let geometric = (split.outputs[0].r * split.outputs[1].r).sqrt()
        * (split.outputs[2].r * split.outputs[3].r).sqrt();
    assert!((split.det_r / geometric - 1.0).abs() < 1e-9);
    within(find(&split, "T", ""), 0.3);
    assert!(find(&split, "T", "").sd.unwrap() < 0.5 * find(&mixed, "T", "").sd.unwrap());
}

#[test]
fn a_floor_keeps_an_output_from_being_trusted_more() {
    let model = model();
    let all = segments(&model, 4, 2, |_| [1e-4, 0.01]);
    let settings = Settings { floor: [("x".to_string(), 0.01)].into(), ..Settings::default() };
    for noise in [NoiseKind::Diagonal, NoiseKind::Full] {
        let e = estimate_segments(&model, &all, &Settings { noise, ..settings.clone() }).unwrap();
        assert_eq!(e.stop, Stop::Converged);
        assert!((1e-4..1.001e-4).contains(&e.outputs[0].r), "{}", e.outputs[0].r);
    }
}

#[test]
fn both_ways_of_stepping_end_at_the_same_point() {
    let model = model();
    let all = segments(&model, 5, 4, |_| [0.01; 2]);
    let tight = Settings { tolerance: 1e-12, step_tolerance: 1e-7, ..Settings::default() };
    for starts in [vec![], vec![("T".to_string(), 5.0)]] {
        let tight = Settings { starts: starts.into_iter().collect(), ..tight.clone() };
        let damped = Settings { step_control: StepControl::LevenbergMarquardt, ..tight.clone() };
        let (a, b) = (
            estimate_segments(&model, &all, &tight).unwrap(),
            estimate_segments(&model, &all, &damped).unwrap(),
        );
        assert_eq!((a.stop, b.stop), (Stop::Converged, Stop::Converged));
        for (a, b) in a.rows.iter().zip(&b.rows) {
            assert!((a.value - b.value).abs() < 1e-6 * a.sd.unwrap(), "{a:?} {b:?}");
        }
        assert!(b.iterations[1].damping > 0.0 && a.iterations[1].damping == 0.0);
        let last = b.iterations.last().unwrap();
        assert!(last.gradient < 1e-3 && last.change < 1e-12 && last.step < 1e-6, "{last:?}");
    }
}

#[test]
fn the_same_bytes_for_any_number_of_threads_and_groups() {
    let model = model();
    let all = segments(&model, 6, 6, |_| [0.01; 2]);
    let settings =
        Settings { noise: NoiseKind::Full, noise_per: "flight".into(), ..Settings::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        format!("{:?}", pool.install(|| estimate_segments(&model, &all, &settings)).unwrap())
    };
    assert_eq!(run(1), run(3));
}

/// A full covariance over 600 segments of a group each.
#[test]
fn many_groups_stay_small() {
    let model = model();
    let all = segments(&model, 7, 600, |_| [0.01; 2]);
    let settings =
        Settings { noise_per: "segment".into(), max_iterations: 2, ..Settings::default() };
    let e = estimate_segments(&model, &all, &settings).unwrap();
    assert_eq!((e.outputs.len(), e.rows.len()), (1200, 605));
}

fn why(e: &Estimation) -> Vec<(usize, &str)> {
    e.left_out.iter().map(|l| (l.segment, l.why.as_str())).collect()
}

#[test]
fn fault_a_segment_without_samples_or_label_is_left_out_by_name() {
    let model = model();
    let mut all = segments(&model, 8, 6, |_| [0.01; 2]);
    all[1].record.channels.iter_mut().for_each(|c| c.z.fill(f64::NAN));
    all[4].labels.shift_remove("flap");
    let e = estimate_segments(&model, &all, &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    assert_eq!(
        why(&e),
        [
            (1, "it has no measured sample that is not masked"),
            (4, "it has no \"flap\", by which parameters differ")
        ]
    );
    let own: Vec<usize> = e.rows.iter().filter_map(|r| r.segment).collect();
    assert_eq!(own, [0, 2, 3, 5]);
    assert!(e.responses[1].is_empty() && e.responses[4].is_empty() && e.responses[5].len() == 2);
    assert_eq!(e.noise_groups[4], None);
    within(find(&e, "K", "15"), 1.5);
}

#[test]
fn fault_a_segment_that_is_not_finite_at_the_start_is_left_out_by_name() {
    let model = model();
    let mut all = segments(&model, 9, 4, |_| [0.01; 2]);
    all[2].record.inputs[50] = 1e300;
    all[3].record.inputs[50] = f64::NAN;
    let e = estimate_segments(&model, &all, &Settings::default()).unwrap();
    assert_eq!(e.stop, Stop::Converged);
    let why_not = [
        (
            2,
            "the model is not finite there at the start values (other ones, or `start = \"equation error\"`?)",
        ),
        (3, "input u has no value at 1 of its samples"),
    ];
    assert_eq!(why(&e), why_not);
    within(find(&e, "y_0", "f1"), 0.1);
}

#[test]
fn fault_parameters_that_only_one_segment_cannot_determine_cost_that_segment() {
    let model = model();
    let mut all = segments(&model, 10, 4, |_| [0.01; 2]);
    all[3].record.channels[1].z.fill(f64::NAN);
    let settings = Settings {
        per: [("y_0".to_string(), "segment".to_string())].into(),
        ..Settings::default()
    };
    let e = estimate_segments(&model, &all, &settings).unwrap();
    assert_eq!(
        (e.stop, why(&e)),
        (Stop::Converged, vec![(3, "y_0 has no effect on the measured outputs")])
    );
    // Where no segment determines it, it is the estimation that ends, and nothing is left out.
    all.iter_mut().for_each(|s| s.record.channels[1].z.fill(f64::NAN));
    let e = estimate_segments(&model, &all, &settings).unwrap();
    assert_eq!((e.stop, e.left_out.len()), (Stop::Singular, 0));
    assert_eq!(
        e.verdict.combinations[0].to_string(),
        "y_0 of segment 0 has no effect on the measured outputs"
    );
}

#[test]
fn fault_a_group_without_its_output_costs_its_segments() {
    let model = model();
    let mut all = segments(&model, 11, 4, |_| [0.01; 2]);
    all[2..].iter_mut().for_each(|s| s.record.channels[1].z.fill(f64::NAN));
    let e = estimate_segments(&model, &all, &Settings::default()).unwrap();
    let no_effect = "y_0 has no effect on the measured outputs";
    assert_eq!((e.stop, why(&e)), (Stop::Converged, vec![(2, no_effect), (3, no_effect)]));
    within(find(&e, "T", ""), 0.3);
}

#[test]
fn fault_a_column_that_no_segment_has_is_a_mistake() {
    let model = model();
    let all = segments(&model, 12, 2, |_| [0.01; 2]);
    let settings = Settings {
        per: [("T".to_string(), "flapp".to_string())].into(),
        noise_per: "day".into(),
        ..Settings::default()
    };
    let text = estimate_segments(&model, &all, &settings).unwrap_err().to_string();
    assert!(
        text.contains("parameter \"T\" of model lag is per \"flapp\"")
            && text.contains("the noise is per \"day\""),
        "{text}"
    );
    assert!(text.contains("campaign, flap, flight, segment"), "{text}");
}

#[test]
fn labels_read_well() {
    assert_eq!(Label { column: "flap".into(), value: "15".into() }.to_string(), "flap 15");
}
