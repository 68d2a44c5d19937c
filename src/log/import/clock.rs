//! A time as a file has it (a number, a date, a time of day) in; its stamp, ns since 1970 or since whatever
//! the time counts from, out.

use crate::units::Unit;

/// Days that programs count, by name: the number of 1970-01-01.
const DAYS: [(&str, f64); 2] = [("excel", 25_569.0), ("datenum", 719_529.0)];

/// Stamps are below this, ns: 64 bits with a sign hold them.
const MOST_NS: f64 = 9e18;
const UNFIT: &str = "the time is negative, not a number or too large";

/// The unit of times of day.
pub const TIME_OF_DAY: &str = "hh:mm:ss";

/// How times become stamps.
#[derive(Debug, Clone)]
pub struct Clock {
    of: Of,
    start_s: f64,
}

#[derive(Debug, Clone)]
enum Of {
    /// Numbers in a unit of so many seconds.
    Numbers(f64),
    /// Days, of which 1970-01-01 has this number.
    Days(f64),
    /// Dates with times, ISO 8601.
    Dates,
    /// Hours, minutes and seconds, with the day of the year before them or without.
    Times,
}

impl Clock {
    /// The clock of a time in `unit`, which is one of time, or names how times are written.
    ///
    /// # Errors
    /// It is neither.
    pub fn new(unit: &str, start_s: f64) -> Result<Clock, String> {
        let days = DAYS.iter().find(|(name, _)| *name == unit);
        let of = match (unit, days) {
            ("iso8601", _) => Of::Dates,
            (TIME_OF_DAY, _) => Of::Times,
            (_, Some((_, first))) => Of::Days(*first),
            _ => Of::Numbers(in_seconds(unit)?),
        };
        Ok(Clock { of, start_s })
    }

    /// Whether times are written in letters, so that a column of numbers has none.
    pub fn is_written(&self) -> bool {
        matches!(self.of, Of::Dates | Of::Times)
    }

    /// The stamp of a number, ns.
    ///
    /// # Errors
    /// It is negative, too large or no number; the clock's times are no numbers.
    pub fn stamp(&self, t: f64) -> Result<u64, String> {
        let seconds = match &self.of {
            Of::Numbers(scale) => t * scale,
            Of::Days(first) => (t - first) * 86_400.0,
            Of::Dates | Of::Times => return Err(format!("{t} is a number, no time")),
        };
        let ns = libm::round((seconds + self.start_s) * 1e9);
        let fits = (0.0..MOST_NS).contains(&ns);
        if fits { Ok(ns as u64) } else { Err(UNFIT.into()) }
    }

    /// The stamp of a whole number, ns: to the ns where the unit is a whole number of them. Times since 1970
    /// have more digits than an `f64`.
    ///
    /// # Errors
    /// As `stamp`.
    pub fn whole(&self, t: i128) -> Result<u64, String> {
        let Some(unit) = self.whole_ns() else { return self.stamp(t as f64) };
        let ns = self.later(t.saturating_mul(unit)).map_err(|_| UNFIT.to_string())?;
        if (ns as f64) < MOST_NS { Ok(ns) } else { Err(UNFIT.into()) }
    }

    /// The clock's unit, ns; none where it is no whole number of them, or is no unit.
    fn whole_ns(&self) -> Option<i128> {
        let Of::Numbers(scale) = self.of else { return None };
        let whole = libm::round(scale * 1e9);
        let is_whole = whole >= 1.0 && (scale * 1e9 - whole).abs() < 1e-9 * whole;
        is_whole.then_some(whole as i128)
    }

    /// The stamp of a time that is written, ns.
    ///
    /// # Errors
    /// It is none; it lies before 1970.
    pub fn read(&self, cell: &str) -> Result<u64, String> {
        let (ns, wanted) = match self.of {
            Of::Times => (
                of_day(cell),
                "time of day, such as 10:00:00.25, or 127:10:00:00.25 with the day of the year",
            ),
            _ => (date(cell), "date with time, such as 2024-05-06T10:00:00.25Z"),
        };
        let ns = ns.ok_or_else(|| format!("\"{cell}\" is no {wanted}"))?;
        self.later(ns).map_err(|_| format!("\"{cell}\" lies before 1970 or too late"))
    }

    /// The stamp of a whole number of ns after the start, ns.
    ///
    /// # Errors
    /// It lies before 1970 or too late.
    pub fn later(&self, ns: i128) -> Result<u64, String> {
        let ns = ns.saturating_add(libm::round(self.start_s * 1e9) as i128);
        u64::try_from(ns).map_err(|_| "the time lies before 1970 or too late".into())
    }

    /// The stamp of row `row` (from 0) at `rate_hz`.
    ///
    /// # Errors
    /// It is too large.
    pub fn at_rate(start_s: f64, rate_hz: f64, row: usize) -> Result<u64, String> {
        Clock::seconds(start_s).stamp(row as f64 / rate_hz)
    }

    /// The clock of times in seconds.
    pub fn seconds(start_s: f64) -> Clock {
        Clock { of: Of::Numbers(1.0), start_s }
    }
}

/// The seconds of a unit of time.
fn in_seconds(name: &str) -> Result<f64, String> {
    let (unit, second) = (Unit::parse(name)?, Unit::parse("s")?);
    if unit.dim == second.dim {
        Ok(unit.scale)
    } else {
        Err(format!("\"{name}\" is no unit of time"))
    }
}

/// A date with its time, ns since 1970; one without a time zone is UTC.
fn date(cell: &str) -> Option<i128> {
    let utc = || {
        let civil = cell.parse::<jiff::civil::DateTime>().ok()?;
        civil.to_zoned(jiff::tz::TimeZone::UTC).ok().map(|z| z.timestamp())
    };
    let at = cell.parse::<jiff::Timestamp>().ok().or_else(utc)?;
    Some(at.as_nanosecond())
}

/// `[DAY:]HH:MM:SS[.fraction]`, ns; the first day of the year is day 1, and without a day there is none
/// that counts. A second 60 is a leap second's.
fn of_day(cell: &str) -> Option<i128> {
    let whole = |text: &str, least: i128, most: i128| {
        let digits =
            !text.is_empty() && text.len() <= 3 && text.bytes().all(|b| b.is_ascii_digit());
        let n = digits.then(|| text.parse::<i128>().ok()).flatten()?;
        (least..=most).contains(&n).then_some(n)
    };
    let mut parts = cell.rsplit(':');
    let seconds = parts.next()?;
    let (seconds, fraction) = seconds.split_once(['.', ',']).unwrap_or((seconds, "0"));
    let (minutes, hours) = (whole(parts.next()?, 0, 59)?, whole(parts.next()?, 0, 23)?);
    let day = parts.next().map_or(Some(1), |day| whole(day, 1, 366))?;
    let digits = (1..=18).contains(&fraction.len()) && fraction.bytes().all(|b| b.is_ascii_digit());
    if parts.next().is_some() || !digits {
        return None;
    }
    // To the ns; what is behind it is cut off.
    let ns: i128 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
    let minutes = ((day - 1) * 24 + hours) * 60 + minutes;
    Some((minutes * 60 + whole(seconds, 0, 60)?) * 1_000_000_000 + ns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_day_are_read_with_the_day_of_the_year_and_without() {
        let clock = Clock::new("hh:mm:ss", 0.0).unwrap();
        let read = |cell: &str| clock.read(cell);
        assert_eq!(read("00:00:01.5"), Ok(1_500_000_000));
        assert_eq!(read("1:2:3"), Ok(3_723_000_000_000));
        assert_eq!(read("002:10:00:00.250"), Ok((86_400 + 36_000) * 1_000_000_000 + 250_000_000));
        assert_eq!(read("10:00:00.1234567891"), Ok(36_000_123_456_789));
        // 1 January 2024
        let year = Clock::new("hh:mm:ss", 1_704_067_200.0).unwrap();
        assert_eq!(
            year.read("060:00:00:00"),
            Clock::new("iso8601", 0.0).unwrap().read("2024-02-29T00:00:00Z")
        );
        for bad in [
            "",
            "10:00",
            "10",
            "24:00:00",
            "10:60:00",
            "10:00:61",
            "0:10:00:00",
            "1:1:1:1:1",
            "-1:00:00",
            "10:00:00.",
            "10:00:0x",
        ] {
            let e = read(bad).unwrap_err();
            assert!(e.contains("is no time of day"), "{bad}: {e}");
        }
    }

    #[test]
    fn whole_numbers_are_stamps_to_the_ns() {
        let clock = |unit: &str| Clock::new(unit, 0.0).expect("a unit of time");
        assert_eq!(clock("ns").whole(1_700_000_000_123_456_789), Ok(1_700_000_000_123_456_789));
        assert_eq!(clock("us").whole(1_700_000_000_123_457), Ok(1_700_000_000_123_457_000));
        assert_eq!(clock("ms").whole(1_700_000_000_123), Ok(1_700_000_000_123_000_000));
        assert_eq!(clock("min").whole(2), Ok(120_000_000_000));
        // what counts from a start, and what counts days
        let from = Clock::new("ns", 1_700_000_000.0).expect("a unit of time");
        assert_eq!(from.whole(37), Ok(1_700_000_000_000_000_037));
        assert_eq!(clock("excel").whole(25_570), Ok(86_400_000_000_000));
        for (unit, t) in [("ns", -1), ("s", i128::from(u64::MAX)), ("ns", i128::MAX)] {
            assert_eq!(clock(unit).whole(t), Err(UNFIT.to_string()), "{t} {unit}");
        }
    }

    #[test]
    fn days_that_programs_count_begin_in_1970() {
        let stamp = |unit: &str, t: f64| Clock::new(unit, 0.0).unwrap().stamp(t).unwrap();
        assert_eq!(stamp("excel", 25_569.0), 0);
        assert_eq!(stamp("datenum", 719_529.0), 0);
        // 2024-05-06 12:00, which Excel has as 45418.5 and MATLAB as 739378.5
        let noon = Clock::new("iso8601", 0.0).unwrap().read("2024-05-06T12:00:00Z").unwrap();
        assert_eq!((stamp("excel", 45_418.5), stamp("datenum", 739_378.5)), (noon, noon));
        assert!(Clock::new("m", 0.0).unwrap_err().contains("no unit of time"));
        assert!(Clock::new("excel", 0.0).unwrap().stamp(2.0).unwrap_err().contains("negative"));
    }
}
