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

/// The verdict on a base without a damping where flights have these dampings.
fn flown(dampings: [f64; 3]) -> Diagnosis {
    against(&model(None), dampings)
}

/// The verdict on a base.
fn against(base: &Model, dampings: [f64; 3]) -> Diagnosis {
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
    held_against(&effects, base, &segments, (&method, &settings))
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

#[test]
fn recovery_of_another_damping_in_one_flight_where_the_base_has_one_for_all() {
    let base = model(Some(-150.0));
    for (dampings, flight, difference) in
        [([-150.0, -150.0, -200.0], "f2", -50.0), ([-200.0, -150.0, -150.0], "f0", -50.0)]
    {
        let d = against(&base, dampings);
        let judged = by_flight(&d);
        assert_eq!(d.verdict, Verdict::Named, "{}", told(&d));
        assert_eq!(judged.standing, Standing::Chosen, "{}", told(&d));
        let value = &judged.refit.as_ref().expect("a fit").values[0];
        let of = value.of.as_ref().expect("it is a flight's");
        assert_eq!(of.value, flight, "{}", told(&d));
        let off = (value.value - difference).abs();
        assert!(off < 3.0 * value.sd.expect("an sd"), "{}", told(&d));
        let from = value.from.as_ref().expect("the others differ from one");
        assert_ne!(from, flight);
        assert_eq!(d.added[0].added[0].held_in.as_ref(), Some(from));
    }
    // The same in all flights is the base's.
    let same = against(&base, [-150.0; 3]);
    assert_eq!(same.verdict, Verdict::NothingMissing, "{}", told(&same));
}
