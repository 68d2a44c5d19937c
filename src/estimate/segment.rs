//! Records with labels in; groups of segments, and which samples of different outputs belong together, out.

use crate::dynamics::Record;
use indexmap::IndexMap;
use std::borrow::Cow;

/// One stretch of flight of an estimation, and what is known of it by name: the columns that parameters can be `per`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Segment {
    pub record: Record,
    /// For example `flight = "f3"`, `flap = "15"`.
    pub labels: IndexMap<String, String>,
}

impl From<Record> for Segment {
    fn from(record: Record) -> Segment {
        Segment { record, labels: IndexMap::new() }
    }
}

/// Segments of equal value in one column.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grouping {
    /// The values, in the order in which segments bring them.
    pub values: Vec<String>,
    /// Per segment the place in `values`.
    pub of: Vec<usize>,
}

/// The column that tells every segment from every other, without being written down in `labels`.
pub const SEGMENT: &str = "segment";
/// All segments together.
pub const CAMPAIGN: &str = "campaign";

impl Grouping {
    /// By value of `column` ("campaign", "segment" or a label); segments without that label are a group of their own.
    pub fn by(column: &str, segments: &[&Segment]) -> Grouping {
        let mut grouping = Grouping::default();
        for (s, segment) in segments.iter().enumerate() {
            let value: Cow<str> = match column {
                CAMPAIGN => "".into(),
                SEGMENT => s.to_string().into(),
                _ => segment.labels.get(column).map(String::as_str).unwrap_or_default().into(),
            };
            let at = if column == SEGMENT { None } else { grouping.values.iter().position(|v| *v == value) };
            grouping.of.push(at.unwrap_or(grouping.values.len()));
            if at.is_none() {
                grouping.values.push(value.into_owned());
            }
        }
        grouping
    }
}

/// Times closer than this share of a grid step are one instant: times in logs are rounded.
const SAME: f64 = 1e-3;

/// The number of the instant of every sample of every channel of a record, ascending within a channel. Two channels of one output
/// never share an instant: they would measure the same noise twice.
pub fn instants(record: &Record) -> Vec<Vec<u32>> {
    let channels = &record.channels;
    let mut numbers: Vec<Vec<u32>> = channels.iter().map(|c| Vec::with_capacity(c.t.len())).collect();
    let head = |numbers: &[Vec<u32>], c: usize| channels[c].t.get(numbers[c].len()).copied();
    let mut now = 0;
    loop {
        let first = (0..channels.len()).filter_map(|c| head(&numbers, c)).fold(f64::INFINITY, f64::min);
        if first == f64::INFINITY {
            return numbers;
        }
        let mut taken: Vec<usize> = Vec::with_capacity(channels.len());
        for c in 0..channels.len() {
            let here = head(&numbers, c).is_some_and(|t| t <= first + SAME * record.dt);
            if here && !taken.contains(&channels[c].output) {
                numbers[c].push(now);
                taken.push(channels[c].output);
            }
        }
        now += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Channel;

    #[test]
    fn samples_of_one_time_share_an_instant() {
        let channel = |output, t: &[f64]| Channel { output, t: t.to_vec(), z: vec![0.0; t.len()] };
        let channels =
            vec![channel(0, &[0.0, 0.1, 0.2]), channel(1, &[0.0, 0.2]), channel(2, &[0.05, 0.100_000_1]), channel(1, &[0.2])];
        let record = Record { dt: 0.1, channels, ..Record::default() };
        assert_eq!(instants(&record), [vec![0, 2, 3], vec![0, 3], vec![1, 2], vec![4]]);
    }

    #[test]
    fn segments_are_grouped_in_the_order_in_which_they_come() {
        let with = |flap: &str| Segment { labels: [("flap".to_string(), flap.to_string())].into(), ..Segment::default() };
        let all = [with("15"), with("0"), with("15")];
        let all: Vec<&Segment> = all.iter().collect();
        let by = |column| Grouping::by(column, &all).of;
        assert_eq!((by("flap"), by("segment"), by("campaign")), (vec![0, 1, 0], vec![0, 1, 2], vec![0, 0, 0]));
        assert_eq!(Grouping::by("flap", &all).values, ["15", "0"]);
    }
}
