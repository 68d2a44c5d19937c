//! An estimation and a parameter that nothing shows in; why that is so out.

use super::reached::Reached;
use super::{Estimation, Row};

/// Why nothing shows a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Idle<'a> {
    /// It belongs to this limit, which the motion never reaches.
    NotReached(&'a Reached),
    /// It is the time of a delay.
    Delays,
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
            None => Idle::NoEffect,
        }
    }
}
