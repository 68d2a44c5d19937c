//! The published HFB-320 record through import, segmentation and estimation: do the pipelines'
//! numbers agree with the book's?

use crate::flightdata::{copy, data, koehler};
use koehler::table::{Table, read_dataset};

/// Case A (start values fixed, 5 iterations) with exact derivatives, and column C (start values
/// free), in the model's order.
const PUBLISHED: [(&str, f64, f64); 11] = [
    ("CD0", 0.1177578, 0.1125395),
    ("CDV", -0.05174587, -0.04768777),
    ("CDa", 0.2348461, 0.2447409),
    ("CL0", -0.204704, -0.1597412),
    ("CLV", 0.3635435, 0.3095857),
    ("CLa", 3.212316, 3.334696),
    ("Cm0", 0.1344113, 0.1275463),
    ("CmV", -0.01390299, -0.006643834),
    ("Cma", -1.002411, -1.010456),
    ("Cmq", -27.05712, -26.89114),
    ("Cmde", -1.437067, -1.450267),
];

fn values<'t>(estimates: &'t Table, model: &str, parameter: &str) -> (f64, f64, &'t str) {
    let (models, parameters) = (
        estimates.strings("model").expect("column"),
        estimates.strings("parameter").expect("column"),
    );
    let row = (0..estimates.rows())
        .find(|i| models[*i] == model && parameters[*i] == parameter)
        .expect("a row");
    let number = |name: &str| estimates.f64(name).expect("column")[row];
    (number("value"), number("sd"), estimates.strings("stop").expect("column")[row])
}

#[test]
fn truth_hfb320_from_text_columns_to_estimates() {
    let Some(data) = data("hfb320/hfb320_1_10.asc") else { return };
    let folder = copy("hfb320");
    koehler(folder.path(), &data, &["import", "import.toml"]);
    koehler(folder.path(), &data, &["run", "pipeline.toml"]);

    let out = folder.path().join("out");
    let segments = read_dataset(&out, "segments").expect("segments");
    let kinds = segments.strings("kind").expect("column");
    let (start, end) = (
        segments.f64("t_start_s").expect("column")[0],
        segments.f64("t_end_s").expect("column")[0],
    );
    assert_eq!(kinds[0], "3211");
    assert!((start - 4.6).abs() < 0.3 && (end - 11.7).abs() < 0.3, "{start}..{end}");

    let estimates = read_dataset(&out, "estimates").expect("estimates");
    for (parameter, case_a, column_c) in PUBLISHED {
        for (model, published) in [("fixed-start", case_a), ("free-start", column_c)] {
            let (value, sd, stop) = values(&estimates, model, parameter);
            println!("{model} {parameter}: {value} for {published}, sd {sd}, {stop}");
            assert_eq!(stop, "converged");
            assert!(
                ((value - published) / published).abs() < 1e-4,
                "{model} {parameter}: {value} for {published}"
            );
        }
    }
}
