//! Estimates, standard deviations, stops and verdicts on problems whose answer is known.

use super::{Known, Settings, Toy, normal, rng, sds, toy_response};
use crate::estimate::solution::{Solution, solve};
use crate::estimate::{StepControl, Stop};
use crate::least_squares::{Block, Layout};
use crate::noise::OrderCriterion;

/// Straight lines `y = c + m t`: rows `[1, t]`, one class per line.
fn lines(z: &[Vec<f64>], t: &[Vec<f64>], p: &[f64]) -> Vec<Block> {
    z.iter()
        .zip(t)
        .enumerate()
        .map(|(output, (z, t))| {
            Block::new(
                output,
                z.iter().zip(t).map(|(z, t)| z - p[0] - p[1] * t).collect(),
                t.iter().flat_map(|t| [1.0, *t]).collect(),
            )
        })
        .collect()
}

/// Variances of the one group.
fn r(s: &Solution) -> Vec<f64> {
    s.fit.noise[0].variances()
}

fn close(a: f64, b: f64, relative: f64) {
    assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
}

#[test]
fn one_straight_line_is_ordinary_least_squares() {
    let mut rng = rng(1);
    let t: Vec<f64> = (0..50).map(|k| k as f64 * 0.1).collect();
    let z: Vec<f64> = t.iter().map(|t| 2.0 - 0.5 * t + 0.3 * normal(&mut rng)).collect();
    let layout = Layout::plain(2, &[0], 1, vec![0.0, 0.0]);
    let s = solve(
        &layout,
        &|_: usize, p: &[f64], _: bool| {
            Some(lines(std::slice::from_ref(&z), std::slice::from_ref(&t), p))
        },
        &Settings::default(),
        &Known::default(),
    );
    assert_eq!(s.fit.stop, Stop::Converged);
    let n = t.len() as f64;
    let (mt, mz) = (t.iter().sum::<f64>() / n, z.iter().sum::<f64>() / n);
    let stt: f64 = t.iter().map(|t| (t - mt) * (t - mt)).sum();
    let slope = t.iter().zip(&z).map(|(t, z)| (t - mt) * (z - mz)).sum::<f64>() / stt;
    close(s.fit.theta[1], slope, 1e-12);
    close(s.fit.theta[0], mz - slope * mt, 1e-12);
    let mean = t.iter().zip(&z).map(|(t, z)| (z - mz - slope * (t - mt)).powi(2)).sum::<f64>() / n;
    close(r(&s)[0], mean, 1e-12);
    close(sds(s.crlb.as_ref().unwrap())[1], (mean / stt).sqrt(), 1e-12);
}

#[test]
fn outputs_of_different_length_and_noise_get_their_own_variance() {
    let mut rng = rng(2);
    let t: Vec<Vec<f64>> =
        [3000, 500].iter().map(|n| (0..*n).map(|k| k as f64 / *n as f64).collect()).collect();
    let sd = [0.1, 2.0];
    let z: Vec<Vec<f64>> = t
        .iter()
        .zip(sd)
        .map(|(t, sd)| t.iter().map(|t| 1.0 + t + sd * normal(&mut rng)).collect())
        .collect();
    let layout = Layout::plain(2, &[0], 2, vec![5.0, -3.0]);
    let s = solve(
        &layout,
        &|_: usize, p: &[f64], _: bool| Some(lines(&z, &t, p)),
        &Settings::default(),
        &Known::default(),
    );
    assert_eq!(s.fit.stop, Stop::Converged);
    close(r(&s)[0].sqrt(), 0.1, 0.05);
    close(r(&s)[1].sqrt(), 2.0, 0.1);
    assert_eq!(s.fit.noise[0].count, [3000, 500]);
    close(s.fit.iterations.last().unwrap().det_r, r(&s)[0] * r(&s)[1], 1e-12);
    // The gradient of the whole likelihood vanishes: sum over outputs of G' e / R.
    let blocks = lines(&z, &t, &s.fit.theta);
    let gradient = |i: usize| -> f64 {
        blocks
            .iter()
            .map(|b| {
                b.e.iter().enumerate().map(|(k, e)| e * b.g[2 * k + i]).sum::<f64>()
                    / r(&s)[b.output]
            })
            .sum()
    };
    let sd = sds(s.crlb.as_ref().unwrap());
    assert!((0..2).all(|i| (gradient(i) * sd[i]).abs() < 1e-3));
}

#[test]
fn the_same_data_twice_halve_the_variance_only() {
    let once = Toy::simulate(3, 1, 400, 0.1, 0.5);
    let twice = Toy { z: vec![once.z[0].clone(), once.z[0].clone()] };
    let settings = Settings {
        tolerance: 1e-12,
        step_tolerance: 1e-6,
        ar_order: OrderCriterion::Bic,
        ..Settings::default()
    };
    let (a, b) = (once.solve(&settings), twice.solve(&settings));
    assert_eq!((a.fit.stop, b.fit.stop), (Stop::Converged, Stop::Converged));
    for i in 0..2 {
        close(b.fit.theta[i], a.fit.theta[i], 1e-8);
        close(
            sds(b.crlb.as_ref().unwrap())[i],
            sds(a.crlb.as_ref().unwrap())[i] / 2f64.sqrt(),
            1e-6,
        );
        // The corrected one takes the copies for independent, so that each absorbed less of its
        // noise: nearly the same colour.
        close(
            sds(b.covariance.as_ref().unwrap())[i],
            sds(a.covariance.as_ref().unwrap())[i] / 2f64.sqrt(),
            0.02,
        );
    }
}

fn all_bits(s: &Solution) -> Vec<u64> {
    let mut out: Vec<f64> = s.fit.theta.clone();
    out.extend(r(s));
    out.extend(s.fit.iterations.iter().flat_map(|i| [i.cost, i.det_r, i.step]));
    out.extend(sds(s.covariance.as_ref().unwrap()));
    out.extend(sds(s.crlb.as_ref().unwrap()));
    out.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let toy = Toy::simulate(4, 150, 60, 0.1, 0.5);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        all_bits(&pool.install(|| toy.solve(&Settings::default())))
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(7));
}

#[test]
fn masked_samples_count_as_absent() {
    let mut toy = Toy::simulate(5, 2, 400, 0.1, 0.0);
    // A masked tail is a shorter record, and nothing is averaged in.
    let short = Toy { z: vec![toy.z[0][..350].to_vec(), toy.z[1].clone()] };
    toy.z[0][350..].fill(f64::NAN);
    let (a, b) = (toy.solve(&Settings::default()), short.solve(&Settings::default()));
    assert_eq!(a.fit.noise[0].count, [750]);
    assert_eq!(all_bits(&a), all_bits(&b));
    toy.z[1][100..140].fill(f64::NAN);
    let c = toy.solve(&Settings::default());
    assert_eq!((c.fit.noise[0].count[0], c.fit.stop), (710, Stop::Converged));
}

#[test]
fn parameters_that_are_the_same_thing_are_named() {
    let t: Vec<f64> = (0..20).map(f64::from).collect();
    let layout = Layout::plain(2, &[1, 1], 1, vec![0.0; 4]);
    // y = (p0 + p1) t + p2 with p2 a segment's own.
    let evaluate = |_: usize, p: &[f64], _: bool| {
        let e = t.iter().map(|t| 0.1 * (t * 7.0).sin() + t - (p[0] + p[1]) * t - p[2]).collect();
        Some(vec![Block::new(0, e, t.iter().flat_map(|t| [*t, *t, 1.0]).collect())])
    };
    let s = solve(&layout, &evaluate, &Settings::default(), &Known::default());
    assert_eq!(s.fit.stop, Stop::Singular);
    assert!(s.singular && s.covariance.is_none() && s.crlb.is_none() && s.condition.is_infinite());
    let names: Vec<usize> = s.weak[0].terms.iter().map(|t| t.0).collect();
    assert_eq!((s.weak.len(), names), (1, vec![0, 1]));
    close(s.weak[0].terms[0].1, -s.weak[0].terms[1].1, 1e-6);
}

#[test]
fn a_shared_parameter_that_every_segment_can_undo_is_named_with_them() {
    let t: Vec<f64> = (0..20).map(f64::from).collect();
    let layout = Layout::plain(2, &[1, 1], 1, vec![0.0; 4]);
    let evaluate = |s: usize, p: &[f64], _: bool| {
        let e = t.iter().map(|t| (t * (7.0 + s as f64)).sin() - p[0] - p[1] * t - p[2]).collect();
        Some(vec![Block::new(0, e, t.iter().flat_map(|t| [1.0, *t, 1.0]).collect())])
    };
    let s = solve(&layout, &evaluate, &Settings::default(), &Known::default());
    assert_eq!(s.fit.stop, Stop::Singular);
    let names: Vec<usize> = s.weak[0].terms.iter().map(|t| t.0).collect();
    assert_eq!((s.weak.len(), names), (1, vec![0, 2, 3]));
}

#[test]
fn a_parameter_without_effect_is_named() {
    for (shared, own, dead) in [(2, 0, 1), (1, 1, 1)] {
        let layout = Layout::plain(shared, &[own], 1, vec![0.0; 2]);
        let evaluate = |_: usize, p: &[f64], _: bool| {
            let e = (0..20).map(|k| f64::from(k % 3) - p[0]).collect();
            Some(vec![Block::new(0, e, [1.0, 0.0].repeat(20))])
        };
        let s = solve(&layout, &evaluate, &Settings::default(), &Known::default());
        if shared == 2 {
            // Common to all: it is held, and the other one has its covariance.
            assert_eq!((s.fit.stop, &s.fit.idle[..]), (Stop::Converged, &[false, true][..]));
            assert!(s.deviation(0).is_some() && s.deviation(dead).is_none());
            continue;
        }
        assert_eq!((s.fit.stop, s.weak.len()), (Stop::Singular, 1));
        assert_eq!(s.weak[0].terms, [(dead, 1.0)]);
    }
}

/// `y = ln(p) t`: the full step from far above jumps below zero, where the model is not finite.
fn logarithm(start: f64, truth: f64, step_control: StepControl) -> Solution {
    let t: Vec<f64> = (1..40).map(f64::from).collect();
    let mut rng = rng(6);
    let z: Vec<f64> = t.iter().map(|t| truth.ln() * t + 0.01 * normal(&mut rng)).collect();
    let evaluate = move |_: usize, p: &[f64], _: bool| {
        (p[0] > 0.0).then(|| {
            let e = t.iter().zip(&z).map(|(t, z)| z - p[0].ln() * t).collect();
            vec![Block::new(0, e, t.iter().map(|t| t / p[0]).collect())]
        })
    };
    solve(
        &Layout::plain(1, &[0], 1, vec![start]),
        &evaluate,
        &Settings { step_control, ..Settings::default() },
        &Known::default(),
    )
}

#[test]
fn a_model_that_is_not_finite_is_met_by_shorter_steps() {
    for control in [StepControl::Halving, StepControl::LevenbergMarquardt] {
        let s = logarithm(8.0, 1.5, control);
        assert_eq!(s.fit.stop, Stop::Converged);
        assert!(s.fit.iterations[1].halvings > 0);
        close(s.fit.theta[0], 1.5, 1e-3);
        let at_start = logarithm(-1.0, 1.5, control);
        assert_eq!(at_start.fit.stop, Stop::NotFinite);
        assert!(at_start.covariance.is_none());
    }
}

/// A gradient that is asked to be small is small at the end, though change and step ask for
/// nothing.
#[test]
fn the_gradient_alone_can_decide() {
    let toy = Toy::simulate(12, 2, 300, 0.1, 0.0);
    for (gradient_tolerance, most) in [(1e-2, 1e-2), (1e-8, 1e-8)] {
        let s = toy.solve(&Settings {
            tolerance: 10.0,
            step_tolerance: 0.0,
            gradient_tolerance,
            ..Settings::default()
        });
        let last = s.fit.iterations.last().unwrap().gradient;
        assert_eq!(s.fit.stop, Stop::Converged);
        assert!(last <= most && s.fit.iterations[0].gradient > 1.0, "{:?}", s.fit.iterations);
    }
}

#[test]
fn iteration_limit_and_no_data_say_so() {
    let toy = Toy::simulate(7, 1, 200, 0.1, 0.0);
    let s = toy.solve(&Settings { max_iterations: 1, ..Settings::default() });
    assert_eq!((s.fit.stop, s.fit.iterations.len()), (Stop::IterationLimit, 2));
    assert!(s.covariance.is_none());
    let blind = Toy { z: vec![vec![f64::NAN; 50]] };
    assert_eq!(blind.solve(&Settings::default()).fit.stop, Stop::NoData);
}

#[test]
fn a_wrong_gradient_ends_as_no_improvement() {
    let evaluate = |_: usize, p: &[f64], _: bool| {
        let e = (0..20).map(|k| f64::from(k % 3) - p[0]).collect();
        Some(vec![Block::new(0, e, vec![-1.0; 20])])
    };
    let s = solve(
        &Layout::plain(1, &[0], 1, vec![5.0]),
        &evaluate,
        &Settings::default(),
        &Known::default(),
    );
    assert_eq!(s.fit.stop, Stop::NoImprovement);
}

/// The model is `|p|` of its parameter: the data lie below it, and the best fit is at the kink,
/// where no step is good.
#[test]
fn the_bottom_of_a_kink_is_converged() {
    for start in [1.0, 3e-4, -0.7] {
        let evaluate = |_: usize, p: &[f64], _: bool| {
            let e = (0..20).map(|k| -2.0 + 0.1 * f64::from(k % 3) - p[0].abs()).collect();
            let slope = if p[0] < 0.0 { -1.0 } else { 1.0 };
            Some(vec![Block::new(0, e, vec![slope; 20])])
        };
        for control in [StepControl::Halving, StepControl::LevenbergMarquardt] {
            let settings = Settings { step_control: control, ..Settings::default() };
            let s = solve(
                &Layout::plain(1, &[0], 1, vec![start]),
                &evaluate,
                &settings,
                &Known::default(),
            );
            assert_eq!(s.fit.stop, Stop::Converged, "{start} {:?}", s.fit.iterations);
            assert!(s.fit.theta[0].abs() < 1e-6, "{:?}", s.fit.theta);
        }
    }
}

#[test]
fn data_without_noise_converge() {
    let (z, _) = toy_response(300, &[0.95, 0.1, 0.3]);
    let s = Toy { z: vec![z] }.solve(&Settings::default());
    assert_eq!(s.fit.stop, Stop::Converged);
    close(s.fit.theta[0], 0.95, 1e-9);
    assert!(sds(s.covariance.as_ref().unwrap()).iter().all(|sd| *sd < 1e-9));
}

/// A line whose slope may not exceed `upper`.
fn bounded(start: [f64; 2], upper: f64, step_control: StepControl) -> Solution {
    let mut rng = rng(8);
    let t: Vec<f64> = (0..50).map(|k| k as f64 * 0.1).collect();
    let z: Vec<f64> = t.iter().map(|t| 2.0 + t + 0.1 * normal(&mut rng)).collect();
    let mut layout = Layout::plain(2, &[0], 1, start.to_vec());
    layout.upper[1] = upper;
    solve(
        &layout,
        &|_: usize, p: &[f64], _: bool| {
            Some(lines(std::slice::from_ref(&z), std::slice::from_ref(&t), p))
        },
        &Settings { step_control, ..Settings::default() },
        &Known::default(),
    )
}

#[test]
fn a_bound_holds_and_lets_go() {
    for control in [StepControl::Halving, StepControl::LevenbergMarquardt] {
        let s = bounded([0.0, 0.0], 0.5, control);
        assert_eq!(s.fit.stop, Stop::Converged);
        assert_eq!((s.fit.theta[1], s.fit.held.clone()), (0.5, vec![false, true]));
        // Given the slope, the intercept is the mean of the rest: 2 + (1 - 0.5) mean(t).
        assert!((s.fit.theta[0] - (2.0 + 0.5 * 2.45)).abs() < 0.05);
        assert_eq!(sds(s.covariance.as_ref().unwrap())[1], 0.0);
        assert!(sds(s.covariance.as_ref().unwrap())[0] > 0.0);
        let free = bounded([-9.0, 1.5], 1.5, control);
        assert_eq!((free.fit.stop, free.fit.held.clone()), (Stop::Converged, vec![false, false]));
        assert!((free.fit.theta[1] - 1.0).abs() < 0.05);
    }
}

#[test]
fn a_prior_weighs_in_with_its_information() {
    let mut rng = rng(9);
    let z: Vec<f64> = (0..2000).map(|_| 3.0 + normal(&mut rng)).collect();
    let mut layout = Layout::plain(1, &[0], 1, vec![2.0]);
    layout.prior_sd[0] = 0.02;
    let evaluate = |_: usize, p: &[f64], _: bool| {
        Some(vec![Block::new(0, z.iter().map(|z| z - p[0]).collect(), vec![1.0; z.len()])])
    };
    let s = solve(
        &layout,
        &evaluate,
        &Settings { tolerance: 1e-12, step_tolerance: 1e-9, ..Settings::default() },
        &Known::default(),
    );
    let (mean, data, prior) =
        (z.iter().sum::<f64>() / 2000.0, 2000.0 / r(&s)[0], 1.0 / (0.02 * 0.02));
    close(s.fit.theta[0], (data * mean + prior * 2.0) / (data + prior), 1e-6);
    close(sds(s.crlb.as_ref().unwrap())[0], (1.0 / (data + prior)).sqrt(), 1e-9);
}

/// With white noise the corrected variance is the bound times N/(N-p): what the fit absorbed is put
/// back.
#[test]
fn the_absorbed_degrees_of_freedom_return() {
    let mut rng = rng(10);
    let t: Vec<f64> = (0..40).map(|k| k as f64 * 0.1).collect();
    let z: Vec<f64> = t.iter().map(|t| 2.0 + t + 0.1 * normal(&mut rng)).collect();
    let layout = Layout::plain(2, &[0], 1, vec![0.0, 0.0]);
    let s = solve(
        &layout,
        &|_: usize, p: &[f64], _: bool| {
            Some(lines(std::slice::from_ref(&z), std::slice::from_ref(&t), p))
        },
        &Settings { max_ar_order: 0, ..Settings::default() },
        &Known::default(),
    );
    for (sd, crlb) in sds(s.covariance.as_ref().unwrap()).iter().zip(sds(s.crlb.as_ref().unwrap()))
    {
        close(sd / crlb, (40.0f64 / 38.0).sqrt(), 1e-3);
    }
}
