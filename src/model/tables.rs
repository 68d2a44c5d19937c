//! Tables of a model: linear interpolation in one or two arguments, held constant outside the break
//! points.

use crate::math::interpolate::locate;

/// One table: break points ascending, values row by row (`y[i * x2.len() + j]` with two arguments).
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    pub x: Vec<f64>,
    /// Break points of the second argument; empty for a table of one argument.
    pub x2: Vec<f64>,
    pub y: Vec<f64>,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tables(pub Vec<Table>);

impl Tables {
    /// Value (or slope) of table number `k` at x.
    pub fn one(&self, k: f64, x: f64, slope: bool) -> f64 {
        let t = &self.0[k as usize];
        let (i, f, r) = locate(&t.x, x);
        let (y0, y1) = (t.y[i], t.y[(i + 1).min(t.y.len() - 1)]);
        if slope { (y1 - y0) * r } else { y0 + f * (y1 - y0) }
    }

    /// Value and both partial slopes of table number `k` at (x, x2).
    pub fn two(&self, k: f64, x: f64, x2: f64) -> [f64; 3] {
        let t = &self.0[k as usize];
        let ((i, f, r), (j, g, s)) = (locate(&t.x, x), locate(&t.x2, x2));
        let (i1, j1) = ((i + 1).min(t.x.len() - 1), (j + 1).min(t.x2.len() - 1));
        let y = |i: usize, j: usize| t.y[i * t.x2.len() + j];
        let (low, high) =
            (y(i, j) + g * (y(i, j1) - y(i, j)), y(i1, j) + g * (y(i1, j1) - y(i1, j)));
        let (left, right) =
            (y(i, j) + f * (y(i1, j) - y(i, j)), y(i, j1) + f * (y(i1, j1) - y(i, j1)));
        [low + f * (high - low), (high - low) * r, (right - left) * s]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_interpolate_and_hold() {
        let one = Table { x: vec![0.0, 1.0, 3.0], x2: vec![], y: vec![1.0, 3.0, 3.5] };
        let two = Table { x: vec![0.0, 2.0], x2: vec![0.0, 1.0], y: vec![0.0, 1.0, 4.0, 9.0] };
        let tables = Tables(vec![one, two]);
        assert_eq!(tables.one(0.0, 0.5, false), 2.0);
        assert_eq!(tables.one(0.0, 2.0, true), 0.25);
        assert_eq!(tables.one(0.0, 9.0, false), 3.5);
        assert_eq!(tables.one(0.0, -1.0, true), 0.0);
        assert!(tables.one(0.0, f64::NAN, false).is_nan());
        assert_eq!(tables.two(1.0, 1.0, 0.5), [3.5, 3.0, 3.0]);
        assert_eq!(tables.two(1.0, 5.0, 5.0), [9.0, 0.0, 0.0]);
    }
}
