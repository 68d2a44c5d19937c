//! What is worth saying about an estimate comes in; a note goes out.

use super::config::Config;
use crate::stage::{Note, Severity};

/// The stage's name.
pub const STAGE: &str = "estimate";

/// A note that names the estimate, about a flight or (empty) the campaign.
pub fn note(
    config: &Config,
    flight: &str,
    severity: Severity,
    subject: String,
    count: usize,
    text: String,
) -> Note {
    let text =
        if text.contains(&config.name()) { text } else { format!("{}: {text}", config.name()) };
    Note {
        flight: flight.to_string(),
        stage: STAGE.to_string(),
        severity,
        subject,
        count: count as u64,
        text,
    }
}
