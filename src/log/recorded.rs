//! Messages of one topic that are in memory and an entry of the channel map in; that signal in SI, as
//! it would be read from the log that they make, out.

use super::channel_map::{ChannelMap, SignalMap, TimeSource};
use super::series::{Account, Series, order, seconds};
use crate::error::{Error, Result};
use crate::units::Unit;

/// The messages of one topic: `rows` is `[messages][fields]`, row by row, in the units of the log.
#[derive(Debug, Clone, Copy)]
pub struct Recorded<'a> {
    pub fields: &'a [&'a str],
    /// When each message was sent, and when it was logged, ns since 1970.
    pub publish_ns: &'a [u64],
    pub log_ns: &'a [u64],
    pub rows: &'a [f64],
}

impl Recorded<'_> {
    /// A signal of these messages: seconds since `start_ns`, values in SI. A time stamp that the map
    /// takes from a field is the publish time: that is what a recorder in memory writes there.
    ///
    /// # Errors
    /// The topic has no such field, or its unit cannot be read.
    pub fn series(&self, map: &ChannelMap, signal: &SignalMap, start_ns: u64) -> Result<Series> {
        let unit = Unit::parse(&signal.unit).map_err(Error::new)?;
        let at = self.fields.iter().position(|f| *f == signal.field).ok_or_else(|| {
            Error::new(format!("topic \"{}\" has no field \"{}\"", signal.topic, signal.field))
        })?;
        let stamps = match map.time_source(signal) {
            TimeSource::Log => self.log_ns,
            TimeSource::Publish | TimeSource::Field(..) => self.publish_ns,
        };
        let since =
            |ns: u64| i64::try_from(i128::from(ns) - i128::from(start_ns)).unwrap_or(i64::MAX);
        let values = self.rows.iter().skip(at).step_by(self.fields.len().max(1));
        let mut samples: Vec<(i64, f64)> = stamps
            .iter()
            .zip(values)
            .filter(|(_, value)| value.is_finite())
            .map(|(stamp, value)| (since(*stamp), *value))
            .collect();
        order(&mut samples, &mut Account::default());
        let factor = f64::from(signal.sign) * signal.scale;
        Ok(Series {
            t_s: samples.iter().map(|s| seconds(s.0) - signal.delay).collect(),
            value: samples.iter().map(|s| factor * unit.to_si(s.1) + signal.offset).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_sorted_converted_and_moved_by_its_delay() {
        let text = "[defaults]\ntime = \"publish\"\n[signal]\nV = { topic = \"/air\", field = \"tas\", unit = \"km/h\", sign = -1, offset = 1.0, delay = 0.5 }\n";
        let (map, _) = crate::config::parse::<ChannelMap>("channels.toml", text).unwrap();
        let recorded = Recorded {
            fields: &["cas", "tas"],
            publish_ns: &[3_000_000_000, 2_000_000_000, 3_000_000_000],
            log_ns: &[1, 2, 3],
            rows: &[0.0, 36.0, 0.0, 18.0, 0.0, 99.0],
        };
        let series = recorded.series(&map, &map.signal["V"], 1_000_000_000).unwrap();
        assert_eq!((series.t_s, series.value), (vec![0.5, 1.5], vec![-4.0, -9.0]));
    }
}
