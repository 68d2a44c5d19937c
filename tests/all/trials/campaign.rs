//! A seed in; a small campaign of recorded maneuvers of an aircraft with something hidden in it,
//! out.

use koehler::dynamics::{Channel, Directions, Interpolation, Propagator, Record};
use koehler::estimate::{self, Segment, Settings};
use koehler::model::Model;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

use super::aircraft::Aircraft;
use super::truth::{Hidden, NOTHING, base};

/// Recorded before a maneuver and in it, s.
const BEFORE: f64 = 0.8;
const MANEUVER: f64 = 8.0;

/// What one trial is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    pub seed: u64,
    pub turbulence: bool,
    /// The size wanted, in sd of noise of the channel that shows it most.
    pub size: f64,
    pub aircraft: &'static Aircraft,
    pub rate_hz: f64,
}

impl Setting {
    fn dt(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// Samples before a maneuver.
    fn before(&self) -> usize {
        (BEFORE * self.rate_hz).round() as usize
    }

    fn points(&self) -> usize {
        ((BEFORE + MANEUVER) * self.rate_hz).round() as usize
    }

    /// The r.m.s. of its gusts, m/s.
    pub fn intensity(&self, r: &mut Pcg64) -> f64 {
        let (least, most) = self.aircraft.gusts;
        if self.turbulence { r.random_range(least..most) } else { 0.0 }
    }
}

/// A campaign and what only the judge knows.
pub struct Trial {
    pub segments: Vec<Segment>,
    pub size: f64,
    /// The channel that shows it most.
    pub channel: String,
    /// How much of it, in its own unit.
    pub amount: f64,
}

pub fn method() -> Settings {
    Settings {
        initial: ["V", "alpha", "theta", "q"].map(String::from).to_vec(),
        ..Settings::default()
    }
}

pub fn random(seed: u64, what: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(what))
}

/// The kinds of maneuvers and their airspeeds; every third of a kind is held out.
const KINDS: [&str; 4] = ["elevator", "flaps", "both", "throttle"];

fn multistep(t: f64, start: f64, unit: f64) -> f64 {
    match (t - start) / unit {
        x if x < 0.0 => 0.0,
        x if x < 3.0 => 1.0,
        x if x < 5.0 => -1.0,
        x if x < 6.0 => 1.0,
        x if x < 7.0 => -1.0,
        _ => 0.0,
    }
}

/// Inputs of one maneuver `[points][de, eta, thrust]`, smooth as surfaces move.
fn inputs(setting: &Setting, kind: usize, speed: usize) -> Vec<f64> {
    let mut r = random(setting.seed, 100 + (kind * 3 + speed) as u64);
    let Aircraft { speeds, quick, .. } = setting.aircraft;
    let (_, de, thrust) = setting.aircraft.trim(speeds[speed]);
    let small = speeds[0] * speeds[0] / (speeds[speed] * speeds[speed]);
    let size = |r: &mut Pcg64| if r.random_range(0..2) == 0 { 1.0 } else { 0.55 };
    let sign = |r: &mut Pcg64| if r.random_range(0..2) == 0 { 1.0 } else { -1.0 };
    let (a, b) = (
        0.07 * small * size(&mut r) * sign(&mut r),
        0.22 * small.sqrt() * size(&mut r) * sign(&mut r),
    );
    let (unit_a, unit_b) = (quick * r.random_range(0.4..0.7), quick * r.random_range(0.4..0.8));
    let throttle = 0.5 * sign(&mut r);
    let (mut x, mut y, mut z) = (0.0, 0.0, 0.0);
    let (dt, points) = (setting.dt(), setting.points());
    let mut out = Vec::with_capacity(points * 3);
    for k in 0..points {
        let t = (k as f64 - setting.before() as f64) * dt;
        let de_to = if kind == 1 { 0.0 } else { a * multistep(t, 0.6, unit_a) };
        let eta_to = if kind == 0 || kind == 3 { 0.0 } else { b * multistep(t, 1.1, unit_b) };
        let throttle_to = if kind == 3 && t > 1.5 && t < 5.0 { throttle } else { 0.0 };
        x += (de_to - x) * dt / (0.08 * quick);
        y += (eta_to - y) * dt / (0.10 * quick);
        z += (throttle_to - z) * dt / (0.4 * quick);
        out.extend([de + x, y, thrust * (1.0 + z)]);
    }
    out
}

/// Gusts along and normal to the flight, m/s (first-order form of Dryden's spectrum).
fn gusts(setting: &Setting, segment: usize, speed: f64, intensity: f64) -> Vec<[f64; 2]> {
    let mut r = random(setting.seed, 1000 + segment as u64);
    let keep = (-speed / setting.aircraft.gust_length * setting.dt()).exp();
    let mut now = [0, 0].map(|_: i32| intensity * r.sample::<f64, _>(StandardNormal));
    let mut step = || {
        now = now.map(|v| {
            keep * v + intensity * (1.0 - keep * keep).sqrt() * r.sample::<f64, _>(StandardNormal)
        });
        now
    };
    (0..setting.points()).map(|_| step()).collect()
}

/// Flies all maneuvers of an aircraft with something hidden in these amounts: what sensors without noise
/// show.
pub fn fly(
    model: &Model,
    amounts: &[f64],
    setting: &Setting,
    intensity: f64,
) -> Option<Vec<Segment>> {
    let (dt, points, start) = (setting.dt(), setting.points(), setting.before());
    let speeds = setting.aircraft.speeds;
    let propagator =
        Propagator::new(model, Directions { parameters: Vec::new(), starts: (0..4).collect() })
            .expect("a propagator");
    let mut segments = Vec::new();
    for kind in 0..KINDS.len() {
        for turn in 0..speeds.len() {
            let speed = (turn + kind) % speeds.len();
            let u = inputs(setting, kind, speed);
            let gust = gusts(setting, segments.len(), speeds[speed], intensity);
            let rows =
                u.chunks(3).zip(&gust).flat_map(|(u, w)| [u[0], u[1], u[2], w[0], w[1]]).collect();
            let truth = Record {
                dt,
                n: points,
                inputs: rows,
                start,
                substeps: (dt / (0.01 * setting.aircraft.quick)).ceil().max(10.0) as usize,
                interpolation: vec![Interpolation::Cubic; 5],
                ..Record::default()
            };
            let alpha = setting.aircraft.trim(speeds[speed]).0;
            let grid = propagator.run(amounts, &[speeds[speed], alpha, alpha, 0.0], &truth, false);
            if !grid.finite {
                return None;
            }
            let t: Vec<f64> = (start..points).map(|k| k as f64 * dt).collect();
            let channel = |output| Channel {
                output,
                t: t.clone().into(),
                z: grid.y.iter().skip(output).step_by(6).copied().collect(),
            };
            let channels = (0..6).map(channel).collect();
            let record = Record { inputs: u.into(), channels, substeps: 0, ..truth };
            let labels = [
                ("input".to_string(), KINDS[kind].to_string()),
                ("flight".to_string(), format!("f{turn}")),
            ];
            segments.push(Segment {
                record,
                labels: labels.into_iter().collect(),
                ..Segment::default()
            });
        }
    }
    Some(segments)
}

pub fn with_noise(mut segments: Vec<Segment>, setting: &Setting) -> Vec<Segment> {
    let mut r = random(setting.seed, 7);
    let factor: f64 = r.random_range(0.7..1.4);
    for segment in &mut segments {
        for channel in &mut segment.record.channels {
            channel.z.iter_mut().for_each(|z| {
                *z += factor
                    * setting.aircraft.noise[channel.output]
                    * r.sample::<f64, _>(StandardNormal)
            });
        }
    }
    segments
}

/// The rms that the base leaves in the outputs of held-out maneuvers, refitted on the others.
pub fn left(segments: &[Segment], aircraft: &Aircraft) -> Option<[f64; 6]> {
    let base = base(aircraft);
    let (train, held): (Vec<_>, Vec<_>) =
        segments.iter().cloned().enumerate().partition(|(i, _)| i % 3 != 2);
    let only = |of: Vec<(usize, Segment)>| of.into_iter().map(|(_, s)| s).collect::<Vec<_>>();
    let floor =
        base.outputs.iter().zip(aircraft.noise).map(|(o, sd)| (o.name.clone(), 0.3 * sd)).collect();
    let method = Settings { floor, ..method() };
    let fit = estimate::estimate_segments(&base, &only(train), &method).ok()?;
    let starts = fit
        .rows
        .iter()
        .filter(|r| r.segment.is_none())
        .map(|r| (r.name.clone(), r.value))
        .collect();
    let frozen = Settings { free: Some(Vec::new()), starts, ..method };
    let held = only(held);
    let check = estimate::estimate_segments(&base, &held, &frozen).ok()?;
    let mut sums = [(0.0, 0usize); 6];
    for trace in check.responses.iter().flatten() {
        for e in
            trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).filter(|e| e.is_finite())
        {
            sums[trace.output].0 += e * e;
            sums[trace.output].1 += 1;
        }
    }
    Some(sums.map(|(sum, n)| (sum / n.max(1) as f64).sqrt()))
}

/// A campaign with `hidden` in it, of about the size wanted.
pub fn trial(hidden: &Hidden, setting: &Setting) -> Option<Trial> {
    let mut r = random(setting.seed, 3);
    let intensity = setting.intensity(&mut r);
    let none = NOTHING.model(setting.aircraft);
    let plain = with_noise(fly(&none, &[0.0], setting, intensity)?, setting);
    let noise = left(&plain, setting.aircraft)?;
    if hidden.name == NOTHING.name {
        return Some(Trial { segments: plain, size: 0.0, channel: String::new(), amount: 0.0 });
    }
    let model = hidden.model(setting.aircraft);
    let (amount, now) = sized(hidden, setting, &noise)?;
    let segments = with_noise(fly(&model, &[amount], setting, intensity)?, setting);
    Some(Trial {
        segments,
        size: now.0,
        channel: base(setting.aircraft).outputs[now.1].name.clone(),
        amount,
    })
}

/// The amount of what is hidden that has the size wanted; the size and the output that shows it most.
/// `noise`: what the base leaves of each output with nothing hidden.
pub fn sized(hidden: &Hidden, setting: &Setting, noise: &[f64; 6]) -> Option<(f64, (f64, usize))> {
    let model = hidden.model(setting.aircraft);
    let size = |amount: f64| {
        let rms = left(&fly(&model, &[amount], setting, 0.0)?, setting.aircraft)?;
        let most = (0..6).max_by(|&a, &b| (rms[a] / noise[a]).total_cmp(&(rms[b] / noise[b])))?;
        Some((rms[most] / noise[most], most))
    };
    // The size grows with the amount, though not always in proportion: a bracket, halved in the
    // logarithm.
    let (mut low, mut high) = (0.0f64, f64::INFINITY);
    let mut amount = hidden.nominal;
    let mut now = size(amount)?;
    for _ in 0..16 {
        let ratio = setting.size / now.0.max(1e-3);
        if (0.85..1.2).contains(&ratio) {
            break;
        }
        if ratio > 1.0 {
            low = amount
        } else {
            high = amount
        }
        let guess = amount * ratio.clamp(0.3, 3.0).powf(0.9);
        amount = if guess > low && guess < high {
            guess
        } else {
            (low.max(0.1 * high) * high.min(10.0 * low)).sqrt()
        };
        now = size(amount)?;
    }
    Some((amount, now))
}
