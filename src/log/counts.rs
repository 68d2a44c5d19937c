//! The channels of the messages that were read in; how many there are of each, and where the log
//! counts others, out.

use super::Note;
use super::channel::Channel;
use super::records::Statistics;
use std::collections::{BTreeMap, BTreeSet};

/// How many messages of each channel were read.
#[derive(Debug, Clone, Default)]
pub struct Counts(Vec<u64>);

impl Counts {
    #[inline]
    pub fn add(&mut self, channel: u16) {
        let at = usize::from(channel);
        match self.0.get_mut(at) {
            Some(count) => *count += 1,
            None => {
                self.0.resize(at + 1, 0);
                self.0[at] = 1;
            }
        }
    }

    pub fn merge(&mut self, others: &Counts) {
        if self.0.len() < others.0.len() {
            self.0.resize(others.0.len(), 0);
        }
        self.0.iter_mut().zip(&others.0).for_each(|(count, other)| *count += other);
    }

    fn of(&self, channel: u16) -> u64 {
        self.0.get(usize::from(channel)).copied().unwrap_or(0)
    }

    /// A note for every channel of which the log counts more messages, or fewer, and one for messages
    /// of channels that the log does not name.
    pub(super) fn against(
        &self,
        told: Option<&Statistics>,
        channels: &BTreeMap<u16, Channel>,
    ) -> Vec<Note> {
        let name = |id: u16| channels.get(&id).map_or("file", |c| c.topic.as_str());
        let mut notes = Vec::new();
        if let Some(told) = told {
            let ids: BTreeSet<u16> = told.messages.keys().chain(channels.keys()).copied().collect();
            for id in ids {
                let (all, read) = (told.messages.get(&id).copied().unwrap_or(0), self.of(id));
                let (topic, off) = (name(id), all.abs_diff(read));
                let text = match all.cmp(&read) {
                    std::cmp::Ordering::Equal => continue,
                    std::cmp::Ordering::Greater => {
                        format!(
                            "{topic}: {off} of {all} messages that the log counts are not there"
                        )
                    }
                    std::cmp::Ordering::Less => {
                        format!("{topic}: {off} messages more than the {all} that the log counts")
                    }
                };
                notes.push(Note::warning(topic, off, text));
            }
        }
        let strange: u64 = (0..=u16::MAX)
            .zip(&self.0)
            .filter(|(id, _)| !channels.contains_key(id))
            .map(|(_, count)| count)
            .sum();
        if strange > 0 {
            let text = format!("{strange} messages are of channels that the log does not name");
            notes.push(Note::warning("file", strange, text));
        }
        notes
    }
}
