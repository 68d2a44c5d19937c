//! The tables of the ATTAS campaign's README: held against the results of a run, where there are
//! any, or written from them.

use super::results::{Results, Row, folder, true_value};
use koehler::math::distribution::t_quantile;

const START: &str = "<!-- written by `UPDATE_DOCS=1 cargo test --test all the_results_in_the_readme` after a run -->\n";
const END: &str = "<!-- until here -->\n";

/// Sensor noise of the campaign, in the unit of the table: output, unit, noise, units per SI.
const NOISE: [(&str, &str, f64, f64); 11] = [
    ("V", "m/s", 0.154, 1.0),
    ("alpha", "deg", 0.06, DEG),
    ("beta", "deg", 0.06, DEG),
    ("p", "deg/s", 0.1, DEG),
    ("q", "deg/s", 0.05, DEG),
    ("r", "deg/s", 0.08, DEG),
    ("phi", "deg", 0.06, DEG),
    ("theta", "deg", 0.06, DEG),
    ("ax", "m/s^2", 0.0392, 1.0),
    ("ay", "m/s^2", 0.0392, 1.0),
    ("az", "m/s^2", 0.0785, 1.0),
];
const DEG: f64 = 180.0 / std::f64::consts::PI;

/// Four significant digits.
fn short(value: f64) -> String {
    let digits =
        if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 9) };
    format!("{value:.0$}", digits as usize)
}

/// A ratio of determinants.
fn times(ratio: f64) -> String {
    if ratio < 1e3 { format!("{ratio:.4}") } else { format!("{ratio:.1e}") }
}

fn with_sd(row: Option<&Row>) -> String {
    row.map_or(String::new(), |row| format!("{} ({})", short(row.value), short(row.sd)))
}

/// A table of Markdown.
fn table(head: &[&str], rows: Vec<Vec<String>>) -> String {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let head_line = line(head.iter().map(|h| h.to_string()).collect());
    let rule = format!("|{}\n", "---|".repeat(head.len()));
    head_line + &rule + &rows.into_iter().map(line).collect::<String>() + "\n"
}

/// How many of the rows are within their intervals of 95%, the r.m.s. of (estimate - truth)/sd, and
/// the largest with its name.
fn honest(rows: &[Row]) -> (usize, f64, String) {
    let z = t_quantile(0.975, 1e6);
    let inside = rows.iter().filter(|row| row.off().abs() <= z).count();
    let mean = rows.iter().map(|row| row.off().powi(2)).sum::<f64>() / rows.len() as f64;
    let worst = rows.iter().max_by(|a, b| a.off().abs().total_cmp(&b.off().abs()));
    let worst = worst.map(|row| format!("{} {:.1}", row.name(), row.off())).unwrap_or_default();
    (inside, mean.sqrt(), worst)
}

/// Every derivative: truth, models A and B.
fn derivatives(run: &Results) -> String {
    let rows = run.derivatives("b-all");
    let cells = |row: &Row| {
        let a = run.find("a-all", &row.name());
        let off = format!("{:.1}", row.off());
        vec![
            row.name(),
            row.unit.clone(),
            short(row.truth()),
            with_sd(a.as_ref()),
            with_sd(Some(row)),
            off,
        ]
    };
    let head = ["parameter", "unit", "truth", "model A (sd)", "model B (sd)", "B - truth, sd"];
    let (inside, ..) = honest(&rows);
    let text = table(&head, rows.iter().map(cells).collect());
    format!("{text}{inside} of these {} intervals of 95% hold the truth.\n\n", rows.len())
}

/// What the paper's Figs. 6 to 9 compare.
fn comparison(run: &Results) -> String {
    let mut rows = Vec::new();
    let mut say = |what: &str, a: String, b: String, truth: String| {
        rows.push(vec![what.to_string(), a, b, truth])
    };
    let det = |model: &str| format!("{:.3e}", run.det_r(model));
    say("det R", det("a-all"), det("b-all"), String::new());
    for (output, unit, noise, scale) in NOISE {
        let rms = |model: &str| format!("{:.4}", scale * run.rms(model, output));
        let what = format!("r.m.s. residual of {output}, {unit}");
        say(&what, rms("a-all"), rms("b-all"), format!("{noise} (sensor noise)"));
    }
    let [a, b] = ["a-all", "b-all"].map(|model| run.pitch_rate(model));
    let places = [
        "r.m.s. residual of q within 1 s of a change of the flaps' level, deg/s",
        "the same from 3 s after the last change on, deg/s",
    ];
    for (i, what) in places.into_iter().enumerate() {
        let cell = |rms: f64| format!("{:.4}", DEG * rms);
        say(what, cell(a[i]), cell(b[i]), "0.05 (sensor noise)".to_string());
    }
    let damping = |model: &str| with_sd(run.find(model, "C_m_q").as_ref());
    let truth = short(true_value("C_m_q"));
    say("C_m_q (sd), all maneuvers", damping("a-all"), damping("b-all"), truth.clone());
    let what = "C_m_q (sd), the flaps' maneuvers alone";
    say(what, damping("a-dlc"), damping("b-dlc"), truth.clone());
    let what = "C_m_q (sd), elevator and stabilizer alone";
    say(what, damping("elevator"), damping("elevator"), truth);
    let arm = run.find("b-all", "l_DLC");
    say("l_DLC (sd), m", String::new(), with_sd(arm.as_ref()), short(true_value("l_DLC")));
    table(&["", "model A", "model B", "truth"], rows)
}

/// Other forms of model B: which one do the data prefer?
fn forms(run: &Results) -> String {
    let forms = [
        ("model A: at once, no unequal moments", "a-all", ""),
        ("no interference of flaps and ailerons", "b-no-interference", ""),
        ("the flaps' rate in place of the delay", "b-rate", "C_m_etadot"),
        ("a first-order lag in place of the delay", "b-lag", "C_m_eta_lag"),
        ("delay r_H/V (model B)", "b-all", "C_m_eta_lag"),
        ("delay, its distance estimated", "b-distance", "C_m_eta_lag"),
    ];
    let best = run.det_r("b-all");
    let cells = |(what, model, parameter): (&str, &str, &str)| {
        let [up, out] =
            [1, 14].map(|k| with_sd(run.find(model, &format!("{parameter}, {k} deg")).as_ref()));
        let q = DEG * run.rms(model, "q");
        let near = DEG * run.pitch_rate(model)[0];
        let ratio = times(run.det_r(model) / best);
        let damping = with_sd(run.find(model, "C_m_q").as_ref());
        let what = what.to_string();
        vec![
            what,
            ratio,
            format!("{q:.4}"),
            format!("{near:.4}"),
            damping,
            parameter.to_string(),
            up,
            out,
        ]
    };
    let head = [
        "form",
        "det R over that of model B",
        "r.m.s. of q, deg/s",
        "within 1 s of a change",
        "C_m_q (sd)",
        "parameter",
        "1 deg (sd)",
        "14 deg (sd)",
    ];
    let distance = run.one("b-distance", "r_H_free");
    format!(
        "{}Estimated distance of the neutral points: {} m (sd {}), truth {}, start 6.000.\n\n",
        table(&head, forms.map(cells).to_vec()),
        short(distance.value),
        short(distance.sd),
        short(distance.truth())
    )
}

/// What the mass of fuel_ref does to all that depends on mass, inertia or the centre of gravity:
/// errors of more than 1% that are beyond the noise.
fn mass(run: &Results) -> String {
    let rows = run.derivatives("b-all");
    let constant = run.derivatives("b-constant-mass");
    let of = |row: &Row| constant.iter().find(|other| other.name() == row.name());
    let percent = |row: &Row| 100.0 * (row.value - row.truth()) / row.truth();
    let cells = |row: &Row| {
        let other = of(row)?;
        let (sd, error) = ((other.value - row.truth()) / row.sd, percent(other));
        let wrong = row.truth() != 0.0 && error.abs() > 1.0 && sd.abs() > 4.0;
        wrong.then(|| {
            let (fuel, fixed) = (with_sd(Some(row)), with_sd(Some(other)));
            let error = format!("{error:.2}");
            vec![row.name(), short(row.truth()), fuel, fixed, format!("{:.2}", percent(row)), error]
        })
    };
    let head = [
        "parameter",
        "truth",
        "mass by fuel (sd)",
        "constant mass (sd)",
        "error, %",
        "error with constant mass, %",
    ];
    let [fuel, fixed] = [honest(&rows), honest(&constant)];
    let det = run.det_r("b-constant-mass") / run.det_r("b-all");
    format!(
        "{}Of {} intervals of 95% hold the truth: {} with mass by fuel, {} with constant mass. det R is {} times as large with constant mass, \
         the r.m.s. residual of V {:.2} m/s in place of {:.3}.\n\n",
        table(&head, rows.iter().filter_map(cells).collect()),
        rows.len(),
        fuel.0,
        fixed.0,
        times(det),
        run.rms("b-constant-mass", "V"),
        run.rms("b-all", "V")
    )
}

/// What the offsets of each maneuver stand for: noise of the measured surfaces.
fn offsets(run: &Results) -> String {
    let kinds = [
        ("estimated for each maneuver, surfaces as measured (b-all)", "b-all"),
        ("zero, surfaces as measured", "b-no-offsets"),
        ("zero, surfaces smoothed", "b-smoothed"),
    ];
    let cells = |(what, model): (&str, &str)| {
        let rows = run.derivatives(model);
        let (inside, rms, worst) = honest(&rows);
        let det = run.det_r(model) / run.det_r("b-all");
        let phi = DEG * run.rms(model, "phi");
        let inside = format!("{inside} of {}", rows.len());
        vec![what.to_string(), times(det), format!("{phi:.4}"), inside, format!("{rms:.2}"), worst]
    };
    let head = [
        "C_l_0, C_n_0",
        "det R over that of b-all",
        "r.m.s. of phi, deg",
        "intervals that hold the truth",
        "r.m.s. error, sd",
        "largest, sd",
    ];
    table(&head, kinds.map(cells).to_vec())
}

/// Cramer-Rao, corrected, and the paper's rule for the derivatives of the flaps.
fn bounds(run: &Results) -> String {
    let flaps = ["A_", "W_", "M_", "C_m_eta_lag", "C_l_xi_eta", "C_n_xi_eta", "l_DLC"];
    let rows = run.derivatives("b-all");
    let rows = rows.iter().filter(|row| flaps.iter().any(|start| row.parameter.starts_with(start)));
    let cells = |row: &Row| {
        let percent = |sd: f64| match row.value {
            _ if row.truth() == 0.0 => String::new(),
            value => format!("{:.3}", 100.0 * sd / value.abs()),
        };
        let error = (row.value - row.truth()).abs();
        vec![
            row.name(),
            short(error),
            short(row.crlb),
            short(row.sd),
            format!("{} to {}", short(5.0 * row.crlb), short(10.0 * row.crlb)),
            percent(row.crlb),
            percent(row.sd),
        ]
    };
    let head = [
        "parameter",
        "error",
        "Cramer-Rao bound",
        "sd, corrected for colour",
        "5 to 10 times the bound",
        "bound, %",
        "sd, %",
    ];
    table(&head, rows.map(cells).collect())
}

#[test]
fn the_results_in_the_readme_of_the_attas_are_those_of_its_run() {
    let path = folder().join("README.md");
    let readme = std::fs::read_to_string(&path).expect("the README");
    assert!(!readme.contains('@'), "a place in the README is not filled in");
    let out = folder().join("out");
    if !out.join("estimates").is_dir() {
        println!(
            "skipped: `koehler run pipelines/attas/pipeline.toml` has not been run (some minutes)"
        );
        return;
    }
    let run = Results::of(&out);
    let texts = [derivatives, comparison, forms, mass, offsets, bounds].map(|text| text(&run));
    let mut parts = readme.split(START);
    let mut wanted = parts.next().expect("text").to_string();
    let mut found = 0;
    for (text, part) in texts.iter().zip(parts) {
        let (_, after) = part.split_once(END).expect("the end of a table");
        wanted += &format!("{START}{}\n{END}{after}", text.trim_end());
        found += 1;
    }
    assert_eq!(found, texts.len(), "a marker of the results is missing");
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write(&path, &wanted).expect("written");
    } else {
        assert!(
            readme == wanted,
            "pipelines/attas/README.md is behind pipelines/attas/out: run the pipeline again if it is old, then UPDATE_DOCS=1 cargo test --test all \
             the_results_in_the_readme"
        );
    }
}
