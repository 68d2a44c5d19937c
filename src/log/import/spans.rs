//! The topics of a log with their rows in; whether they can have been recorded together, in words, out.

use super::rows::Rows;
use super::settings::Import;

const HOUR: f64 = 3600.0;
/// Topics further apart than this were never recorded together, s.
const A_DAY: f64 = 24.0 * HOUR;

/// A topic from its first row to its last, s.
#[derive(Debug, Clone, Copy)]
pub struct Span<'a> {
    topic: &'a str,
    begin: f64,
    end: f64,
}

impl std::fmt::Display for Span<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "\"{}\" ({:.3} to {:.3} s)", self.topic, self.begin, self.end)
    }
}

/// The span of every topic that has rows.
pub fn of<'a>(settings: &'a Import, topics: &[Rows]) -> Vec<Span<'a>> {
    let seconds = |ns: &u64| *ns as f64 * 1e-9;
    let span = |(topic, rows): (&'a super::settings::Topic, &Rows)| {
        let (begin, end) = (rows.stamp.first().map(seconds)?, rows.stamp.last().map(seconds)?);
        Some(Span { topic: &topic.name, begin, end })
    };
    settings.topic.iter().zip(topics).filter_map(span).collect()
}

/// The two that are furthest apart: the first to end, and the last to begin; none where all have some
/// time in common.
fn furthest<'a>(spans: &[Span<'a>]) -> Option<(Span<'a>, Span<'a>)> {
    let early = spans.iter().min_by(|a, b| a.end.total_cmp(&b.end))?;
    let late = spans.iter().max_by(|a, b| a.begin.total_cmp(&b.begin))?;
    (late.begin > early.end).then_some((*early, *late))
}

/// Whether a topic begins more than a day after another has ended.
pub fn apart(spans: &[Span]) -> Option<String> {
    let (early, late) = furthest(spans)?;
    let between = late.begin - early.end;
    (between > A_DAY).then(|| {
        format!(
            "topic \"{}\" begins at {:.0} s since 1970, and \"{}\" has ended at {:.0} s, {:.0} days before",
            late.topic,
            late.begin,
            early.topic,
            early.end,
            between / A_DAY
        )
    })
}

/// Topics that have no time in common, each of them by a day's length at most.
pub fn strangers(spans: &[Span]) -> Option<String> {
    let (early, late) = furthest(spans)?;
    let of = |a: &Span| spans.iter().filter(|b| b.begin > a.end).count();
    let more = spans.iter().map(of).sum::<usize>() - 1;
    let more = if more > 0 { format!(", nor have {more} pairs more") } else { String::new() };
    // A day later the early one would be beside the late one.
    let between = (late.begin - early.end - A_DAY).max(early.begin + A_DAY - late.end);
    let midnight = if between <= HOUR {
        format!(
            ": \"{}\" may have begun after midnight; `start_s` of its time is then a day more (86400)",
            early.topic
        )
    } else {
        String::new()
    };
    Some(format!("topics {early} and {late} have no time in common{more}{midnight}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(spans: &[(&'static str, f64, f64)]) -> Option<String> {
        let span = |&(topic, begin, end): &(&'static str, f64, f64)| Span { topic, begin, end };
        strangers(&spans.iter().map(span).collect::<Vec<Span>>())
    }

    #[test]
    fn topics_without_a_time_in_common_are_named_with_their_spans() {
        let note = told(&[("/a", 0.0, 3.98), ("/g", 18.0, 21.98)]).expect("apart");
        assert_eq!(
            note,
            "topics \"/a\" (0.000 to 3.980 s) and \"/g\" (18.000 to 21.980 s) have no time in common"
        );
        let note = told(&[("/a", 0.0, 4.0), ("/b", 1.0, 5.0), ("/g", 18.0, 22.0)]).expect("apart");
        assert!(note.ends_with("in common, nor have 1 pairs more"), "{note}");
        assert_eq!(told(&[("/a", 0.0, 4.0), ("/g", 4.0, 5.0)]), None);
        assert_eq!(told(&[("/a", 0.0, 4.0)]), None);
        assert_eq!(told(&[]), None);
    }

    #[test]
    fn one_that_may_have_begun_after_midnight_is_said_to() {
        let midnight = |a: (f64, f64), g: (f64, f64)| {
            told(&[("/a", a.0, a.1), ("/g", g.0, g.1)])
                .expect("apart")
                .contains("\"/g\" may have begun after midnight")
        };
        assert!(midnight((86_397.6, 86_402.0), (0.0, 2.0)));
        // four hours before midnight to four behind it, the other from half past midnight
        assert!(midnight((72_000.0, 100_800.0), (1800.0, 14_400.0)));
        // it begins half an hour, and two hours, after the first has ended
        assert!(midnight((82_000.0, 86_000.0), (1400.0, 2000.0)));
        assert!(!midnight((72_000.0, 79_200.0), (0.0, 2000.0)));
    }
}
