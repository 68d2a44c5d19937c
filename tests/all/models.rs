//! Every shipped model: it compiles, and every exact derivative agrees with differences.

use koehler::config;
use koehler::dynamics::{Directions, Propagator, Record};
use koehler::math::simd::Width;
use koehler::model::graph::{Leaf, Node};
use koehler::model::machine::{LANES, Lanes, Points};
use koehler::model::program::Program;
use koehler::model::{Constants, Model, Parameter, fragments::EMBEDDED};
use std::path::{Path, PathBuf};

/// All model files under `pipelines/`, with the aircraft file beside them.
fn shipped() -> Vec<(PathBuf, Constants)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines");
    let mut out = Vec::new();
    let mut stack = vec![root];
    while let Some(dir) = stack.pop() {
        for entry in std::fs::read_dir(dir).unwrap().flatten() {
            let path = entry.path();
            if path.is_dir() {
                // What a run has left there was not shipped.
                if !path.ends_with("out") {
                    stack.push(path);
                }
            } else if path.to_string_lossy().ends_with(".model.toml") {
                let aircraft = path.with_file_name("aircraft.toml");
                let constants = if aircraft.exists() {
                    config::load::<Constants>(&aircraft).unwrap().0
                } else {
                    Constants::default()
                };
                out.push((path, constants));
            }
        }
    }
    out.sort_by(|a, b| a.0.cmp(&b.0));
    out
}

/// Files that are parts of another model and do not stand alone.
fn is_part(path: &Path) -> bool {
    let name = path.file_name().unwrap().to_string_lossy().into_owned();
    let folder = path.parent().unwrap();
    std::fs::read_dir(folder).unwrap().flatten().any(|e| {
        let text = std::fs::read_to_string(e.path()).unwrap_or_default();
        e.path() != path && text.contains(&format!("\"./{name}\""))
    })
}

fn is_friction(parameter: &Parameter) -> bool {
    parameter.quantity.name.starts_with("F_c")
}

/// Whether a parameter moves a limit of a state. Where a limit is reached or left, sensitivities
/// jump; that is compared in `dynamics::contact_tests`.
fn is_limit(parameter: &Parameter) -> bool {
    ["up_", "down_"].iter().any(|start| parameter.quantity.name.starts_with(start))
}

/// Travel of cables, or its rate.
fn is_travel(state: &str) -> bool {
    ["s", "s_dot", "x_A", "x_A_dot", "y", "y_dot"].contains(&state)
}

/// A point near which a model is smooth: its own starts, spread a little so that no two quantities
/// are alike.
fn point(model: &Model) -> Vec<f64> {
    let l = model.layout;
    let spread = |i: usize| 0.1 + 0.037 * (i as f64) - 0.011 * ((i * i) % 7) as f64;
    let mut point: Vec<f64> = (0..l.len()).map(spread).collect();
    for (i, s) in model.states.iter().enumerate() {
        let x: f64 = match s.quantity.unit.as_str() {
            "m" | "m/s" if is_travel(&s.quantity.name) => 0.002 + 0.0005 * i as f64,
            "m/s" => 90.0 + 3.0 * i as f64,
            "m" => 4000.0,
            "N" => 5000.0,
            _ => spread(i) * 0.2,
        };
        point[i] = x;
    }
    for (i, q) in model.inputs.iter().enumerate() {
        point[l.input() + i] = match q.unit.as_str() {
            "m/s" => 95.0,
            "m" => 4100.0,
            "K" => 270.0,
            "Pa" if q.name == "qbar" => 5000.0,
            "Pa" => 55000.0,
            "kg/m^3" => 0.8,
            "N" => 6000.0,
            "kg" => 20000.0,
            _ => spread(i) * 0.3,
        };
        if model.inputs[i].name == "u" {
            point[l.input() + i] = 97.0;
        }
    }
    for (i, p) in model.parameters.iter().enumerate() {
        point[l.parameter() + i] = match p.start {
            // Where friction holds a state or lets it go, its sensitivities jump; that is compared
            // in `dynamics::contact_tests`.
            _ if is_friction(p) => 0.0,
            // What goes with the airspeed is small: limits stay where they are.
            0.0 if p.quantity.unit.ends_with("s/m") || p.quantity.unit.ends_with("s^2/m^2") => {
                1e-6 * spread(i)
            }
            0.0 => 0.01 * spread(i),
            start => start,
        };
    }
    point
}

fn values(model: &Model, program: &Program, point: &[f64]) -> Vec<f64> {
    let mut file = program.registers::<1>();
    for (slot, x) in file.iter_mut().zip(point) {
        slot[0] = *x;
    }
    program.prepare(&mut file, &model.tables);
    program.run(&mut file, &model.tables);
    (0..program.outputs()).map(|k| program.output(&file, k)[0]).collect()
}

/// Largest disagreement between an exact derivative and a difference, and how many derivatives were
/// compared.
fn check(model: &Model, name: &str) -> usize {
    let mut graph = model.graph.clone();
    let rows: Vec<Node> = model.rates.iter().chain(&model.output_nodes).copied().collect();
    let at = point(model);
    let base = Program::lower(&model.graph, &rows, &model.layout);
    let mut compared = 0;
    for leaf in model.graph.leaves(&rows) {
        if matches!(leaf, Leaf::StartValue(_)) {
            continue;
        }
        let exact: Vec<Node> = rows.iter().map(|&n| graph.derivative(n, leaf)).collect();
        let exact = values(model, &Program::lower(&graph, &exact, &model.layout), &at);
        let slot = model.layout.slot(leaf);
        // a fourth-order difference, with the step that balances truncation and rounding
        let h = 1e-3 * at[slot].abs().max(1e-2);
        let shifted: Vec<Vec<f64>> = [-2.0, -1.0, 1.0, 2.0]
            .iter()
            .map(|k| {
                let mut p = at.clone();
                p[slot] += k * h;
                values(model, &base, &p)
            })
            .collect();
        for row in 0..rows.len() {
            let f = |k: usize| shifted[k][row];
            let difference = (f(0) - 8.0 * f(1) + 8.0 * f(2) - f(3)) / (12.0 * h);
            let size = (f(1).abs() + f(2).abs()) / h * 1e-11 + exact[row].abs() * 1e-6 + 1e-9;
            assert!(
                (exact[row] - difference).abs() <= size,
                "{name}: row {row} with respect to {leaf:?}: exact {} difference {difference}",
                exact[row]
            );
            compared += 1;
        }
    }
    compared
}

#[test]
fn every_derivative_of_every_shipped_model_agrees_with_differences() {
    let mut compared = 0;
    for (path, constants) in shipped().into_iter().filter(|(p, _)| !is_part(p)) {
        let model = Model::load(&path, &constants).unwrap_or_else(|e| panic!("{e}"));
        let n = check(&model, &path.to_string_lossy());
        println!("{}: {n} derivatives", path.display());
        compared += n;
    }
    assert!(compared > 1000, "only {compared} derivatives were compared");
}

/// Values and derivatives of a model as one program.
fn everything(model: &Model) -> Program {
    let mut graph = model.graph.clone();
    let mut nodes: Vec<Node> = model.rates.iter().chain(&model.output_nodes).copied().collect();
    for node in nodes.clone() {
        for leaf in model.graph.leaves(&[node]) {
            nodes.push(graph.derivative(node, leaf));
        }
    }
    Program::lower(&graph, &nodes, &model.layout)
}

#[test]
fn machine_code_and_every_vector_width_give_the_same_bits_on_every_shipped_model() {
    let mut compared = 0;
    for (path, constants) in shipped().into_iter().filter(|(p, _)| !is_part(p)) {
        let model = Model::load(&path, &constants).unwrap();
        let (program, at, width) = (everything(&model), point(&model), model.layout.time() + 1);
        // points around the smooth one, some of them on the other side of switches
        let points: Vec<Vec<f64>> =
            (0..8).map(|i| at.iter().map(|x| x * (1.0 - 0.3 * i as f64)).collect()).collect();
        let reference: Vec<Vec<f64>> = points
            .iter()
            .map(|p| values(&model, &program, &[&p[..width], &at[width..]].concat()))
            .collect();
        let mut file = program.registers::<1>();
        for (slot, x) in file.iter_mut().zip(&at) {
            slot[0] = *x;
        }
        program.prepare(&mut file, &model.tables);
        let native = Points::compile(&program, width, Width::detect()).expect("machine code");
        let mut out = vec![0.0; points.len() * program.outputs()];
        native.run(
            &file,
            &points.iter().flat_map(|p| p[..width].to_vec()).collect::<Vec<f64>>(),
            &mut out,
            &model.tables,
        );
        let same = |what: &str, i: usize, k: usize, got: f64| {
            let want = reference[i][k];
            let equal = got.to_bits() == want.to_bits() || (got.is_nan() && want.is_nan());
            assert!(
                equal,
                "{}: {what}, point {i}, output {k}: {got:e} instead of {want:e}",
                path.display()
            );
        };
        for (i, row) in out.chunks(program.outputs()).enumerate() {
            row.iter().enumerate().for_each(|(k, &got)| same("native", i, k, got));
            compared += row.len();
        }
        for &vectors in Width::available() {
            let program = program.clone().with_width(vectors);
            let mut file = program.registers::<8>();
            for (slot, register) in file.iter_mut().take(at.len()).enumerate() {
                *register =
                    std::array::from_fn(|l| if slot < width { points[l][slot] } else { at[slot] });
            }
            program.prepare(&mut file, &model.tables);
            program.run(&mut file, &model.tables);
            for k in 0..program.outputs() {
                (0..8)
                    .for_each(|l| same(&format!("{vectors:?}"), l, k, program.output(&file, k)[l]));
            }
            let Some(lanes) = Lanes::compile(&program, vectors) else { continue };
            let mut file = program.registers::<LANES>();
            for (slot, register) in file.iter_mut().take(at.len()).enumerate() {
                let of = |l: usize| if slot < width { points[l % 8][slot] } else { at[slot] };
                *register = std::array::from_fn(of);
            }
            program.prepare(&mut file, &model.tables);
            lanes.run(&mut file, &model.tables);
            for k in 0..program.outputs() {
                for (l, got) in program.output(&file, k).iter().enumerate() {
                    same(&format!("code, {vectors:?}"), l % 8, k, *got);
                }
            }
        }
    }
    assert!(compared > 5000, "only {compared} numbers were compared");
}

#[test]
fn fragments_that_stand_alone_agree_with_differences() {
    let aircraft = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/citation/aircraft.toml");
    let constants = config::load::<Constants>(&aircraft).unwrap().0;
    let mut checked = 0;
    for (name, text) in EMBEDDED {
        // a fragment may lean on names of its user; those that do are checked within the models
        // above
        if let Ok(model) = Model::parse(name, text, &constants) {
            checked += check(&model, name);
        }
    }
    assert!(checked > 100);
}

#[test]
fn sensitivities_of_every_estimation_model_agree_with_differences() {
    for (path, constants) in shipped().into_iter().filter(|(p, _)| !is_part(p)) {
        let model = Model::load(&path, &constants).unwrap();
        if model.parameters.is_empty() || model.states.is_empty() {
            continue;
        }
        let at = point(&model);
        let l = model.layout;
        let n = 40;
        let inputs = (0..n)
            .flat_map(|k| (0..l.inputs).map(move |j| (k, j)))
            .map(|(k, j)| at[l.input() + j] * (1.0 + 0.02 * libm::sin(0.3 * k as f64 + j as f64)))
            .collect();
        let record = Record { dt: 0.01, n, inputs, substeps: 4, ..Default::default() };
        let directions = Directions {
            parameters: (0..model.parameters.len()).collect(),
            starts: (0..l.states).collect(),
        };
        let propagator = Propagator::new(&model, directions).unwrap();
        let (p, x0) =
            (at[l.parameter()..l.parameter() + l.parameters].to_vec(), at[..l.states].to_vec());
        let exact = propagator.run(&p, &x0, &record, true);
        assert!(exact.finite, "{}", path.display());
        let (ny, nd) = (model.outputs.len(), p.len() + x0.len());
        let jumps = |p: &Parameter| is_friction(p) || is_limit(p);
        let smooth = |d: &usize| *d >= p.len() || !jumps(&model.parameters[*d]);
        for d in (0..nd).filter(smooth) {
            let run = |step: f64| {
                let (mut p, mut x0) = (p.clone(), x0.clone());
                if d < p.len() {
                    p[d] += step
                } else {
                    x0[d - p.len()] += step
                }
                propagator.run(&p, &x0, &record, false).y
            };
            let h = 1e-4 * if d < p.len() { p[d] } else { x0[d - p.len()] }.abs().max(1e-2);
            let (low, high) = (run(-h), run(h));
            for i in (0..n * ny).step_by(7) {
                let difference = (high[i] - low[i]) / (2.0 * h);
                let scale = exact.dy[i * nd + d].abs() * 1e-4 + exact.y[i].abs() / h * 1e-10 + 1e-8;
                assert!(
                    (exact.dy[i * nd + d] - difference).abs() < scale,
                    "{}: point {} output {} direction {d}: exact {} difference {difference}",
                    path.display(),
                    i / ny,
                    model.outputs[i % ny].name,
                    exact.dy[i * nd + d]
                );
            }
        }
    }
}

const LAG: &str = r#"
title = "A lag and a curved output"
[inputs]
u = "rad"
[parameters]
T = { unit = "s", start = 0.4 }
K = { unit = "-", start = 1.5 }
[states]
x = { unit = "rad", rate = "(K*sin(u) - x)/T", start = 0.2 }
[outputs]
y = { unit = "rad", value = "x + K*x^3" }
"#;

/// Response and sensitivities of `LAG` (or any model of its inputs) over `n` grid points.
fn swept(
    model: &Model,
    directions: Directions,
    parameters: &[f64],
    n: usize,
    substeps: usize,
) -> koehler::dynamics::Grid {
    let inputs = (0..n).map(|k| (k as f64 * 0.37).sin()).collect();
    let record = Record { dt: 0.1, n, inputs, substeps, ..Default::default() };
    Propagator::new(model, directions).unwrap().run(parameters, &[], &record, true)
}

#[test]
fn sensitivities_are_exact_however_substeps_fall_into_blocks() {
    let model = Model::parse("lag", LAG, &Constants::default()).unwrap();
    let all = || Directions { parameters: vec![0, 1], starts: Vec::new() };
    for substeps in [1, 2, 3, 5, 7, 16, 33] {
        let (p, n) = ([0.4, 1.5], 75);
        let exact = swept(&model, all(), &p, n, substeps);
        for d in 0..2 {
            let run = |step: f64| {
                swept(
                    &model,
                    all(),
                    &std::array::from_fn::<f64, 2, _>(|i| p[i] + if i == d { step } else { 0.0 }),
                    n,
                    substeps,
                )
                .y
            };
            let (up, down) = (run(1e-5), run(-1e-5));
            for k in 0..n {
                let (want, got) = ((up[k] - down[k]) / 2e-5, exact.dy[k * 2 + d]);
                assert!(
                    (got - want).abs() < 1e-7 * (1.0 + want.abs()),
                    "{substeps} sub-steps, point {k}, {d}: {got} for {want}"
                );
            }
        }
    }
}

#[test]
fn fault_records_and_models_of_next_to_nothing_are_run_all_the_same() {
    let lag = Model::parse("lag", LAG, &Constants::default()).unwrap();
    let text = "title = \"No state\"\n[inputs]\nu = \"rad\"\n[parameters]\nK = { unit = \"-\", start = 2.0 }\n[outputs]\ny = { unit = \"rad\", value = \"K*u\" }\n";
    let algebra = Model::parse("algebra", text, &Constants::default()).unwrap();
    for n in [0, 1, 2, 17] {
        for parameters in [vec![], vec![0]] {
            let directions = || Directions { parameters: parameters.clone(), starts: Vec::new() };
            for (model, values) in [(&lag, &[0.4, 1.5][..]), (&algebra, &[2.0][..])] {
                let grid = swept(model, directions(), values, n, 1);
                assert_eq!(
                    (grid.finite, grid.y.len(), grid.dy.len()),
                    (true, n, n * parameters.len()),
                    "{n} {parameters:?}"
                );
            }
        }
    }
}

#[test]
fn opened_constants_are_the_same_model_with_derivatives() {
    let mut opened_constants = 0;
    for (path, constants) in shipped().into_iter().filter(|(p, _)| !is_part(p)) {
        let name = path.to_string_lossy().into_owned();
        let model = Model::load(&path, &constants).unwrap();
        let opened = model.opened().unwrap();
        let uncertain: Vec<_> = model.constants.iter().filter(|c| c.sd > 0.0).collect();
        let behind: Vec<&str> = opened.parameters[model.parameters.len()..]
            .iter()
            .map(|p| p.quantity.name.as_str())
            .collect();
        assert_eq!(
            behind,
            uncertain.iter().map(|c| c.quantity.name.as_str()).collect::<Vec<_>>(),
            "{name}"
        );
        check(&opened, &name);
        // The opened model at other constants is the model compiled with them.
        let rows =
            |m: &Model| m.rates.iter().chain(&m.output_nodes).copied().collect::<Vec<Node>>();
        let mut at = point(&opened);
        let mut shifted = constants.clone();
        for (k, c) in uncertain.iter().enumerate() {
            let value = c.value + 0.3 * c.sd;
            at[opened.layout.parameter() + model.parameters.len() + k] = value;
            let (unit, source) = (c.quantity.unit.clone(), String::new());
            shifted.0.insert(
                c.quantity.name.clone(),
                koehler::model::Given { value, unit, sd: c.sd, source, origin: None },
            );
        }
        let folded = Model::load(&path, &shifted).unwrap();
        let of_folded = values(
            &folded,
            &Program::lower(&folded.graph, &rows(&folded), &folded.layout),
            &at[..folded.layout.len()],
        );
        let of_opened =
            values(&opened, &Program::lower(&opened.graph, &rows(&opened), &opened.layout), &at);
        for (a, b) in of_folded.iter().zip(&of_opened) {
            assert!((a - b).abs() <= 1e-9 * (a.abs() + 1.0), "{name}: {a} {b}");
        }
        opened_constants += uncertain.len();
    }
    assert!(opened_constants > 30, "{opened_constants}");
}

#[test]
fn an_opened_constant_may_stand_in_an_exponent() {
    let text = r#"
title = "A power"
[constants]
n = { value = 1.5, unit = "-", sd = 0.1 }
[inputs]
u = "-"
[outputs]
y = { unit = "-", value = "u^(n + 1)" }
"#;
    let opened = Model::parse("power", text, &Constants::default()).unwrap().opened().unwrap();
    let mut graph = opened.graph.clone();
    let slope = graph.derivative(opened.output_nodes[0], Leaf::Parameter(0));
    let mut at = vec![0.0; opened.layout.len()];
    at[opened.layout.input()] = 2.0;
    at[opened.layout.parameter()] = 1.5;
    let program = Program::lower(&graph, &[opened.output_nodes[0], slope], &opened.layout);
    let [y, dy] = values(&opened, &program, &at)[..] else { panic!("two values") };
    assert!(
        (y - 2f64.powf(2.5)).abs() < 1e-12 && (dy - 2f64.powf(2.5) * 2f64.ln()).abs() < 1e-12,
        "{y} {dy}"
    );
}
