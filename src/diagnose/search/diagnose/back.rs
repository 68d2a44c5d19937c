//! What was added comes in; each of it tested with everything else in place, and chosen again from other
//! maneuvers, goes out.

use super::Search;
use super::adding::Link;
use crate::diagnose::base::found::Found;
use crate::diagnose::effect::effect_of;
use crate::diagnose::search::decide::gives_way;
use crate::diagnose::search::judged::{Judged, Round};
use crate::diagnose::search::stability::{Stability, stability};
use crate::diagnose::search::surrogate::times;
use crate::diagnose::search::verdict::Finding;
use crate::error::Errors;

impl Search<'_> {
    /// Tests every link with all others in place, the weakest first; true where all of them hold.
    pub(super) fn back(&mut self, base: &Found) -> Result<bool, Errors> {
        self.out.findings.clear();
        self.links.iter_mut().for_each(|l| l.doubt = None);
        let mut order: Vec<usize> = (0..self.links.len()).collect();
        order.sort_by(|&a, &b| self.links[a].evidence.total_cmp(&self.links[b].evidence));
        let mut findings = vec![None; self.links.len()];
        for i in order {
            let name = self.links[i].name.clone();
            let at = match self.tested_already() {
                Some(at) => at,
                None => match self.strict(i, base)? {
                    Some(round) => {
                        self.out.rounds.push(round);
                        self.out.rounds.len() - 1
                    }
                    None => {
                        self.links[i].doubt =
                            Some("without it the model with everything else does not run: it could not be tested".into());
                        continue;
                    }
                },
            };
            let round = &self.out.rounds[at];
            let judged = |c: &usize| round.judged.get(*c);
            if let Some(c) =
                round.class.iter().copied().find(|c| judged(c).is_some_and(|j| j.name == name))
            {
                let (class, stability) = (round.class.clone(), Stability::default());
                findings[i] = Some(Finding { round: at, added: c, class, stability });
                continue;
            }
            let others = |j: &&Judged| self.links.iter().all(|l| l.name != j.name);
            let this = round.judged.iter().find(|j| j.name == name);
            let evidence = this.map_or(f64::NEG_INFINITY, |j| j.evidence);
            let thresholds = &self.subject.settings.thresholds;
            let instead = |j: &&Judged| this.is_some_and(|this| gives_way(this, j, thresholds));
            let better = round
                .class
                .iter()
                .filter_map(judged)
                .find(others)
                .filter(|j| !self.ending && (!(j.evidence < evidence) || instead(j)));
            if let Some(better) = better.and_then(|j| Link::of(round, j, self.rivals())) {
                if better.evidence < evidence {
                    self.dropped.push(name);
                }
                self.links[i] = better;
                return Ok(false);
            }
            let kept = |j: &&Judged| {
                evidence > times(thresholds.kept_factor, round.limit, j.screened.taken, thresholds)
            };
            let doubt = this.filter(|j| j.standing.is_doubt()).filter(kept).map(|j| j.why.clone());
            if doubt.is_some() {
                self.links[i].noise |= this.is_some_and(Judged::is_of_record);
                self.links[i].doubt = doubt;
                continue;
            }
            self.links.remove(i);
            self.dropped.push(name);
            return Ok(false);
        }
        self.out.findings = findings.into_iter().flatten().collect();
        Ok(true)
    }

    /// Lets other choices of the maneuvers vote on every finding: its class grows by those that are
    /// chosen in its place, and what is chosen too seldom is no finding.
    pub(super) fn voted(&mut self, base: &Found) -> Result<(), Errors> {
        let settings = self.subject.settings;
        for mut finding in std::mem::take(&mut self.out.findings) {
            let round = &self.out.rounds[finding.round];
            let name = round.judged[finding.added].name.clone();
            (self.progress)(&format!("{name}: is it chosen from other maneuvers, too?"));
            let others: Vec<Link> = self.links.iter().filter(|l| l.name != name).cloned().collect();
            if let Some((stand, _)) = self.chained(&others)? {
                let made = self.with(&stand, &others, base)?;
                let found = made.as_deref().unwrap_or(base);
                let takes_part = |effect: &str| round.judged.iter().any(|j| j.effect == effect);
                let (candidates, _) = self.offered(&stand, &takes_part)?;
                finding.stability =
                    stability((&stand, found), (round, finding.added), &candidates, self.subject)?;
            }
            match finding.stability.says(&name, round, &finding.class, settings) {
                Ok(class) => {
                    finding.class = class;
                    self.out.findings.push(finding);
                }
                Err(why) => {
                    let this = self.links.iter_mut().filter(|l| l.name == name);
                    this.for_each(|l| l.doubt = Some(why.clone()));
                    self.out.unstable.push((name, finding.stability));
                }
            }
        }
        Ok(())
    }

    /// The round that tested the only link already: the one it was found in, if that was strict
    /// enough.
    fn tested_already(&self) -> Option<usize> {
        let [only] = &self.links[..] else { return None };
        let round =
            |r: &Round| r.base.is_empty() && r.class.iter().any(|&c| r.judged[c].name == only.name);
        self.out.rounds.iter().rposition(round)
    }

    /// A round on everything but link `i`, with it and those that came near it; none where that
    /// does not run.
    fn strict(&self, i: usize, base: &Found) -> Result<Option<Round>, Errors> {
        let mut others = self.links.clone();
        let this = others.remove(i);
        (self.progress)(&format!(
            "{} is taken out and tested with everything else in place",
            this.name
        ));
        let Some((stand, _)) = self.chained(&others)? else { return Ok(None) };
        let takes_part = |name: &String| *name == this.name || this.rivals.contains(name);
        let names = || this.rivals.iter().chain([&this.name]);
        let wanted = |effect: &str| names().any(|name| effect_of(name) == effect);
        let (mut candidates, _) = self.offered(&stand, &wanted)?;
        candidates.retain(|c| takes_part(&c.name));
        let made = self.with(&stand, &others, base)?;
        if made.is_none() && !others.is_empty() {
            return Ok(None);
        }
        // Few take part, but it was found as the best of all.
        let mut round = self.round(
            &stand,
            made.as_deref().unwrap_or(base),
            (&candidates, this.limit, Some(&this.name)),
        )?;
        round.base = others.iter().map(|l| l.name.clone()).collect();
        round.strict = true;
        Ok(Some(round))
    }
}
