//! The times of a topic's rows in the order of the file in; what is said where they go back, and where several
//! rows have one time, out.

use super::steps::usual;
use crate::log::turned::MOST;

/// A step of more than so many usual ones leaves out a row, which may come late.
const HOLE: f64 = 1.5;

/// What is said of rows at these times; `row`: the number of each, from 1.
pub fn said(topic: &str, times: &[i64], row: impl Fn(usize) -> usize) -> Vec<String> {
    let backs: Vec<usize> = (1..times.len()).filter(|&k| times[k] < times[k - 1]).collect();
    // a clock that jitters, and a file in no order, go back at many places
    let (set, late): (Vec<usize>, Vec<usize>) = match usual(times).filter(|_| backs.len() < MOST) {
        Some(step) => backs.iter().copied().partition(|&k| is_set_back(times, k, step)),
        None => (Vec::new(), backs),
    };
    let first = |all: &[usize]| {
        let k = *all.first()?;
        let (before, behind) = (seconds(times[k - 1]), seconds(times[k]));
        let (places, by) = (places(all.len()), before - behind);
        Some(format!(
            "{places}behind row {} of its data by {by:.3} s (from {before:.3} to {behind:.3} s)",
            row(k - 1)
        ))
    };
    let set = first(&set).map(|place| {
        format!(
            "topic {topic}: the clock was set back {place} and goes on from there: what stands behind is too early, or what stands before too late; rows are put in the order of time; give each part as a file of its own, with the `start_s` of its clock"
        )
    });
    let late = first(&late).map(|place| {
        format!("topic {topic}: the time goes back {place}: rows are put in the order of time")
    });
    set.into_iter().chain(late).chain(repeated(topic, times, row)).collect()
}

fn places(count: usize) -> String {
    if count == 1 { String::new() } else { format!("at {count} places, first ") }
}

fn seconds(ns: i64) -> f64 {
    ns as f64 / 1e9
}

/// Whether a clock was set back in front of the row at `k`, and went on from there at its usual step. A row that
/// comes late fills a hole that it left, and is followed by one that goes on where the others were.
fn is_set_back(times: &[i64], k: usize, step: i64) -> bool {
    let hole = |from: i64, to: i64| to.saturating_sub(from) as f64 > HOLE * step as f64;
    let goes_on = times.get(k + 1).is_some_and(|next| *next > times[k] && !hole(times[k], *next));
    let before = times[..k].iter().filter(|t| **t <= times[k]).max();
    let behind = times[..k].iter().filter(|t| **t > times[k]).min();
    let has_room = before.zip(behind).is_none_or(|(before, behind)| hole(*before, *behind));
    // where it jitters, nothing is lost over a few rows
    let lost =
        k.checked_sub(3).and_then(|from| Some(times.get(k + 2)?.saturating_sub(times[from])));
    goes_on && !has_room && lost.is_some_and(|five| five < step.saturating_mul(4))
}

/// Rows at the time of an earlier one, of which a reader of the log takes the first.
fn repeated(topic: &str, times: &[i64], row: impl Fn(usize) -> usize) -> Option<String> {
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by_key(|&k| times[k]);
    let again = || order.windows(2).filter(|w| times[w[0]] == times[w[1]]).map(|w| w[1]);
    let first = again().min()?;
    Some(format!(
        "topic {topic}: {} of {} rows have the time of an earlier row, first row {} of its data ({:.3} s): who reads the log takes the first row of each time",
        again().count(),
        times.len(),
        row(first),
        seconds(times[first])
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    /// What is said of 200 rows that are 50 ms apart, changed.
    fn of(change: impl Fn(&mut Vec<i64>)) -> Vec<String> {
        let mut times: Vec<i64> = (0..200).map(|k| 50 * MS * k).collect();
        change(&mut times);
        said("/a", &times, |k| k + 1)
    }

    #[test]
    fn fault_a_clock_set_back_by_a_step_or_two_is_told_with_its_row() {
        let notes = of(|times| times[100..].iter_mut().for_each(|t| *t -= 100 * MS));
        assert_eq!(notes.len(), 2, "{notes:?}");
        let place = "topic /a: the clock was set back behind row 100 of its data by 0.050 s (from 4.950 to 4.900 s) and goes on";
        assert!(notes[0].starts_with(place), "{notes:?}");
        let twice = "topic /a: 2 of 200 rows have the time of an earlier row, first row 101 of its data (4.900 s)";
        assert!(notes[1].starts_with(twice), "{notes:?}");
        // by less than two steps, and twice
        let notes = of(|times| {
            times[100..].iter_mut().for_each(|t| *t -= 75 * MS);
            times[150..].iter_mut().for_each(|t| *t -= 75 * MS);
        });
        let place = "set back at 2 places, first behind row 100 of its data by 0.025 s";
        assert!(notes.len() == 1 && notes[0].contains(place), "{notes:?}");
    }

    #[test]
    fn fault_a_clock_that_stands_still_for_a_step_is_told_with_its_row() {
        let notes = of(|times| times[100..].iter_mut().for_each(|t| *t -= 50 * MS));
        let twice = "topic /a: 1 of 200 rows have the time of an earlier row, first row 101 of its data (4.950 s)";
        assert!(notes.len() == 1 && notes[0].starts_with(twice), "{notes:?}");
    }

    #[test]
    fn a_clock_that_jitters_is_not_set_back() {
        let notes = of(|times| times.insert(100, times[100] - 2 * MS));
        assert!(notes.is_empty(), "{notes:?}");
        let notes = of(|times| times.insert(101, times[100] - 2 * MS));
        assert!(notes.len() == 1 && notes[0].contains("the time goes back behind"), "{notes:?}");
    }

    #[test]
    fn rows_that_come_late_are_no_clock_set_back() {
        assert_eq!(of(|_| {}), Vec::<String>::new());
        for far in [2, 4, 15] {
            let notes = of(|times| times[100..100 + far].rotate_left(1));
            let late = "topic /a: the time goes back behind row";
            assert!(notes.len() == 1 && notes[0].starts_with(late), "{far}: {notes:?}");
        }
        // in no order at all, as some tables are
        let shuffled: Vec<i64> = (0..600).map(|k| 50 * MS * (k * 331 % 600)).collect();
        let notes = said("/a", &shuffled, |k| k + 1);
        assert!(notes.len() == 1 && notes[0].contains("goes back at 330 places"), "{notes:?}");
    }
}
