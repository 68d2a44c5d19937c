//! Finished estimations come in; the tables of their regressions on equations, and of the searches for
//! terms, go out.

use super::batch::{Batch, Done, per, segment};
use crate::error::Result;
use crate::estimate::regression::{Equation, Regressed, Regression};
use crate::estimate::{Row, Step};
use crate::table::Table;

pub fn regressions(model: &str, done: &[Done]) -> Result<Table> {
    let mut rows: Vec<(&Batch, &Row, &Regression, &Regressed)> = Vec::new();
    for (batch, e) in done {
        if let Some(regression) = &e.regression {
            rows.extend(
                regression
                    .rows
                    .iter()
                    .filter_map(|r| Some((*batch, e.rows.get(r.row)?, regression, r))),
            );
        }
    }
    let number = |of: fn(&Regressed) -> Option<f64>| {
        rows.iter().map(|(.., r)| of(r).unwrap_or(f64::NAN)).collect::<Vec<f64>>()
    };
    let condition = |r: &Regression| if r.condition.is_finite() { r.condition } else { f64::NAN };
    Table::build("regressions")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, ..)| &b.group))
        .opt_strings("segment", rows.iter().map(|(b, row, ..)| segment(b, row.segment)))
        .opt_strings("of", rows.iter().map(|(b, row, ..)| per(b, row).1))
        .strings("parameter", rows.iter().map(|(_, row, ..)| &row.name))
        .strings("unit", rows.iter().map(|(_, row, ..)| &row.unit))
        .strings("outcome", rows.iter().map(|(.., r)| r.outcome))
        .bools("taken", rows.iter().map(|(_, _, all, _)| all.taken).collect::<Vec<_>>())
        .f64("start", number(|r| Some(r.start)))
        .f64("value", number(|r| Some(r.value)))
        .f64("sd", number(|r| r.sd))
        .f64("sd_white", number(|r| r.sd_white))
        .f64("t", number(|r| r.sd.map(|sd| r.value / sd)))
        .f64("partial_f", number(|r| r.sd_white.map(|sd| (r.value / sd) * (r.value / sd))))
        .f64("p", number(Regressed::p))
        .f64("shift", number(|r| r.shift))
        .f64("condition", rows.iter().map(|(_, _, all, _)| condition(all)).collect::<Vec<_>>())
        .strings("stop", rows.iter().map(|(_, _, all, _)| all.stop.as_str()))
        .finish()
}

pub fn equations(model: &str, done: &[Done]) -> Result<Table> {
    let mut rows: Vec<(&Batch, &Equation)> = Vec::new();
    for (batch, e) in done {
        rows.extend(
            e.regression.iter().flat_map(|r| &r.equations).map(|equation| (*batch, equation)),
        );
    }
    let number = |of: fn(&Equation) -> f64| rows.iter().map(|(_, e)| of(e)).collect::<Vec<f64>>();
    Table::build("equations")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, _)| &b.group))
        .strings("equation", rows.iter().map(|(_, e)| &e.name))
        .strings("unit", rows.iter().map(|(_, e)| &e.unit))
        .strings("outcome", rows.iter().map(|(_, e)| &e.outcome))
        .i64("n", rows.iter().map(|(_, e)| e.n as i64).collect::<Vec<_>>())
        .f64("rms", number(|e| e.rms))
        .f64("r2", number(|e| e.r2))
        .i64("ar_order", rows.iter().map(|(_, e)| e.ar_order as i64).collect::<Vec<_>>())
        .finish()
}

pub fn searches(model: &str, done: &[Done]) -> Result<Table> {
    let rows: Vec<(&Batch, &Step)> =
        done.iter().flat_map(|(b, e)| e.searched.iter().map(move |step| (*b, step))).collect();
    let number = |of: fn(&Step) -> f64| rows.iter().map(|(_, s)| of(s)).collect::<Vec<f64>>();
    Table::build("searches")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, _)| &b.group))
        .strings("equation", rows.iter().map(|(_, s)| &s.equation))
        .strings("unit", rows.iter().map(|(_, s)| &s.unit))
        .i64("step", rows.iter().map(|(_, s)| s.step as i64).collect::<Vec<_>>())
        .strings("action", rows.iter().map(|(_, s)| s.action))
        .opt_strings("parameter", rows.iter().map(|(_, s)| s.parameter.as_ref()))
        .f64("partial_f", number(|s| s.partial_f))
        .f64("limit_f", number(|s| s.limit))
        .i64("terms", rows.iter().map(|(_, s)| s.terms as i64).collect::<Vec<_>>())
        .f64("pse", number(|s| s.pse))
        .f64("r2", number(|s| s.r2))
        .f64("s", number(|s| s.s))
        .bools("kept", rows.iter().map(|(_, s)| s.kept).collect::<Vec<_>>())
        .finish()
}
