//! Predictors and which samples of a series were not measured in; those samples bridged, and the
//! first ones behind them made white, out.
//!
//! A sample that was not measured is taken for its prediction, whose error the samples behind it
//! inherit. With `P` the covariance of the errors of the last `p` values (nothing for measured
//! ones), `a` the predictor and `s^2` the variance of its error, the next sample has the innovation
//! variance `v = a'Pa + s^2` and the covariance `P a` with those values: the Kalman filter of an
//! autoregressive process with missing observations (Jones, Technometrics 22, 1980). Measured, it
//! tells of the values before it with the gain `K = P a / v`, `P -= v K K'`. As soon as `p`
//! measured samples follow each other `P` is nothing, and what comes then is as if nothing had been
//! missing.
//!
//! Gains depend on what was measured alone: they are found once for all series of a block.

use crate::math::products::dot;

/// The samples that are no matter of the predictors alone: masked ones, and those within the order
/// behind them.
pub(super) struct Gaps(Vec<Step>);

/// One of these samples.
struct Step {
    at: usize,
    /// None for a masked one.
    measured: Option<Gain>,
}

/// What a measured sample says.
struct Gain {
    /// One over the sd of its innovation.
    scale: f64,
    /// Masked samples of the window, and how much of the innovation each takes.
    of: Vec<(usize, f64)>,
}

/// What is new in the last of these values.
pub(super) fn innovation(predictor: &[f64], x: &[f64]) -> f64 {
    let (now, before) = (x[x.len() - 1], &x[..x.len() - 1]);
    now - predictor.iter().zip(before.iter().rev()).map(|(a, x)| a * x).sum::<f64>()
}

impl Gaps {
    /// `predictors` of every order and the `variances` of their errors.
    pub(super) fn new(predictors: &[Vec<f64>], variances: &[f64], masked: &[bool]) -> Gaps {
        if !masked.iter().fold(false, |any, masked| any | masked) {
            return Gaps(Vec::new());
        }
        let last = predictors.len() - 1;
        let mut errors = Errors { n: last, p: vec![0.0; last * last] };
        // The sample behind which the window holds no masked one.
        let (mut until, mut steps) = (0, Vec::new());
        for (at, &masked) in masked.iter().enumerate() {
            if masked {
                until = at + last + 1;
            }
            if at >= until {
                continue;
            }
            let order = at.min(last);
            let (with, variance) = errors.of_prediction(&predictors[order], variances[order]);
            let measured = (!masked).then(|| errors.measured(at, &with, variance));
            errors.shift(masked.then_some((&with, variance)));
            steps.push(Step { at, measured });
        }
        Gaps(steps)
    }

    /// Whether every sample was measured.
    pub(super) fn are_none(&self) -> bool {
        self.0.is_empty()
    }

    /// Puts estimates in place of the masked samples of `x`, and makes `white` what `Gaps` is
    /// about.
    pub(super) fn bridge(&self, predictors: &[Vec<f64>], x: &mut [f64], white: &mut [f64]) {
        let n = x.len();
        for Step { at, measured } in self.0.iter().take_while(|step| step.at < n) {
            let new = innovation(&predictors[(*at).min(predictors.len() - 1)], &x[..=*at]);
            match measured {
                Some(gain) => {
                    white[*at] = new * gain.scale;
                    gain.of.iter().for_each(|(of, k)| x[*of] += k * new);
                }
                None => (white[*at], x[*at]) = (0.0, x[*at] - new),
            }
        }
    }
}

/// `P`: covariance of the errors of the last `n` values, the latest first.
struct Errors {
    n: usize,
    p: Vec<f64>,
}

impl Errors {
    /// `P a` and the variance of the innovation.
    fn of_prediction(&self, a: &[f64], s2: f64) -> (Vec<f64>, f64) {
        let row = |i: usize| &self.p[i * self.n..(i + 1) * self.n];
        let with: Vec<f64> = (0..self.n).map(|i| dot(row(i), a)).collect();
        let more = dot(&with, a);
        (with, more.max(0.0) + s2)
    }

    /// Sample `at` is measured.
    fn measured(&mut self, at: usize, with: &[f64], variance: f64) -> Gain {
        let n = self.n;
        for i in 0..n {
            (0..n).for_each(|j| self.p[i * n + j] -= with[i] * with[j] / variance);
        }
        let of = (0..n.min(at))
            .filter(|&i| with[i] != 0.0)
            .map(|i| (at - 1 - i, with[i] / variance))
            .collect();
        Gain { scale: 1.0 / variance.sqrt(), of }
    }

    /// The window moves on by one value: a known one, or one with this covariance with the others
    /// and this variance.
    fn shift(&mut self, estimated: Option<(&[f64], f64)>) {
        let n = self.n;
        for i in (1..n).rev() {
            for j in (1..n).rev() {
                self.p[i * n + j] = self.p[(i - 1) * n + j - 1];
            }
        }
        for i in 0..n {
            let with = match (estimated, i) {
                (Some((_, variance)), 0) => variance,
                (Some((with, _)), i) => with[i - 1],
                (None, _) => 0.0,
            };
            (self.p[i], self.p[i * n]) = (with, with);
        }
    }
}
