//! Times of one topic in file order in; where its clock was set back to before what it had recorded, or went
//! forth and back, so that two clocks gave its times, out.
//!
//! Sorted, both would stand in one signal as if they were of one clock, the later part before the earlier
//! one. A block of messages that come late is none of these: it adjoins what is there already.

use super::astray::{Astray, astray};
use super::by_turns::{ByTurns, by_turns};
use super::series::{DAY_NS, seconds};
use super::turned::{FEW, MOST, is_shuffled, several, usual};
use std::ops::Range;

/// What to do where neither clock gave few.
pub const HELP: &str = "make a log of each part, or take times of another clock: time = \"log\", \"publish\" or a field of the message";

/// What is further from all else than this, ns, and than so many usual steps, adjoins nothing.
const APART: i64 = 1_000_000_000;
const STEPS: i64 = 10;
/// Messages of the clock that gave fewer can be left out up to this share of their topic's; of more nobody can
/// say which of both was right. What lies in a time that came twice (`turned`) is no part of them.
pub const SHARE: f64 = 0.1;

/// A place where a clock was set back, and what it gave before and behind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Two {
    /// The first message behind it.
    pub at: usize,
    /// By how much, ns.
    pub by: i64,
    /// First and last time of the others, and of those that the clock gave behind it, ns.
    pub others: (i64, i64),
    pub behind: (i64, i64),
    /// The messages of the clock that gave fewer, ascending.
    pub fewer: Vec<usize>,
    /// How often it went forth and back; 0 where it was set back, and that was all.
    pub turns: usize,
}

impl Two {
    /// In words: both clocks.
    pub fn words(&self) -> String {
        let [a, b, c, d] =
            [self.others.0, self.others.1, self.behind.0, self.behind.1].map(seconds);
        let by = seconds(self.by);
        let how = match self.turns {
            0 => format!("was set back by {by:.3} s, to before what it had recorded"),
            1 => format!("went forth and back by {by:.3} s"),
            n => format!("went forth and back by {by:.3} s, {n} times"),
        };
        format!("the clock {how}: two clocks gave {a:.3} to {b:.3} s and {c:.3} to {d:.3} s")
    }
}

/// The place that most hangs on, where all that the rarer clocks gave is too much to be left out of so many
/// messages, or is at too many places for all to be found.
pub fn too_many(all: &[Two], of: usize) -> Option<&Two> {
    let fewer: usize = all.iter().map(|two| two.fewer.len()).sum();
    let is_much = fewer as f64 > SHARE * of as f64 || all.len() >= MOST;
    all.iter().max_by_key(|two| two.fewer.len()).filter(|_| is_much)
}

/// How many messages the rarer clocks gave, in words.
pub fn share(all: &[Two], of: usize, what: &str) -> String {
    let fewer: usize = all.iter().map(|two| two.fewer.len()).sum();
    let percent = 100.0 * fewer as f64 / of.max(1) as f64;
    format!("{fewer} of {of} {what} ({percent:.0} %) are of the one that gave fewer")
}

/// The messages that are left out of a topic, because its clock was set back and gave few others, with the
/// places where it was. Those more than a day from the others are told elsewhere.
///
/// # Errors
/// In words: it gave too many others.
pub fn left_out(stamps: &[Option<i64>]) -> Result<Vec<Two>, String> {
    if stamps.iter().flatten().is_sorted() {
        return Ok(Vec::new());
    }
    let mut known: Vec<i64> = stamps.iter().copied().flatten().collect();
    let middle = known.len() / 2;
    let middle = *known.select_nth_unstable(middle).1;
    let near = |stamp: i64| stamp.saturating_sub(middle).saturating_abs() <= DAY_NS;
    let (rows, times): (Vec<usize>, Vec<i64>) = (stamps.iter().enumerate())
        .filter_map(|(row, stamp)| stamp.filter(|stamp| near(*stamp)).map(|stamp| (row, stamp)))
        .unzip();
    let mut all = two_clocks(&times);
    if let Some(many) = too_many(&all, times.len()) {
        return Err(format!("{}; {}", many.words(), share(&all, times.len(), "messages")));
    }
    for two in &mut all {
        two.fewer.iter_mut().for_each(|k| *k = rows[*k]);
    }
    Ok(all)
}

/// Every place where a clock was set back so, or went forth and back. What the rarer of two clocks gave is left
/// out before the next one is looked for.
pub fn two_clocks(times: &[i64]) -> Vec<Two> {
    let mut found = beside(times);
    let mut is_kept = vec![true; times.len()];
    found.iter().flat_map(|two| &two.fewer).for_each(|&k| is_kept[k] = false);
    let mut kept: Vec<usize> = (0..times.len()).filter(|k| is_kept[*k]).collect();
    while found.len() < MOST {
        let left: Vec<i64> = kept.iter().map(|&k| times[k]).collect();
        let Some((block, by)) = set_back(&left) else { break };
        let (of_block, others): (Vec<usize>, Vec<usize>) =
            (0..left.len()).partition(|k| block.contains(k));
        let span = |of: &[usize]| {
            let (first, last) =
                (of.iter().map(|&k| left[k]).min(), of.iter().map(|&k| left[k]).max());
            (first.unwrap_or(0), last.unwrap_or(0))
        };
        let fewer = if of_block.len() <= others.len() { &of_block } else { &others };
        found.push(Two {
            at: kept[block.start],
            by,
            others: span(&others),
            behind: span(&of_block),
            fewer: fewer.iter().map(|&k| kept[k]).collect(),
            turns: 0,
        });
        let mut gone = fewer.iter().peekable();
        let mut place = 0;
        kept.retain(|_| {
            let goes = gone.next_if_eq(&&place).is_some();
            place += 1;
            !goes
        });
    }
    found
}

/// What another clock gave beside the record, whole or message by message.
fn beside(times: &[i64]) -> Vec<Two> {
    if times.is_sorted() {
        return Vec::new();
    }
    // one by one, two clocks step far all the time: the usual step is that of their times in order
    let mut ordered = times.to_vec();
    ordered.sort_unstable();
    let Some(usual) = usual(&ordered) else { return Vec::new() };
    let apart = APART.max(usual.saturating_mul(STEPS));
    let found: Vec<Two> =
        astray(times, apart).iter().filter_map(|of| of_astray(times, of)).collect();
    // where both went on over the same time, only the ends of the one are beside the record
    let beside: usize = found.iter().map(|two| two.fewer.len()).sum();
    let turns = by_turns(times, apart).and_then(|of| of_turns(times, &of));
    match turns.filter(|two| two.fewer.len() > beside) {
        Some(two) => vec![two],
        None => found,
    }
}

/// What the rarer of two clocks gave that took turns over the same time.
fn of_turns(times: &[i64], of: &ByTurns) -> Option<Two> {
    let (ahead, others): (Vec<usize>, Vec<usize>) =
        (0..times.len()).partition(|&k| of.is_ahead.get(k) == Some(&true));
    let (fewer, more) = if ahead.len() <= others.len() { (ahead, others) } else { (others, ahead) };
    let at = *fewer.first()?;
    let turns = 1 + fewer.windows(2).filter(|w| w[1] > w[0] + 1).count();
    let span = |of: &[usize]| {
        let times = || of.iter().map(|&k| times[k]);
        times().min().zip(times().max())
    };
    Some(Two { at, by: of.by, others: span(&more)?, behind: span(&fewer)?, fewer, turns })
}

fn of_astray(times: &[i64], of: &Astray) -> Option<Two> {
    let first = of.runs.first()?;
    let at = if first.start == 0 { first.end } else { first.start };
    let by = times.get(at)?.saturating_sub(*times.get(at.checked_sub(1)?)?).saturating_abs();
    // one run at an end of the file has one step beside it, and that is back: ahead would be a pause
    let is_at_end = first.start == 0 || first.end == times.len();
    let turns = if of.runs.len() == 1 && is_at_end { 0 } else { of.runs.len() };
    let fewer = of.runs.iter().cloned().flatten().collect();
    Some(Two { at, by, others: of.record, behind: of.span, fewer, turns })
}

/// The first block of messages that another clock gave than those before it, and by how much that was set
/// back.
fn set_back(times: &[i64]) -> Option<(Range<usize>, i64)> {
    if times.is_sorted() || is_shuffled(times) {
        return None;
    }
    let apart = APART.max(usual(times)?.saturating_mul(STEPS));
    let (mut latest, mut looked) = (i64::MIN, 0);
    for k in 0..times.len() {
        let steps_back = k > 0 && times[k] < times[k - 1] && times[k - 1] == latest;
        if steps_back && looked < MOST && several(times, k, latest) {
            looked += 1;
            let run = times[k..].iter().take_while(|t| **t <= latest).count();
            if is_of_another(times, k..k + run, apart) {
                return Some((k..k + run, latest.saturating_sub(times[k])));
            }
        }
        latest = latest.max(times[k]);
    }
    None
}

/// Whether a block of messages adjoins none of those before it, or begins before all of them and ends
/// among them.
fn is_of_another(times: &[i64], block: Range<usize>, apart: i64) -> bool {
    let (before, of_block) = (&times[..block.start], &times[block.clone()]);
    let (Some(&first), Some(&last)) = (of_block.iter().min(), of_block.iter().max()) else {
        return false;
    };
    let (from, to) = (first.saturating_sub(apart), last.saturating_add(apart));
    let near = before.iter().filter(|t| (from..=to).contains(*t)).count();
    if near == 0 {
        return true;
    }
    let inside = before.iter().filter(|t| (first..=last).contains(*t)).count();
    let is_before_all = before.iter().all(|t| *t > first.saturating_add(apart));
    // where it goes on beyond them, one clock gave all that has no time twice
    let ends = times.get(block.end).is_none_or(|next| next.saturating_sub(last) > apart);
    inside >= FEW && is_before_all && ends
}

#[cfg(test)]
#[path = "clocks_tests.rs"]
mod tests;
