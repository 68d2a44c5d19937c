//! Times of one topic in file order in; which of them another clock gave that took turns with the first over
//! the same time, out.
//!
//! Two clocks that take turns are apart by the same all the time: it goes ahead by that at one turn, and back at
//! the next. Messages that come late by the same all the time look alike, but for their ends: of a record of 100 s
//! both cover the same 0 to 100 s, where one of two clocks covers 0 to 100 s and the other 5 to 105 s (a record that
//! begins and ends while messages come late looks like two clocks: by stamps alone nobody can say). And a
//! clock goes on from message to message, which a table in another order than that of time does not.

use super::turned::FEW;

/// The messages of the clock that is ahead, and how far it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ByTurns {
    /// By message.
    pub is_ahead: Vec<bool>,
    /// ns.
    pub by: i64,
}

/// Jumps that are alike are so to within this share of them, and this share of all jumps is alike.
const WITHIN: f64 = 0.25;
const ALIKE: f64 = 0.9;
/// Of the messages of one clock so many may stand behind a later one of it.
const LATE: f64 = 0.01;

/// The clock that takes turns with another, where there is one; steps of more than `apart`, ns, are jumps.
pub fn by_turns(times: &[i64], apart: i64) -> Option<ByTurns> {
    let jumps = jumps(times, apart);
    let far = |ahead: bool| -> Vec<i64> {
        let of = jumps.iter().filter(|jump| jump.is_ahead == ahead);
        of.filter(|jump| (jump.by > 0) == ahead).map(|jump| jump.by.saturating_abs()).collect()
    };
    let (ahead, back) = (far(true), far(false));
    // between two turns each clock goes on: a turn ahead is that much longer than one back
    let by = middle(&ahead)?.saturating_add(middle(&back)?) / 2;
    let alike = |all: &[i64]| {
        let count = all.iter().filter(|jump| is_near(**jump, by)).count();
        count >= FEW && count as f64 >= ALIKE * all.len() as f64
    };
    if !alike(&ahead) || !alike(&back) {
        return None;
    }
    let is_ahead = sides(times.len(), &jumps);
    let [first, second] = [false, true].map(|side| span(times, &is_ahead, side));
    let ((from, to), (later_from, later_to)) = (first?, second?);
    let is_shifted =
        is_near(later_from.saturating_sub(from), by) && is_near(later_to.saturating_sub(to), by);
    let goes_on = [false, true].iter().all(|side| goes_on(times, &is_ahead, *side, apart));
    (is_shifted && goes_on && !is_repeated(times, &is_ahead)).then_some(ByTurns { is_ahead, by })
}

/// A step that is far.
struct Jump {
    /// The message behind it.
    at: usize,
    by: i64,
    /// It leads to the clock that is ahead. One that is followed by another ahead is a pause.
    is_ahead: bool,
}

fn jumps(times: &[i64], apart: i64) -> Vec<Jump> {
    let steps = times.windows(2).map(|w| w[1].saturating_sub(w[0])).enumerate();
    let mut jumps: Vec<Jump> = steps
        .filter(|(_, by)| by.saturating_abs() > apart)
        .map(|(k, by)| Jump { at: k + 1, by, is_ahead: by > 0 })
        .collect();
    for k in 1..jumps.len() {
        let is_pause = jumps[k - 1].by > 0 && jumps[k].by > 0;
        jumps[k - 1].is_ahead &= !is_pause;
    }
    jumps
}

/// Which messages are of the clock that is ahead, by the jumps to it and back.
fn sides(count: usize, jumps: &[Jump]) -> Vec<bool> {
    let mut is_ahead = jumps.first().is_some_and(|jump| jump.by < 0);
    let mut next = jumps.iter().peekable();
    let side = |k: usize| {
        if let Some(jump) = next.next_if(|jump| jump.at == k) {
            is_ahead = jump.is_ahead;
        }
        is_ahead
    };
    (0..count).map(side).collect()
}

/// First and last time of the messages of one side.
fn span(times: &[i64], is_ahead: &[bool], side: bool) -> Option<(i64, i64)> {
    let of = || times.iter().zip(is_ahead).filter(|(_, is)| **is == side).map(|(t, _)| *t);
    of().min().zip(of().max())
}

/// Whether most messages of the rarer side have the time of one of the other: a link sends them again, and they
/// are of one clock.
fn is_repeated(times: &[i64], is_ahead: &[bool]) -> bool {
    let of = |side: bool| -> Vec<i64> {
        let these = times.iter().zip(is_ahead).filter(|(_, is)| **is == side);
        these.map(|(t, _)| *t).collect()
    };
    let [mut one, mut other] = [of(false), of(true)];
    if one.len() > other.len() {
        std::mem::swap(&mut one, &mut other);
    }
    other.sort_unstable();
    let again = one.iter().filter(|t| other.binary_search(t).is_ok()).count();
    2 * again > one.len()
}

/// Whether the messages of one side follow each other in time, but for a few.
fn goes_on(times: &[i64], is_ahead: &[bool], side: bool, apart: i64) -> bool {
    let (mut count, mut late, mut last) = (0, 0, i64::MIN);
    for (time, _) in times.iter().zip(is_ahead).filter(|(_, is)| **is == side) {
        count += 1;
        late += usize::from(*time < last.saturating_sub(apart));
        last = last.max(*time);
    }
    late as f64 <= LATE * count as f64
}

fn is_near(value: i64, by: i64) -> bool {
    value.saturating_sub(by).saturating_abs() as f64 <= WITHIN * by as f64
}

fn middle(all: &[i64]) -> Option<i64> {
    let mut all = all.to_vec();
    let at = all.len() / 2;
    (!all.is_empty()).then(|| *all.select_nth_unstable(at).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    /// 6000 messages every 10 ms.
    fn grid() -> Vec<i64> {
        (0..6000).map(|k| 500 * S + 10_000_000 * k).collect()
    }

    #[test]
    fn fault_two_clocks_that_take_turns_over_one_time_are_told_apart() {
        for (first, every, by) in [(1, 2, 5), (0, 2, 5), (7, 20, 3), (19, 20, -3), (3, 5, -20)] {
            let is_other = |k: usize| k % every == first;
            let other = |(k, t): (usize, i64)| if is_other(k) { t + by * S } else { t };
            let times: Vec<i64> = grid().into_iter().enumerate().map(other).collect();
            let found = by_turns(&times, S).expect("two clocks");
            assert!((found.by - S * by.abs()).abs() <= 20_000_000, "{}", found.by);
            let is_right = |(k, ahead): (usize, &bool)| *ahead == (is_other(k) == (by > 0));
            assert!(found.is_ahead.iter().enumerate().all(is_right), "{first} {every} {by}");
        }
    }

    #[test]
    fn a_pause_of_both_clocks_changes_nothing() {
        for at in 3000..3004 {
            let change = |(k, t): (usize, i64)| {
                t + if k % 4 < 2 { 5 * S } else { 0 } + if k >= at { 60 * S } else { 0 }
            };
            let times: Vec<i64> = grid().into_iter().enumerate().map(change).collect();
            let found = by_turns(&times, S).expect("two clocks");
            let is_right = |(k, ahead): (usize, &bool)| *ahead == (k % 4 < 2);
            let wrong = found.is_ahead.iter().enumerate().filter(|of| !is_right(*of)).count();
            // one that pauses and goes back at once goes ahead for all that is known
            assert!(wrong <= 2, "{at}: {wrong}");
        }
    }

    #[test]
    fn messages_that_come_late_by_the_same_all_the_time_are_of_one_clock() {
        // every other one, and every twentieth one, 2 s behind the others of its time
        for every in [2, 20] {
            let of = |k: usize| k.is_multiple_of(every);
            let mut placed: Vec<(i64, i64)> = (grid().into_iter().enumerate())
                .map(|(k, t)| (t + if of(k) { 2 * S + 1 } else { 0 }, t))
                .collect();
            placed.sort_unstable();
            let times: Vec<i64> = placed.into_iter().map(|(_, t)| t).collect();
            assert!(times.windows(2).filter(|w| w[1] - w[0] < -S).count() > 100);
            assert_eq!(by_turns(&times, S), None, "{every}");
        }
        // sent again 2 s later, all of them and every fifth, by a link that ran before and goes on after
        for every in [1, 5] {
            let again = |k: i64| (k % every == 0).then_some(500 * S + 100_000_000 * k - 2 * S);
            let times: Vec<i64> = (0..600)
                .flat_map(|k| std::iter::once(500 * S + 100_000_000 * k).chain(again(k)))
                .collect();
            assert_eq!(by_turns(&times, S), None, "{every}");
        }
        // blocks that changed places two by two, and pauses
        let mut times = grid();
        times.chunks_mut(400).for_each(|two| two.rotate_left(200));
        assert_eq!(by_turns(&times, S), None);
        let pauses: Vec<i64> = grid().into_iter().map(|t| t + t / (10 * S) * 7 * S).collect();
        assert_eq!(by_turns(&pauses, S), None);
    }
}
