//! The account of a signal and what was dropped of it in; what is said of that, in words, out.

use super::Note;
use super::channel_map::{SignalMap, Trend};
use super::clocks::{SHARE, Two};
use super::left_out::{Fate, Seen};
use super::series::{Account, Series, seconds};
use super::turned::Back;
use crate::units::Unit;

/// What became of the messages of a signal that has no sample; missing unless a log `may_lack` it.
pub(super) fn nothing_left(name: &str, a: &Account, may_lack: bool) -> Option<Note> {
    let fates = [
        (a.dropped_nan, "hold NaN"),
        (a.dropped_unreadable, "have no number in it, or no time stamp"),
        (a.dropped_out_of_range, "are outside its range"),
        (a.dropped_times, "have times of another clock"),
    ];
    let told: Vec<String> =
        fates.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
    let text = format!(
        "{} {}: no sample is left: of {} messages {}",
        a.topic,
        a.field,
        a.messages,
        told.join(", ")
    );
    let note = match may_lack {
        true => Note::warning(name, a.messages, text),
        false => {
            let remedy =
                "the flight is read without it (optional = true says that a log may lack it)";
            Note::missing(name, a.messages, format!("{text}; {remedy}"))
        }
    };
    (a.count == 0).then_some(note)
}

/// What is said of messages that another clock gave.
pub(super) fn another_clock(name: &str, a: &Account, clocks: &[Two]) -> Option<Note> {
    let first = clocks.first()?.words();
    let again = match clocks.len() {
        1 => String::new(),
        n => format!(" (and so at {} places more)", n - 1),
    };
    let text = format!(
        "{} {}: {first}{again}: {} of {} messages, of the one that gave fewer, dropped ({:.0} %; up to {:.0} % are)",
        a.topic,
        a.field,
        a.dropped_clock,
        a.messages,
        share(a.dropped_clock, a),
        100.0 * SHARE
    );
    Some(Note::warning(name, a.dropped_clock, text))
}

/// Messages in percent of all that the topic has.
fn share(dropped: u64, a: &Account) -> f64 {
    100.0 * dropped as f64 / a.messages.max(1) as f64
}

/// What is said of a time that came twice. Both clocks are right in it, so that the share of the rarer one
/// is nothing to go by.
pub(super) fn set_back(name: &str, a: &Account, twice: &[Back]) -> Option<Note> {
    let largest = twice.iter().max_by(|a, b| a.seconds().total_cmp(&b.seconds()))?;
    let [from, to] = [largest.from, largest.to].map(seconds);
    let text = format!(
        "{} {}: the clock was set back at {} place{} (by {:.3} s, so that {from:.3} to {to:.3} s came twice): {} of {} messages ({:.0} %) are of a time that came twice, in which nobody can say which was when: all of them are dropped, however many they are",
        a.topic,
        a.field,
        twice.len(),
        if twice.len() == 1 { "" } else { "s" },
        largest.seconds(),
        a.dropped_twice,
        a.messages,
        share(a.dropped_twice, a)
    );
    Some(Note::warning(name, a.dropped_twice, text))
}

/// Messages behind a later one, up to this share of all, are late ones; of more something else is wrong, that
/// sorting hides.
const LATE: f64 = 0.3;

/// What is said of messages that were sorted in.
pub(super) fn out_of_order(name: &str, a: &Account) -> Option<Note> {
    let text = format!(
        "{} {}: {} of {} messages out of order, sorted",
        a.topic, a.field, a.reordered, a.messages
    );
    if a.reordered as f64 > LATE * a.messages as f64 {
        let why = "so many are not late ones: two clocks or two sources may have given the times by turns, or blocks of the log changed places";
        return Some(Note::warning(name, a.reordered, format!("{text}; {why}")));
    }
    (a.reordered > 0).then(|| Note::info(name, a.reordered, text))
}

/// What is said of a sensor that stood still.
pub(super) fn stood_still(name: &str, a: &Account) -> Note {
    let [from, to] = a.still.unwrap_or([f64::NAN; 2]);
    let text = format!(
        "{} {}: stands still from {from:.1} to {to:.1} s although it flickered until then, as a live sensor does: {} samples are dropped (still = \"keep\" in the channel map keeps them)",
        a.topic, a.field, a.dropped_still
    );
    Note::warning(name, a.dropped_still, text)
}

/// Spikes that a note tells one by one.
const TOLD: usize = 3;

/// What is said of spikes, as the log has them.
pub(super) fn told(name: &str, signal: &SignalMap, unit: &Unit, left_out: &[Seen]) -> Option<Note> {
    let factor = f64::from(signal.sign) * signal.scale;
    let one = |seen: &&Seen| {
        let value = crate::math::digits(unit.from_si((seen.value - signal.offset) / factor));
        format!("{value} {} at {:.3} s", signal.unit, seen.t_s)
    };
    let spikes: Vec<&Seen> = left_out.iter().filter(|s| s.fate == Fate::Spike).collect();
    let first: Vec<String> = spikes.iter().take(TOLD).map(one).collect();
    let more = if spikes.len() > TOLD { ", ..." } else { "" };
    let text = format!(
        "{} {}: {} of its samples stand{} far out of {} neighbours, dropped (spikes = \"keep\" in the channel map keeps them): {}{more}",
        signal.topic,
        signal.field,
        spikes.len(),
        if spikes.len() == 1 { "s" } else { "" },
        if spikes.len() == 1 { "both" } else { "their" },
        first.join(", ")
    );
    (!spikes.is_empty()).then(|| Note::warning(name, spikes.len() as u64, text))
}

/// What a signal does that goes against what the map says of it, in the log's unit.
pub(super) fn against(
    name: &str,
    signal: &SignalMap,
    trend: Trend,
    series: &Series,
) -> Option<Note> {
    let (way, does, says) = match trend {
        Trend::Falls => (1.0, "rises", "falls"),
        Trend::Rises => (-1.0, "falls", "rises"),
    };
    let turned: Vec<f64> = series.value.iter().map(|value| way * value).collect();
    let rise = crate::signal::trend::rise(&series.t_s, &turned)?;
    let unit = Unit::parse(&signal.unit).ok()?;
    let text = format!(
        "{} {}: {does} by {:.4} {} from {:.0} to {:.0} s, but trend = \"{says}\" says that it only {says}; what follows from it is wrong in this flight \
         if the signal is (topic, field, unit and sign of the map; a tank that is not counted)",
        signal.topic,
        signal.field,
        unit.from_si(rise.by) - unit.from_si(0.0),
        signal.unit,
        rise.from_s,
        rise.to_s
    );
    Some(Note::warning(name, 1, text))
}
