//! An estimation and a parameter that nothing shows in; why that is so out.

use super::reached::Reached;
use super::regressors::NOWHERE;
use super::{Estimation, Row};

/// Why nothing shows a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Idle<'a> {
    /// It belongs to this limit, which the motion never reaches.
    NotReached(&'a Reached),
    /// It is the time of a delay.
    Delays,
    /// No equation that can be used has it.
    NoEquation,
    /// It does nothing.
    NoEffect,
}

impl Estimation {
    /// Why nothing shows the parameter of a row.
    pub fn why_idle(&self, row: &Row) -> Idle<'_> {
        let holds =
            |limit: &&Reached| limit.active.is_empty() && limit.parameters.contains(&row.name);
        match self.reached.iter().find(holds) {
            Some(limit) => Idle::NotReached(limit),
            None if self.delaying.contains(&row.name) => Idle::Delays,
            None if self.is_in_no_equation(row) => Idle::NoEquation,
            None => Idle::NoEffect,
        }
    }

    /// Whether the estimate is by equation error, and none of the equations used has this parameter.
    fn is_in_no_equation(&self, row: &Row) -> bool {
        let estimate = self.regression.as_ref().filter(|r| r.is_estimate);
        let at = self.rows.iter().position(|r| r == row);
        estimate.is_some_and(|r| {
            r.rows.iter().any(|found| Some(found.row) == at && found.outcome == NOWHERE)
        })
    }
}
