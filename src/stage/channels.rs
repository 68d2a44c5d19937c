//! The channel map in; SI units of signals, and which of them are one measurement, out.

use crate::config::Doc;
use crate::error::Place;
use crate::log::ChannelMap;
use crate::units::Unit;

/// The channel map and where its entries stand.
#[derive(Debug, Clone)]
pub struct Channels {
    pub map: ChannelMap,
    pub doc: Doc,
}

/// A unit in the channel map.
#[derive(Debug, Clone, PartialEq)]
pub struct Stated {
    /// As it is written there.
    pub unit: String,
    pub place: Place,
}

impl Channels {
    /// SI unit of a signal's values: empty where there is no such signal.
    pub fn unit(&self, signal: &str) -> String {
        self.map.signal.get(signal).map(|s| si(&s.unit)).unwrap_or_default()
    }

    /// The unit of a signal as the channel map states it, and where; none where there is no such signal.
    pub fn stated(&self, signal: &str) -> Option<Stated> {
        let unit = self.map.signal.get(signal)?.unit.clone();
        Some(Stated { unit, place: self.doc.place(&format!("signal.{signal}.unit")) })
    }

    /// Whether two names are one measurement: the same signal, or signals of the same field of the
    /// log.
    pub fn same(&self, a: &str, b: &str) -> bool {
        let source = |name: &str| self.map.signal.get(name).map(|s| (&s.topic, &s.field));
        a == b || source(a).is_some_and(|of_a| source(b) == Some(of_a))
    }

    /// What a signal is, in the words of the channel map.
    pub fn doc(&self, signal: &str) -> &str {
        self.map.signal.get(signal).map_or("", |s| &s.doc)
    }
}

/// The SI unit that values of `unit` are converted to, as text: `deg/s` becomes `rad/s`, `kt`
/// becomes `m/s`.
fn si(unit: &str) -> String {
    let is_si = |text: &str| Unit::parse(text).is_ok_and(|u| u.is_si());
    let radians = Unit::in_radians(unit);
    match Unit::parse(unit) {
        _ if is_si(&radians) => radians,
        _ if is_si(unit) => unit.to_string(),
        Ok(parsed) => {
            let named = ["Pa", "N", "W", "V"]
                .into_iter()
                .find(|name| Unit::parse(name).is_ok_and(|u| u.dim == parsed.dim));
            named.map_or_else(|| parsed.dim.to_string(), str::to_string)
        }
        Err(_) => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_logs_become_si() {
        for (unit, expected) in [
            ("deg", "rad"),
            ("deg/s", "rad/s"),
            ("kt", "m/s"),
            ("m/s^2", "m/s^2"),
            ("degC", "K"),
            ("degrees/s", "rad/s"),
            ("dps", "rad/s"),
            ("rpm", "rad/s"),
            ("mrad", "rad"),
            ("knots", "m/s"),
            ("hPa", "Pa"),
            ("lbf", "N"),
            ("mV", "V"),
            ("ft lbf", "kg m^2/s^2"),
        ] {
            assert_eq!(si(unit), expected);
        }
    }
}
