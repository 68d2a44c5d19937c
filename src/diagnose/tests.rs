//! Small simulated campaigns with a hidden effect, or none, and a handful of candidates.

use super::base::found::at_first;
use super::base::stand::Stand;
use super::effect::{self, Context};
use super::residual::sources::Sources;
use super::residual::{innovation, sums};
use super::*;
use crate::dynamics::{Channel, Directions, Propagator, Record};
use crate::estimate::{self, Segment};
use crate::model::{Constants, Model};
use crate::simulate::Stream;

/// Short period with what is hidden in the pitching motion and in the vane.
pub fn text(parameters: &str, pitch: &str, vane: &str) -> String {
    text_at(1.0, parameters, pitch, vane)
}

/// The same with all rates so many times as fast.
fn text_at(pace: f64, parameters: &str, pitch: &str, vane: &str) -> String {
    let (z_a, z_d) = (-0.9 * pace, -0.1 * pace);
    let (m_a, m_q, m_d) = (-4.0 * pace * pace, -1.5 * pace, -6.0 * pace * pace);
    format!(
        r#"title = "short period"
[inputs]
de = "rad"
V = "m/s"
[parameters]
Z_a = {{ unit = "1/s", start = {z_a:?} }}
Z_d = {{ unit = "1/s", start = {z_d:?} }}
M_a = {{ unit = "1/s^2", start = {m_a:?} }}
M_q = {{ unit = "1/s", start = {m_q:?} }}
M_d = {{ unit = "1/s^2", start = {m_d:?} }}
{parameters}
[equations]
ddt_alpha = "q + Z_a*alpha + Z_d*de"
ddt_q = "M_a*alpha + M_q*q + M_d*de {pitch}"
[states]
alpha = {{ unit = "rad", rate = "ddt_alpha", start = 0.0 }}
q = {{ unit = "rad/s", rate = "ddt_q", start = 0.0 }}
[outputs]
alpha = {{ unit = "rad", value = "{vane}" }}
q = {{ unit = "rad/s", value = "q" }}
nz = {{ unit = "1/s", value = "ddt_alpha - q" }}
"#
    )
}

pub fn parsed(text: &str) -> Model {
    Model::parse("short", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
}

pub fn model(parameters: &str, pitch: &str, vane: &str) -> Model {
    parsed(&text(parameters, pitch, vane))
}

/// A handful of the library.
pub const LIBRARY: [&str; 7] = [
    "downwash-lag",
    "control-square-longitudinal",
    "alpha-cubic",
    "static-longitudinal",
    "sensor-scale",
    "vane-lever-alpha",
    "control-rate-longitudinal",
];

/// A 3211 of the given unit and amplitude.
pub fn steps(t: f64, unit: f64, amplitude: f64) -> f64 {
    match (t - 1.0) / unit {
        x if x < 0.0 => 0.0,
        x if x < 3.0 => amplitude,
        x if x < 5.0 => -amplitude,
        x if x < 6.0 => amplitude,
        x if x < 7.0 => -amplitude,
        _ => 0.0,
    }
}

/// Segments flown by `truth`, noise of correlation `rho` between samples.
pub fn campaign(truth: &Model, seed: u64, rho: f64) -> Vec<Segment> {
    campaign_at(1.0, truth, seed, rho)
}

/// The same so many times as fast.
fn campaign_at(pace: f64, truth: &Model, seed: u64, rho: f64) -> Vec<Segment> {
    let propagator = Propagator::new(truth, Directions::default()).expect("a propagator");
    let sd = [1e-3, 2e-3 * pace, 5e-3 * pace];
    let one = |s: usize| {
        let (dt, n, unit) = (0.02 / pace, 500, [0.35, 0.5, 0.7][s % 3]);
        let amplitude = [0.04, -0.06, 0.09, -0.03][s % 4];
        let speed = [80.0, 110.0][s % 2] * pace;
        let inputs: Vec<f64> =
            (0..n).flat_map(|k| [steps(k as f64 * 0.02, unit, amplitude), speed]).collect();
        let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let channels = (0..3)
            .map(|output| Channel { output, t: t.clone().into(), z: vec![0.0; n].into() })
            .collect();
        let mut record =
            Record { dt, n, inputs: inputs.into(), channels, substeps: 2, ..Record::default() };
        let response = propagator.respond(&truth.parameter_starts(), &[], &record, false);
        for (channel, y) in record.channels.iter_mut().zip(response.y) {
            let mut stream = Stream::new(seed, &[&s.to_string(), &channel.output.to_string()]);
            let mut v = stream.normal();
            for (z, y) in channel.z.iter_mut().zip(y) {
                *z = y + sd[channel.output] * v;
                v = rho * v + (1.0 - rho * rho).sqrt() * stream.normal();
            }
        }
        Segment {
            record,
            labels: [("input".to_string(), "de".to_string())].into(),
            ..Segment::default()
        }
    };
    (0..9).map(one).collect()
}

fn verdict(truth: &Model, seed: u64, rho: f64, settings: &Settings) -> Diagnosis {
    judged(
        &model("", "", "alpha"),
        &campaign(truth, seed, rho),
        &estimate::Settings::default(),
        settings,
    )
}

/// The verdict on a model estimated by `method`.
fn judged(
    base: &Model,
    segments: &[Segment],
    method: &estimate::Settings,
    settings: &Settings,
) -> Diagnosis {
    held_against(&LIBRARY, base, segments, (method, settings))
}

/// The same with these effects of the library.
pub fn held_against(
    effects: &[&str],
    base: &Model,
    segments: &[Segment],
    (method, settings): (&estimate::Settings, &Settings),
) -> Diagnosis {
    let names: Vec<String> = (0..segments.len()).map(|i| format!("s{i}")).collect();
    let held = held_out(segments, &names, settings);
    let subject = Subject {
        model: base,
        segments,
        held_out: &held.held_out,
        method,
        context: &Context::default(),
        settings,
    };
    let library: Vec<_> = effect::load(&[])
        .expect("the library")
        .into_iter()
        .filter(|e| effects.contains(&e.name.as_str()))
        .collect();
    let offer = |model: &Model, wanted: &effect::Wanted| {
        let offer = effect::candidates_of(model, &Context::default(), &library, wanted);
        Ok((offer.candidates, Vec::new()))
    };
    diagnose(&subject, &offer, &|_| {}).unwrap_or_else(|e| panic!("{e}"))
}

pub fn told(d: &Diagnosis) -> String {
    let mut text = d.verdict.as_str().to_string();
    for round in &d.rounds {
        text += &format!("\nlimit {:.1}", round.limit);
        for j in &round.judged {
            text += &format!(
                "\n  {} gain {:.1} evidence {:.1} {}: {}",
                j.name,
                j.screened.gain,
                j.evidence,
                j.standing.as_str(),
                j.why
            );
            if let Some(refit) = &j.refit {
                let values: Vec<String> = refit
                    .values
                    .iter()
                    .map(|v| format!("{} {:.4}+-{:?}", v.name, v.value, v.sd))
                    .collect();
                let held: Vec<String> = refit
                    .held_out
                    .iter()
                    .map(|g| format!("{:.1}/{:.1}", g.realised, g.predicted))
                    .collect();
                text += &format!(
                    "\n    gain {:.1} {values:?} held {held:?} heterogeneity {:?}",
                    refit.gain, refit.heterogeneity
                );
            }
        }
    }
    for l in d.located().take(3) {
        text += &format!("\nlocated {l:?}");
    }
    text
}

/// A vane that reads 1.025 times the angle where the model assumes once, with this sd.
fn scaled(sd: f64) -> Diagnosis {
    let with = |value: f64, sd: f64| {
        let constant = format!("k_vane = {{ unit = \"-\", value = {value:?}, sd = {sd:?} }}");
        parsed(&(text("", "", "k_vane*alpha") + "[constants]\n" + &constant + "\n"))
    };
    let flown = campaign(&with(1.025, 0.0), 1, 0.0);
    let (method, settings) = (estimate::Settings::default(), Settings::default());
    judged(&with(1.0, sd), &flown, &method, &settings)
}

#[test]
fn recovery_an_error_of_an_assumed_constant_within_its_sd_is_nothing_missing() {
    let d = scaled(0.02);
    assert_eq!(d.verdict, Verdict::NothingMissing, "{}", told(&d));
    let shift = d.comparison.shifts.iter().find(|s| s.name == "k_vane").expect("it is free");
    assert!((shift.after - 1.025).abs() < 3e-3, "{shift:?}");
    // Known exactly, it is another thing that is missing; known to be smaller, it is told.
    let d = scaled(0.0);
    assert_eq!(d.added[0].effect, "sensor-scale", "{}", told(&d));
    assert!(d.comparison.shifts.iter().all(|s| s.name != "k_vane"));
    let d = scaled(0.004);
    assert!(d.unphysical.iter().any(|words| words.starts_with("k_vane")), "{:?}", d.unphysical);
}

/// Parameters that vary in maneuvers of three flights, of which the second one has its own truth.
fn varying(truth: &Model, second: &Model) -> Vec<(String, String, f64)> {
    let mut segments = campaign(truth, 1, 0.0);
    segments[3..6].clone_from_slice(&campaign(second, 1, 0.0)[3..6]);
    for (s, segment) in segments.iter_mut().enumerate() {
        segment.labels.insert("flight".into(), format!("f{}", s / 3));
    }
    let (method, settings) = (estimate::Settings::default(), Settings::default());
    let d = judged(&model("", "", "alpha"), &segments, &method, &settings);
    d.varying.into_iter().map(|v| (v.parameter, v.with, v.spread)).collect()
}

#[test]
fn recovery_what_is_not_one_number_is_told_with_what_it_goes_with() {
    let plain = model("", "", "alpha");
    assert_eq!(varying(&plain, &plain), []);
    // The control's moment is a tenth more in one flight.
    let more = model("D = { unit = \"1/s^2\", start = -0.6 }\n", "+ D*de", "alpha");
    let found = varying(&plain, &more);
    let (name, with, spread) = &found[0];
    assert_eq!((name.as_str(), with.as_str()), ("M_d", "flight"), "{found:?}");
    assert!((spread - 0.6).abs() < 0.15, "{found:?}");
    // It goes with airspeed, 80 or 110 m/s: by a fifth.
    let with_speed = model(
        "k = { unit = \"1/(m s)\", start = -0.04 }\nV_0 = { unit = \"m/s\", start = 95.0 }\n",
        "+ k*(V - V_0)*de",
        "alpha",
    );
    let found = varying(&with_speed, &with_speed);
    let (name, with, spread) = &found[0];
    assert_eq!((name.as_str(), with.as_str()), ("M_d", "V"), "{found:?}");
    assert!((spread - 1.2).abs() < 0.2, "{found:?}");
}

#[test]
fn recovery_a_hidden_lag_is_named_with_its_size() {
    let p = "L = { unit = \"1/s^2\", start = 1.5 }\nr_H = { unit = \"m\", start = 16.0 }\n";
    let d = verdict(&model(p, "+ L*delay(de, r_H/V)", "alpha"), 1, 0.0, &Settings::default());
    println!("{}", told(&d));
    assert_eq!(
        (&d.verdict, d.added[0].effect.as_str()),
        (&Verdict::Named, "downwash-lag"),
        "{}",
        told(&d)
    );
    let finding = &d.findings[0];
    let refit = d.rounds[finding.round].judged[finding.added].refit.as_ref().expect("refitted");
    for (v, truth) in refit.values.iter().zip([1.5, 16.0]) {
        assert!((v.value - truth).abs() < 4.0 * v.sd.expect("sd"), "{v:?}");
    }
}

/// Where the stability grows with airspeed and every maneuver is estimated apart, with lines fitted
/// through the estimates or without, that is not missing; what is hidden besides is found, and is
/// what it is.
#[test]
fn recovery_what_differs_from_maneuver_to_maneuver_is_not_missing_and_hides_nothing() {
    let stiffer =
        "k = { unit = \"1/(m s)\", start = -0.03 }\nV_0 = { unit = \"m/s\", start = 95.0 }\n";
    let lag = "L = { unit = \"1/s^2\", start = 1.5 }\nr_H = { unit = \"m\", start = 16.0 }\n";
    let line = |name: &str| Fitted {
        parameter: name.to_string(),
        against: "V".into(),
        unit: "m/s".into(),
    };
    let lines: Vec<Fitted> = ["Z_a", "Z_d", "M_a", "M_q", "M_d"].map(line).into();
    let of = |truth: &Model, lines: &[Fitted]| {
        let mut segments = campaign(truth, 11, 0.5);
        for segment in &mut segments {
            let speed = segment.record.inputs[1];
            segment.conditions.insert("V".into(), speed);
        }
        let claim = Claim { apart: Some(estimate::SEGMENT.to_string()), lines: lines.to_vec() };
        let base = model("", "", "alpha");
        let (method, _) = together(&base, &estimate::Settings::default(), &mut segments, &claim)
            .unwrap_or_else(|e| panic!("{e}"));
        judged(&model("", "", "alpha"), &segments, &method, &Settings::default())
    };
    for lines in [&lines[..], &[]] {
        let d = of(&model(stiffer, "+ k*(V - V_0)*alpha", "alpha"), lines);
        assert_eq!(d.verdict, Verdict::NothingMissing, "{}", told(&d));
        let both = format!("{stiffer}{lag}");
        let d = of(&model(&both, "+ k*(V - V_0)*alpha + L*delay(de, r_H/V)", "alpha"), lines);
        assert_eq!(
            (&d.verdict, d.added[0].effect.as_str()),
            (&Verdict::Named, "downwash-lag"),
            "{}",
            told(&d)
        );
        let refit = d.rounds[d.findings[0].round].judged[d.findings[0].added]
            .refit
            .as_ref()
            .expect("refitted");
        for (v, truth) in refit.values.iter().zip([1.5, 16.0]) {
            assert!((v.value - truth).abs() < 4.0 * v.sd.expect("sd"), "{v:?}");
        }
        let (predicted, realised) = refit
            .held_out
            .iter()
            .fold((0.0, 0.0), |sum, g| (sum.0 + g.predicted, sum.1 + g.realised));
        assert!(
            (realised - predicted).abs() < 4.0 * (2.0f64 * predicted).sqrt(),
            "{realised} of {predicted}"
        );
    }
    // As one number it is something missing.
    let one = judged(
        &model("", "", "alpha"),
        &campaign(&model(stiffer, "+ k*(V - V_0)*alpha", "alpha"), 11, 0.5),
        &estimate::Settings::default(),
        &Settings::default(),
    );
    assert_ne!(one.verdict, Verdict::NothingMissing, "{}", told(&one));
}

#[test]
fn recovery_what_the_base_can_imitate_is_no_candidate_and_says_by_what() {
    let d = verdict(&model("", "", "alpha"), 2, 0.5, &Settings::default());
    let stability = d.rounds[0].judged.iter().find(|j| j.name == "static-longitudinal:qdot");
    let stability = stability.unwrap_or_else(|| panic!("{}", told(&d)));
    let by = &stability.screened.imitators[..];
    assert_eq!((stability.standing, by.len()), (Standing::Collinear, 1), "{}", told(&d));
    // The moment by angle of attack that it adds is M_a itself.
    assert!(by[0].name == "M_a" && (by[0].shift - 1.0).abs() < 1e-6, "{by:?}");
}

#[test]
fn recovery_nothing_is_named_where_nothing_is_missing() {
    for seed in 0..5 {
        let d = verdict(&model("", "", "alpha"), 100 + seed, 0.8, &Settings::default());
        assert_eq!(d.verdict, Verdict::NothingMissing, "seed {seed}: {}", told(&d));
    }
}

#[test]
fn recovery_an_error_of_a_frozen_derivative_is_named_where_the_base_is_predicted() {
    let truth = parsed(&text("", "", "alpha").replace("-4.0", "-4.2"));
    let d = verdict(&truth, 3, 0.5, &Settings { base: Base::Predicted, ..Settings::default() });
    let added = d.added.first().map(|c| c.effect.as_str());
    assert_eq!((&d.verdict, added), (&Verdict::Named, Some("static-longitudinal")), "{}", told(&d));
    assert!((d.values[0].1 + 0.2).abs() < 0.02, "{:?}", d.values);
}

/// The elevator rings a structural mode, 30 rad/s, which the vane shows.
fn ringing_vane(pace: f64) -> String {
    let (square, damping) = (-900.0 * pace * pace, -1.2 * pace);
    let p = format!("w = {{ unit = \"1/s^2\", start = {:?} }}\n", 60.0 * pace * pace);
    let rate = format!("{square:?}*eta/sec^2 + {damping:?}*eta_dot/sec + w*de");
    let states = format!(
        "eta = {{ unit = \"rad\", rate = \"eta_dot\", start = 0.0 }}\neta_dot = {{ unit = \"rad/s\", rate = \"{rate}\", start = 0.0 }}\n[outputs]"
    );
    let text = text_at(pace, &p, "", "alpha + eta").replace("[outputs]", &states);
    text.replace("[parameters]", "[constants]\nsec = { unit = \"s\", value = 1.0 }\n[parameters]")
}

#[test]
fn recovery_an_effect_that_no_candidate_resembles_is_located() {
    let truth = parsed(&ringing_vane(1.0));
    let d = verdict(&truth, 4, 0.5, &Settings::default());
    assert_eq!(d.verdict, Verdict::Located, "{}", told(&d));
    assert_eq!(d.located().next().expect("one").output, "alpha", "{}", told(&d));
}

#[test]
fn truth_an_aircraft_ten_times_as_fast_has_the_same_verdict() {
    // A structural mode in the vane, which no candidate resembles; and a downwash that is named.
    let lag = |pace: f64| {
        format!(
            "L = {{ unit = \"1/s^2\", start = {:?} }}\nr_H = {{ unit = \"m\", start = 16.0 }}\n",
            1.5 * pace * pace
        )
    };
    let all = |pace: f64| {
        let truths =
            [ringing_vane(pace), text_at(pace, &lag(pace), "+ L*delay(de, r_H/V)", "alpha")];
        let base = parsed(&text_at(pace, "", "", "alpha"));
        truths.map(|truth| {
            judged(
                &base,
                &campaign_at(pace, &parsed(&truth), 4, 0.5),
                &estimate::Settings::default(),
                &Settings::default(),
            )
        })
    };
    let (slow, fast) = (all(1.0), all(10.0));
    assert_eq!(
        (&slow[0].verdict, &slow[1].verdict),
        (&Verdict::Located, &Verdict::Named),
        "{}\n{}",
        told(&slow[0]),
        told(&slow[1])
    );
    for (slow, fast) in slow.iter().zip(&fast) {
        let both = format!("{}\n\nten times as fast: {}", told(slow), told(fast));
        assert_eq!(slow.verdict, fast.verdict, "{both}");
        let named = |d: &Diagnosis| d.added.iter().map(|c| c.name.clone()).collect::<Vec<_>>();
        assert_eq!(named(slow), named(fast), "{both}");
        // What responds to what; frequencies are named in rad/s.
        let first = |d: &Diagnosis| {
            d.located()
                .next()
                .map(|l| (l.output.clone(), l.source.split(" at ").next().map(str::to_string)))
        };
        assert_eq!(first(slow), first(fast), "{both}");
    }
}

#[test]
fn recovery_an_effect_that_comes_and_goes_is_located_by_what_is_new_at_each_instant() {
    let truth = text("w = { unit = \"1/s^2\", start = 1.5 }\n", "+ w*sin(2.3*t/sec)*de", "alpha");
    let truth =
        parsed(&truth.replace(
            "[parameters]",
            "[constants]\nsec = { unit = \"s\", value = 1.0 }\n[parameters]",
        ));
    let d = verdict(&truth, 6, 0.97, &Settings::default());
    assert_eq!(d.verdict, Verdict::Located, "{}", told(&d));
    let source = &d.located().next().expect("one").source;
    assert!(source.starts_with("de, coming and going"), "{}", told(&d));
    assert!(source.ends_with(innovation::HOW), "{}", told(&d));
}

#[test]
fn truth_what_is_new_at_each_instant_is_foretold_by_chance_only_where_nothing_is_missing() {
    let base = model("", "", "alpha");
    let (mut all, mut above, mut sum) = (0.0, 0.0, 0.0);
    for seed in 200..204 {
        let segments = campaign(&base, seed, 0.8);
        let held_out: Vec<bool> = (0..segments.len()).map(|i| i % 3 == 2).collect();
        let (method, settings) = (estimate::Settings::default(), Settings::default());
        let context = Context::default();
        let (segments, held_out) = (&segments[..], &held_out[..]);
        let subject = Subject {
            model: &base,
            segments,
            held_out,
            method: &method,
            context: &context,
            settings: &settings,
        };
        let stand = Stand::first(&base, &method, settings.base);
        let found = at_first(&stand, &subject).expect("settings").expect("a base");
        let (case, theta) = (found.case(), &found.fit.theta);
        let sources =
            Sources::of(&case, &found.places.training, 0.01, true, &Thresholds::default());
        let of =
            |s: usize| innovation::sums(&case, &found.noise, &sources, s, theta, sums::Size::Alike);
        for gram in sums::together(&case, &sources, &found.places.training, &of) {
            let Some((gain, b)) = sums::best(&gram, Thresholds::default().ridge) else { continue };
            let dof = b.len() as f64;
            all += 1.0;
            sum += 2.0 * gain / dof;
            above += f64::from(2.0 * gain > crate::math::distribution::chi2_quantile(0.95, dof));
        }
    }
    // Inputs that do not move say nothing; the others are chi-square, a little less because of what
    // the fit absorbs.
    assert!(
        (0.8..1.1).contains(&(sum / all)) && (0.01..0.07).contains(&(above / all)),
        "{all} {} {}",
        sum / all,
        above / all
    );
}

#[test]
fn truth_the_same_to_the_bit_with_one_thread_and_with_three() {
    let p = "L = { unit = \"1/s^2\", start = 1.5 }\nr_H = { unit = \"m\", start = 16.0 }\n";
    let truth = model(p, "+ L*delay(de, r_H/V)", "alpha");
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let d = pool.install(|| verdict(&truth, 5, 0.5, &Settings::default()));
        // Debug text prints every number to its last digit, and NaN as such.
        format!("{:?} {:?} {:?} {:?} {:?}", d.verdict, d.rounds, d.findings, d.values, d.comparison)
    };
    assert!(on(1) == on(3));
}
