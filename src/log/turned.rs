//! Times of one topic in file order in; where the clock was set back while it was recorded, and what
//! lies in the time that came twice, out.
//!
//! A message that comes late fills a hole that it left; many that come late together fill as many.
//! Behind a clock that was set back messages go on at their usual spacing among others that are there
//! already: twice as many as there is room for. Which of both was when cannot be known. A message that
//! stands there twice is none of these.

/// A time that came twice, ns: the clock stood at `to` and then again at `from`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Back {
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
        self.to.saturating_sub(self.from) as f64 / 1e9
    }
}

/// Messages of either side that a time which came twice has at least.
const FEW: usize = 3;
/// Messages for one that there is room for, at least.
const CROWDED: f64 = 1.5;
/// Steps back of several messages that are looked at.
const MOST: usize = 20;
/// A log that steps back behind more than this share of its messages is shuffled.
const SHUFFLED: f64 = 0.3;

/// Every place where the clock was set back; `same`: whether two messages of one time say the same.
pub fn turned_back(times: &[i64], same: impl Fn(usize, usize) -> bool) -> Vec<Back> {
    let is_back = |w: &[i64]| w[1] < w[0];
    let backs = times.windows(2).filter(|w| is_back(w)).count();
    if backs == 0 || backs as f64 > SHUFFLED * times.len() as f64 {
        return Vec::new();
    }
    let mut steps: Vec<i64> =
        times.windows(2).map(|w| w[1].saturating_sub(w[0])).filter(|d| *d > 0).collect();
    if steps.is_empty() {
        return Vec::new();
    }
    let middle = steps.len() / 2;
    let spacing = *steps.select_nth_unstable(middle).1 as f64;
    let (mut all, mut latest, mut looked) = (Vec::new(), i64::MIN, 0);
    for k in 0..times.len() {
        let steps_back = k > 0 && is_back(&times[k - 1..=k]) && times[k - 1] == latest;
        // a message or two that come late are nothing to look at
        let several = |few: &mut dyn Iterator<Item = &i64>, is: &dyn Fn(i64) -> bool| {
            few.take(FEW).filter(|t| is(**t)).count() == FEW
        };
        if steps_back
            && looked < MOST
            && several(&mut times[k..].iter(), &|t| t <= latest)
            && several(&mut times[..k].iter().rev(), &|t| t >= times[k])
        {
            looked += 1;
            let back = Back { from: times[k], to: latest };
            let before = times[..k].iter().rev().take_while(|t| **t >= times[k]).count();
            let room = latest.saturating_sub(times[k]) as f64 / spacing + 1.0;
            let run = (k..times.len()).take_while(|at| times[*at] <= latest).count();
            let crowded = |behind: usize| {
                before.min(behind) >= FEW && (before + behind) as f64 >= CROWDED * room
            };
            // what stands there twice is counted once, where it matters
            if crowded(run) && crowded(run - repeated(times, (k - before, k, k + run), &same)) {
                all.push(back);
            }
        }
        latest = latest.max(times[k]);
    }
    all
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
        assert_eq!(turned_back(&back, other), [Back { from: 2_690_000_000, to: 2_990_000_000 }]);
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
        assert_eq!(turned_back(&twice, other), [Back { from: 3_500_000_000, to: 3_990_000_000 }]);
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
