//! Made-up flights whose motion is known exactly, recorded with noise and with faults: is the path right, or is it said that it is not?

use super::smoother::tests::Normal;
use super::*;
use crate::model::{Constants, Given};

/// A recorded flight: signals by name, and the true path at the times `t`.
struct Flown {
    signals: IndexMap<String, (Vec<f64>, Vec<f64>)>,
    gust: Vec<[f64; 3]>,
}

const DURATION: f64 = 40.0;
/// Biases of the six inertial sensors.
const BIAS: [f64; 6] = [0.05, -0.03, 0.08, 0.002, -0.001, 0.0015];
/// Noise per sample: specific forces, rates.
const NOISE: [f64; 6] = [0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4];
const INERTIAL: [&str; 6] = ["ax_imu", "ay_imu", "az_imu", "p_imu", "q_imu", "r_imu"];
const OUTPUTS: [(&str, f64); 7] = [
    ("V", 0.1),
    ("alpha_vane", 1e-3),
    ("beta_vane", 1e-3),
    ("phi", 1e-3),
    ("theta", 1e-3),
    ("psi", 2e-3),
    ("static_pressure", 8.0),
];

/// Body velocities and Euler angles of the motion over ground.
fn motion(t: f64) -> [f64; 6] {
    use libm::{cos, sin};
    [
        110.0 + 4.0 * sin(0.25 * t),
        2.5 * sin(1.1 * t) + 0.5 * sin(0.3 * t),
        8.0 + 2.0 * sin(1.4 * t) + sin(0.5 * t),
        0.25 * sin(0.9 * t),
        0.07 + 0.05 * sin(0.8 * t + 0.4),
        2.9 + 0.06 * t + 0.03 * cos(0.7 * t),
    ]
}

fn climb(t: f64) -> f64 {
    let [u, v, w, phi, theta, _] = motion(t);
    use libm::{cos, sin};
    u * sin(theta) - v * sin(phi) * cos(theta) - w * cos(phi) * cos(theta)
}

/// Specific forces and rates of the motion.
fn inertial(t: f64) -> [f64; 6] {
    use libm::{cos, sin};
    let h = 1e-4;
    let (m, a, b) = (motion(t), motion(t - h), motion(t + h));
    let d: [f64; 6] = std::array::from_fn(|i| (b[i] - a[i]) / (2.0 * h));
    let [u, v, w, phi, theta, _] = m;
    let p = d[3] - d[5] * sin(theta);
    let q = d[4] * cos(phi) + d[5] * sin(phi) * cos(theta);
    let r = -d[4] * sin(phi) + d[5] * cos(phi) * cos(theta);
    let g = 9.80665;
    [
        d[0] + g * sin(theta) - r * v + q * w,
        d[1] - g * cos(theta) * sin(phi) + r * u - p * w,
        d[2] - g * cos(theta) * cos(phi) - q * u + p * v,
        p,
        q,
        r,
    ]
}

/// Altitude of the motion every millisecond.
fn altitude() -> Vec<f64> {
    let mut h = vec![3000.0];
    for k in 0..(DURATION * 1000.0) as usize {
        let t = k as f64 * 1e-3;
        h.push(h[k] + 1e-3 * climb(t + 5e-4));
    }
    h
}

/// True states u v w phi theta psi h at a time, gusts included.
fn truth(flown: &Flown, heights: &[f64], t: f64) -> [f64; 7] {
    let m = motion(t);
    let gust = flown.gust[((t * 1000.0).round() as usize).min(flown.gust.len() - 1)];
    [m[0] + gust[0], m[1] + gust[1], m[2] + gust[2], m[3], m[4], m[5], heights[(t * 1000.0).round() as usize]]
}

/// Inertial sensors at 50 Hz, vanes at 20, air data at 10, attitude at 25, each with stamps of its own; gusts of `sigma` m/s.
fn fly(seed: u64, sigma: f64, heights: &[f64]) -> Flown {
    let mut normal = Normal::new(seed);
    let count = (DURATION * 1000.0) as usize + 1;
    // a first-order gust with a time constant of 3 s
    let mut gust = vec![[0.0; 3]];
    for k in 1..count {
        let old = gust[k - 1];
        gust.push(std::array::from_fn(|i| old[i] * (1.0 - 1e-3 / 3.0) + sigma * (2e-3 / 3.0f64).sqrt() * normal.next()));
    }
    let mut flown = Flown { signals: IndexMap::new(), gust };
    let mut stamps = |rate: f64, offset: f64| -> Vec<f64> {
        let n = (DURATION * rate) as usize - 1;
        (0..n)
            .map(|k| (((k as f64 + offset) / rate * 1000.0).round() + (2.0 * normal.next()).round().clamp(-4.0, 4.0)) / 1000.0)
            .collect::<Vec<_>>()
    };
    let imu = stamps(50.0, 0.3);
    let clocks = [(stamps(10.0, 0.2), vec![0, 6]), (stamps(20.0, 0.7), vec![1, 2]), (stamps(25.0, 0.4), vec![3, 4, 5])];
    for i in 0..6 {
        let y = imu.iter().map(|&t| inertial(t)[i] + BIAS[i] + NOISE[i] * normal.next()).collect();
        flown.signals.insert(INERTIAL[i].to_string(), (imu.clone(), y));
    }
    let warm = |h: f64| 288.15 - 0.0065 * h;
    let air: Vec<f64> = clocks[0].0.iter().map(|&t| warm(heights[(t * 1000.0).round() as usize])).collect();
    flown.signals.insert("temperature".into(), (clocks[0].0.clone(), air));
    for (t, outputs) in clocks {
        for k in outputs {
            let (name, sd) = OUTPUTS[k];
            let y = t.iter().map(|&t| {
                let x = truth(&flown, heights, t);
                let y = match k {
                    0 => (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt(),
                    1 => libm::atan2(x[2], x[0]),
                    2 => libm::atan2(x[1], x[0]),
                    3..=5 => x[k],
                    _ => 101325.0 * libm::pow(warm(x[6]) / 288.15, 9.80665 / (0.0065 * 287.05287)),
                };
                y + sd * normal.next()
            });
            let y = y.collect();
            flown.signals.insert(name.to_string(), (t.clone(), y));
        }
    }
    flown
}

fn kinematics() -> Model {
    let zero = |name: &str, unit: &str| (name.to_string(), Given { value: 0.0, unit: unit.into(), sd: 0.0, source: "test".into() });
    let places = ["x_imu", "y_imu", "z_imu", "x_alpha", "y_alpha", "x_beta", "z_beta"];
    let constants = places.iter().map(|name| zero(name, "m")).chain([zero("upwash", "-")]).collect();
    Model::embedded("kinematics", &Constants(constants)).expect("compiles")
}

fn settings() -> Settings {
    Settings { by: Method::Smoother, rate_hz: 20.0, ..Default::default() }
}

fn path(flown: &Flown) -> FlightPath {
    let get = |name: &str| flown.signals.get(name).map(|(t, y)| (&t[..], &y[..]));
    reconstruct(&kinematics(), get, &settings()).unwrap_or_else(|e| panic!("{e}"))
}

const STATES: [&str; 7] = ["u", "v", "w", "phi", "theta", "psi", "h"];

/// (value - truth)/sd of every state at the grid points `keep` accepts.
fn normed(flown: &Flown, heights: &[f64], path: &FlightPath, keep: impl Fn(f64) -> bool) -> Vec<Vec<f64>> {
    let model = kinematics();
    STATES
        .iter()
        .enumerate()
        .map(|(i, name)| {
            let k = model.output(name).expect("an output");
            let at = |p: usize| {
                let e = path.outputs[k][p] - truth(flown, heights, path.t[p])[i];
                let e = if i == 5 { libm::remainder(e, 2.0 * std::f64::consts::PI) } else { e };
                e / path.sd[k][p]
            };
            (0..path.t.len()).filter(|&p| keep(path.t[p]) && path.outputs[k][p].is_finite()).map(at).collect()
        })
        .collect()
}

fn verdict<'a>(path: &'a FlightPath, channel: &str, check: &str) -> &'a str {
    path.checks.iter().find(|r| r.channel == channel && r.check == check).map_or("none", |r| r.verdict)
}

/// No state is further from the truth than `limit` of its standard deviations anywhere.
fn nowhere_wrong(flown: &Flown, heights: &[f64], path: &FlightPath, limit: f64) {
    for (name, list) in STATES.iter().zip(normed(flown, heights, path, |_| true)) {
        let worst = list.iter().fold(0.0f64, |m, e| m.max(e.abs()));
        assert!(worst < limit, "{name} is {worst} standard deviations off: {:?}", path.notes);
    }
}

fn coverage(sigma: f64) {
    let heights = altitude();
    let flights = 6;
    let mut inside = [0; 7];
    let mut all = 0;
    for seed in 0..flights {
        let flown = fly(seed + 1, sigma, &heights);
        let path = path(&flown);
        // far enough apart to be nearly independent
        let lists = normed(&flown, &heights, &path, |t| t > 1.0 && (t / 3.0).fract() < 0.0125);
        all += lists[0].len();
        for (inside, list) in inside.iter_mut().zip(&lists) {
            *inside += list.iter().filter(|e| e.abs() < 1.96).count();
        }
        for bias in &path.biases {
            let k = INERTIAL.iter().position(|n| n[..2] == bias.parameter[2..] || n[..1] == bias.parameter[2..]).expect("a bias");
            let e = (bias.value - BIAS[k]) / bias.sd.expect("an sd");
            assert!(e.abs() < 4.5, "{} {e}", bias.parameter);
        }
    }
    assert!(all >= 60, "{all}");
    for (name, n) in STATES.iter().zip(inside) {
        let share = n as f64 / all as f64;
        // 95% within what so many points can tell (three standard deviations of a binomial count)
        let slack = 3.0 * (0.95 * 0.05 / all as f64).sqrt();
        assert!((share - 0.95).abs() < slack + 0.5 / all as f64, "{name}: {share} of {all}");
    }
}

#[test]
fn recovery_intervals_of_the_states_cover_the_truth_in_calm_air() {
    coverage(0.0);
}

#[test]
fn recovery_intervals_of_the_states_cover_the_truth_in_turbulence() {
    coverage(0.8);
}

#[test]
fn a_clean_flight_is_called_good() {
    let heights = altitude();
    let path = path(&fly(11, 0.0, &heights));
    assert!(path.notes.is_empty(), "{:?}", path.notes);
    let bad: Vec<_> = path.checks.iter().filter(|r| r.check != "sensor error" && r.verdict != "good").collect();
    assert!(bad.is_empty(), "{bad:#?}");
    let signs = path.checks.iter().filter(|r| r.check == "sign").count();
    assert!(signs >= 12, "{signs} channels compared: {:#?}", path.checks.iter().filter(|r| r.check == "sign").collect::<Vec<_>>());
}

#[test]
fn fault_a_gap_of_two_seconds_is_coasted_over_and_one_of_five_has_no_path() {
    let heights = altitude();
    let mut flown = fly(12, 0.0, &heights);
    for name in INERTIAL {
        let (t, y) = &mut flown.signals[name];
        let keep: Vec<usize> = (0..t.len()).filter(|&k| !(15.0..17.0).contains(&t[k]) && !(25.0..30.0).contains(&t[k])).collect();
        (*t, *y) = (keep.iter().map(|&k| t[k]).collect(), keep.iter().map(|&k| y[k]).collect());
    }
    let path = path(&flown);
    nowhere_wrong(&flown, &heights, &path, 5.0);
    let theta = &path.outputs[kinematics().output("theta").expect("theta")];
    let known = |t: f64| theta[path.t.iter().position(|x| *x >= t).expect("on the grid")].is_finite();
    assert!(known(16.0) && !known(27.0) && known(35.0));
    assert!(path.notes.iter().any(|n| n.contains("gap")), "{:?}", path.notes);
    assert_eq!(verdict(&path, "q_imu", "gaps"), "gaps");
}

#[test]
fn fault_a_burst_of_nan_is_passed_over() {
    let heights = altitude();
    let mut flown = fly(13, 0.0, &heights);
    for name in ["q_imu", "alpha_vane", "theta"] {
        let (t, y) = &mut flown.signals[name];
        t.iter().zip(y).filter(|(t, _)| (20.0..20.7).contains(*t)).for_each(|(_, y)| *y = f64::NAN);
    }
    let path = path(&flown);
    nowhere_wrong(&flown, &heights, &path, 5.0);
    assert!(path.outputs[kinematics().output("theta").expect("theta")].iter().all(|v| v.is_finite()));
    assert_eq!(verdict(&path, "alpha_vane", "gaps"), "gaps");
}

#[test]
fn fault_a_dead_gyro_is_named_and_gives_no_path() {
    let heights = altitude();
    let mut flown = fly(14, 0.0, &heights);
    flown.signals["r_imu"].1.fill(0.001);
    let path = path(&flown);
    assert_eq!(verdict(&path, "r_imu", "standing still"), "dead");
    assert!(path.outputs.iter().flatten().all(|v| v.is_nan()));
    assert!(path.notes.iter().any(|n| n.contains("r_imu is dead")), "{:?}", path.notes);
}

#[test]
fn fault_a_gyro_that_freezes_for_ten_seconds_has_no_path_there() {
    let heights = altitude();
    let mut flown = fly(15, 0.0, &heights);
    let (t, y) = &mut flown.signals["p_imu"];
    let held = y[t.iter().position(|t| *t > 20.0).expect("a sample")];
    t.iter().zip(y).filter(|(t, _)| (20.0..30.0).contains(*t)).for_each(|(_, y)| *y = held);
    let path = path(&flown);
    assert_eq!(verdict(&path, "p_imu", "standing still"), "frozen");
    nowhere_wrong(&flown, &heights, &path, 5.0);
    let phi = &path.outputs[kinematics().output("phi").expect("phi")];
    assert!(path.t.iter().zip(phi).all(|(t, v)| !(21.0..29.0).contains(t) || v.is_nan()));
}

#[test]
fn fault_a_reversed_axis_is_named() {
    let heights = altitude();
    for name in ["p_imu", "az_imu"] {
        let mut flown = fly(16, 0.0, &heights);
        flown.signals[name].1.iter_mut().for_each(|y| *y = -*y);
        let path = path(&flown);
        assert_eq!(verdict(&path, name, "sign"), "sign reversed", "{name}: {:?}", path.notes);
        assert!(path.outputs.iter().flatten().all(|v| v.is_nan()), "{name}: a path in spite of it");
    }
    for name in ["beta_vane", "theta"] {
        let mut flown = fly(17, 0.0, &heights);
        flown.signals[name].1.iter_mut().for_each(|y| *y = -*y);
        let path = path(&flown);
        assert_eq!(verdict(&path, name, "sign"), "sign reversed", "{name}: {:?}", path.notes);
        nowhere_wrong(&flown, &heights, &path, 5.0);
    }
}

#[test]
fn fault_a_recorder_that_is_late_is_found() {
    let heights = altitude();
    let mut flown = fly(18, 0.0, &heights);
    for name in ["phi", "theta", "psi"] {
        flown.signals[name].0.iter_mut().for_each(|t| *t += 0.06);
    }
    let path = path(&flown);
    let row = path.checks.iter().find(|r| r.channel == "theta" && r.check == "time skew").expect("a row");
    assert_eq!(row.verdict, "late");
    assert!((row.value - 0.06).abs() < 0.02, "{row:?}");
}

#[test]
fn fault_a_missing_sensor_leaves_honest_intervals_or_nothing() {
    let heights = altitude();
    for missing in [&["alpha_vane"][..], &["beta_vane"], &["phi", "theta", "psi"]] {
        let mut flown = fly(19, 0.0, &heights);
        missing.iter().for_each(|name| {
            flown.signals.shift_remove(*name);
        });
        let path = path(&flown);
        nowhere_wrong(&flown, &heights, &path, 5.5);
        if missing.contains(&"psi") {
            assert!(path.notes.iter().any(|n| n.contains("no sensor determines psi")), "{:?}", path.notes);
            assert!(path.outputs[kinematics().output("psi").expect("psi")].iter().all(|v| v.is_nan()));
        }
    }
}

#[test]
fn the_same_bytes_with_any_number_of_threads() {
    let heights = altitude();
    let flown = fly(20, 0.5, &heights);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let path = pool.install(|| path(&flown));
        let bits = |lists: &[Vec<f64>]| lists.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
        (bits(&path.outputs), bits(&path.sd), path.checks.len())
    };
    let one = on(1);
    assert_eq!(on(1), one);
    assert_eq!(on(3), one);
}
