//! Times of one topic in file order in; where the clock was set back while it was recorded, and what
//! lies in the time that came twice, out.
//!
//! A message that comes late fills a hole that it left; many that come late together fill as many.
//! Behind a clock that was set back messages go on at their usual spacing among others that are there
//! already: twice as many as there is room for. Which of both was when cannot be known. A message that
//! stands there twice is none of these.

/// A time that came twice, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Back {
    /// The first message behind the clock that was set back.
    pub at: usize,
    /// By how much it was.
    pub by: i64,
    /// The time of which there are messages of before and of behind.
    pub from: i64,
    pub to: i64,
}

impl Back {
    /// Whether a time came twice.
    pub fn holds(&self, time: i64) -> bool {
        (self.from..=self.to).contains(&time)
    }

    /// By how much the clock was set back, s.
    pub fn seconds(&self) -> f64 {
        self.by as f64 / 1e9
    }
}

/// Messages of either side that a time which came twice has at least.
pub const FEW: usize = 3;
/// Messages for one that there is room for, at least.
const CROWDED: f64 = 1.5;
/// Steps back of several messages that are looked at.
pub const MOST: usize = 20;
/// A log that steps back behind more than this share of its messages is shuffled.
const SHUFFLED: f64 = 0.3;

/// Every place where the clock was set back; `same`: whether two messages of one time say the same.
pub fn turned_back(times: &[i64], same: impl Fn(usize, usize) -> bool) -> Vec<Back> {
    if times.is_sorted() || is_shuffled(times) {
        return Vec::new();
    }
    let Some(spacing) = usual(times) else { return Vec::new() };
    let (mut all, mut latest, mut looked) = (Vec::new(), i64::MIN, 0);
    for k in 0..times.len() {
        let steps_back = k > 0 && times[k] < times[k - 1] && times[k - 1] == latest;
        // a message or two that come late are nothing to look at
        if steps_back && looked < MOST && several(times, k, latest) {
            looked += 1;
            all.extend(twice(times, (k, latest), spacing as f64, &same));
        }
        latest = latest.max(times[k]);
    }
    all
}

/// Whether so many messages step back that the log is in no order at all.
pub fn is_shuffled(times: &[i64]) -> bool {
    let backs = times.windows(2).filter(|w| w[1] < w[0]).count();
    backs as f64 > SHUFFLED * times.len() as f64
}

/// The usual step forward, ns.
pub fn usual(times: &[i64]) -> Option<i64> {
    let mut steps: Vec<i64> =
        times.windows(2).map(|w| w[1].saturating_sub(w[0])).filter(|d| *d > 0).collect();
    let middle = steps.len() / 2;
    (!steps.is_empty()).then(|| *steps.select_nth_unstable(middle).1)
}

/// Whether several messages from the one at `k` on are no later than the latest before it, and several
/// before it no earlier than it.
pub fn several(times: &[i64], k: usize, latest: i64) -> bool {
    let all = |few: &mut dyn Iterator<Item = &i64>, is: &dyn Fn(i64) -> bool| {
        few.take(FEW).filter(|t| is(**t)).count() == FEW
    };
    all(&mut times[k..].iter(), &|t| t <= latest)
        && all(&mut times[..k].iter().rev(), &|t| t >= times[k])
}

/// The time that came twice as the clock was set back to the message at `k`, where one did. Only the time
/// that both sides have counts: the clock may go back to before the record, and the record may end before
/// the clock is there again.
fn twice(
    times: &[i64],
    (k, latest): (usize, i64),
    spacing: f64,
    same: &impl Fn(usize, usize) -> bool,
) -> Option<Back> {
    let before = times[..k].iter().rev().take_while(|t| **t >= times[k]).count();
    let run = times[k..].iter().take_while(|t| **t <= latest).count();
    let (of_before, of_run) = (&times[k - before..k], &times[k..k + run]);
    let from = *of_before.iter().min()?.max(of_run.iter().min()?);
    let to = *of_run.iter().max()?.min(&latest);
    let count = |of: &[i64]| of.iter().filter(|t| (from..=to).contains(*t)).count();
    let (before_it, behind) = (count(of_before), count(of_run));
    let room = to.saturating_sub(from) as f64 / spacing + 1.0;
    let crowded = |behind: usize| {
        before_it.min(behind) >= FEW && (before_it + behind) as f64 >= CROWDED * room
    };
    // what stands there twice is counted once, where it matters
    let is_twice = from <= to
        && crowded(behind)
        && crowded(behind.saturating_sub(repeated(times, (k - before, k, k + run), same)));
    let by = latest.saturating_sub(times[k]);
    is_twice.then_some(Back { at: k, by, from, to })
}

/// How many of the messages `from..end` say the same as one of the same time among those from `first`
/// to before `from`.
fn repeated(
    times: &[i64],
    (first, from, end): (usize, usize, usize),
    same: &impl Fn(usize, usize) -> bool,
) -> usize {
    let mut known: Vec<usize> = (first..from).collect();
    known.sort_by_key(|at| times[*at]);
    let is_known = |at: &usize| {
        let place = known.partition_point(|of| times[*of] < times[*at]);
        known.get(place).is_some_and(|of| times[*of] == times[*at] && same(*of, *at))
    };
    (from..end).filter(is_known).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn other(_: usize, _: usize) -> bool {
        false
    }

    fn grid(n: i64) -> Vec<i64> {
        (0..n).map(|k| 10_000_000 * k).collect()
    }

    #[test]
    fn a_clock_set_back_is_found_and_late_messages_are_none() {
        let mut back = grid(600);
        back[300..].iter_mut().for_each(|t| *t -= 310_000_000);
        let found = Back { at: 300, by: 300_000_000, from: 2_690_000_000, to: 2_990_000_000 };
        assert_eq!(turned_back(&back, other), [found]);
        assert_eq!(turned_back(&grid(600), other), []);
        // one late message, two that changed places, and fifteen that came late together
        let mut late = grid(600);
        late[100..111].rotate_left(1);
        late.swap(200, 201);
        late[300..330].rotate_left(15);
        assert_eq!(turned_back(&late, other), []);
        // with many late ones before it
        (0..100).for_each(|k| back.swap(2 * k, 2 * k + 1));
        assert_eq!(turned_back(&back, other).len(), 1);
    }

    #[test]
    fn what_stands_there_twice_is_no_clock_set_back() {
        let mut twice = grid(600);
        twice.splice(400..400, grid(600)[350..400].to_vec());
        assert_eq!(turned_back(&twice, |_, _| true), []);
        let found = Back { at: 400, by: 490_000_000, from: 3_500_000_000, to: 3_990_000_000 };
        assert_eq!(turned_back(&twice, other), [found]);
    }

    #[test]
    fn only_the_time_that_both_sides_have_came_twice() {
        // set back by 5 s, and the record ends 1 s later
        let mut short = grid(700);
        short[600..].iter_mut().for_each(|t| *t -= 5_000_000_000);
        let found = Back { at: 600, by: 4_990_000_000, from: 1_000_000_000, to: 1_990_000_000 };
        assert_eq!(turned_back(&short, other), [found]);
        // set back by 5 s after 2 s, and recorded on for 10 s
        let mut beyond = grid(1200);
        beyond[200..].iter_mut().for_each(|t| *t -= 5_000_000_000);
        let found = Back { at: 200, by: 4_990_000_000, from: 0, to: 1_990_000_000 };
        assert_eq!(turned_back(&beyond, other), [found]);
    }

    #[test]
    fn a_clock_that_begins_anew_elsewhere_has_no_time_twice() {
        let mut anew = grid(600);
        anew[300..].iter_mut().for_each(|t| *t -= 9_000_000_000_000);
        assert_eq!(turned_back(&anew, other), []);
        // shuffled: every other one is behind a later one
        let shuffled: Vec<i64> = (0..600).map(|k| 10_000_000 * (k * 331 % 600)).collect();
        assert_eq!(turned_back(&shuffled, other), []);
        assert_eq!(turned_back(&[], other), []);
        assert_eq!(turned_back(&[5, 5, 5], other), []);
    }
}
