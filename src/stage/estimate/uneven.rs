//! An estimation over several flights comes in; outputs whose noise is of another size in one flight
//! than in the next, where all flights are weighed alike, go out.

use super::batch::Batch;
use super::config::Config;
use crate::estimate::{Estimation, Stop, Trace};
use crate::stage::{Note, Severity};
use std::collections::BTreeMap;

/// So many times the residuals of another flight.
const TIMES: f64 = 2.0;
/// Samples of a flight, at least.
const FEWEST: usize = 50;

/// A note on every output whose residuals differ.
pub fn notes(config: &Config, batch: &Batch, estimation: &Estimation) -> Vec<Note> {
    let method = &config.settings.method;
    if estimation.stop != Stop::Converged || method.noise_per != "campaign" {
        return Vec::new();
    }
    let all = uneven(&batch.flights, &estimation.responses);
    if all.is_empty() {
        return Vec::new();
    }
    let text = format!(
        "{}: flights are weighed alike, and residuals of them differ in size: {}; standard deviations of what belongs to one flight are those of all: noise_per = \"flight\" in [estimate.method] tells them apart",
        batch.group,
        all.join(", ")
    );
    vec![config.note("", Severity::Warning, config.name(), all.len(), text)]
}

/// Every output whose residuals in one flight are many times those in another. `flights` and
/// `responses`: of each segment.
fn uneven(flights: &[String], responses: &[Vec<Trace>]) -> Vec<String> {
    let mut sums: BTreeMap<&str, BTreeMap<&str, [f64; 2]>> = BTreeMap::new();
    for (flight, traces) in flights.iter().zip(responses) {
        for trace in traces {
            let of = sums.entry(trace.name.as_str()).or_default().entry(flight).or_default();
            let e = trace.measured.iter().zip(&trace.modelled).map(|(z, y)| z - y);
            for e in e.filter(|e| e.is_finite()) {
                of[0] += 1.0;
                of[1] += e * e;
            }
        }
    }
    let one = |(output, flights): (&str, BTreeMap<&str, [f64; 2]>)| {
        let rms = flights.into_iter().filter(|(_, [n, _])| *n >= FEWEST as f64);
        let mut rms: Vec<(&str, f64)> = rms.map(|(f, [n, sum])| (f, (sum / n).sqrt())).collect();
        rms.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (least, most) = (rms.first()?, rms.last()?);
        (most.1 > TIMES * least.1 && least.1 > 0.0).then(|| {
            format!("{output} ({:.1} times, {} and {})", most.1 / least.1, least.0, most.0)
        })
    };
    sums.into_iter().filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_noisy_flight_is_told_and_even_ones_are_not() {
        let trace = |size: f64| {
            let e = |k: usize| if k.is_multiple_of(2) { size } else { -size };
            vec![Trace {
                noise: None,
                name: "q".into(),
                measured: (0..100).map(e).collect(),
                modelled: vec![0.0; 100],
                ..Trace::default()
            }]
        };
        let flights = ["a".to_string(), "b".to_string()];
        let of = |sizes: [f64; 2]| uneven(&flights, &sizes.map(trace));
        assert!(of([1.0, 1.5]).is_empty());
        assert_eq!(of([1.0, 4.0]), ["q (4.0 times, a and b)"]);
    }
}
