//! A case and the result of a regression on its equations in; the case at the better of its two
//! starts out.

use super::case::Case;
use super::regression::{Regression, regress};
use super::{Settings, StartFrom};
use crate::error::Result;
use crate::least_squares::cost;

impl Case {
    /// Starts from the result of a regression on the equations, if the settings ask for it and it
    /// fits better.
    ///
    /// # Errors
    /// A grid that cannot be smoothed.
    pub fn start_by_regression(&mut self, settings: &Settings) -> Result<Option<Regression>> {
        // The regression knows nothing of lines.
        if settings.start == StartFrom::Model || !self.chosen.lines.is_empty() {
            return Ok(None);
        }
        let (mut regression, theta) = regress(self, settings)?;
        let evaluate =
            |s: usize, local: &[f64], sensitivities: bool| self.evaluate(s, local, sensitivities);
        let [given, found] =
            [&self.layout.start, &theta].map(|theta| cost(&self.layout, &evaluate, theta));
        regression.taken = found.is_some_and(|found| given.is_none_or(|given| found <= given));
        if regression.taken {
            self.layout.start = theta;
        }
        Ok(Some(regression))
    }
}
