//! What is in a log in; the same as a table for a person out.

use super::inspect::{FieldSurvey, Survey, TopicSurvey};
use super::{Severity, decode};
use std::fmt::Write;

impl std::fmt::Display for Survey {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let length = self.end_ns.saturating_sub(self.start_ns) as f64 / 1e9;
        writeln!(
            f,
            "{}: {} messages in {} topics, {} chunks, {length:.1} s{}",
            self.name,
            self.messages,
            self.topics.len(),
            self.chunks,
            date(self.start_ns)
        )?;
        for note in &self.notes {
            let word = if note.severity == Severity::Warning { "warning" } else { "note" };
            writeln!(f, "{word}: {}", note.text)?;
        }
        self.topics.iter().try_for_each(|t| t.fmt(f))
    }
}

impl std::fmt::Display for TopicSurvey {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let schema =
            if self.schema_encoding.is_empty() { "no schema" } else { &self.schema_encoding };
        write!(
            f,
            "\n{}  {} ({schema}{}{})",
            shortened(&self.topic),
            self.message_encoding,
            if self.schema_name.is_empty() { "" } else { " " },
            shortened(&self.schema_name)
        )?;
        write!(f, "  {} messages", self.messages)?;
        if self.rate_hz > 0.0 {
            write!(f, ", {} Hz", Short(self.rate_hz))?;
        }
        match self.gaps {
            0 => write!(f, ", no gaps")?,
            n => write!(f, ", {n} gaps, the longest {:.3} s", self.longest_gap_s)?,
        }
        if self.out_of_order > 0 {
            write!(f, ", {} out of order", self.out_of_order)?;
        }
        writeln!(f, "{}", if self.has_publish_time { ", with publish times" } else { "" })?;
        if !self.decodable {
            return writeln!(
                f,
                "    its messages cannot be decoded; supported: {}",
                decode::supported()
            );
        }
        let wide = |head: &str, of: fn(&FieldSurvey) -> &String| {
            let widths = self.fields.iter().map(|x| shortened(of(x)).chars().count());
            widths.max().unwrap_or(0).max(head.len())
        };
        let (path, unit) = (wide("field", |x| &x.info.path), wide("unit", |x| &x.info.unit));
        if !self.fields.is_empty() {
            writeln!(
                f,
                "    {:path$}  {:unit$}  {:>12}  {:>12}  {:>7}  about",
                "field", "unit", "min", "max", "missing"
            )?;
        }
        for x in &self.fields {
            let mut line = format!(
                "    {:path$}  {:unit$}  {:>12}  {:>12}  ",
                shortened(&x.info.path),
                shortened(&x.info.unit),
                Short(x.min).to_string(),
                Short(x.max).to_string()
            );
            let missing = x.nan + x.unreadable;
            let _ = match missing {
                0 => write!(line, "{:>7}  {}", "-", x.info.doc),
                n => write!(line, "{n:>7}  {}", x.info.doc),
            };
            writeln!(f, "{}", line.trim_end())?;
        }
        let more = |path: &String| format!("    ... and more items: {}", shortened(path));
        self.items.iter().try_for_each(|path| writeln!(f, "{}", more(path)))
    }
}

/// Characters of a name at either end, where it is too long for the screen: a log may have any.
const OF_NAME: usize = 48;

/// A name as the screen shows it.
fn shortened(name: &str) -> std::borrow::Cow<'_, str> {
    let length = name.chars().count();
    if length <= 2 * OF_NAME + 3 {
        return name.into();
    }
    let (first, last) = (name.chars().take(OF_NAME), name.chars().skip(length - OF_NAME));
    first.chain("...".chars()).chain(last).collect::<String>().into()
}

/// A number with six significant digits at most.
pub(super) struct Short(pub f64);

impl std::fmt::Display for Short {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let x = self.0;
        if x.is_nan() {
            return write!(f, "-");
        }
        if x != 0.0 && !(1e-4..1e7).contains(&x.abs()) {
            return write!(f, "{x:.4e}");
        }
        let digits = 5 - (libm::floor(libm::log10(x.abs().max(1e-4))) as i64).clamp(-4, 5);
        let text = format!("{x:.*}", digits.max(0) as usize);
        let text = if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.')
        } else {
            &text
        };
        write!(f, "{text}")
    }
}

/// `, from 2025-11-13 10:20:30 UTC`, or nothing for a clock that does not count from 1970.
fn date(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    if seconds < 978_307_200 {
        return String::new();
    }
    // Days since 1970 to a date of the Gregorian calendar: years counted from 1 March, 400 years
    // have 146097 days.
    let (days, of_day) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!(
        ", from {year}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC",
        of_day / 3600,
        of_day / 60 % 60,
        of_day % 60
    )
}

#[cfg(test)]
mod tests {
    use super::super::inspect::survey;
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(date(951_782_400_000_000_000), "");
        assert_eq!(date(1_709_210_096_000_000_000), ", from 2024-02-29 12:34:56 UTC");
        assert_eq!(date(1_735_689_599_000_000_000), ", from 2024-12-31 23:59:59 UTC");
    }

    #[test]
    fn fault_names_without_end_and_long_lists_are_shown_short() {
        use super::super::tests::{START, raw};
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.mcap");
        let (name, items) = ("y".repeat(70_000), vec!["0.5"; 2000].join(","));
        let text = format!("{{\"{name}\":1,\"v\":[{items}]}}");
        raw(&path, "json", &[("/t", START, START, text)], 4000);
        let survey = survey(&path).expect("surveyed");
        assert_eq!(
            (survey.topics[0].fields.len(), &survey.topics[0].items[..]),
            (65, &["v.*".to_string()][..])
        );
        let said = survey.to_string();
        assert!(said.len() < 20_000 && said.contains("yyy...yyy"), "{} bytes", said.len());
        assert!(said.contains("... and more items: v.*"), "{said}");
    }

    #[test]
    fn numbers_are_short() {
        let text = |x: f64| Short(x).to_string();
        assert_eq!(
            [
                text(0.0),
                text(100.0),
                text(-0.012345678),
                text(99.5003),
                text(1e-9),
                text(123456789.0),
                text(f64::NAN)
            ],
            ["0", "100", "-0.0123457", "99.5003", "1.0000e-9", "1.2346e8", "-"]
        );
    }
}
