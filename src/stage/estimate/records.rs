//! One maneuver as a model sees it: the samples' grid and the signals come in, a record of inputs
//! and measured outputs goes out.

use crate::dynamics::{Channel, Record};
use crate::math::median;

/// Columns of the samples table of one flight.
pub struct Grid<'a> {
    pub t0: f64,
    pub dt: f64,
    pub n: usize,
    /// Looks up a column.
    pub column: &'a dyn Fn(&str) -> Option<&'a [f64]>,
}

/// Where the values of one input of the model come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    Column(String),
    /// Held at this value.
    Held(f64),
}

/// What measures one output of the model.
pub struct Measured<'a> {
    /// Index into the model's outputs.
    pub output: usize,
    pub t: &'a [f64],
    pub z: &'a [f64],
}

/// A stretch of flight, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    pub from: f64,
    pub to: f64,
    /// Time before `from` that only feeds delays.
    pub preroll: f64,
    /// Time before `from` (and behind the preroll) in which the model runs already and nothing is
    /// scored.
    pub settle: f64,
}

/// Why there is no record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Unusable {
    /// The window holds fewer than two samples of the grid.
    Outside,
    /// There is no such column.
    NoColumn(String),
    /// This input is masked at so many samples of the window.
    Masked { input: String, samples: usize },
}

impl std::fmt::Display for Unusable {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Unusable::Outside => write!(f, "the samples of the flight do not cover it"),
            Unusable::NoColumn(name) => {
                write!(f, "the samples of the flight have no column `{name}`")
            }
            Unusable::Masked { input, samples } => {
                write!(f, "input `{input}` has no value at {samples} samples of it")
            }
        }
    }
}

/// What lies outside a window by less than this share of a grid step counts as inside: times in
/// logs are rounded, some to five digits.
const SLACK: f64 = 1e-3;

/// Builds the record of one window: inputs on the grid, outputs at their own time stamps. The
/// window is cut to what the flight has.
///
/// # Errors
/// An input has no value somewhere in the window: a model cannot be driven by what is not there.
pub fn record(
    grid: &Grid,
    inputs: &[Source],
    measured: &[Measured],
    window: Window,
) -> Result<Record, Unusable> {
    let index = |t: f64| (t - grid.t0) / grid.dt;
    let clip = |k: f64| k.clamp(0.0, grid.n as f64) as usize;
    let first = clip((index(window.from - window.settle - window.preroll) - SLACK).ceil());
    let start = clip((index(window.from - window.settle) - SLACK).ceil());
    let begin = clip((index(window.from) - SLACK).ceil());
    let end = clip((index(window.to) + SLACK).floor() + 1.0);
    if end < begin + 2 {
        return Err(Unusable::Outside);
    }
    let n = end - first;
    let nu = inputs.len();
    let mut values = vec![0.0; n * nu];
    for (j, source) in inputs.iter().enumerate() {
        match source {
            Source::Held(value) => (0..n).for_each(|k| values[k * nu + j] = *value),
            Source::Column(name) => {
                let column = (grid.column)(name)
                    .and_then(|c| c.get(first..end))
                    .ok_or_else(|| Unusable::NoColumn(name.clone()))?;
                let samples = column.iter().filter(|v| !v.is_finite()).count();
                if samples > 0 {
                    return Err(Unusable::Masked { input: name.clone(), samples });
                }
                column.iter().enumerate().for_each(|(k, v)| values[k * nu + j] = *v);
            }
        }
    }
    let (from, to) = (grid.t0 + begin as f64 * grid.dt, grid.t0 + (end - 1) as f64 * grid.dt);
    let mut channels: Vec<Channel> =
        measured.iter().map(|m| channel(m, from, to, grid.dt)).collect();
    share_times(&mut channels);
    Ok(Record {
        t0: grid.t0 + first as f64 * grid.dt,
        dt: grid.dt,
        n,
        inputs: values.into(),
        start: start - first,
        channels,
        ..Default::default()
    })
}

/// Channels of one topic have their times in common: they hold them once.
fn share_times(channels: &mut [Channel]) {
    for k in 1..channels.len() {
        let (before, here) = channels.split_at_mut(k);
        if let Some(same) = before.iter().find(|c| c.t == here[0].t) {
            here[0].t = same.t.clone();
        }
    }
}

/// More than so many spacings between two samples of a regular channel: some between them were
/// lost.
const LOST: f64 = 1.5;
/// A channel is regular where so many of its spacings, as a share, are within that share of their
/// median. One that is sent when it changes is not.
const USUAL: f64 = 0.75;
const JITTER: f64 = 0.25;
/// Fewest spacings that tell.
const SPACINGS: usize = 4;

/// What was measured within a window. Samples that a regular channel lost are put back as masked
/// ones, so that neighbours are a spacing apart, as a model of the noise takes them to be, and
/// channels of one clock have the same samples in every window.
fn channel(m: &Measured, from: f64, to: f64, dt: f64) -> Channel {
    let (low, high) = (from - SLACK * dt, to + SLACK * dt);
    let begin = m.t.partition_point(|t| *t < low);
    let end = m.t.partition_point(|t| *t <= high).max(begin);
    let (t, z) = (&m.t[begin..end], m.z.get(begin..end).unwrap_or_default());
    let clamped = |t: f64| t.clamp(from, to);
    let Some(spacing) = spacing(t) else {
        return Channel {
            output: m.output,
            t: t.iter().map(|t| clamped(*t)).collect(),
            z: z.to_vec().into(),
        };
    };
    // The samples around the window; before the channel's first one and behind its last one as many
    // as the window holds.
    let beyond = |room: f64| spacing * ((room / spacing).floor() + 1.0);
    let before = begin.checked_sub(1).map_or_else(|| t[0] - beyond(t[0] - low), |k| m.t[k]);
    let after =
        m.t.get(end).copied().unwrap_or_else(|| t[t.len() - 1] + beyond(high - t[t.len() - 1]));
    let (mut times, mut values) = (Vec::new(), Vec::new());
    let mut last = before;
    for (next, value) in t.iter().copied().zip(z.iter().copied().map(Some)).chain([(after, None)]) {
        for lost in lost(last, next, spacing).filter(|t| (low..=high).contains(t)) {
            times.push(clamped(lost));
            values.push(f64::NAN);
        }
        times.extend(value.map(|_| clamped(next)));
        values.extend(value);
        last = next;
    }
    Channel { output: m.output, t: times.into(), z: values.into() }
}

/// Time between samples of a regular channel; none for another.
fn spacing(t: &[f64]) -> Option<f64> {
    let steps: Vec<f64> = t.windows(2).map(|w| w[1] - w[0]).collect();
    let middle = median(&steps);
    let usual = steps.iter().filter(|step| (**step - middle).abs() <= JITTER * middle).count();
    (steps.len() >= SPACINGS && middle > 0.0 && usual as f64 >= USUAL * steps.len() as f64)
        .then_some(middle)
}

/// Times of the samples lost between two others, evenly spread.
fn lost(a: f64, b: f64, spacing: f64) -> impl Iterator<Item = f64> {
    let steps = if b - a > LOST * spacing { ((b - a) / spacing).round() } else { 1.0 };
    (1..steps as usize).map(move |i| a + (b - a) * i as f64 / steps)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid<'a>(column: &'a dyn Fn(&str) -> Option<&'a [f64]>) -> Grid<'a> {
        Grid { t0: 10.0, dt: 0.1, n: 101, column }
    }

    #[test]
    fn a_model_settles_before_it_is_scored() {
        let u: Vec<f64> = (0..101).map(f64::from).collect();
        let column = |name: &str| (name == "u").then_some(&u[..]);
        let t: Vec<f64> = (0..101).map(|i| 10.0 + 0.1 * f64::from(i)).collect();
        let m = [Measured { output: 0, t: &t, z: &t }];
        let window = Window { from: 12.0, to: 13.0, preroll: 0.2, settle: 0.5 };
        let r = record(&grid(&column), &[Source::Column("u".into())], &m, window).expect("covered");
        assert_eq!((r.start, r.n, r.inputs[r.start], r.channels[0].t.len()), (2, 18, 15.0, 11));
        assert!((r.channels[0].t[0] - 12.0).abs() < 1e-9 && (r.t0 - 11.3).abs() < 1e-9);
    }

    #[test]
    fn a_window_takes_its_grid_points_and_the_samples_between_them() {
        let u: Vec<f64> = (0..101).map(f64::from).collect();
        let column = |name: &str| (name == "u").then_some(&u[..]);
        let t: Vec<f64> = (0..400).map(|i| 9.987 + 0.03 * f64::from(i)).collect();
        let m = [Measured { output: 2, t: &t, z: &t }];
        let inputs = [Source::Held(7.0), Source::Column("u".into())];
        let r = record(
            &grid(&column),
            &inputs,
            &m,
            Window { from: 12.0, to: 13.0, preroll: 0.5, settle: 0.0 },
        )
        .expect("covered");
        assert_eq!((r.n, r.start), (16, 5));
        assert!((r.t0 - 11.5).abs() < 1e-12);
        assert_eq!(&r.inputs[..4], &[7.0, 15.0, 7.0, 16.0]);
        let c = &r.channels[0];
        assert_eq!(c.output, 2);
        assert!(c.t.iter().all(|t| (12.0..=13.0).contains(t)));
        assert_eq!(c.t.len(), 33);
    }

    #[test]
    fn a_window_beyond_the_flight_is_cut_and_one_outside_is_refused() {
        let u = vec![0.0; 101];
        let column = |_: &str| Some(&u[..]);
        let inputs = [Source::Column("u".into())];
        let r = record(
            &grid(&column),
            &inputs,
            &[],
            Window { from: 19.0, to: 30.0, preroll: 0.0, settle: 0.0 },
        )
        .expect("covered");
        assert_eq!(r.n, 11);
        let none = record(
            &grid(&column),
            &inputs,
            &[],
            Window { from: 30.0, to: 40.0, preroll: 0.0, settle: 0.0 },
        );
        assert_eq!(none, Err(Unusable::Outside));
    }

    #[test]
    fn a_masked_input_is_refused_and_counted() {
        let mut u = vec![0.0; 101];
        u[50] = f64::NAN;
        u[51] = f64::NAN;
        let column = |_: &str| Some(&u[..]);
        let inputs = [Source::Column("u".into())];
        let masked = record(
            &grid(&column),
            &inputs,
            &[],
            Window { from: 14.0, to: 16.0, preroll: 0.0, settle: 0.0 },
        );
        assert_eq!(masked, Err(Unusable::Masked { input: "u".into(), samples: 2 }));
    }

    /// The channel of one measured output over 12 s to 13 s.
    fn within(t: &[f64]) -> Channel {
        let u = vec![0.0; 101];
        let column = |_: &str| Some(&u[..]);
        let m = [Measured { output: 0, t, z: t }];
        let window = Window { from: 12.0, to: 13.0, preroll: 0.0, settle: 0.0 };
        record(&grid(&column), &[Source::Column("u".into())], &m, window)
            .expect("covered")
            .channels
            .swap_remove(0)
    }

    #[test]
    fn lost_samples_of_a_regular_channel_are_masked_ones() {
        let whole: Vec<f64> = (0..400).map(|i| 9.987 + 0.03 * f64::from(i)).collect();
        // One, several, and both ends of the window.
        let gone = |t: f64| {
            (12.20..12.23).contains(&t)
                || (12.5..12.65).contains(&t)
                || t < 12.1
                || (12.9..14.0).contains(&t)
        };
        let lossy: Vec<f64> = whole.iter().copied().filter(|t| !gone(*t)).collect();
        let (want, found) = (within(&whole), within(&lossy));
        assert_eq!(found.t.len(), want.t.len());
        assert!(found.t.iter().zip(&want.t).all(|(a, b)| (a - b).abs() < 1e-9), "{:?}", found.t);
        assert!(want.z.iter().zip(&found.z).all(|(z, found)| if gone(*z) {
            found.is_nan()
        } else {
            found == z
        }));
        let kept = want.t.iter().filter(|t| !gone(**t)).count();
        assert!(
            found.z.iter().filter(|z| z.is_finite()).count() == kept && kept < want.t.len() - 10
        );
    }

    #[test]
    fn a_channel_without_lost_samples_is_as_it_is() {
        // Late by up to a third of a spacing.
        let late: Vec<f64> = (0..400)
            .map(|i| 9.987 + 0.03 * f64::from(i) + 0.01 * f64::from(i * i % 7) / 6.0)
            .collect();
        // Sent when it changed.
        let changed: Vec<f64> =
            (0..4000).filter(|i| i * i % 11 < 4).map(|i| 9.987 + 0.003 * f64::from(i)).collect();
        for t in [late, changed] {
            let want: Vec<f64> = t.iter().copied().filter(|t| (12.0..=13.0).contains(t)).collect();
            let found = within(&t);
            assert!(*found.t == *want && *found.z == *want, "{:?}", found.t);
        }
        assert!(within(&[12.1, 12.9]).t.len() == 2 && within(&[1.0]).t.is_empty());
    }
}
