//! Times of one topic in file order in; where its clock was set back to before what it had recorded, or went
//! forth and back, so that two clocks gave its times, out.
//!
//! Sorted, both would stand in one signal as if they were of one clock, the later part before the earlier
//! one. A block of messages that come late is none of these: it adjoins what is there already.

use super::astray::{Astray, astray};
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
        return Err(many.words());
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
    let found = astray(times, APART.max(usual.saturating_mul(STEPS)));
    found.iter().filter_map(|of| of_astray(times, of)).collect()
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
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn grid(n: i64) -> Vec<i64> {
        (0..n).map(|k| 500 * S + 10_000_000 * k).collect()
    }

    fn with(n: i64, change: impl Fn(&mut [i64])) -> Vec<i64> {
        let mut times = grid(n);
        change(&mut times);
        times
    }

    #[test]
    fn a_clock_set_back_to_before_the_record_is_found_with_both_spans() {
        let times = with(1000, |t| t[600..].iter_mut().for_each(|t| *t -= 100 * S));
        let found = two_clocks(&times);
        assert_eq!(found.len(), 1);
        let two = &found[0];
        assert_eq!((two.at, two.by), (600, 100 * S - 10_000_000));
        assert_eq!(two.others, (500 * S, 505_990_000_000));
        assert_eq!(two.behind, (406 * S, 409_990_000_000));
        assert_eq!(two.fewer, (600..1000).collect::<Vec<_>>());
        assert_eq!(too_many(&found, 1000), Some(two));
        // a few before it, or a few behind it
        for (at, fewer) in [(50, 0..50), (950, 950..1000)] {
            let times = with(1000, |t| t[at..].iter_mut().for_each(|t| *t -= 100 * S));
            let found = two_clocks(&times);
            assert_eq!(found[0].fewer, fewer.collect::<Vec<_>>());
            assert!(found.len() == 1 && too_many(&found, 1000).is_none());
        }
    }

    #[test]
    fn messages_without_a_stamp_and_of_another_year_keep_their_places() {
        let times = with(1000, |t| t[960..].iter_mut().for_each(|t| *t -= 100 * S));
        let mut stamps: Vec<Option<i64>> = times.into_iter().map(Some).collect();
        (stamps[10], stamps[20]) = (None, Some(i64::MIN));
        let fewer = |stamps: &[Option<i64>]| left_out(stamps).map(|all| all[0].fewer.clone());
        assert_eq!(fewer(&stamps), Ok((960..1000).collect()));
        let many = with(1000, |t| t[600..].iter_mut().for_each(|t| *t -= 100 * S));
        let error = left_out(&many.into_iter().map(Some).collect::<Vec<_>>()).unwrap_err();
        assert!(
            error.contains("set back by 99.990 s")
                && error.contains("500.000 to 505.990 s and 406.000 to 409.990 s"),
            "{error}"
        );
    }

    #[test]
    fn a_clock_that_was_wrong_for_a_while_costs_that_while() {
        let times = with(1000, |t| t[300..340].iter_mut().for_each(|t| *t -= 100 * S));
        let found = two_clocks(&times);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].fewer, (300..340).collect::<Vec<_>>());
        // twice, by other steps
        let times = with(1000, |t| {
            t[300..340].iter_mut().for_each(|t| *t -= 100 * S);
            t[700..720].iter_mut().for_each(|t| *t -= 300 * S);
        });
        let left_out: Vec<usize> = two_clocks(&times).into_iter().flat_map(|t| t.fewer).collect();
        assert_eq!(left_out, (300..340).chain(700..720).collect::<Vec<_>>());
    }

    #[test]
    fn many_short_whiles_are_together_too_many() {
        let wrong = |each: usize| {
            with(3000, |t| {
                (0..15)
                    .for_each(|k| t[200 * k + 50..][..each].iter_mut().for_each(|t| *t -= 100 * S))
            })
        };
        let (few, many) = (two_clocks(&wrong(10)), two_clocks(&wrong(40)));
        assert_eq!((few.len(), few[0].turns, few[0].fewer.len()), (1, 15, 150));
        assert!(too_many(&few, 3000).is_none());
        assert!(too_many(&many, 3000).is_some(), "{}", many.len());
    }

    #[test]
    fn a_part_that_begins_before_the_record_and_ends_in_it_is_of_another_clock() {
        // ten seconds, then eight that end among them: 493 to 501 s
        let times = with(1800, |t| t[1000..].iter_mut().for_each(|t| *t -= 17 * S));
        assert_eq!(two_clocks(&times).len(), 1);
        // one that goes on beyond them: all that has no time twice is of the second clock
        let times = with(4000, |t| t[1000..].iter_mut().for_each(|t| *t -= 17 * S));
        assert_eq!(two_clocks(&times), []);
    }

    #[test]
    fn fault_clocks_that_take_turns_are_told_with_their_own_spans() {
        let turns = |every: usize, by: i64| {
            let times = with(6000, |t| t.iter_mut().skip(7).step_by(every).for_each(|t| *t += by));
            left_out(&times.into_iter().map(Some).collect::<Vec<_>>())
        };
        for by in [-5000 * S, 5000 * S] {
            let few = turns(20, by).expect("a twentieth");
            assert_eq!((few.len(), few[0].fewer.len(), few[0].turns), (1, 300, 300));
            let error = turns(5, by).expect_err("a fifth");
            let by = if by < 0 { "4999.990" } else { "5000.010" };
            assert!(error.contains(&format!("forth and back by {by} s, 1199 times")), "{error}");
            assert!(error.contains("gave 500.000 to 559.990 s and"), "{error}");
        }
        // a block ahead, and a pause
        let times = with(6000, |t| t[2000..2300].iter_mut().for_each(|t| *t += 5000 * S));
        let found = two_clocks(&times);
        assert_eq!((found.len(), &found[0].fewer), (1, &(2000..2300).collect::<Vec<_>>()));
        assert!(found[0].words().contains("went forth and back by 5000.010 s: two clocks"));
        let times = with(6000, |t| t[2000..].iter_mut().for_each(|t| *t += 600 * S));
        assert_eq!(two_clocks(&times), []);
    }

    #[test]
    fn late_blocks_and_small_steps_back_are_of_one_clock() {
        assert_eq!(two_clocks(&grid(1000)), []);
        assert_eq!(two_clocks(&[]), []);
        // the first half stands behind the second, a block stands behind a later one, some come late
        for change in [500, 300] {
            let times = with(1000, |t| t.rotate_left(change));
            assert_eq!(two_clocks(&times), [], "{change}");
        }
        assert_eq!(two_clocks(&with(1000, |t| t[100..400].rotate_left(150))), []);
        assert_eq!(two_clocks(&with(1000, |t| t[500..].iter_mut().for_each(|t| *t -= S))), []);
        // one message, and two, of another year
        let strays = with(1000, |t| t[400..402].iter_mut().for_each(|t| *t = 0));
        assert_eq!(two_clocks(&strays), []);
        let shuffled: Vec<i64> = (0..600).map(|k| 20 * S * (k * 331 % 600)).collect();
        assert_eq!(two_clocks(&shuffled), []);
    }
}
