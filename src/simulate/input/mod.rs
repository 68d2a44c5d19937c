//! A maneuver's description in, its signal over time out: multisteps, multisines, profiles and
//! sweeps.

mod keys;
mod lines;
mod multisine;
mod multistep;
mod shape;

use super::settings::Maneuver;

pub use shape::{Mistake, Shape};

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
}

/// The largest absolute value of a maneuver's signal, in the input's unit.
pub(super) fn amplitude(maneuver: &Maneuver) -> f64 {
    let steps = maneuver.amplitudes.iter().flatten();
    let all = maneuver.amplitude.iter().chain(steps).chain(maneuver.values.iter().flatten());
    all.fold(0.0, |largest, x| largest.max(x.abs()))
}

#[cfg(test)]
mod tests;
