//! What equations lack and what that goes with in; the strongest of it out.

use super::driven::EquationError;
use super::relation::Relation;
use crate::diagnose::effect::roles;

/// The equation that lacks most.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    pub equation: EquationError,
    /// What it goes with, if with anything.
    pub relation: Option<Relation>,
}

/// The coefficient that lacks most beside what noise of the sensors makes of it, over all maneuvers, or
/// the rate of a state that has none (an actuator), if that lacks more; of a model without coefficients the
/// rate. The rates of the motion say again what coefficients say. None where nothing was looked at.
pub fn strongest(equations: &[EquationError], relations: &[Relation]) -> Option<Evidence> {
    let ratio = |e: &EquationError| e.rms / e.noise;
    let whole = || equations.iter().filter(|e| e.segment.is_none() && ratio(e).is_finite());
    let some = whole().any(|e| !e.is_rate);
    let counts = |e: &&EquationError| !some || !e.is_rate || !roles::is_motion(&e.name);
    let most = whole().filter(counts).max_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    let equation = most?.clone();
    let over = |r: &Relation| r.correlation.abs() / r.limit;
    let relation = relations
        .iter()
        .filter(|r| r.output == equation.name && over(r) > 1.0)
        .max_by(|a, b| over(a).total_cmp(&over(b)))
        .cloned();
    Some(Evidence { equation, relation })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coefficient_goes_before_a_rate_and_what_it_goes_with_is_above_chance() {
        let error = |name: &str, is_rate, rms, segment| EquationError {
            segment,
            name: name.into(),
            is_rate,
            unit: "-".into(),
            rms,
            noise: 1.0,
        };
        let relation = |output: &str, source: &str, correlation, limit| Relation {
            output: output.into(),
            source: source.into(),
            correlation,
            lag: 0.1,
            limit,
            coherence: 0.1,
            from: 0.1,
            to: 1.0,
            coherence_limit: 0.5,
        };
        let equations = [
            error("q", true, 9.0, None),
            error("C_L", false, 1.5, None),
            error("C_m", false, 3.0, None),
            error("C_L", false, 7.0, Some(1)),
        ];
        let relations = [
            relation("C_m", "de", 0.5, 0.4),
            relation("C_m", "modelled q", -0.41, 0.26),
            relation("C_L", "de", 0.9, 0.1),
        ];
        let found = strongest(&equations, &relations).expect("an equation");
        assert_eq!(found.equation.name, "C_m");
        assert_eq!(found.relation.map(|r| r.source).as_deref(), Some("modelled q"));
        let nothing = strongest(&equations, &[relation("C_m", "de", 0.2, 0.4)]).expect("one");
        assert_eq!(nothing.relation, None);
        let actuator = [&equations[..], &[error("de", true, 4.0, None)]].concat();
        assert_eq!(strongest(&actuator, &[]).expect("a rate").equation.name, "de");
        assert_eq!(strongest(&equations[..1], &[]).expect("a rate").equation.name, "q");
        assert_eq!(strongest(&[], &relations), None);
    }
}
