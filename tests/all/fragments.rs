//! The embedded fragments against numbers and limits known from elsewhere.

use koehler::dynamics::{Directions, Propagator, Record};
use koehler::model::{Constants, Model};

/// Outputs of a model without states for one set of inputs.
fn evaluate(text: &str, inputs: &[(&str, f64)], outputs: &[&str]) -> Vec<f64> {
    let model =
        Model::parse("fragments", text, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let value =
        |name: &str| inputs.iter().find(|i| i.0 == name).unwrap_or_else(|| panic!("{name}")).1;
    let row: Vec<f64> = model.inputs.iter().map(|i| value(&i.name)).collect();
    let record = Record { dt: 1.0, n: 1, inputs: row.into(), ..Default::default() };
    let grid = propagator.run(&model.parameter_starts(), &[], &record, false);
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
    // standard sea level: all airspeeds are one, density 1.225 kg/m^3, speed of sound 340.294 m/s
    // (ISO 2533)
    let at =
        evaluate(AIR, &[("static_pressure", 101325.0), ("T_air", 288.15), ("V", 100.0)], &names);
    close("density", at[0], 1.225, 1e-5);
    close("Mach", at[1], 100.0 / 340.294, 1e-5);
    close("calibrated airspeed", at[2], 100.0, 1e-12);
    close("equivalent airspeed", at[3], 100.0, 1e-6);
    assert!(at[4].abs() < 1e-6, "{}", at[4]);
    // standard day at 10 km (ISO 2533: 26436.3 Pa, 223.15 K geopotential), Mach 0.8
    let speed = 0.8 * (1.4f64 * 287.05287 * 223.15).sqrt();
    let at =
        evaluate(AIR, &[("static_pressure", 26436.3), ("T_air", 223.15), ("V", speed)], &names);
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
    // at constant airspeed, u = V cos(alpha): udot = -V sin(alpha) alphadot, wdot = V cos(alpha)
    // alphadot
    let motion = |speed: f64, alpha: f64| {
        let (u, w) = (speed * alpha.cos(), speed * alpha.sin());
        vec![
            ("alpha", alpha),
            ("V", speed),
            ("u", u),
            ("w", w),
            ("udot", -w * rate),
            ("wdot", u * rate),
            ("q", 0.05),
        ]
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

/// What a kinematic model without measurements gives at one point: outputs by name.
fn kinematic(text: &str, inputs: &[(&str, f64)], outputs: &[&str]) -> Vec<f64> {
    let given = |name: &str, unit: &str| {
        (
            name.to_string(),
            koehler::model::Given {
                value: 0.0,
                unit: unit.into(),
                sd: 0.0,
                source: "test".into(),
                origin: None,
            },
        )
    };
    let places = ["y_imu", "z_imu", "x_alpha", "y_alpha", "x_beta", "z_beta"];
    let constants =
        places.iter().map(|name| given(name, "m")).chain([given("upwash", "-")]).collect();
    let model = Model::parse("path", text, &Constants(constants)).unwrap_or_else(|e| panic!("{e}"));
    let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
    let value = |name: &str| inputs.iter().find(|i| i.0 == name).map_or(0.0, |i| i.1);
    // two samples, so that inputs have slopes
    let row: Vec<f64> = model.inputs.iter().map(|i| value(&i.name)).collect();
    let later: Vec<f64> = model
        .inputs
        .iter()
        .zip(&row)
        .map(|(i, x)| x + 0.01 * value(&format!("{}'", i.name)))
        .collect();
    let record = Record {
        dt: 0.01,
        n: 2,
        inputs: [row, later].concat().into(),
        start: 0,
        ..Default::default()
    };
    let starts: Vec<f64> = model.states.iter().map(|s| value(&s.quantity.name)).collect();
    let states = (0..model.states.len()).collect();
    let propagator = if starts.is_empty() {
        propagator
    } else {
        Propagator::new(&model, Directions { parameters: Vec::new(), starts: states })
            .expect("a propagator")
    };
    let run = propagator.run(&model.parameter_starts(), &starts, &record, false);
    outputs.iter().map(|name| run.y[model.output(name).expect("an output")]).collect()
}

const PATH: &str = r#"
title = "path"
use = ["path_imu", "path_air", "path_euler", "path_altitude", "EARTH", "path_vanes", "path_outputs"]
[inputs]
temperature = "K"
CG
[constants]
x_imu = { unit = "m", value = 2.0 }
NONE
y_cg = { unit = "m", value = 0.0 }
z_cg = { unit = "m", value = 0.0 }
[equations]
T_air = "temperature"
LATITUDE
[outputs]
p_horizon = { unit = "rad/s", value = "p_att" }
q_horizon = { unit = "rad/s", value = "q_att" }
r_horizon = { unit = "rad/s", value = "r_att" }
g_here    = { unit = "m/s^2", value = "g_here" }
"#;

#[test]
fn the_centre_of_gravity_moves_where_the_model_says_so() {
    let text = PATH
        .replace("EARTH", "path_flat_earth")
        .replace("CG", "fuel = \"kg\"")
        .replace("LATITUDE", "x_cg = \"0.5*shift*fuel\"");
    let text = text.replace("NONE", "shift = { unit = \"m/kg\", value = 0.002 }");
    let at = [
        ("q_imu", 0.2),
        ("q_imu'", 1.5),
        ("az_imu", -12.0),
        ("ax_imu", 1.0),
        ("u", 100.0),
        ("temperature", 280.0),
    ];
    for fuel in [0.0, 700.0] {
        let got = kinematic(&text, &[&at[..], &[("fuel", fuel)]].concat(), &["ax", "az"]);
        // the sensor is ahead of the centre of gravity by this: centripetal along x, the nose's
        // rise along -z
        let arm = 2.0 - 0.001 * fuel;
        close("ax", got[0], 1.0 + arm * 0.04, 1e-9);
        close("az", got[1], -12.0 + arm * 1.5, 1e-6);
    }
}

#[test]
fn truth_gyros_of_level_flight_over_a_turning_round_earth_do_not_tilt_the_horizon() {
    let text = PATH
        .replace("EARTH", "path_round_earth")
        .replace("CG", "")
        .replace("LATITUDE", "latitude = \"atan(1/sqrt(lat_2))\"");
    let text = text.replace(
        "NONE",
        "lat_2 = { unit = \"-\", value = 3.0 }\nx_cg = { unit = \"m\", value = 0.0 }",
    );
    // 30 deg north, eastward at 200 m/s and 11 km: what gyros of an aircraft see that stays level
    // on its parallel
    let (lat, radius, omega) = (std::f64::consts::FRAC_PI_6, 6371000.0 + 11000.0, 7.292115e-5);
    let (north, down) =
        (omega * lat.cos() + 200.0 / radius, -omega * lat.sin() - 200.0 * lat.tan() / radius);
    let (speed, heading) = (("u", 200.0), ("psi", std::f64::consts::FRAC_PI_2));
    let at = [
        speed,
        heading,
        ("h", 11000.0),
        ("temperature", 216.65),
        ("p_imu", 0.0),
        ("q_imu", -north),
        ("r_imu", down),
    ];
    let got = kinematic(&text, &at, &["p_horizon", "q_horizon", "r_horizon", "g_here"]);
    for (name, rate) in ["roll", "pitch", "yaw"].iter().zip(&got) {
        assert!(rate.abs() < 1e-17, "{name} {rate}");
    }
    close("free fall", got[3], 9.80665 * (6371.0f64 / 6382.0).powi(2), 1e-12);
}
