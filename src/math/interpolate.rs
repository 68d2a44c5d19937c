//! Ascending points and their values in; straight lines between them, held outside, out.

/// On the straight line from `a` (share 0) to `b` (share 1).
#[inline]
pub fn between(a: f64, b: f64, share: f64) -> f64 {
    a + share * (b - a)
}

/// Interval of `x` in ascending `points`, of which there is at least one: index of its left end,
/// fraction, and 1/width (0 outside, where the value is held).
pub fn locate(points: &[f64], x: f64) -> (usize, f64, f64) {
    let last = points.len() - 1;
    if last == 0 || x <= points[0] {
        return (0, 0.0, 0.0);
    }
    if x >= points[last] {
        return (last - 1, 1.0, 0.0);
    }
    // NaN falls through to interval 0 with a NaN fraction
    let i = points.partition_point(|&p| p <= x).clamp(1, last) - 1;
    let width = points[i + 1] - points[i];
    (i, (x - points[i]) / width, 1.0 / width)
}

/// The value at `x`; NaN where there is no point.
pub fn held(points: &[f64], values: &[f64], x: f64) -> f64 {
    if points.is_empty() {
        return f64::NAN;
    }
    let (i, share, _) = locate(points, x);
    let (left, right) = (values[i], values[(i + 1).min(values.len() - 1)]);
    if share == 1.0 { right } else { between(left, right, share) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_straight_and_ends_are_held() {
        let (t, y) = ([0.0, 1.0, 3.0], [1.0, 3.0, 3.5]);
        let all = [-1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 9.0].map(|x| held(&t, &y, x));
        assert_eq!(all, [1.0, 1.0, 2.0, 3.0, 3.25, 3.5, 3.5]);
        assert!(held(&t, &y, f64::NAN).is_nan() && held(&[], &[], 1.0).is_nan());
        assert_eq!((held(&[2.0], &[7.0], 1.0), held(&[2.0], &[7.0], 3.0)), (7.0, 7.0));
    }
}
