//! Sweeps of known rate and size under noise; what is no sweep.

use super::super::edits::Include;
use super::super::{Edits, Kind, Maneuver, Seek, Settings, Source, apply};
use super::find;
use crate::error::Place;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// A triangle from 0 to 1, to -1 and back to 0, in so many cycles; 0 outside.
fn triangle(t: f64, start: f64, period: f64, cycles: f64) -> f64 {
    let phase = (t - start) / period;
    if !(0.0..cycles).contains(&phase) {
        return 0.0;
    }
    let p = phase.fract();
    if p < 0.25 {
        4.0 * p
    } else if p < 0.75 {
        2.0 - 4.0 * p
    } else {
        4.0 * p - 4.0
    }
}

fn both() -> Settings {
    Settings { seek: vec![Seek::Multistep, Seek::Sweep], ..Settings::default() }
}

fn grid(length: f64, dt: f64, f: impl FnMut(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
    let t: Vec<f64> = (0..(length / dt) as usize).map(|i| i as f64 * dt).collect();
    let u = t.iter().copied().map(f).collect();
    (t, u)
}

fn kinds(found: &[Maneuver]) -> Vec<Kind> {
    found.iter().map(|m| m.kind).collect()
}

#[test]
fn recovery_sweeps_of_any_rate_are_found_under_noise() {
    let mut rng = Pcg64::seed_from_u64(7);
    for case in 0..300 {
        let period = 8.0 * 30f64.powf(rng.random_range(0.0..1.0));
        let cycles = f64::from(rng.random_range(1..4));
        let size = 10f64.powf(rng.random_range(-4.0..3.0));
        let sign = if rng.random_range(0..2) == 0 { 1.0 } else { -1.0 };
        let noise = rng.random_range(0.0..0.08);
        let offset = rng.random_range(-5.0..5.0);
        let drift = rng.random_range(-0.1..0.1) / (period * cycles);
        let dt = rng.random_range(0.005..0.1);
        let start = 10.0 + rng.random_range(0.0..1.0);
        let end = start + period * cycles;
        let (t, u) = grid(end + 10.0, dt, |t| {
            let e: f64 = StandardNormal.sample(&mut rng);
            size * (offset + drift * t + sign * triangle(t, start, period, cycles) + noise * e)
        });
        let found = find(&t, &u, &both());
        let about = format!(
            "case {case}: period {period:.1} cycles {cycles} noise {noise:.3} dt {dt:.3}: {found:#?}"
        );
        assert_eq!(kinds(&found), [Kind::Sweep], "{about}");
        let m = &found[0];
        let slack = (0.01 + 0.4 * noise) * period + dt;
        assert!((m.t_start - start).abs() < slack, "start {start}: {about}");
        assert!((m.t_end - end).abs() < slack, "end {end}: {about}");
        assert!((m.amplitude / size - 1.0).abs() < 0.1, "size {size}: {about}");
        assert!((4.0 * m.unit_time / period - 1.0).abs() < 0.04, "{about}");
        assert!(m.polarity == sign && m.score > 0.5 && m.score <= 1.0, "{about}");
        assert_eq!(m.steps.len(), 2 * cycles as usize, "{about}");
        assert!(m.steps.iter().all(|s| s.start < s.end), "{about}");
    }
}

#[test]
fn multisteps_and_sweeps_of_one_flight_each_have_their_name() {
    let mut rng = Pcg64::seed_from_u64(3);
    for (unit, period) in [(0.5, 20.0), (1.0, 60.0), (3.0, 12.0)] {
        let edges = [0.0, 3.0, 5.0, 6.0, 7.0].map(|k| 20.0 + k * unit);
        let (t, u) = grid(300.0, 0.02, |t| {
            let e: f64 = StandardNormal.sample(&mut rng);
            let steps: f64 = edges
                .windows(2)
                .zip([1.5, -1.5, 1.5, -1.5])
                .map(|(w, a)| if t >= w[0] && t < w[1] { a } else { 0.0 })
                .sum();
            steps + triangle(t, 60.0, period, 1.0) - triangle(t, 150.0, period, 2.0) + 0.02 * e
        });
        let found = find(&t, &u, &both());
        assert_eq!(kinds(&found), [Kind::K3211, Kind::Sweep, Kind::Sweep], "{found:#?}");
        let steps = find(&t, &u, &Settings::default());
        assert_eq!(kinds(&steps)[0], Kind::K3211);
        assert!(steps.iter().all(|m| m.kind != Kind::Sweep));
        let sweeps = find(&t, &u, &Settings { seek: vec![Seek::Sweep], ..Settings::default() });
        assert_eq!(kinds(&sweeps), [Kind::Sweep, Kind::Sweep]);
        assert_eq!(find(&t, &u, &Settings { seek: Vec::new(), ..Settings::default() }), []);
    }
}

#[test]
fn a_sweep_that_sticks_and_stops_is_still_one() {
    // A surface behind friction: it stays where it is until the command is 0.05 away.
    let mut place = 0.0f64;
    let (t, u) = grid(100.0, 0.02, |t| {
        let wanted = triangle(t, 20.0, 40.0, 1.0);
        place = place.clamp(wanted - 0.05, wanted + 0.05);
        place.clamp(-0.85, 0.85)
    });
    let found = find(&t, &u, &both());
    assert_eq!(kinds(&found), [Kind::Sweep], "{found:#?}");
    let m = &found[0];
    assert!((m.t_start - 20.0).abs() < 1.5 && (m.t_end - 60.0).abs() < 1.5, "{m:?}");
    assert!((m.amplitude - 0.85).abs() < 0.03, "{m:?}");
}

#[test]
fn what_moves_slowly_and_is_no_triangle_is_no_sweep() {
    let mut rng = Pcg64::seed_from_u64(5);
    let ramp = |t: f64, from: f64, length: f64| ((t - from) / length).clamp(0.0, 1.0);
    let square = |t: f64, unit: f64| {
        let k = (t - 50.0) / unit;
        if (0.0..1.0).contains(&k) {
            1.0
        } else if (1.0..2.0).contains(&k) {
            -1.0
        } else {
            0.0
        }
    };
    let shapes: [(&str, &dyn Fn(f64) -> f64); 13] = [
        ("drift", &|t| 0.01 * t),
        ("a ramp to a new trim", &|t| ramp(t, 50.0, 20.0)),
        ("a ramp there and back", &|t| ramp(t, 50.0, 20.0) - ramp(t, 90.0, 20.0)),
        ("one side of a triangle", &|t| ramp(t, 50.0, 20.0) - ramp(t, 70.0, 20.0)),
        ("a triangle that does not come back", &|t| {
            ramp(t, 50.0, 10.0) - 2.0 * ramp(t, 60.0, 20.0)
        }),
        ("a triangle without end", &|t| ((t / 30.0) % 2.0 - 1.0).abs()),
        ("a sine without end", &|t| (t / 5.0).sin()),
        ("a phugoid that dies out", &|t| {
            if t > 50.0 { (-(t - 50.0) / 60.0).exp() * ((t - 50.0) / 5.0).sin() } else { 0.0 }
        }),
        ("a doublet", &|t| square(t, 6.0)),
        ("a long doublet", &|t| square(t, 20.0)),
        ("one slow sine", &|t| {
            if (50.0..90.0).contains(&t) {
                ((t - 50.0) * std::f64::consts::TAU / 40.0).sin()
            } else {
                0.0
            }
        }),
        ("a quick triangle", &|t| triangle(t, 50.0, 3.0, 2.0)),
        ("nothing", &|_| 0.0),
    ];
    for (name, shape) in shapes {
        for noise in [0.0, 0.02, 0.1] {
            let (t, u) = grid(200.0, 0.02, |t| {
                let e: f64 = StandardNormal.sample(&mut rng);
                shape(t) + noise * e
            });
            let found = find(&t, &u, &both());
            assert!(!kinds(&found).contains(&Kind::Sweep), "{name}, noise {noise}: {found:#?}");
        }
    }
}

#[test]
fn a_leveller_and_lagged_steps_are_no_sweeps() {
    let mut rng = Pcg64::seed_from_u64(11);
    for seed in 0..20 {
        // Slow corrections without end: noise through two lags.
        let lag = 2.0 + f64::from(seed % 4);
        let (mut a, mut b) = (0.0, 0.0);
        let (t, u) = grid(300.0, 0.02, |_| {
            let e: f64 = StandardNormal.sample(&mut rng);
            a += 0.02 / lag * (8.0 * e - a);
            b += 0.02 / lag * (a - b);
            b
        });
        let found = find(&t, &u, &both());
        assert!(!kinds(&found).contains(&Kind::Sweep), "{found:#?}");
        // Steps of 3 s through lags of up to half a step.
        let edges = [0.0, 9.0, 15.0, 18.0, 21.0].map(|k| 30.0 + k);
        let slow = 0.1 * f64::from(seed % 15);
        let mut x = 0.0;
        let (t, u) = grid(80.0, 0.02, |t| {
            let levels = edges.windows(2).zip([1.0, -1.0, 1.0, -1.0]);
            let command: f64 =
                levels.map(|(w, a)| if t >= w[0] && t < w[1] { a } else { 0.0 }).sum();
            x += (command - x) * 0.02 / (slow + 0.02);
            x
        });
        let found = find(&t, &u, &both());
        assert!(!kinds(&found).contains(&Kind::Sweep), "lag {slow}: {found:#?}");
    }
}

#[test]
fn a_sweep_may_be_included_by_hand() {
    let (t, u) = grid(100.0, 0.02, |t| 3.0 - 0.4 * triangle(t, 20.0, 15.0, 3.0));
    let include = Include {
        flight: "f1".into(),
        input: "elevator".into(),
        kind: Kind::Sweep,
        t_start_s: 20.0,
        t_end_s: 65.0,
        reason: "a reason".into(),
    };
    let edits = Edits { include: vec![include.clone()], ..Edits::default() };
    let source = Source { flight: "f1", input: "elevator", t: &t, u: &u };
    let place = Place { file: "pipeline.toml".into(), line: 7, column: 1 };
    let all = apply(Vec::new(), &edits, &source, &Settings::default(), &place).unwrap();
    let m = &all[0];
    assert!(m.kind == Kind::Sweep && m.included && m.score == 0.0 && m.polarity == -1.0);
    assert_eq!((m.t_start, m.t_end, m.steps.len(), m.trim), (20.0, 65.0, 6, 3.0));
    assert!((m.amplitude - 0.4).abs() < 0.01 && (m.unit_time - 3.75).abs() < 1e-9, "{m:?}");
    let outside = Include { t_start_s: 200.0, t_end_s: 210.0, ..include };
    let edits = Edits { include: vec![outside], ..Edits::default() };
    let error = apply(Vec::new(), &edits, &source, &Settings::default(), &place).unwrap_err();
    assert!(error.to_string().contains("has no samples of \"elevator\""), "{error}");
}

#[test]
fn fault_gaps_and_wild_settings_are_survived() {
    let (t, mut u) = grid(100.0, 0.02, |t| triangle(t, 20.0, 40.0, 1.0));
    (0..u.len()).step_by(17).for_each(|i| u[i] = f64::NAN);
    assert_eq!(kinds(&find(&t, &u, &both())), [Kind::Sweep]);
    // Two seconds without samples inside: it is no longer one maneuver.
    (0..u.len()).filter(|i| (34.0..36.0).contains(&t[*i])).for_each(|i| u[i] = f64::NAN);
    assert_eq!(find(&t, &u, &both()), []);
    for wild in [
        Settings { min_period_s: f64::NAN, ..both() },
        Settings { min_period_s: -1.0, max_period_s: f64::INFINITY, ..both() },
        Settings { min_period_s: 1e300, quiet_s: 1e300, ..both() },
        Settings { threshold: f64::NAN, ..both() },
    ] {
        let _ = find(&t, &u, &wild);
    }
    assert_eq!(find(&[], &[], &both()), []);
    assert_eq!(find(&t, &vec![1.0; t.len()], &both()), []);
}

#[test]
fn sweeps_with_short_rests_between_them_are_several() {
    let mut rng = Pcg64::seed_from_u64(2);
    for (period, rest) in [(10.0, 1.5), (30.0, 2.5), (60.0, 6.0)] {
        let starts = [0.0, 1.0, 2.0, 3.0].map(|k| 10.0 + k * (period + rest));
        let (t, u) = grid(starts[3] + period + 10.0, 0.02, |t| {
            let e: f64 = StandardNormal.sample(&mut rng);
            starts.iter().map(|s| triangle(t, *s, period, 1.0)).sum::<f64>() + 0.02 * e
        });
        let found = find(&t, &u, &both());
        assert_eq!(kinds(&found), [Kind::Sweep; 4], "{period}: {found:#?}");
        for (m, start) in found.iter().zip(starts) {
            assert!((m.t_start - start).abs() < 0.02 * period, "{start}: {m:?}");
        }
    }
}
