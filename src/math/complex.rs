//! Complex numbers in, their sums, products, quotients and roots out.

/// A complex number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Complex {
    pub re: f64,
    pub im: f64,
}

impl Complex {
    pub const ZERO: Complex = Complex { re: 0.0, im: 0.0 };

    pub fn real(re: f64) -> Complex {
        Complex { re, im: 0.0 }
    }

    pub fn plus(self, b: Complex) -> Complex {
        Complex { re: self.re + b.re, im: self.im + b.im }
    }

    pub fn minus(self, b: Complex) -> Complex {
        Complex { re: self.re - b.re, im: self.im - b.im }
    }

    pub fn by(self, b: Complex) -> Complex {
        Complex { re: self.re * b.re - self.im * b.im, im: self.re * b.im + self.im * b.re }
    }

    pub fn times(self, factor: f64) -> Complex {
        Complex { re: self.re * factor, im: self.im * factor }
    }

    pub fn over(self, b: Complex) -> Complex {
        let size = b.re * b.re + b.im * b.im;
        self.by(b.conjugate()).times(1.0 / size)
    }

    pub fn conjugate(self) -> Complex {
        Complex { re: self.re, im: -self.im }
    }

    pub fn abs(self) -> f64 {
        libm::hypot(self.re, self.im)
    }

    /// The root with a real part that is not negative.
    pub fn sqrt(self) -> Complex {
        let size = self.abs();
        let re = (0.5 * (size + self.re)).max(0.0).sqrt();
        let im = (0.5 * (size - self.re)).max(0.0).sqrt();
        Complex { re, im: if self.im < 0.0 { -im } else { im } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotients_and_roots_undo_products() {
        for (re, im) in [(3.0, -4.0), (-2.0, 0.5), (0.0, 1.0), (-1.0, 0.0)] {
            let (a, b) = (Complex { re, im }, Complex { re: -1.5, im: 0.7 });
            let close = |x: Complex, y: Complex| x.minus(y).abs() < 1e-14;
            assert!(close(a.by(b).over(b), a) && close(a.sqrt().by(a.sqrt()), a), "{a:?}");
        }
    }
}
