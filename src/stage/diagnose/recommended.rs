//! What a diagnosis adds, and the estimates with it, in; the one value of each added parameter that
//! is to be used, out.
//!
//! A parameter has several values on its way: what the screening promises, the fit to the training
//! maneuvers with everything else in place, and the estimate that is run again over all maneuvers.
//! The last one is the best known where it converged and is one number: it has seen everything, by
//! the estimator that the pipeline uses. Else it is the fit's: where the pipeline estimates every
//! maneuver apart, or where its estimate did not converge.

use crate::error::Result;
use crate::table::Table;

/// A value that is to be used, and where it comes from.
struct Pick {
    value: f64,
    sd: f64,
    source: &'static str,
}

/// The table `recommended`: a row for each parameter of the effects that are named. `again`: the
/// estimates with them, if there are any.
///
/// # Errors
/// A table lacks a column.
pub fn values(diagnosis: &str, additions: &Table, again: Option<&Table>) -> Result<Table> {
    let (found, held, determined) =
        (additions.bools("found")?, additions.bools("held")?, additions.bools("determined")?);
    let (candidates, parameters) =
        (additions.strings("candidate")?, additions.strings("parameter")?);
    let (units, fitted, sds) =
        (additions.strings("unit")?, additions.f64("value")?, additions.f64("sd")?);
    let of = additions.opt_strings("of")?;
    let rows: Vec<usize> = (0..found.len()).filter(|&i| found[i] && !held[i]).collect();
    let pick = |&i: &usize| -> Result<Pick> {
        let estimated =
            again.map(|table| estimated(table, (parameters[i], of[i]))).transpose()?.flatten();
        let fit = match determined[i] {
            true => Pick { value: fitted[i], sd: sds[i], source: "fit to the training maneuvers" },
            false => Pick { value: fitted[i], sd: f64::NAN, source: "not determined" },
        };
        Ok(estimated.map_or(fit, |(value, sd)| Pick {
            value,
            sd,
            source: "estimate over all maneuvers",
        }))
    };
    let picks: Vec<Pick> = rows.iter().map(pick).collect::<Result<_>>()?;
    Table::build("recommended")
        .repeat("diagnosis", diagnosis)
        .strings("candidate", rows.iter().map(|&i| candidates[i]))
        .strings("parameter", rows.iter().map(|&i| parameters[i]))
        .opt_strings("of", rows.iter().map(|&i| of[i].map(str::to_string)))
        .strings("unit", rows.iter().map(|&i| units[i]))
        .f64("value", picks.iter().map(|p| p.value).collect::<Vec<_>>())
        .f64("sd", picks.iter().map(|p| p.sd).collect::<Vec<_>>())
        .strings("source", picks.iter().map(|p| p.source))
        .f64("fitted", rows.iter().map(|&i| fitted[i]).collect::<Vec<_>>())
        .f64("fitted_sd", rows.iter().map(|&i| sds[i]).collect::<Vec<_>>())
        .finish()
}

/// Value and sd of a parameter (of a flight, where it differs by flight) of which there is one converged
/// estimate: with the sd of the constants that the model assumes, where it has any.
fn estimated(table: &Table, parameter: (&str, Option<&str>)) -> Result<Option<(f64, f64)>> {
    let (names, stops) = (table.strings("parameter")?, table.strings("stop")?);
    let of = table.opt_strings("of")?;
    let (values, sds) = (table.f64("value")?, table.f64("sd")?);
    let totals = table.f64("sd_total")?;
    let mut mine = (0..names.len()).filter(|&i| (names[i], of[i]) == parameter);
    let (Some(i), None) = (mine.next(), mine.next()) else { return Ok(None) };
    let is_known = stops[i] == "converged" && values[i].is_finite() && sds[i].is_finite();
    let sd = if totals[i].is_finite() { totals[i] } else { sds[i] };
    Ok(is_known.then_some((values[i], sd)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A size, a shape (determined or not) and a switch.
    fn additions(arm: bool) -> Table {
        Table::build("additions")
            .repeat("diagnosis", "d")
            .i64("round", vec![2; 3])
            .repeat("candidate", "lag:eta")
            .repeat("standing", "chosen")
            .strings("parameter", ["size", "arm", "switch"])
            .opt_strings("of", [None::<String>, None, None])
            .opt_strings("held_in", [None::<String>, None, None])
            .strings("unit", ["-", "m", "-"])
            .f64("value", vec![0.3, 8.0, 1.0])
            .f64("sd", vec![0.01, 0.2, f64::NAN])
            .f64("null", vec![0.0, f64::NAN, 0.0])
            .bools("held", vec![false, false, true])
            .bools("determined", vec![true, arm, true])
            .bools("found", vec![true; 3])
            .bools("at_bound", vec![false; 3])
            .f64("expected", vec![f64::NAN; 3])
            .opt_strings("expected_from", [None::<String>, None, None])
            .finish()
            .expect("additions")
    }

    fn again(rows: &[(&str, &str, f64, &str)]) -> Table {
        let n = rows.len();
        let none = || vec![f64::NAN; n];
        Table::build("estimates")
            .repeat("model", "d.next")
            .strings("group", rows.iter().map(|r| r.0))
            .opt_strings("flight", vec![None::<String>; n])
            .opt_strings("segment", vec![None::<String>; n])
            .strings("parameter", rows.iter().map(|r| r.1))
            .repeat("per", "campaign")
            .opt_strings("of", vec![None::<String>; n])
            .repeat("unit", "-")
            .f64("value", rows.iter().map(|r| r.2).collect::<Vec<_>>())
            .f64("sd", vec![0.005; n])
            .f64("sd_crlb", none())
            .f64("sd_total", none())
            .f64("lower", none())
            .f64("upper", none())
            .opt_strings("interval", vec![None::<String>; n])
            .f64("start", none())
            .bools("at_bound", vec![false; n])
            .strings("stop", rows.iter().map(|r| r.3))
            .finish()
            .expect("estimates")
    }

    #[test]
    fn the_estimate_over_all_maneuvers_is_used_where_it_is_one_and_converged() {
        let of = |again: Option<&Table>| {
            let t = values("d", &additions(true), again).expect("values");
            let sources: Vec<String> = t
                .strings("source")
                .expect("column")
                .iter()
                .map(|s| s.chars().take(3).collect())
                .collect();
            (t.f64("value").expect("column").to_vec(), sources.join(" "))
        };
        assert_eq!(of(None), (vec![0.3, 8.0], "fit fit".to_string()));
        let one = again(&[("all", "size", 0.31, "converged"), ("all", "arm", 8.4, "converged")]);
        assert_eq!(of(Some(&one)), (vec![0.31, 8.4], "est est".to_string()));
        let limit = again(&[
            ("all", "size", 0.31, "iteration limit"),
            ("all", "arm", 8.4, "iteration limit"),
        ]);
        assert_eq!(of(Some(&limit)), (vec![0.3, 8.0], "fit fit".to_string()));
        let apart = again(&[
            ("a", "size", 0.31, "converged"),
            ("b", "size", 0.33, "converged"),
            ("a", "arm", 8.4, "converged"),
        ]);
        assert_eq!(of(Some(&apart)), (vec![0.3, 8.4], "fit est".to_string()));
        // What the flights do not determine is held in the amended model.
        let held =
            values("d", &additions(false), Some(&again(&[("all", "size", 0.31, "converged")])))
                .expect("values");
        assert_eq!(
            held.strings("source").expect("column"),
            ["estimate over all maneuvers", "not determined"]
        );
        assert!(held.f64("sd").expect("column")[1].is_nan());
    }
}
