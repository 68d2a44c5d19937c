//! A channel and what all others say of it over parts of a flight in; their comparison out.

use super::smoother::Smoother;
use super::smoother::backward::Visit;
use super::smoother::grid::Outputs;
use super::smoother::levels::Levels;
use super::smoother::tape::Tape;
use crate::math::dense;
use crate::math::interpolate::between;
use crate::noise::{Modelled, Products, Rule, burg};
use crate::signal::resample::Grid;

/// Means over this time of an input and what the others say of it, s.
const BIN: f64 = 0.2;
/// Rate at which what the others say is read, Hz.
const RATE: f64 = 50.0;
/// Correlation and scale of a part from which its delay is believed.
const SOUND: f64 = 0.9;
/// A channel the wrong way round has a scale below the negative share of its motion that is told,
/// but for this factor, which allows for noise.
const WRONG_WAY: f64 = 0.8;
/// What the others say must vary by more than this many of its standard deviations to be worth a
/// comparison.
const SIGNAL: f64 = 4.0;

/// A channel: an input or a measured output, by its place in the smoother's flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Which {
    Input(usize),
    Output(usize),
}

/// What the others say of one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    pub which: Which,
    /// Of what the trend leaves.
    pub correlation: f64,
    pub scale: [f64; 2],
    /// Delay and its standard deviation, s; NaN for inputs.
    pub delay: [f64; 2],
    /// By how much later the channel is in the later part than in the earlier one, and its standard
    /// deviation, s; NaN where they do not say.
    pub jump: [f64; 2],
    /// Root mean square of what is left, in the channel's unit, and samples.
    pub left: f64,
    pub samples: usize,
    /// The order at which the model of its noise was cut off.
    pub cut: Option<usize>,
}

/// Times, measured values, what the others say, and its slope; one per part.
pub type Pair = [Vec<f64>; 4];

/// Collects an input and its smoothed error, in means over `BIN`.
struct Bins {
    input: usize,
    from: f64,
    /// Per bin: time, weights, input, smoothed input.
    sums: Vec<[f64; 4]>,
    u: Vec<f64>,
}

impl Visit for (&mut Bins, &Smoother<'_>) {
    fn node(
        &mut self,
        tape: &Tape,
        k: usize,
        _: &[f64],
        noise: &[f64],
        _: &mut dyn FnMut(&mut Vec<f64>),
    ) {
        let (bins, smoother) = (&mut *self.0, self.1);
        let (t, h) = (tape.t[k], tape.h[k]);
        let mut slope = bins.u.clone();
        smoother.flight.inputs_at(t + 0.5 * h, &smoother.flight.locate(t), &mut bins.u, &mut slope);
        let at = ((t - bins.from) / BIN).floor().max(0.0) as usize;
        if let Some(sum) = bins.sums.get_mut(at) {
            let u = bins.u[bins.input];
            sum[0] += t * h;
            sum[1] += h;
            sum[2] += u * h;
            sum[3] += (u + noise[bins.input]) * h;
        }
    }
}

/// What was measured and what the others say, over one part; none where the others do not know.
pub fn pair(
    smoother: &Smoother,
    levels: &Levels,
    which: Which,
    part: [f64; 2],
    x: &[f64],
) -> Option<Pair> {
    let flight = smoother.flight;
    match which {
        Which::Input(input) => {
            let count = ((part[1] - part[0]) / BIN) as usize;
            let mut bins = Bins {
                input,
                from: part[0],
                sums: vec![[0.0; 4]; count],
                u: vec![0.0; flight.inputs.len()],
            };
            let smoothed = smoother.run(levels, part, x, &mut (), &mut (&mut bins, smoother));
            // the first second still looks for the state
            let good: Vec<&[f64; 4]> =
                bins.sums.iter().skip(5).filter(|s| s[1] > 0.5 * BIN).collect();
            let mean = |k: usize| good.iter().map(|s| s[k] / s[1]).collect::<Vec<f64>>();
            (smoothed.finite && good.len() > 20).then(|| [mean(0), mean(2), mean(3), Vec::new()])
        }
        Which::Output(number) => {
            let dt = 1.0 / RATE;
            let grid = Grid::covering((part[0] / dt).ceil() * dt, part[1], dt);
            let outputs = smoother.kinematics.model.outputs.len();
            let mut out = Outputs::empty(outputs, smoother.kinematics.size(), grid.n);
            let smoothed = smoother.path(None, levels, part, x, (grid, 10), &mut (), &mut out);
            if !smoothed.finite {
                return None;
            }
            let k = flight.channels[number].output;
            let y = super::smoother::unwrap(&out.value[k]);
            let packet = flight.packets.iter().find(|p| p.channels.contains(&number))?;
            let z = super::smoother::unwrap(&flight.channels[number].z);
            let mut all: Pair = Default::default();
            for (&t, &z) in packet.t.iter().zip(&z) {
                let at = (t - grid.t0) / dt;
                if !(z.is_finite() && at >= 2.0 && at < grid.n as f64 - 3.0) {
                    continue;
                }
                let i = at as usize;
                let w = at - i as f64;
                let slope = |i: usize| (y[i + 2] - y[i - 2]) / (4.0 * dt);
                let values = [t, z, between(y[i], y[i + 1], w), between(slope(i), slope(i + 1), w)];
                all.iter_mut().zip(values).for_each(|(list, value)| list.push(value));
            }
            (all[0].len() > 20).then_some(all)
        }
    }
}

/// By how much later the channel is in the second part than in the first.
pub fn jump(which: Which, pairs: &[Pair]) -> [f64; 2] {
    // only where the part by itself tells the channel well
    let sound = |c: &Comparison| c.correlation > SOUND && (c.scale[0] - 1.0).abs() < 1.0 - SOUND;
    let delay =
        |pair: &Pair| regress(which, std::slice::from_ref(pair)).filter(sound).map(|c| c.delay);
    match pairs {
        [first, second] => match (delay(first), delay(second)) {
            (Some(a), Some(b)) => [b[0] - a[0], libm::hypot(a[1], b[1])],
            _ => [f64::NAN; 2],
        },
        _ => [f64::NAN; 2],
    }
}

/// Least squares over the parts; none where there is nothing to compare.
pub fn regress(which: Which, pairs: &[Pair]) -> Option<Comparison> {
    let shared = if matches!(which, Which::Output(_)) { 2 } else { 1 };
    let size = shared + 2 * pairs.len();
    let mut rows: Vec<(Vec<f64>, f64)> = Vec::new();
    for (number, [t, z, y, slope]) in pairs.iter().enumerate() {
        let (t0, span) = (t[0], t[t.len() - 1] - t[0]);
        let (y0, z0) =
            (y.iter().sum::<f64>() / y.len() as f64, z.iter().sum::<f64>() / z.len() as f64);
        for k in 0..t.len() {
            let mut row = vec![0.0; size];
            row[0] = y[k] - y0;
            if shared == 2 {
                row[1] = -slope[k];
            }
            row[shared + 2 * number] = 1.0;
            row[shared + 2 * number + 1] = (t[k] - t0) / span;
            rows.push((row, z[k] - z0));
        }
    }
    let fit = |columns: &[usize]| -> Option<(Vec<f64>, Vec<f64>, Vec<f64>)> {
        let n = columns.len();
        let (mut gram, mut right) = (vec![0.0; n * n], vec![0.0; n]);
        for (row, z) in &rows {
            for (i, &a) in columns.iter().enumerate() {
                right[i] += row[a] * z;
                for (j, &b) in columns.iter().enumerate() {
                    gram[i * n + j] += row[a] * row[b];
                }
            }
        }
        let factor = dense::cholesky(&gram, n).ok()?;
        dense::cholesky_solve(&factor, n, &mut right);
        let residuals = rows
            .iter()
            .map(|(row, z)| z - columns.iter().zip(&right).map(|(&c, x)| row[c] * x).sum::<f64>())
            .collect();
        Some((right, dense::cholesky_inverse(&factor, n), residuals))
    };
    let trend: Vec<usize> = (shared..size).collect();
    let (_, _, without) = fit(&trend)?;
    let (x, inverse, left) = fit(&(0..size).collect::<Vec<_>>())?;
    let square = |list: &[f64]| list.iter().map(|e| e * e).sum::<f64>();
    let n = left.len();
    let r = square(&left) / (n.checked_sub(size)?.max(1)) as f64;
    let modelled = modelled(&left, &pairs.iter().map(|p| p[0].len()).collect::<Vec<_>>());
    let sd = |i: usize| (inverse[i * size + i] * r * modelled.model.colour().max(1.0)).sqrt();
    let (only, ..) = fit(&[&[0], &trend[..]].concat())?;
    let share = 1.0 - square(&left) / square(&without).max(1e-300);
    let scale = [x[0], sd(0)];
    // What is left of the trend may be explained by the delay alone; that says nothing of the sign.
    let told = x[0].abs() > SIGNAL * sd(0) || (share > 0.5 && x[0] > 0.0 && only[0] > 0.0);
    // Where the others say s + d of a channel that does -s, k = -s^2/(s^2 + d^2) and the square of
    // the correlation is at most -k. A negative k nearer to zero is the drift d alone.
    let worth = told && !(only[0] < 0.0 && x[0] > -WRONG_WAY * share);
    worth.then(|| Comparison {
        which,
        correlation: only[0].signum() * share.max(0.0).sqrt(),
        scale,
        delay: if shared == 2 { [x[1] / x[0], sd(1) / x[0].abs()] } else { [f64::NAN; 2] },
        jump: [f64::NAN; 2],
        left: (square(&left) / n as f64).sqrt(),
        samples: n,
        cut: modelled.cut,
    })
}

/// The noise of all `parts`. By its `colour`, power at frequency zero over that of white noise of the
/// same size, coloured errors widen the variance of what is slow.
pub fn modelled(errors: &[f64], parts: &[usize]) -> Modelled {
    let rule = Rule::default();
    let mut products = Products::new(rule.highest);
    let mut from = 0;
    for &n in parts {
        products.take(&errors[from..from + n]);
        from += n;
    }
    burg::fit(&products, rule.criterion)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A channel that does `z` while the others say `y`.
    fn told(z: impl Fn(f64) -> f64, y: impl Fn(f64) -> f64) -> Option<Comparison> {
        let t: Vec<f64> = (0..400).map(|k| 0.05 * f64::from(k)).collect();
        let noise = |t: f64| 0.05 * libm::sin(97.0 * t * t);
        let slope = |t: f64| (y(t + 0.01) - y(t - 0.01)) / 0.02;
        let of = |f: &dyn Fn(f64) -> f64| t.iter().map(|t| f(*t)).collect::<Vec<f64>>();
        let pair = [t.clone(), of(&|t| z(t) + noise(t)), of(&y), of(&slope)];
        regress(Which::Output(0), &[pair])
    }

    #[test]
    fn a_drift_of_what_the_others_say_is_no_reversed_sign() {
        let s = |t: f64| libm::sin(0.9 * t);
        assert!(told(|t| -s(t), s).expect("a comparison").reversed());
        assert!(!told(s, s).expect("a comparison").reversed());
        // What the others say drifts against the motion, by four times of it.
        assert_eq!(told(s, |t| -3.0 * s(t)), None);
    }
}
