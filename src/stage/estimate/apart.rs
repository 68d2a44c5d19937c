//! An estimation over several flights that did not converge comes in; what each flight by itself says of
//! the parameter that they agree on least goes out.
//!
//! A record that is reversed, or in another unit, in one flight keeps all from being estimated, and nothing of
//! that estimation tells in which.

use super::batch::Batch;
use super::config::Config;
use crate::error::Errors;
use crate::estimate::{Estimation, Segment, Stop};
use crate::math::{digits, median};
use crate::stage::{Note, Severity};

/// Flights differ by more than so many standard deviations and by more than this share of the value.
const BEYOND: f64 = 5.0;
const SHARE: f64 = 0.5;
/// Flights that are named at most.
const NAMED: usize = 6;

/// A flight by itself.
struct Alone {
    flight: String,
    estimation: Estimation,
}

/// What there is to say; `again` estimates from other segments by the same settings, and tells no more of it than
/// values and their standard deviations.
///
/// # Errors
/// An estimation is refused.
pub fn notes(
    config: &Config,
    (batch, estimation): (&Batch, &Estimation),
    again: &dyn Fn(&[Segment]) -> Result<Estimation, Errors>,
) -> Result<Vec<Note>, Errors> {
    let mut flights = batch.flights.clone();
    flights.dedup();
    if estimation.stop == Stop::Converged || flights.len() < 2 {
        return Ok(Vec::new());
    }
    let alone = |flight: String| {
        let own = batch.labelled.iter().zip(&batch.flights).filter(|(_, of)| **of == flight);
        let own: Vec<Segment> = own.map(|(segment, _)| segment.clone()).collect();
        Ok(Alone { flight, estimation: again(&own)? })
    };
    let alone: Vec<Alone> = flights.into_iter().map(alone).collect::<Result<_, Errors>>()?;
    let note = |text: String| {
        let text = format!("{}: flights by themselves: {text}", batch.group);
        config.note("", Severity::Warning, batch.group.clone(), 1, text)
    };
    Ok(said(&alone).map(note).into_iter().collect())
}

/// What flights by themselves say; nothing where they say the same, or hardly one converges.
fn said(alone: &[Alone]) -> Option<String> {
    let (good, bad): (Vec<&Alone>, Vec<&Alone>) =
        alone.iter().partition(|one| one.estimation.stop == Stop::Converged);
    let others: Vec<String> = (bad.iter())
        .take(NAMED)
        .map(|one| format!("{} ends with \"{}\"", one.flight, one.estimation.stop))
        .collect();
    let differ = (good.first()?.estimation.rows.iter())
        .filter(|row| row.segment.is_none() && row.group.is_none())
        .filter_map(|row| differ(&good, &row.name))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let values = differ.map(|(_, text)| {
        format!("{text}: is a record reversed there, or in another unit, or the aircraft another?")
    });
    let text: Vec<String> =
        values.into_iter().chain((!others.is_empty()).then(|| others.join(", "))).collect();
    (!text.is_empty()).then(|| text.join("; "))
}

/// By how many standard deviations a parameter differs between flights, and its values, those farthest from the
/// middle first; none where it does not.
fn differ(good: &[&Alone], name: &str) -> Option<(f64, String)> {
    let of = |one: &&Alone| {
        let row = one.estimation.rows.iter().find(|row| row.name == name)?;
        Some((one.flight.clone(), row.value, row.sd?))
    };
    let mut values: Vec<(String, f64, f64)> = good.iter().filter_map(of).collect();
    if values.len() < 2 {
        return None;
    }
    let middle = median(&values.iter().map(|v| v.1).collect::<Vec<f64>>());
    let far = |v: &(String, f64, f64)| (v.1 - middle).abs();
    values.sort_by(|a, b| far(b).total_cmp(&far(a)).then(a.0.cmp(&b.0)));
    let (_, value, sd) = values.first()?;
    let apart = (value - middle).abs();
    let is_apart = apart > BEYOND * sd && apart > SHARE * value.abs().min(middle.abs());
    let words = values.iter().take(NAMED);
    let words: Vec<String> = words
        .map(|(flight, v, sd)| format!("{flight} {} +- {}", digits(*v), digits(*sd)))
        .collect();
    is_apart.then(|| (apart / sd, format!("{name} is {}", words.join(", "))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::{Channel, Record};
    use crate::estimate::{Settings, estimate_segments};
    use crate::model::{Constants, Model};

    const GAIN: &str = r#"
title = "A rate that a surface drives"
[inputs]
u = "rad"
[parameters]
a = { unit = "1/s", start = -1.0 }
b = { unit = "1/s^2", start = -3.0 }
[states]
q = { unit = "rad/s", rate = "a*q + b*u", start = 0.0 }
[outputs]
q = { unit = "rad/s", value = "q" }
"#;

    fn flight(name: &str, sign: f64) -> Alone {
        let model = Model::parse("gain", GAIN, &Constants::default()).expect("a model");
        let (n, dt) = (400, 0.02);
        let (mut q, mut inputs, mut z) = (0.0f64, Vec::new(), Vec::new());
        for k in 0..n {
            let u = libm::sin(3.0 * k as f64 * dt);
            inputs.push(sign * u);
            z.push(q + 1e-3 * libm::sin(7919.0 * k as f64));
            q += dt * (-1.5 * q - 4.0 * u);
        }
        let t: Vec<f64> = (0..n).map(|k| k as f64 * dt).collect();
        let channels = vec![Channel { output: 0, t: t.into(), z: z.into() }];
        let record = Record { dt, n, inputs: inputs.into(), channels, ..Record::default() };
        let segments = [Segment { record, ..Segment::default() }];
        let estimation =
            estimate_segments(&model, &segments, &Settings::default()).expect("an estimation");
        Alone { flight: name.to_string(), estimation }
    }

    #[test]
    fn the_flight_with_a_reversed_record_stands_first_and_like_flights_say_nothing() {
        let like = [flight("f1", 1.0), flight("f2", 1.0), flight("f3", 1.0)];
        assert_eq!(said(&like), None);
        let one = [flight("f1", 1.0), flight("f2", -1.0), flight("f3", 1.0)];
        let said = said(&one).expect("a word");
        assert!(said.starts_with("b is f2 "), "{said}");
    }
}
