//! Unit strings ("N m", "deg/s", "kg/m^3") to dimensions and the factor that brings a value to SI.
//!
//! `rad` is dimensionless. Only `log` converts values; everywhere else units are coherent SI and
//! serve checks and display.

mod hints;
mod simplify;

pub use simplify::simplified;
use std::fmt;

/// Exponents of kg, m, s, A, K in twelfths, so that roots stay exact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Dim(pub [i16; 5]);

const BASE: [&str; 5] = ["kg", "m", "s", "A", "K"];
const ONE: i16 = 12;

impl Dim {
    pub const NONE: Dim = Dim([0; 5]);

    pub fn times(self, other: Dim) -> Dim {
        Dim(std::array::from_fn(|i| self.0[i].saturating_add(other.0[i])))
    }

    pub fn over(self, other: Dim) -> Dim {
        Dim(std::array::from_fn(|i| self.0[i].saturating_sub(other.0[i])))
    }

    /// `self` to the power `exponent`; `None` where an exponent would not be a twelfth.
    pub fn power(self, exponent: f64) -> Option<Dim> {
        let mut out = [0; 5];
        for (o, &e) in out.iter_mut().zip(&self.0) {
            let x = f64::from(e) * exponent;
            if (x - x.round()).abs() > 1e-9 || x.abs() > 3000.0 {
                return None;
            }
            *o = x.round() as i16;
        }
        Some(Dim(out))
    }
}

impl fmt::Display for Dim {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let power = |name: &str, e: i16| match e {
            ONE => name.to_string(),
            e if e % ONE == 0 => format!("{name}^{}", e / ONE),
            e => format!("{name}^{}", f64::from(e) / f64::from(ONE)),
        };
        let side = |sign: i16| -> Vec<String> {
            (0..5)
                .filter(|&i| self.0[i] * sign > 0)
                .map(|i| power(BASE[i], self.0[i] * sign))
                .collect()
        };
        let (up, down) = (side(1), side(-1));
        match (up.is_empty(), down.is_empty()) {
            (true, true) => write!(f, "-"),
            (_, true) => write!(f, "{}", up.join(" ")),
            (empty, false) => {
                let up = if empty { "1".to_string() } else { up.join(" ") };
                let down =
                    if down.len() > 1 { format!("({})", down.join(" ")) } else { down[0].clone() };
                write!(f, "{up}/{down}")
            }
        }
    }
}

/// What one unit is worth: `si = value * scale + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    pub dim: Dim,
    pub scale: f64,
    pub offset: f64,
}

const DEG: f64 = std::f64::consts::PI / 180.0;
const G0: f64 = 9.80665;
const LB: f64 = 0.45359237;

/// name, [kg, m, s, A, K], scale, offset
#[rustfmt::skip]
const UNITS: &[(&str, [i16; 5], f64, f64)] = &[
    ("-", [0, 0, 0, 0, 0], 1.0, 0.0), ("1", [0, 0, 0, 0, 0], 1.0, 0.0), ("%", [0, 0, 0, 0, 0], 0.01, 0.0),
    ("rad", [0, 0, 0, 0, 0], 1.0, 0.0), ("mrad", [0, 0, 0, 0, 0], 1e-3, 0.0), ("deg", [0, 0, 0, 0, 0], DEG, 0.0),
    ("rev", [0, 0, 0, 0, 0], 360.0 * DEG, 0.0), ("rpm", [0, 0, -1, 0, 0], 6.0 * DEG, 0.0),
    ("kg", [1, 0, 0, 0, 0], 1.0, 0.0), ("lb", [1, 0, 0, 0, 0], LB, 0.0), ("slug", [1, 0, 0, 0, 0], LB * G0 / 0.3048, 0.0),
    ("t", [1, 0, 0, 0, 0], 1000.0, 0.0),
    ("m", [0, 1, 0, 0, 0], 1.0, 0.0), ("km", [0, 1, 0, 0, 0], 1e3, 0.0), ("cm", [0, 1, 0, 0, 0], 1e-2, 0.0),
    ("mm", [0, 1, 0, 0, 0], 1e-3, 0.0), ("ft", [0, 1, 0, 0, 0], 0.3048, 0.0), ("in", [0, 1, 0, 0, 0], 0.0254, 0.0),
    ("nmi", [0, 1, 0, 0, 0], 1852.0, 0.0), ("l", [0, 3, 0, 0, 0], 1e-3, 0.0),
    ("s", [0, 0, 1, 0, 0], 1.0, 0.0), ("ms", [0, 0, 1, 0, 0], 1e-3, 0.0), ("us", [0, 0, 1, 0, 0], 1e-6, 0.0),
    ("ns", [0, 0, 1, 0, 0], 1e-9, 0.0), ("min", [0, 0, 1, 0, 0], 60.0, 0.0), ("h", [0, 0, 1, 0, 0], 3600.0, 0.0),
    ("Hz", [0, 0, -1, 0, 0], 1.0, 0.0), ("kHz", [0, 0, -1, 0, 0], 1e3, 0.0),
    ("kt", [0, 1, -1, 0, 0], 1852.0 / 3600.0, 0.0), ("kn", [0, 1, -1, 0, 0], 1852.0 / 3600.0, 0.0),
    ("fpm", [0, 1, -1, 0, 0], 0.3048 / 60.0, 0.0), ("mph", [0, 1, -1, 0, 0], 0.44704, 0.0),
    ("g", [0, 1, -2, 0, 0], G0, 0.0),
    ("N", [1, 1, -2, 0, 0], 1.0, 0.0), ("kN", [1, 1, -2, 0, 0], 1e3, 0.0), ("lbf", [1, 1, -2, 0, 0], LB * G0, 0.0),
    ("Pa", [1, -1, -2, 0, 0], 1.0, 0.0), ("hPa", [1, -1, -2, 0, 0], 100.0, 0.0), ("kPa", [1, -1, -2, 0, 0], 1e3, 0.0),
    ("mbar", [1, -1, -2, 0, 0], 100.0, 0.0), ("bar", [1, -1, -2, 0, 0], 1e5, 0.0),
    ("MPa", [1, -1, -2, 0, 0], 1e6, 0.0), ("psf", [1, -1, -2, 0, 0], LB * G0 / (0.3048 * 0.3048), 0.0),
    ("psi", [1, -1, -2, 0, 0], LB * G0 / (0.0254 * 0.0254), 0.0), ("inHg", [1, -1, -2, 0, 0], 3386.389, 0.0),
    ("J", [1, 2, -2, 0, 0], 1.0, 0.0), ("W", [1, 2, -3, 0, 0], 1.0, 0.0), ("kW", [1, 2, -3, 0, 0], 1e3, 0.0),
    ("A", [0, 0, 0, 1, 0], 1.0, 0.0), ("mA", [0, 0, 0, 1, 0], 1e-3, 0.0),
    ("V", [1, 2, -3, -1, 0], 1.0, 0.0), ("mV", [1, 2, -3, -1, 0], 1e-3, 0.0), ("ohm", [1, 2, -3, -2, 0], 1.0, 0.0),
    ("K", [0, 0, 0, 0, 1], 1.0, 0.0), ("degC", [0, 0, 0, 0, 1], 1.0, 273.15), ("degF", [0, 0, 0, 0, 1], 5.0 / 9.0, 459.67 * 5.0 / 9.0),
    ("degR", [0, 0, 0, 0, 1], 5.0 / 9.0, 0.0),
];

/// Other spellings, as logs have them, and the unit they stand for.
#[rustfmt::skip]
const SYNONYMS: &[(&str, &str)] = &[
    ("unitless", "-"), ("dimensionless", "-"), ("percent", "%"), ("°", "deg"), ("degree", "deg"), ("degrees", "deg"),
    ("radian", "rad"), ("radians", "rad"), ("kilogram", "kg"), ("kilograms", "kg"), ("lbs", "lb"), ("lbm", "lb"), ("slugs", "slug"),
    ("meter", "m"), ("meters", "m"), ("metre", "m"), ("metres", "m"), ("foot", "ft"), ("feet", "ft"), ("inch", "in"), ("inches", "in"),
    ("NM", "nmi"), ("sec", "s"), ("second", "s"), ("seconds", "s"), ("msec", "ms"), ("usec", "us"), ("µs", "us"), ("μs", "us"), ("nsec", "ns"),
    ("minute", "min"), ("minutes", "min"), ("hr", "h"), ("hour", "h"), ("hours", "h"), ("hz", "Hz"), ("RPM", "rpm"),
    ("knot", "kt"), ("knots", "kt"), ("kts", "kt"), ("mps", "m/s"), ("kph", "km/h"), ("dps", "deg/s"),
    ("newton", "N"), ("newtons", "N"), ("pascal", "Pa"), ("pascals", "Pa"), ("mb", "mbar"), ("ampere", "A"), ("amperes", "A"), ("amps", "A"),
    ("volt", "V"), ("volts", "V"), ("kelvin", "K"), ("Kelvin", "K"), ("°C", "degC"), ("celsius", "degC"), ("Celsius", "degC"),
    ("°F", "degF"), ("fahrenheit", "degF"), ("Fahrenheit", "degF"),
    ("KT", "kt"), ("KTS", "kt"), ("Kts", "kt"), ("MPH", "mph"), ("FT", "ft"), ("FPM", "fpm"),
    ("pct", "%"), ("psia", "psi"), ("PSI", "psi"), ("PSF", "psf"), ("LBS", "lb"), ("Nm", "N m"), ("pph", "lb/h"), ("PPH", "lb/h"),
    ("ft-lb", "ft lbf"), ("ft-lbf", "ft lbf"), ("lb-ft", "ft lbf"),
];

/// Scales that differ by no more than this share are the same: tables of constants are rounded.
const SAME: f64 = 1e-5;

impl Unit {
    /// Reads a unit string: names with optional powers (`m^2`, `m2`, `s^-1`, `s^0.5`), multiplied by a space
    /// or `*`, divided by `/` (which takes the next factor or parenthesis). The error says what
    /// could not be read.
    pub fn parse(text: &str) -> Result<Unit, String> {
        let trimmed = text.trim();
        if trimmed.is_empty() {
            return Err("an empty unit; write \"-\" for none".into());
        }
        if let Some(unit) = lookup(trimmed) {
            return Ok(unit);
        }
        let chars: Vec<char> = trimmed.chars().collect();
        let mut reader = Reader { chars: &chars, at: 0, text: trimmed };
        let meant = |e| hint(trimmed).map_or(e, |meant| format!("unit \"{trimmed}\": {meant}"));
        let unit = reader.product().map_err(meant)?;
        if reader.at < chars.len() {
            return Err(format!(
                "unit \"{trimmed}\": \"{}\" is not expected here",
                chars[reader.at]
            ));
        }
        Ok(unit)
    }

    /// A unit of the coherent SI (factor 1, no offset).
    pub fn is_si(&self) -> bool {
        self.scale == 1.0 && self.offset == 0.0
    }

    /// The text with `rad` in place of other angles, `rad/s` of what turns: a dimension alone loses them.
    pub fn in_radians(text: &str) -> String {
        let angles = [
            ("deg/s", "rad/s"),
            ("dps", "rad/s"),
            ("rpm", "rad/s"),
            ("RPM", "rad/s"),
            ("degrees", "rad"),
            ("degree", "rad"),
            ("deg", "rad"),
            ("°", "rad"),
            ("mrad", "rad"),
            ("radians", "rad"),
            ("radian", "rad"),
            ("rev", "rad"),
        ];
        angles.iter().fold(text.to_string(), |text, (name, rad)| text.replace(name, rad))
    }

    /// The coherent SI unit of what a unit measures: angles stay angles, `rad/s` for `deg/s`.
    pub fn si_of(text: &str, dim: Dim) -> String {
        let renamed = Unit::in_radians(text);
        match Unit::parse(&renamed) {
            Ok(unit) if unit.is_si() && unit.dim == dim && renamed != text => renamed,
            _ if dim == Dim::NONE => "rad or -".to_string(),
            _ => dim.to_string(),
        }
    }

    /// Whether both measure the same quantity with the same scale and zero, whatever they are
    /// called: `knots` and `kt`.
    pub fn same(&self, other: &Unit) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs().max(b.abs());
        self.dim == other.dim && near(self.scale, other.scale) && near(self.offset, other.offset)
    }

    pub fn to_si(&self, value: f64) -> f64 {
        value * self.scale + self.offset
    }

    pub fn from_si(&self, si: f64) -> f64 {
        (si - self.offset) / self.scale
    }
}

/// What may be meant by a name that is not known.
fn hint(name: &str) -> Option<String> {
    let known: Vec<&str> = UNITS.iter().map(|unit| unit.0).collect();
    hints::hint(name, &known)
}

fn lookup(name: &str) -> Option<Unit> {
    let known = UNITS.iter().find(|u| u.0 == name).map(|u| Unit {
        dim: Dim(u.1.map(|e| e * ONE)),
        scale: u.2,
        offset: u.3,
    });
    known.or_else(|| SYNONYMS.iter().find(|s| s.0 == name).and_then(|s| Unit::parse(s.1).ok()))
}

struct Reader<'a> {
    chars: &'a [char],
    at: usize,
    text: &'a str,
}

impl Reader<'_> {
    fn skip(&mut self) {
        while self.peek().is_some_and(char::is_whitespace) {
            self.at += 1;
        }
    }

    fn peek(&self) -> Option<char> {
        self.chars.get(self.at).copied()
    }

    fn product(&mut self) -> Result<Unit, String> {
        let mut total = self.factor()?;
        loop {
            self.skip();
            let over = match self.peek() {
                None | Some(')') => return Ok(total),
                Some('/') => {
                    self.at += 1;
                    true
                }
                Some('*') | Some('·') => {
                    self.at += 1;
                    false
                }
                Some(_) => false,
            };
            let next = self.factor()?;
            if total.offset != 0.0 || next.offset != 0.0 {
                return Err(format!(
                    "unit \"{}\": a temperature with its own zero cannot be part of a product; use K",
                    self.text
                ));
            }
            total = if over {
                Unit { dim: total.dim.over(next.dim), scale: total.scale / next.scale, offset: 0.0 }
            } else {
                Unit {
                    dim: total.dim.times(next.dim),
                    scale: total.scale * next.scale,
                    offset: 0.0,
                }
            };
        }
    }

    fn factor(&mut self) -> Result<Unit, String> {
        self.skip();
        if self.peek() == Some('(') {
            self.at += 1;
            let inner = self.product()?;
            if self.peek() != Some(')') {
                return Err(format!("unit \"{}\": a \")\" is missing", self.text));
            }
            self.at += 1;
            return Ok(inner);
        }
        let start = self.at;
        if self.peek().is_some_and(|c| c.is_ascii_digit()) {
            return self.one();
        }
        while self.peek().is_some_and(|c| c.is_alphabetic() || c == '%' || c == '°') {
            self.at += 1;
        }
        let name: String = self.chars[start..self.at].iter().collect();
        let unit = lookup(&name).ok_or_else(|| {
            let got = if name.is_empty() {
                self.peek().map(String::from).unwrap_or_default()
            } else {
                name.clone()
            };
            let meant = hint(&got).map_or(String::new(), |meant| format!("; {meant}"));
            format!("unit \"{}\": \"{got}\" is not a known unit{meant}", self.text)
        })?;
        match self.exponent()? {
            None => Ok(unit),
            Some(_) if unit.offset != 0.0 => {
                Err(format!("unit \"{}\": {name} cannot be raised to a power", self.text))
            }
            Some(e) => {
                let dim = unit
                    .dim
                    .power(e)
                    .ok_or_else(|| format!("unit \"{}\": power {e} is too large", self.text))?;
                Ok(Unit { dim, scale: libm::pow(unit.scale, e), offset: 0.0 })
            }
        }
    }

    /// The one of `1/s`; any other number would be a scale, which no unit has.
    fn one(&mut self) -> Result<Unit, String> {
        let start = self.at;
        while self.peek().is_some_and(|c| c.is_ascii_digit() || ".eE".contains(c)) {
            self.at += 1;
        }
        let number: String = self.chars[start..self.at].iter().collect();
        let wrong = || format!("unit \"{}\": {number} is a scale, not a unit", self.text);
        lookup(&number).filter(|_| number == "1").ok_or_else(wrong)
    }

    fn exponent(&mut self) -> Result<Option<f64>, String> {
        if let Some(power) = ['²', '³'].iter().position(|&c| self.peek() == Some(c)) {
            self.at += 1;
            return Ok(Some(power as f64 + 2.0));
        }
        let caret = self.peek() == Some('^');
        if caret {
            self.at += 1;
        }
        let start = self.at;
        if self.peek() == Some('-') && caret {
            self.at += 1;
        }
        while self.peek().is_some_and(|c| c.is_ascii_digit() || c == '.' && caret) {
            self.at += 1;
        }
        let digits: String = self.chars[start..self.at].iter().collect();
        match (digits.parse::<f64>(), caret) {
            // "g0" is no unit without a dimension
            (Ok(e), _) if e != 0.0 && e.abs() <= 12.0 && (2.0 * e).fract() == 0.0 => Ok(Some(e)),
            (Err(_), false) if digits.is_empty() => Ok(None),
            _ => Err(format!(
                "unit \"{}\": \"^\" wants a whole number above or below zero, or a half one",
                self.text
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_and_converted() {
        for (text, value, si, dim) in [
            ("deg", 180.0, std::f64::consts::PI, "-"),
            ("kt", 100.0, 51.44444444444444, "m/s"),
            ("ft/min", 100.0, 0.508, "m/s"),
            ("degC", 15.0, 288.15, "K"),
            ("N m s/rad", 1.0, 1.0, "kg m^2/s"),
            ("kg/m^3", 1.0, 1.0, "kg/m^3"),
            ("m/s2", 1.0, 1.0, "m/s^2"),
            ("1/(rad s)", 1.0, 1.0, "1/s"),
            ("s^-1", 1.0, 1.0, "1/s"),
            ("g", 1.0, 9.80665, "m/s^2"),
            ("lb/h", 3600.0, 0.45359237, "kg/s"),
            ("psf", 1.0, 47.88025898033584, "kg/(m s^2)"),
            ("KTS", 100.0, 51.44444444444444, "m/s"),
            ("Nm/rad", 1.0, 1.0, "kg m^2/s^2"),
            ("ft-lb", 1.0, 1.3558179483314003, "kg m^2/s^2"),
            ("pph", 3600.0, 0.45359237, "kg/s"),
            ("-", 1.0, 1.0, "-"),
            ("deg/s^1.5", 180.0, std::f64::consts::PI, "1/s^1.5"),
        ] {
            let unit = Unit::parse(text).unwrap();
            assert!((unit.to_si(value) - si).abs() < 1e-12 * si.abs(), "{text}");
            assert!((unit.from_si(si) - value).abs() < 1e-12 * value.abs(), "{text}");
            assert_eq!(unit.dim.to_string(), dim, "{text}");
        }
    }

    #[test]
    fn the_si_unit_of_an_angle_is_one_of_angles() {
        for (text, si) in [
            ("deg/s", "rad/s"),
            ("dps", "rad/s"),
            ("1/deg", "1/rad"),
            ("deg", "rad"),
            ("%", "rad or -"),
            ("rpm", "rad/s"),
            ("kt", "m/s"),
            ("N m/deg", "N m/rad"),
            ("lbf", "kg m/s^2"),
        ] {
            assert_eq!(Unit::si_of(text, Unit::parse(text).expect("a unit").dim), si, "{text}");
        }
    }

    #[test]
    fn units_are_the_same_by_dimension_scale_and_zero() {
        let same = |a: &str, b: &str| Unit::parse(a).unwrap().same(&Unit::parse(b).unwrap());
        for (a, b) in [
            ("knots", "kt"),
            ("°/s", "deg/s"),
            ("m/s²", "m/s^2"),
            ("m/sec/sec", "m s^-2"),
            ("ft/min", "fpm"),
            ("rad", "-"),
            ("°C", "degC"),
            ("hPa", "mbar"),
        ] {
            assert!(same(a, b), "{a} and {b}");
        }
        for (a, b) in [
            ("kt", "m/s"),
            ("deg", "rad"),
            ("deg", "deg/s"),
            ("K", "degC"),
            ("g", "m/s^2"),
            ("kt", "mph"),
        ] {
            assert!(!same(a, b), "{a} and {b}");
        }
        // a spelling that meant nothing would be passed over in silence
        assert!(SYNONYMS.iter().all(|(_, unit)| Unit::parse(unit).is_ok()));
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        assert!(Unit::parse("furlong").unwrap_err().contains("furlong"));
        assert!(Unit::parse("m/").is_err());
        assert!(Unit::parse("degC/s").unwrap_err().contains("K"));
        assert!(Unit::parse("m^x").is_err());
        for scaled in ["100 ft", "10 kPa", "1000 lb/h", "1/100 ft", "10%", "1e3 m", "1.5 s"] {
            assert!(Unit::parse(scaled).is_err_and(|e| e.contains("is a scale")), "{scaled}");
        }
        assert!(["g0", "m0", "deg0", "2 m", "0.1 deg"].iter().all(|u| Unit::parse(u).is_err()));
        assert!(Unit::parse("").is_err());
    }
}
