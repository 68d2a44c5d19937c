//! The library of effects against the shipped models: what every one of them must do.

use super::*;
use crate::config;
use crate::dynamics::{Directions, Propagator, Record};
use crate::model::{Constants, Model, StartKind};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

const BASES: &[&str] = &[
    "attas/aerodynamics_a.model.toml",
    "hfb320/hfb320.model.toml",
    "citation/elevator.model.toml",
    "attas-real/short_period.model.toml",
    "attas-real/flight_path.model.toml",
    "citation/truth.model.toml",
];

fn shipped(path: &str) -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines").join(path);
    let aircraft = path.with_file_name("aircraft.toml");
    let constants = if aircraft.exists() {
        config::load::<Constants>(&aircraft).unwrap().0
    } else {
        Constants::default()
    };
    Model::load(&path, &constants).unwrap_or_else(|e| panic!("{e}"))
}

/// Three rates without a product of inertia: no shipped model that takes any motion is without one.
fn rates() -> Model {
    let text = r#"
title = "Rates"
[inputs]
de = "rad"
[constants]
I_x = { unit = "kg m^2", value = 1000.0 }
I_y = { unit = "kg m^2", value = 2000.0 }
I_z = { unit = "kg m^2", value = 3000.0 }
[parameters]
a = { unit = "1/s", start = -1.0 }
b = { unit = "1/s^2", start = -1.0 }
[states]
p = { unit = "rad/s", rate = "a*p", start = 0.0 }
q = { unit = "rad/s", rate = "a*q + b*de", start = 0.0 }
r = { unit = "rad/s", rate = "a*r", start = 0.0 }
[outputs]
q = { unit = "rad/s", value = "q" }
"#;
    Model::parse("rates", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
}

fn library() -> Vec<Effect> {
    load(&[]).unwrap_or_else(|e| panic!("{e}"))
}

fn plausible(name: &str, unit: &str, i: usize) -> f64 {
    match (name, unit) {
        ("u", "m/s") => 97.0,
        ("v" | "w", "m/s") => 3.0,
        (name, "m/s") if name.contains("wind") || name.contains("turb") => 1.0,
        (_, "m/s") => 95.0,
        ("x_cg", _) => 0.05,
        (_, "m") => 4100.0,
        (_, "K") => 270.0,
        ("qbar", _) => 5000.0,
        (_, "Pa") => 55000.0,
        (_, "kg/m^3") => 0.8,
        (_, "N") => 6000.0,
        (_, "A" | "V") => 0.3,
        _ => 0.02 + 0.007 * i as f64,
    }
}

/// A second of smooth inputs, the same sub-steps for all models.
fn record(model: &Model) -> Record {
    let (dt, n) = (0.02, 50);
    let input = |k: usize, i: usize| {
        let q = &model.inputs[i];
        plausible(&q.name, &q.unit, i)
            * (1.0 + 0.3 * libm::sin(0.21 * k as f64 + 0.7 * i as f64 + 0.3))
    };
    let inputs = (0..n).flat_map(|k| (0..model.inputs.len()).map(move |i| input(k, i))).collect();
    Record { dt, n, inputs, start: 10, substeps: 16, ..Default::default() }
}

/// Parameters of the base away from zero, and starts of its states that begin measured. Without
/// friction: where it holds or lets go, sensitivities jump (`dynamics::contact_tests`).
fn point(base: &Model) -> (Vec<f64>, Vec<f64>) {
    let parameter = |(i, p): (usize, &crate::model::Parameter)| {
        if p.quantity.name == "F_c" {
            0.0
        } else if p.start == 0.0 {
            0.003 + 0.001 * i as f64
        } else {
            p.start
        }
    };
    let parameters = base.parameters.iter().enumerate().map(parameter).collect();
    let states = base.states.iter().enumerate().filter(|(_, s)| s.start == StartKind::Measured);
    (parameters, states.map(|(i, s)| plausible(&s.quantity.name, &s.quantity.unit, i)).collect())
}

fn outputs(model: &Model, parameters: &[f64], starts: &[f64], record: &Record) -> Vec<f64> {
    Propagator::new(model, Directions::default()).unwrap().run(parameters, starts, record, false).y
}

#[test]
fn every_effect_is_complete_and_names_rivals_that_exist() {
    let effects = library();
    assert!(effects.len() >= 40, "{}", effects.len());
    let names: BTreeSet<&str> = effects.iter().map(|e| e.name.as_str()).collect();
    for e in &effects {
        assert!(
            !e.file.signature.is_empty() && !e.file.rivals.is_empty(),
            "{}: signature and rivals",
            e.name
        );
        assert!(!e.file.source.is_empty(), "{}: where its equations come from", e.name);
        for rival in &e.file.rivals {
            assert!(
                names.contains(rival.as_str()) && *rival != e.name,
                "{}: there is no rival {rival}",
                e.name
            );
        }
    }
    let families: BTreeSet<Family> = effects.iter().map(|e| e.file.family).collect();
    assert_eq!(families.len(), 6, "{families:?}");
}

#[test]
fn every_effect_binds_to_a_shipped_model_and_leaves_it_as_it_is_at_null() {
    let effects = library();
    let mut bound: BTreeSet<String> = BTreeSet::new();
    let bases = BASES.iter().map(|name| (*name, shipped(name))).chain([("rates", rates())]);
    for (name, base) in bases {
        let offer = candidates(&base, &Context::default(), &effects);
        let (record, (p, x0)) = (record(&base), point(&base));
        let want = outputs(&base, &p, &x0, &record);
        let short = Record { substeps: 64, ..record.clone() };
        let fine = outputs(&base, &p, &x0, &short);
        assert!(want.iter().all(|y| y.is_finite()), "{name}");
        let unique: BTreeSet<&str> = offer.candidates.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(unique.len(), offer.candidates.len(), "{name}: names are not unique");
        // two bindings of each effect: simulating all takes minutes without optimisation
        let mut done: BTreeMap<&str, usize> = BTreeMap::new();
        for c in &offer.candidates {
            let times = done.entry(&c.effect).or_default();
            *times += 1;
            // Friction, were it none, is looked for at every reversal: steps end there. With short
            // ones that makes no difference.
            let splits = c.added.iter().any(|a| !a.steps.is_empty());
            let (record, want, apart) = match splits {
                true => (&short, &fine, 1e-8),
                false => (&record, &want, 1e-11),
            };
            for row in 0..if *times <= 2 { c.rows() } else { 0 } {
                let got = outputs(&c.model, &[&p[..], &c.start(row)].concat(), &x0, record);
                for (k, (a, b)) in got.iter().zip(want).enumerate() {
                    assert!(
                        (a - b).abs() <= apart * (1.0 + b.abs()),
                        "{name}: {}: output {k}: {a} for {b}",
                        c.name
                    );
                }
            }
            assert!(!c.sentence.contains('{'), "{}: {}", c.name, c.sentence);
            bound.insert(c.effect.clone());
        }
    }
    let unbound: Vec<&String> =
        effects.iter().map(|e| &e.name).filter(|n| !bound.contains(*n)).collect();
    assert!(unbound.is_empty(), "no shipped model has {unbound:?}");
}

#[test]
fn a_state_of_an_effect_keeps_what_its_file_says_of_it() {
    let base = shipped("hfb320/hfb320.model.toml");
    let offer = candidates(&base, &Context::default(), &library());
    let of = |effect: &str| offer.candidates.iter().find(|c| c.effect == effect).expect("bound");
    for (effect, limited) in [("actuator-rate-limit", true), ("actuator-backlash", false)] {
        let state = of(effect).model.states.last().expect("a state").clone();
        assert!(state.rests && state.min.is_some() && state.max.is_some(), "{effect}");
        assert_eq!(state.rate_max.is_some(), limited, "{effect}");
    }
    let text = r#"
title = "a state with friction"
family = "actuator"
signature = "a test"
separate = "a test"
source = "a test"
[bind]
control = "surface"
[parameters]
k = { unit = "1/s", null = 0.0, typical = 0.1 }
[states]
v = { unit = "{control}", rate = "{k}*{control}", start = 0.0, friction = 0.5, noise = 0.1 }
[add]
"{control}" = "{v}"
"#;
    let told = super::file::parse("own", "own.toml", text).expect_err("noise").to_string();
    assert!(told.contains("a state of an effect has no noise"), "{told}");
}

/// The parameters of an effect with its sizes away from null.
fn active(c: &Candidate, row: usize) -> Vec<f64> {
    let start = c.start(row);
    let step = |(a, x): (&Added, f64)| match (a.null, a.hold) {
        (Some(_), Some(hold)) => hold,
        (Some(null), None) => a.step(row).unwrap_or(null + a.typical),
        (None, _) => x * 1.013,
    };
    c.added.iter().zip(start).map(step).collect()
}

#[test]
fn sensitivities_of_every_effect_agree_with_differences() {
    let effects = library();
    let mut compared: BTreeSet<String> = BTreeSet::new();
    for name in &BASES[..5] {
        let base = shipped(name);
        let offer = candidates(&base, &Context::default(), &effects);
        let (record, (p, x0), nb) = (record(&base), point(&base), base.parameters.len());
        for c in &offer.candidates {
            if !compared.insert(c.effect.clone()) {
                continue;
            }
            for row in 0..c.rows() {
                let directions = Directions {
                    parameters: (nb..c.model.parameters.len()).collect(),
                    starts: Vec::new(),
                };
                let propagator = Propagator::new(&c.model, directions).unwrap();
                let at = [&p[..], &active(c, row)].concat();
                let exact = propagator.run(&at, &x0, &record, true);
                assert!(exact.finite, "{name}: {}", c.name);
                let nd = c.added.len();
                for d in 0..nd {
                    let h = 2e-6 * at[nb + d].abs().max(c.added[d].typical.min(1.0) * 0.1);
                    let run = |step: f64| {
                        let mut shifted = at.clone();
                        shifted[nb + d] += step;
                        propagator.run(&shifted, &x0, &record, false).y
                    };
                    let (low, high) = (run(-h), run(h));
                    let column: Vec<f64> = (0..low.len()).map(|i| exact.dy[i * nd + d]).collect();
                    let ny = c.model.outputs.len();
                    for o in 0..ny {
                        let scale =
                            (o..low.len()).step_by(ny).fold(0.0f64, |m, i| m.max(column[i].abs()));
                        for i in (o..low.len()).step_by(ny) {
                            let difference = (high[i] - low[i]) / (2.0 * h);
                            let allowed = 1e-4 * scale + 1e-10 * low[i].abs() / h + 1e-9;
                            assert!(
                                (column[i] - difference).abs() <= allowed,
                                "{name}: {} row {row}, {}: output {} point {}: exact {} difference {difference}",
                                c.name,
                                c.added[d].name,
                                c.model.outputs[o].name,
                                i / ny,
                                column[i]
                            );
                        }
                    }
                }
            }
        }
    }
    assert!(compared.len() + 6 > effects.len(), "{} of {} effects", compared.len(), effects.len());
}

#[test]
fn a_model_with_an_effect_found_is_its_text_with_lines_added() {
    let base = shipped("attas/aerodynamics_a.model.toml");
    let offer = candidates(&base, &Context::default(), &library());
    let lag = offer.candidates.iter().find(|c| c.name == "downwash-lag:eta").unwrap();
    assert_eq!(
        lag.added[1].check,
        Some(Check { text: "r_H".into(), value: lag.added[1].starts[0], within: 0.2 })
    );
    // In its other forms it takes the time of that distance, about, where the airspeed is known.
    let context =
        Context { middles: [("V".to_string(), 80.0)].into_iter().collect(), ..Context::default() };
    for (context, known) in [(&context, true), (&Context::default(), false)] {
        let offer = candidates(&base, context, &library());
        for name in ["downwash-lag-time:eta", "downwash-lag-first-order:eta"] {
            let form = offer.candidates.iter().find(|c| c.name == name).unwrap();
            let value = lag.added[1].starts[0] / 80.0;
            let check = Check { text: "r_H/V".into(), value, within: 1.0 };
            assert_eq!(form.added[1].check, known.then_some(check), "{name}");
        }
    }
    let values = [("C_m_eta_lag".to_string(), 0.25)].into();
    let text = lag.text(&base, &values, &[], "found by a test\nin two lines");
    assert!(
        text.starts_with(base.own_text())
            && text.contains("# found by a test\n# in two lines\n[[effect]]")
    );
    let lagged =
        "C_m = \"C_m_eta_lag*(delay(((eta_L + eta_R)/2), r_H_eta/V) - ((eta_L + eta_R)/2))\"";
    assert!(text.contains(lagged), "{text}");
    let cubic = offer.candidates.iter().find(|c| c.name == "control-cubic-longitudinal:eta,C_L");
    let power = cubic.unwrap().text(&base, &[("C_L_eta3".to_string(), 1.0)].into(), &[], "");
    assert!(power.contains("C_L = \"C_L_eta3*((eta_L + eta_R)/2)^3\""), "{power}");
    // the same flaps again: names stay free
    let next = base.amended(&text[base.own_text().len()..]).unwrap();
    assert_eq!(next.parameters[next.parameter("C_m_eta_lag").unwrap()].start, 0.25);
    let again = candidates(&next, &Context::default(), &library());
    assert!(again.candidates.iter().any(|c| c.added.iter().any(|a| a.name == "C_m_eta_lag_2")));
}

#[test]
fn roles_of_the_pipeline_file_come_before_names() {
    let text = r#"
title = "Names that tell nothing"
[inputs]
lever = "rad"
[parameters]
a = { unit = "1/s", start = -1.0 }
[states]
x1 = { unit = "rad/s", rate = "a*x1 + lever*force", start = 0.0 }
[constants]
force = { unit = "1/s^2", value = 2.0 }
[outputs]
y = { unit = "rad/s", value = "x1" }
"#;
    let base = Model::parse("plain", text, &Constants::default()).unwrap();
    let effects = library();
    let named = |c: &Context| {
        candidates(&base, c, &effects).candidates.iter().map(|c| c.name.clone()).collect::<Vec<_>>()
    };
    assert!(!named(&Context::default()).iter().any(|n| n.starts_with("downwash-lag")));
    let roles = [("pitch-rate".to_string(), vec!["x1".to_string()])].into_iter().collect();
    let told = named(&Context { roles, ..Default::default() });
    assert!(told.contains(&"downwash-lag:lever".to_string()), "{told:?}");
}

#[test]
fn a_product_of_inertia_is_corrected_where_the_model_has_one_and_added_where_not() {
    let offered = |base: &Model| -> Vec<String> {
        let all = candidates(base, &Context::default(), &library()).candidates;
        all.into_iter().map(|c| c.name).filter(|name| name.contains("product-of-inertia")).collect()
    };
    assert_eq!(offered(&shipped("attas/aerodynamics_a.model.toml")), ["product-of-inertia"]);
    assert_eq!(offered(&rates()), ["product-of-inertia-pitch"]);
}

#[test]
fn fault_effect_files_say_what_is_wrong() {
    let head = "title = \"t\"\nfamily = \"sensor\"\nsignature = \"s\"\n";
    let message = |rest: &str| {
        parse("e", "e.toml", &format!("{head}{rest}")).expect_err("unnoticed").to_string()
    };
    let good = "[bind]\nx = \"sensor\"\n[parameters]\nk = { unit = \"-\", null = 0.0 }\n[add]\n\"{x}\" = \"{k}*{x}\"\n";
    assert!(parse("e", "e.toml", &format!("{head}{good}")).is_ok());
    for (from, to, wanted) in [
        ("\"sensor\"", "\"gauge\"", "e.toml:5:5: there is no role \"gauge\""),
        ("{k}*{x}", "{z}*{x}", "\"{z}\" is not bound here"),
        ("null = 0.0", "starts = []", "a size has a null value, a shape has starts"),
        ("null = 0.0", "starts = [1.0]", "an effect has at least one size"),
        (
            "null = 0.0",
            "null = 0.0, max = -1.0",
            "null, hold, steps and starts lie within the bounds",
        ),
        ("null = 0.0", "null = 0.0, of = \"y\"", "`of` and `about` are names of something bound"),
        ("null = 0.0", "null = 0.0, over = \"y\"", "a positive number that stands in for it"),
        ("[add]\n\"{x}\" = \"{k}*{x}\"\n", "", "an effect adds to something or replaces something"),
    ] {
        let got = message(&good.replace(from, to));
        assert!(got.contains(wanted), "wanted: {wanted}\ngot: {got}");
    }
}

/// `UPDATE_DOCS=1 cargo test --release --lib roles_are_in_the_docs` rewrites the table.
#[test]
fn roles_are_in_the_docs() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/effects.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (head, _) = page.split_once("| role | filled by |\n|---|---|\n").unwrap();
    let rows: String =
        roles::list().map(|(role, meaning)| format!("| `{role}` | {meaning} |\n")).collect();
    let effects: String = library()
        .iter()
        .map(|e| format!("| `{}` | {} | {} |\n", e.name, e.file.family.name(), e.file.title))
        .collect();
    let new = format!(
        "{head}| role | filled by |\n|---|---|\n{rows}\n## The library\n\n| effect | family | sentence |\n|---|---|---|\n{effects}"
    );
    if std::env::var_os("UPDATE_DOCS").is_some() {
        crate::table::write_atomic(&path, new.as_bytes()).unwrap();
    }
    assert!(
        std::fs::read_to_string(&path).unwrap() == new,
        "UPDATE_DOCS=1 cargo test --release --lib roles_are_in_the_docs"
    );
}
