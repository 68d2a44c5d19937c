//! A candidate and the base it is held against, in; its full fit, made once however many rounds ask for it,
//! out.
//!
//! A test of one effect with all others in place asks again for what the search has fitted on the way to
//! it, and so does a search that goes on from where it has been.

use super::refit::{Ground, Left, Refit, refit};
use crate::diagnose::base::found::Found;
use crate::diagnose::effect::Candidate;
use crate::error::Errors;
use std::cell::RefCell;

/// A fit, and what is left with it; none where the model does not run over all maneuvers.
type Fit = Option<(Refit, Left)>;

/// The fits of a search.
#[derive(Default)]
pub struct Fits(RefCell<Vec<(Key, Fit)>>);

/// The base by its place in memory, where a search keeps all of them until it ends; the candidate; and
/// where its fit begins, bit by bit.
#[derive(PartialEq)]
struct Key(*const Found, String, Vec<u64>);

impl Fits {
    /// The fit of a candidate from `at`, on `ground`, which is that of the base `found`.
    ///
    /// # Errors
    /// As `refit`.
    pub fn of(
        &self,
        found: &Found,
        ground: &Ground,
        candidate: &Candidate,
        at: &[f64],
    ) -> Result<Fit, Errors> {
        let start = at.iter().map(|value| value.to_bits()).collect();
        let key = Key(std::ptr::from_ref(found), candidate.name.clone(), start);
        if let Some((_, fit)) = self.0.borrow().iter().find(|(known, _)| *known == key) {
            return Ok(fit.clone());
        }
        let fit = refit(ground, candidate, at)?;
        self.0.borrow_mut().push((key, fit.clone()));
        Ok(fit)
    }
}
