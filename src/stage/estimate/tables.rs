//! Finished estimations come in, their tables go out.

use super::adequacy;
use super::batch::{Batch, Done, per, segment};
use super::config::Config;
use super::doubts;
use super::limits;
use super::regressions;
use super::uncertainty;
use crate::error::Result;
use crate::estimate::{Estimation, Iteration, Mode, Profile, Row, Trace};
use crate::noise::{Modelled, Whiteness, theil, whiteness};
use crate::table::Table;
use std::borrow::Cow;

/// The tables of one model's estimations.
pub fn all(config: &Config, done: &[Done]) -> Result<Vec<(&'static str, Table)>> {
    let model = &config.name();
    Ok(vec![
        ("estimates", estimates(model, done)?),
        ("correlations", correlations(model, done)?),
        ("separability", uncertainty::separability(model, done)?),
        ("budget", uncertainty::budget(model, done)?),
        ("profiles", uncertainty::profiles(model, done)?),
        ("doubts", doubts::table(config, done)?),
        ("regressions", regressions::regressions(model, done)?),
        ("equations", regressions::equations(model, done)?),
        ("searches", regressions::searches(model, done)?),
        ("modes", modes(model, done)?),
        ("iterations", iterations(model, done)?),
        ("residuals", residuals(model, done)?),
        ("adequacy", adequacy::table(model, done)?),
        ("reached", limits::reached(model, done)?),
        ("plateaus", limits::plateaus(model, done)?),
        ("responses", responses(model, done)?),
    ])
}

/// The one segment that a row is of: its own, or the only one of the batch.
fn of_segment<'a>(batch: &'a Batch, row: &Row) -> Option<&'a str> {
    match batch.segments.as_slice() {
        [only] => Some(only),
        _ => segment(batch, row.segment),
    }
}

/// The one flight whose segments a row is of; none where they are of several.
fn of_flight<'a>(batch: &'a Batch, row: &Row) -> Option<&'a str> {
    let holds = |s: &usize| match (row.segment, &row.group) {
        (Some(own), _) => own == *s,
        (None, Some(label)) => batch.labelled[*s].labels.get(&label.column) == Some(&label.value),
        (None, None) => true,
    };
    let mut flights = (0..batch.labelled.len())
        .filter(holds)
        .map(|s| batch.labelled[s].labels.get("flight").map(String::as_str));
    let first = flights.next()??;
    flights.all(|flight| flight == Some(first)).then_some(first)
}

fn estimates(model: &str, done: &[Done]) -> Result<Table> {
    let mut rows: Vec<_> =
        done.iter().flat_map(|(b, e)| e.rows.iter().map(move |row| (b, e, row))).collect();
    rows.sort_by_key(|(b, _, r)| (&b.group, &r.name, segment(b, r.segment), per(b, r).1));
    Table::build("estimates")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, _, _)| &b.group))
        .opt_strings("flight", rows.iter().map(|(b, _, r)| of_flight(b, r)))
        .opt_strings("segment", rows.iter().map(|(b, _, r)| of_segment(b, r)))
        .strings("parameter", rows.iter().map(|(_, _, r)| &r.name))
        .strings("per", rows.iter().map(|(b, _, r)| per(b, r).0))
        .opt_strings("of", rows.iter().map(|(b, _, r)| per(b, r).1))
        .strings("unit", rows.iter().map(|(_, _, r)| &r.unit))
        .f64("value", rows.iter().map(|(_, _, r)| r.value).collect::<Vec<_>>())
        .f64("sd", rows.iter().map(|(_, _, r)| r.sd.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .f64(
            "sd_crlb",
            rows.iter().map(|(_, _, r)| r.sd_crlb.unwrap_or(f64::NAN)).collect::<Vec<_>>(),
        )
        .f64(
            "sd_total",
            rows.iter().map(|(_, _, r)| r.sd_total.unwrap_or(f64::NAN)).collect::<Vec<_>>(),
        )
        .f64("lower", rows.iter().map(|(_, _, r)| r.lower.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .f64("upper", rows.iter().map(|(_, _, r)| r.upper.unwrap_or(f64::NAN)).collect::<Vec<_>>())
        .opt_strings("interval", rows.iter().map(|(_, e, r)| e.profile(r).map(Profile::words)))
        .f64("start", rows.iter().map(|(_, _, r)| r.start).collect::<Vec<_>>())
        .bools("at_bound", rows.iter().map(|(_, _, r)| r.at_bound).collect::<Vec<_>>())
        .strings("stop", rows.iter().map(|(_, e, _)| e.stop.as_str()))
        .finish()
}

fn correlations(model: &str, done: &[Done]) -> Result<Table> {
    let rows: Vec<_> = done
        .iter()
        .flat_map(|(b, e)| {
            e.correlations
                .iter()
                .filter_map(move |c| Some((b, e.rows.get(c.a)?, e.rows.get(c.b)?, *c)))
        })
        .filter(|(_, _, _, c)| c.value.is_finite())
        .collect();
    Table::build("correlations")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, ..)| &b.group))
        .strings("parameter", rows.iter().map(|(_, one, ..)| &one.name))
        .opt_strings("segment", rows.iter().map(|(b, one, ..)| segment(b, one.segment)))
        .opt_strings("of", rows.iter().map(|(b, one, ..)| per(b, one).1))
        .strings("other", rows.iter().map(|(_, _, other, _)| &other.name))
        .opt_strings("other_segment", rows.iter().map(|(b, _, other, _)| segment(b, other.segment)))
        .opt_strings("other_of", rows.iter().map(|(b, _, other, _)| per(b, other).1))
        .f64("value", rows.iter().map(|(.., c)| c.value).collect::<Vec<_>>())
        .f64("value_crlb", rows.iter().map(|(.., c)| c.crlb).collect::<Vec<_>>())
        .finish()
}

fn modes(model: &str, done: &[Done]) -> Result<Table> {
    let rows: Vec<(&Batch, &Mode)> =
        done.iter().flat_map(|(b, e)| e.modes.iter().map(move |mode| (*b, mode))).collect();
    let number = |of: fn(&Mode) -> f64| rows.iter().map(|(_, m)| of(m)).collect::<Vec<f64>>();
    let kind = |m: &Mode| match (m.imag.value > 0.0, m.real.value == 0.0) {
        (true, _) => "oscillation",
        (_, true) => "integrator",
        _ => "aperiodic",
    };
    Table::build("modes")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, _)| &b.group))
        .opt_strings("segment", rows.iter().map(|(b, m)| segment(b, m.segment)))
        .i64("number", rows.iter().map(|(_, m)| m.number as i64).collect::<Vec<_>>())
        .strings("kind", rows.iter().map(|(_, m)| kind(m)))
        .strings("states", rows.iter().map(|(_, m)| m.states.join(", ")))
        .f64("real", number(|m| m.real.value))
        .f64("real_sd", number(|m| m.real.sd))
        .f64("imag", number(|m| m.imag.value))
        .f64("imag_sd", number(|m| m.imag.sd))
        .f64("frequency", number(|m| m.frequency.value))
        .f64("frequency_sd", number(|m| m.frequency.sd))
        .f64("damping", number(|m| m.damping.value))
        .f64("damping_sd", number(|m| m.damping.sd))
        .f64("period", number(|m| m.period.value))
        .f64("period_sd", number(|m| m.period.sd))
        .f64("time_constant", number(|m| m.time_constant.value))
        .f64("time_constant_sd", number(|m| m.time_constant.sd))
        .finish()
}

fn iterations(model: &str, done: &[Done]) -> Result<Table> {
    let rows: Vec<_> =
        done.iter().flat_map(|(b, e)| e.iterations.iter().map(move |i| (b, i))).collect();
    let of =
        |value: fn(&Iteration) -> f64| rows.iter().map(|(_, i)| value(i)).collect::<Vec<f64>>();
    let after_start = |value: f64, i: &Iteration| if i.iteration == 0 { f64::NAN } else { value };
    Table::build("iterations")
        .repeat("model", model)
        .strings("group", rows.iter().map(|(b, _)| &b.group))
        .i64("iteration", rows.iter().map(|(_, i)| i.iteration as i64).collect::<Vec<_>>())
        .f64("cost", of(|i| i.cost))
        .f64("det_r", of(|i| i.det_r))
        .f64("change", rows.iter().map(|(_, i)| after_start(i.change, i)).collect::<Vec<_>>())
        .f64("step", rows.iter().map(|(_, i)| after_start(i.step, i)).collect::<Vec<_>>())
        .f64("gradient", of(|i| i.gradient))
        .i64("halvings", rows.iter().map(|(_, i)| i.halvings as i64).collect::<Vec<_>>())
        .f64("damping", of(|i| i.damping))
        .finish()
}

/// What is left of one output in one segment.
struct Left<'a> {
    batch: &'a Batch,
    segment: usize,
    trace: &'a Trace,
    estimation: &'a Estimation,
}

impl Left<'_> {
    fn values(&self) -> Vec<f64> {
        let both = self.trace.measured.iter().zip(&self.trace.modelled);
        both.map(|(z, y)| z - y).filter(|e| e.is_finite()).collect()
    }

    fn whiteness(&self) -> Whiteness {
        let both = self.trace.measured.iter().zip(&self.trace.modelled);
        let e: Vec<f64> =
            both.map(|(z, y)| z - y).map(|e| if e.is_finite() { e } else { f64::NAN }).collect();
        whiteness(&e)
    }
}

/// By group, segment and output.
fn traces<'a>(done: &'a [Done<'a>]) -> Vec<Left<'a>> {
    let mut all: Vec<Left> = Vec::new();
    for (batch, estimation) in done {
        for (segment, traces) in estimation.responses.iter().enumerate() {
            all.extend(traces.iter().map(|trace| Left { batch, segment, trace, estimation }));
        }
    }
    all.sort_by_key(|l| (&l.batch.group, segment(l.batch, Some(l.segment)), &l.trace.name));
    all
}

fn residuals(model: &str, done: &[Done]) -> Result<Table> {
    let rows = traces(done);
    let values: Vec<Vec<f64>> = rows.iter().map(Left::values).collect();
    let mean = |v: &Vec<f64>| v.iter().sum::<f64>() / v.len() as f64;
    let sd = |v: &Vec<f64>| {
        let m = mean(v);
        (v.iter().map(|e| (e - m) * (e - m)).sum::<f64>() / (v.len() as f64 - 1.0)).sqrt()
    };
    let rms = |v: &Vec<f64>| (v.iter().map(|e| e * e).sum::<f64>() / v.len() as f64).sqrt();
    let white: Vec<Whiteness> = rows.iter().map(Left::whiteness).collect();
    let colour: Vec<Option<&Modelled>> = rows
        .iter()
        .map(|l| l.estimation.scatter(l.segment, &l.trace.name)?.colour.as_ref())
        .collect();
    Table::build("residuals")
        .repeat("model", model)
        .strings("group", rows.iter().map(|l| &l.batch.group))
        .opt_strings("segment", rows.iter().map(|l| segment(l.batch, Some(l.segment))))
        .strings("output", rows.iter().map(|l| &l.trace.name))
        .strings("unit", rows.iter().map(|l| &l.trace.unit))
        .i64("n", values.iter().map(|v| v.len() as i64).collect::<Vec<_>>())
        .f64("mean", values.iter().map(mean).collect::<Vec<_>>())
        .f64("sd", values.iter().map(sd).collect::<Vec<_>>())
        .f64("rms", values.iter().map(rms).collect::<Vec<_>>())
        .f64(
            "theil",
            rows.iter()
                .map(|l| theil(&l.trace.measured, &l.trace.modelled).coefficient)
                .collect::<Vec<_>>(),
        )
        .f64("white_p", white.iter().map(|w| w.p).collect::<Vec<_>>())
        .f64("outside", white.iter().map(|w| w.outside).collect::<Vec<_>>())
        .opt_i64(
            "ar_order",
            colour.iter().map(|c| c.map(|c| c.model.order() as i64)).collect::<Vec<_>>(),
        )
        .f64(
            "colour",
            colour.iter().map(|c| c.map_or(f64::NAN, |c| c.model.colour())).collect::<Vec<_>>(),
        )
        .finish()
}

/// The free simulation beside a filter's predictions; none where there is no filter.
fn simulated(trace: &Trace) -> Cow<'_, [f64]> {
    match &trace.filtered {
        Some(filtered) => Cow::Borrowed(&filtered.simulated),
        None => Cow::Owned(vec![f64::NAN; trace.t.len()]),
    }
}

fn residual(trace: &Trace) -> Cow<'_, [f64]> {
    trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y).collect()
}

fn responses(model: &str, done: &[Done]) -> Result<Table> {
    let rows = traces(done);
    let samples = rows.iter().map(|l| l.trace.t.len()).sum();
    let each = |of: fn(&Trace) -> Cow<[f64]>| {
        let mut all = Vec::with_capacity(samples);
        rows.iter().for_each(|l| all.extend_from_slice(&of(l.trace)));
        all
    };
    let text = |of: for<'a> fn(&Left<'a>) -> &'a str| {
        rows.iter().flat_map(move |l| std::iter::repeat_n(of(l), l.trace.t.len()))
    };
    Table::build("responses")
        .repeat("model", model)
        .strings("group", text(|l| &l.batch.group))
        .strings("segment", text(|l| l.batch.segments.get(l.segment).map_or("", String::as_str)))
        .strings("output", text(|l| &l.trace.name))
        .strings("unit", text(|l| &l.trace.unit))
        .f64("t_s", each(|t| Cow::Borrowed(&t.t)))
        .f64("measured", each(|t| Cow::Borrowed(&t.measured)))
        .f64("modelled", each(|t| Cow::Borrowed(&t.modelled)))
        .f64("residual", each(residual))
        .f64("simulated", each(simulated))
        .finish()
}
