//! A test on the ground from end to end: a surface with friction and stops is flown with a slow
//! sweep and a 3211, logged, and its friction, spring and stops are estimated from the sweep that is
//! found.

use crate::campaign::Campaign;
use koehler::table::{Table, read_dataset};

/// The moment of the weight is steady: the surface hangs 0.025 rad below neutral before the tests.
const TRUTH: &str = r#"
title = "A surface on the ground: spring, damper, friction at the hinge, stops"
[inputs]
M = "N m"
V_cmd = "m/s"
[constants]
J = { unit = "kg m^2", value = 0.5 }
k = { unit = "N m/rad", value = 200.0 }
c = { unit = "N m s", value = 3.0 }
F_c = { unit = "N m", value = 4.0 }
M_0 = { unit = "N m", value = 5.0 }
stop = { unit = "rad", value = 0.3 }
[equations]
moment = "M + M_0 - k*delta - c*delta_dot"
[states]
delta = { unit = "rad", rate = "delta_dot", start = 0.0, min = "-stop", max = "stop" }
delta_dot = { unit = "rad/s", rate = "moment/J", start = 0.0, friction = "F_c/J" }
[outputs]
delta = { unit = "rad", value = "delta" }
V = { unit = "m/s", value = "V_cmd" }
[trim]
free = ["delta", "delta_dot"]
zero = ["moment", "rate(delta)"]
"#;

const MODEL: &str = r#"
title = "A surface with friction and stops"
[inputs]
M = "N m"
[constants]
J = { unit = "kg m^2", value = 0.5 }
c = { unit = "N m s", value = 3.0 }
[parameters]
k = { unit = "N m/rad", start = 180.0 }
F_c = { unit = "N m", start = 3.0, min = 0.0 }
M_0 = { unit = "N m", start = 4.0 }
stop = { unit = "rad", start = 0.29, min = 0.1 }
[states]
delta = { unit = "rad", rate = "delta_dot", start = "measured", min = "-stop", max = "stop" }
delta_dot = { unit = "rad/s", rate = "(M + M_0 - k*delta - c*delta_dot)/J", start = 0.0, friction = "F_c/J" }
[outputs]
delta = { unit = "rad", value = "delta" }
"#;

const CAMPAIGN: &str = r#"
title = "A test on the ground"
seed = 5
truth = "truth.model.toml"
rate_hz = 200
start_unix_s = 1000000000
drive = { speed = "V_cmd" }

[maneuvers.slow]
input = "M"
kind = "sweep"
amplitude = 75.0
period_s = 30.0
cycles = 2
polarity = -1

[maneuvers.quick]
input = "M"
kind = "3211"
unit_time_s = 0.5
amplitudes = [20.0, 25.0, 20.0, 25.0]

[maneuvers.slowly_there]
input = "M"
kind = "profile"
times_s = [0, 10, 20, 30]
values = [0.0, 12.0, 12.0, 0.0]

[flights.ground]
events = [
  { at_s = 10.0, maneuver = "slow" },
  { at_s = 90.0, maneuver = "quick" },
  { at_s = 120.0, maneuver = "slowly_there" },
]

[topics."/rig"]
rate_hz = 50
[topics."/rig".fields]
moment = { truth = "M", unit = "N m", noise = 0.02 }
delta = { truth = "delta", unit = "deg", noise = 0.03 }
"#;

const CHANNELS: &str = r#"
[signal]
M = { topic = "/rig", field = "moment", unit = "N m" }
delta = { topic = "/rig", field = "delta", unit = "deg" }
"#;

const PIPELINE: &str = r#"
title = "Friction on the ground"
simulate = "campaign.toml"
channels = "channels.toml"
logs = ["logs/*.mcap"]

[derive]
rate_hz = 50.0

[[segment.input]]
name = "moment"
signal = "M"
optional = true

[segment.input.method]
seek = ["multistep", "sweep"]

[[estimate]]
name = "surface"
model = "surface.model.toml"
input = "moment"
kinds = ["sweep"]
pre_s = 2.0
post_s = 2.0

[report]
"#;

/// A folder with everything that a run needs.
fn tested(campaign: &str, pipeline: &str) -> Campaign {
    let c = Campaign { folder: tempfile::tempdir().expect("a temporary folder") };
    for (file, text) in [
        ("truth.model.toml", TRUTH),
        ("surface.model.toml", MODEL),
        ("campaign.toml", campaign),
        ("channels.toml", CHANNELS),
        ("pipeline.toml", pipeline),
    ] {
        c.write(file, text);
    }
    c
}

/// Kind, times and amplitude of the segments of a flight.
fn segments(table: &Table) -> Vec<(String, f64, f64, f64)> {
    let column = |name: &str| table.f64(name).expect("a column").to_vec();
    let (from, to, size) = (column("t_start_s"), column("t_end_s"), column("amplitude"));
    let kinds = table.strings("kind").expect("kinds");
    (0..table.rows()).map(|i| (kinds[i].to_string(), from[i], to[i], size[i])).collect()
}

#[test]
fn recovery_of_friction_and_stops_from_a_sweep_on_the_ground() {
    let c = tested(CAMPAIGN, PIPELINE);
    c.run().ended(0);

    let text = std::fs::read_to_string(c.path("truth/ground.json")).expect("the truth file");
    let truth: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let flown = truth["maneuvers"].as_array().expect("maneuvers");
    let said = |i: usize, key: &str| flown[i][key].as_f64();
    // The steady start is that of the weight; polarity and amplitude are those of each signal.
    assert!((flown[0]["at_start"]["delta"].as_f64().expect("a number") - 0.025).abs() < 1e-9);
    assert_eq!((said(0, "amplitude"), said(0, "polarity")), (Some(75.0), Some(-1.0)));
    assert_eq!((said(1, "amplitude"), said(2, "amplitude")), (Some(25.0), Some(12.0)));
    assert!(flown.iter().all(|m| m["altitude_ft"].is_null() && m["speed_kt"] == 0.0));

    let out = c.path("out");
    let found = segments(&read_dataset(&out, "segments").expect("segments"));
    println!("{found:?}");
    let kinds: Vec<&str> = found.iter().map(|s| s.0.as_str()).collect();
    assert_eq!(kinds, ["sweep", "3211"]);
    let (_, from, to, size) = &found[0];
    assert!(
        (from - 10.0).abs() < 0.1 && (to - 70.0).abs() < 0.1 && (size - 75.0).abs() < 0.01 * 75.0
    );

    let estimates = read_dataset(&out, "estimates").expect("estimates");
    let (value, sd) = (estimates.f64("value").expect("value"), estimates.f64("sd").expect("sd"));
    let names = estimates.strings("parameter").expect("names");
    let mut seen = Vec::new();
    for (name, truth) in [("k", 200.0), ("F_c", 4.0), ("M_0", 5.0), ("stop", 0.3)] {
        let rows: Vec<usize> = (0..estimates.rows()).filter(|i| names[*i] == name).collect();
        assert_eq!(rows.len(), 1, "{name}: one sweep, and no other maneuver, is estimated");
        let (value, sd) = (value[rows[0]], sd[rows[0]]);
        println!("{name} = {value} +- {sd}");
        seen.push((value - truth).abs() < 4.0 * sd && sd < 0.02 * truth);
    }
    assert_eq!(seen, [true; 4], "k, F_c, M_0, stop");
}

#[test]
fn fault_a_stop_that_was_never_reached_is_named() {
    // 40 N m against 200 N m/rad: 0.2 rad of 0.3.
    let short = CAMPAIGN.replace("amplitude = 75.0", "amplitude = 40.0");
    assert_ne!(short, CAMPAIGN);
    let c = tested(&short, PIPELINE);
    let ran = c.run().ended(0);
    println!("{}{}", ran.out, ran.err);
    assert!(
        ran.out.contains("stop belongs to min of delta") && ran.out.contains("not reached"),
        "{}",
        ran.out
    );
    let verdicts = read_dataset(&c.path("out"), "separability").expect("verdicts");
    let (verdict, text) =
        (verdicts.strings("verdict").expect("verdicts"), verdicts.strings("text").expect("texts"));
    let said =
        (0..verdicts.rows()).any(|i| verdict[i] == "not reached" && text[i].contains("stop"));
    assert!(said, "{verdict:?} {text:?}");
    let estimates = read_dataset(&c.path("out"), "estimates").expect("estimates");
    let names = estimates.strings("parameter").expect("names");
    let sd = estimates.f64("sd").expect("sd");
    let known = |i: usize| sd[i].is_finite();
    assert!(
        names.contains(&"stop") && (0..names.len()).all(|i| known(i) == (names[i] != "stop")),
        "all but a stop that nobody met: {names:?} {sd:?}"
    );
}

/// Out and not back: friction and a steady moment push the same way all along.
#[test]
fn fault_a_motion_one_way_only_does_not_determine_friction() {
    let sweep = "kind = \"sweep\"\namplitude = 75.0\nperiod_s = 30.0\ncycles = 2\npolarity = -1\n";
    let out = "kind = \"profile\"\ntimes_s = [0, 30, 40, 70]\nvalues = [0.0, -60.0, -60.0, 0.0]\n";
    let only = r#"
[[segment.edits.include]]
flight = "ground"
input = "moment"
kind = "multistep"
t_start_s = 10.0
t_end_s = 45.0
reason = "out, and not back"

[[estimate]]"#;
    let campaign = CAMPAIGN.replace(sweep, out);
    let pipeline = PIPELINE
        .replace("kinds = [\"sweep\"]", "kinds = [\"multistep\"]")
        .replace("\n[[estimate]]", only);
    assert!(campaign != CAMPAIGN && pipeline.contains("multistep\"]") && pipeline.contains(only));
    let ran = tested(&campaign, &pipeline).run().ended(1);
    assert!(ran.out.contains("F_c, M_0 are not distinguishable"), "{}", ran.out);
    assert!(ran.out.contains("no estimate of surface converged: singular"), "{}", ran.out);
}
