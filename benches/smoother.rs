//! The smoother's speed: a made-up flight of two hours with inertial sensors at 100 Hz in; seconds
//! on one thread and peak memory of the whole reconstruction (signs, noise levels, path with
//! standard deviations, checks) out. `cargo bench --bench smoother -- [minutes] [errors]`; with
//! `errors` the vanes' delays, scales and biases are estimated as well.
//!
//! Held against: at most 20 s on one thread, sensor errors or not, and memory that grows beyond the
//! logs and the results with the square root of the length.

use koehler::model::{Constants, Given, Model};
use koehler::reconstruct::{Method, Settings, reconstruct};
use std::collections::BTreeMap;
use std::time::Instant;

fn main() {
    let minutes = std::env::args().skip(1).find_map(|a| a.parse::<f64>().ok()).unwrap_or(120.0);
    let signals = flight(60.0 * minutes);
    let bytes: usize = signals.values().map(|(t, y)| 8 * (t.len() + y.len())).sum();
    let before = peak();
    let mut settings = Settings { by: Method::Smoother, ..Default::default() };
    if std::env::args().any(|a| a == "errors") {
        settings.late = ["alpha_vane", "beta_vane"].map(String::from).to_vec();
        settings.candidates = ["k_alpha", "b_alpha", "k_beta", "b_beta"].map(String::from).to_vec();
    }
    let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let clock = Instant::now();
    let path = threads.install(|| {
        let get = |name: &str| signals.get(name).map(|(t, y)| (&t[..], &y[..]));
        reconstruct(&kinematics(), get, &settings).unwrap_or_else(|e| panic!("{e}"))
    });
    let seconds = clock.elapsed().as_secs_f64();
    let found = path.biases.iter().find(|b| b.parameter == "b_q").expect("a bias");
    println!(
        "{minutes} min at 100 Hz: {seconds:.1} s on one thread, of 20 s for 120 min; b_q {:.2e} of 1e-3",
        found.value
    );
    let results = 8 * path.t.len() * (1 + path.outputs.len() + path.sd.len());
    let (logs, results) = (bytes as f64 / 1e6, results as f64 / 1e6);
    println!(
        "peak memory {:.0} MB above the {before:.0} MB before: logs {logs:.0} MB, results {results:.0} MB",
        peak() - before
    );
}

/// Largest resident size so far, MB.
fn peak() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("0 kB");
    line.trim().trim_end_matches("kB").trim().parse::<f64>().unwrap_or(0.0) / 1e3
}

fn kinematics() -> Model {
    let zero = |(name, unit): (&str, &str)| {
        (
            name.to_string(),
            Given {
                value: 0.0,
                unit: unit.into(),
                sd: 0.0,
                source: "made up".into(),
                origin: None,
            },
        )
    };
    let places = ["x_imu", "y_imu", "z_imu", "x_alpha", "y_alpha", "x_beta", "z_beta"]
        .map(|name| (name, "m"));
    let constants = places.into_iter().chain([("upwash", "-")]).map(zero).collect();
    Model::embedded("kinematics", &Constants(constants)).unwrap_or_else(|e| panic!("{e}"))
}

/// Gentle motion about all axes: inertial sensors at 100 Hz, all others at 50 Hz, each group with
/// stamps of its own.
fn flight(seconds: f64) -> BTreeMap<String, (Vec<f64>, Vec<f64>)> {
    let mut seed = 1u64;
    let mut noise = move || {
        let mut sum = 0.0;
        for _ in 0..12 {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            sum += (seed >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum - 6.0
    };
    let (sin, g, h) = (libm::sin, 9.80665, 1e-4);
    // u v w phi theta psi
    let motion = |t: f64| -> [f64; 6] {
        [
            110.0 + 3.0 * sin(0.25 * t),
            2.0 * sin(1.1 * t),
            8.0 + 1.5 * sin(1.4 * t),
            0.2 * sin(0.9 * t),
            0.072 + 0.04 * sin(0.8 * t),
            1.0,
        ]
    };
    let forces = |t: f64| -> [f64; 6] {
        let (m, a, b) = (motion(t), motion(t - h), motion(t + h));
        let d: [f64; 6] = std::array::from_fn(|i| (b[i] - a[i]) / (2.0 * h));
        let (s, c) = (sin, libm::cos);
        let [u, v, w, phi, theta, _] = m;
        let (p, q, r) = (d[3], d[4] * c(phi), -d[4] * s(phi));
        [
            d[0] + g * s(theta) - r * v + q * w,
            d[1] - g * c(theta) * s(phi) + r * u - p * w,
            d[2] - g * c(theta) * c(phi) - q * u + p * v,
            p,
            q,
            r,
        ]
    };
    let mut signals = BTreeMap::new();
    let stamps = |rate: f64, offset: f64| {
        (0..(seconds * rate) as usize).map(|k| (k as f64 + offset) / rate).collect::<Vec<f64>>()
    };
    let imu = stamps(100.0, 0.0);
    let inertial: Vec<[f64; 6]> = imu.iter().map(|&t| forces(t)).collect();
    for (i, name) in
        ["ax_imu", "ay_imu", "az_imu", "p_imu", "q_imu", "r_imu"].into_iter().enumerate()
    {
        let (sd, bias) = if i < 3 { (0.02, 0.03) } else { (5e-4, 1e-3) };
        signals.insert(
            name.to_string(),
            (imu.clone(), inertial.iter().map(|f| f[i] + bias + sd * noise()).collect()),
        );
    }
    // altitude by summing the climb
    let mut height = vec![5000.0];
    for k in 0..(seconds * 50.0) as usize {
        let [u, v, w, phi, theta, _] = motion((k as f64 + 0.5) / 50.0);
        let climb = u * sin(theta)
            - v * sin(phi) * libm::cos(theta)
            - w * libm::cos(phi) * libm::cos(theta);
        height.push(height[k] + climb / 50.0);
    }
    let warm = |h: f64| 288.15 - 0.0065 * h;
    let at = |t: f64| height[((t * 50.0).round() as usize).min(height.len() - 1)];
    let pressure = |t: f64| 101325.0 * libm::pow(warm(at(t)) / 288.15, g / (0.0065 * 287.05287));
    let speed = |t: f64| motion(t)[..3].iter().map(|v| v * v).sum::<f64>().sqrt();
    type Sensor<'a> = (&'a str, f64, f64, &'a dyn Fn(f64) -> f64);
    let others: [Sensor; 8] = [
        ("temperature", 0.0, 0.05, &|t| warm(at(t))),
        ("static_pressure", 0.0, 8.0, &pressure),
        ("V", 0.0, 0.1, &speed),
        ("alpha_vane", 0.6, 1e-3, &|t| libm::atan2(motion(t)[2], motion(t)[0])),
        ("beta_vane", 0.6, 1e-3, &|t| libm::atan2(motion(t)[1], motion(t)[0])),
        ("phi", 0.8, 1e-3, &|t| motion(t)[3]),
        ("theta", 0.8, 1e-3, &|t| motion(t)[4]),
        ("psi", 0.8, 2e-3, &|t| motion(t)[5]),
    ];
    for (name, offset, sd, value) in others {
        let t = stamps(50.0, offset);
        let y = t.iter().map(|&t| value(t) + sd * noise()).collect();
        signals.insert(name.to_string(), (t, y));
    }
    signals
}
