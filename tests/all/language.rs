//! The reference page of the model language: every example compiles, has exact sensitivities, and
//! gives the number it says.

use koehler::dynamics::{Directions, Propagator, Record};
use koehler::model::{Constants, Model};

/// The complete models of the page, in order.
fn examples() -> Vec<String> {
    let page = include_str!("../../docs/model-language.md");
    let blocks = page.split("```toml\n").skip(1).filter_map(|b| b.split("```").next());
    blocks.filter(|b| b.contains("title")).map(str::to_string).collect()
}

/// `# check: u = 1, v = t: y(0.5) = 2` as inputs, output, time, value.
fn check_line(text: &str) -> (Vec<(String, String)>, String, f64, f64) {
    let line = text
        .lines()
        .find_map(|l| l.strip_prefix("# check: "))
        .expect("an example without a check line");
    let (inputs, claim) = line.split_once(": ").unwrap_or(("", line));
    let inputs = inputs
        .split(", ")
        .filter_map(|p| p.split_once(" = "))
        .map(|(n, v)| (n.to_string(), v.to_string()))
        .collect();
    let (left, value) = claim.split_once(" = ").unwrap();
    let (output, time) = left.split_once('(').unwrap();
    (
        inputs,
        output.to_string(),
        time.trim_end_matches(')').parse().unwrap(),
        value.parse().unwrap(),
    )
}

fn record(model: &Model, inputs: &[(String, String)], duration: f64) -> Record {
    let dt = 0.005;
    let n = (duration / dt).round() as usize + 2;
    let value = |name: &str, t: f64| {
        let text = &inputs
            .iter()
            .find(|(n, _)| n == name)
            .unwrap_or_else(|| panic!("no value for input {name}"))
            .1;
        if text == "t" { t } else { text.parse().unwrap() }
    };
    let rows = (0..n)
        .flat_map(|k| model.inputs.iter().map(move |i| (i.name.clone(), k as f64 * dt)))
        .map(|(i, t)| value(&i, t))
        .collect();
    Record { dt, n, inputs: rows, ..Default::default() }
}

#[test]
fn every_example_gives_the_number_it_says() {
    let examples = examples();
    assert!(examples.len() >= 11, "only {} examples were found", examples.len());
    for text in examples {
        let model = Model::parse("example", &text, &Constants::default())
            .unwrap_or_else(|e| panic!("{e}\n{text}"));
        let (inputs, output, time, wanted) = check_line(&text);
        let record = record(&model, &inputs, time);
        let propagator = Propagator::new(&model, Directions::default()).unwrap();
        let parameters = model.parameter_starts();
        let given = propagator.first_values(&model, &parameters, &record, &record).unwrap();
        let grid = propagator.run(&parameters, &given, &record, false);
        let at = (time / record.dt).round() as usize;
        let got = grid.y[at * model.outputs.len() + model.output(&output).unwrap()];
        // as exact as the number of digits on the page
        assert!(
            (got - wanted).abs() <= 2e-6 * wanted.abs().max(1e-3),
            "{}: {output}({time}) is {got}, the page says {wanted}",
            model.title
        );
    }
}

#[test]
fn every_example_has_exact_sensitivities() {
    for text in examples() {
        let model = Model::parse("example", &text, &Constants::default()).unwrap();
        let (inputs, _, _, _) = check_line(&text);
        // away from the switches that the numbers on the page sit on, and with delays well inside
        // the record
        let record = record(&model, &inputs, 0.43);
        let directions = Directions {
            parameters: (0..model.parameters.len()).collect(),
            starts: (0..model.states.len()).collect(),
        };
        let propagator = Propagator::new(&model, directions).unwrap();
        // a little off the round numbers, so that no switch falls on a grid point
        let p: Vec<f64> = model.parameter_starts().iter().map(|v| v * 1.0037).collect();
        let x0: Vec<f64> = propagator.first_values(&model, &p, &record, &record).unwrap();
        let exact = propagator.run(&p, &x0, &record, true);
        let nd = p.len() + x0.len();
        for d in 0..nd {
            let run = |step: f64| {
                let (mut p, mut x0) = (p.clone(), x0.clone());
                if d < p.len() {
                    p[d] += step
                } else {
                    x0[d - p.len()] += step
                }
                propagator.run(&p, &x0, &record, false).y
            };
            let h = 1e-5 * if d < p.len() { p[d] } else { x0[d - p.len()] }.abs().max(1e-2);
            let (low, high) = (run(-h), run(h));
            for i in 0..exact.y.len() {
                let difference = (high[i] - low[i]) / (2.0 * h);
                let bound = 2e-5 * exact.dy[i * nd + d].abs() + 1e-7 + exact.y[i].abs() / h * 1e-12;
                assert!(
                    (exact.dy[i * nd + d] - difference).abs() < bound,
                    "{}: value {i}, direction {d}: exact {} difference {difference}",
                    model.title,
                    exact.dy[i * nd + d]
                );
            }
        }
    }
}

/// What came before the record was like its first point.
#[test]
fn a_lag_of_a_past_value_starts_at_rest() {
    let lag = "title = \"t\"\n[inputs]\nu = \"-\"\n[parameters]\ntau = { unit = \"s\", start = 0.1 }\nT = { unit = \"s\", start = 0.5 }\none = { unit = \"-\", start = 1.0 }\n\
               [outputs]\ny = { unit = \"-\", value = \"lag(delay(u, tau) + smooth(u, tau, one), T)\" }";
    let model = Model::parse("lag", lag, &Constants::default()).expect("a model");
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let record = record(&model, &[("u".to_string(), "3.0".to_string())], 1.0);
    let y = propagator.run(&model.parameter_starts(), &[], &record, false).y;
    assert!(y.iter().all(|y| (y - 6.0).abs() < 1e-12), "{y:?}");
}

/// A rate limit that grows with airspeed: on it `x = r_0 t + r_1 t^2/2` for `V = t`.
#[test]
fn a_rate_limit_may_move() {
    let text = r#"title = "A rate limit that moves"
[inputs]
u = "rad"
V = "s"
[constants]
T = { unit = "s", value = 0.1 }
[parameters]
r_0 = { unit = "rad/s", start = 0.1 }
r_1 = { unit = "rad/s^2", start = 0.05 }
[states]
x = { unit = "rad", rate = "(u - x)/T", start = 0.0, rate_max = "r_0 + r_1*V" }
[outputs]
x = { unit = "rad", value = "x" }
"#;
    let model =
        Model::parse("moving", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
    let directions = Directions { parameters: vec![0, 1], starts: Vec::new() };
    let propagator = Propagator::new(&model, directions).expect("a propagator");
    let (dt, n) = (0.01, 101);
    let inputs = (0..n).flat_map(|k| [1.0, dt * k as f64]).collect();
    let record = Record { dt, n, inputs, ..Record::default() };
    let grid = propagator.run(&[0.1, 0.05], &[], &record, true);
    for k in 0..n {
        let t = dt * k as f64;
        let wanted = [0.1 * t + 0.025 * t * t, t, 0.5 * t * t];
        let got = [grid.y[k], grid.dy[2 * k], grid.dy[2 * k + 1]];
        assert!(wanted.iter().zip(got).all(|(a, b)| (a - b).abs() < 1e-12), "{t}: {got:?}");
    }
}

/// Stops and a fastest velocity, written into the lines or put there by an effect: the same motion and the same derivatives.
#[test]
fn limits_by_an_effect_are_those_of_a_line() {
    let model = |position: &str, velocity: &str, effect: &str| {
        let text = format!(
            r#"title = "A surface with stops"
[inputs]
u = "rad"
[constants]
w = {{ unit = "1/s", value = 8.0 }}
[parameters]
stop = {{ unit = "rad", start = 0.8 }}
fastest = {{ unit = "rad/s", start = 3.0 }}
[states]
x = {{ unit = "rad", rate = "v", start = 0.0{position} }}
v = {{ unit = "rad/s", rate = "w^2*(u - x) - w*v", start = 0.0{velocity} }}
[outputs]
x = {{ unit = "rad", value = "x" }}
v = {{ unit = "rad/s", value = "v" }}
{effect}"#
        );
        Model::parse("stops", &text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"))
    };
    let own = model(", min = \"-stop/2\", max = \"stop\"", ", max = \"fastest\"", "");
    let effect = "[[effect]]\ntitle = \"stops\"\n[effect.replace]\n\"min(x)\" = \"-stop/2\"\n\"max(x)\" = \"stop\"\n\"max(v)\" = \"fastest\"\n";
    let added = model("", "", effect);
    // one that reads what was there before it
    let moved = "[[effect]]\ntitle = \"further\"\n[effect.replace]\n\"min(x)\" = \"-stop/2\"\n[effect.add]\n\"max(x)\" = \"stop - 7.0\"\n";
    let moved = model(", min = -5.0, max = 7.0", ", max = \"fastest\"", moved);
    let (dt, n) = (0.01, 300);
    let u = |k: usize| if (k / 100).is_multiple_of(2) { 1.2 } else { -1.2 };
    let record = Record { dt, n, inputs: (0..n).map(u).collect(), ..Record::default() };
    let run = |model: &Model| {
        let directions = Directions { parameters: vec![0, 1], starts: Vec::new() };
        let propagator = Propagator::new(model, directions).expect("a propagator");
        let grid = propagator.run(&[0.8, 3.0], &[], &record, true);
        (grid.y, grid.dy)
    };
    let wanted = run(&own);
    let most = |i: usize| wanted.0.iter().skip(i).step_by(2).copied().fold(f64::MIN, f64::max);
    assert!((most(0) - 0.8).abs() < 1e-9 && (most(1) - 3.0).abs() < 1e-9, "both are reached");
    assert_eq!(run(&added), wanted);
    let off = run(&moved).0.iter().zip(&wanted.0).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-9, "{off}");
}

/// The message for a model with one mistake.
fn message(text: &str) -> String {
    Model::parse("m.model.toml", text, &Constants::default())
        .expect_err("the mistake went unnoticed")
        .to_string()
}

const HEAD: &str = "title = \"t\"\n[inputs]\nV = \"m/s\"\nrho = \"kg/m^3\"\n[outputs]\ny = { unit = \"-\", value = \"1.0\" }\n";

#[test]
fn mistakes_are_named_with_line_and_column() {
    let with = |rest: &str| message(&format!("{HEAD}{rest}"));
    for (text, wanted) in [
        ("[equations]\na = \"V + rho\"", "m.model.toml:8:10: kg/m^3 cannot be added to m/s"),
        (
            "[equations]\na = \"2*Vv\"",
            "m.model.toml:8:8: unknown name \"Vv\"\n    did you mean \"V\"?",
        ),
        (
            "[equations]\na = \"b\"\nb = \"a\"",
            "depends on itself: a -> b -> a\n    an equation cannot need its own value: solve for it by hand, or make one of them a state",
        ),
        (
            "[equations]\na = \"sin(V)\"",
            "m.model.toml:8:10: sin() takes a number without unit (or rad), this one is in m/s",
        ),
        ("[equations]\na = \"sine(V)\"", "unknown function \"sine\"\n    did you mean \"sin\"?"),
        ("[equations]\na = \"atan2(V)\"", "atan2(y, x) is wanted, 1 argument(s) are there"),
        ("[equations]\na = \"V^rho\"", "an exponent has no unit"),
        ("[equations]\na = \"(V\"", "m.model.toml:8:8: \")\" is wanted"),
        ("[equations]\nV = \"1.0\"", "\"V\" is already declared at m.model.toml:3:1"),
        ("[equations]\nsin = \"1.0\"", "\"sin\" is a function"),
        (
            "[equations]\na = \"delay(rate(V), t)\"",
            "m.model.toml:8:12: delay() of a delayed value or of a rate is not available",
        ),
        (
            "[equations]\na = \"slope(V, 2*V)\"",
            "slope() and without() take an input, a state or a parameter here",
        ),
        ("[equations]\na = \"output(z)\"", "there is no output \"z\""),
        (
            "[[effect]]\ntitle = \"e\"\n[effect.add]\nW = \"V\"",
            "m.model.toml:10:6: there is no W to add to",
        ),
        (
            "[[effect]]\ntitle = \"e\"\n[effect.add]\nV = \"rho\"",
            "m.model.toml:10:6: kg/m^3 cannot be added to m/s",
        ),
        (
            "[[effect]]\ntitle = \"e\"\n[effect.replace]\n\"rate(V)\" = \"1.0\"",
            "there is no rate(V) to replace",
        ),
        ("[equations]\na = \"delay(V, rho)\"", "a delay must be in s"),
        (
            "[equations]\na = \"smooth(V, t, V)\"",
            "the reach and the width of smooth() cannot change during a record",
        ),
        ("[equations]\na = \"smooth(V^2/V, t, V + rho)\"", "kg/m^3 cannot be added to m/s"),
        (
            "[equations]\na = \"smooth(V*rho, t, V*rho)\"",
            "smooth() is of one input in the unit of its width",
        ),
        ("[equations]\na = \"smooth(V, t, rho)\"", "kg/m^3 cannot be compared with m/s"),
        ("[equations]\na = \"table(nil, V)\"", "unknown table \"nil\""),
        (
            "[constants]\nk = \"deg\"",
            "unit \"deg\" is not a coherent SI unit\n    models are in SI: use rad",
        ),
        (
            "[constants]\nk = \"N m\"\n[equations]\na = \"k*2\"",
            "constant \"k\" has no value\n    add to the aircraft file: k =",
        ),
        ("[constants]\nk = \"furlong\"", "\"furlong\" is not a known unit"),
        (
            "[states]\nx = { unit = \"m\", rate = \"rho\", start = 0.0 }",
            "the rate must be in m/s, the expression is in kg/m^3",
        ),
        ("[states]\nx = { unit = \"m\", rat = \"V\", start = 0.0 }", "m.model.toml:8:19: "),
        (
            "[states]\nx = { unit = \"m/s\", rate = \"V/t\", start = 0.0, max = \"rate(V)*t\" }",
            "max is a number or an expression of inputs, states, constants and parameters: no rates",
        ),
        (
            "[states]\nx = { unit = \"m\", rate = \"V\", start = 0.0, max = \"z\" }\nz = { unit = \"m\", rate = \"V\", start = 0.0, min = \"x\" }",
            "the limits of \"x\", \"z\" depend on each other, or on themselves",
        ),
        (
            "[states]\nx = { unit = \"m/s\", rate = \"V/t\", start = 0.0, friction = -1.0 }",
            "m.model.toml:8:59: friction is -1, and it cannot be negative",
        ),
        (
            "[states]\nx = { unit = \"m/s\", rate = \"V/t\", start = 0.0, friction = \"V\" }",
            "friction must be in m/s^2, the expression is in m/s",
        ),
        (
            "[states]\nx = { unit = \"m/s\", rate = \"V/t\", start = 0.0, friction = 1.0, rate_max = 2.0 }",
            "\"x\" has friction and a rate_max: one of them",
        ),
        (
            "[states]\nx = { unit = \"m/s\", rate = \"V/t\", start = 0.0, friction = 1.0, friction = 2.0 }",
            "duplicate key",
        ),
        (
            "[states]\nv = { unit = \"m/s\", rate = \"V/t\", start = 0.0 }\nx = { unit = \"m\", rate = \"v\", start = 0.0, max = 1.0 }\nz = { unit = \"m\", rate = \"v\", start = 0.0, max = 1.0 }",
            "the stops of \"x\" and \"z\" would both hold \"v\"",
        ),
        (
            "[[effect]]\ntitle = \"e\"\n[effect.add]\n\"friction(V)\" = \"1.0\"",
            "there is no friction(V) to add to",
        ),
        (
            "[states]\nx = { unit = \"m/s\", rate = \"V/t\", start = 0.0, max = 1.0 }\n[[effect]]\ntitle = \"e\"\n[effect.add]\n\"min(x)\" = \"V\"",
            "there is no min(x) to add to",
        ),
        (
            "[states]\nx = { unit = \"m/s\", rate = \"V/t\", start = 0.0 }\n[[effect]]\ntitle = \"e\"\n[effect.replace]\n\"max(x)\" = \"V/t\"",
            "put in place of",
        ),
        (
            "[parameters]\np = { unit = \"-\", start = 2.0, max = 1.0 }",
            "starts at 2 outside its bounds",
        ),
        (
            "[tables]\nT = { x = [1.0, 0.0], unit_x = \"-\", y = [1.0, 2.0], unit_y = \"-\" }",
            "break points must ascend",
        ),
        ("[trim]\nfree = [\"W\"]\nzero = []", "unknown name \"W\""),
    ] {
        let got = with(text);
        assert!(got.contains(wanted), "for\n{text}\nwanted: {wanted}\ngot:    {got}");
    }
    assert!(
        message("use = [\"nothing\"]\ntitle = \"t\"").contains("there is no fragment \"nothing\"")
    );
}

#[test]
fn all_mistakes_of_a_model_come_at_once() {
    let text = message(&format!(
        "{HEAD}[equations]\na = \"V + rho\"\nb = \"unknown_name*2\"\nc = \"sin(\""
    ));
    assert_eq!(text.lines().filter(|l| l.starts_with("m.model.toml:")).count(), 3, "{text}");
}

#[test]
fn damaged_models_end_in_messages_never_in_a_panic() {
    use rand::{RngExt, SeedableRng};
    let mut random = rand_pcg::Pcg64::seed_from_u64(3211);
    let pieces = [
        "(",
        ")",
        "^",
        "0",
        "delay(",
        "rate(",
        "\"",
        "]",
        "{ ",
        "-",
        "lag(x, T)",
        "1e999",
        "\n",
        "[states]\n",
        "unit",
        "€",
    ];
    let (mut refused, mut runs) = (0, 0);
    for text in examples() {
        for _ in 0..200 {
            let mut damaged: Vec<char> = text.chars().collect();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..damaged.len());
                let end = (at + random.random_range(0..8)).min(damaged.len());
                damaged.splice(at..end, pieces[random.random_range(0..pieces.len())].chars());
            }
            let damaged: String = damaged.into_iter().collect();
            match Model::parse("damaged", &damaged, &Constants::default()) {
                Err(errors) => refused += usize::from(!errors.is_empty()),
                // what still compiles also runs
                Ok(model) => {
                    let n = 20;
                    let record = Record {
                        dt: 0.01,
                        n,
                        inputs: vec![0.5; n * model.inputs.len()].into(),
                        ..Default::default()
                    };
                    let directions = Directions {
                        parameters: (0..model.parameters.len()).collect(),
                        starts: vec![],
                    };
                    if let Ok(propagator) = Propagator::new(&model, directions) {
                        let given = vec![0.1; propagator.given().len()];
                        propagator.run(&model.parameter_starts(), &given, &record, true);
                        runs += 1;
                    }
                }
            }
        }
    }
    println!("{refused} refused, {runs} ran");
    assert!(refused > 500 && runs > 100);
}
