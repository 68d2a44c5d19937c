//! A maneuver's description in, its signal over time out: multisteps and multisines.

use super::settings::Maneuver;
use std::f64::consts::{PI, TAU};

/// The signal of one maneuver; time counts from its first step.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    Steps {
        /// Time, s, and size of each change of level; the last one leads back to 0.
        changes: Vec<(f64, f64)>,
        /// Duration of one edge, s; 0 is a jump.
        edge: f64,
    },
    Sines {
        /// Length, s; the signal is 0 outside.
        duration: f64,
        /// Frequency, rad/s, and phase, rad, of each term.
        terms: Vec<(f64, f64)>,
        /// Factor of the sum.
        factor: f64,
    },
}

/// A mistake in a maneuver: the key it belongs to and what is wrong.
pub type Mistake = (&'static str, String);

impl Shape {
    /// The signal that `maneuver` describes.
    ///
    /// # Errors
    /// Every key that does not fit.
    pub fn of(maneuver: &Maneuver) -> Result<Shape, Vec<Mistake>> {
        let mut mistakes = Vec::new();
        if !maneuver.amplitude.is_finite() || maneuver.amplitude <= 0.0 {
            mistakes.push((
                "amplitude",
                format!(
                    "the amplitude must be greater than 0, not {}; the sign is `polarity`",
                    maneuver.amplitude
                ),
            ));
        }
        if maneuver.polarity.abs() != 1 {
            mistakes.push((
                "polarity",
                format!("the polarity must be 1 or -1, not {}", maneuver.polarity),
            ));
        }
        let shape = match (maneuver.kind.as_str(), steps(&maneuver.kind)) {
            ("multisine", _) => multisine(maneuver, &mut mistakes),
            (_, Some(digits)) => multistep(maneuver, &digits, &mut mistakes),
            (other, None) => {
                let what = format!(
                    "\"{other}\" is no kind of maneuver: digits such as \"3211\", \"doublet\", \"step\" or \"multisine\" are"
                );
                mistakes.push(("kind", what));
                None
            }
        };
        shape.filter(|_| mistakes.is_empty()).ok_or(mistakes)
    }

    /// Time from the first step until the signal is 0 again, s.
    pub fn duration(&self) -> f64 {
        match self {
            Shape::Steps { changes, edge } => changes.last().map_or(0.0, |c| c.0) + edge,
            Shape::Sines { duration, .. } => *duration,
        }
    }

    /// The signal at `t` seconds after the first step.
    pub fn value(&self, t: f64) -> f64 {
        // Grid times are products of an index: a step at a grid point must not be missed by a
        // rounding error.
        const SLACK: f64 = 1e-9;
        match self {
            Shape::Steps { changes, edge } => {
                let risen = |at: f64| {
                    if *edge > 0.0 {
                        ((t - at) / edge).clamp(0.0, 1.0)
                    } else {
                        f64::from(t >= at - SLACK)
                    }
                };
                changes.iter().map(|(at, change)| change * risen(*at)).sum()
            }
            Shape::Sines { duration, terms, factor } => {
                if !(0.0..=*duration).contains(&t) {
                    return 0.0;
                }
                factor
                    * terms.iter().map(|(omega, phase)| libm::sin(omega * t + phase)).sum::<f64>()
            }
        }
    }
}

/// The digits of a multistep kind.
fn steps(kind: &str) -> Option<Vec<u32>> {
    match kind {
        "doublet" => Some(vec![1, 1]),
        "step" => Some(vec![1]),
        _ if kind.is_empty() => None,
        _ => kind.chars().map(|c| c.to_digit(10).filter(|d| *d > 0)).collect(),
    }
}

fn positive(
    value: Option<f64>,
    key: &'static str,
    for_what: &str,
    mistakes: &mut Vec<Mistake>,
) -> Option<f64> {
    match value {
        Some(x) if x.is_finite() && x > 0.0 => Some(x),
        Some(x) => {
            mistakes.push((key, format!("`{key}` must be greater than 0 s, not {x}")));
            None
        }
        None => {
            mistakes.push((key, format!("{for_what} needs `{key}`")));
            None
        }
    }
}

/// Steps of `digits` time units with alternating sign (Koehler and Wilhelm, DFVLR IB 154-77/40,
/// 1977).
fn multistep(maneuver: &Maneuver, digits: &[u32], mistakes: &mut Vec<Mistake>) -> Option<Shape> {
    let unit = positive(maneuver.unit_time_s, "unit_time_s", "a multistep", mistakes);
    for (key, given) in
        [("duration_s", maneuver.duration_s.is_some()), ("band_hz", maneuver.band_hz.is_some())]
    {
        if given {
            mistakes.push((
                key,
                format!("`{key}` belongs to a multisine, not to \"{}\"", maneuver.kind),
            ));
        }
    }
    let unit = unit?;
    let shortest = unit * f64::from(*digits.iter().min()?);
    if !(0.0..=shortest).contains(&maneuver.edge_s) {
        mistakes.push((
            "edge_s",
            format!(
                "an edge must take from 0 s to one step, {shortest} s, not {}",
                maneuver.edge_s
            ),
        ));
    }
    let mut changes = Vec::new();
    let (mut time, mut level, mut sign) = (0u32, 0.0, f64::from(maneuver.polarity));
    for digit in digits {
        let next = sign * maneuver.amplitude;
        changes.push((f64::from(time) * unit, next - level));
        (time, level, sign) = (time + digit, next, -sign);
    }
    changes.push((f64::from(time) * unit, -level));
    Some(Shape::Steps { changes, edge: maneuver.edge_s })
}

/// Harmonics of 1/duration inside the band, equal power, Schroeder phases (IEEE Trans. Inf. Theory
/// 16, 1970), shifted in time so that the signal begins and ends at zero.
fn multisine(maneuver: &Maneuver, mistakes: &mut Vec<Mistake>) -> Option<Shape> {
    let duration = positive(maneuver.duration_s, "duration_s", "a multisine", mistakes);
    if maneuver.unit_time_s.is_some() || maneuver.edge_s != 0.0 {
        mistakes.push(("kind", "a multisine has no `unit_time_s` and no `edge_s`".into()));
    }
    let Some([low, high]) = maneuver.band_hz else {
        mistakes.push(("band_hz", "a multisine needs `band_hz = [lowest, highest]`".into()));
        return None;
    };
    let duration = duration?;
    // Bounded: a band of many thousand harmonics is a mistake in a unit.
    let (first, last) = ((low * duration - 1e-9).ceil().max(1.0), (high * duration + 1e-9).floor());
    if !(low > 0.0 && last >= first && last < 10_000.0) {
        let what = format!(
            "between {low} and {high} Hz there must be 1 to 9999 multiples of 1/duration = {} Hz",
            1.0 / duration
        );
        mistakes.push(("band_hz", what));
        return None;
    }
    let count = last - first + 1.0;
    let term = |k: f64| {
        let j = k - first + 1.0;
        (TAU * k / duration, -PI * j * (j - 1.0) / count)
    };
    let terms: Vec<(f64, f64)> = (0..count as usize).map(|i| term(first + i as f64)).collect();
    let sum = |t: f64| terms.iter().map(|(omega, phase)| libm::sin(omega * t + phase)).sum::<f64>();
    let points = (32.0 * last) as usize;
    let step = duration / points as f64;
    let samples: Vec<f64> = (0..=points).map(|i| sum(i as f64 * step)).collect();
    let largest = samples.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let zero = rising_zero(&samples, step, sum);
    let terms = terms.iter().map(|(omega, phase)| (*omega, phase + omega * zero)).collect();
    Some(Shape::Sines {
        duration,
        terms,
        factor: f64::from(maneuver.polarity) * maneuver.amplitude / largest,
    })
}

/// The first time at which `f`, sampled at multiples of `step`, rises through 0; 0 when it never
/// does.
fn rising_zero(samples: &[f64], step: f64, f: impl Fn(f64) -> f64) -> f64 {
    let Some(i) = samples.windows(2).position(|w| w[0] <= 0.0 && w[1] > 0.0) else { return 0.0 };
    let (mut low, mut high) = (i as f64 * step, (i + 1) as f64 * step);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if f(middle) <= 0.0 { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maneuver(kind: &str) -> Maneuver {
        Maneuver {
            input: "u".into(),
            kind: kind.into(),
            unit_time_s: Some(0.5),
            amplitude: 2.0,
            polarity: -1,
            edge_s: 0.0,
            duration_s: None,
            band_hz: None,
            with: Vec::new(),
        }
    }

    fn sampled(shape: &Shape, dt: f64) -> Vec<f64> {
        let n = (shape.duration() / dt).round() as usize;
        (0..=n).map(|k| shape.value(k as f64 * dt)).collect()
    }

    #[test]
    fn multisteps_have_the_durations_and_integrals_of_their_digits() {
        // 3-2+1-1 = +1 unit, 2-2+1-1 = 0, 2-1+1 = 2, 1-1 = 0, 1.
        for (kind, duration, integral) in [
            ("3211", 3.5, 1.0),
            ("2211", 3.0, 0.0),
            ("211", 2.0, 2.0),
            ("doublet", 1.0, 0.0),
            ("step", 0.5, 1.0),
        ] {
            let shape = Shape::of(&maneuver(kind)).unwrap();
            assert_eq!(shape.duration(), duration, "{kind}");
            let area: f64 = sampled(&shape, 0.005).iter().sum::<f64>() * 0.005;
            assert!((area - integral * 0.5 * -2.0).abs() < 1e-9, "{kind} {area}");
        }
    }

    #[test]
    fn a_3211_has_its_levels_in_turn_and_changes_exactly_at_grid_points() {
        let shape = Shape::of(&maneuver("3211")).unwrap();
        let dt = 1.0 / 200.0;
        for (k, expected) in [
            (0, -2.0),
            (299, -2.0),
            (300, 2.0),
            (499, 2.0),
            (500, -2.0),
            (600, 2.0),
            (699, 2.0),
            (700, 0.0),
            (900, 0.0),
        ] {
            assert_eq!(shape.value(k as f64 * dt), expected, "{k}");
        }
        assert_eq!(shape.value(-dt), 0.0);
    }

    #[test]
    fn edges_are_ramps_that_keep_the_integral() {
        let m = Maneuver { edge_s: 0.2, ..maneuver("211") };
        let shape = Shape::of(&m).unwrap();
        assert!((shape.value(0.1) + 1.0).abs() < 1e-12);
        let area: f64 = sampled(&shape, 0.001).iter().sum::<f64>() * 0.001;
        assert!((area + 2.0).abs() < 1e-9, "{area}");
    }

    #[test]
    fn a_multisine_fills_its_band_begins_at_zero_and_reaches_its_amplitude() {
        let m = Maneuver {
            unit_time_s: None,
            duration_s: Some(10.0),
            band_hz: Some([0.2, 1.5]),
            polarity: 1,
            ..maneuver("multisine")
        };
        let shape = Shape::of(&m).unwrap();
        let values = sampled(&shape, 0.001);
        assert!(values[0].abs() < 1e-9 && values[10_000].abs() < 1e-9);
        let largest = values.iter().fold(0.0f64, |a, x| a.max(x.abs()));
        assert!((largest - 2.0).abs() < 0.01, "{largest}");
        // All 14 harmonics have the same power, others none; a relative peak factor (Morelli) below
        // 1.3 is what Schroeder phases give.
        let power = |k: f64| {
            let part = |f: fn(f64) -> f64| {
                values[1..]
                    .iter()
                    .enumerate()
                    .map(|(i, x)| x * f(TAU * k * (i + 1) as f64 / 10_000.0))
                    .sum::<f64>()
                    / 5000.0
            };
            part(f64::sin).hypot(part(f64::cos))
        };
        assert!(
            (power(2.0) - power(15.0)).abs() < 1e-9
                && power(2.0) > 0.2
                && power(1.0) < 1e-9
                && power(16.0) < 1e-9
        );
        let rms = (values[1..].iter().map(|x| x * x).sum::<f64>() / 10_000.0).sqrt();
        assert!(largest / rms / 2f64.sqrt() < 1.3);
    }

    #[test]
    fn every_mistake_of_a_maneuver_is_found() {
        let m = Maneuver {
            amplitude: -1.0,
            polarity: 3,
            unit_time_s: None,
            edge_s: 1.0,
            ..maneuver("3211")
        };
        let keys =
            |m: &Maneuver| Shape::of(m).unwrap_err().into_iter().map(|e| e.0).collect::<Vec<_>>();
        assert_eq!(keys(&m), ["amplitude", "polarity", "unit_time_s"]);
        assert_eq!(keys(&Maneuver { edge_s: 1.0, ..maneuver("3211") }), ["edge_s"]);
        assert_eq!(keys(&maneuver("32x1")), ["kind"]);
        assert_eq!(keys(&maneuver("3201")), ["kind"]);
        assert_eq!(
            keys(&Maneuver {
                band_hz: Some([2.0, 1.0]),
                unit_time_s: None,
                duration_s: Some(5.0),
                ..maneuver("multisine")
            }),
            ["band_hz"]
        );
        assert_eq!(
            keys(&Maneuver { unit_time_s: Some(1.0), ..maneuver("multisine") }),
            ["duration_s", "kind", "band_hz"]
        );
    }
}
