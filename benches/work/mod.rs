//! The estimations that are timed: models, records and settings.

pub mod ceiling;
pub mod fused;
pub mod hand;

use koehler::dynamics::{Channel, Directions, Propagator, Record, Tier};
use koehler::estimate::{Asked, Estimation, Settings, Stop, estimate};
use koehler::model::{Constants, Model};
use std::path::{Path, PathBuf};

pub struct Work {
    pub model: Model,
    pub records: Vec<Record>,
    pub settings: Settings,
}

impl Work {
    /// An estimation of exactly `iterations` full Gauss-Newton steps.
    pub fn estimate(&self, iterations: usize, tier: Tier) {
        self.after(iterations, tier);
    }

    /// The same, and where it ended.
    pub fn after(&self, iterations: usize, tier: Tier) -> Estimation {
        let settings = Settings { max_iterations: iterations, tier, ..self.settings.clone() };
        let e =
            estimate(&self.model, &self.records, &settings).expect("settings that fit the model");
        assert_eq!(e.stop, Stop::IterationLimit, "the timed iterations must all take place");
        assert_eq!(e.iterations.len(), iterations + 1);
        assert!(e.iterations.iter().all(|i| i.halvings == 0), "a halved step is two passes");
        e
    }

    /// The whole estimation; iterations that it took.
    pub fn whole(&self, tier: Tier) -> usize {
        let settings = Settings { tier, ..self.settings.clone() };
        let e =
            estimate(&self.model, &self.records, &settings).expect("settings that fit the model");
        assert_eq!(e.stop, Stop::Converged);
        e.iterations.len() - 1
    }

    /// Directions of one segment's sensitivities.
    pub fn directions(&self) -> usize {
        self.model.parameters.len() + self.settings.initial.len()
    }

    /// Fused multiply-adds of sensitivities and sums of products in one iteration, without padding.
    pub fn multiply_adds(&self) -> f64 {
        let (nd, ny) = (self.directions(), self.model.outputs.len());
        let all: Vec<usize> = (0..self.model.parameters.len()).collect();
        let linear = self.model.linearize(&all, &(0..ny).collect::<Vec<_>>());
        let stage = linear.rates.states.len() * nd + 2 * self.model.states.len() * nd;
        let point = 4 * stage + linear.outputs.states.len() * nd + ny * (nd * (nd + 1) / 2 + nd);
        (self.samples() * point) as f64
    }

    /// Grid points of all segments.
    pub fn samples(&self) -> usize {
        self.records.iter().map(|r| r.n).sum()
    }
}

/// `KOEHLER_DATA`, or `shared/data` in this directory or one above it.
pub fn data() -> Option<PathBuf> {
    if let Ok(given) = std::env::var("KOEHLER_DATA") {
        return Some(PathBuf::from(given));
    }
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .map(|p| p.join("shared/data"))
        .find(|p| p.is_dir())
}

/// The HFB-320 record as so many equal segments; with more than one their initial states are free.
/// `None`, said aloud, without the data.
pub fn hfb320(copies: usize) -> Option<Work> {
    let Some(path) = data().map(|d| d.join("hfb320/hfb320_1_10.asc")).filter(|p| p.is_file())
    else {
        println!("HFB-320: no hfb320/hfb320_1_10.asc in KOEHLER_DATA or ../shared/data, not timed");
        return None;
    };
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/hfb320/hfb320.model.toml");
    let model = Model::load(&file, &Constants::default()).expect("the model");
    let text = std::fs::read_to_string(path).expect("the data");
    let numbers = |line: &str| {
        line.split_whitespace().map(|w| w.parse().expect("a number")).collect::<Vec<f64>>()
    };
    let rows: Vec<Vec<f64>> = text.lines().map(numbers).filter(|r| !r.is_empty()).collect();
    let dt = 0.1;
    let inputs: Vec<usize> =
        model.inputs.iter().map(|i| if i.name == "de" { 1 } else { 3 }).collect();
    let columns =
        [("V", 4), ("alpha", 5), ("theta", 6), ("q", 7), ("qdot", 8), ("ax", 9), ("az", 10)];
    let mut channels: Vec<Channel> = columns
        .iter()
        .map(|(name, c)| Channel {
            output: model.output(name).expect("an output"),
            t: (0..rows.len()).map(|k| k as f64 * dt).collect(),
            z: rows.iter().map(|r| r[*c]).collect(),
        })
        .collect();
    channels.sort_by_key(|c| c.output);
    let inputs = rows.iter().flat_map(|r| inputs.iter().map(|&c| r[c])).collect();
    let record = Record { dt, n: rows.len(), inputs, channels, substeps: 1, ..Default::default() };
    let initial = if copies > 1 {
        ["V", "alpha", "theta", "q"].map(String::from).to_vec()
    } else {
        Vec::new()
    };
    let settings = Settings { initial, tolerance: 0.0, ..Settings::default() };
    Some(Work { model, records: vec![record; copies], settings })
}

/// The same record with noise that drives angle of attack and pitch rate: a filter's work.
pub fn hfb320_filtered() -> Option<Work> {
    let work = hfb320(1)?;
    let file = include_str!("../../pipelines/hfb320/hfb320.model.toml");
    let noisy = [("alpha", "rad/s^0.5", 1e-3), ("q", "rad/s^1.5", 1e-3)];
    Some(Work { model: driven("hfb320", file, &noisy), ..work })
}

/// `six_dof` with noise that drives the three rates of rotation.
pub fn six_dof_filtered(segments: usize) -> Work {
    let noisy = ["p", "q", "r"].map(|state| (state, "rad/s^1.5", 1e-3));
    let model = driven("six_dof", include_str!("../six_dof.model.toml"), &noisy);
    Work { model, ..six_dof(segments) }
}

/// A model file with densities of noise (unit, start) on some of its states.
fn driven(name: &str, file: &str, noisy: &[(&str, &str, f64)]) -> Model {
    let densities: String = noisy
        .iter()
        .map(|(state, unit, start)| {
            format!("F_{state} = {{ unit = \"{unit}\", start = {start}, min = 0.0 }}\n")
        })
        .collect();
    let (head, states) = file.split_once("[states]").expect("states");
    let mut text =
        head.replace("[parameters]\n", &format!("[parameters]\n{densities}")) + "[states]";
    for line in states.lines() {
        let state = line.split('=').next().unwrap_or_default().trim();
        let is = noisy.iter().any(|(name, ..)| *name == state) && line.contains("rate =");
        match line.strip_suffix('}').filter(|_| is) {
            Some(start) => text.push_str(&format!("{start}, noise = \"F_{state}\" }}\n")),
            None => text.push_str(&format!("{line}\n")),
        }
    }
    Model::parse(name, &text, &Constants::default()).expect("the model")
}

/// A simulated campaign: every segment has its own inputs, length and noise, and its initial states
/// are free.
pub fn six_dof(segments: usize) -> Work {
    let settings = Settings { tolerance: 0.0, ..Settings::default() };
    simulated(segments, |s| 190 + 10 * (s % 3), 0.02, settings)
}

/// The same, of which nothing is told but where it ended: what is told takes longer than iterations.
pub fn six_dof_briefly(segments: usize) -> Work {
    let mut work = six_dof(segments);
    work.settings.asked = Asked::Nothing;
    work
}

/// One as large as those of published work: 20 maneuvers of 30 s, the parameters' starts up to a
/// fifth off.
pub fn whole_campaign() -> Work {
    simulated(20, |_| 1500, 0.2, Settings::default())
}

/// `samples` of each segment; the truth is off the starts by up to the share `off`.
fn simulated(
    segments: usize,
    samples: impl Fn(usize) -> usize,
    off: f64,
    settings: Settings,
) -> Work {
    let model =
        Model::parse("six_dof", include_str!("../six_dof.model.toml"), &Constants::default())
            .expect("the model");
    let names: Vec<String> = model.states.iter().map(|s| s.quantity.name.clone()).collect();
    let all = Directions { parameters: Vec::new(), starts: (0..names.len()).collect() };
    let propagator = Propagator::new(&model, all).expect("a propagator");
    let dt = 0.02;
    let records = (0..segments).map(|s| {
        let n = samples(s);
        let inputs = (0..n).flat_map(|k| controls(s, (k as f64 * dt) % 7.5)).collect();
        let mut record = Record { dt, n, inputs, substeps: 1, ..Default::default() };
        let truth: Vec<f64> = model
            .parameters
            .iter()
            .enumerate()
            .map(|(i, p)| p.start * (1.0 + off * hash(i, 7)))
            .collect();
        let starts = propagator.first_values(&model, &truth, &record, &record).expect("starts");
        let grid = propagator.run(&truth, &starts, &record, false);
        assert!(grid.finite);
        let ny = model.outputs.len();
        record.channels = (0..ny)
            .map(|output| {
                let sd =
                    1e-3 * (0..n).map(|k| grid.y[k * ny + output].abs()).fold(0.0, f64::max) + 1e-4;
                let z = (0..n).map(|k| {
                    grid.y[k * ny + output]
                        + sd * (hash(k, 31 * s + output) + hash(k, 31 * s + output + 1_000_003))
                });
                Channel { output, t: (0..n).map(|k| k as f64 * dt).collect(), z: z.collect() }
            })
            .collect();
        record
    });
    let records = records.collect();
    Work { model, records, settings: Settings { initial: names, ..settings } }
}

/// Steps on all controls, at other times in every segment.
fn controls(segment: usize, t: f64) -> [f64; 4] {
    let pulse = |from: f64, unit: f64| match (t - from) / unit {
        x if !(0.0..7.0).contains(&x) => 0.0,
        x if x < 3.0 || (5.0..6.0).contains(&x) => 1.0,
        _ => -1.0,
    };
    let shift = 0.2 * hash(segment, 3);
    [
        -0.005 + 0.02 * pulse(0.3 + shift, 0.15),
        0.03 * pulse(1.3 + shift, 0.2),
        0.03 * pulse(2.0 - shift, 0.2),
        6000.0 + 400.0 * pulse(0.2, 0.4 + 0.1 * shift),
    ]
}

/// A number in -1..1 that looks random and is always the same.
fn hash(a: usize, b: usize) -> f64 {
    let mut x = (a as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (b as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
    for _ in 0..3 {
        x = (x ^ (x >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}
