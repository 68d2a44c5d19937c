//! The rows of one topic as a file has them, in; the same in the order of time, without those that are none
//! of the topic or came twice, and what there is to say of it, out.

use super::back;
use super::midnight::carried_on;
use super::rows::Rows;
use super::steps::{lacking, usual};
use crate::log::clocks::{Two, share, too_many, two_clocks};
use crate::log::turned::{Back, turned_back};
use std::collections::BTreeSet;

/// What clocks count that begin anew, s: a day, a week of GPS, 32 bits of microseconds and of
/// milliseconds.
const PERIODS: [(f64, &str); 4] = [
    (86_400.0, "a day"),
    (604_800.0, "a week"),
    (4_294.967_296, "2^32 us"),
    (4_294_967.296, "2^32 ms"),
];
/// A clock begins anew where it falls by a period to within this, s, or two steps, and this share of it.
const NEAR: f64 = 0.05;
const SHARE: f64 = 1e-3;
/// Rows that may be left out because their time came twice: of more nothing is known.
const TWICE: f64 = 0.1;
/// Rows with values that are further apart than so many steps have a hole between them.
const HOLE: f64 = 2.5;

impl Rows {
    /// Puts the rows in the order of their stamps. `topic`: its name; `day_s`: where its clock tells the
    /// time of day, the start of the day, s since 1970.
    ///
    /// # Errors
    /// In words: too many rows are of a time that came twice.
    pub fn settle(&mut self, topic: &str, day_s: Option<f64>) -> Result<Vec<String>, String> {
        let mut notes = Vec::new();
        let midnight = day_s.and_then(|day_s| carried_on(&mut self.stamp, day_s));
        let anew = midnight.or_else(|| self.begin_anew());
        notes.extend(anew.map(|note| format!("topic {topic}: {note}")));
        notes.extend(self.lacking().map(|note| format!("topic {topic}: {note}")));
        self.without_values();
        notes.extend(self.of_one_clock(topic)?);
        let times = self.times();
        let twice = turned_back(&times, |a, b| self.of(a) == self.of(b));
        let mut order: Vec<usize> = (0..times.len()).collect();
        order.retain(|&row| !twice.iter().any(|back| back.holds(times[row])));
        let dropped = times.len() - order.len();
        let backs: Vec<String> = twice.iter().map(set_back).collect();
        let all = times.len();
        if dropped as f64 > TWICE * all as f64 {
            return Err(format!(
                "topic {topic}: {}: {dropped} of {all} rows are of a time that came twice; give each part as a file of its own",
                backs.join(", ")
            ));
        }
        if dropped > 0 {
            notes.push(format!(
                "topic {topic}: {}: what came twice then is left out, {dropped} of {all} rows",
                backs.join(", ")
            ));
        }
        let kept: Vec<i64> = order.iter().map(|&row| times[row]).collect();
        notes.extend(back::said(topic, &kept, |k| order[k] + 1));
        if dropped > 0 || !kept.is_sorted() {
            order.sort_by_key(|&row| times[row]);
            self.take(&order);
        }
        Ok(notes)
    }

    /// Leaves out what another clock gave than the others, where that are few.
    fn of_one_clock(&mut self, topic: &str) -> Result<Vec<String>, String> {
        let (clocks, all) = (two_clocks(&self.times()), self.stamp.len());
        let said = |two: &Two| format!("topic {topic}: behind row {}: {}", two.at, two.words());
        if let Some(many) = too_many(&clocks, all) {
            let share = share(&clocks, all, "rows");
            return Err(format!("{}; {share}; give each part as a file of its own", said(many)));
        }
        let out: BTreeSet<usize> = clocks.iter().flat_map(|two| &two.fewer).copied().collect();
        if !out.is_empty() {
            self.take(&(0..all).filter(|row| !out.contains(row)).collect::<Vec<_>>());
        }
        let left_out = |two: &Two| {
            let few = two.fewer.len();
            format!("{}: {few} of {all} rows, of the one that gave fewer, are left out", said(two))
        };
        Ok(clocks.iter().map(left_out).collect())
    }

    fn times(&self) -> Vec<i64> {
        self.stamp.iter().map(|t| i64::try_from(*t).unwrap_or(i64::MAX)).collect()
    }

    fn of(&self, row: usize) -> &[f64] {
        let fields = self.values.len().checked_div(self.stamp.len()).unwrap_or(0);
        &self.values[row * fields..(row + 1) * fields]
    }

    fn take(&mut self, rows: &[usize]) {
        let values = rows.iter().flat_map(|&row| self.of(row).iter().copied()).collect();
        self.stamp = rows.iter().map(|&row| self.stamp[row]).collect();
        self.values = values;
    }

    /// Adds a period to what stands behind the one row at which the clock begins anew.
    fn begin_anew(&mut self) -> Option<String> {
        let times = self.times();
        let step = usual(&times)?;
        let mut backs = (1..times.len()).filter(|&k| times[k] < times[k - 1]);
        let (Some(at), None) = (backs.next(), backs.next()) else { return None };
        let fall = (times[at - 1] - times[at] + step) as f64 / 1e9;
        let steps = NEAR.max(2.0 * step as f64 / 1e9);
        let is_near = |period: &f64| (fall - period).abs() < steps.min(SHARE * period);
        let (period, name) = PERIODS.iter().find(|(period, _)| is_near(period))?;
        let more = libm::round(period * 1e9) as u64;
        self.stamp[at..].iter_mut().for_each(|stamp| *stamp = stamp.saturating_add(more));
        Some(format!(
            "the time falls by {:.3} s behind row {at}, as a clock does that begins anew: {name} is added from there on",
            fall - step as f64 / 1e9
        ))
    }

    fn has_value(&self, row: usize) -> bool {
        self.of(row).iter().any(|v| !v.is_nan())
    }

    /// How many rows lack a value, in words: those that are left out are seen nowhere later.
    fn lacking(&self) -> Option<String> {
        let count = lacking(&self.times(), |row| self.has_value(row));
        let all = self.stamp.len();
        (count > 0).then(|| format!("{count} of {all} rows have no value of it where one was due"))
    }

    /// Leaves out rows without any value: of a file in which each clock has rows of its own, most are of
    /// other topics. In a hole they stay, as what tells that there is one.
    fn without_values(&mut self) {
        let has_value = |&row: &usize| self.has_value(row);
        let times = self.times();
        let mut with: Vec<i64> = (0..times.len()).filter(has_value).map(|row| times[row]).collect();
        with.sort_unstable();
        let Some(step) = usual(&with) else { return };
        let in_hole = |&row: &usize| {
            let next = with.partition_point(|t| *t < times[row]);
            let beside = next.checked_sub(1).and_then(|last| with.get(last)).zip(with.get(next));
            beside.is_none_or(|(a, b)| b.saturating_sub(*a) as f64 > HOLE * step as f64)
        };
        let stay: Vec<usize> =
            (0..times.len()).filter(|row| has_value(row) || in_hole(row)).collect();
        if stay.len() < times.len() {
            self.take(&stay);
        }
    }
}

fn set_back(back: &Back) -> String {
    format!("after row {} of its data the time goes back by {:.3} s", back.at, back.seconds())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(all: impl IntoIterator<Item = (f64, f64)>) -> Rows {
        let mut rows = Rows::default();
        all.into_iter().for_each(|(t, v)| rows.push((t * 1e9) as u64, [v]));
        rows
    }

    fn values(rows: &Rows) -> Vec<f64> {
        rows.values.clone()
    }

    #[test]
    fn a_clock_that_begins_anew_goes_on() {
        let mut midnight = rows((0..100).map(|k| {
            let t = 86_399.0 + 0.02 * f64::from(k);
            (t % 86_400.0, f64::from(k))
        }));
        let notes = midnight.settle("/t", None).expect("it goes on");
        assert!(notes[0].contains("a day is added") && notes.len() == 1, "{notes:?}");
        assert!(values(&midnight).is_sorted() && midnight.stamp.is_sorted());
        assert_eq!(midnight.stamp.len(), 100);
    }

    #[test]
    fn rows_of_other_clocks_are_none_and_holes_stay() {
        // every other row is of another recorder; for a while the sensor says nothing
        let value = |k: u32| {
            if k % 2 == 1 || (40..60).contains(&k) { f64::NAN } else { f64::from(k) }
        };
        let mut own = rows((0..100).map(|k| (0.01 * f64::from(k), value(k))));
        let notes = own.settle("/t", None).expect("nothing is twice");
        assert_eq!(notes, ["topic /t: 21 of 100 rows have no value of it where one was due"]);
        let known = values(&own).iter().filter(|v| !v.is_nan()).count();
        assert_eq!((known, own.stamp.len()), (40, 40 + 21 + 1));
        // one below the other, at times between each other
        let (a, b) = (
            (0..100).map(|k| (f64::from(k), 1.0)),
            (0..100).map(|k| (0.4 + f64::from(k), f64::NAN)),
        );
        let mut stacked = rows(a.chain(b));
        let notes = stacked.settle("/t", None).expect("those of the other are none");
        assert_eq!(notes, Vec::<String>::new());
        assert_eq!(stacked.stamp.len(), 101);
    }

    #[test]
    fn fault_rows_of_a_clock_that_was_set_back_to_before_the_file_are_not_mixed_in() {
        let of = |at: u32| {
            let t = move |k: u32| 500.0 + 0.02 * f64::from(k) - if k < at { 0.0 } else { 300.0 };
            rows((0..600).map(move |k| (t(k), f64::from(k))))
        };
        let error = of(300).settle("/t", None).expect_err("half is of another clock");
        assert!(
            error.contains("behind row 300: the clock was set back by 299.980 s")
                && error.contains("a file of its own"),
            "{error}"
        );
        let mut few = of(570);
        let notes = few.settle("/t", None).expect("a few");
        assert!(notes.len() == 1 && notes[0].contains("30 of 600 rows"), "{notes:?}");
        assert!(few.stamp.len() == 570 && few.stamp.is_sorted() && values(&few)[569] == 569.0);
    }

    #[test]
    fn a_file_of_two_runs_is_refused_and_a_shuffled_one_is_sorted() {
        let run = || (0..300).map(|k| (0.02 * f64::from(k), f64::from(k)));
        let second = run().map(|(t, v)| (t, -v));
        let error = rows(run().chain(second)).settle("/t", None).expect_err("all came twice");
        assert!(error.contains("after row 300") && error.contains("600 of 600 rows"), "{error}");
        let mut shuffled =
            rows((0..600).map(|k| (f64::from(k * 331 % 600), f64::from(k * 331 % 600))));
        let notes = shuffled.settle("/t", None).expect("nothing is twice");
        assert!(notes[0].contains("put in the order of time"), "{notes:?}");
        assert!(values(&shuffled).is_sorted() && shuffled.stamp.len() == 600);
    }
}
