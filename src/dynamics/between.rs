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
    let last = record.n - 1;
    let at = |k: usize| &from[k.min(last) * nu..][..nu];
    let (here, next) = (at(k), at(k + 1));
    if c == 0.0 {
        return row.copy_from_slice(here);
    }
    // The fraction as the sum of both leaves it: the same bits as a position on the grid.
    let s = (k as f64 + c) - k as f64;
    let (before, behind) = (at(k.saturating_sub(1)), at(k + 2));
    for (j, value) in row.iter_mut().enumerate() {
        *value = match record.interpolation.get(j).copied().unwrap_or_default() {
            Interpolation::Hold => here[j],
            Interpolation::Linear | Interpolation::Ramps => here[j] + c * (next[j] - here[j]),
            Interpolation::Cubic if s >= 1.0 => next[j],
            Interpolation::Cubic => history::value([before[j], here[j], next[j], behind[j]], s),
        };
    }
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
