//! Times of one topic in file order in; where the clock was set back while it was recorded, and what
//! lies in the time that came twice, out.
//!
//! A message that comes late fills a hole that it left; many that come late together fill as many.
//! Behind a clock that was set back messages go on at their usual spacing among others that are there
//! already: twice as many as there is room for. Which of both was when cannot be known.

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
        super::series::seconds(self.to.saturating_sub(self.from))
    }
}

/// Messages of either side that a time which came twice has at least.
const FEW: usize = 3;
/// Messages for one that there is room for, at least.
const CROWDED: f64 = 1.5;

/// Every place where the clock was set back.
pub fn turned_back(times: &[i64]) -> Vec<Back> {
    let is_back = |w: &[i64]| w[1] < w[0];
    if !times.windows(2).any(is_back) {
        return Vec::new();
    }
    let mut steps: Vec<i64> =
        times.windows(2).map(|w| w[1].saturating_sub(w[0])).filter(|d| *d > 0).collect();
    if steps.is_empty() {
        return Vec::new();
    }
    let middle = steps.len() / 2;
    let spacing = *steps.select_nth_unstable(middle).1 as f64;
    let (mut all, mut latest) = (Vec::new(), i64::MIN);
    for k in 0..times.len() {
        let steps_back = k > 0 && is_back(&times[k - 1..=k]) && times[k - 1] == latest;
        if steps_back {
            let back = Back { from: times[k], to: latest };
            let behind = times[k..].iter().take_while(|t| **t <= latest).count();
            let before = times[..k].iter().rev().take_while(|t| **t >= times[k]).count();
            let room = (latest.saturating_sub(times[k])) as f64 / spacing + 1.0;
            let crowded = (before + behind) as f64 >= CROWDED * room;
            if before.min(behind) >= FEW && crowded {
                all.push(back);
            }
        }
        latest = latest.max(times[k]);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: i64) -> Vec<i64> {
        (0..n).map(|k| 10_000_000 * k).collect()
    }

    #[test]
    fn a_clock_set_back_is_found_and_late_messages_are_none() {
        let mut back = grid(600);
        back[300..].iter_mut().for_each(|t| *t -= 310_000_000);
        assert_eq!(turned_back(&back), [Back { from: 2_690_000_000, to: 2_990_000_000 }]);
        assert_eq!(turned_back(&grid(600)), []);
        // one late message, two that changed places, and fifteen that came late together
        let mut late = grid(600);
        late[100..111].rotate_left(1);
        late.swap(200, 201);
        late[300..330].rotate_left(15);
        assert_eq!(turned_back(&late), []);
    }

    #[test]
    fn a_clock_that_begins_anew_elsewhere_has_no_time_twice() {
        let mut anew = grid(600);
        anew[300..].iter_mut().for_each(|t| *t -= 9_000_000_000_000);
        assert_eq!(turned_back(&anew), []);
        assert_eq!(turned_back(&[]), []);
        assert_eq!(turned_back(&[5, 5, 5]), []);
    }
}
