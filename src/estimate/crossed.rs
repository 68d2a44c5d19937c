//! A case and a parameter vector in; limits of its states that cross each other somewhere that was flown, out.

use super::case::Case;
use super::watched::{conditions, watched};
use crate::error::{Error, Errors, Result};

impl Case {
    /// In words, where the lower limit of a state is above the upper one at `theta`: one sentence per state, about the
    /// place where it is so most.
    ///
    /// # Errors
    /// Start values that depend on each other.
    pub fn crossed(&self, theta: &[f64]) -> Result<Vec<String>> {
        let (model, watches) = watched(&self.model);
        if watches.is_empty() {
            return Ok(Vec::new());
        }
        let (seen, told) =
            (self.seen_all(&model, &watches, theta)?, conditions(&self.model, &watches));
        let place = |state: usize, limit: &str| {
            watches.iter().position(|w| w.state == state && w.limit == limit)
        };
        let mut all = Vec::new();
        for state in 0..self.model.states.len() {
            let (Some(low), Some(high)) = (place(state, "min"), place(state, "max")) else {
                continue;
            };
            let grid = |s: usize| 0..seen[s][low].bound.len();
            let at = |&(s, k): &(usize, usize)| [seen[s][low].bound[k], seen[s][high].bound[k]];
            let over = |place: &(usize, usize)| at(place)[0] - at(place)[1];
            let places = (0..seen.len()).flat_map(|s| grid(s).map(move |k| (s, k)));
            let worst = places.filter(|p| over(p) > 0.0).max_by(|a, b| over(a).total_cmp(&over(b)));
            let Some(worst) = worst else { continue };
            let quantity = &self.model.states[state].quantity;
            let input = |&j: &usize| {
                let input = &self.model.inputs[j];
                format!("{} = {:.4} {}", input.name, self.driven(worst.0, worst.1, j), input.unit)
            };
            let [min, max] = at(&worst);
            let inputs: Vec<String> = told.iter().map(input).collect();
            let inputs = if inputs.is_empty() {
                String::new()
            } else {
                format!(" at {}", inputs.join(", "))
            };
            all.push(format!(
                "the limits of {} cross: min {min:.4} {unit} is above max {max:.4} {unit}{inputs}",
                quantity.name,
                unit = quantity.unit
            ));
        }
        Ok(all)
    }

    /// Refuses starts with which limits cross.
    ///
    /// # Errors
    /// Limits that cross at the start values, all of them.
    pub fn check_limits(&self) -> std::result::Result<(), Errors> {
        let mut errors = Errors::default();
        for crossed in self.crossed(&self.layout.start)? {
            let what = format!("{crossed}, at the starts of model {}", self.model.name);
            let help = "give starts that leave room between the limits at every condition flown";
            errors.push(Error::new(what).help(help));
        }
        errors.or(())
    }
}
