//! Times of one topic in file order in; stretches of them that another clock gave, out.
//!
//! A record goes forward in time, over pauses of any length. What another clock gave is jumped to and left
//! again: what goes forward and has the most messages is the record, and what lies before all of it, or behind
//! all of it, is of another clock. Messages that come late lie in the record, or adjoin it.

use super::turned::{FEW, MOST, is_shuffled};
use std::ops::Range;

/// What another clock gave, on one side of the record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Astray {
    /// In file order.
    pub runs: Vec<Range<usize>>,
    /// First and last time of the record, and of what is astray, ns.
    pub record: (i64, i64),
    pub span: (i64, i64),
}

/// Messages one behind the other without a jump, with their first and last time.
struct Run {
    at: Range<usize>,
    first: i64,
    last: i64,
}

impl Run {
    /// How far from another one; 0 where they overlap.
    fn distance(&self, other: &Run) -> i64 {
        let ahead = self.first.saturating_sub(other.last);
        ahead.max(other.first.saturating_sub(self.last)).max(0)
    }
}

/// What another clock gave; steps of more than `apart`, ns, are jumps.
pub fn astray(times: &[i64], apart: i64) -> Vec<Astray> {
    let runs = runs(times, apart);
    if runs.windows(2).all(|w| w[1].first >= w[0].last) {
        return Vec::new();
    }
    let mut is_record = forward(&runs, apart);
    give_up_ends(&runs, &mut is_record, apart);
    take_late(&runs, &mut is_record, apart);
    let of_record = || runs.iter().zip(&is_record).filter(|(_, is)| **is).map(|(run, _)| run);
    let (Some(from), Some(to)) =
        (of_record().map(|run| run.first).min(), of_record().map(|run| run.last).max())
    else {
        return Vec::new();
    };
    let sides = [
        runs.iter().filter(|run| run.last < from).collect::<Vec<_>>(),
        runs.iter().filter(|run| run.first > to).collect(),
    ];
    sides.iter().filter_map(|side| of_side(times, side, (from, to))).collect()
}

/// What is astray on one side. A few messages are errors of theirs, and what is in no order is of no clock.
fn of_side(times: &[i64], side: &[&Run], record: (i64, i64)) -> Option<Astray> {
    let given: Vec<i64> = side.iter().flat_map(|run| &times[run.at.clone()]).copied().collect();
    if given.len() < FEW || is_shuffled(&given) {
        return None;
    }
    let span = (*given.iter().min()?, *given.iter().max()?);
    Some(Astray { runs: side.iter().map(|run| run.at.clone()).collect(), record, span })
}

fn runs(times: &[i64], apart: i64) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for (k, &time) in times.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if time.saturating_sub(times[k - 1]).saturating_abs() <= apart => {
                run.at.end = k + 1;
                (run.first, run.last) = (run.first.min(time), run.last.max(time));
            }
            _ => runs.push(Run { at: k..k + 1, first: time, last: time }),
        }
    }
    runs
}

/// Which runs are of the sequence that goes forward and has the most messages.
fn forward(runs: &[Run], apart: i64) -> Vec<bool> {
    let mut ends: Vec<i64> = runs.iter().map(|run| run.last).collect();
    ends.sort_unstable();
    ends.dedup();
    // the heaviest sequence that ends no later than the place says, as a tree of prefixes (Fenwick)
    let mut heaviest: Vec<(usize, Option<usize>)> = vec![(0, None); ends.len() + 1];
    let mut before: Vec<Option<usize>> = Vec::with_capacity(runs.len());
    let mut all = (0, None);
    for (k, run) in runs.iter().enumerate() {
        let mut place = ends.partition_point(|end| *end <= run.first.saturating_add(apart));
        let mut longest = (0, None);
        while place > 0 {
            longest = longest.max(heaviest[place]);
            place &= place - 1;
        }
        before.push(longest.1);
        let with = (longest.0 + run.at.len(), Some(k));
        all = all.max(with);
        let mut place = ends.partition_point(|end| *end < run.last) + 1;
        while place < heaviest.len() {
            heaviest[place] = heaviest[place].max(with);
            place += place & place.wrapping_neg();
        }
    }
    let mut is_record = vec![false; runs.len()];
    let mut at = all.1;
    while let Some(k) = at {
        is_record[k] = true;
        at = before[k];
    }
    is_record
}

/// The other clock may have given the first messages of a file, or the last ones: these go forward, too. Such
/// a run is not of the record where others beside it, as many or more, are not.
fn give_up_ends(runs: &[Run], is_record: &mut [bool], apart: i64) {
    for is_last in [false, true] {
        for _ in 0..MOST {
            let mut ends: Vec<usize> = (0..runs.len()).filter(|k| is_record[*k]).collect();
            if is_last {
                ends.reverse();
            }
            let [end, next, ..] = ends[..] else { break };
            let (end_run, next_run) = (&runs[end], &runs[next]);
            let is_beyond = |run: &Run| match is_last {
                true => run.first > next_run.last.saturating_add(apart),
                false => run.last < next_run.first.saturating_sub(apart),
            };
            let beside = runs.iter().zip(&*is_record).filter(|(run, is)| {
                !**is && is_beyond(run) && run.distance(end_run) < run.distance(next_run)
            });
            let beside: usize = beside.map(|(run, _)| run.at.len()).sum();
            if !is_beyond(end_run) || beside < end_run.at.len() {
                break;
            }
            is_record[end] = false;
        }
    }
}

/// Takes up what lies in the record or adjoins it, or what does so: it came late.
fn take_late(runs: &[Run], is_record: &mut [bool], apart: i64) {
    let mut ordered: Vec<usize> = (0..runs.len()).collect();
    ordered.sort_by_key(|k| runs[*k].first);
    let mut latest = i64::MIN;
    let adjoining = ordered.chunk_by(|a, b| {
        latest = latest.max(runs[*a].last);
        runs[*b].first <= latest.saturating_add(apart)
    });
    for together in adjoining {
        if together.iter().any(|k| is_record[*k]) {
            together.iter().for_each(|k| is_record[*k] = true);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    /// 6000 messages every 20 ms, changed.
    fn with(change: impl Fn(usize, &mut i64)) -> Vec<i64> {
        let mut times: Vec<i64> = (0..6000).map(|k| 10_000 * S + 20_000_000 * k).collect();
        times.iter_mut().enumerate().for_each(|(k, t)| change(k, t));
        times
    }

    fn messages(times: &[i64]) -> Vec<usize> {
        astray(times, S).into_iter().flat_map(|of| of.runs).flatten().collect()
    }

    #[test]
    fn what_is_jumped_to_and_left_again_is_astray() {
        for by in [-5000 * S, 5000 * S] {
            for (first, every) in [(7, 20), (0, 20), (19, 20), (3, 5), (1, 3)] {
                let is_other = |k: usize| k % every == first;
                let times = with(|k, t| *t += if is_other(k) { by } else { 0 });
                let wanted: Vec<usize> = (0..6000).filter(|k| is_other(*k)).collect();
                assert_eq!(messages(&times), wanted, "{by} {first} of {every}");
            }
            let times = with(|k, t| *t += if (2000..2300).contains(&k) { by } else { 0 });
            assert_eq!(messages(&times), (2000..2300).collect::<Vec<_>>(), "{by}");
            let found = astray(&times, S);
            let span = (10_040 * S + by, 10_045_980_000_000 + by);
            assert_eq!((found[0].record, found[0].span), ((10_000 * S, 10_119_980_000_000), span));
        }
    }

    #[test]
    fn pauses_and_late_messages_are_not() {
        let paused = with(|k, t| *t += if k >= 3000 { 600 * S } else { 0 });
        assert!(messages(&paused).is_empty());
        // what came before the pause stands in the file behind what came after it
        let mut late = paused.clone();
        late[2500..3500].rotate_left(500);
        assert!(messages(&late).is_empty());
        let shuffled: Vec<i64> = (0..6000).map(|k| paused[k * 2503 % 6000]).collect();
        assert!(messages(&shuffled).is_empty());
        let two = with(|k, t| *t -= if (400..402).contains(&k) { 5000 * S } else { 0 });
        assert!(messages(&two).is_empty());
    }
}
