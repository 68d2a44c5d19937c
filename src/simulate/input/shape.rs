//! The signal of a maneuver: a time in, its value out.

use crate::math::interpolate::held;

/// The signal of one maneuver; time counts from its first step.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    Steps {
        /// Time, s, and size of each change of level; the last one leads back to 0.
        changes: Vec<(f64, f64)>,
        /// Duration of one edge, s; 0 is a jump.
        edge: f64,
    },
    Sines {
        /// Length, s; the signal is 0 outside.
        duration: f64,
        /// Frequency, rad/s, and phase, rad, of each term.
        terms: Vec<(f64, f64)>,
        /// Factor of the sum.
        factor: f64,
    },
    /// Straight lines between points; the signal is 0 outside.
    Lines {
        /// Ascending times, s, from 0 on.
        t: Vec<f64>,
        /// Values at these times.
        value: Vec<f64>,
    },
}

/// A mistake in a maneuver: the key it belongs to and what is wrong.
pub type Mistake = (&'static str, String);

impl Shape {
    /// Time from the first step until the signal is 0 again, s.
    pub fn duration(&self) -> f64 {
        match self {
            Shape::Steps { changes, edge } => changes.last().map_or(0.0, |c| c.0) + edge,
            Shape::Sines { duration, .. } => *duration,
            Shape::Lines { t, .. } => t.last().copied().unwrap_or_default(),
        }
    }

    /// Sign of the signal where it first leaves 0.
    pub fn polarity(&self) -> i8 {
        let first = match self {
            Shape::Steps { changes, .. } => changes.first().map(|c| c.1),
            Shape::Sines { factor, .. } => Some(*factor),
            Shape::Lines { value, .. } => value.iter().copied().find(|v| *v != 0.0),
        };
        if first.is_some_and(|x| x < 0.0) { -1 } else { 1 }
    }

    /// The signal at `t` seconds after the first step.
    pub fn value(&self, t: f64) -> f64 {
        // Grid times are products of an index: a step at a grid point must not be missed by a
        // rounding error.
        const SLACK: f64 = 1e-9;
        match self {
            Shape::Steps { changes, edge } => {
                let risen = |at: f64| {
                    if *edge > 0.0 {
                        ((t - at) / edge).clamp(0.0, 1.0)
                    } else {
                        f64::from(t >= at - SLACK)
                    }
                };
                changes.iter().map(|(at, change)| change * risen(*at)).sum()
            }
            Shape::Sines { duration, terms, factor } => {
                if !(0.0..=*duration).contains(&t) {
                    return 0.0;
                }
                factor
                    * terms.iter().map(|(omega, phase)| libm::sin(omega * t + phase)).sum::<f64>()
            }
            Shape::Lines { t: times, value } => {
                if !(-SLACK..self.duration() - SLACK).contains(&t) {
                    return 0.0;
                }
                held(times, value, t)
            }
        }
    }
}
