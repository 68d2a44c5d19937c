use super::*;
use crate::simulate::settings::Gap;
use crate::simulate::truth::Signal;
use indexmap::IndexMap;

const DT: f64 = 0.005;
const START: u64 = 1_000_000_000_000_000_000;

/// Name, unit and value over time of a true signal.
type Wave<'a> = (&'a str, &'a str, fn(f64) -> f64);

fn truth(seconds: f64, signals: &[Wave]) -> Truth {
    let n = (seconds / DT).round() as usize + 1;
    let signal = |unit: &str, f: fn(f64) -> f64| Signal {
        unit: unit.into(),
        doc: String::new(),
        values: (0..n).map(|k| f(k as f64 * DT)).collect(),
    };
    Truth {
        flight: "flight-01".into(),
        dt: DT,
        n,
        signals: signals
            .iter()
            .map(|(name, unit, f)| (name.to_string(), signal(unit, *f)))
            .collect(),
        maneuvers: Vec::new(),
    }
}

fn sensor(truth: &str, unit: &str) -> Sensor {
    let text = format!("truth = \"{truth}\"\nunit = \"{unit}\"");
    toml::from_str(&text).unwrap()
}

fn topic(rate_hz: f64, fields: &[(&str, Sensor)]) -> Topic {
    let mut topic: Topic = toml::from_str(&format!("rate_hz = {rate_hz}\nfields = {{}}")).unwrap();
    topic.fields = fields.iter().map(|(name, s)| (name.to_string(), s.clone())).collect();
    topic
}

fn settings(topics: &[(&str, Topic)]) -> Settings {
    let text = "title = 't'\nseed = 1\ntruth = 'x'\nstart_unix_s = 0\ndrive = {}\nflights = {}\ntopics = {}";
    let mut settings: Settings = toml::from_str(text).unwrap();
    settings.topics =
        topics.iter().map(|(name, t)| (name.to_string(), t.clone())).collect::<IndexMap<_, _>>();
    settings
}

fn column(log: &TopicLog, field: usize) -> Vec<f64> {
    log.rows.iter().skip(field).step_by(log.fields.len()).copied().collect()
}

fn times(log: &TopicLog) -> Vec<f64> {
    log.publish_ns.iter().map(|t| (t - START) as f64 * 1e-9).collect()
}

fn mean_sd(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0)).sqrt())
}

#[test]
fn units_signs_bias_scale_and_noise_are_those_of_the_settings() {
    let s = Sensor { noise: 0.5, bias: 2.0, scale: 1.1, sign: -1.0, ..sensor("a", "deg") };
    let truth = truth(1000.0, &[("a", "rad", |_| 0.1)]);
    let recording = record(&settings(&[("/t", topic(50.0, &[("x", s)]))]), &truth, 7, START);
    let values = column(&recording.topics[0], 0);
    assert!((values.len() as i64 - 50_000).abs() <= 1);
    let (mean, sd) = mean_sd(&values);
    // Four standard errors: 0.5/sqrt(50000) and 0.5/sqrt(100000).
    assert!((mean - (-1.1 * 0.1f64.to_degrees() + 2.0)).abs() < 0.009, "{mean}");
    assert!((sd - 0.5).abs() < 0.0064, "{sd}");
}

#[test]
fn errors_drawn_per_flight_have_their_deviation_and_differ_between_flights() {
    let s = Sensor { bias_sd: 2.0, scale_sd: 0.01, ..sensor("a", "deg") };
    let settings = settings(&[("/t", topic(1.0, &[("x", s)]))]);
    let mut truth = truth(5.0, &[("a", "rad", |_| 0.1)]);
    let mut drawn = Vec::new();
    for i in 0..2000 {
        truth.flight = format!("flight-{i}");
        let recording = record(&settings, &truth, 7, START);
        let e = recording.errors[0].clone();
        assert!(
            (column(&recording.topics[0], 0)[0] - (e.scale * 0.1f64.to_degrees() + e.bias)).abs()
                < 1e-12
        );
        drawn.push(e);
    }
    let (mean, sd) = mean_sd(&drawn.iter().map(|e| e.bias).collect::<Vec<_>>());
    assert!(mean.abs() < 0.18 && (sd - 2.0).abs() < 0.13, "{mean} {sd}");
    let (mean, sd) = mean_sd(&drawn.iter().map(|e| e.scale).collect::<Vec<_>>());
    assert!((mean - 1.0).abs() < 0.0009 && (sd - 0.01).abs() < 0.00065, "{mean} {sd}");
}

#[test]
fn a_lag_answers_a_step_and_a_ramp_like_the_textbook_says() {
    let step = |t: f64| f64::from(t >= 2.0);
    let lagged = lag(&(0..2000).map(|k| step(k as f64 * DT)).collect::<Vec<_>>(), DT, 0.3);
    for k in 400..2000 {
        // The grid's step is a ramp over the last interval before 2 s: half a grid step early.
        let expected = 1.0 - (-((k as f64 + 0.5) * DT - 2.0) / 0.3).exp();
        assert!((lagged[k] - expected).abs() < 1e-4, "{k}");
    }
    let ramp = lag(&(0..2000).map(|k| k as f64 * DT).collect::<Vec<_>>(), DT, 0.3);
    for k in [1, 10, 100, 1999] {
        let t = k as f64 * DT;
        assert!((ramp[k] - (t - 0.3 * (1.0 - (-t / 0.3).exp()))).abs() < 1e-12, "{k}");
    }
}

#[test]
fn a_delayed_value_is_that_old_at_its_stamp() {
    let s = Sensor { delay_s: 0.123, ..sensor("a", "-") };
    let truth = truth(20.0, &[("a", "-", |t| (2.0 * t).sin())]);
    let recording = record(&settings(&[("/t", topic(37.0, &[("x", s)]))]), &truth, 7, START);
    let log = &recording.topics[0];
    for (t, x) in times(log).iter().zip(column(log, 0)).filter(|(t, _)| **t > 0.2) {
        assert!((x - (2.0 * (t - 0.123)).sin()).abs() < 2e-5, "{t}");
    }
}

#[test]
fn jittered_stamps_are_right_and_have_their_deviation() {
    let mut t = topic(50.0, &[("x", sensor("a", "-"))]);
    t.jitter_s = 0.002;
    let truth = truth(400.0, &[("a", "-", |t| t)]);
    let recording = record(&settings(&[("/t", t)]), &truth, 7, START);
    let times = times(&recording.topics[0]);
    for (t, x) in times.iter().zip(column(&recording.topics[0], 0)) {
        assert!((t - x).abs() < 1e-8);
    }
    let steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let (mean, sd) = mean_sd(&steps);
    // The difference of two independent shifts.
    assert!((mean - 0.02).abs() < 1e-6 && (sd - 0.002 * 2f64.sqrt()).abs() < 8e-5, "{mean} {sd}");
    assert!(steps.iter().all(|s| *s > 0.0));
}

#[test]
fn messages_get_lost_repeated_and_late_as_often_as_asked() {
    let mut t = topic(100.0, &[("x", sensor("a", "-"))]);
    (t.lost, t.repeated, t.latency_s, t.latency_jitter_s) = (0.1, 0.05, 0.02, 0.01);
    t.gaps = vec![
        Gap { flight: "flight-01".into(), from_s: 30.0, to_s: 40.0 },
        Gap { flight: "other".into(), from_s: 50.0, to_s: 60.0 },
    ];
    let truth = truth(200.0, &[("a", "-", |t| t)]);
    let log = &record(&settings(&[("/t", t)]), &truth, 7, START).topics[0];
    // 19000 samples outside the gap, 90% come through, 5% of these twice.
    assert!(
        (log.log_ns.len() as f64 - 19_000.0 * 0.9 * 1.05).abs() < 4.0 * 50.0,
        "{}",
        log.log_ns.len()
    );
    assert!(log.log_ns.windows(2).all(|w| w[0] <= w[1]));
    assert!(times(log).iter().all(|t| !(30.0..40.0).contains(t)));
    let late: Vec<f64> =
        log.log_ns.iter().zip(&log.publish_ns).map(|(l, p)| (l - p) as f64 * 1e-9).collect();
    assert!(late.iter().all(|l| *l >= 0.02));
    // Repeated ones, 1 in 21, come 1 ms later.
    assert!((mean_sd(&late).0 - 0.03005).abs() < 3e-4, "{}", mean_sd(&late).0);
}

#[test]
fn values_are_rounded_to_short_decimal_numbers() {
    assert_eq!(rounded(0.30000000000000004, 0.01), 0.3);
    assert_eq!(rounded(-0.004, 0.01).to_string(), "0");
    assert_eq!(rounded(12.26, 0.25), 12.25);
    assert_eq!(rounded(1234.0, 5.0), 1235.0);
    assert_eq!(rounded(0.1234567, 0.0), 0.1234567);
}

#[test]
fn sampling_is_smooth_between_grid_points_and_never_overshoots_a_step() {
    let wave: Vec<f64> = (0..1000).map(|k| (3.0 * k as f64 * DT).sin()).collect();
    let worst = (0..4000)
        .map(|i| i as f64 * 0.00123)
        .map(|t| (sample(&wave, DT, t) - (3.0 * t).sin()).abs())
        .fold(0.0, f64::max);
    // Linear interpolation would err by (3 DT)^2/8 = 2.8e-5 everywhere; here only next to the
    // peaks.
    assert!(worst < 2.9e-5, "{worst}");
    assert!((sample(&wave, DT, 0.0025) - 0.0075f64.sin()).abs() < 1e-8);
    let step: Vec<f64> = (0..100).map(|k| f64::from(k >= 50)).collect();
    assert!((0..10_000).all(|i| (0.0..=1.0).contains(&sample(&step, DT, f64::from(i) * 5e-5))));
    assert_eq!((sample(&step, DT, -1.0), sample(&step, DT, 99.0)), (0.0, 1.0));
}

#[test]
fn the_same_seed_gives_the_same_recording_and_one_sensor_touches_no_other() {
    let noisy = |truth: &str| Sensor { noise: 0.1, bias_sd: 0.1, ..sensor(truth, "-") };
    let truth = truth(20.0, &[("a", "-", |t| t), ("b", "-", |t| t * t)]);
    let mut air = topic(20.0, &[("x", noisy("a"))]);
    air.jitter_s = 0.001;
    let both = settings(&[
        ("/imu", topic(50.0, &[("x", noisy("a")), ("y", noisy("b"))])),
        ("/air", air.clone()),
    ]);
    let first = record(&both, &truth, 7, START);
    assert_eq!(first, record(&both, &truth, 7, START));
    assert_ne!(first.topics[1].rows, record(&both, &truth, 8, START).topics[1].rows);
    let mut changed = both.clone();
    changed.topics["/imu"].fields["x"].noise = 3.0;
    changed.topics["/imu"].lost = 0.5;
    let second = record(&changed, &truth, 7, START);
    assert_eq!(first.topics[1], second.topics[1]);
    let y: Vec<(u64, f64)> =
        first.topics[0].publish_ns.iter().copied().zip(column(&first.topics[0], 1)).collect();
    let left: Vec<(u64, f64)> =
        second.topics[0].publish_ns.iter().copied().zip(column(&second.topics[0], 1)).collect();
    assert!(left.len() < y.len() && left.iter().all(|m| y.contains(m)));
    let without = settings(&[("/air", air)]);
    assert_eq!(record(&without, &truth, 7, START).topics[0], first.topics[1]);
}

#[test]
fn changes_are_logged_when_they_begin_and_end() {
    let wave: Wave = ("u", "rad", |t| if (1.0..2.0).contains(&t) { 0.1 } else { 0.0 });
    let truth = truth(3.0, &[wave]);
    let topic = Topic { on_change: true, ..topic(2.0, &[("command", sensor("u", "rad"))]) };
    let log = record(&settings(&[("/fbw", topic)]), &truth, 3, START).topics.remove(0);
    let (t, u) = (times(&log), column(&log, 0));
    assert!(t.windows(2).all(|two| two[0] < two[1]), "{t:?}");
    // Six at 2 Hz, and two for each of two steps.
    assert_eq!(t.len(), 10, "{t:?}");
    for (time, value) in [(0.995, 0.0), (1.0, 0.1), (1.995, 0.1), (2.0, 0.0)] {
        let k = t.iter().position(|t| (t - time).abs() < 1e-6);
        let k = k.unwrap_or_else(|| panic!("no message at {time}: {t:?}"));
        assert!((u[k] - value).abs() < 1e-12, "{time}: {}", u[k]);
    }
}
