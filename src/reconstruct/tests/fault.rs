//! Sensors that are missing, dead, reversed, late or silent: is the path right all the same, or is
//! it said that it is not?

use super::*;

#[test]
fn fault_a_gap_of_two_seconds_is_coasted_over_and_one_of_five_has_no_path() {
    let heights = altitude();
    let mut flown = fly(12, 0.0, &heights);
    for name in INERTIAL {
        let (t, y) = &mut flown.signals[name];
        let keep: Vec<usize> = (0..t.len())
            .filter(|&k| !(15.0..17.0).contains(&t[k]) && !(25.0..30.0).contains(&t[k]))
            .collect();
        (*t, *y) = (keep.iter().map(|&k| t[k]).collect(), keep.iter().map(|&k| y[k]).collect());
    }
    let path = path(&flown);
    nowhere_wrong(&flown, &heights, &path, 5.0);
    let theta = &path.outputs[kinematics().output("theta").expect("theta")];
    let known =
        |t: f64| theta[path.t.iter().position(|x| *x >= t).expect("on the grid")].is_finite();
    assert!(known(16.0) && !known(27.0) && known(35.0));
    assert!(path.notes.iter().any(|n| n.text.contains("gap")), "{:?}", path.notes);
    assert_eq!(verdict(&path, "q_imu", "gaps"), "gaps");
}

#[test]
fn fault_a_burst_of_nan_is_passed_over() {
    let heights = altitude();
    let mut flown = fly(13, 0.0, &heights);
    for name in ["q_imu", "alpha_vane", "theta"] {
        let (t, y) = &mut flown.signals[name];
        t.iter().zip(y).filter(|(t, _)| (20.0..20.7).contains(*t)).for_each(|(_, y)| *y = f64::NAN);
    }
    let path = path(&flown);
    nowhere_wrong(&flown, &heights, &path, 5.0);
    assert!(
        path.outputs[kinematics().output("theta").expect("theta")].iter().all(|v| v.is_finite())
    );
    assert_eq!(verdict(&path, "alpha_vane", "gaps"), "gaps");
}

#[test]
fn fault_a_dead_gyro_is_named_and_gives_no_path() {
    let heights = altitude();
    let mut flown = fly(14, 0.0, &heights);
    flown.signals["r_imu"].1.fill(0.001);
    let path = path(&flown);
    assert_eq!(verdict(&path, "r_imu", "standing still"), "dead");
    assert!(path.outputs.iter().flatten().all(|v| v.is_nan()));
    assert!(path.notes.iter().any(|n| n.text.contains("r_imu is dead")), "{:?}", path.notes);
}

#[test]
fn fault_a_gyro_that_freezes_for_ten_seconds_has_no_path_there() {
    let heights = altitude();
    let mut flown = fly(15, 0.0, &heights);
    let (t, y) = &mut flown.signals["p_imu"];
    let held = y[t.iter().position(|t| *t > 20.0).expect("a sample")];
    t.iter().zip(y).filter(|(t, _)| (20.0..30.0).contains(*t)).for_each(|(_, y)| *y = held);
    let path = path(&flown);
    assert_eq!(verdict(&path, "p_imu", "standing still"), "frozen");
    nowhere_wrong(&flown, &heights, &path, 5.0);
    let phi = &path.outputs[kinematics().output("phi").expect("phi")];
    assert!(path.t.iter().zip(phi).all(|(t, v)| !(21.0..29.0).contains(t) || v.is_nan()));
}

/// Jammed, while its noise goes on: no value repeats.
#[test]
fn fault_a_vane_that_jams_is_told_and_not_used_there() {
    let scene = Scene { duration: 120.0, ..CALM };
    let heights = heights(&scene);
    for (seed, [from, to]) in [(31, [40.0, 75.0]), (32, [62.0, 120.0])] {
        for name in ["alpha_vane", "beta_vane"] {
            let mut flown = record(seed, scene, &heights);
            let (t, y) = &mut flown.signals[name];
            let held = y[t.partition_point(|t| *t < from)];
            let noise = |k: usize| 1e-3 * (2.0 * libm::sin(1e4 * k as f64)).clamp(-1.5, 1.5);
            let jammed = (0..t.len()).filter(|&k| (from..to).contains(&t[k]));
            jammed.for_each(|k| y[k] = held + noise(k));
            let path = path(&flown);
            let row = path.checks.iter().find(|r| r.channel == name && r.check == "follows");
            assert_eq!(row.expect("asked").verdict, "stuck", "{name}: {row:?}");
            assert!(path.notes.iter().any(|n| n.text.contains("stands still from")), "{name}");
            nowhere_wrong(&flown, &heights, &path, 6.0);
        }
    }
}

#[test]
fn sensors_that_follow_are_not_stuck() {
    for (seed, gusts) in [(41, 0.0), (42, 0.0), (43, 0.5), (44, 1.5)] {
        let scene = Scene { duration: 120.0, gusts, ..CALM };
        let path = path(&record(seed, scene, &heights(&scene)));
        let asked = path.checks.iter().filter(|r| r.check == "follows");
        assert!(asked.clone().count() >= 2, "{seed}: {:?}", path.checks);
        asked.for_each(|row| assert_eq!(row.verdict, "good", "{seed}: {row:?}"));
    }
}

#[test]
fn fault_a_reversed_axis_is_named() {
    let heights = altitude();
    for name in ["p_imu", "az_imu"] {
        let mut flown = fly(16, 0.0, &heights);
        flown.signals[name].1.iter_mut().for_each(|y| *y = -*y);
        let path = path(&flown);
        assert_eq!(verdict(&path, name, "sign"), "sign reversed", "{name}: {:?}", path.notes);
        assert!(path.outputs.iter().flatten().all(|v| v.is_nan()), "{name}: a path in spite of it");
    }
    for name in ["beta_vane", "theta"] {
        let mut flown = fly(17, 0.0, &heights);
        flown.signals[name].1.iter_mut().for_each(|y| *y = -*y);
        let path = path(&flown);
        assert_eq!(verdict(&path, name, "sign"), "sign reversed", "{name}: {:?}", path.notes);
        nowhere_wrong(&flown, &heights, &path, 5.0);
    }
}

#[test]
fn fault_a_recorder_that_is_late_is_found() {
    let heights = altitude();
    let mut flown = fly(18, 0.0, &heights);
    for name in ["phi", "theta", "psi"] {
        flown.signals[name].0.iter_mut().for_each(|t| *t += 0.06);
    }
    let path = path(&flown);
    let row =
        path.checks.iter().find(|r| r.channel == "theta" && r.check == "time skew").expect("a row");
    assert_eq!(row.verdict, "late");
    assert!((row.value - 0.06).abs() < 0.02, "{row:?}");
    // no other channel is accused, and the path is that of the flight
    let innocent = ["V", "alpha_vane", "beta_vane", "static_pressure", "p_imu", "q_imu", "r_imu"];
    let wrong = |r: &&consistency::Row| {
        innocent.contains(&&*r.channel) && ["scaled", "late", "early"].contains(&r.verdict)
    };
    let accused: Vec<_> = path.checks.iter().filter(wrong).collect();
    assert!(accused.is_empty(), "{accused:#?}");
    nowhere_wrong(&flown, &heights, &path, 5.5);
}

#[test]
fn fault_gyros_that_are_exchanged_or_late_are_named_by_the_attitude() {
    let heights = altitude();
    let mut flown = fly(18, 0.0, &heights);
    let [p, q] = ["p_imu", "q_imu"].map(|name| flown.signals[name].clone());
    flown.signals.insert("p_imu".to_string(), q);
    flown.signals.insert("q_imu".to_string(), p);
    let exchanged = path(&flown);
    assert_eq!(verdict(&exchanged, "p_imu", "axis"), "exchanged", "{:?}", exchanged.checks);
    assert_eq!(verdict(&exchanged, "q_imu", "axis"), "exchanged");
    assert_eq!(verdict(&exchanged, "r_imu", "axis"), "good");
    let why = exchanged.notes.iter().find(|note| note.missing).expect("why there is no path");
    assert!(why.text.contains("p_imu and q_imu are exchanged"), "{}", why.text);
    let mut flown = fly(18, 0.0, &heights);
    flown.signals["q_imu"].0.iter_mut().for_each(|t| *t += 0.06);
    let late = path(&flown);
    let row = |name| late.checks.iter().find(|r| r.channel == name && r.check == "time skew");
    let of = row("q_imu").expect("a row");
    assert!(of.verdict == "late" && (of.value - 0.06).abs() < 0.01, "{of:?}");
    assert!(row("p_imu").is_none_or(|r| r.verdict == "good"), "{:?}", row("p_imu"));
}

#[test]
fn fault_a_clock_that_jumps_is_named() {
    // long enough that each half of the flight is a part by itself
    let scene = Scene { duration: 42.0, ..CALM };
    let heights = heights(&scene);
    let mut flown = record(21, scene, &heights);
    for name in ["phi", "theta", "psi"] {
        flown.signals[name].0.iter_mut().filter(|t| **t > 21.0).for_each(|t| *t += 0.25);
    }
    let path = path(&flown);
    let named = |name: &str| verdict(&path, name, "clock") == "clock jumps";
    let rows: Vec<_> = path.checks.iter().filter(|r| r.check == "clock").collect();
    assert!(["phi", "theta", "psi"].into_iter().any(named), "{rows:#?}");
    // those whose clocks are right are not accused
    assert!(
        !["V", "alpha_vane", "beta_vane", "static_pressure"].into_iter().any(named),
        "{rows:#?}"
    );
}

#[test]
fn fault_a_missing_sensor_leaves_honest_intervals_or_nothing() {
    let heights = altitude();
    for missing in [&["alpha_vane"][..], &["beta_vane"], &["phi", "theta", "psi"]] {
        let mut flown = fly(19, 0.0, &heights);
        missing.iter().for_each(|name| {
            flown.signals.shift_remove(*name);
        });
        let path = path(&flown);
        nowhere_wrong(&flown, &heights, &path, 5.5);
        if missing.contains(&"psi") {
            assert!(
                path.notes.iter().any(|n| n.text.contains("no sensor determines psi")),
                "{:?}",
                path.notes
            );
            assert!(
                path.outputs[kinematics().output("psi").expect("psi")].iter().all(|v| v.is_nan())
            );
        }
    }
}

/// Stands for 15 s, rolls faster and faster until 45 s, takes off and climbs.
fn from_the_ground(t: f64) -> [f64; 6] {
    let ramp = |from: f64, to: f64| {
        let s = ((t - from) / (to - from)).clamp(0.0, 1.0);
        s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
    };
    let (roll, fly) = (ramp(15.0, 45.0), ramp(46.0, 52.0));
    let airborne = fly * libm::sin(0.9 * (t - 46.0));
    let theta = 0.12 * fly + 0.03 * airborne;
    let u = 70.0 * roll;
    [u, 1.5 * airborne, 4.0 * fly + airborne, 0.2 * airborne, theta, 1.0 + 0.02 * fly * (t - 46.0)]
}

#[test]
fn fault_a_flight_that_starts_on_the_ground_is_right_in_the_air_and_says_what_was_not_used() {
    let scene = Scene { motion: from_the_ground, duration: 90.0, dead_below: 18.0, ..CALM };
    let heights = heights(&scene);
    let flown = record(22, scene, &heights);
    let path = path(&flown);
    assert!(
        path.notes.iter().any(|n| n.text.contains("slower than") && n.text.contains("alpha_vane")),
        "{:?}",
        path.notes
    );
    for (name, list) in STATES.iter().zip(normed(&flown, &heights, &path, |t| t > 50.0)) {
        let worst = list.iter().fold(0.0f64, |m, e| m.max(e.abs()));
        assert!(
            list.len() > 500 && worst < 5.0,
            "{name} is {worst} standard deviations off in the air"
        );
    }
    nowhere_wrong(&flown, &heights, &path, 6.0);
}

#[test]
fn fault_a_clock_that_jumps_by_years_gives_no_path_and_a_note() {
    let heights = altitude();
    let mut flown = fly(23, 0.0, &heights);
    for (t, _) in flown.signals.values_mut() {
        t.iter_mut().filter(|t| **t > 20.0).for_each(|t| *t += 1e9);
    }
    for by in [Method::Smoother, Method::Windows] {
        let path = path_by(&flown, &kinematics(), &Settings { by, ..settings() });
        assert!(
            path.outputs.is_empty()
                && path.notes.iter().any(|n| n.text.contains("clock has jumped")),
            "{:?}",
            path.notes
        );
    }
}

#[test]
fn fault_a_flight_of_half_a_second_has_no_path_and_says_so() {
    let heights = altitude();
    let mut flown = fly(24, 0.0, &heights);
    for (t, y) in flown.signals.values_mut() {
        let n = t.partition_point(|t| *t < 0.5);
        t.truncate(n);
        y.truncate(n);
    }
    for by in [Method::Smoother, Method::Windows] {
        let path = path_by(&flown, &kinematics(), &Settings { by, ..settings() });
        assert!(path.outputs.iter().flatten().all(|v| v.is_nan()));
        assert!(path.notes.iter().any(|n| n.text.contains("no flight path")), "{:?}", path.notes);
    }
}

#[test]
fn fault_a_signal_without_values_is_missing_and_one_with_three_is_not_used() {
    let heights = altitude();
    let mut flown = fly(25, 0.0, &heights);
    flown.signals["beta_vane"].1.fill(f64::NAN);
    let (t, y) = &mut flown.signals["static_pressure"];
    let few: Vec<usize> = [20, 150, 350].to_vec();
    (*t, *y) = (few.iter().map(|&k| t[k]).collect(), few.iter().map(|&k| y[k] + 300.0).collect());
    let found = path(&flown);
    let said = |what: &str| found.notes.iter().any(|n| n.text.contains(what));
    assert!(
        said("not measured, so not checked: beta_vane")
            && said("static_pressure has only 3 samples"),
        "{:?}",
        found.notes
    );
    // nothing tells the height, so none is given
    assert!(said("no sensor determines h"), "{:?}", found.notes);
    for (name, list) in STATES
        .iter()
        .zip(normed(&flown, &heights, &found, |_| true))
        .filter(|(name, _)| **name != "h")
    {
        let worst = list.iter().fold(0.0f64, |m, e| m.max(e.abs()));
        assert!(!list.is_empty() && worst < 5.5, "{name} is {worst} standard deviations off");
    }
    flown.signals["temperature"].1.fill(f64::NAN);
    let get = |name: &str| flown.signals.get(name).map(|(t, y)| (&t[..], &y[..]));
    let error = reconstruct(&kinematics(), get, &settings()).unwrap_err().to_string();
    assert!(error.contains("needs the signal \"temperature\""), "{error}");
}

fn bits(path: &FlightPath) -> Vec<u64> {
    path.outputs.iter().flatten().map(|v| v.to_bits()).collect()
}

fn by_windows() -> Settings {
    Settings { by: Method::Windows, window_s: 20.0, overlap_s: 4.0, ..settings() }
}

#[test]
fn fault_windows_of_output_error_have_the_same_checks() {
    let heights = altitude();
    let mut flown = fly(26, 0.0, &heights);
    let good = path_by(&flown, &kinematics(), &by_windows());
    assert!(good.notes.is_empty() && good.failed == 0, "{:?}", good.notes);
    for (channel, check) in
        [("theta", "sign"), ("alpha_vane", "time skew"), ("q_imu", "sign"), ("V", "whiteness")]
    {
        assert_eq!(verdict(&good, channel, check), "good", "{channel} {check}: {:#?}", good.checks);
    }
    // a sensor that is turned round is named and not used: the path is the one without it
    flown.signals["beta_vane"].1.iter_mut().for_each(|y| *y = -*y);
    let turned = path_by(&flown, &kinematics(), &by_windows());
    assert_eq!(verdict(&turned, "beta_vane", "sign"), "sign reversed", "{:?}", turned.notes);
    flown.signals.shift_remove("beta_vane");
    assert_eq!(bits(&path_by(&flown, &kinematics(), &by_windows())), bits(&turned));
    // with an inertial one there is no path, and that is missing
    let mut flown = fly(26, 0.0, &heights);
    flown.signals["az_imu"].1.iter_mut().for_each(|y| *y = -*y);
    let none = path_by(&flown, &kinematics(), &by_windows());
    assert_eq!(verdict(&none, "az_imu", "sign"), "sign reversed");
    assert!(
        none.outputs.iter().flatten().all(|v| v.is_nan()) && none.notes.iter().any(|n| n.missing),
        "{:?}",
        none.notes
    );
}

#[test]
fn fault_a_window_that_ends_singular_names_the_parameter() {
    let heights = altitude();
    let mut flown = fly(27, 0.0, &heights);
    flown.signals.shift_remove("beta_vane");
    let path =
        path_by(&flown, &kinematics(), &Settings { free: vec!["k_beta".into()], ..by_windows() });
    let lost: Vec<&Note> = path.notes.iter().filter(|n| n.missing).collect();
    let named = |n: &&Note| n.text.contains("ended as \"singular\"") && n.text.contains("k_beta");
    assert!(
        path.failed > 0 && lost.len() == path.failed && lost.iter().all(named),
        "{:?}",
        path.notes
    );
}

#[test]
fn fault_rejected_samples_are_counted_in_a_note() {
    let heights = altitude();
    let mut flown = fly(28, 0.0, &heights);
    flown.signals["theta"].1.iter_mut().step_by(60).for_each(|y| *y += 0.3);
    for settings in [settings(), by_windows()] {
        let settings =
            Settings { sd: [("theta".to_string(), 1e-3)].into_iter().collect(), ..settings };
        let path = path_by(&flown, &kinematics(), &settings);
        let note = path
            .notes
            .iter()
            .find(|n| n.subject == "theta")
            .unwrap_or_else(|| panic!("{:?}", path.notes));
        assert!(
            (15..=18).contains(&note.count) && note.text.contains("samples rejected"),
            "{note:?}"
        );
        assert_eq!(verdict(&path, "theta", "rejected"), "outliers");
    }
}

#[test]
fn fault_a_signal_that_drives_the_model_is_not_compared_with_itself() {
    let heights = altitude();
    let flown = fly(29, 0.0, &heights);
    let plain = path(&flown);
    // the same signals by the names of the model's outputs, as a channel map may have them
    let natural = [
        ("ax_imu", "ax"),
        ("ay_imu", "ay"),
        ("az_imu", "az"),
        ("p_imu", "p"),
        ("q_imu", "q"),
        ("r_imu", "r"),
    ];
    let natural = [&natural[..], &[("alpha_vane", "alpha"), ("beta_vane", "beta")]].concat();
    let mut renamed =
        Flown { signals: IndexMap::new(), gust: flown.gust.clone(), scene: flown.scene };
    for (name, series) in &flown.signals {
        let new = natural.iter().find(|(old, _)| old == name).map_or(name.as_str(), |(_, new)| new);
        renamed.signals.insert(new.to_string(), series.clone());
    }
    let signals = natural.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect();
    let mapped = path_by(&renamed, &kinematics(), &Settings { signals, ..settings() });
    assert_eq!((bits(&mapped), mapped.biases), (bits(&plain), plain.biases));
}
