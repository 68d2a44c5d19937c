//! Candidates and the base they are held against, in; their full fits, each made once however many rounds ask
//! for it, out.
//!
//! A test of one effect with all others in place asks again for what the search has fitted on the way to
//! it, and so does a search that goes on from where it has been. Fits that are new are made side by side.

use super::refit::{Ground, Left, Refit, refit};
use crate::diagnose::base::found::Found;
use crate::diagnose::effect::Candidate;
use crate::error::Errors;
use rayon::prelude::*;
use std::cell::RefCell;

/// A fit, and what is left with it; none where the model does not run over all maneuvers.
type Fit = Option<(Refit, Left)>;

/// The fits of a search.
#[derive(Default)]
pub struct Fits(RefCell<Vec<(Key, Fit)>>);

/// A start this near another one, as a share, leads where that one leads: rounding.
const NEAR: f64 = 1e-6;

/// The base by its place in memory, where a search keeps all of them until it ends; the candidate; and
/// where its fit begins.
struct Key(*const Found, String, Vec<f64>);

impl Key {
    fn new(found: &Found, (candidate, at): (&Candidate, &[f64])) -> Key {
        Key(std::ptr::from_ref(found), candidate.name.clone(), at.to_vec())
    }

    fn is(&self, other: &Key) -> bool {
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= NEAR * a.abs().max(b.abs());
        self.0 == other.0
            && self.1 == other.1
            && self.2.len() == other.2.len()
            && self.2.iter().zip(&other.2).all(near)
    }
}

impl Fits {
    /// The fits of candidates, each from where it begins, on `ground`, which is that of the base `found`; `begun`
    /// is told which are made.
    ///
    /// # Errors
    /// As `refit`.
    pub fn of(
        &self,
        found: &Found,
        ground: &Ground,
        asked: &[(&Candidate, &[f64])],
        begun: &(dyn Fn(&Candidate) + Sync),
    ) -> Result<Vec<Fit>, Errors> {
        let known = |one: &(&Candidate, &[f64])| {
            let key = Key::new(found, *one);
            self.0.borrow().iter().find(|(known, _)| known.is(&key)).map(|(_, fit)| fit.clone())
        };
        let mut fits: Vec<Option<Fit>> = asked.iter().map(known).collect();
        let new: Vec<usize> = (0..asked.len()).filter(|&i| fits[i].is_none()).collect();
        let one = |&i: &usize| {
            let (candidate, at) = asked[i];
            begun(candidate);
            Ok((i, refit(ground, candidate, at)?))
        };
        let made: Vec<(usize, Fit)> = new.par_iter().map(one).collect::<Result<_, Errors>>()?;
        for (i, fit) in made {
            self.0.borrow_mut().push((Key::new(found, asked[i]), fit.clone()));
            fits[i] = Some(fit);
        }
        Ok(fits.into_iter().map(Option::flatten).collect())
    }
}
