//! Flights with loops that are let go for minutes, and flights without test points.

use super::tests::{CAMPAIGN, folder, load};

/// Height under an acceleration that is commanded, and loops that hold it when they are not let go.
const PARABOLA: &str = r#"
title = "A parabola"
[inputs]
a = "m/s^2"
a_trim = "m/s^2"
h_cmd = "m"
hold = "-"
[constants]
K = { unit = "1/s^2", value = 1.0 }
D = { unit = "1/s", value = 2.0 }
[states]
h = { unit = "m", rate = "w", start = 0.0 }
w = { unit = "m/s", rate = "a + a_trim + (1 - hold)*(K*(h_cmd - h) - D*w)", start = 0.0 }
[outputs]
h = { unit = "m", value = "h" }
w = { unit = "m/s", value = "w" }
[trim]
free = ["h", "w"]
zero = ["rate(w)", "rate(h)"]
"#;

const LONG: &str = r#"
title = "a parabola of a minute and more"
seed = 3
truth = "toy.model.toml"
rate_hz = 50
start_unix_s = 1000000000
drive = { altitude = "h_cmd", hold = "hold" }
timing = { settle_s = 5, hold_before_s = 1, hold_after_s = 2, end_s = 30 }

[maneuvers.parabola]
input = "a"
kind = "profile"
times_s = [0, 60, 100]
values = [0.0, 1.2, 0.0]
with = [{ maneuver = "trim_down", after_s = 20.0 }]

[maneuvers.trim_down]
input = "a_trim"
kind = "step"
unit_time_s = 70.0
amplitude = 0.5
polarity = -1

[flights.long]
altitude_ft = 1000
speeds_kt = [100]
at_each = ["parabola"]

[topics."/state"]
rate_hz = 50
fields = { h = { truth = "h", unit = "m" } }
"#;

#[test]
fn truth_loops_stay_let_go_through_profiles_of_minutes() {
    let folder = folder();
    std::fs::write(folder.path().join("toy.model.toml"), PARABOLA).unwrap();
    std::fs::write(folder.path().join("campaign.toml"), LONG).unwrap();
    let truth = load(&folder).truth("long").unwrap();
    let at = |t: f64| (truth.at(t)["h"], truth.at(t)["w"]);
    let h = 1000.0 * 0.3048;
    // It starts trimmed, and the profile begins at 6 s: 0.02 m/s^3 for 60 s, then -0.03 m/s^3;
    // w = integral of both inputs, h of w. The companion takes 0.5 m/s^2 off from 26 to 96 s.
    assert!((at(5.9).0 - h).abs() < 1e-9 && at(5.9).1.abs() < 1e-9);
    let rise = |s: f64| (0.01 * s * s, 0.02 * s * s * s / 6.0);
    let fall = |s: f64| (1.2 * s - 0.015 * s * s, 0.6 * s * s - 0.005 * s * s * s);
    // The edge of the step is a ramp over the grid step before it.
    let step = |s: f64| (-0.5 * (s + 0.01), -0.25 * (s + 0.01) * (s + 0.01));
    for t in [16.0, 30.0, 46.0, 66.0, 86.0, 95.9] {
        let s: f64 = t - 6.0;
        let (w_60, h_60) = rise(s.min(60.0));
        let (w_fall, h_fall) = fall((s - 60.0).max(0.0));
        let late = (s - 60.0).max(0.0);
        let (w_step, h_step) = if s > 20.0 { step(s - 20.0) } else { (0.0, 0.0) };
        let wanted = (h + h_60 + w_60 * late + h_fall + h_step, w_60 + w_fall + w_step);
        assert!((at(t).1 - wanted.1).abs() < 1e-3, "{t} s: {} {}", at(t).1, wanted.1);
        assert!((at(t).0 - wanted.0).abs() < 0.01, "{t} s: {} {}", at(t).0, wanted.0);
    }
    // Held for 100 s and 1 and 2 s around; then the loops bring it back.
    assert_eq!(truth.maneuvers[0].hold_s, [5.0, 108.0]);
    assert!((at(107.9).0 - h).abs() > 100.0 && (at(137.0).0 - h).abs() < 0.01, "{:?}", at(137.0));
}

#[test]
fn a_test_on_the_ground_starts_steady_and_needs_no_altitude() {
    let folder = folder();
    let text = CAMPAIGN.replace(
        "[topics.\"/state\"]\n",
        "[maneuvers.sweep]\ninput = \"u\"\nkind = \"sweep\"\namplitude = 0.1\nperiod_s = 40.0\n\n\
         [flights.ground]\nevents = [{ at_s = 10.0, maneuver = \"sweep\" }]\n\n\
         [flights.still]\nduration_s = 8.0\n\n[topics.\"/state\"]\n",
    );
    std::fs::write(folder.path().join("campaign.toml"), text).unwrap();
    let campaign = load(&folder);
    let truth = campaign.truth("ground").unwrap();
    // Steady at a commanded airspeed of 0; x is u, late by the lag of 0.5 s times its rate.
    assert_eq!(truth.at(5.0)["V"], 0.0);
    for (t, rate) in [(15.0, 0.01), (25.0, -0.01), (45.0, 0.01)] {
        let u = if t < 20.0 { 0.01 * (t - 10.0) } else { truth.at(t)["u"] };
        assert!((truth.at(t)["x"] - (u - 0.5 * rate)).abs() < 1e-5, "{t} s {:?}", truth.at(t));
    }
    assert!((truth.duration() - 57.0).abs() < 1e-9);
    assert!((campaign.truth("still").unwrap().duration() - 8.0).abs() < 1e-9);
    campaign.fly("ground").unwrap();
    let file: serde_json::Value =
        serde_json::from_slice(&std::fs::read(campaign.truth_path("ground")).unwrap()).unwrap();
    let m = &file["maneuvers"][0];
    assert_eq!(m["kind"], "sweep");
    assert_eq!((m["amplitude"].as_f64(), m["polarity"].as_i64()), (Some(0.1), Some(1)));
    assert!(m["altitude_ft"].is_null() && m["unit_time_s"].is_null());
    assert_eq!((m["speed_kt"].as_f64(), m["t_end_s"].as_f64()), (Some(0.0), Some(50.0)));
}

/// Lift carries the weight in the air; on the ground the angle is 0.
const BOTH: &str = r#"
title = "In the air and on the ground"
[inputs]
V_cmd = "m/s"
on_ground = "-"
u = "rad"
[constants]
K = { unit = "kg/m", value = 40.0 }
W = { unit = "N", value = 40000.0 }
T = { unit = "s", value = 0.5 }
[equations]
balance = "select(on_ground - 0.5, a, K*V_cmd^2*a/W - 1)"
[states]
a = { unit = "rad", rate = "(a_trim + u - a)/T", start = 0.1 }
[parameters]
a_trim = { unit = "rad", start = 0.0 }
[outputs]
a = { unit = "rad", value = "a" }
[trim]
free = ["a", "a_trim"]
zero = ["balance", "rate(a)"]
"#;

#[test]
fn one_model_starts_steady_in_the_air_and_on_the_ground() {
    let folder = folder();
    let write = |file: &str, text: &str| std::fs::write(folder.path().join(file), text).unwrap();
    write("toy.model.toml", BOTH);
    write(
        "campaign.toml",
        r#"
title = "both"
seed = 3
truth = "toy.model.toml"
rate_hz = 50
start_unix_s = 1000000000
drive = { speed = "V_cmd", constant = { on_ground = 0.0 } }
topics = { "/state" = { rate_hz = 50, fields = { a = { truth = "a", unit = "rad" } } } }

[maneuvers.slow]
input = "u"
kind = "sweep"
amplitude = 0.1
period_s = 20.0

[flights.air]
altitude_ft = 0
speeds_kt = [194.3844492440605]

[flights.ground]
events = [{ at_s = 10.0, maneuver = "slow" }]
constant = { on_ground = 1.0 }
"#,
    );
    let campaign = load(&folder);
    // 100 m/s: 40000 / (40 * 100^2) = 0.1 rad.
    let (air, ground) = (campaign.truth("air").unwrap(), campaign.truth("ground").unwrap());
    assert!((air.at(0.0)["a"] - 0.1).abs() < 1e-9 && (air.at(30.0)["a"] - 0.1).abs() < 1e-9);
    assert!(ground.at(0.0)["a"] == 0.0 && ground.at(15.0)["a"] > 0.05);
    // Without the choice, the lift that has to carry the weight at rest is named.
    write(
        "toy.model.toml",
        &BOTH.replace(
            "select(on_ground - 0.5, a, K*V_cmd^2*a/W - 1)",
            "K*V_cmd^2*a/W - 1 + 0*on_ground",
        ),
    );
    let error = load(&folder).truth("ground").unwrap_err();
    assert!(error.what.contains("\"balance\" depends on no free quantity"), "{error}");
}
