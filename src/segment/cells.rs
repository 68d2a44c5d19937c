//! A piece of signal in; its means over cells, straight lines through them and its turning points
//! out.

use super::scan::Work;
use crate::signal::robust::noise_sd;
use std::ops::Range;

/// The signal as means over cells of equal length.
pub struct Cells {
    /// Middle of the first cell, s.
    t0: f64,
    /// Length of a cell, s.
    pub h: f64,
    pub v: Vec<f64>,
    /// Sd of their noise.
    pub noise: f64,
}

/// A straight line.
#[derive(Clone, Copy)]
pub struct Line {
    pub t: f64,
    pub value: f64,
    pub rate: f64,
    /// Sd of the rate from the noise of the cells.
    pub rate_sd: f64,
}

impl Cells {
    /// Means over `length` seconds, or the samples where they are farther apart.
    pub fn of(work: &Work, length: f64) -> Cells {
        let count = work.count(length).max(1);
        let mean = |cell: &[f64]| {
            let finite = cell.iter().filter(|v| v.is_finite());
            finite.clone().sum::<f64>() / finite.count() as f64
        };
        let v: Vec<f64> = work.v.chunks_exact(count).map(mean).collect();
        let noise = noise_sd(&v);
        Cells { t0: work.time(0.5 * (count - 1) as f64), h: count as f64 * work.h, v, noise }
    }

    pub fn time(&self, i: usize) -> f64 {
        self.t0 + i as f64 * self.h
    }

    /// The cells whose middles are within `from..to`, s.
    pub fn range(&self, from: f64, to: f64) -> Range<usize> {
        let index = |t: f64| (((t - self.t0) / self.h).ceil().max(0.0) as usize).min(self.v.len());
        let first = index(from);
        first..index(to).max(first)
    }

    /// The cells there with a value: times, values.
    pub fn values(&self, range: Range<usize>) -> (Vec<f64>, Vec<f64>) {
        range.map(|i| (self.time(i), self.v[i])).filter(|p| p.1.is_finite()).unzip()
    }

    /// Rms distance of the cells from `wanted` of time, without their noise.
    pub fn rms(&self, range: Range<usize>, wanted: impl Fn(f64) -> f64) -> f64 {
        let (t, v) = self.values(range);
        let square: f64 = t.iter().zip(&v).map(|(t, v)| (v - wanted(*t)) * (v - wanted(*t))).sum();
        (square / t.len() as f64 - self.noise * self.noise).max(0.0).sqrt()
    }

    /// The least-squares line through the cells within `from..to`; `None` where there are fewer
    /// than two.
    pub fn line(&self, from: f64, to: f64) -> Option<Line> {
        let (t, v) = self.values(self.range(from, to));
        let n = t.len() as f64;
        let (t_mean, v_mean) = (t.iter().sum::<f64>() / n, v.iter().sum::<f64>() / n);
        let square: f64 = t.iter().map(|t| (t - t_mean) * (t - t_mean)).sum();
        let product: f64 = t.iter().zip(&v).map(|(t, v)| (t - t_mean) * (v - v_mean)).sum();
        let rate_sd = self.noise / square.sqrt();
        (square > 0.0).then(|| Line { t: t_mean, value: v_mean, rate: product / square, rate_sd })
    }
}

impl Line {
    /// When the line is at `value`, s.
    pub fn when(&self, value: f64) -> f64 {
        self.t + (value - self.value) / self.rate
    }

    /// Time, s, and value where two lines meet.
    pub fn meet(&self, other: &Line) -> (f64, f64) {
        let t = (other.value - self.value + self.rate * self.t - other.rate * other.t)
            / (self.rate - other.rate);
        (t, self.value + self.rate * (t - self.t))
    }
}

/// Indices at which the signal turns: maxima and minima by turns, between reversals by at least
/// `reversal`. Of a flat top it is the middle.
pub fn turning_points(v: &[f64], reversal: f64) -> Vec<usize> {
    let mut turns = Vec::new();
    let (mut low, mut high) = (0, 0);
    // 1: the signal has risen, and a maximum is next; 0: neither has been seen.
    let mut side = 0;
    for i in (0..v.len()).filter(|i| v[*i].is_finite()) {
        if side >= 0 && !(v[i] <= v[high]) {
            high = i;
        }
        if side <= 0 && !(v[i] >= v[low]) {
            low = i;
        }
        if side >= 0 && v[high] - v[i] >= reversal {
            turns.extend((side > 0).then(|| middle(v, high, 0.2 * reversal)));
            (side, low) = (-1, i);
        } else if side <= 0 && v[i] - v[low] >= reversal {
            turns.extend((side < 0).then(|| middle(v, low, 0.2 * reversal)));
            (side, high) = (1, i);
        }
    }
    turns
}

/// The middle of the stretch around `at` where the signal is within `near` of its value there.
fn middle(v: &[f64], at: usize, near: f64) -> usize {
    let away = |i: &usize| !((v[*i] - v[at]).abs() <= near);
    let first = (0..at).rev().find(away).map_or(0, |i| i + 1);
    let last = (at..v.len()).find(away).unwrap_or(v.len()) - 1;
    (first + last) / 2
}
