use super::*;

const MODEL: &str = r#"
title = "A lag that feeds an integrator"
[inputs]
u = "rad"
V_cmd = "m/s"
gust = "-"
hold = "-"
[constants]
T = "s"
K = { unit = "1/s", value = 0.5 }
sigma = { unit = "rad", value = 0.1 }
[states]
x = { unit = "rad", rate = "(u + sigma*gust - x)/T", start = 0.0 }
y = { unit = "rad", rate = "K*x", start = 0.0 }
V = { unit = "m/s", rate = "(1 - hold)*(V_cmd - V)/T", start = 50.0 }
[outputs]
x = { unit = "rad", value = "x", doc = "lagged input" }
y = { unit = "rad", value = "y" }
V = { unit = "m/s", value = "V" }
[trim]
free = ["V"]
zero = ["rate(V)"]
"#;

pub const CAMPAIGN: &str = r#"
title = "toy"
seed = 3
truth = "toy.model.toml"
constants = ["constants.toml"]
rate_hz = 100
start_unix_s = 1000000000
drive = { speed = "V_cmd", hold = "hold", noise = ["gust"] }
timing = { settle_s = 5, hold_before_s = 1, hold_after_s = 2, recover_s = 5, end_s = 5 }

[maneuvers.step]
input = "u"
kind = "step"
unit_time_s = 4.0
amplitude = 0.2

[flights.calm]
altitude_ft = 0
speeds_kt = [100, 110]
at_each = ["step"]

[flights.rough]
altitude_ft = 0
speeds_kt = [100]
at_each = ["step"]
turbulence = 1.0

[topics."/state"]
rate_hz = 50
latency_s = 0.01

[topics."/state".fields]
x = { truth = "x", unit = "deg" }
y = { truth = "y", unit = "rad", noise = 0.001 }

[topics."/air"]
rate_hz = 10
fields = { tas = { truth = "V", unit = "kt" } }
"#;

pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let constants = "T = { value = 0.5, unit = \"s\", sd = 0.0, source = \"test\" }\n";
    for (name, text) in
        [("toy.model.toml", MODEL), ("campaign.toml", CAMPAIGN), ("constants.toml", constants)]
    {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

pub fn load(folder: &tempfile::TempDir) -> Campaign {
    Campaign::load(&folder.path().join("campaign.toml")).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn a_flight_is_what_its_equations_say() {
    let folder = folder();
    let truth = load(&folder).truth("calm").unwrap();
    // 5 s settle and 1 s hold, then 0.2 for 4 s through 1/(1 + 0.5 s) and 0.5/s; the edge is half a
    // grid step early.
    let at = |name: &str, t: f64| truth.at(t)[name];
    for t in [7.0, 8.0, 9.9] {
        let s = t - 6.0 + 0.005;
        let x = 0.2 * (1.0 - (-s / 0.5f64).exp());
        assert!((at("x", t) - x).abs() < 2e-6, "{t} {} {x}", at("x", t));
        assert!((at("y", t) - 0.5 * (0.2 * s - 0.5 * x)).abs() < 2e-6, "{t}");
    }
    let knot = 1852.0 / 3600.0;
    assert!(
        (at("V", 0.0) - 100.0 * knot).abs() < 1e-9 && (at("V", 11.9) - 100.0 * knot).abs() < 1e-9
    );
    // 12 s, then 1 kt/s: a ramp through a lag stays T times the slope behind.
    assert!((at("V", 20.0) - (108.0 - 0.5) * knot).abs() < 1e-3);
}

#[test]
fn the_log_on_disk_holds_the_recording() {
    let folder = folder();
    let campaign = load(&folder);
    assert_eq!(campaign.missing(), ["calm", "rough"]);
    let flown = campaign.fly_all(&campaign.flights(), &|_| ()).unwrap();
    assert_eq!(flown.iter().map(|f| f.flight.as_str()).collect::<Vec<_>>(), ["calm", "rough"]);
    assert!(campaign.missing().is_empty());
    let truth = campaign.truth("calm").unwrap();
    let recording = campaign.record(&truth, campaign.sensor_seed()).unwrap();
    let bytes = std::fs::read(&flown[0].log).unwrap();
    let (mut state, mut last, mut count) = (0, 0, 0);
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= last);
        (last, count) = (message.log_time, count + 1);
        if message.channel.topic == "/state" {
            let value: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
            let log = &recording.topics[0];
            assert_eq!(message.log_time - message.publish_time, 10_000_000);
            assert_eq!(message.publish_time, log.publish_ns[state]);
            for (field, expected) in ["x", "y"].iter().zip(&log.rows[2 * state..]) {
                // The JSON reader used here may miss the last digit.
                assert!(
                    (value[field].as_f64().unwrap() - expected).abs() <= 1e-15 * expected.abs()
                );
            }
            let t = (message.publish_time - 1_000_000_000_000_000_000) as f64 * 1e-9;
            let k = (t * 100.0) as usize;
            let (low, high) = (
                truth.signals["x"].values[k].min(truth.signals["x"].values[k + 1]),
                truth.signals["x"].values[k].max(truth.signals["x"].values[k + 1]),
            );
            assert!(
                (low - 1e-12..=high + 1e-12).contains(&value["x"].as_f64().unwrap().to_radians())
            );
            state += 1;
        }
    }
    assert_eq!((state, count), (recording.topics[0].log_ns.len(), flown[0].messages));
    let truth: serde_json::Value =
        serde_json::from_slice(&std::fs::read(campaign.truth_path("calm")).unwrap()).unwrap();
    assert_eq!(truth["maneuvers"].as_array().unwrap().len(), 2);
    assert_eq!(truth["maneuvers"][0]["t_start_s"], 6.0);
    assert!(
        (truth["maneuvers"][1]["at_start"]["V"].as_f64().unwrap() - 110.0 * 1852.0 / 3600.0).abs()
            < 1e-3
    );
}

#[test]
fn the_same_seeds_give_the_same_bytes_and_other_seeds_what_they_should() {
    let read = |campaign: &str| {
        let folder = folder();
        std::fs::write(folder.path().join("campaign.toml"), campaign).unwrap();
        let campaign = load(&folder);
        campaign.fly_all(&campaign.flights(), &|_| ()).unwrap();
        let truth = ["calm", "rough"].map(|id| campaign.truth(id).unwrap().signals);
        (["calm", "rough"].map(|id| std::fs::read(campaign.log_path(id)).unwrap()), truth)
    };
    let first = read(CAMPAIGN);
    assert!(first == read(CAMPAIGN));
    let sensors = read(&CAMPAIGN.replace("seed = 3", "seed = 3\nsensor_seed = 4"));
    assert!(first.0[0] != sensors.0[0] && first.1 == sensors.1);
    let turbulence = read(&CAMPAIGN.replace("seed = 3", "seed = 4\nsensor_seed = 3"));
    assert!(first.0[0] == turbulence.0[0] && first.1[0] == turbulence.1[0]);
    assert!(first.0[1] != turbulence.0[1] && first.1[1] != turbulence.1[1]);
}

#[test]
fn a_log_simulated_from_another_state_of_its_campaign_is_outdated() {
    let folder = folder();
    let campaign = load(&folder);
    assert!(campaign.outdated().is_empty(), "nothing is there");
    campaign.fly_all(&campaign.flights(), &|_| ()).unwrap();
    let edited = |file: &str, old: &str, new: &str| {
        let path = folder.path().join(file);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, text.replace(old, new)).unwrap();
        let now = load(&folder);
        let outdated = now.outdated().into_iter().map(str::to_string).collect::<Vec<_>>();
        std::fs::write(&path, text).unwrap();
        outdated
    };
    for (file, old, new, wanted) in [
        ("campaign.toml", "title = \"toy\"", "title = \"a toy\"", &[][..]),
        (
            "campaign.toml",
            "[topics.\"/state\"]",
            "[flights.third]\naltitude_ft = 0\nspeeds_kt = [90]\nat_each = []\n[topics.\"/state\"]",
            &[],
        ),
        ("campaign.toml", "turbulence = 1.0", "turbulence = 2.0", &["rough"]),
        ("campaign.toml", "seed = 3", "seed = 3\nsensor_seed = 4", &["calm", "rough"]),
        ("campaign.toml", "noise = 0.001", "noise = 0.002", &["calm", "rough"]),
        ("toy.model.toml", "K*x", "2*K*x", &["calm", "rough"]),
        ("constants.toml", "0.5", "0.6", &["calm", "rough"]),
        ("constants.toml", "sd = 0.0", "sd = 0.1", &[]),
    ] {
        assert_eq!(edited(file, old, new), wanted, "{file}: {new}");
    }
    // A log of somebody else says nothing of a campaign.
    let mut other = crate::log::LogWriter::create(&campaign.log_path("calm")).unwrap();
    other.add_topic("/state", &[]).unwrap();
    other.finish().unwrap();
    assert_eq!(edited("campaign.toml", "seed = 3", "seed = 3\nsensor_seed = 4"), ["rough"]);
}

#[test]
fn white_noise_through_a_lag_has_the_variance_of_its_spectrum() {
    let folder = folder();
    let text = CAMPAIGN.replace("end_s = 5 }", "end_s = 3000 }");
    std::fs::write(folder.path().join("campaign.toml"), text).unwrap();
    let truth = load(&folder).truth("rough").unwrap();
    let x = &truth.signals["x"].values[2000..];
    // Unit two-sided density through 0.1/(1 + T s): variance 0.01/(2 T) = 0.01. 3000 s are about
    // 3000 independent values: 2.6%.
    let variance = x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64;
    assert!((variance / 0.01 - 1.0).abs() < 0.105, "{variance}");
}

#[test]
fn every_mistake_is_reported_before_anything_is_flown() {
    let folder = folder();
    let text = CAMPAIGN
        .replace("truth = \"x\"", "truth = \"z\"")
        .replace("unit = \"kt\"", "unit = \"degC\"");
    std::fs::write(folder.path().join("campaign.toml"), text).unwrap();
    let errors = Campaign::load(&folder.path().join("campaign.toml")).unwrap_err();
    assert_eq!(errors.0.len(), 2, "{errors}");
    std::fs::write(folder.path().join("toy.model.toml"), MODEL.replace("K*x", "K*z")).unwrap();
    let errors = Campaign::load(&folder.path().join("campaign.toml")).unwrap_err();
    assert!(errors.to_string().contains("toy.model.toml"), "{errors}");
    assert!(!folder.path().join("logs").exists());
    let missing = Campaign::load(&folder.path().join("nothing.toml")).unwrap_err();
    assert!(missing.to_string().contains("nothing.toml"));
}

#[test]
fn a_flight_that_diverges_says_where_and_spares_the_others() {
    let folder = folder();
    let unstable =
        MODEL.replace("rate = \"K*x\"", "rate = \"K*x + 600*K*y*select(abs(u) - sigma, 1, 0)\"");
    std::fs::write(folder.path().join("toy.model.toml"), unstable).unwrap();
    std::fs::write(
        folder.path().join("campaign.toml"),
        CAMPAIGN.replace(
            "[flights.rough]",
            "[flights.level]\naltitude_ft = 0\nspeeds_kt = [100]\n\n[flights.rough]",
        ),
    )
    .unwrap();
    let campaign = load(&folder);
    let errors = campaign.fly_all(&["calm", "level"], &|_| ()).unwrap_err();
    assert_eq!(errors.0.len(), 1);
    assert!(
        errors.0[0].what.starts_with("calm: the motion diverges at ")
            && errors.0[0].what.contains("after \"step\" at 6.0 s"),
        "{errors}"
    );
    assert_eq!(campaign.missing(), ["calm", "rough"]);
}
