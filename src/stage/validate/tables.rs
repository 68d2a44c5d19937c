//! Validated maneuvers come in, their tables go out.

use super::judge::{Agreement, Driven, Output};
use super::proof::Judged;
use super::settings::Settings;
use super::tolerances::Checked;
use super::validated::{Validated, Value};
use crate::error::Result;
use crate::table::Table;

/// The tables of one validation.
pub fn all(
    settings: &Settings,
    model: &str,
    all: &[Checked],
    done: &[Validated],
) -> Result<Vec<(&'static str, Table)>> {
    let mut rows: Vec<(&Validated, &Output, Option<&Agreement>)> = done
        .iter()
        .flat_map(|one| one.outputs.iter().map(move |(o, a)| (one, o, a.as_ref())))
        .collect();
    rows.sort_by_key(|(one, output, _)| (&one.segment, &output.name));
    let number = |of: &dyn Fn(&Agreement) -> f64| -> Vec<f64> {
        rows.iter().map(|(.., a)| a.map_or(f64::NAN, of)).collect()
    };
    let verdict = |a: Option<&Agreement>| {
        a.map_or("nothing was measured".into(), |a| a.verdict(settings.within, settings.theil))
    };
    let validation = Table::build("validation")
        .repeat("validation", &settings.name())
        .repeat("model", model)
        .strings("flight", rows.iter().map(|(one, ..)| &one.flight))
        .strings("segment", rows.iter().map(|(one, ..)| &one.segment))
        .opt_strings(
            "input",
            rows.iter().map(|(one, ..)| Some(one.input.as_str()).filter(|s| !s.is_empty())),
        )
        .opt_strings(
            "kind",
            rows.iter().map(|(one, ..)| Some(one.kind.as_str()).filter(|s| !s.is_empty())),
        )
        .strings("output", rows.iter().map(|(_, output, _)| &output.name))
        .strings("unit", rows.iter().map(|(_, output, _)| &output.unit))
        .i64("n", rows.iter().map(|(.., a)| a.map_or(0, |a| a.n as i64)).collect::<Vec<_>>())
        .f64("rms", number(&|a| a.rms))
        .f64("fit", number(&|a| a.fit))
        .f64("theil", number(&|a| a.theil.coefficient))
        .f64("theil_bias", number(&|a| a.theil.bias))
        .f64("theil_variance", number(&|a| a.theil.variance))
        .f64("theil_covariance", number(&|a| a.theil.covariance))
        .f64("largest", number(&|a| a.largest))
        .f64("largest_at_s", number(&|a| a.largest_at))
        .f64("noise_sd", number(&|a| a.noise_sd))
        .f64("carried_sd", number(&|a| a.carried_sd))
        .f64("band", number(&|a| a.band))
        .f64("within", number(&|a| a.within))
        .bools("beyond", rows.iter().map(|(one, ..)| !one.beyond.is_empty()).collect::<Vec<_>>())
        .f64("outside", rows.iter().map(|(one, ..)| one.outside).collect::<Vec<_>>())
        .strings("verdict", rows.iter().map(|(.., a)| verdict(*a)))
        .f64("r_sd", number(&|a| a.r_sd))
        .f64("smoothed", number(&|a| a.smoothed))
        .opt_strings(
            "noise_verdict",
            rows.iter().map(|(.., a)| a.and_then(Agreement::noise_verdict)),
        )
        .opt_strings(
            "followed",
            rows.iter().map(|(one, ..)| Some(one.followed.as_str()).filter(|s| !s.is_empty())),
        )
        .f64("driven_sd", number(&|a| a.driven_sd))
        .finish()?;
    let samples: Vec<(&Validated, &Output, usize)> = rows
        .iter()
        .flat_map(|(one, output, _)| (0..output.t.len()).map(move |k| (*one, *output, k)))
        .collect();
    let sample = |of: fn(&Output) -> &Vec<f64>| -> Vec<f64> {
        samples.iter().map(|(_, output, k)| of(output)[*k]).collect()
    };
    let driven = |of: fn(&Driven) -> &Vec<f64>| -> Vec<f64> {
        let value = |output: &Output, k: usize| {
            output.driven.as_ref().map_or(f64::NAN, |driven| of(driven)[k])
        };
        samples.iter().map(|(_, output, k)| value(output, *k)).collect()
    };
    let traces = Table::build("validation_traces")
        .repeat("validation", &settings.name())
        .strings("segment", samples.iter().map(|(one, ..)| &one.segment))
        .strings("output", samples.iter().map(|(_, output, _)| &output.name))
        .strings("unit", samples.iter().map(|(_, output, _)| &output.unit))
        .f64("t_s", sample(|o| &o.t))
        .f64("measured", sample(|o| &o.measured))
        .f64("modelled", sample(|o| &o.modelled))
        .f64("carried_sd", sample(|o| &o.carried_sd))
        .f64("band", sample(|o| &o.band))
        .bools("beyond", samples.iter().map(|(_, output, k)| output.beyond[*k]).collect::<Vec<_>>())
        .f64("driven_sd", driven(|d| &d.sd))
        .f64("ahead", driven(|d| &d.ahead))
        .f64("ahead_sd", driven(|d| &d.ahead_sd))
        .finish()?;
    Ok(vec![
        ("validation", validation),
        ("validation_traces", traces),
        ("validation_values", values(&settings.name(), model, done)?),
        ("tolerances", tolerances(&settings.name(), all, done)?),
    ])
}

/// One row per maneuver and value of its run.
fn values(name: &str, model: &str, done: &[Validated]) -> Result<Table> {
    let mut rows: Vec<(&Validated, &Value)> =
        done.iter().flat_map(|one| one.values.iter().map(move |value| (one, value))).collect();
    rows.sort_by_key(|(one, value)| (&one.segment, &value.name));
    Table::build("validation_values")
        .repeat("validation", name)
        .repeat("model", model)
        .strings("flight", rows.iter().map(|(one, _)| &one.flight))
        .strings("segment", rows.iter().map(|(one, _)| &one.segment))
        .strings("parameter", rows.iter().map(|(_, value)| &value.name))
        .strings("unit", rows.iter().map(|(_, value)| &value.unit))
        .f64("value", rows.iter().map(|(_, value)| value.value).collect::<Vec<_>>())
        .f64("sd", rows.iter().map(|(_, value)| value.sd).collect::<Vec<_>>())
        .strings("source", rows.iter().map(|(_, value)| value.source))
        .finish()
}

/// One row per maneuver and tolerance that is for it.
fn tolerances(name: &str, all: &[Checked], done: &[Validated]) -> Result<Table> {
    let mut rows: Vec<(&Validated, &Judged, &Checked)> = done
        .iter()
        .flat_map(|one| one.judged.iter().map(move |j| (one, j, &all[j.place])))
        .collect();
    rows.sort_by_key(|(one, j, c)| (&one.segment, &c.told.test, &c.told.output, j.place));
    let number =
        |of: &dyn Fn(&Judged) -> f64| -> Vec<f64> { rows.iter().map(|(_, j, _)| of(j)).collect() };
    Table::build("tolerances")
        .repeat("validation", name)
        .strings("flight", rows.iter().map(|(one, ..)| &one.flight))
        .strings("segment", rows.iter().map(|(one, ..)| &one.segment))
        .strings("test", rows.iter().map(|(.., c)| &c.told.test))
        .opt_strings("group", rows.iter().map(|(.., c)| c.told.group.as_deref()))
        .strings("output", rows.iter().map(|(.., c)| &c.told.output))
        .strings("of", rows.iter().map(|(.., c)| c.told.of.as_str()))
        .strings("unit", rows.iter().map(|(.., c)| &c.unit))
        .f64("measured", number(&|j| j.measured))
        .f64("modelled", number(&|j| j.modelled))
        .f64("error", number(&|j| j.error))
        .f64("tolerance", number(&|j| j.allowed))
        .f64("used", number(&|j| j.error / j.allowed))
        .strings("verdict", rows.iter().map(|(_, j, _)| j.verdict.as_str()))
        .strings("group_verdict", rows.iter().map(|(_, j, _)| j.group.as_str()))
        .opt_strings("why", rows.iter().map(|(_, j, _)| j.why.as_deref()))
        .finish()
}
