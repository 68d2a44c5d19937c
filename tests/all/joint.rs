//! The joint fit of the Citation's hinge-moment lines against the lines through the estimates per
//! maneuver, and both against the truth, on one short flight.

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
}
