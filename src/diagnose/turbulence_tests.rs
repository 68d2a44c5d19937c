//! Campaigns flown in simulated turbulence: is it told from something that is missing?

use super::effect::{self, Context};
use super::tests::{parsed, steps, told};
use super::*;
use crate::dynamics::{Channel, Directions, Interpolation, Propagator, Record};
use crate::estimate::{self, Segment};
use crate::model::Model;
use crate::simulate::Stream;

/// Densities of the noise in the rates of alpha and q, rad/s^0.5 and rad/s^1.5.
const DENSITIES: [f64; 2] = [0.02, 0.08];

/// Short period with what drives its rates besides, and what an input does in the moment.
fn model(alpha: &str, pitch: &str, moment: &str) -> Model {
    let inputs = if alpha.is_empty() { "" } else { "w_alpha = \"rad/s\"\nw_q = \"rad/s^2\"\n" };
    parsed(&format!(
        r#"title = "short period"
[inputs]
de = "rad"
V = "m/s"
{inputs}
[constants]
rad = {{ unit = "rad", value = 1.0, sd = 0.01 }}
half = {{ unit = "1/s^2", value = -3.0 }}
[parameters]
Z_a = {{ unit = "1/s", start = -0.9 }}
Z_d = {{ unit = "1/s", start = -0.1 }}
M_a = {{ unit = "1/s^2", start = -4.0 }}
M_q = {{ unit = "1/s", start = -1.5 }}
M_d = {{ unit = "1/s^2", start = -6.0 }}
[equations]
lift = "Z_a*alpha + Z_d*de"
ddt_q = "M_a*alpha + M_q*q + {moment}"
[states]
alpha = {{ unit = "rad", rate = "q + lift {alpha}", start = 0.0 }}
q = {{ unit = "rad/s", rate = "ddt_q {pitch}", start = 0.0 }}
[outputs]
alpha = {{ unit = "rad", value = "alpha" }}
q = {{ unit = "rad/s", value = "q" }}
nz = {{ unit = "1/s", value = "lift" }}
"#
    ))
}

/// Nine maneuvers in turbulence so many times as strong, of an aircraft with this moment of the
/// elevator.
fn flown(moment: &str, strength: f64, seed: u64) -> Vec<Segment> {
    flown_in(moment, strength, 0.0, seed)
}

/// The same where what drives the pitch rate lasts so many seconds, with the same density for what is slow.
fn flown_in(moment: &str, strength: f64, lasts: f64, seed: u64) -> Vec<Segment> {
    let truth = model("+ w_alpha", "+ w_q", moment);
    let propagator = Propagator::new(&truth, Directions::default()).expect("a propagator");
    let (dt, n) = (0.02, 500);
    let one = |s: usize| {
        let (unit, amplitude) = ([0.35, 0.5, 0.7][s % 3], [0.04, -0.06, 0.09, -0.03][s % 4]);
        let mut air = Stream::new(seed, &["air", &s.to_string()]);
        let gust = DENSITIES.map(|f| strength * f / f64::sqrt(dt));
        let keep = if lasts > 0.0 { libm::exp(-dt / lasts) } else { 0.0 };
        let mut pitch = 0.0;
        let mut row = |k: usize| {
            let de = steps(k as f64 * dt, unit, amplitude);
            pitch = keep * pitch + (1.0 - keep) * gust[1] * air.normal();
            [de, 90.0, gust[0] * air.normal(), pitch]
        };
        let inputs: Vec<f64> = (0..n).flat_map(&mut row).collect();
        let seen = inputs.chunks(4).flat_map(|u| [u[0], u[1]]).collect();
        let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let channels = (0..3)
            .map(|output| Channel { output, t: t.clone().into(), z: vec![0.0; n].into() })
            .collect();
        let interpolation = vec![Interpolation::Hold; 4];
        let record = Record {
            dt,
            n,
            inputs: inputs.into(),
            channels,
            substeps: 2,
            interpolation,
            ..Record::default()
        };
        let response = propagator.respond(&truth.parameter_starts(), &[], &record, false);
        let mut record =
            Record { inputs: seen, interpolation: vec![Interpolation::Hold; 2], ..record };
        for (channel, y) in record.channels.iter_mut().zip(response.y) {
            let sd = [1e-3, 2e-3, 5e-3][channel.output];
            let mut stream = Stream::new(seed, &[&s.to_string(), &channel.output.to_string()]);
            channel.z.iter_mut().zip(y).for_each(|(z, y)| *z = y + sd * stream.normal());
        }
        let labels = [("input".to_string(), "de".to_string())].into();
        Segment { record, labels, ..Segment::default() }
    };
    (0..9).map(one).collect()
}

/// The verdict on a base with this moment of the elevator, without any effect to be named.
fn judged(moment: &str, segments: &[Segment], settings: &Settings) -> Diagnosis {
    let base = model("", "", moment);
    let held_out = [false, false, true].repeat(3);
    let subject = Subject {
        model: &base,
        segments,
        held_out: &held_out,
        method: &estimate::Settings::default(),
        context: &Context::default(),
        settings,
    };
    let library: Vec<effect::Effect> = Vec::new();
    let offer = |model: &Model, wanted: &effect::Wanted| {
        let offer = effect::candidates_of(model, &Context::default(), &library, wanted);
        Ok((offer.candidates, Vec::new()))
    };
    diagnose(&subject, &offer, &|_| {}).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn recovery_turbulence_is_no_missing_effect_and_its_densities_are_found() {
    for seed in 0..6 {
        let d = judged("M_d*de", &flown("M_d*de", 1.0, seed), &Settings::default());
        let found = d.turbulence.as_ref().unwrap_or_else(|| panic!("{seed}: {}", told(&d)));
        assert_eq!(d.verdict, Verdict::ButTurbulence, "{seed}: {found:?} {}", told(&d));
        assert!(d.complete && d.left.iter().any(|l| l.adequacy.is_poor()), "{:?}", d.left);
        for (density, truth) in found.densities.iter().zip(DENSITIES) {
            let sd = density.sd.expect("a standard deviation");
            assert!((density.value - truth).abs() < 4.0 * sd && sd < 0.1 * truth, "{density:?}");
        }
    }
}

#[test]
fn recovery_turbulence_that_lasts_is_found_with_its_time() {
    let truth = 0.2;
    for seed in 0..4 {
        let d = judged("M_d*de", &flown_in("M_d*de", 4.0, truth, seed), &Settings::default());
        let found = d.turbulence.as_ref().unwrap_or_else(|| panic!("{seed}: {}", told(&d)));
        println!("{:?}", found.densities);
        assert_eq!(d.verdict, Verdict::ButTurbulence, "{seed}: {found:?} {}", told(&d));
        let pitch = found.densities.iter().find(|density| density.state == "q").expect("q");
        let (time, sd) = pitch.lasts.expect("no white noise");
        let sd = sd.expect("a standard deviation");
        assert!((time - truth).abs() < 4.0 * sd && sd < 0.2 * truth, "{time} +- {sd}");
        let alpha = found.densities.iter().find(|density| density.state == "alpha");
        assert_eq!(alpha.map(|density| density.lasts), Some(None));
    }
}

/// Nor for turbulence that lasts.
#[test]
fn recovery_what_is_missing_is_not_taken_for_turbulence_that_lasts() {
    for (truth, base) in [("M_d*de", "0.0*M_d*de"), ("M_d*de*(1 - 150*(de/rad)^2)", "M_d*de")] {
        for seed in 0..2 {
            let d = judged(base, &flown_in(truth, 1.0, 0.2, seed), &Settings::default());
            assert_eq!(d.verdict, Verdict::Located, "{base} {seed}: {}", told(&d));
        }
    }
}

#[test]
fn recovery_without_turbulence_none_is_looked_for() {
    let d = judged("M_d*de", &flown("M_d*de", 0.0, 1), &Settings::default());
    assert_eq!((&d.verdict, &d.turbulence), (&Verdict::NothingMissing, &None), "{}", told(&d));
}

/// The base knows nothing of the elevator's moment, half of it, or all but a cubic part: in
/// turbulence or not, what is missing is not taken for it.
#[test]
fn recovery_what_is_missing_is_not_taken_for_turbulence() {
    for strength in [0.0, 1.0] {
        for (truth, base) in [
            ("M_d*de", "0.0*M_d*de"),
            ("M_d*de", "half*de + 0.0*M_d*de"),
            ("M_d*de*(1 - 150*(de/rad)^2)", "M_d*de"),
        ] {
            for seed in 0..3 {
                let d = judged(base, &flown(truth, strength, seed), &Settings::default());
                assert_eq!(d.verdict, Verdict::Located, "{base} {strength} {seed}: {}", told(&d));
                assert!(!d.complete);
            }
        }
    }
}
