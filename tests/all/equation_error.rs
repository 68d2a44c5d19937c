//! Equation error on a published record, from the file to the tables: are the estimates those that were
//! published, is the structure, and are the modes? And does the page's example do what it says?

use crate::flightdata::{copy, data, in_the_readme, koehler};
use koehler::dynamics::{Channel, Record};
use koehler::estimate::{self, Estimation, estimate};
use koehler::model::{Constants, Model};
use koehler::table::{Table, read_dataset};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::path::Path;

/// NASA's SIDPAC, Twin Otter: ordinary least squares, sd corrected for coloured residuals.
const PUBLISHED: [(&str, f64, f64); 6] = [
    ("C_Z_alpha", -6.348930, 1.999e-2),
    ("C_Z_q", -18.406, 0.5524),
    ("C_Z_de", -0.62606, 1.527e-2),
    ("C_m_alpha", -1.47617, 2.242e-2),
    ("C_m_q", -36.353, 0.689),
    ("C_m_de", -1.86877, 2.037e-2),
];

const RECORD: &str = "records/totter_lon_020213f1_018.mat";

/// The tables of a run of the shipped pipeline.
fn run(data: &Path) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = copy("twin-otter");
    koehler(folder.path(), data, &["import", "import.toml"]);
    koehler(folder.path(), data, &["run", "pipeline.toml"]);
    let out = folder.path().join("out");
    (folder, out)
}

/// The row of a table where these columns have these values.
fn row(table: &Table, wanted: &[(&str, &str)]) -> usize {
    let is = |r: &usize| {
        wanted.iter().all(|(column, value)| table.strings(column).expect("column")[*r] == *value)
    };
    (0..table.rows()).find(is).unwrap_or_else(|| panic!("no row {wanted:?}"))
}

fn page() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/equation-error.md");
    std::fs::read_to_string(path).expect("the page")
}

fn digits(value: f64, significant: i32) -> String {
    let places = (significant - 1 - value.abs().log10().floor() as i32).max(0) as usize;
    format!("{value:.places$}")
}

#[test]
fn truth_the_twin_otters_coefficients_to_four_digits() {
    let Some(data) = data(RECORD) else { return };
    let (_folder, out) = run(&data);
    let regressions = read_dataset(&out, "regressions").expect("regressions");
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    let mut table = String::from(
        "| | published | here | published sd | sd here | sd if white | shift by noise in regressors |\n|---|---|---|---|---|---|---|\n",
    );
    for (parameter, published, published_sd) in PUBLISHED {
        let wanted = [("model", "coefficients"), ("parameter", parameter)];
        let at = row(&regressions, &wanted);
        let of = |name: &str| regressions.f64(name).expect("column")[at];
        let (value, sd) = (of("value"), of("sd"));
        assert_eq!(digits(value, 4), digits(published, 4), "{parameter}");
        let of_estimate = row(&estimates, &wanted);
        assert_eq!(estimates.f64("value").expect("column")[of_estimate], value);
        // The published one sums the residuals' sample autocovariances over all lags. Those of
        // residuals are too small, as the fit has taken its part: it claims more than there is.
        assert!(sd > published_sd && sd < 3.5 * published_sd, "{parameter}: {sd} {published_sd}");
        assert!(of("sd_white") < published_sd && of("shift").abs() < 0.1 * sd, "{parameter}");
        let cells = [
            digits(published, 4),
            digits(value, 4),
            digits(published_sd, 2),
            digits(sd, 2),
            digits(of("sd_white"), 2),
            format!("{:.0e}", of("shift")),
        ];
        table += &format!("| `{parameter}` | {} |\n", cells.join(" | "));
    }
    let equations = read_dataset(&out, "equations").expect("equations");
    for (equation, r2) in [("C_Z", 0.9997), ("C_m", 0.9926)] {
        let at = row(&equations, &[("model", "coefficients"), ("equation", equation)]);
        assert!((equations.f64("r2").expect("column")[at] - r2).abs() < 5e-5);
        assert_eq!(equations.i64("n").expect("column")[at], 401);
    }
    let page = page();
    if std::env::var_os("UPDATE_DOCS").is_none() {
        assert!(page.contains(&table), "docs/equation-error.md is behind its results:\n{table}");
    }
    structure(&out);
    in_the_readme(
        "twin-otter",
        "the test equation_error",
        &[("coefficients", table), ("search", history(&out)), ("modes", modes(&out))],
    );
}

/// The published stepwise regression takes the three linear terms and leaves alpha de out.
fn structure(out: &Path) {
    let searches = read_dataset(out, "searches").expect("searches");
    let column = |name: &str| searches.strings(name).expect("column").to_vec();
    let (models, actions, parameters) = (column("model"), column("action"), column("parameter"));
    let mut taken: Vec<&str> = Vec::new();
    for r in (0..searches.rows()).filter(|&r| models[r] == "stepwise") {
        match actions[r] {
            "in" => taken.push(parameters[r]),
            "out" => taken.retain(|name| *name != parameters[r]),
            _ => {}
        }
    }
    taken.sort_unstable();
    assert_eq!(taken, ["C_m_alpha", "C_m_de", "C_m_q"]);
}

/// The searches as a table.
fn history(out: &Path) -> String {
    let searches = read_dataset(out, "searches").expect("searches");
    let text = |name: &str| searches.strings(name).expect("column").to_vec();
    let number = |name: &str| searches.f64(name).expect("column").to_vec();
    let (models, actions, parameters) = (text("model"), text("action"), text("parameter"));
    let (f, pse, r2, s) = (number("partial_f"), number("pse"), number("r2"), number("s"));
    let steps = searches.i64("step").expect("column");
    let kept = searches.bools("kept").expect("column");
    let mut table = String::from(
        "| search | step | term | partial F | PSE | R² | s | kept |\n|---|---|---|---|---|---|---|---|\n",
    );
    for r in 0..searches.rows() {
        let term = match parameters[r].is_empty() {
            true => actions[r].to_string(),
            false => format!("`{}` {}", parameters[r], actions[r]),
        };
        let f = if f[r].is_finite() { format!("{:.1}", f[r]) } else { String::new() };
        let kept = if kept[r] { "yes" } else { "" };
        table += &format!(
            "| {} | {} | {term} | {f} | {:.3e} | {:.5} | {:.5} | {kept} |\n",
            models[r], steps[r], pse[r], r2[r], s[r]
        );
    }
    table
}

/// The modes as a table, held against the published transfer function of pitch rate and elevator,
/// 1/(s^2 + 4.906 s + 16.705).
fn modes(out: &Path) -> String {
    let modes = read_dataset(out, "modes").expect("modes");
    let (frequency, damping) = (16.70490648f64.sqrt(), 4.90590901 / (2.0 * 16.70490648f64.sqrt()));
    let mut table =
        String::from("| | frequency, rad/s | damping ratio | period, s |\n|---|---|---|---|\n");
    for model in ["equation-error", "output-error"] {
        let at = row(&modes, &[("model", model), ("kind", "oscillation")]);
        let of = |name: &str| {
            let number = |name: &str| modes.f64(name).expect("column")[at];
            (number(name), number(&format!("{name}_sd")))
        };
        let ((w, w_sd), (z, z_sd), (p, p_sd)) = (of("frequency"), of("damping"), of("period"));
        assert!((w / frequency - 1.0).abs() < 0.08, "{model}: {w} for {frequency}");
        assert!((z / damping - 1.0).abs() < 0.15, "{model}: {z} for {damping}");
        let with = |value: f64, sd: f64| format!("{value:.3} ± {:.3}", 1.96 * sd);
        table +=
            &format!("| {model} | {} | {} | {} |\n", with(w, w_sd), with(z, z_sd), with(p, p_sd));
    }
    let period = 2.0 * std::f64::consts::PI / (frequency * (1.0 - damping * damping).sqrt());
    table
        + &format!(
            "| published transfer function | {frequency:.3} | {damping:.3} | {period:.3} |\n"
        )
}

/// Coefficients of `e_k = -sum a_i e_k-i + w_k` by Burg's recursion, and the sd of `w`.
fn burg(e: &[f64], order: usize) -> (Vec<f64>, f64) {
    let (mut f, mut b) = (e.to_vec(), e.to_vec());
    let mut a = vec![1.0];
    let mut power = e.iter().map(|v| v * v).sum::<f64>() / e.len() as f64;
    for _ in 0..order {
        let (ahead, behind) = (f[1..].to_vec(), b[..b.len() - 1].to_vec());
        let pairs = || ahead.iter().zip(&behind);
        let r = -2.0 * pairs().map(|(f, b)| f * b).sum::<f64>()
            / pairs().map(|(f, b)| f * f + b * b).sum::<f64>();
        a.push(0.0);
        a = a.iter().zip(a.iter().rev()).map(|(a, b)| a + r * b).collect();
        f = pairs().map(|(f, b)| f + r * b).collect();
        b = pairs().map(|(f, b)| b + r * f).collect();
        power *= 1.0 - r * r;
    }
    (a, power.sqrt())
}

/// Noise like the residuals of the record, on the record's own regressors: do the intervals cover?
#[test]
fn recovery_intervals_cover_with_the_noise_of_the_record() {
    let Some(data) = data(RECORD) else { return };
    let (folder, out) = run(&data);
    let samples = read_dataset(&out, "samples").expect("samples");
    let columns = ["alpha", "q_hat", "de"].map(|name| samples.f64(name).expect("column"));
    let responses = read_dataset(&out, "responses").expect("responses");
    let of = |name: &str| responses.strings(name).expect("column").to_vec();
    let (models, outputs) = (of("model"), of("output"));
    let series = |output: &str, column: &str| -> Vec<f64> {
        let all = responses.f64(column).expect("column");
        let is = |r: &usize| models[*r] == "coefficients" && outputs[*r] == output;
        (0..responses.rows()).filter(is).map(|r| all[r]).collect()
    };
    let constants = Constants::default();
    let text = std::fs::read_to_string(folder.path().join("coefficients.model.toml"));
    let model = Model::parse("coefficients", &text.expect("a model"), &constants);
    let model = model.unwrap_or_else(|e| panic!("{e}"));
    let n = columns[0].len();
    let draw = |seed: u64| {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let noisy = |(output, name): (usize, &str)| {
            let (a, sd) = burg(&series(name, "residual"), 21);
            let mut e = vec![0.0; 2000 + n];
            for k in a.len()..e.len() {
                let w: f64 = StandardNormal.sample(&mut random);
                e[k] = sd * w - (1..a.len()).map(|i| a[i] * e[k - i]).sum::<f64>();
            }
            let z = series(name, "modelled").iter().zip(&e[2000..]).map(|(y, e)| y + e).collect();
            let t = (0..n).map(|k| k as f64 * 0.02).collect();
            Channel { output, t, z }
        };
        let channels = [(0, "C_Z"), (1, "C_m")].into_iter().map(noisy).collect();
        let inputs = (0..n).flat_map(|k| columns.map(|c| c[k])).collect();
        let record = Record { dt: 0.02, n, inputs, channels, ..Record::default() };
        let method = estimate::Settings { by: estimate::By::EquationError, ..Default::default() };
        estimate(&model, &[record], &method).unwrap_or_else(|e| panic!("{e}"))
    };
    let estimates = read_dataset(&out, "estimates").expect("estimates");
    let truth = |name: &str| {
        let at = row(&estimates, &[("model", "coefficients"), ("parameter", name)]);
        estimates.f64("value").expect("column")[at]
    };
    let draws = 200;
    let all: Vec<Estimation> = (0..draws).map(draw).collect();
    let mut pooled = 0.0;
    for (i, parameter) in all[0].rows.iter().enumerate() {
        let (mut hits, mut scatter, mut claimed) = (0.0, 0.0, 0.0);
        for e in &all {
            let (miss, sd) = (e.rows[i].value - truth(&parameter.name), e.rows[i].sd.expect("sd"));
            hits += f64::from(miss.abs() <= 1.96 * sd);
            scatter += miss * miss;
            claimed += sd * sd;
        }
        let n = draws as f64;
        println!(
            "{}: {:.3} covered, scatter {:.4e}, claimed {:.4e}",
            parameter.name,
            hits / n,
            (scatter / n).sqrt(),
            (claimed / n).sqrt()
        );
        pooled += hits / n / all[0].rows.len() as f64;
    }
    println!("{pooled:.3} of the intervals cover");
    assert!((0.90..=0.99).contains(&pooled), "{pooled}");
}

/// The model and the method of the page's example.
fn example() -> (Model, estimate::Settings) {
    let page = page();
    let blocks: Vec<&str> =
        page.split("```toml\n").skip(1).filter_map(|b| b.split("```").next()).collect();
    let model = blocks.iter().find(|b| b.contains("title")).expect("a model");
    let method = blocks.iter().find(|b| b.contains("[[estimate]]")).expect("an estimate");
    #[derive(serde::Deserialize)]
    struct Page {
        estimate: Vec<One>,
    }
    #[derive(serde::Deserialize)]
    struct One {
        method: estimate::Settings,
    }
    let page: Page = toml::from_str(method).unwrap_or_else(|e| panic!("{e}"));
    let model =
        Model::parse("page", model, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
    (model, page.estimate.into_iter().next().expect("an estimate").method)
}

#[test]
fn the_pages_example_takes_the_terms_that_there_are() {
    let (model, method) = example();
    let n = 500;
    let wave = |k: usize, a: f64, b: f64| {
        0.1 * (a * k as f64 * 0.02).sin() + 0.03 * (b * k as f64 * 0.02).cos()
    };
    let inputs: Vec<[f64; 3]> =
        (0..n).map(|k| [wave(k, 3.0, 5.0), 0.01 * wave(k, 4.1, 2.0), wave(k, 7.0, 1.3)]).collect();
    let ripple = |k: usize| 1e-4 * ((k * k) as f64 * 0.37).sin();
    let moment = |[a, q, de]: [f64; 3]| 0.01 - 1.5 * a - 36.0 * q - 1.9 * de - 2.0 * a * a;
    let z = inputs.iter().enumerate().map(|(k, u)| moment(*u) + ripple(k)).collect();
    let record = Record {
        dt: 0.02,
        n,
        inputs: inputs.concat().into(),
        channels: vec![Channel { output: 0, t: (0..n).map(|k| k as f64 * 0.02).collect(), z }],
        ..Record::default()
    };
    let found: Estimation = estimate(&model, &[record], &method).unwrap_or_else(|e| panic!("{e}"));
    let names: Vec<&str> = found.rows.iter().map(|r| r.name.as_str()).collect();
    assert_eq!(names, ["C_m_0", "C_m_alpha", "C_m_q", "C_m_de", "C_m_alpha2"]);
    for (row, truth) in found.rows.iter().zip([0.01, -1.5, -36.0, -1.9, -2.0]) {
        assert!((row.value / truth - 1.0).abs() < 0.02, "{row:?}");
    }
}
