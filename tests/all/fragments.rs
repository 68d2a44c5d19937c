//! The embedded fragments against numbers and limits known from elsewhere.

use koehler::dynamics::{Directions, Plan, Record};
use koehler::model::{Constants, Model};

/// Outputs of a model without states for one set of inputs.
fn evaluate(text: &str, inputs: &[(&str, f64)], outputs: &[&str]) -> Vec<f64> {
    let model = Model::parse("fragments", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
    let plan = Plan::new(&model, Directions::default()).expect("a plan");
    let value = |name: &str| inputs.iter().find(|i| i.0 == name).unwrap_or_else(|| panic!("{name}")).1;
    let row: Vec<f64> = model.inputs.iter().map(|i| value(&i.name)).collect();
    let record = Record { dt: 1.0, n: 1, inputs: row, ..Default::default() };
    let grid = plan.run(&model.parameter_starts(), &[], &record, false);
    outputs.iter().map(|name| grid.y[model.output(name).expect("an output")]).collect()
}

const AIR: &str = r#"
title = "air data"
use = ["air_data"]
[inputs]
static_pressure = "Pa"
T_air = "K"
V = "m/s"
[outputs]
rho = { unit = "kg/m^3", value = "rho" }
Mach = { unit = "-", value = "Mach" }
V_cas = { unit = "m/s", value = "V_cas" }
V_eas = { unit = "m/s", value = "V_eas" }
h_p = { unit = "m", value = "h_p" }
impact = { unit = "Pa", value = "impact_pressure" }
"#;

fn close(what: &str, got: f64, want: f64, relative: f64) {
    assert!((got - want).abs() <= relative * want.abs(), "{what}: {got} for {want}");
}

#[test]
fn truth_air_data_at_sea_level_and_aloft() {
    let names = ["rho", "Mach", "V_cas", "V_eas", "h_p", "impact"];
    // standard sea level: all airspeeds are one, density 1.225 kg/m^3, speed of sound 340.294 m/s (ISO 2533)
    let at = evaluate(AIR, &[("static_pressure", 101325.0), ("T_air", 288.15), ("V", 100.0)], &names);
    close("density", at[0], 1.225, 1e-5);
    close("Mach", at[1], 100.0 / 340.294, 1e-5);
    close("calibrated airspeed", at[2], 100.0, 1e-12);
    close("equivalent airspeed", at[3], 100.0, 1e-6);
    assert!(at[4].abs() < 1e-6, "{}", at[4]);
    // standard day at 10 km (ISO 2533: 26436.3 Pa, 223.15 K geopotential), Mach 0.8
    let speed = 0.8 * (1.4f64 * 287.05287 * 223.15).sqrt();
    let at = evaluate(AIR, &[("static_pressure", 26436.3), ("T_air", 223.15), ("V", speed)], &names);
    close("density", at[0], 0.41271, 1e-4);
    close("Mach", at[1], 0.8, 1e-12);
    close("pressure altitude", at[4], 10000.0, 1e-5);
    // isentropic tables: p_0/p = 1.524338 at Mach 0.8
    close("impact pressure", at[5], 26436.3 * 0.524338, 1e-5);
    // compressibility: calibrated above equivalent airspeed, both far below true
    assert!(at[3] < at[2] && at[2] < 0.7 * speed, "{at:?}");
    // slow: incompressible, impact pressure is qbar
    let at = evaluate(AIR, &[("static_pressure", 80000.0), ("T_air", 280.0), ("V", 1.0)], &names);
    close("impact pressure of slow flow", at[5], 0.5 * at[0], 1e-4);
}

const TAIL: &str = r#"
title = "tail"
use = ["tail_flow", "downwash"]
[inputs]
alpha = "rad"
V = "m/s"
u = "m/s"
w = "m/s"
udot = "m/s^2"
wdot = "m/s^2"
q = "rad/s"
[constants]
alpha_0 = { unit = "rad", value = -0.02 }
i_h = { unit = "rad", value = -0.035 }
l_h = { unit = "m", value = 5.0 }
wing_aspect_ratio = { unit = "-", value = 8.0 }
[outputs]
deps = { unit = "-", value = "deps_da" }
alpha_h = { unit = "rad", value = "alpha_tail" }
alpha_h_star = { unit = "rad", value = "alpha_tail_pitching" }
alphadot = { unit = "rad/s", value = "alphadot_w" }
"#;

#[test]
fn the_tail_sees_downwash_and_its_own_motion() {
    let names = ["deps", "alpha_h", "alpha_h_star", "alphadot"];
    let (speed, alpha, rate) = (100.0f64, 0.1f64, 0.2);
    // at constant airspeed, u = V cos(alpha): udot = -V sin(alpha) alphadot, wdot = V cos(alpha) alphadot
    let motion = |speed: f64, alpha: f64| {
        let (u, w) = (speed * alpha.cos(), speed * alpha.sin());
        vec![("alpha", alpha), ("V", speed), ("u", u), ("w", w), ("udot", -w * rate), ("wdot", u * rate), ("q", 0.05)]
    };
    let at = evaluate(TAIL, &motion(speed, alpha), &names);
    close("downwash gradient", at[0], 0.4, 1e-12);
    close("tail angle", at[1], 0.12 * 0.6 - 0.055, 1e-12);
    close("with pitching", at[2], at[1] + 5.0 * 0.05 / speed, 1e-12);
    close("alphadot", at[3], rate, 1e-12);
    // at the zero-lift angle there is no downwash; at rest nothing is infinite
    let at = evaluate(TAIL, &motion(speed, -0.02), &names);
    close("without lift", at[1], -0.055, 1e-12);
    let at = evaluate(TAIL, &motion(0.0, 0.0), &names);
    assert!(at.iter().all(|v| v.is_finite()) && at[3] == 0.0, "{at:?}");
}
