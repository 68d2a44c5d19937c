//! Lines of known truth in; whether the fit, its named outcomes and the coverage of its intervals
//! are right out.

use super::*;
use crate::fit::bands;
use crate::math::distribution::f_quantile;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// Points that have nothing in common.
fn apart<'a>(x: &'a [f64], sd: &'a [f64]) -> Points<'a> {
    Points { x, sd, shared: &[] }
}

const TRUTH: (f64, f64) = (-0.8, 0.3);

/// How often the truth was inside, of `trials` simulated fits.
#[derive(Debug)]
struct Coverage {
    joint: f64,
    slope: f64,
    simultaneous: f64,
    prediction: f64,
}

/// The squared distance of a supposed line from the fitted one, in units of its covariance and per
/// parameter: below `f_quantile(level, 2, dof)` where the line is inside the joint confidence
/// region of that level, and so inside the simultaneous band everywhere.
fn joint_statistic(fit: &LineFit, slope: f64, intercept: f64) -> f64 {
    // Slope and value at the centre are uncorrelated.
    let term =
        |difference: f64, sd: f64| if difference == 0.0 { 0.0 } else { (difference / sd).powi(2) };
    let at_center = intercept + slope * fit.x_center;
    0.5 * (term(slope - fit.slope, fit.slope_sd) + term(at_center - fit.y_center, fit.y_center_sd))
}

/// Fits of `n` points with true sd `s_i` from 0.02 to `0.02 * spread`, claimed sd `claim * s_i`,
/// scatter `tau` between points.
fn coverage(n: usize, spread: f64, claim: f64, tau: f64, trials: u64) -> Coverage {
    let mut inside = [0u64; 4];
    for trial in 0..trials {
        let mut rng = Pcg64::seed_from_u64(1000 + trial);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let x: Vec<f64> =
            (0..n).map(|i| 2.0 + i as f64 / (n - 1) as f64 + 0.02 * normal()).collect();
        let s: Vec<f64> = (0..n)
            .map(|i| 0.02 * f64::powf(spread, ((i * 7) % n) as f64 / (n - 1) as f64))
            .collect();
        let y: Vec<f64> =
            (0..n).map(|i| TRUTH.1 + TRUTH.0 * x[i] + s[i] * normal() + tau * normal()).collect();
        let claimed: Vec<f64> = s.iter().map(|s| claim * s).collect();
        let fit = line(apart(&x, &claimed), &y, &Settings::default()).unwrap();
        let xs: Vec<f64> = (0..21).map(|i| 2.0 + i as f64 / 20.0).collect();
        let within = bands(&fit, &xs, 0.95).iter().all(|b| {
            let truth = TRUTH.1 + TRUTH.0 * b.x;
            b.simultaneous.0 <= truth && truth <= b.simultaneous.1
        });
        // a further point with the typical sd
        let typical = crate::math::median(&s.iter().map(|s| s * s).collect::<Vec<f64>>()).sqrt();
        let new = TRUTH.1 + TRUTH.0 * 2.4 + typical * normal() + tau * normal();
        let predicted = bands(&fit, &[2.4], 0.95)[0].prediction;
        inside[0] +=
            u64::from(joint_statistic(&fit, TRUTH.0, TRUTH.1) <= f_quantile(0.95, 2.0, fit.dof));
        inside[1] +=
            u64::from((fit.slope - TRUTH.0).abs() <= fit.interval_factor(0.95) * fit.slope_sd);
        inside[2] += u64::from(within);
        inside[3] += u64::from(predicted.0 <= new && new <= predicted.1);
    }
    let [joint, slope, simultaneous, prediction] = inside.map(|k| k as f64 / trials as f64);
    Coverage { joint, slope, simultaneous, prediction }
}

fn covers(spread: f64, claim: f64, tau: f64, allowed: std::ops::RangeInclusive<f64>) {
    for n in [6, 12, 24] {
        let c = coverage(n, spread, claim, tau, 2500);
        let what = format!("n {n}, sd spread {spread}, claim {claim}, tau {tau}: {c:?}");
        println!("{what}");
        assert!(allowed.contains(&c.joint) && allowed.contains(&c.slope), "{what}");
        // A band over a limited range of x holds the line at least as often as the joint region.
        assert!((c.joint..=0.985).contains(&c.simultaneous), "{what}");
        assert!(allowed.contains(&c.prediction), "{what}");
    }
}

#[test]
fn the_region_covers_where_the_claims_are_right() {
    covers(2.0, 1.0, 0.0, 0.93..=0.97);
    covers(4.0, 1.0, 0.0, 0.93..=0.97);
}

#[test]
fn the_region_covers_where_all_claims_are_wrong_by_two() {
    covers(2.0, 2.0, 0.0, 0.93..=0.97);
    covers(2.0, 0.5, 0.0, 0.93..=0.97);
    covers(4.0, 2.0, 0.0, 0.93..=0.97);
}

#[test]
fn the_region_covers_where_points_scatter_more_than_they_claim() {
    covers(2.0, 1.0, 0.05, 0.93..=0.97);
    covers(2.0, 1.0, 0.3, 0.93..=0.97);
    covers(4.0, 1.0, 0.3, 0.93..=0.97);
}

/// Where the sd differ by a factor 4 and the scatter between points is as large as they are (or the
/// excess is a factor, not a scatter), the weights are estimated from few residuals: 92 to 97.5% is
/// what the method gives.
#[test]
fn the_region_nearly_covers_where_the_weights_are_hard_to_tell() {
    covers(4.0, 1.0, 0.05, 0.92..=0.97);
    covers(4.0, 0.5, 0.0, 0.94..=0.975);
}

#[test]
fn equal_sds_give_the_textbook_line() {
    // residuals of +-1 about y = 2 + 3 x at x = 0, 1, 2, 3: (+, -, -, +) is orthogonal to 1 and x
    let (x, y) = ([0.0, 1.0, 2.0, 3.0], [3.0, 4.0, 7.0, 12.0]);
    for sd in [1e-3, 1.0, 50.0] {
        let fit = line(apart(&x, &[sd; 4]), &y, &Settings::default()).unwrap();
        assert!((fit.slope - 3.0).abs() < 1e-12 && (fit.intercept - 2.0).abs() < 1e-12);
        // s^2 = RSS/(n-2) = 2, Sxx = 5: whatever the claim
        assert!((fit.slope_sd - (2.0f64 / 5.0).sqrt()).abs() < 1e-9, "{fit:?}");
        assert!((fit.intercept_sd - (2.0 * (0.25 + 1.5 * 1.5 / 5.0f64)).sqrt()).abs() < 1e-9);
        assert!((fit.covariance + 1.5 * 2.0 / 5.0).abs() < 1e-9);
        assert!((fit.reduced_chi_square * sd * sd - 2.0).abs() < 1e-9);
        assert!((fit.tau * fit.tau - (2.0 - sd * sd).max(0.0)).abs() < 1e-9);
        let band = bands(&fit, &[1.5], 0.95)[0];
        assert!((band.pointwise.1 - band.value - 4.302653 * 0.5f64.sqrt()).abs() < 1e-5);
        assert!(
            (band.simultaneous.1 - band.value - (2.0f64 * 19.0).sqrt() * 0.5f64.sqrt()).abs()
                < 1e-5
        );
        assert!((band.prediction.1 - band.value - 4.302653 * 2.5f64.sqrt()).abs() < 1e-5);
    }
}

#[test]
fn weights_count() {
    // the third point claims nothing: the line goes through the other three nearly
    let fit = line(
        apart(&[0.0, 1.0, 2.0, 4.0], &[1e-3, 1e-3, 1e3, 1e-3]),
        &[0.0, 1.0, 100.0, 4.0],
        &Settings::default(),
    )
    .unwrap();
    assert!((fit.slope - 1.0).abs() < 1e-6 && fit.intercept.abs() < 1e-6 && fit.tau == 0.0);
}

#[test]
fn joint_statistic_is_the_quadratic_form() {
    let mut rng = Pcg64::seed_from_u64(5);
    let x: Vec<f64> = (0..9).map(|_| rng.random_range(0.0..1.0)).collect();
    let y: Vec<f64> = x.iter().map(|x| 1.0 + x + rng.random_range(-0.1..0.1)).collect();
    let sd: Vec<f64> = x.iter().map(|_| rng.random_range(0.02..0.1)).collect();
    let fit = line(apart(&x, &sd), &y, &Settings::default()).unwrap();
    let (a, b) = (1.1 - fit.slope, 0.9 - fit.intercept);
    let (va, vb, c) = (fit.slope_sd.powi(2), fit.intercept_sd.powi(2), fit.covariance);
    let form = (a * a * vb - 2.0 * a * b * c + b * b * va) / (va * vb - c * c) / 2.0;
    assert!((joint_statistic(&fit, 1.1, 0.9) / form - 1.0).abs() < 1e-9);
    assert_eq!(
        joint_statistic(&fit, fit.slope, fit.value(fit.x_center) - fit.slope * fit.x_center),
        0.0
    );
}

#[test]
fn far_from_the_origin_nothing_is_lost() {
    let x: Vec<f64> = (0..8).map(|i| 1e6 + i as f64 * 1e-2).collect();
    let y: Vec<f64> =
        (0..8).map(|i| 5e3 + i as f64 * 2e-2 + if i % 2 == 0 { 1e-4 } else { -1e-4 }).collect();
    let fit = line(apart(&x, &[1e-4; 8]), &y, &Settings::default()).unwrap();
    assert!((fit.slope - 2.0).abs() < 0.01 && (fit.value(1e6 + 0.035) - 5e3 - 0.07).abs() < 1e-4);
}

#[test]
fn what_cannot_be_fitted_has_a_name() {
    let s = Settings::default();
    assert_eq!(line(apart(&[], &[]), &[], &s), Err(Unfit::TooFewPoints));
    assert_eq!(line(apart(&[1.0, 2.0], &[1.0, 1.0]), &[1.0, 2.0], &s), Err(Unfit::TooFewPoints));
    assert_eq!(
        line(apart(&[2.0; 4], &[1.0; 4]), &[1.0, 2.0, 3.0, 4.0], &s),
        Err(Unfit::IdenticalX)
    );
    assert_eq!(
        line(apart(&[1.0, 2.0, 3.0], &[1.0; 3]), &[1.0, f64::NAN, 1.0], &s),
        Err(Unfit::BadValue(1))
    );
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(
            line(apart(&[1.0, 2.0, 3.0], &[1.0, 1.0, bad]), &[1.0; 3], &s),
            Err(Unfit::BadSd(2))
        );
    }
    assert_eq!(Unfit::BadSd(2).name(), "bad_sd");
}

#[test]
fn without_between_scatter_tau_is_zero() {
    let fit = line(
        apart(&[0.0, 1.0, 2.0, 3.0], &[0.1; 4]),
        &[3.0, 4.0, 7.0, 12.0],
        &Settings { between_scatter: false },
    )
    .unwrap();
    assert_eq!(fit.tau, 0.0);
    assert!((fit.q - 200.0).abs() < 1e-9);
}

#[test]
fn a_common_error_of_the_points_is_carried_into_the_line() {
    let (x, sd) = ([1.0, 2.0, 4.0, 7.0], [0.1, 0.3, 0.2, 0.1]);
    let y = [2.0, 3.5, 4.1, 9.0];
    let change = [0.3, -0.1, 0.2, 0.5];
    for between_scatter in [false, true] {
        let settings = Settings { between_scatter };
        let base = line(apart(&x, &sd), &y, &settings).unwrap();
        let (slope, intercept) = carried(&base, apart(&x, &sd), &change);
        // A small move leaves the scatter between the points, and so the weights, nearly as they
        // are.
        let moved: Vec<f64> = y.iter().zip(change).map(|(y, c)| y + 1e-6 * c).collect();
        let other = line(apart(&x, &sd), &moved, &settings).unwrap();
        if !between_scatter {
            assert!(((other.slope - base.slope) / 1e-6 - slope).abs() < 1e-6);
            assert!(((other.intercept - base.intercept) / 1e-6 - intercept).abs() < 1e-6);
        }
        let all = carried(&base, apart(&x, &sd), &[0.7; 4]);
        assert!(all.0.abs() < 1e-12 && (all.1 - 0.7).abs() < 1e-12, "{all:?}");
    }
}

/// Each point with its own effects of the sources of its group.
fn groups(of: &[(usize, f64)]) -> Vec<Shared> {
    let mut all: Vec<Shared> = Vec::new();
    for (point, &(group, effect)) in of.iter().enumerate() {
        if !all.iter().any(|s| s.group == group) {
            all.push(Shared { group, sources: 1, points: vec![], effects: vec![] });
        }
        if let Some(found) = all.iter_mut().find(|s| s.group == group) {
            found.points.push(point);
            found.effects.push(effect);
        }
    }
    all
}

#[test]
fn an_error_that_all_points_share_is_in_the_intercept_alone() {
    // All errors one and the same number of variance c besides their own.
    let x: Vec<f64> = (0..8).map(f64::from).collect();
    let y: Vec<f64> = x.iter().map(|x| 1.0 + 0.5 * x + 0.1 * libm::sin(x * 7.3)).collect();
    let (own, c): (f64, f64) = (0.1, 0.04);
    let sd = vec![(own * own + c).sqrt(); 8];
    for between_scatter in [false, true] {
        let settings = Settings { between_scatter };
        let all = groups(&[(0, c.sqrt()); 8]);
        let with = line(Points { x: &x, sd: &sd, shared: &all }, &y, &settings).expect("a line");
        // The residuals show the own errors alone: slope and scale are those of a line without the
        // rest.
        let alone = line(apart(&x, &[own; 8]), &y, &settings).expect("a line");
        assert!((with.q / alone.q - 1.0).abs() < 1e-9, "{} {}", with.q, alone.q);
        assert!((with.slope_sd / alone.slope_sd - 1.0).abs() < 1e-9);
        let wanted = alone.intercept_sd.powi(2) + alone.q * c;
        assert!((with.intercept_sd.powi(2) / wanted - 1.0).abs() < 1e-9);
        assert!((with.slope - alone.slope).abs() < 1e-12);
        assert!((with.intercept - alone.intercept).abs() < 1e-12);
        // The bands use the same numbers: the value at zero has the intercept's sd.
        assert!((with.value_sd(0.0) - with.intercept_sd).abs() < 1e-12);
        // What only one point has from a source is its own.
        let each: Vec<(usize, f64)> = (0..8).map(|point| (point, c.sqrt())).collect();
        let none = line(apart(&x, &sd), &y, &settings).expect("a line");
        let shared = groups(&each);
        let same = line(Points { x: &x, sd: &sd, shared: &shared }, &y, &settings).expect("a line");
        assert!((same.slope_sd / none.slope_sd - 1.0).abs() < 1e-12);
        assert!((same.intercept_sd / none.intercept_sd - 1.0).abs() < 1e-12);
    }
}

/// Three flights whose maneuvers share an error: the region covers where claims are right, all too
/// large by one factor, and with scatter between the maneuvers.
#[test]
fn the_region_covers_where_maneuvers_of_a_flight_share_an_error() {
    for (tau, claim) in [(0.0, 1.0), (0.0, 2.0), (0.05, 1.0)] {
        let (mut joint, mut without, trials) = (0, 0, 2500);
        for trial in 0..trials {
            let mut rng = Pcg64::seed_from_u64(7000 + trial);
            let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
            let flights: Vec<f64> = (0..3).map(|_| normal()).collect();
            let (mut x, mut y, mut sd, mut effects) = (vec![], vec![], vec![], vec![]);
            for point in 0..30 {
                let at = 2.0 + (point % 10) as f64 / 9.0;
                let (own, effect) = (0.02, 0.03 * (1.0 + 0.5 * (at - 2.5)));
                let error = own * normal() + effect * flights[point / 10] + tau * normal();
                x.push(at);
                y.push(TRUTH.1 + TRUTH.0 * at + error);
                sd.push(claim * f64::hypot(own, effect));
                effects.push((point / 10, claim * effect));
            }
            let inside = |shared: &[Shared]| {
                let points = Points { x: &x, sd: &sd, shared };
                let fit = line(points, &y, &Settings::default()).expect("a line");
                let limit = f_quantile(0.95, 2.0, fit.dof);
                u64::from(joint_statistic(&fit, TRUTH.0, TRUTH.1) <= limit)
            };
            joint += inside(&groups(&effects));
            without += inside(&[]);
        }
        let [joint, without] = [joint, without].map(|k| k as f64 / trials as f64);
        println!("tau {tau}, claim {claim}: {joint} with, {without} without");
        assert!((0.93..=0.97).contains(&joint), "tau {tau}, claim {claim}: {joint}");
        assert!(without < 0.9, "the test would not notice: {without}");
    }
}

#[test]
fn lines_with_one_source_in_common_are_correlated() {
    let x: Vec<f64> = (0..8).map(f64::from).collect();
    let y: Vec<f64> = x.iter().map(|x| 1.0 + 0.5 * x + 0.1 * libm::sin(x * 7.3)).collect();
    let (own, c): (f64, f64) = (0.1, 0.04);
    let sd = vec![(own * own + c).sqrt(); 8];
    let all = groups(&[(0, c.sqrt()); 8]);
    let points = Points { x: &x, sd: &sd, shared: &all };
    let fit = line(points, &y, &Settings { between_scatter: false }).expect("a line");
    let one = (&fit, points);
    let found = crate::fit::correlations(one, one, &[]);
    let wanted = fit.q * c / fit.intercept_sd.powi(2);
    assert!((found[1][1] - wanted).abs() < 1e-9, "{found:?} {wanted}");
    assert!(found[0][0].abs() < 1e-9 && found[0][1].abs() < 1e-9);
    // With its own errors as pairs it is the line itself.
    let pairs: Vec<(usize, usize, f64)> = (0..8).map(|i| (i, i, own * own)).collect();
    let found = crate::fit::correlations(one, one, &pairs);
    assert!((found[0][0] - 1.0).abs() < 1e-9 && (found[1][1] - 1.0).abs() < 1e-9, "{found:?}");
    let both = fit.covariance / (fit.slope_sd * fit.intercept_sd);
    assert!((found[0][1] - both).abs() < 1e-9);
}
