//! A made-up campaign of three flights in, checks of the whole page out.
//! `KOEHLER_REPORT_PAGE=/some/file.html cargo test --release --lib report` writes the page down for a look in
//! a browser.

use super::*;
use crate::table::Table;
use rand::{Rng, RngExt, SeedableRng};

const LINES: [(&str, &str, f64, f64, f64); 4] = [
    ("C_h_delta", "1/rad", -0.3717, -0.3189, 0.004),
    ("C_h_deltadot", "s/rad", -0.094, -0.017, 0.0009),
    ("C_h_alpha", "1/rad", -0.4229, -0.0107, 0.006),
    ("C_h_0", "1", -0.39, 0.0216, 0.0006),
];
pub const LEFT_OUT: &str = "flight-2-s4";
const HOSTILE: &str = "<script>alert('x')</script>&\"";

pub type Tables = BTreeMap<String, Table>;

struct Maneuver {
    flight: String,
    segment: String,
    start: f64,
    alpha: f64,
    speed: f64,
}

fn maneuvers() -> Vec<Maneuver> {
    let points = [(82.0, 0.070), (62.0, 0.140), (123.0, 0.022), (82.5, 0.071)];
    let one = |(i, flight, j): (usize, usize, usize)| Maneuver {
        flight: format!("flight-{flight}"),
        segment: format!("flight-{flight}-s{}", j + 1),
        start: 120.0 + 150.0 * j as f64 + 3.7 * i as f64,
        alpha: points[j].1 + 0.002 * flight as f64,
        speed: points[j].0,
    };
    (0..12).map(|i| one((i, i / 4 + 1, i % 4))).collect()
}

/// The commanded 3-2-1-1 at `t` seconds after its start.
fn command(t: f64) -> f64 {
    match t {
        t if !(0.0..7.0).contains(&t) => 0.0,
        t if t < 3.0 => 1.0,
        t if t < 5.0 => -1.0,
        t if t < 6.0 => 1.0,
        _ => -1.0,
    }
}

fn segments(all: &[Maneuver]) -> Table {
    let text = |f: &dyn Fn(&Maneuver) -> String| all.iter().map(f).collect::<Vec<_>>();
    let number = |f: &dyn Fn(&Maneuver) -> f64| all.iter().map(f).collect::<Vec<_>>();
    let out = |m: &Maneuver| m.segment == LEFT_OUT;
    Table::build("segments")
        .strings("flight", text(&|m| m.flight.clone()))
        .strings("segment", text(&|m| m.segment.clone()))
        .repeat("kind", "3211")
        .repeat("input", "servo_torque")
        .f64("t_start_s", number(&|m| m.start))
        .f64("t_end_s", number(&|m| m.start + 7.0))
        .f64("unit_time_s", number(&|_| 1.0))
        .f64("amplitude", number(&|m| 5.0 + 0.01 * m.speed))
        .i64("polarity", vec![1; all.len()])
        .f64("score", number(&|m| 0.97 - 0.01 * m.alpha))
        .bools("included", all.iter().map(|m| !out(m)).collect::<Vec<_>>())
        .opt_strings(
            "reason",
            all.iter().map(|m| out(m).then(|| format!("left out by hand: {HOSTILE}"))),
        )
        .finish()
        .expect("segments")
}

/// Twelve minutes of every flight, and the responses of all maneuvers with one spike each.
fn histories(all: &[Maneuver], noise: &mut impl Rng) -> (Table, Table) {
    let (mut names, mut rows) = (Vec::new(), [vec![], vec![], vec![]]);
    let (mut flights, mut samples) = (Vec::new(), vec![Vec::new(); 5]);
    for flight in (1..=3).map(|i| format!("flight-{i}")) {
        let own: Vec<&Maneuver> = all.iter().filter(|m| m.flight == flight).collect();
        let (mut v, mut alpha) = (82.0, 0.07);
        for t in (0..36_000).map(|i| 0.02 * f64::from(i)) {
            let next = own
                .iter()
                .find(|m| t < m.start + 40.0)
                .or(own.last())
                .expect("flights have maneuvers");
            v += 0.0006 * (next.speed - v);
            alpha += 0.0006 * (next.alpha - alpha);
            let torque = 5.0 * own.iter().map(|m| command(t - m.start)).sum::<f64>();
            flights.push(flight.clone());
            let row = [
                t,
                v + 0.3 * libm::sin(0.1 * t),
                5180.0 + 25.0 * libm::sin(0.013 * t),
                alpha + 0.004 * torque,
                torque,
            ];
            samples.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        }
    }
    for m in all {
        let (mut x, mut rate) = (0.0, 0.0);
        for i in 0..1100 {
            let t = 0.01 * f64::from(i) - 1.0;
            rate += 0.01 * (900.0 * (0.03 * command(t) - x) - 21.0 * rate);
            x += 0.01 * rate;
            names.push(m.segment.clone());
            let measured = x - 0.02
                + 0.0007 * (noise.random::<f64>() - 0.5)
                + if i == 500 { 0.01 } else { 0.0 };
            [t + m.start, measured, x - 0.02]
                .into_iter()
                .zip(rows.iter_mut())
                .for_each(|(value, column)| column.push(value));
        }
    }
    let [t, measured, modelled] = rows;
    let responses = Table::build("responses")
        .repeat("model", "elevator")
        .strings("group", &names)
        .strings("segment", &names);
    let residual: Vec<f64> = measured.iter().zip(&modelled).map(|(z, y)| z - y).collect();
    let responses = responses
        .repeat("output", "delta_e")
        .repeat("unit", "rad")
        .f64("t_s", t)
        .f64("residual", residual)
        .f64("measured", measured)
        .f64("simulated", vec![f64::NAN; modelled.len()])
        .f64("modelled", modelled);
    let mut columns = samples.into_iter();
    let mut build = Table::build("samples")
        .strings("flight", flights)
        .f64("t_s", columns.next().unwrap_or_default());
    for ((name, unit), values) in
        [("V", "m/s"), ("h", "m"), ("alpha", "rad"), ("servo_torque", "N m")]
            .into_iter()
            .zip(columns)
    {
        build = build.dynamic(name, unit, "made up", values);
    }
    (responses.finish().expect("responses"), build.finish().expect("samples"))
}

/// Estimates about the lines, the fits through them and their bands; the tenth estimation has
/// failed.
fn results(all: &[Maneuver], noise: &mut impl Rng) -> [Table; 4] {
    let used: Vec<&Maneuver> = all.iter().filter(|m| m.segment != LEFT_OUT).collect();
    let [mut estimates, mut fits, mut bands, mut points] = [const { Vec::new() }; 4];
    for (name, unit, slope, intercept, sd) in LINES {
        let alpha: Vec<f64> = used.iter().map(|m| m.alpha).collect();
        let sds: Vec<f64> = alpha.iter().map(|x| sd * (0.6 + 8.0 * x)).collect();
        let mut gauss = || (0..12).map(|_| noise.random::<f64>()).sum::<f64>() - 6.0;
        let values: Vec<f64> =
            alpha.iter().zip(&sds).map(|(x, sd)| slope * x + intercept + sd * gauss()).collect();
        let segments = || used.iter().map(|m| m.segment.as_str());
        let failed = |i: usize| i == 9;
        let known = |v: f64| {
            (0..used.len())
                .map(|i| if failed(i) { f64::NAN } else { v * sds[i] })
                .collect::<Vec<_>>()
        };
        let table = Table::build("estimates")
            .repeat("model", "elevator")
            .strings("group", segments())
            .strings("segment", segments());
        let table = table.strings("flight", used.iter().map(|m| m.flight.as_str()));
        let table = table
            .repeat("parameter", name)
            .repeat("per", "segment")
            .strings("of", segments())
            .repeat("unit", unit);
        let table = table.f64("value", values.clone()).f64("sd", known(1.0));
        let table =
            table.f64("sd_crlb", known(0.37)).f64("start", vec![0.9 * intercept; used.len()]);
        let (lower, upper) = (vec![f64::NAN; used.len()], vec![f64::NAN; used.len()]);
        let table = table.f64("sd_total", known(1.3)).f64("lower", lower).f64("upper", upper);
        let table = table
            .opt_strings("interval", used.iter().map(|_| None::<&str>))
            .bools("at_bound", vec![false; used.len()]);
        let stop = (0..used.len()).map(|i| if failed(i) { "singular" } else { "converged" });
        estimates.push(table.strings("stop", stop).finish().expect("estimates"));
        let table = Table::build("points")
            .repeat("model", "elevator")
            .repeat("parameter", name)
            .repeat("against", "alpha")
            .repeat("fit", "elevator-alpha");
        let table = table
            .repeat("unit", unit)
            .repeat("unit_x", "rad")
            .strings("flight", used.iter().map(|m| m.flight.as_str()));
        let table = table
            .strings("segment", segments())
            .f64("x", alpha.clone())
            .f64("value", values.clone())
            .f64("sd", sds);
        points.push(table.finish().expect("points"));
        let (fit, band) = line(name, unit, &alpha, &values);
        fits.push(fit);
        bands.push(band);
    }
    [("estimates", estimates), ("fits", fits), ("bands", bands), ("points", points)]
        .map(|(name, parts)| Table::concat(name, &parts).expect("parts"))
}

/// An unweighted line, good enough to look at.
fn line(name: &str, unit: &str, x: &[f64], y: &[f64]) -> (Table, Table) {
    let n = x.len() as f64;
    let (mx, my) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let sxx: f64 = x.iter().map(|x| (x - mx) * (x - mx)).sum();
    let slope = x.iter().zip(y).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>() / sxx;
    let s2 =
        x.iter().zip(y).map(|(x, y)| (y - my - slope * (x - mx)).powi(2)).sum::<f64>() / (n - 2.0);
    let table = Table::build("fits")
        .strings("model", ["elevator"])
        .repeat("parameter", name)
        .repeat("against", "alpha")
        .repeat("fit", "elevator-alpha")
        .repeat("unit", unit);
    let table = table
        .repeat("unit_x", "rad")
        .f64("slope", [slope])
        .f64("intercept", [my - slope * mx])
        .f64("slope_sd", [(s2 / sxx).sqrt()]);
    let table = table
        .f64("slope_sd_total", [2.0 * (s2 / sxx).sqrt()])
        .f64("intercept_sd_total", [2.0 * (s2 * (1.0 / n + mx * mx / sxx)).sqrt()])
        .f64("intercept_sd", [(s2 * (1.0 / n + mx * mx / sxx)).sqrt()])
        .f64("covariance", [-mx * s2 / sxx])
        .i64("n", [x.len() as i64]);
    let chi2 = if name == "C_h_alpha" { 3.1 * (n - 2.0) } else { 1.1 * (n - 2.0) };
    let table = table
        .f64("relative_sd", [0.02])
        .bools("poor", [false])
        .f64("scatter_sd", [if name == "C_h_0" { 0.0 } else { 0.3 * s2.sqrt() }])
        .f64("chi2", [chi2])
        .f64("x_min", [0.022]);
    let fit = table
        .f64("x_max", [0.146])
        .f64("level", [0.9875])
        .repeat("stop", "converged")
        .finish()
        .expect("fits");
    let grid: Vec<f64> = (0..=50).map(|i| 0.022 + 0.00248 * f64::from(i)).collect();
    let curve = |f: &dyn Fn(f64) -> f64| {
        grid.iter().map(|&x| my + slope * (x - mx) + f(x)).collect::<Vec<_>>()
    };
    let sd = |x: f64| (s2 * (1.0 / n + (x - mx).powi(2) / sxx)).sqrt();
    let mut table = Table::build("bands")
        .repeat("model", "elevator")
        .repeat("parameter", name)
        .repeat("against", "alpha")
        .repeat("fit", "elevator-alpha");
    table = table.f64("x", grid.clone()).f64("value", curve(&|_| 0.0));
    for (name, sign) in [("lower", -1.0), ("upper", 1.0)] {
        table = table.f64(&format!("pointwise_{name}"), curve(&|x| sign * 2.26 * sd(x)));
        table = table.f64(&format!("simultaneous_{name}"), curve(&|x| sign * 3.5 * sd(x)));
        table = table.f64(
            &format!("prediction_{name}"),
            curve(&|x| sign * 2.26 * (sd(x).powi(2) + s2).sqrt()),
        );
    }
    (fit, table.finish().expect("bands"))
}

fn channels() -> Table {
    let signals = [
        ("V", "/air_data", "tas", "m/s", 50),
        ("alpha_vane", "/air_data", "alpha", "rad", 50),
        ("q", "/imu", "gyro.y", "rad/s", 100),
    ];
    let rows: Vec<_> = (1..=3).flat_map(|f| signals.map(|s| (f, s))).collect();
    let rate = || rows.iter().map(|r| r.1.4 as f64);
    let n = rows.len();
    Table::build("channels")
        .strings("flight", rows.iter().map(|r| format!("flight-{}", r.0)))
        .strings("signal", rows.iter().map(|r| r.1.0))
        .strings("topic", rows.iter().map(|r| if r.0 == 2 { HOSTILE } else { r.1.1 }))
        .strings("field", rows.iter().map(|r| r.1.2))
        .strings("unit", rows.iter().map(|r| r.1.3))
        .i64("count", rows.iter().map(|r| 720 * r.1.4 - r.0).collect::<Vec<_>>())
        .f64("rate_hz", rate().collect::<Vec<_>>())
        .i64("dropped_duplicate", rows.iter().map(|r| r.0 - 1).collect::<Vec<_>>())
        .i64("reordered", vec![0; n])
        .i64("dropped_out_of_order", vec![0; n])
        .i64("dropped_nan", vec![0; n])
        .i64("dropped_unreadable", vec![0; n])
        .i64("dropped_out_of_range", vec![0; n])
        .i64("dropped_spikes", vec![0; n])
        .i64("dropped_still", vec![0; n])
        .i64("dropped_times", vec![0; n])
        .f64(
            "longest_gap_s",
            rows.iter()
                .map(|r| if r.0 == 3 { 0.4 } else { 1.2 / r.1.4 as f64 })
                .collect::<Vec<_>>(),
        )
        .f64("t_first_s", vec![0.01; n])
        .f64("t_last_s", vec![719.98; n])
        .f64("still_from_s", vec![f64::NAN; n])
        .f64("still_to_s", vec![f64::NAN; n])
        .f64("min", vec![-0.1; n])
        .f64("max", vec![0.2; n])
        .finish()
        .expect("channels")
}

fn biases() -> Table {
    let all = [
        ("ax_bias", "m/s^2", 6.76e-3, 4.6e-4),
        ("az_bias", "m/s^2", 8.4e-2, 8.2e-4),
        ("q_bias", "rad/s", 3.409e-3, 4.0e-6),
    ];
    Table::build("biases")
        .strings("flight", ["flight-1"; 3])
        .i64("window", [0; 3])
        .f64("t_start_s", [100.0; 3])
        .f64("t_end_s", [600.0; 3])
        .strings("parameter", all.map(|b| b.0))
        .strings("unit", all.map(|b| b.1))
        .f64("value", all.map(|b| b.2))
        .f64("sd", all.map(|b| b.3))
        .finish()
        .expect("biases")
}

fn consistency() -> Table {
    let rows = [
        ("alpha_vane", "sign", 0.998, "good", "as the others say"),
        ("alpha_vane", "time skew", 0.06, "late", "measured behind reconstructed"),
        ("b_q", "sensor error", 3.4e-3, "significant", "bias of the pitch rate"),
        ("q_imu", "sign", -0.99, "sign reversed", "against what all others say"),
        ("theta", "whiteness", 0.3, "coloured", "neighbouring innovations"),
        ("ay_imu", "sign", -0.63, "opposed", "against what all others say"),
        ("ay_imu", "noise", 25.0, "needs noise", "as the path needs it"),
        ("az_imu", "sign", -0.6, "opposed", "against what all others say"),
    ];
    Table::build("consistency")
        .strings("flight", ["flight-1"; 8])
        .strings("channel", rows.map(|r| r.0))
        .strings("check", rows.map(|r| r.1))
        .f64("value", rows.map(|r| r.2))
        .f64("low", [-0.8; 8])
        .f64("high", [1.0; 8])
        .strings("unit", ["-"; 8])
        .strings("verdict", rows.map(|r| r.3))
        .strings("text", rows.map(|r| r.4))
        .finish()
        .expect("consistency")
}

#[test]
fn channels_that_do_not_fit_are_named() {
    let tables: BTreeMap<String, Columns> =
        [("consistency".to_string(), Columns::of(&consistency()))].into();
    let table = tables.get("consistency");
    let (level, text) = super::consistency::summary(table).expect("a sentence");
    assert_eq!(level, grid::Level::Bad);
    assert!(
        text.contains("q_imu (sign reversed)")
            && text.contains("alpha_vane (late)")
            && !text.contains("theta"),
        "{text}"
    );
    let grid = super::consistency::table(table);
    assert_eq!(grid.rows.len(), 5, "sensor errors have a table of their own");
    let of = |channel: &str| grid.rows.iter().find(|r| r.cells[1].text == channel).expect("a row");
    assert_eq!(of("q_imu").level, Some(grid::Level::Bad));
    assert_eq!(of("theta").level, Some(grid::Level::Info));
    // Against the others by little, and with much noise that the path needs, it is wrong.
    assert_eq!(of("ay_imu").level, Some(grid::Level::Bad));
    assert_eq!(of("az_imu").level, Some(grid::Level::Warn));
}

pub fn notes() -> Table {
    Table::build("notes")
        .strings("flight", ["flight-2", "flight-3"])
        .strings("stage", ["ingest", "estimate"])
        .strings("severity", ["info", "warning"])
        .strings("subject", [HOSTILE, "elevator"])
        .i64("count", [3, 1])
        .strings(
            "text",
            [
                "messages repeat an earlier time stamp",
                "the normal matrix is singular: no covariance",
            ],
        )
        .finish()
        .expect("notes")
}

fn residuals(all: &[Maneuver]) -> Table {
    let n = all.len();
    let table = Table::build("residuals")
        .repeat("model", "elevator")
        .strings("group", all.iter().map(|m| &m.segment));
    let table = table
        .strings("segment", all.iter().map(|m| &m.segment))
        .repeat("output", "delta_e")
        .repeat("unit", "rad");
    let table = table
        .i64("n", vec![1100; n])
        .f64("mean", vec![0.0; n])
        .f64("sd", vec![2e-4; n])
        .i64("ar_order", vec![2; n]);
    let table = table
        .f64("rms", vec![2e-4; n])
        .f64("theil", vec![0.02; n])
        .f64("white_p", vec![1e-5; n])
        .f64("outside", vec![0.4; n]);
    table.f64("colour", vec![7.3; n]).finish().expect("residuals")
}

/// A budget, the scatter of repeats, one verdict and one profile.
fn uncertainties() -> [Table; 4] {
    let budget = Table::build("budget")
        .repeat("model", "elevator")
        .strings("group", ["s1", "s1"])
        .strings("segment", ["s1", "s1"]);
    let budget =
        budget.strings("of", ["s1", "s1"]).repeat("parameter", "C_h_delta").repeat("unit", "1/rad");
    let budget = budget
        .opt_strings("constant", [Some("K_te"), None])
        .opt_strings("constant_unit", [Some("N m/A"), None]);
    let budget = budget
        .opt_strings("constant_source", [Some("course data of the aircraft"), None])
        .f64("constant_value", [5.0, f64::NAN])
        .f64("constant_sd", [0.05, f64::NAN])
        .f64("sensitivity", [-0.06, f64::NAN]);
    let budget = budget
        .f64("contribution", [3e-3, 2e-3])
        .f64("share", [0.692, 0.308])
        .finish()
        .expect("budget");
    let verdict = Table::build("separability")
        .repeat("model", "elevator")
        .strings("group", ["s1", "s2"])
        .i64("number", [0, 1]);
    let verdict = verdict
        .strings("verdict", ["separable", "no effect"])
        .f64("information", [f64::NAN, 0.0])
        .f64("condition", [30.0, f64::NAN]);
    let verdict = verdict
        .opt_strings("parameter", [None, Some("tau")])
        .opt_strings("segment", [None::<&str>; 2])
        .opt_strings("of", [None::<&str>; 2]);
    let verdict = verdict.opt_strings("unit", [None, Some("s")]).f64("change", [f64::NAN, 1.0]);
    let verdict = verdict
        .strings("text", ["fine", "tau has no effect on the measured outputs"])
        .finish()
        .expect("separability");
    let repeats = Table::build("repeats")
        .repeat("model", "elevator")
        .strings("parameter", ["C_h_delta", "C_h_delta"])
        .repeat("unit", "1/rad");
    let repeats = repeats
        .strings("set", ["condition", "kind"])
        .opt_strings("condition", [Some("V 82.0 m/s"), None]);
    let repeats = repeats
        .opt_strings("input", [None::<&str>; 2])
        .opt_strings("kind", [Some("3211"); 2])
        .i64("n", [2, 4]);
    let repeats = repeats
        .f64("mean", [-0.33, -0.34])
        .f64("scatter_sd", [0.01, 0.03])
        .f64("rms_sd", [0.01, 0.01])
        .f64("ratio", [1.0, 3.0]);
    let repeats = repeats.f64("chi2", [1.0, 27.0]).f64("p", [0.3, 6e-6]).finish().expect("repeats");
    let x: Vec<f64> = (0..9).map(|i| 0.1 + 0.005 * f64::from(i)).collect();
    let rise: Vec<f64> = x.iter().map(|x| 1e4 * (x - 0.12) * (x - 0.12)).collect();
    let profile = Table::build("profiles")
        .strings("model", vec!["elevator"; 9])
        .repeat("group", "s1")
        .opt_strings("segment", [None::<&str>; 9]);
    let profile = profile
        .opt_strings("of", [None::<&str>; 9])
        .repeat("parameter", "tau")
        .repeat("unit", "s")
        .f64("value", x)
        .f64("rise", rise);
    let profile =
        profile.f64("limit", vec![3.84; 9]).f64("level", vec![0.95; 9]).finish().expect("profiles");
    [budget, verdict, repeats, profile]
}

#[test]
fn uncertainties_are_told_in_words() {
    let page = page(&frame(campaign())).expect("a page");
    for text in [
        "K_te 69.2 %",
        "no effect",
        "tau has no effect on the measured outputs",
        "id=\"profile-0\"",
        "&lt; 0.0001",
    ] {
        assert!(page.contains(text), "{text}");
    }
    assert!(page.contains("Maneuvers repeated at the same condition (1 condition) scatter as their standard deviations say"));
}

/// Two parameters that go together in every estimation.
fn correlations(all: &[Maneuver]) -> Table {
    let n = all.len();
    let table = Table::build("correlations")
        .repeat("model", "elevator")
        .strings("group", all.iter().map(|m| &m.segment));
    let table = table
        .strings("parameter", vec!["C_h_delta"; n])
        .opt_strings("segment", vec![None::<&str>; n]);
    let table = table.opt_strings("of", vec![None::<&str>; n]).strings("other", vec!["C_h_0"; n]);
    let table = table
        .opt_strings("other_segment", vec![None::<&str>; n])
        .opt_strings("other_of", vec![None::<&str>; n]);
    table
        .f64("value", vec![-0.97; n])
        .f64("value_crlb", vec![-0.9; n])
        .finish()
        .expect("correlations")
}

pub fn campaign() -> Tables {
    let mut noise = rand_pcg::Pcg64::seed_from_u64(7);
    let all = maneuvers();
    let (responses, samples) = histories(&all, &mut noise);
    let tables = results(&all, &mut noise).into_iter().chain([
        segments(&all),
        responses,
        residuals(&all),
        correlations(&all),
        samples,
        channels(),
        biases(),
        consistency(),
        notes(),
    ]);
    let tables = tables.chain(uncertainties());
    tables.map(|table| (table.name().to_string(), table)).collect()
}

pub fn frame(tables: Tables) -> ReportInput {
    ReportInput {
        tables,
        title: "Citation elevator campaign".into(),
        subtitle:
            "pipelines/citation/pipeline.toml: ingest, reconstruct, derive, segment, estimate, fit"
                .into(),
        provenance: vec![
            ("program".into(), "koehler 0.1.0".into()),
            ("code".into(), "0123456789abcdef".into()),
        ],
        ..ReportInput::default()
    }
}

#[test]
fn a_campaign_becomes_one_self_contained_page() {
    let html = page(&frame(campaign())).expect("page");
    if let Ok(path) = std::env::var("KOEHLER_REPORT_PAGE") {
        std::fs::write(path, &html).expect("written");
    }
    assert!(html.contains("C_h_delta = (-0.00"), "no equation");
    assert!(html.contains("10 &#x2f; 11</b>"), "no count of converged estimations");
    assert!(html.contains("singular"), "the failed estimate is not shown");
    assert!(html.contains("Every one of the 3 flights has a maneuver"));
    let body = html.find("<script type=\"application/json\"").expect("data");
    assert!(!html[..body].contains("://"), "the page points outside");
    assert!(html.len() < 8_000_000, "{} bytes", html.len());
    assert_eq!(html, page(&frame(campaign())).expect("page"), "not the same bytes twice");
}

#[test]
fn what_the_page_calls_a_problem_is_what_the_program_prints() {
    let report = report(&frame(campaign())).expect("a page");
    assert!(
        report.problems.iter().any(|p| p.contains("did not converge")),
        "{:?}",
        report.problems
    );
    let (_, rest) = report.page.split_once("<ul class=\"checks\">").expect("checks");
    let list = rest.split_once("</ul>").expect("their end").0;
    assert_eq!(list.matches(">problem<").count(), report.problems.len(), "{list}");
    assert_eq!(
        super::report(&frame(Tables::new())).expect("a page").problems,
        Vec::<String>::new()
    );
}

#[test]
fn text_from_logs_is_escaped_everywhere() {
    let mut input = frame(campaign());
    input.title = HOSTILE.into();
    input.provenance.push((HOSTILE.into(), HOSTILE.into()));
    let html = page(&input).expect("page");
    assert!(html.contains("&lt;script&gt;alert"));
    assert!(!html.contains("<script>alert"), "text from a log came through as markup");
}

#[test]
fn what_is_not_asked_for_has_no_place_on_the_page() {
    let html =
        page(&ReportInput { unasked: vec!["fits", "bands", "points"], ..frame(Tables::new()) })
            .expect("page");
    for section in ["lines", "fits"] {
        assert!(
            !html.contains(&format!("id=\"{section}\""))
                && !html.contains(&format!("href=\"#{section}\"")),
            "{section}"
        );
    }
    assert!(
        !html.contains("fitted lines")
            && html.contains("id=\"estimates\"")
            && html.contains("estimates converged")
    );
}

/// Everything between `before` and the next quotation mark.
pub fn all_of<'a>(html: &'a str, before: &str) -> Vec<&'a str> {
    html.split(before).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

#[test]
fn every_link_has_its_target_and_every_target_one_name() {
    let mut without = campaign();
    without.remove("correlations");
    let pages = [
        frame(campaign()),
        frame(Tables::new()),
        ReportInput {
            unasked: vec!["fits", "bands", "points", "repeats", "budget", "correlations"],
            ..frame(without)
        },
    ];
    for input in pages {
        let html = page(&input).expect("page");
        let html = html.split("<script type=\"application/json\"").next().expect("a page");
        let (links, ids) = (all_of(html, "href=\"#"), all_of(html, " id=\""));
        assert!(links.len() > 10 && !ids.is_empty());
        for link in links {
            assert_eq!(ids.iter().filter(|id| **id == link).count(), 1, "#{link} among {ids:?}");
        }
        let mut once = ids.clone();
        once.sort_unstable();
        once.dedup();
        assert_eq!(once.len(), ids.len(), "an id stands twice: {ids:?}");
    }
}

#[test]
fn a_check_leads_to_what_it_speaks_of() {
    let html = page(&frame(campaign())).expect("page");
    let link = |sentence: &str, to: &str| {
        let line = html
            .split("<li class=")
            .find(|line| line.contains(sentence))
            .unwrap_or_else(|| panic!("{sentence}"));
        assert!(line.contains(&format!("href=\"#{to}\"")), "{line}");
    };
    link("hardly separable there", "correlations");
    assert!(
        html.contains("id=\"correlation-plot\"") && html.contains("\"correlations\":[{"),
        "no heat map"
    );
    link("Maneuvers repeated", "repeats");
    link("found but left out", "segments");
}

#[test]
fn sections_are_named_once_and_their_tables_have_schemas() {
    let mut ids: Vec<&str> = SECTIONS.iter().map(|s| s.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), SECTIONS.len());
    for table in tables(&Form::One, &[]) {
        assert!(crate::table::schema(table).is_ok(), "{table}");
    }
    let html = page(&frame(campaign())).expect("page");
    let order = |pattern: &str| all_of(&html, pattern);
    // One page has no list of others; this campaign has no adequacy, no diagnosis, no model with limits or states, no regression, nothing was
    // predicted, and no sample was left out.
    let without = [
        "verdict",
        "list",
        "matches",
        "limits",
        "predictions",
        "equation-error",
        "modes",
        "left-out",
    ];
    let there: Vec<&str> =
        SECTIONS.iter().map(|s| s.id).filter(|id| !without.contains(id)).collect();
    assert_eq!(order("<section id=\""), there, "the page has the order of the list");
    assert_eq!(order("<li><a href=\"#"), there, "and so has its navigation");
}

/// A section of a table that the page had nothing to do with: one value in a list is all it takes.
#[test]
fn a_new_section_is_one_value() {
    const TOY: Section = Section {
        id: "toy",
        heading: "Iterations",
        on: On::Both,
        tables: &["iterations"],
        build: |given| {
            let Some(table) = given.get("iterations") else { return Ok(None) };
            let mut grid = grid::Grid::new(["model", "#cost"]);
            (0..table.rows()).for_each(|r| {
                grid.push(vec![table.text("model", r).into(), table.text("cost", r).into()])
            });
            Body::grid(grid).plot("toy", &table.column("cost")).map(Some)
        },
    };
    static WITH: &[Section] = &[TOY, logs::NOTES];
    let table = Table::build("iterations")
        .repeat("model", "elevator")
        .repeat("group", "s1")
        .i64("iteration", [0])
        .f64("cost", [12.5]);
    let table = table
        .f64("det_r", [1.0])
        .f64("change", [f64::NAN])
        .f64("step", [f64::NAN])
        .f64("gradient", [1.0]);
    let table = table.i64("halvings", [0]).f64("damping", [0.0]).finish().expect("iterations");
    let with = frame([("iterations".to_string(), table)].into());
    let html = page_with(WITH, &with).expect("page");
    for part in ["<section id=\"toy\">", "href=\"#toy\">Iterations", "12.5</td>", "\"toy\":[12.5]"]
    {
        assert!(html.contains(part), "{part}");
    }
    assert!(
        !page_with(WITH, &frame(Tables::new())).expect("page").contains("id=\"toy\""),
        "nothing to show, no place"
    );
}

/// The numbers in the round brackets of `equation`, in the order in which they stand.
fn numbers(equation: &str) -> Vec<f64> {
    let inside = equation.split('(').skip(1).filter_map(|rest| rest.split(')').next());
    inside
        .flat_map(|pair| pair.split('±'))
        .map(|word| word.trim().parse().expect("a number"))
        .collect()
}

#[test]
fn a_printed_line_is_the_drawn_one_and_its_interval_is_95_percent() {
    let all = campaign();
    let of = |name: &str| Columns::of(&all[name]);
    let (fits, bands, points) = (of("fits"), of("bands"), of("points"));
    let (text, plots) = lines::lines(Some(&fits), Some(&bands), Some(&points));
    for (row, (caption, plot)) in text.models[0].plots.iter().zip(&plots).enumerate() {
        assert_eq!(plot.x_unit, "deg");
        let line = numbers(caption.equation.split_once('=').expect("an equation").1);
        let [slope, half, intercept, of_intercept] = line[..] else {
            panic!("{}", caption.equation)
        };
        let band = plot.band.as_ref().expect("a band");
        let (x, drawn) = (band.x[50].expect("x"), band.value[50].expect("y"));
        let sd = |column: &str| fits.number(column, row);
        let factor = crate::math::distribution::t_quantile(0.975, fits.number("n", row) - 2.0);
        let (a, b) =
            (factor * sd("slope_sd") / 180.0 * std::f64::consts::PI, factor * sd("intercept_sd"));
        assert!(
            (slope * x + intercept - drawn).abs() < 0.1 * a * x + 0.1 * b,
            "{} at {x}: {drawn}",
            caption.equation
        );
        assert!(
            (half - a).abs() < 0.06 * a && (of_intercept - b).abs() < 0.06 * b,
            "{}: {a} {b}",
            caption.equation
        );
        assert!(
            caption.equation.contains("per deg]") || caption.equation.contains("[1/deg]"),
            "{}",
            caption.equation
        );
    }
}

#[test]
fn the_meaning_of_an_interval_is_said_once_and_written_in_one_place() {
    let all = campaign();
    let html = page(&frame(all.clone())).expect("page");
    assert_eq!(html.matches("half of the 95% interval").count(), 1);
    let estimates = Columns::of(&all["estimates"]);
    for row in [0, 12, 23] {
        let text = format::plus_minus(estimates.number("value", row), estimates.number("sd", row));
        assert!(text.contains(" ± ") && html.contains(&text), "{text}");
    }
    // Whoever writes the sign by hand would have to know what it means: only format.rs does, and
    // bars drawn as it says.
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/report");
    for folder in [folder.clone(), folder.join("html")] {
        for entry in std::fs::read_dir(folder)
            .expect("a folder")
            .map(|e| e.expect("an entry").path())
            .filter(|p| p.is_file())
        {
            let name = entry.file_name().expect("a name").to_string_lossy().into_owned();
            let text = std::fs::read_to_string(&entry).expect("text");
            let code = text
                .lines()
                .take_while(|l| l.trim() != "#[cfg(test)]")
                .filter(|l| !l.trim_start().starts_with("//"));
            let hand = code
                .filter(|l| l.contains('±') || l.contains("+-") || l.contains("&plusmn;"))
                .count();
            assert!(
                hand == 0 || ["format.rs", "tests.rs", "page.js"].contains(&name.as_str()),
                "{name} writes ± by hand"
            );
        }
    }
}

#[test]
fn a_record_that_is_estimated_as_it_is_needs_no_maneuvers_and_shows_its_inputs() {
    let mut all = campaign();
    let rename = |name: &str, all: &mut Tables| {
        let t = &all[name];
        let names: Vec<String> = t
            .strings("segment")
            .expect("segments")
            .iter()
            .map(|_| "flight-1".to_string())
            .collect();
        (t.clone(), names)
    };
    all.remove("segments");
    let (t, names) = rename("responses", &mut all);
    let of = |c: &str| t.f64(c).expect("column").to_vec();
    let responses = Table::build("responses")
        .repeat("model", "elevator")
        .strings("group", &names)
        .strings("segment", &names);
    let responses = responses
        .repeat("output", "delta_e")
        .repeat("unit", "rad")
        .f64("t_s", of("t_s"))
        .f64("measured", of("measured"));
    let responses = responses
        .f64("modelled", of("modelled"))
        .f64("residual", of("residual"))
        .f64("simulated", of("simulated"))
        .finish()
        .expect("responses");
    all.insert("responses".into(), responses);
    let inputs = [("elevator".to_string(), vec!["servo_torque".to_string()])].into();
    let unasked = vec!["segments", "conditions"];
    let html = page(&ReportInput { inputs, unasked, ..frame(all) }).expect("page");
    assert!(
        !html.contains("maneuvers found</span>")
            && html.contains("record estimated as one segment")
    );
    assert!(
        html.contains("\"inputs\":[{\"name\":\"servo_torque\""),
        "the inputs of the record are not drawn"
    );
    assert!(html.contains("No maneuvers are searched for in this campaign"));
}

#[test]
fn missing_tables_are_said_to_be_missing() {
    let html = page(&frame(Tables::new())).expect("page");
    for sentence in [
        "No fitted line",
        "No time history",
        "No estimate",
        "No table of segments",
        "No account of channels",
        "No flight traces",
    ] {
        assert!(html.contains(sentence), "{sentence}");
    }
    let all = campaign();
    for name in all.keys() {
        let mut without = all.clone();
        without.remove(name);
        page(&frame(without)).unwrap_or_else(|e| panic!("without {name}: {e}"));
    }
}
