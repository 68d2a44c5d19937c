//! Numbers in, what a person reads out: significant digits, display units, thinning of long traces.

use crate::math::distribution::INTERVAL_95;
use std::f64::consts::PI;

/// What `±` and units mean, once for the whole page.
pub const MEANING: &str = "± is half of the 95% interval everywhere on this page: 1.96 standard deviations, of a fitted line through n points those of a t \
    distribution with n - 2 degrees of freedom; what is called sd is one standard deviation. Plots, and what is printed with them, are in the units of their axes, angles in degrees; tables are in SI units, angles in rad, \
    unless a unit stands there.";

/// Times to the millisecond: six digits would not do for a long flight.
pub fn times(t: &[f64]) -> Vec<Option<f64>> {
    t.iter().map(|t| t.is_finite().then(|| (t * 1e3).round() / 1e3)).collect()
}

/// `-0.372 ± 0.008`: an estimate with half of its 95% interval; alone where it has no standard
/// deviation.
pub fn plus_minus(value: f64, sd: f64) -> String {
    with_half(value, INTERVAL_95 * sd)
}

/// The same with half of the interval given. No other place writes a `±`.
pub fn with_half(value: f64, half: f64) -> String {
    let (text, half) = with_sd(value, half);
    half.map_or(text.clone(), |half| format!("{text} ± {half}"))
}

/// The unit of a slope: that of `y` over that of `x`, as it is read.
pub fn slope_unit(y: &str, x: &str) -> String {
    match (y, x) {
        ("" | "1", "" | "1") => String::new(),
        ("" | "1", x) => format!("1/{x}"),
        (y, "" | "1") => y.to_string(),
        (y, x) => format!("{y} per {x}"),
    }
}

/// ` [1/rad]`, or nothing.
pub fn bracketed(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" [{unit}]") }
}

/// Share of a value below which its standard deviation is rounding.
const EXACT: f64 = 1e-12;

/// `value` and `sd` as text: two significant digits of `sd`, and `value` to the same decimal place.
pub fn with_sd(value: f64, sd: f64) -> (String, Option<String>) {
    if !value.is_finite() {
        return ("none".into(), None);
    }
    // What rounding leaves of a number that is exact is no standard deviation.
    if !(sd.is_finite() && sd > EXACT * value.abs()) {
        return (number(value, 5), None);
    }
    let digits = 1 - exponent(sd);
    // Very large or small quantities read better with an exponent, both with the same significance.
    if !(-3..=9).contains(&digits) || value.abs() >= 1e7 {
        let significant = (exponent(value).max(exponent(sd)) - exponent(sd) + 2).clamp(2, 12);
        return (number(value, significant as usize), Some(number(sd, 2)));
    }
    let places = digits.max(0) as usize;
    (format!("{value:.places$}"), Some(format!("{sd:.places$}")))
}

/// `value` with `significant` digits; exponents only where plain digits would be long.
pub fn number(value: f64, significant: usize) -> String {
    if !value.is_finite() {
        return if value.is_nan() { "none".into() } else { format!("{value}") };
    }
    if value == 0.0 {
        return "0".into();
    }
    let e = exponent(value);
    let significant = significant.max(1) as i32;
    if (-4..=6).contains(&e) {
        let places = (significant - 1 - e).max(0) as usize;
        let text = format!("{value:.places$}");
        return if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
            "0".into()
        } else {
            text
        };
    }
    let places = (significant - 1) as usize;
    format!("{value:.places$e}")
}

/// A number as it stands, integers without a decimal point.
pub fn plain(value: f64, places: usize) -> String {
    if !value.is_finite() {
        return "none".into();
    }
    // a little less than zero is zero, not "-0.0"
    let text = format!("{value:.places$}");
    if text.bytes().any(|b| (b'1'..=b'9').contains(&b)) {
        text
    } else {
        text.trim_start_matches('-').to_string()
    }
}

/// Decimal exponent of `value` after rounding to two digits, so that 0.0996 counts as 0.10.
fn exponent(value: f64) -> i32 {
    let text = format!("{:.1e}", value.abs());
    text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0)
}

/// The unit a plot shows for SI `unit`, and the factor to it: angles are read in degrees.
pub fn display_unit(unit: &str) -> (f64, String) {
    match unit {
        "rad" => (180.0 / PI, "deg".into()),
        "rad/s" => (180.0 / PI, "deg/s".into()),
        "rad/s^2" | "rad/s2" => (180.0 / PI, "deg/s^2".into()),
        _ => (1.0, unit.into()),
    }
}

/// A number with its unit to so many digits, angles in degrees.
pub fn with_unit(value: f64, unit: &str, digits: usize) -> String {
    let (factor, unit) = display_unit(unit);
    format!("{} {unit}", number(factor * value, digits)).trim_end_matches([' ', '-']).to_string()
}

/// `value` rounded to six significant digits: what a plot can show, and a third of the bytes. Not
/// finite is `None`.
pub fn short(value: f64) -> Option<f64> {
    if !value.is_finite() {
        return None;
    }
    format!("{value:.5e}").parse().ok()
}

/// `values * factor`, shortened for a plot.
pub fn shorts(values: impl IntoIterator<Item = f64>, factor: f64) -> Vec<Option<f64>> {
    values.into_iter().map(|v| short(v * factor)).collect()
}

/// The samples to draw when `n` are too many: in every bucket the smallest and the largest of each
/// of `curves`, so that no spike is lost. Returns increasing indices, at most about `limit` of
/// them; all when `n <= limit`.
pub fn thin(n: usize, curves: &[&[f64]], limit: usize) -> Vec<usize> {
    let per_bucket = 2 * curves.len().max(1);
    let buckets = (limit / per_bucket).max(1);
    if n <= limit.max(per_bucket) {
        return (0..n).collect();
    }
    let mut keep = Vec::with_capacity(limit + 2);
    keep.push(0);
    for b in 0..buckets {
        let (from, to) = (b * n / buckets, (b + 1) * n / buckets);
        for curve in curves {
            let finite = || (from..to).filter(|&i| curve.get(i).is_some_and(|v| v.is_finite()));
            let at = |i: &usize| curve[*i];
            keep.extend(finite().min_by(|a, b| at(a).total_cmp(&at(b))));
            keep.extend(finite().max_by(|a, b| at(a).total_cmp(&at(b))));
        }
    }
    keep.push(n - 1);
    keep.sort_unstable();
    keep.dedup();
    keep
}

/// A line of words, at most about.
const LONG: usize = 170;

/// Words that fit into a line; the rest stands elsewhere.
pub fn brief(text: &str) -> String {
    if text.chars().count() <= LONG {
        return text.to_string();
    }
    let cut: String = text.chars().take(LONG).collect();
    format!("{} …", cut.rsplit_once(' ').map_or(cut.as_str(), |(words, _)| words))
}

/// "1 flight", "3 flights".
pub fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

/// "The flight", "Every one of the 3 flights".
pub fn every(n: usize, what: &str) -> String {
    if n == 1 { format!("The {what}") } else { format!("Every one of the {n} {what}s") }
}

/// At most six names, and how many more there are.
pub fn few(names: &[String]) -> String {
    let shown = names.iter().take(6).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > 6 { format!("{shown}, and {} more", names.len() - 6) } else { shown }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_ends_at_a_word() {
        let long = "word ".repeat(60);
        let short = brief(&long);
        assert!(short.ends_with("word …") && short.chars().count() <= LONG + 2, "{short}");
        assert_eq!(brief("a few words"), "a few words");
    }

    #[test]
    fn the_sd_decides_the_digits() {
        assert_eq!(with_sd(-0.372_149, 0.004_21), ("-0.3721".into(), Some("0.0042".into())));
        assert_eq!(with_sd(-0.372_149, 0.0996), ("-0.37".into(), Some("0.10".into())));
        assert_eq!(with_sd(1234.56, 25.0), ("1235".into(), Some("25".into())));
        assert_eq!(with_sd(3.016e-24, 2e-26), ("3.016e-24".into(), Some("2.0e-26".into())));
        assert_eq!(with_sd(0.25, f64::NAN), ("0.25000".into(), None));
        assert_eq!(with_sd(f64::NAN, 1.0), ("none".into(), None));
    }

    #[test]
    fn an_interval_is_95_percent_wide_to_either_side() {
        assert_eq!(plus_minus(-0.372_149, 0.004_21), "-0.3721 ± 0.0083");
        assert_eq!(plus_minus(0.25, f64::NAN), "0.25000");
    }

    #[test]
    fn a_slope_has_the_units_of_both_axes() {
        let units = [("", "deg"), ("1/rad", "deg"), ("1/rad", ""), ("1", "")]
            .map(|(y, x)| slope_unit(y, x));
        assert_eq!(units, ["1/deg", "1/rad per deg", "1/rad", ""]);
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(number(0.0, 3), "0");
        assert_eq!(number(-0.012_345, 3), "-0.0123");
        assert_eq!(number(12_345.0, 3), "12345");
        assert_eq!(number(1.234_5e-9, 3), "1.23e-9");
        assert_eq!(short(1.234_567_89), Some(1.234_57));
        assert_eq!(short(f64::INFINITY), None);
    }

    #[test]
    fn thinning_keeps_spikes_and_ends() {
        let mut curve: Vec<f64> = (0..10_000).map(|i| f64::from(i % 7)).collect();
        curve[4321] = 99.0;
        curve[1234] = -99.0;
        curve[77] = f64::NAN;
        let keep = thin(curve.len(), &[&curve], 400);
        assert!(keep.len() <= 402, "{}", keep.len());
        assert!(keep.windows(2).all(|w| w[0] < w[1]));
        assert!([0, 1234, 4321, 9999].iter().all(|i| keep.contains(i)));
        assert_eq!(thin(5, &[&curve[..5]], 400), vec![0, 1, 2, 3, 4]);
        assert_eq!(thin(0, &[&[]], 400), Vec::<usize>::new());
    }
}
