//! The joint fit of the Citation's hinge-moment lines against the lines through the estimates per
//! maneuver, and both against the truth, on one short flight; and what a wrong prior of friction
//! does to them.

use crate::flightdata::{copy, koehler};
use koehler::table::{Table, read_dataset};

/// Citation Eqs. 8 to 11, 14: slope and intercept.
const LINES: [(&str, f64, f64); 5] = [
    ("C_h_delta", -0.3717, -0.3189),
    ("C_h_deltadot", -0.094, -0.017),
    ("C_h_alpha", -0.4229, -0.0107),
    ("C_h_alphadot", -0.0333, -0.0072),
    ("C_h_0", -0.39, 0.0216),
];

const FLIGHT: &str = r#"[flights.flight-1]
altitude_ft = 17000.0
points = [
  { speed_kt = 160.0, maneuvers = ["lateral", "longitudinal"] },
  { speed_kt = 140.0, maneuvers = ["longitudinal"] },
  { speed_kt = 120.0, maneuvers = ["longitudinal"] },
  { speed_kt = 200.0, maneuvers = ["longitudinal"] },
  { speed_kt = 240.0, maneuvers = ["longitudinal"] },
]

"#;

/// Value and sd of a campaign parameter of the joint fit.
fn joint(estimates: &Table, parameter: &str) -> (f64, f64) {
    let text = |name: &str| estimates.strings(name).expect("a column");
    let row = (0..estimates.rows())
        .find(|i| text("model")[*i] == "elevator-lines" && text("parameter")[*i] == parameter)
        .unwrap_or_else(|| panic!("no {parameter}"));
    assert_eq!(text("stop")[row], "converged");
    let number = |name: &str| estimates.f64(name).expect("a column")[row];
    (number("value"), number("sd"))
}

/// Root mean square of the errors of a coefficient's points, in sd of the points of `honest`.
fn error(points: &Table, honest: &Table, (name, slope, intercept): (&str, f64, f64)) -> f64 {
    let rows = |table: &Table| -> Vec<usize> {
        let text = |column: &str| table.strings(column).expect("a column");
        let is_mine = |i: &usize| text("parameter")[*i] == name && text("against")[*i] == "alpha";
        (0..table.rows()).filter(is_mine).collect()
    };
    let number = |table: &Table, column: &str, i: usize| table.f64(column).expect("a column")[i];
    let (mine, theirs) = (rows(points), rows(honest));
    assert!(mine.len() == 5 && theirs.len() == 5, "five maneuvers, {name}");
    let square = |(&i, &k): (&usize, &usize)| {
        let truth = slope * number(points, "x", i) + intercept;
        ((number(points, "value", i) - truth) / number(honest, "sd", k)).powi(2)
    };
    (mine.iter().zip(&theirs).map(square).sum::<f64>() / 5.0).sqrt()
}

/// Friction of the estimates per maneuver, N.
fn friction(out: &std::path::Path) -> Vec<f64> {
    let estimates = read_dataset(out, "estimates").expect("estimates");
    let text = |column: &str| estimates.strings(column).expect("a column");
    let is_mine = |i: &usize| text("model")[*i] == "elevator" && text("parameter")[*i] == "F_c";
    let value = estimates.f64("value").expect("a column");
    (0..estimates.rows()).filter(is_mine).map(|i| value[i]).collect()
}

/// Figures are drawn of maneuvers that this flight does not have.
fn without_figures(pipeline: &str) -> String {
    let mut figure = false;
    let keep = |line: &&str| {
        figure = if line.starts_with('[') { *line == "[[figure]]" } else { figure };
        !figure
    };
    pipeline.lines().filter(keep).map(|line| format!("{line}\n")).collect()
}

#[test]
fn recovery_of_the_elevators_lines_in_one_fit_of_all_maneuvers() {
    let folder = copy("citation");
    let (campaign, pipeline) =
        (folder.path().join("campaign.toml"), folder.path().join("pipeline.toml"));
    let text = std::fs::read_to_string(&campaign).expect("readable");
    let (before, rest) = text.split_once("# lateral inputs of both").expect("the flights");
    let (_, recorder) = rest.split_once("# --- the recorder").expect("the recorder");
    std::fs::write(&campaign, format!("{before}{FLIGHT}# --- the recorder{recorder}"))
        .expect("written");
    let text = std::fs::read_to_string(&pipeline).expect("readable");
    let (analysis, _) = text.split_once("# --- two parabolas").expect("the validation");
    let analysis = without_figures(&analysis.replace("except = [\"flight-4\"]\n", ""));
    std::fs::write(&pipeline, analysis).expect("written");

    koehler(folder.path(), folder.path(), &["run", "pipeline.toml"]);
    let out = folder.path().join("out");
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    let fits = read_dataset(&out, "fits").expect("fits");
    for (name, slope, intercept) in LINES {
        let text = |column: &str| fits.strings(column).expect("a column");
        let row = (0..fits.rows())
            .find(|i| text("parameter")[*i] == name && text("against")[*i] == "alpha")
            .expect("a line");
        for (term, truth, parameter) in [
            ("slope", slope, format!("{name}_slope")),
            ("intercept", intercept, format!("{name}_0")),
        ] {
            let number = |column: &str| fits.f64(column).expect("a column")[row];
            let (two_step, its_sd) = (number(term), number(&format!("{term}_sd")));
            let (value, sd) = joint(&estimates, &parameter);
            println!(
                "{parameter}: {value} +- {sd}, two steps {two_step} +- {its_sd}, truth {truth}"
            );
            assert!((value - truth).abs() < 4.0 * sd, "{parameter}: {value} +- {sd}, {truth}");
            assert!(
                (value - two_step).abs() < 3.0 * its_sd.max(sd),
                "{parameter}: {value}, in two steps {two_step} +- {its_sd}"
            );
        }
    }

    // What one maneuver tells to worse than 5 % (the default of `poor`) is called poor.
    let relative = fits.f64("relative_sd").expect("a column");
    let poor = fits.bools("poor").expect("a column");
    let is_poor = |name: &str| {
        let row = fits.strings("parameter").expect("a column").iter().position(|p| *p == name);
        poor[row.expect("a line")]
    };
    assert!((0..fits.rows()).all(|i| poor[i] == (relative[i] > 0.05)));
    assert!(is_poor("C_h_alphadot") && !is_poor("C_h_delta"));

    // The friction of the ground test with its sd for a prior: vibration in flight lowers friction,
    // and such a prior is not overruled.
    let honest = read_dataset(&out, "points").expect("points");
    assert!(friction(&out).iter().all(|f| (f - 10.0).abs() < 3.0), "{:?}", friction(&out));
    let model = folder.path().join("elevator.model.toml");
    let text = std::fs::read_to_string(&model).expect("readable");
    let ground =
        text.replace("start = 15.0, min = 0.0, sd = 7.5", "start = 30.0, min = 0.0, sd = 0.34");
    assert_ne!(text, ground);
    std::fs::write(&model, ground).expect("written");
    koehler(folder.path(), folder.path(), &["run", "pipeline.toml"]);
    assert!(friction(&out).iter().all(|f| *f > 20.0), "{:?}", friction(&out));
    let biased = read_dataset(&out, "points").expect("points");
    for line in LINES.iter().filter(|line| line.0 != "C_h_0") {
        let (before, after) = (error(&honest, &honest, *line), error(&biased, &honest, *line));
        println!("{}: off by {before:.1} sd, with the ground's prior by {after:.1} sd", line.0);
        assert!(before < 2.5 && after > 5.0, "{}: {before} and {after} sd", line.0);
    }
}
