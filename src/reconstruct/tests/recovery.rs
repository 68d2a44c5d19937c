//! Are states, wind and sensor errors found again, inside their intervals at the right rate?

use super::*;

fn coverage(sigma: f64) {
    let heights = altitude();
    let flights = 6;
    let mut inside = [0; 7];
    let mut all = 0;
    for seed in 0..flights {
        let flown = fly(seed + 1, sigma, &heights);
        let path = path(&flown);
        // far enough apart to be nearly independent
        let lists = normed(&flown, &heights, &path, |t| t > 1.0 && (t / 3.0).fract() < 0.0125);
        all += lists[0].len();
        for (inside, list) in inside.iter_mut().zip(&lists) {
            *inside += list.iter().filter(|e| e.abs() < 1.96).count();
        }
        for bias in &path.biases {
            let k = INERTIAL
                .iter()
                .position(|n| n[..2] == bias.parameter[2..] || n[..1] == bias.parameter[2..])
                .expect("a bias");
            let e = (bias.value - BIAS[k]) / bias.sd.expect("an sd");
            assert!(e.abs() < 4.5, "{} {e}", bias.parameter);
        }
    }
    assert!(all >= 60, "{all}");
    for (name, n) in STATES.iter().zip(inside) {
        let share = n as f64 / all as f64;
        // 95% within what so many points can tell (three standard deviations of a binomial count)
        let slack = 3.0 * (0.95 * 0.05 / all as f64).sqrt();
        assert!((share - 0.95).abs() < slack + 0.5 / all as f64, "{name}: {share} of {all}");
    }
}

#[test]
fn recovery_intervals_of_the_states_cover_the_truth_in_calm_air() {
    coverage(0.0);
}

#[test]
fn recovery_intervals_of_the_states_cover_the_truth_in_turbulence() {
    coverage(0.8);
}

#[test]
fn a_clean_flight_is_called_good() {
    let heights = altitude();
    let path = path(&fly(11, 0.0, &heights));
    assert!(path.notes.is_empty(), "{:?}", path.notes);
    // Nothing else tells static pressure here, and that is said.
    let unlike = path.checks.iter().filter(|r| r.check != "sensor error" && r.verdict != "good");
    let bad: Vec<_> = unlike.map(|r| (r.channel.as_str(), r.verdict)).collect();
    assert_eq!(bad, [("static_pressure", "not compared")]);
    let signs = path.checks.iter().filter(|r| r.check == "sign" && r.verdict == "good").count();
    assert!(
        signs >= 12,
        "{signs} channels compared: {:#?}",
        path.checks.iter().filter(|r| r.check == "sign").collect::<Vec<_>>()
    );
}

fn error<'a>(path: &'a FlightPath, parameter: &str) -> &'a Bias {
    path.biases
        .iter()
        .find(|b| b.parameter == parameter)
        .unwrap_or_else(|| panic!("no {parameter}: {:?}", path.biases))
}

/// Whether `truth` is within `limit` standard deviations of an estimated sensor error.
fn within(path: &FlightPath, parameter: &str, truth: f64, limit: f64) -> f64 {
    let found = error(path, parameter);
    let z = (found.value - truth) / found.sd.expect("a standard deviation");
    assert!(z.abs() < limit, "{parameter}: {} +- {:?} for {truth}", found.value, found.sd);
    z
}

#[test]
fn recovery_scale_bias_and_delay_of_a_vane_at_the_right_rate() {
    let scene = Scene { vane: [1.08, 0.012, 0.07], ..CALM };
    let heights = heights(&scene);
    let names = |list: &[&str]| list.iter().map(|s| s.to_string()).collect::<Vec<_>>();
    let settings = Settings {
        late: names(&["alpha_vane"]),
        candidates: names(&["k_alpha", "b_alpha", "b_beta"]),
        ..settings()
    };
    let (mut inside, mut all) = (0, 0);
    for seed in 0..8 {
        let flown = record(40 + seed, scene, &heights);
        let path = path_by(&flown, &kinematics(), &settings);
        for (name, truth) in [("k_alpha", 1.08), ("b_alpha", 0.012), ("tau_alpha_vane", 0.07)] {
            inside += usize::from(within(&path, name, truth, 4.0).abs() < 1.96);
            all += 1;
        }
        assert!(error(&path, "tau_alpha_vane").sd.expect("sd") < 0.01);
        let row = path
            .checks
            .iter()
            .find(|r| r.channel == "b_beta" && r.check == "sensor error")
            .expect("a decision");
        // there is none: at most one in twenty is called significant, and then it is small
        assert!(row.verdict == "not significant" || row.value.abs() < 3e-3, "{row:?}");
    }
    let slack = 3.0 * (0.95f64 * 0.05 / all as f64).sqrt();
    assert!(inside as f64 / all as f64 > 0.95 - slack, "{inside} of {all}");
}

#[test]
fn recovery_constant_wind_where_ground_speed_is_logged() {
    let scene = Scene { wind: [9.0, -6.0], ..CALM };
    let heights = heights(&scene);
    // the motion over ground turns by some 2.4 rad; airspeed and track together tell the wind
    for seed in 0..3 {
        let flown = record(60 + seed, scene, &heights);
        let settings = Settings { gusts: Vec::new(), ..settings() };
        let path = path_by(&flown, &embedded("kinematics_wind"), &settings);
        within(&path, "wind_n", 9.0, 3.5);
        within(&path, "wind_e", -6.0, 3.5);
        assert!(error(&path, "wind_n").sd.expect("sd") < 0.5, "{:?}", error(&path, "wind_n"));
    }
}

/// `kinematics_wind` where a position is logged.
const POSITION: [&str; 8] = [
    "path_imu",
    "path_ground",
    "path_euler",
    "path_altitude",
    "path_flat_earth",
    "path_vanes",
    "path_outputs",
    "path_position",
];
/// Any attitude.
const LOOP: [&str; 7] = [
    "path_imu",
    "path_air",
    "path_quaternion",
    "path_altitude",
    "path_flat_earth",
    "path_vanes",
    "path_outputs",
];

/// A kinematic model put together of parts, about a centre of gravity that stays where it is.
fn put_together(title: &str, parts: &[&str]) -> String {
    let constants = ["x_cg", "y_cg", "z_cg"]
        .map(|name| format!("{name} = {{ unit = \"m\", value = 0.0 }}"))
        .join("\n");
    format!(
        "title = \"{title}\"\nuse = {parts:?}\n[inputs]\ntemperature = \"K\"\n[constants]\n{constants}\n[equations]\nT_air = \"temperature\"\n"
    )
}

#[test]
fn recovery_position_and_wind_where_a_position_is_logged() {
    let scene = Scene { wind: [9.0, -6.0], ..CALM };
    let heights = heights(&scene);
    let mut flown = record(65, scene, &heights);
    // the motion is that over ground
    let still = Flown {
        gust: vec![[0.0; 3]],
        scene: Scene { wind: [0.0; 2], ..scene },
        signals: IndexMap::new(),
    };
    let mut places = vec![[1000.0, -500.0]];
    for k in 0..(scene.duration * 1000.0) as usize {
        let t = (k as f64 + 0.5) * 1e-3;
        let [north, east] = earth(&truth(&still, &heights, t), motion(t)[5]);
        places.push([places[k][0] + 1e-3 * north, places[k][1] + 1e-3 * east]);
    }
    let place = |t: f64| places[((t * 1000.0).round() as usize).min(places.len() - 1)];
    let mut normal = Normal::new(66);
    let t: Vec<f64> = (0..195).map(|k| 0.1 + 0.2 * k as f64).collect();
    for (i, name) in ["north", "east"].into_iter().enumerate() {
        let z = t.iter().map(|&t| place(t)[i] + 2.0 * normal.next()).collect();
        flown.signals.insert(name.to_string(), (t.clone(), z));
    }
    ["ground_speed", "track"].iter().for_each(|name| {
        flown.signals.shift_remove(*name);
    });
    let model = from_fragments("position", &put_together("Position over ground", &POSITION));
    let path = path_by(&flown, &model, &Settings { gusts: Vec::new(), ..settings() });
    within(&path, "wind_n", 9.0, 3.5);
    within(&path, "wind_e", -6.0, 3.5);
    assert!(error(&path, "wind_n").sd.expect("sd") < 0.5, "{:?}", error(&path, "wind_n"));
    for (i, name) in ["north", "east"].into_iter().enumerate() {
        let k = model.output(name).expect("an output");
        for (p, &t) in path.t.iter().enumerate() {
            let e = (path.outputs[k][p] - place(t)[i]) / path.sd[k][p];
            assert!(
                e.abs() < 5.0 && path.sd[k][p] < 2.0,
                "{name} at {t}: {e} standard deviations off, {} m",
                path.sd[k][p]
            );
        }
    }
}

#[test]
fn recovery_lever_arms_where_angular_acceleration_excites_them_and_not_elsewhere() {
    let candidates: Vec<String> = ["dx_imu", "dz_imu"].map(String::from).to_vec();
    let settings = Settings { candidates, ..settings() };
    let scene = Scene { motion: shaken, arm: [1.5, 0.0, -0.6], ..CALM };
    let heights_of = heights(&scene);
    let path = path_by(&record(70, scene, &heights_of), &kinematics(), &settings);
    within(&path, "dx_imu", 1.5, 3.5);
    within(&path, "dz_imu", -0.6, 3.5);
    let scene = Scene { motion: straight, arm: [1.5, 0.0, -0.6], ..CALM };
    let heights_of = heights(&scene);
    let path = path_by(&record(71, scene, &heights_of), &kinematics(), &settings);
    for name in ["dx_imu", "dz_imu"] {
        let row = path.checks.iter().find(|r| r.channel == name).expect("a decision");
        assert_eq!(row.verdict, "not observable", "{row:?}");
    }
}

/// A short record does not tell a small bias of a vane: held at none, it is in the standard deviation of the
/// path all the same.
#[test]
fn coverage_of_a_path_with_an_error_that_the_data_do_not_tell() {
    let scene = Scene { vane: [1.0, 0.002, 0.0], duration: 2.5, ..CALM };
    let heights = heights(&scene);
    let settings = Settings { candidates: vec!["b_alpha".to_string()], ..settings() };
    let (mut squares, mut held) = (0.0, 0);
    for seed in 0..24 {
        let flown = record(90 + seed, scene, &heights);
        let path = path_by(&flown, &kinematics(), &settings);
        if path.biases.iter().any(|b| b.parameter == "b_alpha") {
            continue;
        }
        let z = normed(&flown, &heights, &path, |t| (t - 1.25).abs() < 0.01)[2][0];
        println!("{seed}: {z:.2}");
        (squares, held) = (squares + z * z, held + 1);
    }
    let rms = (squares / f64::from(held)).sqrt();
    assert!(held >= 6 && (0.5..1.8).contains(&rms), "{rms} of {held}");
}

/// Wind would take up an airspeed in another unit.
#[test]
fn an_airspeed_in_another_unit_is_told_whatever_the_wind_says() {
    let scene = Scene { wind: [9.0, -6.0], ..CALM };
    let heights = heights(&scene);
    let settings = Settings { gusts: Vec::new(), ..settings() };
    for (scale, verdict) in [(1.0, "good"), (1.03, "scaled"), (0.5144, "scaled")] {
        let mut flown = record(61, scene, &heights);
        flown.signals["V"].1.iter_mut().for_each(|v| *v *= scale);
        let path = path_by(&flown, &embedded("kinematics_wind"), &settings);
        let row = path.checks.iter().find(|r| r.channel == "V" && r.check == "level");
        let row = row.unwrap_or_else(|| panic!("{scale}: {:?}", path.notes));
        assert_eq!(row.verdict, verdict, "{scale}: {row:?}");
    }
}

/// Quick oscillations about all axes.
fn shaken(t: f64) -> [f64; 6] {
    use libm::sin;
    let [u, v, w, phi, theta, psi] = motion(t);
    [u, v, w, phi + 0.12 * sin(4.0 * t), theta + 0.05 * sin(5.0 * t), psi + 0.04 * sin(4.5 * t)]
}

/// Straight and level.
fn straight(_: f64) -> [f64; 6] {
    [110.0, 0.0, 7.7, 0.0, 0.07, 1.0]
}

/// A loop in the plane: the pitch angle runs from 0.05 on through whole turns.
fn looping(t: f64) -> [f64; 6] {
    let s = (t / 40.0).clamp(0.0, 1.0);
    let turn = s * s * (3.0 - 2.0 * s);
    [
        110.0 + 20.0 * libm::cos(2.0 * std::f64::consts::PI * turn),
        0.0,
        6.0 + libm::sin(1.3 * t),
        0.0,
        0.05 + 2.0 * std::f64::consts::PI * turn,
        0.6,
    ]
}

#[test]
fn recovery_of_a_loop_by_the_quaternion() {
    let scene = Scene { motion: looping, ..CALM };
    let heights = heights(&scene);
    let mut flown = record(80, scene, &heights);
    // as logged: pitch within a quarter turn, bank and heading half a turn off while inverted
    let pitch = flown.signals["theta"].1.clone();
    let inverted: Vec<bool> = pitch.iter().map(|p| libm::cos(*p) < 0.0).collect();
    flown.signals["theta"].1.iter_mut().for_each(|p| *p = libm::asin(libm::sin(*p)));
    for name in ["phi", "psi"] {
        let half = std::f64::consts::PI;
        let list =
            flown.signals[name].1.iter_mut().zip(&inverted).filter(|(_, inverted)| **inverted);
        list.for_each(|(a, _)| *a -= half);
    }
    let model = from_fragments("loop", &put_together("Any attitude", &LOOP));
    let path = path_by(&flown, &model, &settings());
    let of = |name: &str| model.output(name).expect("an output");
    let mut worst = [0.0f64; 3];
    for (k, &t) in path.t.iter().enumerate() {
        let x = truth(&flown, &heights, t);
        let up = libm::asin(libm::sin(x[4]));
        let z = [(of("theta"), up), (of("u"), x[0]), (of("w"), x[2])];
        for (worst, (i, true_value)) in worst.iter_mut().zip(z) {
            assert!(path.outputs[i][k].is_finite(), "no path at {t}: {:?}", path.notes);
            // pitch has no sensible deviation within some degrees of the vertical, where it turns
            // round
            if i != of("theta") || up.abs() < 1.4 {
                *worst = worst.max(((path.outputs[i][k] - true_value) / path.sd[i][k]).abs());
            }
        }
    }
    assert!(worst.iter().all(|z| *z < 5.5), "{worst:?} {:?}", path.notes);
}
