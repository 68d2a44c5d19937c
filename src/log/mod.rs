//! Flight logs: MCAP files and a channel map in, signals in SI with their accounts out; and MCAP
//! files out.

pub mod agree;
mod around;
mod astray;
mod by_turns;
mod bytes;
mod channel;
pub mod channel_map;
mod chunk;
#[cfg(test)]
mod clock_tests;
mod clocks;
mod counts;
#[cfg(test)]
mod damage_tests;
pub mod decode;
pub mod file;
pub mod flight;
mod guess;
pub mod import;
pub mod inspect;
mod layout;
mod left_out;
mod listing;
pub mod memory;
mod parts;
mod pauses;
mod recorded;
mod records;
mod ros_units;
mod said;
mod search;
mod series;
mod shown;
mod signal;
mod source;
#[cfg(test)]
mod sources_tests;
mod stamps;
pub mod starter;
mod starter_texts;
#[cfg(test)]
mod storm_tests;
mod summary;
#[cfg(test)]
mod tests;
mod turned;
#[cfg(test)]
mod unseen_tests;
mod walk;
mod window;
mod words;
pub mod write;

pub use agree::{Look, Mistake, look};
pub use channel_map::{ChannelMap, SignalMap, TimeZero};
pub use chunk::Buffer;
pub use file::LogFile;
pub use flight::{FlightLog, SignalLog, read_flight};
pub use left_out::{Fate, Seen};
pub use recorded::Recorded;
pub use series::{Account, Series};
pub use write::{FieldSpec, LogWriter, Stream, TopicId};

use serde::Serialize;

/// How much a note matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing.
    Info,
    /// Something was lost or looks wrong; the result stands without it.
    Warning,
    /// Something that was asked for is not there.
    Missing,
}

/// Something lost or noticed while reading a log: what (a topic, a signal, `file`), how often, and
/// in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Note {
    pub severity: Severity,
    pub subject: String,
    pub count: u64,
    pub text: String,
}

impl Note {
    pub fn info(subject: impl Into<String>, count: u64, text: impl Into<String>) -> Note {
        Note { severity: Severity::Info, subject: subject.into(), count, text: text.into() }
    }

    pub fn warning(subject: impl Into<String>, count: u64, text: impl Into<String>) -> Note {
        Note { severity: Severity::Warning, subject: subject.into(), count, text: text.into() }
    }

    pub fn missing(subject: impl Into<String>, count: u64, text: impl Into<String>) -> Note {
        Note { severity: Severity::Missing, subject: subject.into(), count, text: text.into() }
    }
}
