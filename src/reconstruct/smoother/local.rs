//! Samples at their own stamps in; local cubics through them, and how noisy the samples are, out.

use crate::math::median;

/// Values and slopes at the stamps, and the share of the samples' noise variance that is left in
/// them.
#[derive(Debug, Clone, Default)]
pub struct Smooth {
    pub value: Vec<f64>,
    pub slope: Vec<f64>,
    pub gain: [f64; 2],
}

/// The least-squares cubic through the `half` samples on either side of every sample, at that
/// sample; at the ends and beside gaps longer than `gap` the window is shifted inwards, and where
/// fewer than five samples are together the sample itself is kept with the slope of its neighbours.
/// The basis is orthonormal on the window's own stamps, so jitter does no harm.
pub fn cubic(t: &[f64], y: &[f64], half: usize, gap: f64) -> Smooth {
    let n = t.len();
    let mut out = Smooth { value: y.to_vec(), slope: vec![0.0; n], gain: [1.0, 0.0] };
    let mut basis = Vec::new();
    let mut begin = 0;
    while begin < n {
        let end = (begin + 1..n).find(|&k| t[k] - t[k - 1] > gap).unwrap_or(n);
        for i in begin..end {
            let from =
                i.saturating_sub(half).max(begin).min(end.saturating_sub(2 * half + 1).max(begin));
            let to = (from + 2 * half + 1).min(end);
            if to - from >= 5 {
                let (value, slope, gain) = fit(&t[from..to], &y[from..to], i - from, &mut basis);
                (out.value[i], out.slope[i]) = (value, slope);
                if i == n / 2 {
                    out.gain = gain;
                }
            } else if to - from >= 2 {
                let k = i.min(to - 2);
                out.slope[i] = (y[k + 1] - y[k]) / (t[k + 1] - t[k]);
            }
        }
        begin = end;
    }
    out
}

/// Value, slope and noise gains of the cubic through a window at its sample `at`.
fn fit(t: &[f64], y: &[f64], at: usize, basis: &mut Vec<f64>) -> (f64, f64, [f64; 2]) {
    let n = t.len();
    let scale = 2.0 / (t[n - 1] - t[0]);
    basis.clear();
    basis.resize(4 * n, 0.0);
    let mut derived = [0.0; 4];
    let base = y[at];
    let (mut value, mut slope, mut gain) = (base, 0.0, [0.0; 2]);
    for k in 0..4 {
        let (lower, rest) = basis.split_at_mut(k * n);
        let p = &mut rest[..n];
        for (p, t0) in p.iter_mut().zip(t) {
            let x = (t0 - t[at]) * scale;
            *p = [1.0, x, x * x, x * x * x][k];
        }
        derived[k] = if k == 1 { scale } else { 0.0 };
        for j in 0..k {
            let q = &lower[j * n..(j + 1) * n];
            let share: f64 = p.iter().zip(q).map(|(a, b)| a * b).sum();
            p.iter_mut().zip(q).for_each(|(a, b)| *a -= share * b);
            derived[k] -= share * derived[j];
        }
        let norm = p.iter().map(|v| v * v).sum::<f64>().sqrt();
        p.iter_mut().for_each(|v| *v /= norm);
        derived[k] /= norm;
        // differences from the sample: a constant passes exactly
        let sum: f64 = p.iter().zip(y).map(|(p, y)| p * (y - base)).sum();
        value += p[at] * sum;
        slope += derived[k] * sum;
        gain[0] += p[at] * p[at];
        gain[1] += derived[k] * derived[k];
    }
    (value, slope, gain)
}

/// How far a signal strays from its median: robust standard deviation.
pub fn spread(y: &[f64]) -> f64 {
    if y.is_empty() {
        return 0.0;
    }
    let middle = median(y);
    let mean_square = y.iter().map(|v| (v - middle) * (v - middle)).sum::<f64>() / y.len() as f64;
    mean_square.sqrt()
}

/// Angles without jumps of a whole turn.
pub fn unwrap(z: &[f64]) -> Vec<f64> {
    let turn = 2.0 * std::f64::consts::PI;
    let (mut shift, mut last) = (0.0, f64::NAN);
    z.iter()
        .map(|&x| {
            if !x.is_finite() {
                return x;
            }
            if last.is_finite() {
                shift -= turn * ((x + shift - last) / turn).round();
            }
            last = x + shift;
            last
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_passes_and_its_slope_is_right_at_jittered_stamps() {
        let t: Vec<f64> = (0..60).map(|k| 0.01 * k as f64 + 1e-3 * libm::sin(k as f64)).collect();
        let f = |t: f64| 1.0 - 2.0 * t + 3.0 * t * t - 4.0 * t * t * t;
        let y: Vec<f64> = t.iter().map(|&t| f(t)).collect();
        let s = cubic(&t, &y, 5, 1.0);
        for (k, &t) in t.iter().enumerate() {
            assert!((s.value[k] - f(t)).abs() < 1e-12);
            assert!((s.slope[k] - (-2.0 + 6.0 * t - 12.0 * t * t)).abs() < 1e-9);
        }
    }

    #[test]
    fn angles_are_unwrapped() {
        let z = [3.0, 3.1, -3.1, -3.0, f64::NAN, 3.1];
        let u = unwrap(&z);
        assert!(
            u.windows(2)
                .all(|w| !(w[0].is_finite() && w[1].is_finite()) || (w[1] - w[0]).abs() < 0.3),
            "{u:?}"
        );
        assert!((u[5] - 3.1).abs() < 1e-12);
    }
}
