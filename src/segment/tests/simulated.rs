//! Simulated input channels of known truth.

use super::super::{Kind, Maneuver, Settings, search};
use super::find;
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// One maneuver on a channel.
#[derive(Debug, Clone, Copy)]
struct Flown {
    kind: Kind,
    start: f64,
    unit: f64,
    amplitude: f64,
}

impl Flown {
    fn end(&self) -> f64 {
        self.start + self.unit * self.kind.pattern().iter().sum::<f64>()
    }

    fn command(&self, t: f64) -> f64 {
        let mut from = self.start;
        for (k, duration) in self.kind.pattern().iter().enumerate() {
            let to = from + duration * self.unit;
            if t >= from && t < to {
                return if k % 2 == 0 { self.amplitude } else { -self.amplitude };
            }
            from = to;
        }
        0.0
    }
}

/// What else is on the channel.
#[derive(Debug, Clone, Copy, Default)]
struct Disturbance {
    /// Sd of white noise.
    noise: f64,
    /// Time constant of a first-order lag on the whole channel, s.
    lag: f64,
    offset: f64,
    /// Slope of the trim, 1/s.
    drift: f64,
    /// Sd of slow continuous corrections (time constant about 2 s) between the maneuvers.
    leveller: f64,
    /// Sd of the time stamps' jitter as a share of their spacing.
    jitter: f64,
    seed: u64,
}

/// The channel as recorded: times and values.
fn record(flown: &[Flown], length: f64, dt: f64, d: &Disturbance) -> (Vec<f64>, Vec<f64>) {
    let mut rng = Pcg64::seed_from_u64(d.seed);
    let fine = 1e-3;
    let (mut lagged, mut walk, mut corrections) = (0.0f64, 0.0f64, 0.0f64);
    let mut next = 0.0;
    let (mut t, mut u) = (vec![], vec![]);
    for i in 0..(length / fine) as usize {
        let time = i as f64 * fine;
        // second-order coloured corrections of unit sd
        let e: f64 = StandardNormal.sample(&mut rng);
        walk += fine / 2.0 * -walk + (2.0 * fine / 2.0f64).sqrt() * e;
        corrections += fine / 1.0 * (walk * 1.22 - corrections);
        let command: f64 = flown.iter().map(|f| f.command(time)).sum();
        lagged += if d.lag > 0.0 {
            (1.0 - (-fine / d.lag).exp()) * (command - lagged)
        } else {
            command - lagged
        };
        if time >= next {
            let e: f64 = StandardNormal.sample(&mut rng);
            t.push(time);
            u.push(d.offset + d.drift * time + lagged + d.leveller * corrections + d.noise * e);
            let e: f64 = StandardNormal.sample(&mut rng);
            next += dt * (1.0 + (d.jitter * e).clamp(-0.8, 0.8));
        }
    }
    (t, u)
}

/// `m` is the maneuver flown: kind, polarity, amplitude, times (a lag delays every edge alike),
/// unit time.
fn is(m: &Maneuver, f: &Flown, dt: f64, d: &Disturbance) -> Result<(), TestCaseError> {
    let delay = 0.69 * d.lag;
    let slack = 0.6 * dt + 0.12 * f.unit + 0.02;
    prop_assert_eq!(m.kind, f.kind);
    prop_assert_eq!(m.polarity, f.amplitude.signum());
    prop_assert!((m.amplitude / f.amplitude.abs() - 1.0).abs() < 0.25, "amplitude {}", m.amplitude);
    prop_assert!(
        (m.t_start - f.start - delay).abs() < slack,
        "start {} of {}",
        m.t_start,
        f.start + delay
    );
    prop_assert!(
        (m.t_end - f.end() - delay).abs() < slack,
        "end {} of {}",
        m.t_end,
        f.end() + delay
    );
    prop_assert!(
        (m.unit_time / f.unit - 1.0).abs() < 0.12 + 0.5 * dt / f.unit,
        "unit {}",
        m.unit_time
    );
    prop_assert!(m.onset <= m.t_start && m.onset > f.start - slack - 0.15, "onset {}", m.onset);
    prop_assert!(m.score > 0.4 && m.score <= 1.0);
    prop_assert!(m.included && m.reason.is_empty());
    Ok(())
}

fn kinds() -> impl Strategy<Value = Kind> {
    proptest::sample::select(vec![Kind::K3211, Kind::K2211, Kind::K211, Kind::Doublet, Kind::Step])
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, rng_seed: proptest::test_runner::RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn one_maneuver_is_found_whatever_its_unit_time(
        kind in kinds(), unit in 0.25f64..3.0, up in any::<bool>(), size in -6.0f64..2.0, noise in 0.0f64..0.08, lag in 0.0f64..0.3,
        offset in -20.0f64..20.0, drift in -0.01f64..0.01, jitter in 0.0f64..0.3, dt in 0.01f64..0.06, leveller in 0.0f64..0.03, seed in any::<u64>(),
    ) {
        let amplitude = 10f64.powf(size);
        let f = Flown { kind, start: 8.0, unit, amplitude: if up { amplitude } else { -amplitude } };
        let d = Disturbance {
            noise: noise * amplitude, lag: lag * unit, offset: offset * amplitude, drift: drift * amplitude,
            leveller: leveller * amplitude, jitter, seed,
        };
        let (t, u) = record(&[f], f.end() + 8.0, dt, &d);
        let found = find(&t, &u, &Settings::default());
        prop_assert_eq!(found.len(), 1, "{:?}", found);
        is(&found[0], &f, dt, &d)?;
    }

    #[test]
    fn scale_and_offset_change_nothing(unit in 0.4f64..2.0, factor in -4.0f64..4.0, offset in -5.0f64..5.0, seed in any::<u64>()) {
        let f = Flown { kind: Kind::K3211, start: 5.0, unit, amplitude: 1.0 };
        let d = Disturbance { noise: 0.03, lag: 0.1, seed, ..Disturbance::default() };
        let (t, u) = record(&[f], f.end() + 5.0, 0.02, &d);
        let factor = 10f64.powf(factor);
        let scaled: Vec<f64> = u.iter().map(|u| -factor * (u + offset)).collect();
        let (a, b) = (find(&t, &u, &Settings::default()), find(&t, &scaled, &Settings::default()));
        prop_assert_eq!(a.len(), 1);
        prop_assert_eq!(b.len(), 1);
        prop_assert!(a[0].kind == b[0].kind && a[0].polarity == -b[0].polarity);
        prop_assert!((a[0].t_start - b[0].t_start).abs() < 1e-6 && (a[0].score - b[0].score).abs() < 1e-6);
        prop_assert!((a[0].amplitude * factor / b[0].amplitude - 1.0).abs() < 1e-6);
    }
}

#[test]
fn a_flight_gives_its_maneuvers_and_nothing_else() {
    for seed in 0..10 {
        let mut flown = vec![];
        let mut rng = Pcg64::seed_from_u64(seed);
        for (i, kind) in
            [Kind::K3211, Kind::K3211, Kind::Doublet, Kind::K211, Kind::K2211, Kind::K3211]
                .into_iter()
                .enumerate()
        {
            let amplitude = rng.random_range(0.6..1.5) * if i % 2 == 0 { 1.0 } else { -1.0 };
            flown.push(Flown {
                kind,
                start: 30.0 + 45.0 * i as f64,
                unit: rng.random_range(0.5..2.0),
                amplitude,
            });
        }
        let d = Disturbance {
            noise: 0.02,
            lag: 0.08,
            offset: 3.0,
            drift: 0.005,
            leveller: 0.04,
            jitter: 0.1,
            seed,
        };
        let (t, u) = record(&flown, 320.0, 0.02, &d);
        let found = find(&t, &u, &Settings::default());
        let listing: Vec<String> = found
            .iter()
            .map(|m| {
                format!(
                    "{} {:.2} {:.2} A {:.3} s {:.2}",
                    m.kind, m.t_start, m.t_end, m.amplitude, m.score
                )
            })
            .collect();
        println!("seed {seed}: {listing:#?}");
        assert_eq!(found.len(), flown.len(), "seed {seed}: {flown:#?}");
        for (m, f) in found.iter().zip(&flown) {
            is(m, f, 0.02, &d).unwrap();
        }
    }
}

#[test]
fn a_leveller_alone_gives_no_maneuvers() {
    let mut alarms = vec![];
    for seed in 0..20 {
        let d = Disturbance {
            noise: 0.02,
            leveller: 1.0,
            drift: 0.05,
            jitter: 0.1,
            seed,
            ..Disturbance::default()
        };
        let (t, u) = record(&[], 300.0, 0.02, &d);
        alarms.extend(find(&t, &u, &Settings::default()).into_iter().map(|m| (seed, m)));
        let still = Disturbance { noise: 1.0, seed, ..Disturbance::default() };
        let (t, u) = record(&[], 300.0, 0.02, &still);
        alarms.extend(find(&t, &u, &Settings::default()).into_iter().map(|m| (seed, m)));
    }
    alarms.iter().for_each(|(seed, m)| {
        println!(
            "seed {seed}: {} {:.2} to {:.2} s score {:.2}",
            m.kind, m.t_start, m.t_end, m.score
        )
    });
    assert!(alarms.is_empty(), "{} false maneuvers in 200 minutes", alarms.len());
}

#[test]
fn smooth_corrections_without_noise_give_no_maneuvers() {
    let t: Vec<f64> = (0..20_000).map(|i| i as f64 * 0.02).collect();
    for period in [6.0, 15.0, 40.0] {
        let u: Vec<f64> =
            t.iter().map(|t| (t * std::f64::consts::TAU / period).sin() + 0.01 * t).collect();
        assert_eq!(find(&t, &u, &Settings::default()), [], "period {period}");
    }
    let ramps: Vec<f64> = t.iter().map(|t| ((t / 30.0) % 2.0 - 1.0).abs()).collect();
    assert_eq!(find(&t, &ramps, &Settings::default()), []);
    assert_eq!(find(&t, &vec![0.3; t.len()], &Settings::default()), []);
}

#[test]
fn overshoot_and_rate_limits_do_not_disturb() {
    let f = Flown { kind: Kind::K3211, start: 5.0, unit: 1.0, amplitude: 1.0 };
    let (mut x, mut v, mut slow) = (0.0f64, 0.0f64, 0.0f64);
    let (mut t, mut ringing, mut limited) = (vec![], vec![], vec![]);
    for i in 0..20_000 {
        let time = i as f64 * 1e-3;
        // 12 rad/s, damping 0.4: 25% overshoot; 5 units per second
        v += 1e-3 * (144.0 * (f.command(time) - x) - 2.0 * 0.4 * 12.0 * v);
        x += 1e-3 * v;
        slow += (f.command(time) - slow).clamp(-5e-3, 5e-3);
        if i % 20 == 0 {
            t.push(time);
            ringing.push(x);
            limited.push(slow);
        }
    }
    for u in [ringing, limited] {
        let found = find(&t, &u, &Settings::default());
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            found[0].kind == Kind::K3211
                && (found[0].unit_time - 1.0).abs() < 0.06
                && found[0].score > 0.6,
            "{found:?}"
        );
    }
}

#[test]
fn gaps_and_nonsense_are_survived() {
    let s = Settings::default();
    assert_eq!(find(&[], &[], &s), []);
    assert_eq!(find(&[0.0, 1.0], &[0.0, 1.0], &s), []);
    assert_eq!(find(&[0.0; 50], &[1.0; 50], &s), []);
    let f = Flown { kind: Kind::K3211, start: 10.0, unit: 1.0, amplitude: 1.0 };
    let (t, mut u) =
        record(&[f], 30.0, 0.02, &Disturbance { noise: 0.02, ..Disturbance::default() });
    let whole = find(&t, &u, &s);
    // single NaN samples do not matter
    (0..u.len()).step_by(17).for_each(|i| u[i] = f64::NAN);
    let holes = find(&t, &u, &s);
    assert!(holes.len() == 1 && (holes[0].t_start - whole[0].t_start).abs() < 0.02);
    // a second of NaN inside the maneuver hides it: no maneuver across a gap
    (0..u.len()).filter(|&i| t[i] > 11.0 && t[i] < 12.0).for_each(|i| u[i] = f64::NAN);
    assert!(
        find(&t, &u, &s)
            .iter()
            .all(|m| m.kind != Kind::K3211 && (m.t_start > 12.0 || m.t_end < 11.0))
    );
    assert_eq!(find(&t, &vec![f64::NAN; t.len()], &s), []);
    // a clock that jumps by decades costs neither memory nor what was flown before and after
    let (mut times, mut values) =
        record(&[f], 30.0, 0.02, &Disturbance { noise: 0.02, ..Disturbance::default() });
    times.extend(times.clone().iter().map(|t| t + 1.7e9));
    values.extend(values.clone());
    assert_eq!(
        find(&times, &values, &s).iter().map(|m| m.kind).collect::<Vec<_>>(),
        [Kind::K3211, Kind::K3211]
    );
    let wild =
        Settings { max_step_s: 1e300, quiet_s: 1e300, max_gap_s: -1.0, threshold: f64::NAN, ..s };
    assert_eq!(find(&t, &u, &wild), []);
}

#[test]
fn the_quiet_window_ends_where_the_signal_leaves_trim() {
    let f = Flown { kind: Kind::Doublet, start: 10.0, unit: 1.0, amplitude: 2.0 };
    let (t, u) = record(
        &[f],
        20.0,
        0.02,
        &Disturbance { noise: 0.02, lag: 0.2, offset: 7.0, ..Disturbance::default() },
    );
    let m = &find(&t, &u, &Settings::default())[0];
    let (from, to) = m.pre_window(1.0);
    assert!((to - from - 1.0).abs() < 1e-12 && to <= 10.05 && to > 9.9, "{m:?}");
    assert!((m.trim - 7.0).abs() < 0.02);
}

#[test]
fn small_and_unwanted_maneuvers_are_filtered_by_amplitude() {
    let flown = [1.0, 1.0, 0.1].map(|amplitude| Flown {
        kind: Kind::Doublet,
        start: 10.0 * (1.0 + 20.0 * (1.0 - amplitude)),
        unit: 1.0,
        amplitude,
    });
    let flown = [flown[0], Flown { start: 30.0, ..flown[1] }, Flown { start: 50.0, ..flown[2] }];
    let (t, u) =
        record(&flown, 70.0, 0.02, &Disturbance { noise: 0.005, ..Disturbance::default() });
    assert_eq!(find(&t, &u, &Settings::default()).len(), 2);
    assert_eq!(find(&t, &u, &Settings { relative_amplitude: 0.0, ..Settings::default() }).len(), 3);
    assert_eq!(find(&t, &u, &Settings { min_amplitude: 3.0, ..Settings::default() }), []);
}

#[test]
fn what_a_gap_or_the_end_cuts_off_is_told() {
    let flown = |start: f64| Flown { kind: Kind::K3211, start, unit: 0.5, amplitude: 0.05 };
    let quiet = Disturbance { noise: 1e-4, ..Disturbance::default() };
    let all = [flown(5.0), flown(15.0), flown(25.0)];
    let (t, u) = record(&all, 40.0, 0.02, &quiet);
    let settings = Settings::default();
    let cut = |keep: &dyn Fn(f64) -> bool| {
        let (t, u): (Vec<f64>, Vec<f64>) =
            t.iter().zip(&u).filter(|(t, _)| keep(**t)).map(|(t, u)| (*t, *u)).unzip();
        search(&t, &u, &settings).cut
    };
    assert_eq!(cut(&|_| true), []);
    let ended = cut(&|t| t < 27.2);
    assert!(
        matches!(ended[..], [one] if (one.from - 25.0).abs() < 0.2 && one.steps == 2 && !one.by_gap),
        "{ended:?}"
    );
    let gap = cut(&|t| !(16.0..18.0).contains(&t));
    assert!(matches!(gap[..], [one] if (one.from - 15.0).abs() < 0.2 && one.by_gap), "{gap:?}");
}
