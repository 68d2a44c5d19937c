//! Records with labels in; groups of segments, and which samples of different outputs belong
//! together, out.

use crate::dynamics::{Channel, Numbers, Record};
use crate::model::Assumed;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// What a group of segments has in common.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Label {
    pub column: String,
    pub value: String,
}

impl std::fmt::Display for Label {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{} {}", self.column, self.value)
    }
}

/// One stretch of flight of an estimation, and what is known of it by name: the columns that
/// parameters can be `per`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize, Serialize)]
pub struct Segment {
    pub record: Record,
    /// For example `flight = "f3"`, `flap = "15"`.
    pub labels: IndexMap<String, String>,
    /// Conditions at which it was flown, SI: what a parameter may follow as a line
    /// (`Settings::lines`).
    pub conditions: IndexMap<String, f64>,
    /// Which part of the record is scored; all of it unless given.
    pub stretch: Option<Stretch>,
    /// What the assumed constants change of the record that its columns were made with. Whoever sums over
    /// segments elsewhere has no use for it.
    #[serde(skip)]
    pub made: Vec<Made>,
}

/// What one assumed constant changes of a record: the columns as they are where it is larger by `by`.
#[derive(Debug, Clone, PartialEq)]
pub struct Made {
    pub constant: Assumed,
    pub by: f64,
    /// By input: one value per point of the grid.
    pub inputs: Vec<(usize, Numbers)>,
    /// By channel of the record: one value per sample.
    pub channels: Vec<(usize, Numbers)>,
}

/// A stretch of a longer record. The model runs from the record's beginning, with start values and
/// segment parameters that all stretches of the record have in common; only what was measured
/// within the stretch is scored.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
pub struct Stretch {
    /// Name of the record, the same in all of its stretches.
    pub of: String,
    /// From this time on, s, and before that one.
    pub from: f64,
    pub to: f64,
}

impl Segment {
    /// The segment as it is where the constant of this name is larger; itself where that changes nothing.
    pub fn remade(&self, constant: &str) -> Segment {
        let mut segment = Segment { made: Vec::new(), ..self.clone() };
        let made = self.made.iter().find(|made| made.constant.quantity.name == constant);
        let Some(made) = made else { return segment };
        let record = &mut segment.record;
        let nu = record.inputs.len() / record.n.max(1);
        for (input, values) in &made.inputs {
            let rows = record.inputs.chunks_exact_mut(nu.max(1));
            rows.zip(values.iter()).for_each(|(row, value)| row[*input] = *value);
        }
        for (channel, values) in &made.channels {
            record.channels[*channel].z = values.clone();
        }
        segment
    }

    /// The record as far as it is run, with the samples that are scored.
    pub fn scored(&self) -> Record {
        let record = &self.record;
        let Some(stretch) = &self.stretch else { return record.clone() };
        let nu = record.inputs.len() / record.n.max(1);
        let channel = |c: &Channel| {
            let kept: Vec<usize> =
                (0..c.t.len()).filter(|&k| c.t[k] >= stretch.from && c.t[k] < stretch.to).collect();
            Channel {
                output: c.output,
                t: kept.iter().map(|&k| c.t[k]).collect(),
                z: kept.iter().map(|&k| c.z[k]).collect(),
            }
        };
        // up to the first point of the grid that no sample of the stretch lies behind
        let points =
            (((stretch.to - record.t0) / record.dt).ceil().max(0.0) as usize).saturating_add(1);
        let n = points.clamp(record.n.min(record.start + 1), record.n);
        Record {
            n,
            inputs: if n == record.n {
                record.inputs.clone()
            } else {
                record.inputs[..n * nu].to_vec().into()
            },
            channels: record.channels.iter().map(channel).collect(),
            ..record.clone()
        }
    }
}

impl From<Record> for Segment {
    fn from(record: Record) -> Segment {
        Segment { record, ..Segment::default() }
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

/// The column that tells every segment from every other (stretches of one record count as one),
/// without being written down in `labels`.
pub const SEGMENT: &str = "segment";
/// All segments together.
pub const CAMPAIGN: &str = "campaign";

impl Grouping {
    /// By value of `column` ("campaign", "segment" or a label); segments without that label are a
    /// group of their own.
    pub fn by(column: &str, segments: &[&Segment]) -> Grouping {
        let mut grouping = Grouping::default();
        for (s, segment) in segments.iter().enumerate() {
            let alone = column == SEGMENT && segment.stretch.is_none();
            let value: Cow<str> = match (column, &segment.stretch) {
                (CAMPAIGN, _) => "".into(),
                (SEGMENT, Some(stretch)) => stretch.of.as_str().into(),
                (SEGMENT, None) => s.to_string().into(),
                _ => segment.labels.get(column).map(String::as_str).unwrap_or_default().into(),
            };
            let at = if alone { None } else { grouping.values.iter().position(|v| *v == value) };
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

/// The number of the instant of every sample of every channel of a record, ascending within a
/// channel. Two channels of one output never share an instant: they would measure the same noise
/// twice.
pub fn instants(record: &Record) -> Vec<Vec<u32>> {
    let channels = &record.channels;
    let mut numbers: Vec<Vec<u32>> =
        channels.iter().map(|c| Vec::with_capacity(c.t.len())).collect();
    let head = |numbers: &[Vec<u32>], c: usize| channels[c].t.get(numbers[c].len()).copied();
    let mut now = 0;
    loop {
        let first =
            (0..channels.len()).filter_map(|c| head(&numbers, c)).fold(f64::INFINITY, f64::min);
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

    #[test]
    fn samples_of_one_time_share_an_instant() {
        let channel = |output, t: &[f64]| Channel {
            output,
            t: t.to_vec().into(),
            z: vec![0.0; t.len()].into(),
        };
        let channels = vec![
            channel(0, &[0.0, 0.1, 0.2]),
            channel(1, &[0.0, 0.2]),
            channel(2, &[0.05, 0.100_000_1]),
            channel(1, &[0.2]),
        ];
        let record = Record { dt: 0.1, channels, ..Record::default() };
        assert_eq!(instants(&record), [vec![0, 2, 3], vec![0, 3], vec![1, 2], vec![4]]);
    }

    #[test]
    fn segments_are_grouped_in_the_order_in_which_they_come() {
        let with = |flap: &str| Segment {
            labels: [("flap".to_string(), flap.to_string())].into(),
            ..Segment::default()
        };
        let all = [with("15"), with("0"), with("15")];
        let all: Vec<&Segment> = all.iter().collect();
        let by = |column| Grouping::by(column, &all).of;
        assert_eq!(
            (by("flap"), by("segment"), by("campaign")),
            (vec![0, 1, 0], vec![0, 1, 2], vec![0, 0, 0])
        );
        assert_eq!(Grouping::by("flap", &all).values, ["15", "0"]);
    }
}
