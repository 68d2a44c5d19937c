//! The times of a topic's rows, and which of them have a value, in; the usual step, and how many rows lack a
//! value where one was due, out.

/// Values that are further apart than so many usual steps have others missing between them.
const DUE: f64 = 1.5;
/// Rows to a value of a slower signal, at least, and how far a value may be from its row.
const SLOWER: f64 = 1.4;
const WITHIN: f64 = 1.0;

pub use crate::log::turned::usual;

/// The rows without a value that lie between two values further apart than usual. Rows of other topics, which
/// stand between values at their usual step, are none.
pub fn lacking(times: &[i64], has_value: impl Fn(usize) -> bool) -> usize {
    let with: Vec<usize> = (0..times.len()).filter(|row| has_value(*row)).collect();
    let known: Vec<i64> = with.iter().map(|&row| times[row]).collect();
    let Some(step) = usual(&known) else { return 0 };
    if is_slower(&with) {
        return 0;
    }
    let late = |w: &[usize]| times[w[1]].saturating_sub(times[w[0]]) as f64 > DUE * step as f64;
    with.windows(2).filter(|w| late(w)).map(|w| w[1] - w[0] - 1).sum()
}

/// Whether every n-th row throughout has a value, to within one row.
fn is_slower(with: &[usize]) -> bool {
    let [first, .., last] = with else { return false };
    let each = (last - first) as f64 / (with.len() - 1) as f64;
    let is_near =
        |(k, row): (usize, &usize)| ((row - first) as f64 - k as f64 * each).abs() <= WITHIN;
    each >= SLOWER
        && with.windows(2).all(|w| (w[1] - w[0]) as f64 <= each + WITHIN)
        && with.iter().enumerate().all(is_near)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn on_a_grid(n: i64, has_value: impl Fn(usize) -> bool) -> usize {
        lacking(&(0..n).map(|k| 20_000_000 * k).collect::<Vec<i64>>(), has_value)
    }

    #[test]
    fn cells_that_are_missing_are_counted() {
        // every third one, in the middle of the file
        let third = |k: usize| !(22..179).contains(&k) || !(k - 22).is_multiple_of(3);
        assert_eq!(on_a_grid(200, third), 53);
        assert_eq!(on_a_grid(200, |k| k != 50), 1);
        assert_eq!(on_a_grid(200, |k| !(50..70).contains(&k)), 20);
        // a slower one that pauses, at any place of it
        for at in [20, 100, 180] {
            assert_eq!(on_a_grid(200, |k| k % 2 == 0 && k != at), 3, "{at}");
        }
        // before the first value and behind the last nothing is known to be due
        assert_eq!(on_a_grid(200, |k| (20..180).contains(&k)), 0);
        assert_eq!(on_a_grid(200, |_| false), 0);
    }

    #[test]
    fn slower_signals_and_rows_of_other_clocks_lack_nothing() {
        for n in [2, 3, 7, 50] {
            assert_eq!(on_a_grid(200, |k| k % n == 1), 0, "{n}");
        }
        // 30 of 100, and two of three
        assert_eq!(on_a_grid(1000, |k| (k + 1) * 3 / 10 > k * 3 / 10), 0);
        assert_eq!((on_a_grid(1000, |k| k % 3 < 2), on_a_grid(1001, |k| k % 3 < 2)), (0, 0));
        // another recorder, which began later, has rows of its own
        let (own, other) =
            ((0..300).map(|k| (20 * k, true)), (0..70).map(|k| (2007 + 53 * k, false)));
        let mut both: Vec<(i64, bool)> = own.chain(other).collect();
        both.sort_unstable();
        let times: Vec<i64> = both.iter().map(|(t, _)| *t * 1_000_000).collect();
        assert_eq!(lacking(&times, |row| both[row].1), 0);
    }
}
