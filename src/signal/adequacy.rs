//! What was measured of an output and what a model says of it, maneuver by maneuver, in; whether
//! what the model leaves is the sensor's noise, out. This is the one rule for that in the program:
//! the console, the report and the verdict of a diagnosis go by it.
//!
//! Three numbers of an output decide, each a mean square over all samples of all maneuvers:
//!
//! - `s^2`, the sensor's noise, read from the measurement alone: the fast part of it
//!   (`robust::noise_sd`, maneuver by maneuver),
//! - `e^2`, what the model leaves, `e = z - y`; where noise drives the model, what its filter takes
//!   for noise of the sensor,
//! - `v^2`, the variation of the measurement about its mean in each maneuver.
//!
//! A model that is right leaves the sensor's noise and nothing else: `e = s`. But `s` is what is
//! fast in the noise. Of slow noise it is too small: of noise whose neighbouring samples correlate
//! by `rho`, third differences see the share `(20 - 30 rho + 12 rho^2 - 2 rho^3)/20` of the power, a
//! quarter at 0.65. So what is left may be `COLOUR` times `s`. Besides, an output is accounted for
//! where next to nothing of its motion is left, whatever its noise: what is left may have the
//! `SHARE` of the variation. Both are of different origin, so their squares add up:
//!
//! `e^2 <= (COLOUR s)^2 + (SHARE v)^2`.
//!
//! An output that moved by less than `MOVED` times the noise, and is left with no more, tells
//! nothing: slow noise and motion that nothing explains look alike then.

use super::robust::noise_sd;
use crate::noise::theil;

/// So many times what is read of the sensor's noise its noise may be, because some of it is slow.
/// *Convention*: neighbouring samples that correlate by 0.65. Lower: slow noise of sensors passes for
/// something missing. Higher: what is missing passes for noise.
pub const COLOUR: f64 = 2.0;
/// Share of the measured variation (root mean square) that may be left. *Convention*: 96% of its
/// power is explained.
pub const SHARE: f64 = 0.2;
/// A model that leaves more than the variation is worse than none. Turbulence and small motions in an axis
/// that was not excited come to that; so many times it is a sign, a unit or a sensor that is wrong.
/// *Convention*: twice the power.
pub const WORSE: f64 = 1.5;
/// Little that is left is so many times what noise may leave, and no noise: a remark, as a term that is missing
/// moves the others. *Convention*: six times the noise that was read.
pub const FAR: f64 = 3.0;
/// So many times its noise an output must move, or be missed, to tell anything. *Convention*.
pub const MOVED: f64 = 3.0;

/// What a model leaves of one output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Leaves {
    /// No more than noise of its sensor.
    Noise,
    /// More than that, and next to nothing of the motion.
    Little,
    /// More than the sensor's noise.
    More,
    /// It hardly moved: nothing can be told.
    Unmoved,
}

impl Leaves {
    /// The stable text that tables carry.
    pub fn as_str(self) -> &'static str {
        match self {
            Leaves::Noise => "noise",
            Leaves::Little => "little",
            Leaves::More => "more than noise",
            Leaves::Unmoved => "hardly moved",
        }
    }
}

/// Whether what is left, little as it may be beside the motion, is no noise of a sensor.
pub fn is_far(left: f64, noise: f64) -> bool {
    left > FAR * COLOUR * noise
}

/// What is left beyond noise of the measured variation, in words; `variation` is the measured one.
pub fn words(share: f64, variation: f64) -> String {
    match share {
        s if s < 10.0 => format!("{:.0}%", 100.0 * s),
        s if s < 1000.0 => format!("{s:.0} times as much"),
        _ if variation > 0.0 => "the model runs away".into(),
        _ => "measured not to move".into(),
    }
}

/// Sums over samples of one output.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Adequacy {
    n: f64,
    noise: f64,
    left: f64,
    variation: f64,
    /// Parts of `left` (Theil, Economic Forecasts and Policy, 1961): a mean, motion of another
    /// size, motion that does not go together.
    parts: [f64; 3],
}

impl Adequacy {
    /// One maneuver; samples without both values are left out.
    pub fn of(measured: &[f64], modelled: &[f64]) -> Adequacy {
        let both = measured.iter().zip(modelled).map(|(z, y)| (*z, *y));
        let pairs: Vec<(f64, f64)> = both.filter(|(z, y)| z.is_finite() && y.is_finite()).collect();
        let n = pairs.len() as f64;
        if pairs.is_empty() {
            return Adequacy::default();
        }
        let mean = pairs.iter().map(|(z, _)| z).sum::<f64>() / n;
        let left = pairs.iter().map(|(z, y)| (z - y) * (z - y)).sum::<f64>();
        let parts = theil(measured, modelled);
        let of = |share: f64| if share.is_finite() { share * left } else { 0.0 };
        let noise = noise_sd(measured);
        Adequacy {
            n,
            noise: if noise.is_finite() { n * noise * noise } else { 0.0 },
            left,
            // Rounding of the mean is no variation.
            variation: match pairs.iter().all(|(z, _)| *z == pairs[0].0) {
                true => 0.0,
                false => pairs.iter().map(|(z, _)| (z - mean) * (z - mean)).sum(),
            },
            parts: [of(parts.bias), of(parts.variance), of(parts.covariance)],
        }
    }

    /// The same, with what a filter takes for the sensor's noise in the place of what is left: in a
    /// model driven by noise predictions follow the measurement, right or wrong.
    pub fn with_noise(self, sd: f64) -> Adequacy {
        Adequacy { left: self.n * sd * sd, parts: [0.0; 3], ..self }
    }

    /// The same, with noise of the sensor that is at least so large: that of a signal which was filtered is
    /// not its fast part.
    pub fn with_sensor(self, sd: f64) -> Adequacy {
        Adequacy { noise: self.noise.max(self.n * sd * sd), ..self }
    }

    pub fn add(&mut self, other: &Adequacy) {
        self.n += other.n;
        self.noise += other.noise;
        self.left += other.left;
        self.variation += other.variation;
        self.parts.iter_mut().zip(other.parts).for_each(|(a, b)| *a += b);
    }

    /// Samples.
    pub fn samples(&self) -> usize {
        self.n as usize
    }

    /// Standard deviation of the sensor's noise.
    pub fn noise(&self) -> f64 {
        (self.noise / self.n).sqrt()
    }

    /// Root of the mean square that is left.
    pub fn left(&self) -> f64 {
        (self.left / self.n).sqrt()
    }

    /// Standard deviation of what was measured.
    pub fn variation(&self) -> f64 {
        (self.variation / self.n).sqrt()
    }

    /// What is left beyond the sensor's noise as it is read, over the measured variation. What is
    /// known of the noise from `n` samples has a standard error of some 1.6/sqrt(n) of it.
    pub fn share(&self) -> f64 {
        let noise = self.noise() * (1.0 + 3.2 / self.n.sqrt());
        let beyond = (self.left / self.n - noise * noise).max(0.0).sqrt();
        beyond / self.variation()
    }

    /// Theil's shares of what is left: a mean, motion of another size, motion that does not go
    /// together. Not numbers where nothing is left, or a filter says what is.
    pub fn parts(&self) -> [f64; 3] {
        let sum: f64 = self.parts.iter().sum();
        self.parts.map(|part| if sum > 0.0 { part / sum } else { f64::NAN })
    }

    /// By the rule above.
    pub fn leaves(&self) -> Leaves {
        let (s, e, v) = (self.noise(), self.left(), self.variation());
        if !(self.n > 0.0) {
            Leaves::Unmoved
        } else if e <= COLOUR * s {
            Leaves::Noise
        } else if v.max(e) <= MOVED * s {
            Leaves::Unmoved
        } else if e * e <= COLOUR * s * COLOUR * s + SHARE * v * SHARE * v {
            Leaves::Little
        } else {
            Leaves::More
        }
    }

    /// Whether it is more than the sensor's noise.
    pub fn is_poor(&self) -> bool {
        self.leaves() == Leaves::More
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const N: usize = 800;

    /// How the noise of a sensor goes from sample to sample.
    #[derive(Debug, Clone, Copy)]
    enum Kind {
        /// Neighbouring samples correlate by so much.
        Slow(f64),
        /// White, and stored in steps of so many of its standard deviations.
        Steps(f64),
        /// White, and a vibration of so much of its power at so many Hz of 50.
        Vibration(f64, f64),
    }

    /// Noise of unit standard deviation.
    fn noise(kind: Kind, seed: u64) -> Vec<f64> {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        match kind {
            Kind::Slow(rho) => {
                let mut v = normal();
                let next = |_| {
                    v = rho * v + (1.0 - rho * rho).sqrt() * normal();
                    v
                };
                (0..N).map(next).collect()
            }
            Kind::Steps(step) => (0..N).map(|_| (normal() / step).round() * step).collect(),
            Kind::Vibration(share, hertz) => {
                let turn =
                    |k: usize| libm::sin(std::f64::consts::TAU * hertz * k as f64 / 50.0 + 1.0);
                let white = (1.0 - share).sqrt();
                (0..N).map(|k| white * normal() + (2.0 * share).sqrt() * turn(k)).collect()
            }
        }
    }

    /// A response to steps: two modes, of unit standard deviation.
    fn motion() -> Vec<f64> {
        let (mut x, mut v, mut all) = (0.0, 0.0, Vec::new());
        for k in 0..N {
            let u = if (100..220).contains(&k) || (300..340).contains(&k) { 1.0 } else { 0.0 }
                - if (220..300).contains(&k) { 1.0 } else { 0.0 };
            v += 0.02 * (9.0 * (u - x) - 2.5 * v);
            x += 0.02 * v;
            all.push(x);
        }
        let mean = all.iter().sum::<f64>() / N as f64;
        let sd = (all.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / N as f64).sqrt();
        all.iter().map(|x| x / sd).collect()
    }

    /// A model that explains this share of the motion (as a factor on it), over three maneuvers.
    fn judged(kind: Kind, explains: f64, signal: f64, seed: u64) -> Adequacy {
        let mut all = Adequacy::default();
        for maneuver in 0..3 {
            let noise = noise(kind, 10 * seed + maneuver);
            let y: Vec<f64> = motion().iter().map(|x| signal * x).collect();
            let z: Vec<f64> = y.iter().zip(noise).map(|(y, n)| y + n).collect();
            let modelled: Vec<f64> = y.iter().map(|y| explains * y).collect();
            all.add(&Adequacy::of(&z, &modelled));
        }
        all
    }

    /// Sensors as they are: white, slow, coarse, on something that shakes.
    const SENSORS: [Kind; 6] = [
        Kind::Slow(0.0),
        Kind::Slow(0.5),
        Kind::Slow(0.6),
        Kind::Steps(1.0),
        Kind::Vibration(0.5, 5.0),
        Kind::Vibration(0.7, 18.0),
    ];

    #[test]
    fn a_model_that_explains_all_is_never_poor_and_one_of_nothing_or_a_half_always() {
        for (kind, seed) in SENSORS.iter().flat_map(|kind| (0..20).map(move |seed| (*kind, seed))) {
            for signal in [0.0, 1.0, 5.0, 20.0, 100.0] {
                let all = judged(kind, 1.0, signal, seed);
                assert!(!all.is_poor(), "{kind:?} {signal} {seed}: {all:?}");
            }
            // (What shakes fast reads as more noise than there is: less motion is hidden by it.)
            for signal in [7.0, 20.0, 100.0] {
                // Half of the motion, and half of its power.
                for explains in [0.0, 0.5, 1.0 - 0.5f64.sqrt()] {
                    let part = judged(kind, explains, signal, seed);
                    assert!(part.is_poor(), "{kind:?} {explains} {signal} {seed}: {part:?}");
                }
            }
        }
    }

    #[test]
    fn noise_that_is_slower_still_is_little_beside_a_motion_of_its_size_times_ten() {
        for seed in 0..20 {
            let all = judged(Kind::Slow(0.9), 1.0, 10.0, seed);
            assert_eq!(all.leaves(), Leaves::Little, "{seed}: {all:?}");
            // Without motion it cannot be told from it.
            assert_ne!(judged(Kind::Slow(0.8), 1.0, 0.0, seed).leaves(), Leaves::More, "{seed}");
        }
    }

    #[test]
    fn an_output_that_hardly_moved_tells_nothing_and_maneuvers_are_judged_together() {
        let small = judged(Kind::Slow(0.0), 0.0, 2.5, 1);
        assert_eq!(small.leaves(), Leaves::Unmoved, "{small:?}");
        // Missed by far more than that, it does.
        let y = noise(Kind::Slow(0.0), 1);
        let aside: Vec<f64> = y.iter().map(|y| y + 4.0).collect();
        assert!(Adequacy::of(&y, &aside).is_poor());
        // In one maneuver of four nothing is explained, of the same size.
        let mut all = judged(Kind::Slow(0.0), 1.0, 20.0, 1);
        all.add(&Adequacy::of(&motion().iter().map(|x| 20.0 * x).collect::<Vec<_>>(), &[0.0; N]));
        assert!(all.is_poor(), "{all:?}");
        assert_eq!(Adequacy::of(&[f64::NAN; 9], &[0.0; 9]).leaves(), Leaves::Unmoved);
        assert_eq!(Adequacy::default().leaves(), Leaves::Unmoved);
    }

    #[test]
    fn what_is_left_has_the_parts_of_theil_and_of_a_filter_its_noise() {
        let y = motion();
        let parts = |of: &dyn Fn(usize) -> f64| {
            Adequacy::of(&y, &(0..N).map(of).collect::<Vec<_>>()).parts()
        };
        assert!(parts(&|k| y[k] + 1.0)[0] > 0.99);
        assert!(
            parts(&|k| 0.5 * (y[k] - y.iter().sum::<f64>() / N as f64)
                + y.iter().sum::<f64>() / N as f64)[1]
                > 0.99
        );
        assert!(parts(&|k| y[(k + 60) % N])[2] > 0.9);
        let poor = judged(Kind::Slow(0.0), 0.0, 20.0, 3);
        assert!(
            poor.is_poor() && !poor.with_noise(1.1).is_poor() && poor.with_noise(15.0).is_poor()
        );
        assert!((poor.with_noise(15.0).left() - 15.0).abs() < 1e-9);
    }
}
