//! The modes of the simulated ATTAS, and the table of them in its README.

use indexmap::IndexMap;
use koehler::math::eigen::{Eigen, eigen};
use koehler::model::Program;
use koehler::model::graph::Leaf;
use koehler::simulate::{Campaign, Flight};
use std::path::Path;

/// A number of the complex plane.
type Complex = (f64, f64);

/// Eigenvalues of a small matrix, the fastest first, both of a pair.
fn eigenvalues(a: &[Vec<f64>]) -> Vec<Complex> {
    let all = eigen(&a.concat(), a.len()).expect("eigenvalues");
    let pair = |e: &Eigen| {
        let (re, im) = (e.value.re, e.value.im);
        if im > 0.0 { vec![(re, im), (re, -im)] } else { vec![(re, im)] }
    };
    all.iter().flat_map(pair).collect()
}

fn rounded(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        text.trim_start_matches('-').to_string()
    } else {
        text
    }
}

/// The oscillation among eigenvalues, `-0.83 ± 1.49i`, or its two real values.
fn oscillation(pair: &[Complex], digits: usize) -> String {
    match pair[0].1.abs() > 1e-6 {
        true => format!("{} ± {}i", rounded(pair[0].0, digits), rounded(pair[0].1.abs(), digits)),
        false => pair.iter().map(|z| rounded(z.0, digits)).collect::<Vec<_>>().join(", "),
    }
}

/// A place in the campaign: calibrated airspeed in kt, pressure altitude in ft, and what the flight
/// holds constant (landing flap, fuel at its start).
struct Place {
    knots: f64,
    feet: f64,
    constant: IndexMap<String, f64>,
}

/// One row of the table: trimmed in level flight, surfaces, thrust and fuel held.
fn row(campaign: &Campaign, place: &Place) -> String {
    let (knots, feet) = (place.knots, place.feet);
    let model = &campaign.model;
    // what a flight that begins there begins with
    let mut flown = campaign.clone();
    let text = format!(
        "altitude_ft = {feet:?}\nspeeds_kt = [{knots:?}]\nat_each = []\ntiming = {{ settle_s = 1, end_s = 1 }}"
    );
    let flight = Flight {
        constant: place.constant.clone(),
        ..toml::from_str::<Flight>(&text).expect("a flight")
    };
    flown.settings.flights = [("trimmed".to_string(), flight)].into_iter().collect();
    let truth = flown.truth("trimmed").unwrap_or_else(|e| panic!("{knots} kt: {e}"));
    let steady = truth.at(0.0);
    let (speed, alpha, height) = (steady["true_airspeed"], steady["alpha_true"], feet * 0.3048);
    let state = |name: &str| model.state(name).unwrap_or_else(|| panic!("no state {name}"));
    let (longitudinal, lateral) =
        (["u", "w", "q", "theta"].map(state), ["v", "p", "r", "phi"].map(state));
    // d(rate of row)/d(column), flaps at rest, which their downwash then is as well
    let mut graph = model.graph.clone();
    let mut known = model.steady(&mut graph);
    let zero = graph.c(0.0);
    known.extend((0..model.inputs.len()).map(|i| (Leaf::InputRate(i), zero)));
    let all: Vec<usize> = longitudinal.into_iter().chain(lateral).collect();
    let mut nodes = Vec::new();
    for &i in &all {
        let rate = graph.substitute(model.rates[i], &known);
        nodes.extend(all.iter().map(|&j| graph.derivative(rate, Leaf::State(j))));
    }
    let program = Program::lower(&graph, &nodes, &model.layout);
    let mut file = program.registers::<1>();
    file.iter_mut()
        .skip(model.layout.parameter())
        .zip(model.parameter_starts())
        .for_each(|(slot, value)| *slot = [value]);
    let (u, w) = (speed * alpha.cos(), speed * alpha.sin());
    let level = [
        ("u", u),
        ("w", w),
        ("theta", steady["theta"]),
        ("h", height),
        ("delta_e", steady["delta_e"]),
        ("thrust", steady["engine_thrust"]),
        ("fuel", steady["fuel"]),
    ];
    for (input, slot) in model.inputs.iter().zip(model.layout.input()..) {
        file[slot] = [steady[input.name.as_str()]];
    }
    level.iter().for_each(|(name, value)| file[state(name)] = [*value]);
    program.prepare(&mut file, &model.tables);
    program.run(&mut file, &model.tables);
    let entry = |i: usize, j: usize| program.output(&file, i * all.len() + j)[0];
    let block = |from: usize| -> Vec<Vec<f64>> {
        (from..from + 4).map(|i| (from..from + 4).map(|j| entry(i, j)).collect()).collect()
    };
    // symmetric flight: the two do not touch
    assert!(
        (0..4).all(|i| (4..8).all(|j| entry(i, j).abs() < 1e-9 && entry(j, i).abs() < 1e-9)),
        "{knots} kt"
    );
    let (along, across) = (eigenvalues(&block(0)), eigenvalues(&block(4)));
    let (dutch, real): (Vec<Complex>, Vec<Complex>) =
        across.into_iter().partition(|z| z.1.abs() > 1e-6);
    assert_eq!((dutch.len(), real.len()), (2, 2), "{knots} kt: {dutch:?} {real:?}");
    let cells = [
        rounded(knots, 0),
        rounded(feet, 0),
        rounded(steady["eta_k"].to_degrees(), 0),
        rounded(steady["mass"], 0),
        rounded(speed, 1),
        rounded(alpha.to_degrees(), 2),
        rounded(steady["delta_e"].to_degrees(), 2),
        rounded(steady["engine_thrust"] / 1e3, 1),
        oscillation(&along[..2], 2),
        oscillation(&along[2..], 4),
        oscillation(&dutch, 2),
        rounded(real[0].0, 2),
        rounded(real[1].0, 4),
    ];
    format!("| {} |\n", cells.join(" | "))
}

#[test]
fn the_modes_in_the_readme_of_the_attas_are_those_of_the_simulated_aircraft() {
    const START: &str =
        "<!-- written by `UPDATE_DOCS=1 cargo test --test all the_modes_in_the_readme` -->\n";
    const END: &str = "<!-- until here -->\n";
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/attas");
    let campaign = Campaign::load(&folder.join("campaign.toml")).unwrap_or_else(|e| panic!("{e}"));
    let places = |f: &Flight| -> Vec<Place> {
        let (feet, constant) = (f.altitude_ft.expect("an altitude"), f.constant.clone());
        let place = |knots| Place { knots, feet, constant: constant.clone() };
        f.points.iter().map(|p| place(p.speed_kt)).collect()
    };
    let mut places: Vec<Place> = campaign.settings.flights.values().flat_map(places).collect();
    // the condition of the real records
    places.push(Place { knots: 198.0, feet: 16_003.0, constant: IndexMap::new() });
    let head = "| kt | ft | landing flap deg | mass kg | true m/s | alpha deg | elevator deg | thrust kN | short period 1/s | phugoid 1/s | Dutch roll 1/s | roll 1/s | spiral 1/s |\n";
    let rule = format!("|{}\n", "---|".repeat(13));
    let rows: String = places.iter().map(|place| row(&campaign, place)).collect();
    let path = folder.join("README.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(START).expect("the marker of the modes");
    let (_, after) = rest.split_once(END).expect("its end");
    let wanted = format!("{before}{START}{head}{rule}{rows}{END}{after}");
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, &wanted).unwrap();
    } else {
        assert!(
            text == wanted,
            "pipelines/attas/README.md is behind the model: UPDATE_DOCS=1 cargo test --test all the_modes_in_the_readme\n{rows}"
        );
    }
}
