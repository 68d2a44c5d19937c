//! The published ATTAS records from MAT files to a validated model: do the pipeline's numbers agree
//! with the book's, and its steps with the records' description?

use crate::flightdata::{copy, data, koehler};
use koehler::table::read_dataset;
use std::path::PathBuf;
use std::sync::OnceLock;
use tempfile::TempDir;

/// The results of the shipped pipeline, run once for all tests; none where there are no data.
pub fn results() -> Option<PathBuf> {
    static RUN: OnceLock<Option<TempDir>> = OnceLock::new();
    let run = RUN.get_or_init(|| {
        let data = data("attas/fAttasElv1.mat")?;
        let folder = copy("attas-real");
        koehler(folder.path(), &data, &["import", "import.toml"]);
        koehler(folder.path(), &data, &["run", "pipeline.toml"]);
        Some(folder)
    });
    run.as_ref().map(|folder| folder.path().join("out"))
}

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
    let Some(out) = results() else { return };
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    let text = |name: &str| estimates.strings(name).expect("column");
    let number = |name: &str| estimates.f64(name).expect("column");
    for (parameter, published, sd, own, free) in PUBLISHED {
        for (model, want) in [
            ("short-period-published", published),
            ("short-period-own-start", own),
            ("short-period", free),
        ] {
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
            if model == "short-period-published" {
                assert!(((crlb - sd) / sd).abs() < 0.02, "{parameter}: sd {crlb} for {sd}");
            }
        }
    }
}

/// The short period that follows from the published derivatives, in closed form.
#[test]
fn truth_attas_short_period_mode() {
    let Some(out) = results() else { return };
    let modes = read_dataset(&out, "modes").expect("modes");
    let of = |name: &str| PUBLISHED.iter().find(|p| p.0 == name).map(|p| p.1).expect("a value");
    let [za, zq, ma, mq] = ["Za", "Zq", "Ma", "Mq"].map(of);
    let frequency = (za * mq - (zq + 1.0) * ma).sqrt();
    let damping = -(za + mq) / (2.0 * frequency);
    let models = modes.strings("model").expect("column");
    let rows: Vec<usize> =
        (0..modes.rows()).filter(|&i| models[i] == "short-period-published").collect();
    let [row] = rows[..] else { panic!("one mode, the same for both maneuvers: {rows:?}") };
    let number = |name: &str| modes.f64(name).expect("column")[row];
    assert_eq!(modes.strings("states").expect("column")[row].len(), "alpha, q".len());
    for (name, want) in [
        ("frequency", frequency),
        ("damping", damping),
        ("period", 2.0 * std::f64::consts::PI / (frequency * (1.0 - damping * damping).sqrt())),
        ("time_constant", -2.0 / (za + mq)),
    ] {
        let (value, sd) = (number(name), number(&format!("{name}_sd")));
        println!("{name}: {value} +- {sd} for {want}");
        assert!((value / want - 1.0).abs() < 1e-4, "{name}: {value} for {want}");
        assert!(sd > 0.0 && sd < 0.05 * value, "{name}: {value} +- {sd}");
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
    let Some(out) = results() else { return };
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    for (i, (parameter, want, sd)) in BIASES.into_iter().enumerate() {
        let names = estimates.strings("parameter").expect("column");
        let models = estimates.strings("model").expect("column");
        let row = (0..names.len())
            .find(|&i| models[i] == "flight-path" && names[i] == parameter)
            .expect("a row");
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
    let models = iterations.strings("model").expect("column");
    let last = models.iter().rposition(|model| *model == "flight-path").expect("an iteration");
    let cost = iterations.f64("cost").expect("column")[last];
    let det_r = (2.0 * cost / SAMPLES).exp();
    println!("det R {det_r:e} for {DET_R:e}");
    assert!(((det_r - DET_R) / DET_R).abs() < 0.005, "{det_r:e}");
}

/// A step of the records' description: record, input, times from its beginning, s, and level, deg.
pub type Told = (&'static str, &'static str, &'static [(f64, f64, f64)]);

/// Steps as the records' description has them: where the surface is further than 0.8 deg from its
/// median.
pub const STEPS: [Told; 4] = [
    (
        "fAttasElv1",
        "elevator",
        &[(5.64, 7.64, -2.8), (7.76, 9.80, 2.2), (9.96, 10.92, -2.6), (11.04, 12.04, 2.7)],
    ),
    (
        "fAttasElv2",
        "elevator",
        &[(6.16, 8.60, 2.6), (8.72, 10.64, -3.6), (10.76, 11.80, 2.1), (11.92, 12.64, -3.8)],
    ),
    ("fAttasAil1", "aileron", &[(5.60, 6.96, 12.7), (7.00, 9.32, -14.0), (9.36, 10.44, 12.6)]),
    ("fAttasRud1", "rudder", &[(6.00, 7.12, -4.8), (7.36, 8.64, 3.8)]),
];
/// How far they are from trim there, deg.
const BEYOND: f64 = 0.8;

/// A step that was found: times from the beginning of its record, s, level and rises, deg and s.
pub struct Step {
    pub from: f64,
    pub to: f64,
    pub level: f64,
    pub rises: [f64; 2],
}

/// The steps of the largest maneuver of an input in a record.
pub fn steps(out: &std::path::Path, flight: &str, input: &str) -> Vec<Step> {
    let segments = read_dataset(out, "segments").expect("segments");
    let text = |name: &str| segments.strings(name).expect("column");
    let amplitude = segments.f64("amplitude").expect("column");
    let row = (0..segments.rows())
        .filter(|&i| text("segment")[i].starts_with(flight) && text("input")[i] == input)
        .max_by(|&a, &b| amplitude[a].total_cmp(&amplitude[b]))
        .expect("a maneuver");
    let channels = read_dataset(out, "samples").expect("samples");
    let begin = (0..channels.rows())
        .filter(|&i| channels.strings("flight").expect("column")[i] == flight)
        .map(|i| channels.f64("t_s").expect("column")[i])
        .fold(f64::INFINITY, f64::min);
    let steps = read_dataset(out, "steps").expect("steps");
    let of = |name: &str| steps.f64(name).expect("column");
    (0..steps.rows())
        .filter(|&i| steps.strings("segment").expect("column")[i] == text("segment")[row])
        .map(|i| Step {
            from: of("t_start_s")[i] - begin,
            to: of("t_end_s")[i] - begin,
            level: of("level")[i].to_degrees(),
            rises: [of("rise_s")[i], of("fall_s")[i]],
        })
        .collect()
}

/// When the signal is `BEYOND` on a step's side of trim, along the edges between it and its
/// neighbours, which rise from 20 to 80% in the times that the table has.
fn beyond(steps: &[Step], k: usize) -> (f64, f64) {
    let step = &steps[k];
    let edge = |at: f64, other: f64, rise: f64| {
        let half = 0.5 * (step.level + other);
        let slope = 0.6 * (step.level - other) / rise;
        at + (BEYOND * step.level.signum() - half) / slope
    };
    let level = |k: Option<usize>| k.and_then(|k| steps.get(k)).map_or(0.0, |step| step.level);
    let start = edge(step.from, level(k.checked_sub(1)), step.rises[0]);
    let end = edge(step.to, level(Some(k + 1)), -step.rises[1]);
    (start, end)
}

#[test]
fn recovery_of_the_steps_of_four_records() {
    let Some(out) = results() else { return };
    for (flight, input, told) in STEPS {
        let found = steps(&out, flight, input);
        assert_eq!(found.len(), told.len(), "{flight}");
        for (k, (from, to, level)) in told.iter().enumerate() {
            let (start, end) = beyond(&found, k);
            println!(
                "{flight} {input} {}: {start:.2} to {end:.2} s for {from} to {to}, {:.1} deg for {level}",
                k + 1,
                found[k].level
            );
            assert!((start - from).abs() < 0.15 && (end - to).abs() < 0.15, "{flight} {}", k + 1);
            assert!(found[k].level * level > 0.0);
        }
    }
}

/// The coupled model knows aerodynamics and the path's kinematics knows none: do both find the same
/// errors of the sensors?
#[test]
fn recovery_of_the_sensors_shifts_by_two_models() {
    let Some(out) = results() else { return };
    let table = read_dataset(&out, "estimates").expect("estimates");
    let of = |model: &str, parameter: &str| {
        let row = (0..table.rows()).find(|&i| {
            table.strings("model").expect("column")[i] == model
                && table.strings("parameter").expect("column")[i] == parameter
        });
        let number = |name: &str| table.f64(name).expect("column")[row.expect("a row")];
        (number("value"), number("sd"), number("sd_crlb"))
    };
    for (shift, bias) in [("dz_p", "b_p"), ("dz_q", "b_q"), ("dz_r", "b_r"), ("dz_az", "b_az")] {
        let (shown, other) = (of("coupled", shift), of("flight-path", bias));
        let sd = shown.1.hypot(other.1);
        println!(
            "{shift}: {:.5} +- {:.5}, {bias}: {:.5} +- {:.5}",
            shown.0, shown.1, other.0, other.1
        );
        assert!((shown.0 - other.0).abs() < 3.0 * sd, "{shift}");
        // the residuals are slow: what is said is larger than what white noise would give
        assert!(shown.1 > shown.2, "{shift}");
    }
}
