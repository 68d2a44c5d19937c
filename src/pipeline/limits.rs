//! What a command wants of a run (some flights, until a stage, from a stage on anew) comes in; which
//! stages and flights are taken, and which units are run although they are fresh, goes out.

use super::assess::{Assessment, State};
use super::order;
use super::plan::Plan;
use super::provenance::Reason;
use crate::config::list;
use crate::error::{Error, Errors};
use crate::stage::Stage;

/// The part of a run that is wanted; the default is all of it.
#[derive(Debug, Clone, Default)]
pub struct Limits {
    /// This stage and those behind it are run again, fresh or not.
    pub from: Option<String>,
    /// Stages behind this one are left as they are.
    pub until: Option<String>,
    /// These flights alone go through the stages of flights; nothing is done for the campaign as a
    /// whole. All of them where none is named.
    pub flights: Vec<String>,
}

impl Limits {
    /// Whether they leave something out.
    pub fn leave_out(&self) -> bool {
        self.until.is_some() || !self.flights.is_empty()
    }

    /// Every mistake in the names of stages and flights.
    ///
    /// # Errors
    /// There is no such stage or flight; the run would end before it begins.
    pub fn check(&self, plan: &Plan) -> Result<(), Errors> {
        let mut errors = Errors::default();
        let stages: Vec<&str> = plan.campaign.stages.iter().map(|stage| stage.name).collect();
        for (option, name) in [("--from", &self.from), ("--until", &self.until)] {
            if let Some(name) = name.as_deref().filter(|name| !stages.contains(name)) {
                let what = format!("{option}: there is no stage \"{name}\"");
                errors.push(Error::new(what).help(format!("the stages are {}", list(&stages))));
            }
        }
        let flights = &plan.campaign.flights;
        for name in self.flights.iter().filter(|name| !flights.contains(name)) {
            let what = format!("--flight: the campaign has no flight \"{name}\"");
            errors.push(Error::new(what).help(format!("it has {}", list(flights))));
        }
        let place = |name: &Option<String>| {
            name.as_ref().and_then(|name| stages.iter().position(|stage| stage == name))
        };
        if let (Some(from), Some(until)) = (place(&self.from), place(&self.until))
            && from > until
        {
            errors.push(
                Error::new("--from names a stage behind the one that --until names")
                    .help(format!("the order of the stages is {}", stages.join(", "))),
            );
        }
        errors.or(())
    }

    /// The stages that are taken: those of flights, and those of the campaign.
    pub fn stages(&self, plan: &Plan) -> (&'static [Stage], &'static [Stage]) {
        let stages = plan.campaign.stages;
        let last = self.until.as_ref();
        let end = last.and_then(|last| stages.iter().position(|stage| stage.name == last));
        let taken = stages.get(..end.map_or(stages.len(), |end| end + 1)).unwrap_or(stages);
        let (flights, campaign) = taken.split_at(order::of_flights(&plan.campaign, taken));
        (flights, if self.flights.is_empty() { campaign } else { &[] })
    }

    /// The flights that are taken, in the order of the campaign.
    pub fn flights(&self, plan: &Plan) -> Vec<String> {
        let all = plan.campaign.flights.iter();
        all.filter(|flight| self.has(flight)).cloned().collect()
    }

    /// Whether a flight is taken.
    pub fn has(&self, flight: &str) -> bool {
        self.flights.is_empty() || self.flights.iter().any(|name| name == flight)
    }

    /// Makes fresh units of a stage stale where they are to be run again. What later runs leave as it
    /// is stays as it is.
    pub fn anew(&self, plan: &Plan, stage: &Stage, assessments: &mut [Assessment]) {
        let stages = plan.campaign.stages;
        let place = |name: &str| stages.iter().position(|other| other.name == name);
        let from = self.from.as_deref().and_then(place);
        if from.is_none() || from > place(stage.name) {
            return;
        }
        let runs = |a: &&mut Assessment| {
            a.state == State::Fresh && (stage.idle)(&plan.campaign, &a.unit).is_none()
        };
        assessments
            .iter_mut()
            .filter(runs)
            .for_each(|a| a.state = State::Stale(vec![Reason::Asked]));
    }

    /// What is left out and why, one line for each limit that leaves something out.
    pub fn words(&self, plan: &Plan) -> Vec<String> {
        let has_units = |stage: &&Stage| !(stage.units)(&plan.campaign).is_empty();
        let names = |stages: &[Stage]| -> Vec<&str> {
            stages.iter().filter(has_units).map(|stage| stage.name).collect()
        };
        let (_, campaign) = self.stages(plan);
        let all = Limits { flights: Vec::new(), ..self.clone() }.stages(plan);
        let behind = plan.campaign.stages.get(all.0.len() + all.1.len()..).unwrap_or_default();
        let (of_all, behind) = (names(all.1), names(behind));
        let mut words = Vec::new();
        if campaign.len() < all.1.len() && !of_all.is_empty() {
            words.push(format!(
                "left as they are, because they take all flights together (--flight names {}): {}",
                list(&self.flights),
                of_all.join(", ")
            ));
        }
        if let Some(until) = self.until.as_ref().filter(|_| !behind.is_empty()) {
            words.push(format!(
                "left as they are, because the run ends with {until}: {}",
                behind.join(", ")
            ));
        }
        words
    }
}
