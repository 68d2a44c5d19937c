//! A subject and the library in; what is missing, found round after round and tested once
//! everything else is in place, and the verdict, out.
//!
//! *Forward*: the candidate of most evidence is added, and all begins again. Where several things
//! are missing, held-out maneuvers may contradict one of them only because of the others, so here a
//! candidate needs only evidence that they do not take away. *Back*: each one is taken out of the
//! whole again and must come out of a strict round on what is left, against those that came near
//! it; one that does not is replaced by the one that does, or dropped for good, and the search goes
//! on. One that explains most and is contradicted all the same stays in the model without being
//! named: the others are judged with it in place.

mod adding;
mod back;

use super::answering::answering;
use super::ending::ended;
use super::fits::Fits;
use super::judged::{Judged, Round};
use super::refit::joined;
use super::round::{held_against, referenced};
use super::verdict::{Diagnosis, Verdict};
use crate::diagnose::base::constants::with_constants;
use crate::diagnose::base::found::{Found, at_first, at_next};
use crate::diagnose::base::stand::{Known, Stand};
use crate::diagnose::effect::{Candidate, Wanted, effect_of};
use crate::diagnose::gap::comparison::Comparison;
use crate::diagnose::subject::{Subject, Trouble};
use crate::error::Errors;
use crate::model::Model;
use adding::{Link, beside, to_add};
use std::cell::RefCell;
use std::rc::Rc;

/// What the library has for a model: candidates, and effects that could not be attached with the
/// reason.
pub type Offered = (Vec<Candidate>, Vec<(String, String)>);

/// Attaches the effects wanted of the library to a model.
pub type Offer<'a> = dyn Fn(&Model, &Wanted) -> Result<Offered, Errors> + 'a;

/// The base with what was added, as it was fitted once.
struct Made {
    /// The parameters added, and where they started.
    added: Vec<(String, Option<f64>)>,
    known: Option<Known>,
    found: Option<Rc<Found>>,
}

/// The search while it goes on.
struct Search<'a> {
    subject: &'a Subject<'a>,
    offer: &'a Offer<'a>,
    progress: &'a (dyn Fn(&str) + Sync),
    links: Vec<Link>,
    /// The models that were fitted so far.
    made: RefCell<Vec<Made>>,
    /// The candidates' fits.
    fits: Fits,
    dropped: Vec<String>,
    /// Links are only taken out any more.
    ending: bool,
    out: Diagnosis,
}

/// Diagnoses a subject; `progress` is called with words on what is being done.
///
/// # Errors
/// Settings that do not fit the model. What the data say is never an error.
pub fn diagnose(
    subject: &Subject,
    offer: &Offer,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Diagnosis, Errors> {
    let out = Diagnosis {
        verdict: Verdict::NothingMissing,
        complete: true,
        rounds: Vec::new(),
        findings: Vec::new(),
        doubts: Vec::new(),
        unsettled: Vec::new(),
        beside: Vec::new(),
        unstable: Vec::new(),
        added: Vec::new(),
        values: Vec::new(),
        before: Vec::new(),
        after: Vec::new(),
        missed: Vec::new(),
        varying: Vec::new(),
        unphysical: Vec::new(),
        turned: Vec::new(),
        left_out: Vec::new(),
        unsure_noise: Vec::new(),
        skipped: Vec::new(),
        comparison: Comparison::default(),
        left: Vec::new(),
        turbulence: None,
    };
    let held = subject.held_out.iter().filter(|h| **h).count();
    if held == 0 || held == subject.held_out.len() {
        let why =
            Trouble::Segments("there must be maneuvers to train on and maneuvers held out".into());
        return Ok(Diagnosis { verdict: Verdict::None(why), ..out });
    }
    progress("estimating the base from the training maneuvers");
    let stand = |model| Stand::first(model, subject.method, subject.settings.base);
    let base = match at_first(&stand(subject.model), subject)? {
        Ok(base) => base,
        Err(trouble) => return Ok(Diagnosis { verdict: Verdict::None(trouble), ..out }),
    };
    // With constants free that the flights see, where the model runs so.
    let free = with_constants(&base, subject)?;
    let with = match &free {
        Some(model) => at_next(&stand(model), &Subject { model, ..*subject }, &base, None)?,
        None => None,
    };
    let model = free.as_ref().filter(|_| with.is_some()).unwrap_or(subject.model);
    let (subject, base) = (&Subject { model, ..*subject }, with.unwrap_or(base));
    let mut search = Search {
        subject,
        offer,
        progress,
        links: Vec::new(),
        made: RefCell::default(),
        fits: Fits::default(),
        dropped: Vec::new(),
        ending: false,
        out,
    };
    match search.run(base)? {
        Ok(()) => {}
        Err(trouble) => search.out.verdict = Verdict::None(trouble),
    }
    Ok(search.out)
}

impl Search<'_> {
    fn run(&mut self, base: Found) -> Result<Result<(), Trouble>, Errors> {
        self.out.left_out = base.prepared.left_out.clone();
        self.out.unsure_noise = base.unsure_noise();
        if base.places.training.is_empty() || base.places.held_out.is_empty() {
            let what = if base.places.training.is_empty() { "to train on" } else { "held out" };
            return Ok(Err(Trouble::Segments(format!("none of the maneuvers {what} can be used"))));
        }
        let most =
            self.subject.settings.thresholds.rounds_per_effect * self.subject.settings.effects + 2;
        self.out.before = answering(&self.first(), &base, self.subject.settings);
        self.forward(&base)?;
        while !self.back(&base)? {
            // Said of a link that may be gone.
            self.out.beside.clear();
            // No end of it: what does not hold is taken out, and nothing comes in any more.
            self.ending = self.out.rounds.len() >= most;
            if !self.ending {
                self.forward(&base)?;
            }
        }
        self.voted(&base)?;
        let named: Vec<Link> = self.links.iter().filter(|l| l.doubt.is_none()).cloned().collect();
        let chained = self.chained(&named)?;
        let (stand, added) = chained.unwrap_or_else(|| (self.first(), Vec::new()));
        let last = self.with(&stand, &named, &base)?;
        if added.len() < named.len() || (last.is_none() && !named.is_empty()) {
            let names: Vec<&str> = named.iter().map(|l| l.name.as_str()).collect();
            return Ok(Err(Trouble::Base(format!(
                "the model with {} does not run",
                names.join(" and ")
            ))));
        }
        let last = last.as_deref().unwrap_or(&base);
        let out = &mut self.out;
        out.added = added;
        out.doubts =
            self.links.iter().filter_map(|l| Some((l.name.clone(), l.doubt.clone()?))).collect();
        // Small movements of a record that happened here and not there: that is a doubt about the
        // record, and none about what the model was found to lack.
        let doubted = self.links.iter().filter(|l| l.doubt.is_some() && !l.noise);
        let doubted = doubted.map(|l| l.evidence).sum();
        ended(out, self.subject, (&stand, &base, last), doubted, self.progress)?;
        Ok(Ok(()))
    }

    fn first(&self) -> Stand {
        Stand::first(self.subject.model, self.subject.method, self.subject.settings.base)
    }

    fn rivals(&self) -> usize {
        self.subject.settings.thresholds.rivals
    }

    /// The effects wanted for a model. What a round found to differ from a value of its column does so in all
    /// that follow.
    fn offered(&self, stand: &Stand, wanted: &Wanted) -> Result<Offered, Errors> {
        let (mut candidates, skipped) = (self.offer)(&stand.model, wanted)?;
        let differs = |j: &&Judged| !j.screened.references.is_empty();
        for judged in self.out.rounds.iter().flat_map(|r| &r.judged).filter(differs) {
            for candidate in candidates.iter_mut().filter(|c| c.name == judged.name) {
                *candidate =
                    referenced(candidate, stand, &judged.screened.references)?.into_owned();
            }
        }
        Ok((candidates, skipped))
    }

    /// The base with these links, and the candidates that they are; none where one of them cannot
    /// be attached to the others.
    fn chained(&self, links: &[Link]) -> Result<Option<(Stand, Vec<Candidate>)>, Errors> {
        let (mut stand, mut added) = (self.first(), Vec::new());
        for link in links {
            let (candidates, _) =
                self.offered(&stand, &|effect| effect == effect_of(&link.name))?;
            let Some(candidate) = candidates.into_iter().find(|c| c.name == link.name) else {
                return Ok(None);
            };
            stand = joined(&stand, &candidate, &link.values);
            added.push(candidate);
        }
        Ok(Some((stand, added)))
    }

    /// Adds what has most evidence until nothing has.
    fn forward(&mut self, base: &Found) -> Result<(), Errors> {
        while self.links.len() < self.subject.settings.effects {
            let Some((stand, added)) = self.chained(&self.links)? else { return Ok(()) };
            let made = self.with(&stand, &self.links, base)?;
            if made.is_none() && !self.links.is_empty() {
                return Ok(());
            }
            let found = made.as_deref().unwrap_or(base);
            let (mut candidates, skipped) = self.offered(&stand, &|_| true)?;
            if self.out.rounds.is_empty() {
                self.out.skipped = skipped;
            }
            candidates.retain(|c| {
                let new = self.links.iter().all(|l| l.name != c.name);
                new && !self.dropped.contains(&c.name) && !added.iter().any(|a| c.is_form_of(a))
            });
            let number = self.out.rounds.len() + 1;
            let round = self.round(&stand, found, (&candidates, 0.0, None))?;
            self.out.beside = beside(&self.links, &round, &self.subject.settings.thresholds);
            let chosen = to_add(&self.links, &round, self.subject.settings);
            let link = chosen.and_then(|c| Link::of(&round, &round.judged[c], self.rivals()));
            (self.progress)(&match &link {
                Some(link) => {
                    format!("round {number}: {} is added, evidence {:.1}", link.name, link.evidence)
                }
                None => format!("round {number}: nothing is added"),
            });
            self.out.rounds.push(round);
            match link {
                Some(link) => self.links.push(link),
                None => return Ok(()),
            }
        }
        Ok(())
    }

    /// The base with what these links add; none where there are none, or where it does not run. What was
    /// fitted from there once is not fitted again.
    fn with(
        &self,
        stand: &Stand,
        links: &[Link],
        base: &Found,
    ) -> Result<Option<Rc<Found>>, Errors> {
        if stand.added.is_empty() {
            return Ok(None);
        }
        let known = links.last().map(|link| &link.known);
        let start = |name: &String| (name.clone(), stand.method.starts.get(name).copied());
        let added: Vec<_> = stand.added.iter().map(start).collect();
        let is = |made: &&Made| made.added == added && made.known.as_ref() == known;
        if let Some(made) = self.made.borrow().iter().find(is) {
            return Ok(made.found.clone());
        }
        let found = at_next(stand, self.subject, base, known)?.map(Rc::new);
        let made = Made { added, known: known.cloned(), found: found.clone() };
        self.made.borrow_mut().push(made);
        Ok(found)
    }

    /// `offered`: candidates, what chance gives at least, and the one that is tested.
    fn round(
        &self,
        stand: &Stand,
        found: &Found,
        offered: (&[Candidate], f64, Option<&str>),
    ) -> Result<Round, Errors> {
        let number = self.out.rounds.len() + 1;
        let case = found.case();
        let progress = self.progress;
        let tell = |text: &str| progress(&format!("round {number}: {text}"));
        let mut round =
            held_against(stand, found, &case, offered, (self.subject, &self.fits), &tell)?;
        round.base = self.links.iter().map(|l| l.name.clone()).collect();
        Ok(round)
    }
}
