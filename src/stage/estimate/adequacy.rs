//! Finished estimations come in; whether each output's residual is its sensor's noise, flight by
//! flight, goes out.

use super::batch::Done;
use crate::error::Result;
use crate::estimate::{Estimation, Trace};
use crate::signal::adequacy::Adequacy;
use crate::table::Table;

/// One output over all maneuvers of a flight.
struct Judged<'a> {
    flight: &'a str,
    output: &'a str,
    unit: &'a str,
    all: Adequacy,
}

/// What one maneuver leaves of an output. Where a filter predicts it from the samples before, its
/// noise as the filter has it.
fn of(estimation: &Estimation, segment: usize, trace: &Trace) -> Adequacy {
    let found = Adequacy::of(&trace.measured, &trace.modelled);
    let found = trace.noise.map_or(found, |sd| found.with_sensor(sd));
    match (trace.filtered.is_none(), estimation.scatter(segment, &trace.name)) {
        (false, Some(scatter)) => found.with_noise(scatter.r.sqrt()),
        _ => found,
    }
}

/// The table `adequacy` of one model.
pub fn table(model: &str, done: &[Done]) -> Result<Table> {
    let mut all: Vec<Judged> = Vec::new();
    for (batch, estimation) in done {
        for (segment, traces) in estimation.responses.iter().enumerate() {
            let flight = batch.flights[segment].as_str();
            for trace in traces {
                let one = of(estimation, segment, trace);
                let same = |j: &&mut Judged| j.flight == flight && j.output == trace.name;
                match all.iter_mut().rev().find(same) {
                    Some(judged) => judged.all.add(&one),
                    None => {
                        let (output, unit) = (&trace.name, &trace.unit);
                        all.push(Judged { flight, output, unit, all: one });
                    }
                }
            }
        }
    }
    all.sort_by_key(|j| (j.flight, j.output));
    let number = |of: &dyn Fn(&Adequacy) -> f64| {
        let finite = |v: f64| if v.is_finite() { v } else { f64::NAN };
        all.iter().map(|j| finite(of(&j.all))).collect::<Vec<f64>>()
    };
    Table::build("adequacy")
        .repeat("model", model)
        .strings("flight", all.iter().map(|j| j.flight))
        .strings("output", all.iter().map(|j| j.output))
        .strings("unit", all.iter().map(|j| j.unit))
        .i64("n", all.iter().map(|j| j.all.samples() as i64).collect::<Vec<_>>())
        .f64("noise", number(&Adequacy::noise))
        .f64("left", number(&Adequacy::left))
        .f64("variation", number(&Adequacy::variation))
        .f64("share", number(&Adequacy::share))
        .f64("bias", number(&|a| a.parts()[0]))
        .f64("size", number(&|a| a.parts()[1]))
        .f64("shape", number(&|a| a.parts()[2]))
        .strings("leaves", all.iter().map(|j| j.all.leaves().as_str()))
        .finish()
}
