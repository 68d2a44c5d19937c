//! Past values: of inputs from the grid (cubic convolution), of delayed states from their own
//! history (cubic Hermite).

/// Value and time derivative of grid column `column` at fractional grid position `at`; constant
/// before the first and after the last point.
pub fn input(inputs: &[f64], stride: usize, column: usize, dt: f64, at: f64) -> (f64, f64) {
    let n = inputs.len() / stride.max(1);
    if n == 0 {
        return (f64::NAN, 0.0);
    }
    let u = |i: isize| inputs[i.clamp(0, n as isize - 1) as usize * stride + column];
    if at.is_nan() {
        return (f64::NAN, f64::NAN);
    }
    if at <= 0.0 {
        return (u(0), 0.0);
    }
    if at >= (n - 1) as f64 {
        return (u(n as isize - 1), 0.0);
    }
    let i = at.floor() as isize;
    let s = at - i as f64;
    let around = [u(i - 1), u(i), u(i + 1), u(i + 2)];
    let [_, c1, c2, c3] = cubic(around);
    (value(around, s), (c1 + s * (2.0 * c2 + 3.0 * s * c3)) / dt)
}

/// The same along straight lines.
pub fn on_lines(inputs: &[f64], stride: usize, column: usize, dt: f64, at: f64) -> (f64, f64) {
    let n = inputs.len() / stride.max(1);
    let u = |i: usize| inputs[i * stride + column];
    if n == 0 || at.is_nan() {
        return (f64::NAN, f64::NAN);
    }
    if at <= 0.0 {
        return (u(0), 0.0);
    }
    if at >= (n - 1) as f64 {
        return (u(n - 1), 0.0);
    }
    let i = at.floor() as usize;
    let step = u(i + 1) - u(i);
    (u(i) + at.fract() * step, step / dt)
}

/// Catmull-Rom: passes through the two in the middle, slope continuous.
fn cubic([a, b, c, d]: [f64; 4]) -> [f64; 4] {
    [b, 0.5 * (c - a), a - 2.5 * b + 2.0 * c - 0.5 * d, 0.5 * (d - a) + 1.5 * (b - c)]
}

/// The value at a fraction `s` (0 to 1) of the way between the two in the middle.
pub fn value(around: [f64; 4], s: f64) -> f64 {
    let [c0, c1, c2, c3] = cubic(around);
    c0 + s * (c1 + s * (c2 + s * c3))
}

/// How a past value is put together from the history:
/// `value = w[0] x_i + w[1] x'_i + w[2] x_j + w[3] x'_j`, its slope with `slope`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Past {
    pub i: usize,
    pub j: usize,
    pub w: [f64; 4],
    pub slope: [f64; 4],
}

/// Locates time `t` in ascending step times. `slope_known`: whether the slope at the last entry has
/// been computed already.
pub fn locate(times: &[f64], t: f64, slope_known: bool) -> Past {
    let last = times.len() - 1;
    let at_start = Past { i: 0, j: 0, w: [1.0, 0.0, 0.0, 0.0], slope: [0.0; 4] };
    if t <= times[0] {
        return at_start; // before the record a state has its start value
    }
    if t >= times[last] {
        // the unfinished step: along the slope where there is one
        let d = if slope_known { t - times[last] } else { 0.0 };
        let s = if slope_known { 1.0 } else { 0.0 };
        return Past { i: last, j: last, w: [1.0, d, 0.0, 0.0], slope: [0.0, s, 0.0, 0.0] };
    }
    if t.is_nan() {
        return Past { w: [f64::NAN; 4], ..at_start }; // a delay that is no number
    }
    let i = step_of(times, t);
    let j = i + 1;
    let h = times[j] - times[i];
    let s = (t - times[i]) / h;
    if j == last && !slope_known {
        // parabola through x_i with slope x'_i and x_j
        let w = [1.0 - s * s, h * (s - s * s), s * s, 0.0];
        return Past { i, j, w, slope: [-2.0 * s / h, 1.0 - 2.0 * s, 2.0 * s / h, 0.0] };
    }
    let (s2, s3) = (s * s, s * s * s);
    let w =
        [2.0 * s3 - 3.0 * s2 + 1.0, h * (s3 - 2.0 * s2 + s), -2.0 * s3 + 3.0 * s2, h * (s3 - s2)];
    let slope = [
        (6.0 * s2 - 6.0 * s) / h,
        3.0 * s2 - 4.0 * s + 1.0,
        (-6.0 * s2 + 6.0 * s) / h,
        3.0 * s2 - 2.0 * s,
    ];
    Past { i, j, w, slope }
}

/// The step that time `t` lies in, `times[0] < t < times[last]`: steps are mostly alike, so one looks
/// first where it would be if all were.
fn step_of(times: &[f64], t: f64) -> usize {
    let last = times.len() - 1;
    let guess = (t - times[0]) / (times[last] - times[0]) * last as f64;
    let near = (guess as usize).saturating_sub(1);
    let found =
        times[near..(near + 4).min(last + 1)].windows(2).position(|w| w[0] <= t && t < w[1]);
    found.map_or_else(|| times.partition_point(|&x| x <= t).clamp(1, last) - 1, |k| near + k)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_read_back_from_inputs() {
        let f = |t: f64| 1.0 - 2.0 * t + 0.5 * t * t;
        let column: Vec<f64> = (0..20).map(|i| f(0.1 * f64::from(i))).collect();
        let (value, slope) = input(&column, 1, 0, 0.1, 7.3);
        assert!((value - f(0.73)).abs() < 1e-12);
        assert!((slope - (-2.0 + 0.73)).abs() < 1e-10);
        assert_eq!(input(&column, 1, 0, 0.1, -3.0), (1.0, 0.0));
    }

    #[test]
    fn a_step_is_found_whether_steps_are_alike_or_not() {
        let alike: Vec<f64> = (0..50).map(|k| 0.1 * f64::from(k)).collect();
        let uneven: Vec<f64> = alike.iter().map(|t| t * t * t).collect();
        for times in [alike, uneven] {
            for k in 1..4000 {
                let t = times[49] * f64::from(k) / 4000.0;
                let want = times.partition_point(|&x| x <= t) - 1;
                assert_eq!(step_of(&times, t), want, "{t}");
            }
        }
    }

    #[test]
    fn a_cubic_is_read_back_from_history() {
        let (f, g) = (|t: f64| t * t * t - t, |t: f64| 3.0 * t * t - 1.0);
        let times = [0.0, 0.2, 0.5, 0.6];
        let value = |p: Past, w: [f64; 4]| {
            w[0] * f(times[p.i])
                + w[1] * g(times[p.i])
                + w[2] * f(times[p.j])
                + w[3] * g(times[p.j])
        };
        let p = locate(&times, 0.33, true);
        assert!((value(p, p.w) - f(0.33)).abs() < 1e-12);
        assert!((value(p, p.slope) - g(0.33)).abs() < 1e-12);
        let p = locate(&times, 0.55, false);
        assert!((value(p, p.w) - f(0.55)).abs() < 2e-4); // a parabola only
        assert_eq!(locate(&times, -1.0, true).w, [1.0, 0.0, 0.0, 0.0]);
        assert!(locate(&times[..1], f64::NAN, true).w[0].is_nan());
    }
}
