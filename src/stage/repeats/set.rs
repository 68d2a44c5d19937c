//! Estimates of one parameter that are compared with each other, and what they have in common, come in; how
//! they scatter goes out.

use super::one::One;
use super::trim::Trim;
use crate::fit::{Repeats, repeats};
use crate::stage::correlations::Correlations;

/// Estimates that are compared.
pub struct Set<'a> {
    pub parameter: &'a str,
    pub unit: &'a str,
    pub set: &'static str,
    pub trim: Option<&'a Trim>,
    pub input: Option<&'a str>,
    pub kind: Option<&'a str>,
    pub found: Repeats,
}

/// Estimates that are compared; none for fewer than two.
pub fn set<'a>(set: &'static str, mine: &[&One<'a>], common: &Correlations) -> Option<Set<'a>> {
    let first = mine.first()?;
    let number = |of: fn(&One) -> f64| mine.iter().map(|one| of(one)).collect::<Vec<f64>>();
    let (values, sds) = (number(|one| one.value), number(|one| one.sd));
    let segments: Vec<&str> = mine.iter().map(|one| one.segment).collect();
    let shared = common.shared(first.parameter, &segments, &sds);
    Some(Set {
        parameter: first.parameter,
        unit: first.unit,
        set,
        trim: None,
        input: first.input,
        kind: first.kind,
        found: repeats(&values, &sds, &shared)?,
    })
}
