//! What was measured and what a held model says come in; how well they agree, and a verdict, go out.

use crate::math::distribution::INTERVAL_95;
use crate::noise::{Theil, theil};
use crate::signal::adequacy::{COLOUR, SHARE};
use crate::signal::robust::noise_sd;

/// Smoothed residuals within so many standard deviations are the sensor's noise.
const SIGMAS: f64 = 3.0;
/// What is short and yet no more than was left where the values come from.
const AS_BEFORE: &str =
    ": the estimate leaves as much itself, so that noise and what the model lacks look alike";
/// Residuals of an estimate whose level at frequency zero is so many times that of white noise are slow.
const SLOW: f64 = 1.5;
/// So many times the limit of Theil's coefficient, and the noise, is far beyond it.
const FAR: f64 = 3.0;
/// Share of them that must be.
const NOISE: f64 = 0.95;
/// The estimate leaves more than the sensor's noise from so many times that on. *Convention*, as for what an
/// estimate leaves (`signal::adequacy`).
const SENSOR: f64 = 2.0;

/// One output of one maneuver.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Output {
    pub name: String,
    pub unit: String,
    /// Times, s, and values at them; NaN where nothing was measured.
    pub t: Vec<f64>,
    pub measured: Vec<f64>,
    pub modelled: Vec<f64>,
    /// Standard deviation of what is modelled, from that of the values.
    pub carried_sd: Vec<f64>,
    /// Half-width of the band within which it is not known besides; 0 without one.
    pub band: Vec<f64>,
    /// Where noise drives the states of the model.
    pub driven: Option<Driven>,
    /// Whether a line that the values come from is taken outside its points.
    pub beyond: Vec<bool>,
    /// Standard deviation of its noise by the `R` of the estimate; not a number where that has no
    /// output of this name.
    pub r_sd: f64,
    /// Variance of its residuals at frequency zero over their variance: one where they are white.
    pub r_colour: f64,
    /// Length of the moving average that is held against that noise, s.
    pub smooth_s: f64,
}

/// What noise that drives the states does to an output, at the times of the samples.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Driven {
    /// Standard deviation of what it adds to the motion by itself.
    pub sd: Vec<f64>,
    /// What a filter predicts one sample ahead, and the standard deviation by which it says it errs.
    pub ahead: Vec<f64>,
    pub ahead_sd: Vec<f64>,
}

/// How well one output agrees.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement {
    /// Samples looked at.
    pub n: usize,
    /// So many independent ones say as much of the share within: fewer where noise drives the
    /// states, because what a gust does lasts.
    pub independent: f64,
    /// The same for `within_left`, by the colour of what the estimate left: an error of its own that lasts would
    /// excuse itself.
    pub independent_left: f64,
    pub rms: f64,
    /// `1 - rms/s`, with the standard deviation `s` of what was measured: 1 is a perfect fit.
    pub fit: f64,
    pub theil: Theil,
    /// Largest absolute error, and when.
    pub largest: f64,
    pub largest_at: f64,
    /// Standard deviation of the sensor's noise, from the measurement alone.
    pub noise_sd: f64,
    /// Theil's coefficient of a model that leaves that alone.
    pub noise_theil: f64,
    /// Root mean square of `carried_sd`, and mean of the band.
    pub carried_sd: f64,
    pub band: f64,
    /// Root mean square of what noise that drives the states adds; not a number where none does.
    pub driven_sd: f64,
    /// Share of the samples within the interval that is predicted for them: the band, and 95% by the
    /// standard deviations of what is modelled, of what drives the states, and of the sensor's noise.
    pub within: f64,
    /// The same with the noise as large as what the estimate left on its own maneuvers; not a number where
    /// that is not slow.
    pub within_left: f64,
    /// Standard deviation of the sensor's noise by the `R` of the estimate.
    pub r_sd: f64,
    /// Share of the smoothed residuals within three standard deviations of what white noise of that
    /// `R` leaves after the smoothing.
    pub smoothed: f64,
}

impl Output {
    /// Share of the moving averages of the residuals that such noise alone explains; not a number
    /// without `R`, or where no stretch is long enough. An average of `m` samples of white noise
    /// has its standard deviation over the root of `m`; slow noise has a larger one, by the root of its
    /// colour at most, and never more than its own.
    fn smoothed(&self, left: Option<f64>) -> f64 {
        let steps: Vec<f64> = self.t.windows(2).map(|t| t[1] - t[0]).collect();
        if steps.is_empty() {
            return f64::NAN;
        }
        let m = (self.smooth_s / crate::math::median(&steps)).round().max(1.0) as usize;
        let slow = if self.r_colour > 1.0 { self.r_colour.min(m as f64) } else { 1.0 };
        let limit = SIGMAS * (slow / m as f64).sqrt();
        // an inadequate model leaves more than counts as noise
        let more = left.map_or(1.0, |left| self.r_sd / left);
        let mut e = self.errors();
        e.iter_mut().for_each(|e| *e *= more);
        let (mut inside, mut all) = (0.0, 0.0);
        for of in e.windows(m) {
            let mean = of.iter().sum::<f64>() / m as f64;
            if mean.is_finite() {
                all += 1.0;
                inside += f64::from(u8::from(mean.abs() <= limit));
            }
        }
        if all > 0.0 { inside / all } else { f64::NAN }
    }

    /// What the estimate left on its own maneuvers, where that is slow: noise of the sensor as far as an
    /// adequate model may leave it (`adequacy`), or a gust that nobody knows. `fast` is the part of the
    /// noise that the measurement shows.
    fn left(&self, fast: f64, spread: f64) -> Option<f64> {
        let is_slow = self.r_colour > SLOW && self.r_sd.is_finite();
        is_slow.then(|| fast.max(self.r_sd.min((COLOUR * fast).hypot(SHARE * spread))))
    }

    /// Errors over the standard deviation that they have by the estimate: of the model, or of the
    /// predictions of its filter.
    fn errors(&self) -> Vec<f64> {
        let error = |k: usize| match &self.driven {
            Some(driven) => (self.measured[k] - driven.ahead[k]) / driven.ahead_sd[k],
            None => (self.measured[k] - self.modelled[k]) / self.r_sd,
        };
        (0..self.t.len()).map(error).collect()
    }

    /// Standard deviation of a sample about what is modelled, but for the sensor's noise.
    pub fn sd(&self, k: usize) -> f64 {
        let driven = self.driven.as_ref().map_or(0.0, |driven| driven.sd[k]);
        self.carried_sd[k].hypot(driven)
    }

    /// How well it agrees; none where nothing was measured.
    pub fn agreement(&self) -> Option<Agreement> {
        let there = |k: &usize| self.measured[*k].is_finite() && self.modelled[*k].is_finite();
        let all: Vec<usize> = (0..self.t.len()).filter(there).collect();
        let n = all.len() as f64;
        let last = *all.last()?;
        let mean = |of: &dyn Fn(usize) -> f64| all.iter().map(|&k| of(k)).sum::<f64>() / n;
        let e = |k: usize| self.measured[k] - self.modelled[k];
        let rms = mean(&|k| e(k) * e(k)).sqrt();
        let middle = mean(&|k| self.measured[k]);
        let spread = mean(&|k| (self.measured[k] - middle) * (self.measured[k] - middle)).sqrt();
        let theil = theil(&self.modelled, &self.measured);
        let largest =
            all.iter().copied().fold(last, |a, b| if e(b).abs() > e(a).abs() { b } else { a });
        let noise = noise_sd(&self.measured);
        let fast = if noise.is_finite() { noise } else { 0.0 };
        let half = |k: usize, noise: f64| {
            let sd = self.sd(k);
            self.band[k] + INTERVAL_95 * (sd * sd + noise * noise).sqrt()
        };
        let inside = |noise: f64| mean(&|k| f64::from(u8::from(e(k).abs() <= half(k, noise))));
        let left = self.left(fast, spread);
        let few = || independent(&all.iter().map(|&k| e(k)).collect::<Vec<_>>());
        Some(Agreement {
            n: all.len(),
            independent: if self.driven.is_some() { few() } else { n },
            independent_left: if self.r_colour > 1.0 { n / self.r_colour } else { n },
            rms,
            fit: 1.0 - rms / spread,
            theil,
            largest: e(largest).abs(),
            largest_at: self.t[largest],
            noise_sd: fast,
            noise_theil: left.unwrap_or(fast) * theil.coefficient / rms,
            carried_sd: mean(&|k| self.carried_sd[k] * self.carried_sd[k]).sqrt(),
            band: mean(&|k| self.band[k]),
            driven_sd: self
                .driven
                .as_ref()
                .map_or(f64::NAN, |driven| mean(&|k| driven.sd[k] * driven.sd[k]).sqrt()),
            within: inside(fast),
            within_left: left.map_or(f64::NAN, inside),
            r_sd: self.r_sd,
            smoothed: self.smoothed(left),
        })
    }
}

impl Agreement {
    /// By how much the share within may fall short of a wanted one by chance: three standard
    /// deviations of a share of `n` independent ones, and of the noise's size, which is known to
    /// `1.6/sqrt(n)` of it
    /// (a larger interval of 1% holds 0.23% more).
    fn chance(wanted: f64, independent: f64) -> f64 {
        let square = wanted * (1.0 - wanted) + (0.23 * 1.6) * (0.23 * 1.6);
        3.0 * (square / independent).sqrt()
    }

    /// Whether what is left is the sensor's noise, or as much as the estimate leaves of its own maneuvers where
    /// that is more; none without `R`.
    pub fn noise_verdict(&self) -> Option<&'static str> {
        match self.smoothed {
            share if share.is_nan() => None,
            share if share < NOISE => Some("more than noise"),
            // Noise that a filter has found is the sensor's.
            _ if self.driven_sd.is_nan() && self.r_sd > SENSOR * self.noise_sd => {
                Some("as the estimate leaves")
            }
            _ => Some("noise"),
        }
    }

    /// Whether the model says something else than what was flown: far beyond Theil's limit, and far beyond
    /// noise of the sensor and what the estimate left.
    pub fn is_far(&self, theil: f64) -> bool {
        let noise =
            if self.r_sd.is_finite() { self.noise_sd.max(self.r_sd) } else { self.noise_sd };
        self.driven_sd.is_nan()
            && !(self.theil.coefficient <= FAR * theil)
            && !(self.rms <= FAR * noise)
    }

    /// `good`, or what it falls short of. What the sensor's noise alone makes of Theil's coefficient is
    /// no error of the model. Where noise drives the states Theil's coefficient is not
    /// asked: a gust is no error of the model, and the interval knows how much it may do.
    pub fn verdict(&self, within: f64, theil: f64) -> String {
        let mut short = Vec::new();
        // The noise's size is known to `1.6/sqrt(n)` of it, and that of the errors to `1/sqrt(2 n)`.
        let chance = 1.0 + 3.0 * f64::hypot(1.6, 0.5f64.sqrt()) / self.independent.sqrt();
        let limit = match self.noise_theil > 0.0 {
            true => theil.hypot(chance * self.noise_theil),
            false => theil,
        };
        if self.driven_sd.is_nan() && !(self.theil.coefficient <= limit) {
            short.push(format!("Theil {:.3} above {theil}", self.theil.coefficient));
        }
        let least = |independent: f64| within - Agreement::chance(within, independent);
        if !(self.within >= least(self.independent)) {
            let percent = |share: f64| format!("{:.0}%", 100.0 * share);
            let is_left = self.within_left >= least(self.independent_left);
            let left = if is_left { AS_BEFORE } else { "" };
            short.push(format!(
                "{} within the predicted interval, {} wanted{left}",
                percent(self.within),
                percent(within)
            ));
        }
        if short.is_empty() { "good".into() } else { short.join("; ") }
    }
}

/// Of how many independent numbers the mean varies as that of these: `n/(1 + 2 sum rho)`, with their
/// autocorrelations up to the first that is not positive.
fn independent(x: &[f64]) -> f64 {
    let of = |lag: usize| x[lag..].iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
    let square = of(0);
    let positive = (1..x.len()).map(|lag| of(lag) / square).take_while(|rho| *rho > 0.0);
    x.len() as f64 / (1.0 + 2.0 * positive.sum::<f64>())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output(error: impl Fn(f64) -> f64, carried: f64, band: f64) -> Output {
        let t: Vec<f64> = (0..400).map(|k| 0.02 * f64::from(k)).collect();
        let modelled: Vec<f64> = t.iter().map(|t| libm::sin(2.0 * t)).collect();
        let measured = t.iter().zip(&modelled).map(|(t, y)| y + error(*t)).collect();
        let n = t.len();
        Output {
            t,
            measured,
            modelled,
            carried_sd: vec![carried; n],
            band: vec![band; n],
            r_sd: 0.02,
            smooth_s: 0.2,
            ..Output::default()
        }
    }

    #[test]
    fn a_band_and_the_carried_sd_make_the_interval_wide() {
        let share = |carried, band| {
            let agreement = output(|t| 0.1 * libm::sin(0.7 * t), carried, band).agreement();
            agreement.expect("samples").within
        };
        assert!(share(0.0, 0.0) < 0.2 && share(0.06, 0.0) == 1.0 && share(0.0, 0.11) == 1.0);
    }

    #[test]
    fn the_verdict_says_what_is_short() {
        let far = output(|t| 0.5 * libm::sin(0.7 * t), 0.0, 0.0).agreement().expect("samples");
        let text = far.verdict(0.95, 0.1);
        assert!(text.contains("Theil") && text.contains("95% wanted"), "{text}");
        let near = output(|_| 0.01, 0.01, 0.0).agreement().expect("samples");
        assert_eq!(near.verdict(0.95, 0.1), "good");
        assert!((near.theil.bias - 1.0).abs() < 1e-9 && near.theil.covariance.abs() < 1e-9);
    }

    /// A motion that is small beside the sensor's noise: Theil's coefficient is near one, and says nothing.
    #[test]
    fn noise_alone_is_no_error_of_the_model() {
        for seed in 0..100 {
            let mut noise = crate::simulate::Stream::new(seed, &["noise"]);
            let mut output = output(|_| 0.0, 0.0, 0.0);
            output.modelled.iter_mut().for_each(|y| *y *= 2e-3);
            let measured = output.modelled.iter().map(|y| y + 0.05 * noise.normal());
            output.measured = measured.collect();
            let agreement = output.agreement().expect("samples");
            assert_eq!(agreement.verdict(0.95, 0.1), "good", "{seed}: {agreement:?}");
        }
    }

    #[test]
    fn noise_averages_out_and_an_error_of_the_model_does_not() {
        // Of both signs in turn: 10 samples average to 0, whatever its size.
        let flip = |t: f64| if (t / 0.02).round() as i64 % 2 == 0 { 0.05 } else { -0.05 };
        let noise = output(flip, 0.0, 0.0).agreement().expect("samples");
        assert_eq!((noise.smoothed, noise.noise_verdict()), (1.0, Some("noise")));
        // 3 * 0.02 / sqrt(10) = 0.019 is the limit.
        let share = |size: f64| {
            output(|t| size * libm::sin(t) + flip(t), 0.0, 0.0).agreement().expect("samples")
        };
        assert_eq!(share(0.018).noise_verdict(), Some("noise"));
        assert_eq!(share(0.03).noise_verdict(), Some("more than noise"));
        let mut without = output(flip, 0.0, 0.0);
        without.r_sd = f64::NAN;
        assert_eq!(without.agreement().expect("samples").noise_verdict(), None);
    }

    #[test]
    fn a_gust_is_no_error_of_the_model_where_its_size_is_known() {
        let gust = |t: f64| 0.3 * libm::sin(1.5 * t);
        let judged = |sd: f64, off: f64| {
            let mut output = output(gust, 0.0, 0.0);
            let n = output.t.len();
            let ahead = output.measured.iter().map(|z| z - off).collect();
            output.driven = Some(Driven { sd: vec![sd; n], ahead, ahead_sd: vec![0.01; n] });
            let agreement = output.agreement().expect("samples");
            (agreement.verdict(0.95, 0.1), agreement.noise_verdict(), agreement.independent)
        };
        let (verdict, noise, independent) = judged(0.25, 0.0);
        assert_eq!((verdict.as_str(), noise), ("good", Some("noise")));
        // Two periods in 8 s.
        assert!(independent > 2.0 && independent < 20.0, "{independent}");
        // A motion that runs away has no interval, and nothing is within it.
        assert!(judged(f64::NAN, 0.0).0.contains("0% within the predicted interval"));
        let (verdict, noise, _) = judged(0.02, 0.05);
        assert!(verdict.contains("95% wanted"), "{verdict}");
        assert_eq!(noise, Some("more than noise"));
    }

    #[test]
    fn nothing_measured_is_no_agreement() {
        let mut none = output(|_| 0.0, 0.0, 0.0);
        none.measured.fill(f64::NAN);
        assert_eq!(none.agreement(), None);
    }
}
