//! Hand edits: what they change, and what happens to one that matches nothing.

use super::super::edits::{Exclude, Include, Move};
use super::super::{Edits, Kind, Maneuver, Settings, Source, apply};
use super::find;
use crate::error::Place;

fn channel() -> (Vec<f64>, Vec<f64>) {
    let t: Vec<f64> = (0..3000).map(|i| i as f64 * 0.02).collect();
    // a doublet at 10 s; a slow one at 30 s that its ramps hide
    let slow = |t: f64| {
        if (30.0..34.0).contains(&t) {
            ((t - 30.0) * std::f64::consts::FRAC_PI_2).sin()
        } else {
            0.0
        }
    };
    let u = t.iter().map(|t| {
        5.0 + if (10.0..11.0).contains(t) {
            1.0
        } else if (11.0..12.0).contains(t) {
            -1.0
        } else {
            0.5 * slow(*t)
        }
    });
    let u = u.collect();
    (t, u)
}

fn run(edits: &Edits) -> Result<Vec<Maneuver>, String> {
    let (t, u) = channel();
    let found = vec![find(&t, &u, &Settings::default())[0].clone()];
    let source = Source { flight: "f1", input: "elevator", t: &t, u: &u };
    let place = Place { file: "pipeline.toml".into(), line: 7, column: 1 };
    apply(found, edits, &source, &Settings::default(), &place).map_err(|e| e.to_string())
}

fn words() -> (String, String, String) {
    ("f1".into(), "elevator".into(), "a reason".into())
}

#[test]
fn no_edits_change_nothing() {
    let all = run(&Edits::default()).unwrap();
    assert_eq!(all.len(), 1);
    assert!(all[0].kind == Kind::Doublet && all[0].included && all[0].reason.is_empty());
}

#[test]
fn an_excluded_maneuver_stays_with_its_reason() {
    let (flight, input, reason) = words();
    let all = run(&Edits {
        exclude: vec![Exclude { flight, input, t_s: 13.0, reason }],
        ..Edits::default()
    })
    .unwrap();
    assert_eq!(all.len(), 1);
    assert!(!all[0].included && all[0].reason == "a reason");
}

#[test]
fn an_included_interval_is_measured() {
    let (flight, input, reason) = words();
    let e = Include { flight, input, kind: Kind::Doublet, t_start_s: 30.0, t_end_s: 34.0, reason };
    let all = run(&Edits { include: vec![e], ..Edits::default() }).unwrap();
    assert_eq!(all.len(), 2);
    let m = &all[1];
    assert!(
        m.included
            && m.reason == "a reason"
            && m.kind == Kind::Doublet
            && m.unit_time == 2.0
            && m.polarity == 1.0
    );
    assert!(
        (m.trim - 5.0).abs() < 1e-9 && m.amplitude > 0.3 && m.amplitude < 0.5 && m.steps.len() == 2
    );
}

#[test]
fn a_moved_maneuver_has_its_new_interval() {
    let (flight, input, reason) = words();
    let e = Move { flight, input, t_s: 11.0, t_start_s: 9.5, t_end_s: 12.5, kind: None, reason };
    let all = run(&Edits { moves: vec![e], ..Edits::default() }).unwrap();
    assert_eq!(all.len(), 1);
    assert!(
        all[0].t_start == 9.5
            && all[0].t_end == 12.5
            && all[0].kind == Kind::Doublet
            && all[0].reason == "a reason"
    );
}

#[test]
fn an_edit_that_matches_nothing_is_an_error_with_its_place() {
    let (flight, input, reason) = words();
    let e =
        Exclude { flight: flight.clone(), input: input.clone(), t_s: 40.0, reason: reason.clone() };
    let i = Include {
        flight: flight.clone(),
        input: input.clone(),
        kind: Kind::Step,
        t_start_s: 11.0,
        t_end_s: 13.0,
        reason: reason.clone(),
    };
    let far = Include { flight, input, kind: Kind::Step, t_start_s: 100.0, t_end_s: 101.0, reason };
    let text =
        run(&Edits { exclude: vec![e], include: vec![i, far], ..Edits::default() }).unwrap_err();
    assert!(text.starts_with("pipeline.toml:7:1: exclude at 40 s: flight \"f1\" has no maneuver on \"elevator\" within 2 s; found were doublet at 9.99"), "{text}");
    assert!(
        text.contains("include at 11 s: a doublet was found") && text.contains("has no samples"),
        "{text}"
    );
}

#[test]
fn edits_for_other_flights_are_left_alone_and_checked_beforehand() {
    let (_, input, _) = words();
    let edits = Edits {
        exclude: vec![Exclude { flight: "f2".into(), input, t_s: 40.0, reason: " ".into() }],
        ..Edits::default()
    };
    assert_eq!(run(&edits).unwrap().len(), 1);
    let errors = edits
        .check(&["f1".into()], &["aileron".into()], &Place::file("pipeline.toml"))
        .unwrap_err();
    assert_eq!(errors.0.len(), 3);
    assert!(errors.to_string().contains("there is no flight \"f2\""));
}

#[test]
fn edits_read_from_toml() {
    let text = "[[include]]\nflight = \"f1\"\ninput = \"elevator\"\nkind = \"3211\"\nt_start_s = 1.0\nt_end_s = 8.0\nreason = \"flown by hand\"\n\
                [[move]]\nflight = \"f1\"\ninput = \"elevator\"\nt_s = 20.0\nt_start_s = 19.0\nt_end_s = 26.0\nreason = \"late\"\n";
    let edits: Edits = toml::from_str(text).unwrap();
    assert_eq!(edits.include[0].kind, Kind::K3211);
    assert_eq!(edits.moves[0].kind, None);
    assert!(toml::from_str::<Edits>("[[exclude]]\nflight = \"f1\"\n").is_err());
}
