//! The stamps of a clock that tells the time of day, or the day of the year with it, in the order of the file,
//! in; the same, carried on over midnight, or over New Year, out.

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

/// A day of the year that falls by more than this is one of the next year.
const HALF_A_YEAR: i64 = 180 * DAY;

/// Adds a day behind each midnight, or a year behind New Year; says so in words where there is one. `start_s`:
/// the start of the day, or of the year, s since 1970.
pub fn carried_on(stamps: &mut [u64], start_s: f64) -> Option<String> {
    let times: Vec<i64> = stamps.iter().map(|t| i64::try_from(*t).unwrap_or(i64::MAX)).collect();
    let start = libm::round(start_s * 1e9) as i64;
    if times.iter().any(|t| !(0..MOST).contains(&t.saturating_sub(start))) {
        return over_new_year(stamps, &times, start_s);
    }
    let is_midnight = |w: &[i64]| w[0] - w[1] > NEXT;
    let first = times.windows(2).position(is_midnight)?;
    let days = turns(&times, NEXT, LATE);
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

/// Adds a year behind New Year.
fn over_new_year(stamps: &mut [u64], times: &[i64], start_s: f64) -> Option<String> {
    let first = times.windows(2).position(|w| w[0] - w[1] > HALF_A_YEAR)?;
    let start = libm::round(start_s * 1e9) as i64;
    let is_day_366 = |t: &i64| t.saturating_sub(start) >= 365 * DAY;
    let days = if times.iter().any(is_day_366) { 366 } else { days_of_year(start_s) };
    let years = turns(times, HALF_A_YEAR, HALF_A_YEAR);
    let carried: Vec<i64> =
        times.iter().zip(&years).map(|(t, year)| t.saturating_add(year * days * DAY)).collect();
    let back = carried.windows(2).filter(|w| w[1] < w[0]).count();
    if back as f64 > SHUFFLED * times.len() as f64 {
        return None;
    }
    stamps.iter_mut().zip(&carried).for_each(|(stamp, t)| *stamp = t.unsigned_abs());
    Some(format!(
        "the day of the year begins anew behind row {}, as over New Year: {days} days are added from there on",
        first + 1
    ))
}

/// The days of the year that begins so many s after 1970; of one that is not known (0), 365.
fn days_of_year(start_s: f64) -> i64 {
    let start = jiff::Timestamp::from_second(libm::round(start_s) as i64).ok();
    let date =
        start.filter(|_| start_s != 0.0).map(|at| at.to_zoned(jiff::tz::TimeZone::UTC).date());
    date.map_or(365, |date| i64::from(date.days_in_year()))
}

/// How often the clock began anew before each row: it falls by more than `fall`; one that then rises by more
/// than `rise` is a late one of before.
fn turns(times: &[i64], fall: i64, rise: i64) -> Vec<i64> {
    let mut turn = 0;
    let steps = std::iter::once(0).chain(times.windows(2).map(|w| w[1] - w[0]));
    steps
        .map(|step| {
            if step < -fall {
                turn += 1;
            } else if step > rise && turn > 0 {
                turn -= 1;
            }
            turn
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
    fn a_day_of_the_year_goes_on_over_new_year() {
        // by second from 23:59:10 of the last day on
        let of = |days: u64, start: u64| -> Vec<u64> {
            let at = |k: u64| (days - 1) * 86_400 + 86_350 + k;
            (0..100).map(|k| (start + at(k) % (days * 86_400)) * S).collect()
        };
        // a year that is not known, 2023, 2024; and 2024 with a pause from day 360 to day 3
        let cases = [(365, 0), (365, 1_672_531_200), (366, 1_704_067_200), (366, 0)];
        for (days, start) in cases {
            let mut stamps = of(days, start);
            let note = carried_on(&mut stamps, start as f64).expect("New Year");
            assert!(
                note.contains(&format!("behind row 50, as over New Year: {days} days")),
                "{note}"
            );
            assert!(stamps.windows(2).all(|w| w[1] - w[0] == S), "{days} {start}");
        }
        let start = 1_704_067_200;
        let mut paused: Vec<u64> = [359, 2].map(|day| (start + day * 86_400) * S).to_vec();
        assert!(
            carried_on(&mut paused, start as f64).is_some_and(|note| note.contains("366 days"))
        );
        assert_eq!(paused[1] - paused[0], (366 - 359 + 2) * 86_400 * S);
        // summer: a fall of some days is none
        let mut summer: Vec<u64> = [200, 190].map(|day| day * 86_400 * S).to_vec();
        assert_eq!(carried_on(&mut summer, 0.0), None);
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
