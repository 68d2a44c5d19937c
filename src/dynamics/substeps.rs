//! A propagator and a record in; the integration steps per grid step that the model asks for along it,
//! out.

use super::Record;
use super::evaluate::Single;
use super::propagator::Propagator;
use super::starts::evaluate_starts;
use super::stiffness::Stiffness;
use super::tableau::MOST_SUBSTEPS;
use super::values::Run;
use crate::model::Delayed;

/// Steps per grid step where limits depend on a state that limits take along at its own rate.
const CHAIN: usize = 4;

/// Integration steps per grid step: the largest that the Jacobian asks for at the start state over
/// inputs along the record, and where each of them is at its extremes: what is stiff only where an
/// input has passed a threshold (the end of a play) shows there. A threshold between two states
/// does not.
pub fn substeps(
    propagator: &Propagator,
    parameters: &[f64],
    given: &[f64],
    record: &Record,
) -> usize {
    let n = record.n.saturating_sub(record.start);
    if n == 0 || record.inputs.len() < record.n * propagator.layout.inputs {
        return 1;
    }
    let x = evaluate_starts(
        &propagator.starts,
        propagator.layout,
        &propagator.tables,
        parameters,
        given,
        record,
    );
    let mut taus = Single::new(&propagator.delay_values, propagator, parameters);
    let mut run = Run::new(propagator, record, &mut taus);
    let mut stiffness = Stiffness::new(propagator, parameters);
    let mut most = 1;
    for k in looks(propagator, record) {
        let chunk = run.at_rest(k, &x, &mut taus);
        most = most.max(stiffness.substeps(&chunk.points, record.dt));
        // a delayed state is read from finished steps where the delay is not absurdly short
        for (k, d) in propagator.delays.iter().enumerate() {
            let tau = taus.get(k);
            if matches!(d.of, Delayed::State(_)) && tau > 0.0 {
                most = most.max(((record.dt / tau).ceil() as usize).min(16));
            }
        }
    }
    // What follows something as fast as it can comes to it, and turns, inside a step: what depends on
    // that sees it at the ends of steps.
    if propagator.hurries && propagator.level_ends.len() > 1 {
        most = most.max(CHAIN);
    }
    most.min(MOST_SUBSTEPS)
}

/// Grid points after the start: five along the record, and those with the least and the most of
/// every input; each once.
fn looks(propagator: &Propagator, record: &Record) -> Vec<usize> {
    let (n, nu) = (record.n - record.start, propagator.layout.inputs);
    let mut looks: Vec<usize> = (0..5).map(|i| i * (n - 1) / 4).collect();
    for input in 0..nu {
        let value = |k: &usize| record.inputs[(record.start + k) * nu + input];
        looks.extend((0..n).min_by(|a, b| value(a).total_cmp(&value(b))));
        looks.extend((0..n).max_by(|a, b| value(a).total_cmp(&value(b))));
    }
    looks.sort_unstable();
    looks.dedup();
    looks
}

#[cfg(test)]
mod tests {
    use crate::dynamics::{Directions, Propagator, Record};
    use crate::model::{Constants, Model};

    /// A surface with play: nothing pushes it until the input has taken the play up, and then
    /// within 10 ms.
    const PLAY: &str = r#"title = "play"
[inputs]
de = "rad"
[parameters]
b = { unit = "rad", start = 0.02 }
[constants]
follow = { unit = "s", value = 0.01 }
[states]
z = { unit = "rad", rate = "deadband(de - z, b)/follow", start = "de" }
[outputs]
z = { unit = "rad", value = "z" }
"#;

    #[test]
    fn what_is_stiff_beyond_a_threshold_only_is_found_wherever_the_input_passes_it() {
        let model =
            Model::parse("play", PLAY, &Constants::default()).unwrap_or_else(|e| panic!("{e}"));
        let propagator = Propagator::new(&model, Directions::default()).expect("a propagator");
        // Between the points that are looked at along the record.
        let inputs: Vec<f64> =
            (0..400).map(|k| if (130..150).contains(&k) { 0.05 } else { 0.0 }).collect();
        let record = Record { dt: 0.04, n: 400, inputs: inputs.into(), ..Record::default() };
        let steps = propagator.substeps(&model.parameter_starts(), &[], &record);
        assert!(
            (8..=9).contains(&steps),
            "a rate of 100 1/s over 0.04 s, half of one in a step: {steps}"
        );
        let grid = propagator.run(
            &model.parameter_starts(),
            &[],
            &Record { substeps: steps, ..record },
            false,
        );
        assert!(
            (grid.y[149] - 0.03).abs() < 1e-6 && (grid.y[399] - 0.02).abs() < 1e-6,
            "{} {}",
            grid.y[149],
            grid.y[399]
        );
    }
}
