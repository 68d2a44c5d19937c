//! `findings`, `additions`, `next_models` and `estimates` in; every value that an added parameter has, and the one to use, out.

use super::columns::Columns;
use super::format::{bracketed, number, plus_minus};
use super::grid::{Cell, Grid, Level};
use std::collections::BTreeMap;

/// Tables that are looked at.
pub struct Sources<'a> {
    pub findings: Option<&'a Columns>,
    pub additions: Option<&'a Columns>,
    pub next_models: Option<&'a Columns>,
    pub estimates: Option<&'a Columns>,
}

/// Their names.
pub const TABLES: [&str; 4] = ["findings", "additions", "next_models", "estimates"];

impl<'a> Sources<'a> {
    pub fn of(get: impl Fn(&str) -> Option<&'a Columns>) -> Self {
        let [findings, additions, next_models, estimates] = TABLES.map(get);
        Sources { findings, additions, next_models, estimates }
    }
}

/// One parameter that a diagnosis added to its model.
#[derive(Debug, Clone, PartialEq)]
pub struct Added {
    pub diagnosis: String,
    pub candidate: String,
    pub parameter: String,
    pub unit: String,
    /// Value and sd of the round that tested the effect: training maneuvers only, later additions not yet there.
    pub tested: [f64; 2],
    /// Where the amended model file starts: training maneuvers, all additions together. NaN where no file was written.
    pub start: f64,
    /// The flights do not determine it: the amended model holds it where it starts.
    pub fixed: bool,
    /// Value and sd of the estimate with the amended model, all maneuvers, the pipeline's own method; and how it ended.
    pub again: Option<([f64; 2], String)>,
}

impl Added {
    /// Whether the estimate with the amended model can be used.
    fn is_estimated(&self) -> bool {
        self.again.as_ref().is_some_and(|([value, _], stop)| value.is_finite() && stop == "converged")
    }

    /// The value to use and its sd: estimated again where that converged, else as it was found.
    pub fn used(&self) -> [f64; 2] {
        match &self.again {
            _ if self.fixed => [self.start, f64::NAN],
            Some((found, _)) if self.is_estimated() => *found,
            _ => self.tested,
        }
    }

    /// `tau = 0.12 ± 0.01 [s]`
    pub fn words(&self) -> String {
        let held = if self.fixed { ", held" } else { "" };
        format!("{} = {}{}{held}", self.parameter, self.value(), bracketed(&self.unit))
    }

    /// The value to use, with its interval.
    fn value(&self) -> String {
        let [value, sd] = self.used();
        if self.fixed { number(value, 3) } else { plus_minus(value, sd) }
    }

    /// Where the value to use comes from.
    pub fn source(&self) -> &'static str {
        match &self.again {
            _ if self.fixed => "held in the amended model: the flights do not determine it",
            _ if self.is_estimated() => "estimated with all maneuvers",
            Some(_) => "from its test: the estimate with all maneuvers did not converge",
            None => "from its test: it was not estimated again",
        }
    }
}

/// Parameters of what was added, diagnosis by diagnosis, in the order of the findings; without those that are held.
pub fn added(from: &Sources) -> Vec<Added> {
    let (Some(findings), Some(additions)) = (from.findings, from.additions) else { return Vec::new() };
    let mut all = Vec::new();
    for row in (0..findings.rows()).filter(|&r| findings.text("role", r) == "added") {
        let key = ["diagnosis", "round", "candidate"].map(|c| findings.text(c, row));
        let same = |r: &usize| ["diagnosis", "round", "candidate"].map(|c| additions.text(c, *r)) == key;
        let free = |r: &usize| additions.flag("held", *r) != Some(true);
        let [diagnosis, _, candidate] = key.clone();
        let starts = from.next_models.map(|t| starts(t, &diagnosis)).unwrap_or_default();
        for r in (0..additions.rows()).filter(same).filter(free) {
            let parameter = additions.text("parameter", r);
            all.push(Added {
                diagnosis: diagnosis.clone(),
                candidate: candidate.clone(),
                unit: additions.unit_in("unit", r),
                tested: [additions.number("value", r), additions.number("sd", r)],
                start: starts.get(&parameter).map_or(f64::NAN, |s| s.0),
                fixed: starts.get(&parameter).is_some_and(|s| s.1),
                again: from.next_models.zip(from.estimates).and_then(|(next, t)| again(next, t, &diagnosis, &parameter)),
                parameter,
            });
        }
    }
    all
}

/// Starting values of the blocks that an amended model file has behind the model's own lines, and whether they are held.
fn starts(next_models: &Columns, diagnosis: &str) -> BTreeMap<String, (f64, bool)> {
    let mut starts = BTreeMap::new();
    for row in (0..next_models.rows()).filter(|&r| next_models.text("diagnosis", r) == diagnosis) {
        let Ok(lines) = next_models.text("added", row).parse::<toml::Table>() else { continue };
        let blocks = lines.get("effect").and_then(toml::Value::as_array).into_iter().flatten();
        for (name, of) in blocks.filter_map(|b| b.get("parameters")?.as_table()).flatten() {
            if let Some(start) = of.get("start").and_then(|v| v.as_float().or(v.as_integer().map(|i| i as f64))) {
                let fixed = of.get("fixed").and_then(toml::Value::as_bool).unwrap_or(false);
                starts.insert(name.clone(), (start, fixed));
            }
        }
    }
    starts
}

/// The one estimate of a parameter with the amended model; none where there is none, or one per maneuver.
fn again(next_models: &Columns, estimates: &Columns, diagnosis: &str, parameter: &str) -> Option<([f64; 2], String)> {
    let row = (0..next_models.rows()).find(|&r| next_models.text("diagnosis", r) == diagnosis)?;
    let next = next_models.text("next", row);
    let mut rows =
        (0..estimates.rows()).filter(|&r| estimates.text("model", r) == next && estimates.text("parameter", r) == parameter);
    let row = rows.next()?;
    rows.next().is_none().then(|| ([estimates.number("value", row), estimates.number("sd", row)], estimates.text("stop", row)))
}

/// All values side by side.
pub fn table(from: &Sources) -> Grid {
    let columns = [
        "diagnosis",
        "effect",
        "parameter",
        "#in its test",
        "#start of the|amended model",
        "#estimated|with it",
        "#to use",
        "~because",
    ];
    let mut grid = Grid::new(columns);
    for a in added(from) {
        let pale = |text: String| Cell::new(text).level(Level::Dim);
        let again = match &a.again {
            Some(([value, sd], stop)) if stop == "converged" => plus_minus(*value, *sd),
            Some((_, stop)) => stop.clone(),
            None => String::new(),
        };
        grid.push(vec![
            Cell::new(&a.diagnosis),
            Cell::new(&a.candidate),
            Cell::new(&a.parameter).sub(&a.unit),
            pale(plus_minus(a.tested[0], a.tested[1])),
            pale(if a.start.is_finite() { number(a.start, 4) } else { String::new() }),
            pale(again),
            Cell::new(a.value()).level(Level::Good),
            Cell::new(a.source()),
        ]);
    }
    grid.note = Some(
        "The value of the test is evidence: training maneuvers only, with what had been added by then; findings and the console quote it. \
         The amended model starts at the fit of everything added to the training maneuvers. Estimated with it is what the pipeline's own \
         method makes of all maneuvers: the one to use where it converged."
            .into(),
    );
    grid.or_missing("Nothing was added.")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    const LINES: &str = r#"# found
[[effect]]
title = "t"

[effect.parameters]
tau = { unit = "s", start = 0.115 }
depth = { unit = "s", start = 3.5, fixed = true }
"#;

    fn tables(stop: &str) -> [Columns; 4] {
        let findings = Table::build("findings")
            .repeat("diagnosis", "d")
            .repeat("model", "m")
            .i64("number", [0, 1])
            .repeat("verdict", "named")
            .bools("complete", [true, true])
            .opt_i64("round", [None, Some(2)])
            .opt_strings("candidate", [None, Some("lag")])
            .opt_strings("effect", [None, Some("lag")])
            .opt_strings("family", [None, Some("actuator")])
            .opt_strings("role", [None, Some("added")])
            .f64("gain", [f64::NAN, 40.0])
            .f64("limit", [8.0, 8.0])
            .f64("held_out_predicted", [f64::NAN, 20.0])
            .f64("held_out_realised", [f64::NAN, 19.0])
            .strings("text", ["The model lacks something.", "lag: tau"])
            .repeat("held_out", "b1")
            .finish();
        let additions = Table::build("additions")
            .repeat("diagnosis", "d")
            .i64("round", [1, 2, 2])
            .repeat("candidate", "lag")
            .repeat("standing", "chosen")
            .strings("parameter", ["tau", "tau", "depth"])
            .repeat("unit", "s")
            .f64("value", [0.5, 0.11, 1.0])
            .f64("sd", [0.1, 0.01, f64::NAN])
            .f64("null", [0.0; 3])
            .bools("held", [false; 3])
            .bools("at_bound", [false; 3])
            .f64("expected", [f64::NAN; 3])
            .opt_strings("expected_from", [None::<&str>; 3])
            .finish();
        let next = Table::build("next_models")
            .repeat("diagnosis", "d")
            .repeat("estimate", "m")
            .repeat("next", "d.next")
            .strings("added", [LINES])
            .finish();
        let estimates = Table::build("estimates")
            .strings("model", ["m", "d.next"])
            .repeat("group", "all")
            .opt_strings("segment", [None::<&str>; 2])
            .strings("parameter", ["K", "tau"])
            .repeat("per", "campaign")
            .opt_strings("of", [None::<&str>; 2])
            .repeat("unit", "s")
            .f64("value", [1.0, 0.12])
            .f64("sd", [0.1, 0.005])
            .f64("sd_crlb", [0.1, 0.005])
            .f64("sd_total", [0.1, 0.005])
            .f64("lower", [f64::NAN; 2])
            .f64("upper", [f64::NAN; 2])
            .opt_strings("interval", [None::<&str>; 2])
            .f64("start", [1.0, 0.115])
            .bools("at_bound", [false; 2])
            .strings("stop", ["converged", stop])
            .finish();
        [findings, additions, next, estimates].map(|t| Columns::of(&t.expect("a table")))
    }

    fn only(stop: &str) -> Added {
        let [findings, additions, next, estimates] = tables(stop);
        let all = [("findings", &findings), ("additions", &additions), ("next_models", &next), ("estimates", &estimates)];
        let from = Sources::of(|table| all.iter().find(|(name, _)| *name == table).map(|(_, t)| *t));
        let all = added(&from);
        assert_eq!(all.len(), 2, "another round's are not told: {all:?}");
        assert_eq!(all[1].words(), "depth = 3.50 [s], held");
        all[0].clone()
    }

    #[test]
    fn the_value_to_use_is_the_one_of_all_maneuvers_where_that_converged() {
        let tau = only("converged");
        assert_eq!((tau.tested, tau.start, tau.used()), ([0.11, 0.01], 0.115, [0.12, 0.005]));
        assert_eq!(tau.words(), "tau = 0.1200 ± 0.0098 [s]");
        let tau = only("singular");
        assert_eq!(tau.used(), [0.11, 0.01]);
        assert!(tau.source().contains("did not converge"));
    }
}
