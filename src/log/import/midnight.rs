//! The stamps of a clock that tells the time of day, in the order of the file, in; the same, carried on over
//! midnight, out.

const HOUR: i64 = 3_600_000_000_000;
const DAY: i64 = 24 * HOUR;
/// A time of day that falls by more than this is one of the next day, also where the recording paused over
/// midnight: a clock is not set back by so much.
const NEXT: i64 = 12 * HOUR;
/// Behind midnight, one that rises by more than this is a late one of the day before.
const LATE: i64 = 23 * HOUR;
/// The time of day is below a day, and a leap second, ns: days of the year need no carrying on.
const MOST: i64 = DAY + 1_000_000_000;
/// A file in which more than this share of the rows is behind a later one is shuffled: its falls say nothing.
const SHUFFLED: f64 = 0.3;

/// Adds a day behind each midnight; says so in words where there is one. `start_s`: the start of the day, s
/// since 1970.
pub fn carried_on(stamps: &mut [u64], start_s: f64) -> Option<String> {
    let times: Vec<i64> = stamps.iter().map(|t| i64::try_from(*t).unwrap_or(i64::MAX)).collect();
    let start = libm::round(start_s * 1e9) as i64;
    if times.iter().any(|t| !(0..MOST).contains(&t.saturating_sub(start))) {
        return None;
    }
    let is_midnight = |w: &[i64]| w[0] - w[1] > NEXT;
    let first = times.windows(2).position(is_midnight)?;
    let days = days(&times);
    let later = |(t, day): (&i64, &i64)| t.saturating_add(day.saturating_mul(DAY));
    let carried: Vec<i64> = times.iter().zip(&days).map(later).collect();
    let back = carried.windows(2).filter(|w| w[1] < w[0]).count();
    if back as f64 > SHUFFLED * times.len() as f64 {
        return None;
    }
    stamps.iter_mut().zip(&carried).for_each(|(stamp, t)| *stamp = t.unsigned_abs());
    let fall = (times[first] - times[first + 1]) as f64 / 1e9;
    let more = days.iter().max().map_or(0, |most| most - 1);
    let again = if more > 0 { format!(", and so {more} times more") } else { String::new() };
    Some(format!(
        "the time falls by {fall:.3} s behind row {}, as a clock does that begins anew: a day is added from there on{again}",
        first + 1
    ))
}

/// How many midnights lie before each row.
fn days(times: &[i64]) -> Vec<i64> {
    let mut day = 0;
    let steps = std::iter::once(0).chain(times.windows(2).map(|w| w[1] - w[0]));
    steps
        .map(|step| {
            if step < -NEXT {
                day += 1;
            } else if step > LATE && day > 0 {
                day -= 1;
            }
            day
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    /// A hundred rows before a pause and a hundred behind it; each begins at so many hours.
    fn paused(before: u64, behind: u64) -> Vec<u64> {
        let run = |hour: u64| (0..100).map(move |k| hour * 3600 * S + 20_000_000 * k);
        run(before).chain(run(behind)).collect()
    }

    #[test]
    fn a_recording_that_paused_over_midnight_goes_on() {
        for (before, behind) in [(23, 1), (20, 4), (18, 5)] {
            let mut stamps = paused(before, behind);
            let note = carried_on(&mut stamps, 0.0).expect("midnight");
            assert!(
                note.contains("behind row 100, as a clock does that begins anew: a day"),
                "{note}"
            );
            assert!(stamps.is_sorted());
            assert_eq!(stamps[100], (24 + behind) * 3600 * S);
        }
        // of a day that is known
        let mut stamps: Vec<u64> = paused(23, 1).iter().map(|t| t + 1_700_000_000 * S).collect();
        assert!(carried_on(&mut stamps, 1.7e9).is_some() && stamps.is_sorted());
    }

    #[test]
    fn every_midnight_is_one_and_a_late_row_stays_in_its_day() {
        // fifty hours by quarters
        let mut stamps: Vec<u64> = (0..200).map(|k| (86_390 + 900 * k) % 86_400 * S).collect();
        let note = carried_on(&mut stamps, 0.0).expect("midnights");
        assert!(note.ends_with("from there on, and so 2 times more"), "{note}");
        assert!(stamps.is_sorted());
        let mut late: Vec<u64> = (0..100).map(|k| (86_350 + k) % 86_400 * S).collect();
        late.swap(49, 50);
        assert!(carried_on(&mut late, 0.0).is_some());
        assert_eq!((late[49], late[50], late[51]), (86_400 * S, 86_399 * S, 86_401 * S));
    }

    #[test]
    fn a_smaller_fall_a_day_of_the_year_and_a_shuffled_file_are_left_alone() {
        let year = paused(23, 1).iter().map(|t| t + 126 * 86_400 * S).collect();
        let shuffled = (0..400).map(|k| 200 * S * (k * k * 37 % 401)).collect();
        for stamps in [paused(23, 12), year, shuffled] {
            let mut same: Vec<u64> = stamps.clone();
            assert_eq!(carried_on(&mut same, 0.0), None);
            assert_eq!(same, stamps);
        }
    }
}
