//! Values that were measured or found in; the lines of the consistency table for what no sensor and no air has
//! out.

use super::consistency::Row;
use crate::math::{digits, median};

/// Scales that a sensor may have.
const SCALES: [f64; 2] = [0.5, 2.0];
/// Steady wind along an axis that there is, m/s.
const WIND: f64 = 120.0;

/// The line of an error of a sensor, or a wind, that there is not: what is wrong with another sensor, or with a
/// unit, is taken up by it. Beyond chance by its standard deviation.
pub fn error_row(name: &str, start: f64, unit: &str, (value, sd): (f64, f64)) -> Option<Row> {
    let ([low, high], what) = match (unit, start) {
        ("-", 1.0) => (SCALES, "a scale"),
        ("m/s", _) if name.starts_with("wind_") => ([-WIND, WIND], "a wind"),
        _ => return None,
    };
    let text = format!(
        "{what} of {value:.4}, which there is not: another unit, a stamp or another sensor?"
    );
    (value + 3.0 * sd < low || value - 3.0 * sd > high).then(|| {
        let row = Row::of(name, "scale", value, unit, ("implausible", text));
        Row { low, high, ..row }
    })
}

/// The largest bias that an inertial sensor may have, by its unit.
const BIASES: [(&str, f64); 2] = [("m/s^2", 2.0), ("rad/s", 0.1)];

/// The line of a sensor whose bias, as it was found, no such sensor has: what it measures in another unit,
/// about another axis or with another sign is taken up by that. Beyond chance by its standard deviation.
pub fn bias_row(channel: &str, unit: &str, (value, sd): (f64, f64)) -> Option<Row> {
    let (_, most) = BIASES.into_iter().find(|(of, _)| *of == unit)?;
    let text = format!(
        "a bias of {value:.3} {unit}, where such a sensor has {most} at most: another unit, axis or sign?"
    );
    (value.abs() - 3.0 * sd > most).then(|| Row {
        channel: channel.to_string(),
        check: "bias",
        value,
        low: -most,
        high: most,
        unit: unit.to_string(),
        verdict: "implausible",
        text,
    })
}

/// Temperatures of air, at rest or brought to rest at twice the speed of sound, K. (Kelvin taken for degrees Celsius are above
/// 470 K.)
const TEMPERATURES: [f64; 2] = [150.0, 450.0];
/// Pressures of air from 31 km down to below the sea, Pa. (Hectopascals taken for pascals are below.)
const PRESSURES: [f64; 2] = [1.0e3, 1.2e5];

/// The line of a temperature or a static pressure that no air has; none where it may be one.
pub fn air_row(channel: &str, unit: &str, y: &[f64]) -> Option<Row> {
    let ([low, high], exchanged) = match (channel, unit) {
        (_, "K") => (TEMPERATURES, "kelvin and degrees Celsius"),
        ("static_pressure", "Pa") => (PRESSURES, "pascals and hectopascals (or others)"),
        _ => return None,
    };
    let known: Vec<f64> = y.iter().copied().filter(|v| v.is_finite()).collect();
    let middle = median(&known);
    let text = format!(
        "{} {unit} in the middle of the flight's values, which no air has: {exchanged} exchanged?",
        digits(middle)
    );
    (!known.is_empty() && !(low..high).contains(&middle)).then(|| {
        let row = Row::of(channel, "unit", middle, unit, ("another unit", text));
        Row { low, high, ..row }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_is_neither_at_twenty_kelvin_nor_at_fifty_bars() {
        let of = |name: &str, unit: &str, y: &[f64]| air_row(name, unit, y).map(|row| row.verdict);
        assert_eq!(of("T", "K", &[15.0, f64::NAN, 14.0]), Some("another unit"));
        assert_eq!(of("T", "K", &[288.0 + 273.15, 480.0]), Some("another unit"));
        assert_eq!(of("T", "K", &[288.0, 250.0]), None);
        assert_eq!((of("h", "m", &[15.0]), of("T", "K", &[])), (None, None));
        assert_eq!(of("static_pressure", "Pa", &[5.2e6]), Some("another unit"));
        assert_eq!(of("static_pressure", "Pa", &[520.0]), Some("another unit"));
        assert_eq!(of("static_pressure", "Pa", &[5.2e4]), None);
    }

    #[test]
    fn a_vane_in_another_unit_is_implausible() {
        let of = |name: &str, start: f64, unit: &str, value: f64| {
            error_row(name, start, unit, (value, 1e-3)).map(|row| row.verdict)
        };
        assert_eq!(of("k_alpha", 1.0, "-", 0.0175), Some("implausible"));
        assert_eq!(of("k_alpha", 1.0, "-", 3.9), Some("implausible"));
        assert_eq!(of("wind_n", 0.0, "m/s", -240.0), Some("implausible"));
        assert_eq!(of("k_alpha", 1.0, "-", 1.3), None);
        assert_eq!((of("wind_e", 0.0, "m/s", 70.0), of("b_V", 0.0, "m/s", 140.0)), (None, None));
    }

    #[test]
    fn a_bias_that_no_sensor_has_is_implausible() {
        let of =
            |unit: &str, value: f64| bias_row("az_imu", unit, (value, 1e-3)).map(|row| row.verdict);
        assert_eq!(of("m/s^2", 9.037), Some("implausible"));
        assert_eq!(of("m/s^2", -10.8), Some("implausible"));
        assert_eq!(of("rad/s", 0.2), Some("implausible"));
        assert_eq!((of("m/s^2", 0.08), of("rad/s", 0.01), of("rad", 3.0)), (None, None, None));
    }
}
