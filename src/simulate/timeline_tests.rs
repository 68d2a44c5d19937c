//! When maneuvers are flown, and what every input is meanwhile.

use super::super::settings::Companion;
use super::*;
use crate::simulate::atmosphere::true_airspeed;

const TEXT: &str = r#"
title = "t"
seed = 1
truth = "x"
rate_hz = 100
start_unix_s = 0
topics = {}

[drive]
speed = "V_cmd"
altitude = "h_cmd"
hold = "hold"
noise = ["n_u", "n_w"]
turbulence = "sigma"
constant = { wind = 0.0 }

[timing]
speed_rate_kt_s = 0.5
settle_s = 30
hold_before_s = 2
hold_after_s = 4
recover_s = 10
end_s = 5

[maneuvers.lateral]
input = "aileron"
kind = "3211"
unit_time_s = 1.0
amplitude = 2.5

[maneuvers.longitudinal]
input = "elevator"
kind = "211"
unit_time_s = 0.5
amplitude = 1.5
polarity = -1

[flights.one]
altitude_ft = 17000
speeds_kt = [160, 150]
at_each = ["lateral", "longitudinal"]

[flights.two]
altitude_ft = 17000
points = [{ speed_kt = 160 }, { speed_kt = 160, altitude_ft = 17150, maneuvers = ["lateral"] }]
events = [{ at_s = 10.0, maneuver = "longitudinal" }]
turbulence = 1.5
constant = { wind = 3.0 }
"#;

fn timeline(id: &str) -> (Settings, IndexMap<String, Shape>, Timeline) {
    let settings: Settings = toml::from_str(TEXT).unwrap();
    let shapes: IndexMap<String, Shape> =
        settings.maneuvers.iter().map(|(n, m)| (n.clone(), Shape::of(m).unwrap())).collect();
    let timeline = Timeline::new(&settings, &shapes, id, &settings.flights[id]);
    (settings, shapes, timeline)
}

fn signal(id: &str, name: &str) -> Vec<f64> {
    let (settings, shapes, timeline) = timeline(id);
    timeline.signal(&settings, &shapes, &settings.flights[id], name).unwrap()
}

#[test]
fn maneuvers_follow_each_other_at_each_speed() {
    let timeline = timeline("one").2;
    let times: Vec<(f64, f64, f64)> =
        timeline.maneuvers.iter().map(|m| (m.t_start_s, m.t_end_s, m.speed_kt)).collect();
    // 30 settle, 2 hold, 7 long, 4 hold, 10 recover, 2 hold, 2 long, 4 hold = 61; then 20 s for
    // 10 kt.
    assert_eq!(
        times,
        [(32.0, 39.0, 160.0), (55.0, 57.0, 160.0), (113.0, 120.0, 150.0), (136.0, 138.0, 150.0)]
    );
    assert!((timeline.duration() - 147.0).abs() < 1e-9);
}

#[test]
fn inputs_are_what_the_timeline_says() {
    let at = |name: &str, t: f64| signal("one", name)[(t * 100.0).round() as usize];
    assert_eq!(
        [at("hold", 29.99), at("hold", 30.0), at("hold", 42.99), at("hold", 43.0)],
        [0.0, 1.0, 1.0, 0.0]
    );
    assert_eq!(
        [at("aileron", 31.99), at("aileron", 32.0), at("aileron", 35.0), at("aileron", 39.0)],
        [0.0, 2.5, -2.5, 0.0]
    );
    assert_eq!(
        [at("elevator", 54.99), at("elevator", 55.0), at("elevator", 56.0), at("elevator", 57.0)],
        [0.0, -1.5, 1.5, 0.0]
    );
    let h = 17_000.0 * FOOT;
    assert_eq!(at("h_cmd", 100.0), h);
    for (t, kt) in [(0.0, 160.0), (61.0, 160.0), (71.0, 155.0), (81.0, 150.0), (140.0, 150.0)] {
        assert!((at("V_cmd", t) - true_airspeed(kt * KNOT, h)).abs() < 1e-9, "{t}");
    }
    assert_eq!(at("sigma", 50.0) + at("n_w", 50.0) + at("wind", 50.0), 0.0);
}

#[test]
fn points_and_events_make_a_flight_of_their_own() {
    let timeline = timeline("two").2;
    let names: Vec<(&str, f64, f64)> = timeline
        .maneuvers
        .iter()
        .map(|m| (m.maneuver.as_str(), m.t_start_s, m.altitude_ft.unwrap()))
        .collect();
    // 30 settle, 10 s for 150 ft at 15 ft/s, 30 settle, 2 hold.
    assert_eq!(names, [("longitudinal", 10.0, 17_000.0), ("lateral", 72.0, 17_150.0)]);
    assert_eq!((signal("two", "wind")[100], signal("two", "sigma")[100]), (3.0, 1.5));
}

#[test]
fn noise_has_unit_spectral_density_and_each_input_its_own() {
    let (u, w) = (signal("two", "n_u"), signal("two", "n_w"));
    let n = u.len() as f64;
    // Variance 1/dt = 100, standard error 100 sqrt(2/n) = 1.5.
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / n;
    assert!(
        (product(&u, &u) - 100.0).abs() < 6.0 && product(&u, &w).abs() < 4.5,
        "{} {}",
        product(&u, &u),
        product(&u, &w)
    );
    assert_eq!(u[0], 0.0);
}

#[test]
fn maneuvers_flown_together_share_a_hold() {
    let mut settings: Settings = toml::from_str(TEXT).unwrap();
    settings.maneuvers["lateral"]
        .with
        .push(Companion { maneuver: "longitudinal".into(), after_s: 6.0 });
    let shapes: IndexMap<String, Shape> =
        settings.maneuvers.iter().map(|(n, m)| (n.clone(), Shape::of(m).unwrap())).collect();
    let timeline = Timeline::new(&settings, &shapes, "one", &settings.flights["one"]);
    let first: Vec<_> = timeline.maneuvers[..2]
        .iter()
        .map(|m| (m.maneuver.as_str(), m.t_start_s, m.t_end_s, m.hold_s))
        .collect();
    // The elevator's doublet outlasts the aileron's 3211 by a second, and so does the hold.
    assert_eq!(
        first,
        [("lateral", 32.0, 39.0, [30.0, 44.0]), ("longitudinal", 38.0, 40.0, [30.0, 44.0])]
    );
    assert_eq!(timeline.maneuvers[2].t_start_s, 56.0);
}

#[test]
fn what_nothing_drives_has_no_signal() {
    let (settings, shapes, timeline) = timeline("one");
    assert_eq!(timeline.signal(&settings, &shapes, &settings.flights["one"], "rudder"), None);
}

/// A flight on the ground: no test point, no altitude.
fn on_the_ground(flight: &str) -> (Settings, IndexMap<String, Shape>, Timeline) {
    let mut settings: Settings = toml::from_str(TEXT).unwrap();
    settings.flights.insert("ground".into(), toml::from_str(flight).unwrap());
    let shapes: IndexMap<String, Shape> =
        settings.maneuvers.iter().map(|(n, m)| (n.clone(), Shape::of(m).unwrap())).collect();
    let timeline = Timeline::new(&settings, &shapes, "ground", &settings.flights["ground"]);
    (settings, shapes, timeline)
}

#[test]
fn a_flight_without_test_points_stands_and_has_its_events() {
    let (settings, shapes, timeline) =
        on_the_ground("events = [{ at_s = 7.0, maneuver = \"lateral\" }]");
    let m = &timeline.maneuvers[0];
    assert_eq!((m.t_start_s, m.speed_kt, m.altitude_ft), (7.0, 0.0, None));
    // 7 s, 7 s of maneuver, 4 s of hold, 5 s to the end.
    assert!((timeline.duration() - 23.0).abs() < 1e-9);
    let flight = &settings.flights["ground"];
    let speed = timeline.signal(&settings, &shapes, flight, "V_cmd").unwrap();
    assert!(speed.len() == timeline.n && speed.iter().all(|v| *v == 0.0));
    let still = on_the_ground("duration_s = 12.5\naltitude_ft = 30").2;
    assert!((still.duration() - 12.5).abs() < 1e-9 && still.maneuvers.is_empty());
}

#[test]
fn a_hold_lasts_as_long_as_a_profile_of_minutes_and_all_flown_with_it() {
    let mut settings: Settings = toml::from_str(TEXT).unwrap();
    settings.maneuvers["lateral"] = toml::from_str(
        "input = \"aileron\"\nkind = \"profile\"\ntimes_s = [0, 30, 100, 150]\nvalues = [0, 0.2, -0.1, 0]\n\
         with = [{ maneuver = \"longitudinal\", after_s = 20.0 }, { maneuver = \"slow\", after_s = 5.0 }]",
    )
    .unwrap();
    let slow = "input = \"rudder\"\nkind = \"sweep\"\namplitude = 1.0\nperiod_s = 80.0\ncycles = 2";
    settings.maneuvers.insert("slow".into(), toml::from_str(slow).unwrap());
    let shapes: IndexMap<String, Shape> =
        settings.maneuvers.iter().map(|(n, m)| (n.clone(), Shape::of(m).unwrap())).collect();
    let flight = &settings.flights["one"];
    let timeline = Timeline::new(&settings, &shapes, "one", flight);
    // The sweep ends last: 32 s + 5 s + 160 s; then 4 s of hold.
    let together = timeline.maneuvers.iter().take(3).map(|m| (m.maneuver.as_str(), m.hold_s));
    assert_eq!(
        together.collect::<Vec<_>>(),
        [("lateral", [30.0, 201.0]), ("slow", [30.0, 201.0]), ("longitudinal", [30.0, 201.0])]
    );
    let hold = timeline.signal(&settings, &shapes, flight, "hold").unwrap();
    let released = |from: f64, to: f64| {
        hold[(from * 100.0).round() as usize..(to * 100.0).round() as usize]
            .iter()
            .all(|h| *h == 1.0)
    };
    assert!(released(30.0, 201.0));
    assert_eq!((hold[2999], hold[20_100]), (0.0, 0.0));
    // The next maneuver waits for its end: 10 s to recover, 2 s of hold.
    assert_eq!(timeline.maneuvers[3].t_start_s, 213.0);
    let at = |name: &str, t: f64| {
        timeline.signal(&settings, &shapes, flight, name).unwrap()[(t * 100.0).round() as usize]
    };
    assert!(
        (at("aileron", 47.0) - 0.1).abs() < 1e-12 && (at("aileron", 132.0) + 0.1).abs() < 1e-12
    );
    assert!((at("rudder", 57.0) - 1.0).abs() < 1e-12 && (at("rudder", 177.0) + 1.0).abs() < 1e-12);
}
