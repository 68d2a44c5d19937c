//! How fast the fastest mode is: the spectral radius of the compiled Jacobian at a point, and the
//! sub-steps it asks for.

use super::evaluate::Many;
use super::propagator::Propagator;
use super::tableau::{MOST_SUBSTEPS, STIFF};

pub struct Stiffness<'p> {
    propagator: &'p Propagator,
    jacobian: Many<'p>,
    entries: Vec<f64>,
}

impl<'p> Stiffness<'p> {
    pub fn new(propagator: &'p Propagator, parameters: &[f64]) -> Self {
        let program = &propagator.linear.rates_program;
        Stiffness {
            propagator,
            jacobian: Many::new(program, propagator, parameters),
            entries: vec![0.0; program.outputs()],
        }
    }

    /// The state that is fastest at a point by itself, and its time constant, s.
    pub fn fastest(&mut self, point: &[f64]) -> (usize, f64) {
        let (a, nx) = (self.jacobian_at(point), self.propagator.layout.states);
        let by_itself = |i: &usize| a[i * nx + i].abs();
        let state = (0..nx).max_by(|i, j| by_itself(i).total_cmp(&by_itself(j))).unwrap_or(0);
        let rate = by_itself(&state);
        // Where no state is fast by itself, the pair that oscillates is.
        (state, 1.0 / if rate > 0.0 { rate } else { spectral_radius(&a, nx) })
    }

    fn jacobian_at(&mut self, point: &[f64]) -> Vec<f64> {
        let nx = self.propagator.layout.states;
        self.jacobian.at(point, &mut self.entries);
        let mut a = vec![0.0; nx * nx];
        for e in &self.propagator.linear.rates.states {
            a[e.row * nx + e.column] = self.entries[e.output];
        }
        a
    }

    /// Sub-steps per grid step `dt` so that |lambda| h stays below the limit; more than the most
    /// allowed if it cannot.
    pub fn substeps(&mut self, point: &[f64], dt: f64) -> usize {
        let (a, nx) = (self.jacobian_at(point), self.propagator.layout.states);
        let needed = spectral_radius(&a, nx) * dt / STIFF;
        if needed.is_nan() { 1 } else { (needed.ceil() as usize).clamp(1, MOST_SUBSTEPS + 1) }
    }
}

/// Spectral radius by Gelfand's formula, |A^k|^(1/k), with k = 1024 by repeated squaring (scaled,
/// so nothing overflows).
pub fn spectral_radius(a: &[f64], n: usize) -> f64 {
    let mut power = a.to_vec();
    let mut log_scale = 0.0;
    let mut exponent = 1.0;
    for _ in 0..10 {
        let norm = power.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        if norm == 0.0 {
            return 0.0;
        }
        if !norm.is_finite() {
            return f64::NAN;
        }
        for v in &mut power {
            *v /= norm;
        }
        // A^(2k) = (norm B)^2 = norm^2 B^2
        log_scale = 2.0 * (log_scale + libm::log(norm));
        exponent *= 2.0;
        let mut square = vec![0.0; n * n];
        for i in 0..n {
            for k in 0..n {
                let f = power[i * n + k];
                if f != 0.0 {
                    for j in 0..n {
                        square[i * n + j] += f * power[k * n + j];
                    }
                }
            }
        }
        power = square;
    }
    let norm = power.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    if norm == 0.0 { 0.0 } else { libm::exp((log_scale + libm::log(norm)) / exponent) }
}

#[cfg(test)]
mod tests {
    use super::spectral_radius;

    #[test]
    fn the_spectral_radius_is_that_of_known_matrices() {
        // real -3, complex pair of modulus 5, a nilpotent block, badly scaled states
        let close = |a: &[f64], n: usize, r: f64| {
            let got = spectral_radius(a, n);
            assert!((got - r).abs() < 0.02 * r, "{got} instead of {r}");
        };
        close(&[-3.0, 1e4, 0.0, 1.0], 2, 3.0);
        close(&[0.0, 1.0, -25.0, -6.0], 2, 5.0);
        close(&[-2.0, 1e6, -1e-6, -2.0], 2, 5.0f64.sqrt());
        assert_eq!(spectral_radius(&[0.0, 1.0, 0.0, 0.0], 2), 0.0);
    }
}
