//! Signals of known levels, lengths, integrals and spectra; the mistakes of a maneuver.

use super::*;
use std::f64::consts::TAU;

fn maneuver(kind: &str) -> Maneuver {
    Maneuver {
        input: "u".into(),
        kind: kind.into(),
        unit_time_s: Some(0.5),
        amplitude: Some(2.0),
        amplitudes: None,
        polarity: -1,
        edge_s: 0.0,
        duration_s: None,
        band_hz: None,
        period_s: None,
        cycles: None,
        times_s: None,
        values: None,
        with: Vec::new(),
    }
}

fn sampled(shape: &Shape, dt: f64) -> Vec<f64> {
    let n = (shape.duration() / dt).round() as usize;
    (0..=n).map(|k| shape.value(k as f64 * dt)).collect()
}

#[test]
fn multisteps_have_the_durations_and_integrals_of_their_digits() {
    // 3-2+1-1 = +1 unit, 2-2+1-1 = 0, 2-1+1 = 2, 1-1 = 0, 1.
    for (kind, duration, integral) in [
        ("3211", 3.5, 1.0),
        ("2211", 3.0, 0.0),
        ("211", 2.0, 2.0),
        ("doublet", 1.0, 0.0),
        ("step", 0.5, 1.0),
    ] {
        let shape = Shape::of(&maneuver(kind)).unwrap();
        assert_eq!(shape.duration(), duration, "{kind}");
        let area: f64 = sampled(&shape, 0.005).iter().sum::<f64>() * 0.005;
        assert!((area - integral * 0.5 * -2.0).abs() < 1e-9, "{kind} {area}");
    }
}

#[test]
fn a_3211_has_its_levels_in_turn_and_changes_exactly_at_grid_points() {
    let shape = Shape::of(&maneuver("3211")).unwrap();
    let dt = 1.0 / 200.0;
    for (k, expected) in [
        (0, -2.0),
        (299, -2.0),
        (300, 2.0),
        (499, 2.0),
        (500, -2.0),
        (600, 2.0),
        (699, 2.0),
        (700, 0.0),
        (900, 0.0),
    ] {
        assert_eq!(shape.value(k as f64 * dt), expected, "{k}");
    }
    assert_eq!(shape.value(-dt), 0.0);
}

#[test]
fn edges_are_ramps_that_keep_the_integral() {
    let m = Maneuver { edge_s: 0.2, ..maneuver("211") };
    let shape = Shape::of(&m).unwrap();
    assert!((shape.value(0.1) + 1.0).abs() < 1e-12);
    let area: f64 = sampled(&shape, 0.001).iter().sum::<f64>() * 0.001;
    assert!((area + 2.0).abs() < 1e-9, "{area}");
}

#[test]
fn a_multisine_fills_its_band_begins_at_zero_and_reaches_its_amplitude() {
    let m = Maneuver {
        unit_time_s: None,
        duration_s: Some(10.0),
        band_hz: Some([0.2, 1.5]),
        polarity: 1,
        ..maneuver("multisine")
    };
    let shape = Shape::of(&m).unwrap();
    let values = sampled(&shape, 0.001);
    assert!(values[0].abs() < 1e-9 && values[10_000].abs() < 1e-9);
    let largest = values.iter().fold(0.0f64, |a, x| a.max(x.abs()));
    assert!((largest - 2.0).abs() < 0.01, "{largest}");
    // All 14 harmonics have the same power, others none; a relative peak factor (Morelli) below
    // 1.3 is what Schroeder phases give.
    let power = |k: f64| {
        let part = |f: fn(f64) -> f64| {
            values[1..]
                .iter()
                .enumerate()
                .map(|(i, x)| x * f(TAU * k * (i + 1) as f64 / 10_000.0))
                .sum::<f64>()
                / 5000.0
        };
        part(f64::sin).hypot(part(f64::cos))
    };
    assert!(
        (power(2.0) - power(15.0)).abs() < 1e-9
            && power(2.0) > 0.2
            && power(1.0) < 1e-9
            && power(16.0) < 1e-9
    );
    let rms = (values[1..].iter().map(|x| x * x).sum::<f64>() / 10_000.0).sqrt();
    assert!(largest / rms / 2f64.sqrt() < 1.3);
}

#[test]
fn every_mistake_of_a_maneuver_is_found() {
    let m = Maneuver {
        amplitude: Some(-1.0),
        polarity: 3,
        unit_time_s: None,
        edge_s: 1.0,
        ..maneuver("3211")
    };
    let keys =
        |m: &Maneuver| Shape::of(m).unwrap_err().into_iter().map(|e| e.0).collect::<Vec<_>>();
    assert_eq!(keys(&m), ["polarity", "amplitude", "unit_time_s"]);
    assert_eq!(keys(&Maneuver { edge_s: 1.0, ..maneuver("3211") }), ["edge_s"]);
    assert_eq!(keys(&maneuver("32x1")), ["kind"]);
    assert_eq!(keys(&maneuver("3201")), ["kind"]);
    assert_eq!(
        keys(&Maneuver {
            band_hz: Some([2.0, 1.0]),
            unit_time_s: None,
            duration_s: Some(5.0),
            ..maneuver("multisine")
        }),
        ["band_hz"]
    );
    assert_eq!(
        keys(&Maneuver { unit_time_s: Some(1.0), ..maneuver("multisine") }),
        ["unit_time_s", "duration_s", "band_hz"]
    );
}

/// A maneuver without any key that belongs to some kinds only.
fn bare(kind: &str) -> Maneuver {
    Maneuver { unit_time_s: None, amplitude: None, polarity: 1, ..maneuver(kind) }
}

fn profile() -> Maneuver {
    Maneuver {
        times_s: Some(vec![0.0, 1.0, 3.0, 4.0]),
        values: Some(vec![0.5, -1.0, -1.0, 2.0]),
        ..bare("profile")
    }
}

fn sweep() -> Maneuver {
    Maneuver { amplitude: Some(0.3), period_s: Some(8.0), ..bare("sweep") }
}

/// Keys and words of the mistakes of a maneuver.
fn mistakes(m: &Maneuver) -> Vec<Mistake> {
    Shape::of(m).unwrap_err()
}

#[test]
fn a_profile_is_straight_between_its_points_and_zero_outside() {
    let shape = Shape::of(&profile()).unwrap();
    for (t, expected) in
        [(-0.01, 0.0), (0.0, 0.5), (0.5, -0.25), (1.0, -1.0), (2.2, -1.0), (3.5, 0.5), (4.0, 0.0)]
    {
        assert!((shape.value(t) - expected).abs() < 1e-12, "{t}: {}", shape.value(t));
    }
    assert_eq!((shape.duration(), shape.polarity()), (4.0, 1));
    assert_eq!(amplitude(&profile()), 2.0);
    let over = Shape::of(&Maneuver { polarity: -1, ..profile() }).unwrap();
    assert_eq!((over.value(1.5), over.polarity()), (1.0, -1));
}

#[test]
fn a_sweep_goes_to_both_sides_at_one_rate() {
    for (polarity, cycles) in [(1, None), (-1, Some(3))] {
        let m = Maneuver { polarity, cycles, ..sweep() };
        let shape = Shape::of(&m).unwrap();
        let n = f64::from(cycles.unwrap_or(1));
        assert_eq!((shape.duration(), shape.polarity()), (8.0 * n, polarity));
        let values = sampled(&shape, 0.01);
        // 0.3 in a quarter of 8 s.
        for w in values.windows(2) {
            assert!(((w[1] - w[0]).abs() - 0.0015).abs() < 1e-12, "{w:?}");
        }
        for cycle in 0..n as usize {
            let at = |t: f64| values[800 * cycle + (100.0 * t) as usize] * f64::from(polarity);
            for (t, expected) in [(0.0, 0.0), (2.0, 0.3), (4.0, 0.0), (6.0, -0.3), (8.0, 0.0)] {
                assert!((at(t) - expected).abs() < 1e-12, "{t}");
            }
        }
        assert_eq!(amplitude(&m), 0.3);
    }
}

#[test]
fn every_step_may_have_its_own_amplitude() {
    let m = Maneuver {
        amplitude: None,
        amplitudes: Some(vec![0.5, 1.0, 2.0, 4.0]),
        ..maneuver("3211")
    };
    let shape = Shape::of(&m).unwrap();
    for (t, expected) in
        [(-0.1, 0.0), (0.0, -0.5), (1.4, -0.5), (1.5, 1.0), (2.6, -2.0), (3.2, 4.0), (3.5, 0.0)]
    {
        assert!((shape.value(t) - expected).abs() < 1e-12, "{t}: {}", shape.value(t));
    }
    assert_eq!(amplitude(&m), 4.0);
}

#[test]
fn fault_points_of_a_profile_are_refused_with_what_is_wrong() {
    let with = |times: &[f64], values: &[f64]| {
        mistakes(&Maneuver {
            times_s: Some(times.to_vec()),
            values: Some(values.to_vec()),
            ..profile()
        })
    };
    for (times, values, key, what) in [
        (&[1.0, 2.0][..], &[1.0, 2.0][..], "times_s", "must begin at 0 s, not at 1 s"),
        (&[0.0, 2.0, 2.0], &[1.0, 2.0, 0.0], "times_s", "must ascend: 2 s follows 2 s"),
        (&[0.0, f64::NAN], &[1.0, 2.0], "times_s", "must be numbers, not NaN"),
        (&[0.0], &[1.0], "times_s", "two points or more, not 1"),
        (&[0.0, 1.0], &[1.0], "values", "each of the 2 times, not 1"),
        (&[0.0, 1.0], &[1.0, f64::INFINITY], "values", "must be numbers, not inf"),
        (&[0.0, 1.0], &[0.0, 0.0], "values", "never leaves 0"),
    ] {
        let found = with(times, values);
        assert!(found.len() == 1 && found[0].0 == key && found[0].1.contains(what), "{found:?}");
    }
    let found = mistakes(&bare("profile"));
    assert_eq!(
        found,
        [
            ("times_s", "a profile needs `times_s`".into()),
            ("values", "a profile needs `values`".into())
        ]
    );
}

#[test]
fn fault_a_key_of_another_kind_says_whose_it_is() {
    let all = |kind: &str| Maneuver {
        amplitude: Some(1.0),
        amplitudes: Some(vec![1.0]),
        unit_time_s: Some(1.0),
        edge_s: 0.1,
        duration_s: Some(10.0),
        band_hz: Some([0.1, 1.0]),
        period_s: Some(10.0),
        cycles: Some(1),
        times_s: Some(vec![0.0, 1.0]),
        values: Some(vec![0.0, 1.0]),
        ..maneuver(kind)
    };
    let keys = |kind: &str| mistakes(&all(kind)).into_iter().map(|m| m.0).collect::<Vec<_>>();
    let steps = ["amplitudes", "unit_time_s", "edge_s"];
    let sines = ["duration_s", "band_hz"];
    let sweeps = ["period_s", "cycles"];
    let points = ["times_s", "values"];
    assert_eq!(keys("sweep"), [&steps[..], &sines, &points].concat());
    assert_eq!(keys("multisine"), [&steps[..], &sweeps, &points].concat());
    assert_eq!(keys("profile"), [&["amplitude"], &steps[..], &sines, &sweeps].concat());
    assert_eq!(keys("step"), [&sines[..], &sweeps, &points, &["amplitudes"]].concat());
    let found = mistakes(&Maneuver { period_s: Some(1.0), ..maneuver("3211") });
    assert_eq!(found, [("period_s", "`period_s` belongs to a sweep, not to \"3211\"".into())]);
}

#[test]
fn fault_sizes_and_periods_are_there_and_in_range() {
    for (m, key, what) in [
        (Maneuver { amplitude: None, ..sweep() }, "amplitude", "a sweep needs `amplitude`"),
        (Maneuver { period_s: None, ..sweep() }, "period_s", "a sweep needs `period_s`"),
        (Maneuver { period_s: Some(-1.0), ..sweep() }, "period_s", "greater than 0 s, not -1"),
        (Maneuver { cycles: Some(0), ..sweep() }, "cycles", "1 to 1000 cycles, not 0"),
        (Maneuver { amplitude: None, ..maneuver("211") }, "amplitude", "needs `amplitude`"),
        (
            Maneuver { amplitude: None, amplitudes: Some(vec![1.0; 2]), ..maneuver("211") },
            "amplitudes",
            "\"211\" has 3 steps: `amplitudes` must have as many values, not 2",
        ),
        (
            Maneuver { amplitude: None, amplitudes: Some(vec![1.0, -1.0]), ..maneuver("doublet") },
            "amplitudes",
            "greater than 0, not -1; the sign is `polarity`",
        ),
    ] {
        let found = mistakes(&m);
        assert!(found.len() == 1 && found[0].0 == key && found[0].1.contains(what), "{found:?}");
    }
}
