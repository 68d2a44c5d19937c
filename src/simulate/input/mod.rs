//! A maneuver's description in, its signal over time out: multisteps, multisines, profiles and
//! sweeps.

mod keys;
mod lines;
mod multisine;
mod multistep;

use super::settings::Maneuver;
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
    /// The signal that `maneuver` describes.
    ///
    /// # Errors
    /// Every key that does not fit.
    pub fn of(maneuver: &Maneuver) -> Result<Shape, Vec<Mistake>> {
        let mut mistakes = Vec::new();
        if maneuver.polarity.abs() != 1 {
            mistakes.push((
                "polarity",
                format!("the polarity must be 1 or -1, not {}", maneuver.polarity),
            ));
        }
        let shape = match (maneuver.kind.as_str(), multistep::digits(&maneuver.kind)) {
            ("multisine", _) => multisine::shape(maneuver, &mut mistakes),
            ("profile", _) => lines::profile(maneuver, &mut mistakes),
            ("sweep", _) => lines::sweep(maneuver, &mut mistakes),
            (_, Some(digits)) => multistep::shape(maneuver, &digits, &mut mistakes),
            (other, None) => {
                let what = format!(
                    "\"{other}\" is no kind of maneuver: digits such as \"3211\", \"doublet\", \"step\", \"multisine\", \"profile\" or \"sweep\" are"
                );
                mistakes.push(("kind", what));
                None
            }
        };
        shape.filter(|_| mistakes.is_empty()).ok_or(mistakes)
    }

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

/// The largest absolute value of a maneuver's signal, in the input's unit.
pub(super) fn amplitude(maneuver: &Maneuver) -> f64 {
    let steps = maneuver.amplitudes.iter().flatten();
    let all = maneuver.amplitude.iter().chain(steps).chain(maneuver.values.iter().flatten());
    all.fold(0.0, |largest, x| largest.max(x.abs()))
}

#[cfg(test)]
mod tests;
