//! The published ATTAS records from MAT files to estimates: do the pipelines' numbers agree with
//! the book's?

use crate::flightdata::{copy, data, koehler};
use koehler::table::read_dataset;

/// Short period over two maneuvers: parameter; published value and sd (both segments started from
/// the first one's first sample); each started from its own first sample; initial values estimated.
const PUBLISHED: [(&str, f64, f64, f64, f64); 8] = [
    ("Z0", -8.98779e-3, 6.52e-4, -8.882942e-3, -8.980343e-3),
    ("Za", -0.483362, 6.59e-3, -0.4830028, -0.4836956),
    ("Zq", 0.104198, 5.50e-3, 0.1027022, 0.1041382),
    ("Zd", 0.676322, 1.19e-2, 0.6759184, 0.6755831),
    ("M0", 0.475234, 1.41e-3, 0.4763694, 0.4750252),
    ("Ma", -4.92651, 1.61e-2, -4.935150, -4.925222),
    ("Mq", -2.00573, 1.15e-2, -2.012113, -2.005093),
    ("Md", -7.20806, 2.53e-2, -7.226550, -7.206799),
];

#[test]
fn truth_attas_short_period_from_mat_files_to_estimates() {
    let Some(data) = data("attas/fAttasElv1.mat") else { return };
    let folder = copy("attas-real");
    koehler(folder.path(), &data, &["import", "import.toml"]);
    koehler(folder.path(), &data, &["run", "short-period.toml"]);

    let estimates =
        read_dataset(&folder.path().join("out/short-period"), "estimates").expect("estimates");
    let text = |name: &str| estimates.strings(name).expect("column");
    let number = |name: &str| estimates.f64(name).expect("column");
    for (parameter, published, sd, own, free) in PUBLISHED {
        for (model, want) in [("published", published), ("own-start", own), ("free-start", free)] {
            let row = (0..estimates.rows())
                .find(|i| text("model")[*i] == model && text("parameter")[*i] == parameter)
                .expect("a row");
            let (value, crlb) = (number("value")[row], number("sd_crlb")[row]);
            println!(
                "{model:10} {parameter}: {value:13.6e} for {want:13.6e}, sd_crlb {crlb:.3e}, sd {:.3e}",
                number("sd")[row]
            );
            assert_eq!(text("stop")[row], "converged");
            // four significant digits and more
            assert!(
                ((value - want) / want).abs() < 1e-4,
                "{model} {parameter}: {value} for {want}"
            );
            if model == "published" {
                assert!(((crlb - sd) / sd).abs() < 0.02, "{parameter}: sd {crlb} for {sd}");
            }
        }
    }
}

/// Reconstruction over three maneuvers: bias, published value and sd. Accelerometers first, then
/// gyros.
const BIASES: [(&str, f64, f64); 6] = [
    ("b_ax", 6.76242e-3, 4.6e-4),
    ("b_ay", -1.50664e-3, 1.1e-3),
    ("b_az", 8.39892e-2, 8.2e-4),
    ("b_p", 1.02555e-3, 7.9e-6),
    ("b_q", 3.40891e-3, 4.0e-6),
    ("b_r", 9.96192e-4, 4.3e-6),
];
const DET_R: f64 = 1.230917e-28;
/// Samples of the three records.
const SAMPLES: f64 = 626.0 + 751.0 + 751.0;

#[test]
fn truth_attas_flight_path_over_three_maneuvers() {
    let Some(data) = data("attas/fAttasElv1.mat") else { return };
    let folder = copy("attas-real");
    koehler(folder.path(), &data, &["import", "import.toml"]);
    koehler(folder.path(), &data, &["run", "flight-path.toml"]);

    let out = folder.path().join("out/flight-path");
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    for (i, (parameter, want, sd)) in BIASES.into_iter().enumerate() {
        let names = estimates.strings("parameter").expect("column");
        let row = names.iter().position(|name| *name == parameter).expect("a row");
        let (value, crlb) = (
            estimates.f64("value").expect("column")[row],
            estimates.f64("sd_crlb").expect("column")[row],
        );
        println!("{parameter}: {value:e} for {want:e}, sd_crlb {crlb:.2e} for {sd:.2e}");
        assert_eq!(estimates.strings("stop").expect("column")[row], "converged");
        assert!((value - want).abs() < 0.1 * sd, "{parameter}: {value} for {want}");
        // the gyros' to three digits
        assert!(i < 3 || ((value - want) / want).abs() < 0.5e-3, "{parameter}: {value} for {want}");
        assert!(
            ((crlb - sd) / sd).abs() < 0.05,
            "{parameter}: sd {crlb} for {sd}, published with two digits"
        );
    }
    // the cost is N/2 ln det R without its constants
    let iterations = read_dataset(&out, "iterations").expect("iterations");
    let cost = *iterations.f64("cost").expect("column").last().expect("an iteration");
    let det_r = (2.0 * cost / SAMPLES).exp();
    println!("det R {det_r:e} for {DET_R:e}");
    assert!(((det_r - DET_R) / DET_R).abs() < 0.005, "{det_r:e}");
}
