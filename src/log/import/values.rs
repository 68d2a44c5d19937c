//! A column as a file has it in; the numbers that a log has in its place, and what is said of whole numbers that
//! lose digits so, out.

/// What a file has in a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    Numbers(Vec<f64>),
    /// Whole numbers, of which an `f64` has not all digits; none where there is no value.
    Whole(Vec<Option<i128>>),
    /// ns since 1970; none where there is no value.
    Stamps(Vec<Option<i64>>),
}

impl Values {
    pub fn len(&self) -> usize {
        match self {
            Values::Numbers(all) => all.len(),
            Values::Whole(all) => all.len(),
            Values::Stamps(all) => all.len(),
        }
    }

    pub fn are_stamps(&self) -> bool {
        matches!(self, Values::Stamps(_))
    }

    /// The numbers, NaN where there is no value; none of stamps.
    pub fn numbers(self) -> Option<Vec<f64>> {
        match self {
            Values::Numbers(all) => Some(all),
            Values::Whole(all) => {
                Some(all.into_iter().map(|n| n.map_or(f64::NAN, |n| n as f64)).collect())
            }
            Values::Stamps(_) => None,
        }
    }

    /// Every `step`-th value from the one at `first` on, `count` at most.
    pub fn every(&self, first: usize, step: usize, count: usize) -> Values {
        match self {
            Values::Numbers(all) => Values::Numbers(every(all, first, step, count)),
            Values::Whole(all) => Values::Whole(every(all, first, step, count)),
            Values::Stamps(all) => Values::Stamps(every(all, first, step, count)),
        }
    }

    /// These values with those that follow them in the same column.
    pub fn and(self, more: Values) -> Values {
        match (self, more) {
            (Values::Whole(mut all), Values::Whole(more)) => {
                all.extend(more);
                Values::Whole(all)
            }
            (Values::Stamps(mut all), Values::Stamps(more)) => {
                all.extend(more);
                Values::Stamps(all)
            }
            // a column is of one type throughout: these are numbers
            (all, more) => {
                let mut all = all.numbers().unwrap_or_default();
                all.extend(more.numbers().unwrap_or_default());
                Values::Numbers(all)
            }
        }
    }
}

fn every<T: Copy>(all: &[T], first: usize, step: usize, count: usize) -> Vec<T> {
    let from = all.get(first..).unwrap_or_default();
    from.iter().step_by(step.max(1)).take(count).copied().collect()
}

/// The whole numbers of one column of which a log, whose numbers are `f64`, has not all digits.
#[derive(Debug, Clone, Default)]
pub struct Rounded {
    count: usize,
    /// The first: where it stands, and the number.
    first: Option<(String, i128)>,
}

impl Rounded {
    /// Looks at a number; `place` says where it stands.
    pub fn see(&mut self, n: i128, place: impl FnOnce() -> String) {
        if n as f64 as i128 == n {
            return;
        }
        self.count += 1;
        self.first.get_or_insert_with(|| (place(), n));
    }

    /// In words, where there is one; `column`: what the column is called in messages, `all`: its rows.
    pub fn words(&self, topic: &str, column: &str, all: usize) -> Option<String> {
        let (place, n) = self.first.as_ref()?;
        Some(format!(
            "topic {topic}: {} of {all} whole numbers of {column} have more digits than a number of a log holds (it holds all up to 2^53, 9007199254740992): the nearest stands in their place, first in {place}, {} for {n}; as a topic's `time` a column keeps all its digits",
            self.count, *n as f64 as i128
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_that_lose_digits_are_counted_and_the_first_has_its_place() {
        let mut rounded = Rounded::default();
        let all = [7, 1 << 53, (1 << 53) + 1, 1 << 62, i128::from(u64::MAX), -(1 << 53) - 1];
        for (row, n) in all.into_iter().enumerate() {
            rounded.see(n, || format!("row {}", row + 1));
        }
        let words = rounded.words("/a", "\"n\"", 6).expect("three lose digits");
        assert!(words.starts_with("topic /a: 3 of 6 whole numbers of \"n\" have more"), "{words}");
        assert!(words.contains("first in row 3, 9007199254740992 for 9007199254740993"), "{words}");
        assert_eq!(Rounded::default().words("/a", "\"n\"", 6), None);
    }

    #[test]
    fn columns_and_rows_of_a_matrix_are_taken_out_of_it() {
        let values = Values::Whole((0..6).map(Some).collect());
        assert_eq!(values.every(2, 1, 2), Values::Whole(vec![Some(2), Some(3)]));
        assert_eq!(values.every(1, 2, 9), Values::Whole(vec![Some(1), Some(3), Some(5)]));
        assert_eq!(values.every(7, 1, 2).len(), 0);
    }
}
