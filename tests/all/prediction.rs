//! A file that predicts what an estimate finds: what of it is beyond the band, what is flown and not predicted, and what
//! is said of a file that is wrong?

use crate::campaign::Campaign;
use crate::delays;
use koehler::table::{Table, read_dataset};

const DEG: f64 = std::f64::consts::PI / 180.0;

const MODEL: &str = r#"
title = "First-order system behind a delay, and where it comes to rest"

[inputs]
u = "rad"

[constants]
scale = { unit = "-", value = 1.0, sd = 0.01 }

[parameters]
K = { unit = "-", start = 1.0 }
T = { unit = "s", start = 0.3, min = 0.01 }
tau = { unit = "s", start = 0.05, min = 0.0, max = 0.3 }

[states]
x = { unit = "rad", rate = "(scale*K*delay(u, tau) - x)/T", start = 0.0 }

[equations]
steady = "K*u"

[outputs]
y = { unit = "rad", value = "x" }
"#;

const CURVE: &str = r#"
[[curve]]
estimate   = "late"
equations  = ["steady"]
unit       = "rad"
along      = "u"
range      = [-0.04, 0.04]
prediction = "predicted.csv"

[[figure]]
name   = "steady"
title  = "Where it comes to rest"
series = [
  { table = "curves", x = "x", y = "value", ends = ["simultaneous_lower", "simultaneous_upper"], joined = true, label = "flight" },
  { table = "predictions", x = "x", y = "predicted", label = "predicted" },
  { table = "unpredicted", x = "from", y = "to", strips = true, label = "flown, not predicted" },
]

[report]
"#;

/// The gain is 1.5, if the scale is right, and 2 deg are flown either way.
fn campaign(predicted: &str) -> Campaign {
    let c = delays::campaign(10);
    c.write("lag.model.toml", MODEL);
    c.write("predicted.csv", predicted);
    let pipeline = std::fs::read_to_string(c.path("pipeline.toml")).expect("the pipeline");
    c.write("pipeline.toml", &(pipeline + CURVE));
    c
}

fn table(c: &Campaign, name: &str) -> Table {
    read_dataset(&c.path("out"), name).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn what_is_predicted_wrongly_is_beyond_the_band_and_what_is_not_predicted_is_shaded() {
    let c = campaign("u [deg], steady [deg]\n-1, -1.5\n0, 0\n1, 1.5\n2.5, 4\n");
    let run = c.run().ended(0);
    let told = table(&c, "predictions");
    assert_eq!(told.bools("beyond").expect("flags"), [false, false, false, true]);
    assert_eq!(told.bools("flown").expect("flags"), [true, true, true, false]);
    let off = told.f64("difference").expect("numbers")[3] / DEG;
    assert!((off - (1.5 * 2.5 - 4.0)).abs() < 0.02, "{off}");
    // an error of the scale of 1% is one of the gain
    let of = |name: &str| told.f64(name).expect("numbers")[2] / DEG;
    println!("{} +- {} with constants {}", of("value"), of("sd"), of("sd_total"));
    assert!((of("sd_total") - 0.015).abs() < 1e-3 && of("sd") < 1e-3);
    let shaded = table(&c, "unpredicted");
    let ends = ["from", "to"].map(|end| shaded.f64(end).expect("numbers").to_vec());
    assert!(ends[0].len() == 1 && (ends[0][0] / DEG + 2.0).abs() < 0.05, "{ends:?}");
    assert!((ends[1][0] / DEG + 1.0).abs() < 1e-9, "{ends:?}");
    let figures = table(&c, "figures");
    assert!(figures.strings("kind").expect("texts").contains(&"strips"));
    assert!(run.out.contains("what is beyond is not compared"), "{}", run.out);
    let page = std::fs::read_to_string(c.path("out/report/index.html")).expect("the page");
    assert!(page.contains("Predicted and flown"));
}

#[test]
fn fault_a_prediction_of_what_is_not_there_or_in_another_unit_is_told_with_its_line() {
    let c = campaign("# a tunnel's\nu [m/s], stedy [deg]\n0, 0\n");
    let run = c.run().ended(2);
    for part in [
        "predicted.csv:2:1: column \"u\" is in m/s, in the model it is in rad",
        "column \"stedy\" is neither input, equation nor condition of the curve",
        "did you mean \"steady\"?",
    ] {
        assert!(run.err.contains(part), "{part}: {}", run.err);
    }
}

#[test]
fn fault_an_input_that_is_misspelt_is_told_once() {
    let c = campaign("u [deg], steady [deg]\n0, 0\n");
    let pipeline = std::fs::read_to_string(c.path("pipeline.toml")).expect("the pipeline");
    c.write("pipeline.toml", &pipeline.replace("along      = \"u\"", "along      = \"uu\""));
    let run = c.run().ended(2);
    assert!(run.err.contains("there is no input of the model \"uu\""), "{}", run.err);
    assert!(!run.err.contains("depend on"), "{}", run.err);
}
