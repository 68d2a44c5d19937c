//! Records with two wrong samples in a row, and with what looks like them and is flown, come in; what is
//! found wrong in them goes out.

use super::spikes::found;
use crate::simulate::Stream;

/// A motion with noise of an sd of 0.001.
fn motion() -> Vec<f64> {
    let mut stream = Stream::new(2, &["spikes"]);
    (0..3000).map(|k| 0.1 * libm::sin(0.05 * k as f64) + 1e-3 * stream.normal()).collect()
}

/// Times of so many samples a second.
fn at(rate_hz: f64, n: usize) -> Vec<i64> {
    (0..n).map(|k| (k as f64 * 1e9 / rate_hz) as i64).collect()
}

/// A surface at so many samples a second: noise, and from 20 s on a 3211 by a servo of 1 rad/s, whose last
/// steps are of `unit_s`.
fn flown(rate_hz: f64, unit_s: f64, seed: u64) -> Vec<f64> {
    let mut stream = Stream::new(seed, &["flown"]);
    let mut position = 0.0f64;
    let y = (0..(60.0 * rate_hz) as usize).map(|k| {
        let since = (k as f64 / rate_hz - 20.0) / unit_s;
        let wanted = match since {
            s if (0.0..3.0).contains(&s) || (5.0..6.0).contains(&s) => 0.1,
            s if (3.0..5.0).contains(&s) || (6.0..7.0).contains(&s) => -0.1,
            _ => 0.0,
        };
        position += (wanted - position).clamp(-1.0 / rate_hz, 1.0 / rate_hz);
        position + 1e-3 * stream.normal()
    });
    y.collect()
}

#[test]
fn two_wrong_samples_are_found_on_one_side_and_on_both() {
    for second in [0.35, 0.3, -0.35] {
        let mut y = flown(50.0, 0.5, 1);
        (y[400], y[401]) = (0.35, second);
        assert_eq!(found(&at(50.0, y.len()), &y, None), [400, 401], "{second}");
        // While the surface moves, and beside a single one.
        (y[1060], y[1061], y[2000]) = (0.6, 0.55, -0.5);
        let wrong = [400, 401, 1060, 1061, 2000];
        assert_eq!(found(&at(50.0, y.len()), &y, None), wrong, "{second}");
    }
}

#[test]
fn no_two_samples_are_found_in_what_is_flown() {
    for seed in 0..40 {
        for (rate_hz, unit_s) in [(20.0, 0.1), (20.0, 0.3), (50.0, 0.04), (50.0, 0.3), (100.0, 0.3)]
        {
            let y = flown(rate_hz, unit_s, seed);
            assert_eq!(found(&at(rate_hz, y.len()), &y, None), [0; 0], "{rate_hz} {unit_s}");
        }
    }
}

#[test]
fn two_samples_that_a_slow_record_or_others_explain_are_none() {
    let rate_hz = 50.0;
    let with = |of: &dyn Fn(usize) -> bool| -> Vec<f64> {
        let y = motion().into_iter().enumerate();
        y.map(|(k, v)| if of(k) { v + 0.5 } else { v }).collect()
    };
    let one = with(&|k| (700..702).contains(&k));
    assert_eq!(found(&at(rate_hz, 3000), &one, None), [700, 701]);
    // A pulse of 0.1 s at 20 Hz.
    assert_eq!(found(&at(20.0, 3000), &one, None), [0; 0]);
    // A command that steps elsewhere.
    let steps = with(&|k| (700..702).contains(&k) || k > 2000);
    assert_eq!(found(&at(rate_hz, 3000), &steps, None), [0; 0]);
    // A marker every second and a half.
    let marker = with(&|k| k % 75 < 2 && k > 77);
    assert_eq!(found(&at(rate_hz, 3000), &marker, None), [0; 0]);
}
