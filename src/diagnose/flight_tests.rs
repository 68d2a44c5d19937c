//! Small simulated campaigns of three flights in which a damping is missing: the same in all of them, or in
//! each another.

use super::tests::{campaign, held_against, parsed, text, told};
use super::*;
use crate::estimate;
use crate::model::Model;

/// Without damping, or with so much of it: `D q/V`, with `D` in m/s^2.
fn model(damping: Option<f64>) -> Model {
    let (declared, term) = match damping {
        Some(value) => (format!("D = {{ unit = \"m/s^2\", start = {value:?} }}\n"), "+ D*q/V"),
        None => (String::new(), ""),
    };
    let whole = text(&declared, term, "alpha");
    parsed(&whole.replace("M_q = { unit = \"1/s\", start = -1.5 }\n", "").replace(" + M_q*q", ""))
}

/// The verdict where flights have these dampings.
fn flown(dampings: [f64; 3]) -> Diagnosis {
    let mut segments = campaign(&model(Some(dampings[0])), 3, 0.0);
    for flight in 0..3 {
        let of = campaign(&model(Some(dampings[flight])), 3, 0.0);
        for (segment, own) in segments.iter_mut().zip(of).skip(3 * flight).take(3) {
            *segment = own;
            segment.labels.insert("flight".into(), format!("f{flight}"));
        }
    }
    let effects = ["rate-derivative-longitudinal", "damping-by-flight-longitudinal"];
    let (method, settings) = (estimate::Settings::default(), Settings::default());
    held_against(&effects, &model(None), &segments, (&method, &settings))
}

/// What became of the effect that differs from flight to flight.
fn by_flight(d: &Diagnosis) -> &Judged {
    let mut judged = d.rounds[0].judged.iter();
    judged.find(|j| j.name == "damping-by-flight-longitudinal:qdot").expect("it was tried")
}

#[test]
fn recovery_what_is_the_same_in_all_flights_does_not_differ_between_them() {
    let same = flown([-150.0; 3]);
    let judged = by_flight(&same);
    assert_eq!(judged.standing, Standing::Bounds, "{}", told(&same));
    assert!(judged.why.contains("the same in all flights"), "{}", judged.why);
    let differing = flown([-100.0, -150.0, -200.0]);
    let judged = by_flight(&differing);
    assert!(!judged.why.contains("the same in all flights"), "{}", told(&differing));
    assert!(judged.refit.is_some(), "{}", told(&differing));
}
