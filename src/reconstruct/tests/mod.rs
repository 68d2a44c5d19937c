//! Made-up flights whose motion is known exactly, recorded with noise and with faults: is the path
//! right, or is it said that it is not?

use super::smoother::tests::Normal;
use super::*;
use crate::model::{Constants, Given};
use indexmap::IndexMap;

mod fault;
mod recovery;

/// A recorded flight: signals by name, and what is true.
struct Flown {
    signals: IndexMap<String, (Vec<f64>, Vec<f64>)>,
    gust: Vec<[f64; 3]>,
    scene: Scene,
}

/// What is flown, and with which sensors.
#[derive(Clone, Copy)]
struct Scene {
    /// Body velocities over ground and Euler angles.
    motion: fn(f64) -> [f64; 6],
    /// s.
    duration: f64,
    /// Standard deviation of gusts, m/s.
    gusts: f64,
    /// Towards north and east, m/s.
    wind: [f64; 2],
    /// Where the inertial sensors are, m.
    arm: [f64; 3],
    /// Scale, bias and delay of the alpha vane.
    vane: [f64; 3],
    /// Below this airspeed the sensor shows nothing and the vanes hang, m/s.
    dead_below: f64,
}

const CALM: Scene = Scene {
    motion,
    duration: DURATION,
    gusts: 0.0,
    wind: [0.0; 2],
    arm: [0.0; 3],
    vane: [1.0, 0.0, 0.0],
    dead_below: 0.0,
};

const DURATION: f64 = 40.0;
/// Biases of the six inertial sensors.
const BIAS: [f64; 6] = [0.05, -0.03, 0.08, 0.002, -0.001, 0.0015];
/// Noise per sample: specific forces, rates.
const NOISE: [f64; 6] = [0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4];
const INERTIAL: [&str; 6] = ["ax_imu", "ay_imu", "az_imu", "p_imu", "q_imu", "r_imu"];
const OUTPUTS: [(&str, f64); 9] = [
    ("V", 0.1),
    ("alpha_vane", 1e-3),
    ("beta_vane", 1e-3),
    ("phi", 1e-3),
    ("theta", 1e-3),
    ("psi", 2e-3),
    ("static_pressure", 8.0),
    ("ground_speed", 0.1),
    ("track", 1e-3),
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

fn climb(motion: fn(f64) -> [f64; 6], t: f64) -> f64 {
    let [u, v, w, phi, theta, _] = motion(t);
    use libm::{cos, sin};
    u * sin(theta) - v * sin(phi) * cos(theta) - w * cos(phi) * cos(theta)
}

/// Specific forces and rates of the motion at the centre of gravity.
fn inertial(motion: fn(f64) -> [f64; 6], t: f64) -> [f64; 6] {
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

/// The same at `arm`: rotation adds `w' x arm + w x (w x arm)`.
fn inertial_at(scene: &Scene, t: f64) -> [f64; 6] {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let mut at = inertial(scene.motion, t);
    let turn = |t: f64| -> [f64; 3] { std::array::from_fn(|i| inertial(scene.motion, t)[3 + i]) };
    let (w, a, b) = (turn(t), turn(t - 1e-3), turn(t + 1e-3));
    let slope = std::array::from_fn(|i| (b[i] - a[i]) / 2e-3);
    let (one, two) = (cross(slope, scene.arm), cross(w, cross(w, scene.arm)));
    (0..3).for_each(|i| at[i] += one[i] + two[i]);
    at
}

/// Altitude of the motion every millisecond.
fn heights(scene: &Scene) -> Vec<f64> {
    let mut h = vec![3000.0];
    for k in 0..(scene.duration * 1000.0) as usize {
        let t = k as f64 * 1e-3;
        h.push(h[k] + 1e-3 * climb(scene.motion, t + 5e-4));
    }
    h
}

fn altitude() -> Vec<f64> {
    heights(&CALM)
}

/// True states u v w phi theta psi h at a time, wind and gusts included.
fn truth(flown: &Flown, heights: &[f64], t: f64) -> [f64; 7] {
    use libm::{cos, sin};
    let m = (flown.scene.motion)(t);
    let gust = flown.gust[((t * 1000.0).round() as usize).min(flown.gust.len() - 1)];
    let ([n, e], [phi, theta, psi]) = (flown.scene.wind, [m[3], m[4], m[5]]);
    let along = n * cos(psi) + e * sin(psi);
    let across = e * cos(psi) - n * sin(psi);
    let wind = [
        cos(theta) * along,
        sin(phi) * sin(theta) * along + cos(phi) * across,
        cos(phi) * sin(theta) * along - sin(phi) * across,
    ];
    let air = |i: usize| m[i] - wind[i] + gust[i];
    [
        air(0),
        air(1),
        air(2),
        phi,
        theta,
        psi,
        heights[((t * 1000.0).round().max(0.0) as usize).min(heights.len() - 1)],
    ]
}

/// A flight with gusts of `sigma` m/s and sensors without faults.
fn fly(seed: u64, sigma: f64, heights: &[f64]) -> Flown {
    record(seed, Scene { gusts: sigma, ..CALM }, heights)
}

/// Inertial sensors at 50 Hz, vanes at 20, air data and the motion over ground at 10, attitude at
/// 25, each with stamps of its own.
fn record(seed: u64, scene: Scene, heights: &[f64]) -> Flown {
    let mut normal = Normal::new(seed);
    let count = (scene.duration * 1000.0) as usize + 1;
    // a first-order gust with a time constant of 3 s
    let mut gust = vec![[0.0; 3]];
    for k in 1..count {
        let old = gust[k - 1];
        gust.push(std::array::from_fn(|i| {
            old[i] * (1.0 - 1e-3 / 3.0) + scene.gusts * (2e-3 / 3.0f64).sqrt() * normal.next()
        }));
    }
    let mut flown = Flown { signals: IndexMap::new(), gust, scene };
    let mut stamps = |rate: f64, offset: f64| -> Vec<f64> {
        let n = (scene.duration * rate) as usize - 1;
        (0..n)
            .map(|k| {
                (((k as f64 + offset) / rate * 1000.0).round()
                    + (2.0 * normal.next()).round().clamp(-4.0, 4.0))
                    / 1000.0
            })
            .collect::<Vec<_>>()
    };
    let imu = stamps(50.0, 0.3);
    let clocks = [
        (stamps(10.0, 0.2), vec![0, 6, 7, 8]),
        (stamps(20.0, 0.7), vec![1, 2]),
        (stamps(25.0, 0.4), vec![3, 4, 5]),
    ];
    for i in 0..6 {
        let y = imu
            .iter()
            .map(|&t| inertial_at(&scene, t)[i] + BIAS[i] + NOISE[i] * normal.next())
            .collect();
        flown.signals.insert(INERTIAL[i].to_string(), (imu.clone(), y));
    }
    let warm = |h: f64| 288.15 - 0.0065 * h;
    let air: Vec<f64> =
        clocks[0].0.iter().map(|&t| warm(heights[(t * 1000.0).round() as usize])).collect();
    flown.signals.insert("temperature".into(), (clocks[0].0.clone(), air));
    for (t, outputs) in clocks {
        for k in outputs {
            let (name, sd) = OUTPUTS[k];
            let y = t.iter().map(|&t| {
                let late = if k == 1 { scene.vane[2] } else { 0.0 };
                let x = truth(&flown, heights, (t - late).max(0.0));
                let m = (scene.motion)(t);
                let over = Flown {
                    gust: vec![[0.0; 3]],
                    scene: Scene { wind: [0.0; 2], ..scene },
                    signals: IndexMap::new(),
                };
                let ground = truth(&over, heights, t);
                let north = earth(&ground, m[5]);
                let speed = (x[0] * x[0] + x[1] * x[1] + x[2] * x[2]).sqrt();
                let hangs = speed < scene.dead_below;
                let y = match k {
                    0 if hangs => 0.0,
                    1 if hangs => 0.6,
                    2 if hangs => -0.3,
                    0 => speed,
                    1 => scene.vane[0] * libm::atan2(x[2], x[0]) + scene.vane[1],
                    2 => libm::atan2(x[1], x[0]),
                    3..=5 => x[k],
                    6 => 101325.0 * libm::pow(warm(x[6]) / 288.15, 9.80665 / (0.0065 * 287.05287)),
                    7 => north[0].hypot(north[1]),
                    _ => libm::atan2(north[1], north[0]),
                };
                y + sd * normal.next()
            });
            let y = y.collect();
            flown.signals.insert(name.to_string(), (t.clone(), y));
        }
    }
    flown
}

/// Velocities towards north and east of the motion over ground.
fn earth(x: &[f64; 7], psi: f64) -> [f64; 2] {
    use libm::{cos, sin};
    let [u, v, w, phi, theta, ..] = *x;
    let along = cos(theta) * u + sin(theta) * (sin(phi) * v + cos(phi) * w);
    let across = cos(phi) * v - sin(phi) * w;
    [cos(psi) * along - sin(psi) * across, sin(psi) * along + cos(psi) * across]
}

fn kinematics() -> Model {
    embedded("kinematics")
}

pub(super) fn embedded(name: &str) -> Model {
    Model::embedded(name, &all_at_the_origin()).expect("compiles")
}

/// A model file put together from fragments.
pub(super) fn from_fragments(name: &str, text: &str) -> Model {
    Model::parse(name, text, &all_at_the_origin()).unwrap_or_else(|e| panic!("{e}"))
}

/// Where the sensors are.
fn all_at_the_origin() -> Constants {
    let zero = |name: &str, unit: &str| {
        (
            name.to_string(),
            Given { value: 0.0, unit: unit.into(), sd: 0.0, source: "test".into(), origin: None },
        )
    };
    let places = ["x_imu", "y_imu", "z_imu", "x_alpha", "y_alpha", "x_beta", "z_beta"];
    Constants(places.iter().map(|name| zero(name, "m")).chain([zero("upwash", "-")]).collect())
}

fn settings() -> Settings {
    Settings { by: Method::Smoother, rate_hz: 20.0, ..Default::default() }
}

fn path(flown: &Flown) -> FlightPath {
    path_by(flown, &kinematics(), &settings())
}

fn path_by(flown: &Flown, model: &Model, settings: &Settings) -> FlightPath {
    let get = |name: &str| flown.signals.get(name).map(|(t, y)| (&t[..], &y[..]));
    reconstruct(model, get, settings).unwrap_or_else(|e| panic!("{e}"))
}

const STATES: [&str; 7] = ["u", "v_body", "w", "phi", "theta", "psi", "h"];

/// (value - truth)/sd of every state at the grid points `keep` accepts.
fn normed(
    flown: &Flown,
    heights: &[f64],
    path: &FlightPath,
    keep: impl Fn(f64) -> bool,
) -> Vec<Vec<f64>> {
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
            (0..path.t.len())
                .filter(|&p| keep(path.t[p]) && path.outputs[k][p].is_finite())
                .map(at)
                .collect()
        })
        .collect()
}

fn verdict<'a>(path: &'a FlightPath, channel: &str, check: &str) -> &'a str {
    path.checks
        .iter()
        .find(|r| r.channel == channel && r.check == check)
        .map_or("none", |r| r.verdict)
}

/// No state is further from the truth than `limit` of its standard deviations anywhere.
fn nowhere_wrong(flown: &Flown, heights: &[f64], path: &FlightPath, limit: f64) {
    for (name, list) in STATES.iter().zip(normed(flown, heights, path, |_| true)) {
        let worst = list.iter().fold(0.0f64, |m, e| m.max(e.abs()));
        assert!(worst < limit, "{name} is {worst} standard deviations off: {:?}", path.notes);
    }
}

#[test]
fn the_same_bytes_with_any_number_of_threads() {
    let heights = altitude();
    let flown = fly(20, 0.5, &heights);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let path = pool.install(|| path(&flown));
        let bits =
            |lists: &[Vec<f64>]| lists.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
        (bits(&path.outputs), bits(&path.sd), path.checks.len())
    };
    let one = on(1);
    assert_eq!(on(1), one);
    assert_eq!(on(3), one);
}
