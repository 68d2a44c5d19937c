use super::*;
use crate::simulate::atmosphere::{FOOT, KNOT, true_airspeed};

/// The shipped campaign with one short flight of its own at `speed_kt`.
fn flight(speed_kt: f64, maneuvers: &str, timing: &str, turbulence: f64) -> Truth {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/citation/campaign.toml");
    let mut campaign = Campaign::load(&path).unwrap_or_else(|e| panic!("{e}"));
    let text = format!(
        "altitude_ft = 17000\nspeeds_kt = [{speed_kt}]\nat_each = [{maneuvers}]\nturbulence = {turbulence}\ntiming = {{ {timing} }}"
    );
    campaign.settings.flights =
        [("test".to_string(), toml::from_str::<Flight>(&text).unwrap())].into_iter().collect();
    campaign.truth("test").unwrap_or_else(|e| panic!("{e}"))
}

fn range(truth: &Truth, name: &str) -> (f64, f64) {
    let values = &truth.signals[name].values;
    values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x)))
}

#[test]
fn the_citation_stays_trimmed_in_calm_air() {
    for speed in [120.0, 160.0, 240.0] {
        let truth = flight(speed, "", "settle_s = 20", 0.0);
        for (name, allowed) in [
            ("true_airspeed", 1e-6),
            ("alpha_true", 1e-9),
            ("theta", 1e-9),
            ("delta_e", 1e-9),
            ("static_pressure_port", 1e-3),
            ("phi", 1e-9),
            ("q", 1e-9),
        ] {
            let (low, high) = range(&truth, name);
            assert!(high - low <= allowed, "{speed} kt: {name} goes from {low} to {high}");
        }
        let expected = true_airspeed(speed * KNOT, 17_000.0 * FOOT);
        assert!((truth.at(0.0)["true_airspeed"] - expected).abs() < 1e-6);
        assert!((truth.at(0.0)["load_factor"] - libm::cos(truth.at(0.0)["theta"])).abs() < 1e-6);
    }
}

#[test]
fn an_elevator_input_of_the_citation_gives_no_roll() {
    let truth = flight(160.0, "\"longitudinal\"", "settle_s = 2, end_s = 20", 0.0);
    for name in ["phi", "p", "r", "beta_vane", "delta_a"] {
        let (low, high) = range(&truth, name);
        assert!(low == 0.0 && high == 0.0, "{name} goes from {low} to {high}");
    }
    let (low, high) = range(&truth, "q");
    assert!(low < -0.01 && high > 0.01, "{low} {high}");
    // Coefficients stay those of the trimmed condition while the maneuver lasts.
    let m = &truth.maneuvers[0];
    assert_eq!(truth.at(m.t_start_s)["C_h_delta_true"], truth.at(m.t_end_s)["C_h_delta_true"]);
}

#[test]
fn the_citation_rides_through_turbulence() {
    let truth = flight(160.0, "\"lateral\", \"longitudinal\"", "settle_s = 20, end_s = 60", 1.0);
    // A vertical gust of 1 m/s is 0.0094 rad of alpha at 106.5 m/s; the aircraft gives way to the
    // slow part of it.
    let alpha = &truth.signals["alpha_vane"].values;
    let mean = alpha.iter().sum::<f64>() / alpha.len() as f64;
    let sd =
        (alpha.iter().map(|a| (a - mean) * (a - mean)).sum::<f64>() / alpha.len() as f64).sqrt();
    assert!((0.002..0.03).contains(&sd), "{sd}");
    for (name, low, high) in
        [("phi", -0.8, 0.8), ("true_airspeed", 95.0, 118.0), ("theta", -0.1, 0.25)]
    {
        let (least, most) = range(&truth, name);
        assert!(least > low && most < high, "{name} goes from {least} to {most}");
    }
}
