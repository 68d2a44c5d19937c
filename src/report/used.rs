//! The table `recommended` in; every value that an added parameter has, and the one to use, out.

use super::columns::Columns;
use super::format::{bracketed, number, plus_minus};
use super::grid::{Cell, Grid, Level};

/// One parameter that a diagnosis added to its model.
#[derive(Debug, Clone, PartialEq)]
pub struct Added {
    pub diagnosis: String,
    pub candidate: String,
    /// With the flight that it is of, where it differs by flight.
    parameter: String,
    unit: String,
    /// Value and sd of the fit to the training maneuvers.
    fitted: [f64; 2],
    /// Value and sd to use; without sd where the flights do not determine it.
    used: [f64; 2],
    pub source: String,
}

impl Added {
    pub fn is_determined(&self) -> bool {
        self.used[1].is_finite()
    }

    /// `tau = 0.12 ± 0.01 [s]`
    pub fn words(&self) -> String {
        format!("{} = {}{}", self.parameter, self.value(), bracketed(&self.unit))
    }

    fn value(&self) -> String {
        let [value, sd] = self.used;
        if self.is_determined() {
            plus_minus(value, sd)
        } else {
            format!("not determined, best at {}", number(value, 3))
        }
    }
}

/// Parameters of what was added, in the order of the table. The estimate with the amended model
/// writes its rows behind those of the diagnosis: the last row of a parameter is the one.
pub fn added(recommended: Option<&Columns>) -> Vec<Added> {
    let Some(table) = recommended else { return Vec::new() };
    let mut all: Vec<Added> = Vec::new();
    for row in 0..table.rows() {
        let of = table.text("of", row);
        let of = if of.is_empty() { of } else { format!(" in {of}") };
        let one = Added {
            diagnosis: table.text("diagnosis", row),
            candidate: table.text("candidate", row),
            parameter: table.text("parameter", row) + &of,
            unit: table.unit_in("unit", row),
            fitted: [table.number("fitted", row), table.number("fitted_sd", row)],
            used: [table.number("value", row), table.number("sd", row)],
            source: table.text("source", row),
        };
        let same = |a: &&mut Added| {
            (&a.diagnosis, &a.candidate, &a.parameter)
                == (&one.diagnosis, &one.candidate, &one.parameter)
        };
        match all.iter_mut().find(same) {
            Some(earlier) => *earlier = one,
            None => all.push(one),
        }
    }
    all
}

/// All values side by side.
pub fn table(recommended: Option<&Columns>) -> Grid {
    let mut grid = Grid::new([
        "diagnosis",
        "effect",
        "parameter",
        "#fit to training|maneuvers",
        "#to use",
        "~which is the",
    ]);
    for a in added(recommended) {
        grid.push(vec![
            Cell::new(&a.diagnosis),
            Cell::new(&a.candidate),
            Cell::new(&a.parameter).under(&a.unit),
            Cell::new(plus_minus(a.fitted[0], a.fitted[1])).level(Level::Dim),
            Cell::new(a.value()).level(if a.is_determined() { Level::Good } else { Level::Dim }),
            Cell::new(&a.source),
        ]);
    }
    grid.note = Some(
        "The fit is to the training maneuvers, with everything that was added in place: the amended model file starts there. The estimate over all \
         maneuvers is what the pipeline's own method makes of the amended model: the one to use where it converged and is one value. Findings quote \
         the value of each effect's own test, when not everything had been added: that is evidence, not a result."
            .into(),
    );
    grid.or_missing("No effect is trusted enough for a value of it to be used.")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    #[test]
    fn the_value_to_use_is_the_last_one_written() {
        let table = Table::build("recommended")
            .repeat("diagnosis", "d")
            .repeat("candidate", "lag")
            .strings("parameter", ["tau", "depth", "tau"])
            .opt_strings("of", [None, Some("f3"), None])
            .repeat("unit", "s")
            .f64("value", [0.11, 3.5, 0.12])
            .f64("sd", [0.01, f64::NAN, 0.005])
            .strings(
                "source",
                ["fit to the training maneuvers", "not determined", "estimate over all maneuvers"],
            )
            .f64("fitted", [0.11, 3.5, 0.11])
            .f64("fitted_sd", [0.01, f64::NAN, 0.01])
            .finish();
        let all = added(Some(&Columns::of(&table.expect("a table"))));
        assert_eq!(all.len(), 2);
        assert_eq!(
            (all[0].words(), all[0].source.as_str()),
            ("tau = 0.1200 ± 0.0098 [s]".into(), "estimate over all maneuvers")
        );
        assert_eq!(all[1].words(), "depth in f3 = not determined, best at 3.50 [s]");
    }
}
