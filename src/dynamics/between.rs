//! Inputs on a grid in; their values, and those of their rates, inside a grid step out.

use super::history;
use super::{Interpolation, Record};

/// Inputs and their rates inside grid steps. The last few are kept: a step asks for its middle
/// twice, and for its end again as the start of the next.
pub(super) struct Between {
    kept: [Row; KEPT],
    oldest: usize,
}

/// Rows that are kept: start, middle and end of a step.
const KEPT: usize = 3;

/// Inputs, then their rates, at a fraction `c` of the step behind grid point `k`.
#[derive(Clone)]
struct Row {
    k: usize,
    c: f64,
    values: Vec<f64>,
}

impl Between {
    /// For records of so many inputs and input rates.
    pub(super) fn new(columns: usize) -> Between {
        let row = Row { k: usize::MAX, c: f64::NAN, values: vec![0.0; columns] };
        Between { kept: std::array::from_fn(|_| row.clone()), oldest: 0 }
    }

    /// Inputs, then what `slopes` (laid out like the inputs; may be empty) has for them, at a
    /// fraction `c` (0 to 1) of the step behind grid point `k`.
    pub(super) fn at(&mut self, record: &Record, slopes: &[f64], k: usize, c: f64) -> &[f64] {
        if let Some(i) = self.kept.iter().position(|row| row.k == k && row.c == c) {
            return &self.kept[i].values;
        }
        let i = self.oldest;
        self.oldest = (i + 1) % KEPT;
        let row = &mut self.kept[i];
        (row.k, row.c) = (k, c);
        let half = if slopes.is_empty() { row.values.len() } else { row.values.len() / 2 };
        let (inputs, rates) = row.values.split_at_mut(half);
        fill(inputs, record, &record.inputs, k, c);
        if !slopes.is_empty() {
            fill(rates, record, slopes, k, c);
        }
        &row.values
    }
}

/// One row of `from`, which has a row for each grid point.
fn fill(row: &mut [f64], record: &Record, from: &[f64], k: usize, c: f64) {
    let nu = row.len();
    for (j, value) in row.iter_mut().enumerate() {
        *value = Column::of(record, from, nu, j).at(k, c);
    }
}

/// An input, or its rate, on the grid.
#[derive(Clone, Copy)]
pub(super) struct Column<'a> {
    /// Rows of all columns, from this one's first value on.
    from: &'a [f64],
    /// How many columns there are.
    nu: usize,
    last: usize,
    kind: Interpolation,
}

impl<'a> Column<'a> {
    /// Column `j` of `from`, which has a row of `nu` for each grid point.
    pub(super) fn of(record: &Record, from: &'a [f64], nu: usize, j: usize) -> Column<'a> {
        let kind = record.interpolation.get(j).copied().unwrap_or_default();
        Column { from: &from[j..], nu, last: record.n - 1, kind }
    }

    /// Its value at a fraction `c` (0 to 1) of the step behind grid point `k`.
    #[inline(always)]
    pub(super) fn at(self, k: usize, c: f64) -> f64 {
        let here = self.point(k);
        if c == 0.0 {
            return here;
        }
        // The fraction as the sum of both leaves it: the same bits as a position on the grid.
        let s = (k as f64 + c) - k as f64;
        match self.kind {
            Interpolation::Hold => here,
            Interpolation::Linear | Interpolation::Ramps => line(here, self.point(k + 1), c),
            Interpolation::Cubic if s >= 1.0 => self.point(k + 1),
            Interpolation::Cubic => {
                let around = [k.saturating_sub(1), k, k + 1, k + 2];
                history::value(around.map(|k| self.point(k)), s)
            }
        }
    }

    /// Its values at these fractions of the step behind grid point `k`.
    #[inline(always)]
    pub(super) fn over<'o>(
        self,
        k: usize,
        fractions: &[f64],
        out: impl Iterator<Item = &'o mut f64>,
    ) {
        let both = fractions.iter().zip(out);
        if let Interpolation::Linear | Interpolation::Ramps = self.kind {
            let (here, next) = (self.point(k), self.point(k + 1));
            return both.for_each(|(&c, value)| *value = line(here, next, c));
        }
        both.for_each(|(&c, value)| *value = self.at(k, c));
    }

    #[inline(always)]
    fn point(self, k: usize) -> f64 {
        self.from[k.min(self.last) * self.nu]
    }
}

/// The straight line from `a` to `b` at a fraction of it.
#[inline(always)]
fn line(a: f64, b: f64, c: f64) -> f64 {
    if c == 0.0 { a } else { a + c * (b - a) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_input_is_what_a_delay_reads_there() {
        let f = |t: f64| 1.0 - 2.0 * t + 0.5 * t * t;
        let inputs: Vec<f64> = (0..20).map(|i| f(0.1 * f64::from(i))).collect();
        let record = Record {
            dt: 0.1,
            n: 20,
            inputs: inputs.into(),
            interpolation: vec![Interpolation::Cubic],
            ..Record::default()
        };
        let mut between = Between::new(1);
        for (k, s) in [(0, 0.25), (7, 0.5), (7, 1.0), (18, 0.75), (18, 1.0), (19, 0.0), (7, 0.5)] {
            let (at, got) = (k as f64 + s, between.at(&record, &[], k, s)[0]);
            assert_eq!(got, history::input(&record.inputs, 1, 0, 0.1, at).0, "{at}");
        }
    }

    #[test]
    fn what_is_kept_is_what_is_computed_again() {
        let inputs: Vec<f64> = (0..40).map(|i| (i as f64).sin()).collect();
        let interpolation = vec![Interpolation::Linear, Interpolation::Hold];
        let record =
            Record { dt: 0.1, n: 20, inputs: inputs.into(), interpolation, ..Record::default() };
        let slopes: Vec<f64> = (0..40).map(|i| (i as f64).cos()).collect();
        let mut between = Between::new(4);
        for step in 0..60 {
            let (k, c) = (step * 7 % 19, [0.0, 0.5, 0.5, 1.0][step % 4]);
            let kept = between.at(&record, &slopes, k, c).to_vec();
            assert_eq!(kept, Between::new(4).at(&record, &slopes, k, c), "{k} {c}");
            let a = record.inputs[2 * k];
            assert_eq!(kept[0], if c == 0.0 { a } else { a + c * (record.inputs[2 * k + 2] - a) });
            assert_eq!(
                kept[1..3],
                [record.inputs[2 * k + 1], {
                    let a = slopes[2 * k];
                    if c == 0.0 { a } else { a + c * (slopes[2 * k + 2] - a) }
                }]
            );
        }
    }
}
