//! The channel map (`channels.toml`): which topic and field of a log is which signal, and how its
//! numbers become SI.

use crate::config::Doc;
use crate::error::{Error, Errors};
use crate::units::Unit;
use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maps the topics and fields of a log to signals in SI units.
///
/// One sample becomes `value = sign * scale * si(raw) + offset` at the time `stamp - delay`, where
/// `si` converts from `unit`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChannelMap {
    /// What holds for every signal that does not say otherwise.
    #[serde(default)]
    pub defaults: Defaults,
    /// The signals, by the name that the other files use.
    pub signal: IndexMap<String, SignalMap>,
}

/// What holds for every signal that does not say otherwise.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Defaults {
    /// Which time stamp counts: "log" (when the recorder received the message), "publish" (when it
    /// was sent), or the path of a field of the message, such as "header.stamp". Default "log".
    pub time: Option<String>,
    /// Unit of a time stamp taken from a field: "s", "ms", "us" or "ns". Not needed for a stamp of
    /// two fields (sec, nanosec).
    pub time_unit: Option<String>,
    /// What a time stamp taken from a field counts from. Default "epoch".
    pub time_zero: Option<TimeZero>,
}

/// What a time stamp taken from a field counts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TimeZero {
    /// The epoch of the log times, 1970 for most recorders.
    #[default]
    Epoch,
    /// The start of the recording: the earliest log time of the flight.
    Start,
}

/// Where one signal comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SignalMap {
    /// Topic in the log, for example "/surfaces".
    pub topic: String,
    /// Field of the message; a path such as "pose.position.x" or "channels.3" reaches into nested
    /// messages and lists.
    pub field: String,
    /// Unit of the numbers in the log, for example "deg", "kt", "ft/min", "hPa", "degC"; "1" where
    /// there is none. Where the log states another one by itself, that is an error, unless
    /// `despite` says so.
    pub unit: String,
    /// The unit that the log states for this field where the log is wrong and `unit` is right: unit
    /// = "m/s", despite = "kt".
    pub despite: Option<String>,
    /// +1, or -1 where the log counts the other way round.
    #[serde(default = "one_int")]
    pub sign: i8,
    /// Known scale factor: multiplies the value.
    #[serde(default = "one")]
    pub scale: f64,
    /// Known offset in SI units: added after sign and scale.
    #[serde(default)]
    pub offset: f64,
    /// Known latency in s, from the physical event to the time stamp: subtracted from the time
    /// stamp. At most 10 s either way.
    #[serde(default)]
    #[schemars(range(min = -10.0, max = 10.0))]
    pub delay: f64,
    /// Which time stamp counts, if another than in [defaults].
    pub time: Option<String>,
    /// Unit of a time stamp taken from a field, if another than in [defaults].
    pub time_unit: Option<String>,
    /// What a time stamp taken from a field counts from, if another than in [defaults].
    pub time_zero: Option<TimeZero>,
    /// Which way the signal can go at most, where that is known: fuel on board only falls. One that
    /// goes the other way, by more than its noise, is noted.
    pub trend: Option<Trend>,
    /// Range outside of which the signal cannot be, in SI units, lowest and highest: a sample outside
    /// is dropped and counted.
    pub range: Option<[f64; 2]>,
    /// What becomes of single samples, and of two in a row, that stand far out of their neighbours, as nothing else in the
    /// signal does: "drop" (they are counted, and told) or "keep". Default "drop".
    #[serde(default)]
    pub spikes: Wrong,
    /// What becomes of the samples of a sensor that stands still although it flickered until then: "drop"
    /// (they are counted, and told) or "keep". Default "drop".
    #[serde(default)]
    pub still: Wrong,
    /// Whether a log may lack it: that log then is one without a sample of this signal, which is
    /// noted, instead of a mistake.
    #[serde(default)]
    pub optional: bool,
    /// What the signal is, with its sign convention.
    #[serde(default)]
    pub doc: String,
}

/// What becomes of samples that cannot be right.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Wrong {
    #[default]
    Drop,
    Keep,
}

/// Which way a signal can go at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Trend {
    /// It never rises.
    Falls,
    /// It never falls.
    Rises,
}

fn one() -> f64 {
    1.0
}

fn one_int() -> i8 {
    1
}

/// Which time stamp of a message counts.
#[derive(Debug, Clone, PartialEq)]
pub enum TimeSource {
    Log,
    Publish,
    /// Path of a field, how many ns one unit of it is (`None`: no unit given, a stamp of `sec` and
    /// `nanosec`), and its zero.
    Field(String, Option<f64>, TimeZero),
}

impl ChannelMap {
    /// Checks everything that can be checked without a log: units, signs, numbers, time stamps.
    pub fn check(&self, doc: &Doc) -> Result<(), Errors> {
        let mut errors = Errors::default();
        if let Some(unit) = &self.defaults.time_unit {
            errors.take(
                time_unit_ns(unit).map_err(|e| Error::at(doc.place("defaults.time_unit"), e)),
            );
        }
        for (name, signal) in &self.signal {
            let place = |key: &str| doc.place(&format!("signal.{name}.{key}"));
            errors.take(Unit::parse(&signal.unit).map_err(|e| Error::at(place("unit"), e)));
            if signal.despite.as_ref() == Some(&signal.unit) {
                let what = format!(
                    "despite = \"{0}\" is `unit` itself: it is the unit that the log states where that is wrong",
                    signal.unit
                );
                errors.push(Error::at(place("despite"), what).help("leave it out"));
            }
            if signal.sign != 1 && signal.sign != -1 {
                errors.push(Error::at(
                    place("sign"),
                    format!("sign is 1 or -1, not {}", signal.sign),
                ));
            }
            for (key, value) in
                [("scale", signal.scale), ("offset", signal.offset), ("delay", signal.delay)]
            {
                if !value.is_finite() {
                    errors.push(Error::at(
                        place(key),
                        format!("{key} is a finite number, not {value}"),
                    ));
                }
            }
            if let Some([low, high]) = signal.range.filter(|[low, high]| !(low < high)) {
                let what = format!("range is lowest and highest, but {low} is not below {high}");
                errors.push(Error::at(place("range"), what));
            }
            if signal.scale == 0.0 {
                errors.push(Error::at(place("scale"), "a scale of 0 would make every value 0"));
            }
            if let Some(unit) = &signal.time_unit {
                errors.take(time_unit_ns(unit).map_err(|e| Error::at(place("time_unit"), e)));
            }
        }
        errors.or(())
    }

    /// The time stamp that counts for a signal.
    pub fn time_source(&self, signal: &SignalMap) -> TimeSource {
        let time = signal.time.as_deref().or(self.defaults.time.as_deref()).unwrap_or("log");
        let unit = signal.time_unit.as_deref().or(self.defaults.time_unit.as_deref());
        let zero = signal.time_zero.or(self.defaults.time_zero).unwrap_or_default();
        match time {
            "log" => TimeSource::Log,
            "publish" => TimeSource::Publish,
            path => {
                TimeSource::Field(path.to_string(), unit.and_then(|u| time_unit_ns(u).ok()), zero)
            }
        }
    }
}

fn time_unit_ns(unit: &str) -> Result<f64, String> {
    match unit {
        "s" => Ok(1e9),
        "ms" => Ok(1e6),
        "us" => Ok(1e3),
        "ns" => Ok(1.0),
        other => {
            Err(format!("a time stamp is in \"s\", \"ms\", \"us\" or \"ns\", not in \"{other}\""))
        }
    }
}
