//! A fitted line in, its value, standard deviations and bands at any x out.

use super::line::LineFit;
use crate::math::distribution::{f_quantile, t_quantile};

impl LineFit {
    /// Value of the line at `x`.
    pub fn value(&self, x: f64) -> f64 {
        self.y_center + self.slope * (x - self.x_center)
    }

    /// Sd of the value of the line at `x`.
    pub fn value_sd(&self, x: f64) -> f64 {
        libm::hypot(self.y_center_sd, self.slope_sd * (x - self.x_center))
    }

    /// Sd of a further point of typical claimed sd about the line at `x`: line, scatter between
    /// points and the point's own error.
    ///
    /// The variance of a point is `q (tau^2 + s^2)`, with the median of the claimed `s_i^2` as
    /// `s^2`.
    pub fn point_sd(&self, x: f64) -> f64 {
        libm::hypot(
            self.value_sd(x),
            (self.q * (self.tau * self.tau + self.typical_variance)).sqrt(),
        )
    }

    /// Half width of the interval of `level` of one parameter, in units of its sd.
    pub fn interval_factor(&self, level: f64) -> f64 {
        t_quantile(0.5 * (1.0 + level), self.dof)
    }

    /// Half width of the simultaneous band (Working & Hotelling 1929) of `level`, in units of the
    /// sd of the line's value.
    pub fn simultaneous_factor(&self, level: f64) -> f64 {
        (2.0 * f_quantile(level, 2.0, self.dof)).sqrt()
    }
}

/// Half of the 95% interval of slope or intercept of a line through `n` points, in units of their
/// sd: a t quantile with n - 2 degrees of freedom; NaN where there are none.
pub fn half_95(n: f64) -> f64 {
    t_quantile(0.975, n - 2.0)
}

/// The line and its bands at one `x`, all in units of y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    pub x: f64,
    pub value: f64,
    /// Confidence interval of the line at this x alone.
    pub pointwise: (f64, f64),
    /// The whole line lies in this band, over all x at once.
    pub simultaneous: (f64, f64),
    /// A further point of typical claimed sd lies in here.
    pub prediction: (f64, f64),
}

/// The bands of `level` (0.95, say) at each of `xs`.
pub fn bands(fit: &LineFit, xs: &[f64], level: f64) -> Vec<Band> {
    let (single, joint) = (fit.interval_factor(level), fit.simultaneous_factor(level));
    xs.iter()
        .map(|&x| {
            let value = fit.value(x);
            let about = |half: f64| (value - half, value + half);
            let (sd, point) = (fit.value_sd(x), fit.point_sd(x));
            Band {
                x,
                value,
                pointwise: about(single * sd),
                simultaneous: about(joint * sd),
                prediction: about(single * point),
            }
        })
        .collect()
}
