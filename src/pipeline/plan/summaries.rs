//! A channel map and logs come in; what these say at their ends against it (topics, fields, units), for
//! all logs at once, goes out.

use super::logs::FlightLog;
use crate::config::list;
use crate::error::{Error, Errors};
use crate::log::{self, Look, Mistake};
use crate::stage::Channels;
use rayon::prelude::*;
use std::path::Path;

/// Names of logs in one message; how many more there are is said.
const NAMED: usize = 4;

/// What the logs of a campaign say at their ends.
#[derive(Debug, Default)]
pub struct Summaries {
    /// Logs that were looked at, and those of them without a mistake.
    pub looked_at: usize,
    pub sound: usize,
    /// Every mistake once, with the logs it is one of.
    pub mistakes: Errors,
    /// The same of units that cannot be compared.
    pub remarks: Vec<Error>,
    /// Names of logs without a summary section, about which nothing is known before they are read.
    pub without: Vec<String>,
    /// Logs that cannot be read at all.
    pub unreadable: Errors,
}

impl Summaries {
    /// Whether there is no log that fits: the mistake is then one of the configuration, not of a
    /// flight.
    pub fn hopeless(&self) -> bool {
        !self.mistakes.is_empty() && self.sound == 0 && self.without.is_empty()
    }
}

/// Holds the channel map against the summary section of every log that is there.
pub fn summaries(channels: &Channels, logs: &[FlightLog]) -> Summaries {
    // what is there and no file is looked at as well, and told
    let is_there = |path: &&Path| path.symlink_metadata().is_ok();
    let there: Vec<&Path> = logs.iter().map(|log| log.path.as_path()).filter(is_there).collect();
    let looks: Vec<_> =
        there.par_iter().map(|path| log::look(path, &channels.map, &channels.doc)).collect();
    let mut all = Summaries::default();
    let mut seen: Vec<(String, Look)> = Vec::new();
    for (path, look) in there.iter().zip(looks) {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        match all.unreadable.take(look) {
            Some(look) if look.summary => seen.push((name, look)),
            Some(_) => all.without.push(name),
            None => {}
        }
    }
    all.looked_at = seen.len();
    all.sound = seen.iter().filter(|(_, look)| look.mistakes.is_empty()).count();
    all.mistakes = Errors(together(&seen, |look| &look.mistakes));
    all.remarks = together(&seen, |look| &look.remarks);
    all
}

/// Every mistake once, in the order in which it is met, with the names of the logs it is one of.
fn together(seen: &[(String, Look)], of: fn(&Look) -> &Vec<Mistake>) -> Vec<Error> {
    let mut met: Vec<(&Mistake, Vec<&str>)> = Vec::new();
    for (name, mistake) in
        seen.iter().flat_map(|(name, look)| of(look).iter().map(move |m| (name.as_str(), m)))
    {
        match met.iter_mut().find(|(known, _)| *known == mistake) {
            Some((_, names)) => names.push(name),
            None => met.push((mistake, vec![name])),
        }
    }
    met.sort_by(|a, b| a.0.place.cmp(&b.0.place));
    met.into_iter().map(|(mistake, names)| mistake.of(&listed(&names))).collect()
}

/// `a.mcap, b.mcap and 7 more logs`
fn listed(names: &[&str]) -> String {
    match names.len().saturating_sub(NAMED) {
        0 => list(names),
        1 => format!("{} and 1 more log", list(&names[..NAMED])),
        more => format!("{} and {more} more logs", list(&names[..NAMED])),
    }
}
