//! Estimates of single maneuvers of one parameter come in; flights in which it is another one by far,
//! while all others agree, go out: a unit, a sign or a scale of one log.

use super::one::One;
use crate::math::median;
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// A flight whose estimates of a parameter are so many times those of the others.
#[derive(Debug, Clone, PartialEq)]
pub struct Apart<'a> {
    pub flight: &'a str,
    pub parameter: &'a str,
    pub value: f64,
    pub others: f64,
    /// How many other flights there are.
    pub count: usize,
}

/// So many times another value is no change of condition.
const TIMES: f64 = 5.0;
/// The flight's own sd is below so much of the difference.
const SURE: f64 = 0.1;
/// The others lie within so much of their middle.
const ALIKE: f64 = 0.5;
/// Flights that agree with each other, at least.
const FEWEST: usize = 2;
/// So near 180/pi, or its inverse, is degrees for radians.
const NEAR: f64 = 0.05;

impl Apart<'_> {
    pub fn ratio(&self) -> f64 {
        self.value / self.others
    }

    /// Whether angles in deg for rad, or the other way round, would do this.
    pub fn is_of_degrees(&self) -> bool {
        let ratio = self.ratio().abs();
        let is = |times: f64| (ratio / times - 1.0).abs() < NEAR;
        is(180.0 / PI) || is(PI / 180.0)
    }
}

/// Of what is about zero the sign says nothing.
fn is_turned(ratio: f64) -> bool {
    (-2.0..-0.5).contains(&ratio)
}

/// The flights that stand apart in this parameter: at most one. Of two that contradict each other
/// the second is told, and only where the ratio names its cause: degrees for radians, or a sign.
pub fn apart<'a>(ones: &[One<'a>]) -> Option<Apart<'a>> {
    let mut flights: BTreeMap<&str, [f64; 2]> = BTreeMap::new();
    for one in ones {
        let sums = flights.entry(one.flight?).or_default();
        sums[0] += one.value / (one.sd * one.sd);
        sums[1] += 1.0 / (one.sd * one.sd);
    }
    let mean = |[sum, weight]: &[f64; 2]| sum / weight;
    let known = |sums: &[f64; 2]| 1.0 / sums[1].sqrt() < SURE * mean(sums).abs();
    if let [(_, first), (flight, second)] = flights.iter().collect::<Vec<_>>()[..] {
        let (value, others) = (mean(second), mean(first));
        let this = Apart { flight, parameter: ones[0].parameter, value, others, count: 1 };
        let named = this.is_of_degrees() || is_turned(this.ratio());
        return (known(first) && known(second) && named).then_some(this);
    }
    let mut found = flights.iter().filter_map(|(flight, sums)| {
        let others: Vec<f64> =
            flights.iter().filter(|(of, _)| *of != flight).map(|(_, sums)| mean(sums)).collect();
        let (value, sd, middle) = (mean(sums), 1.0 / sums[1].sqrt(), median(&others));
        let alike = others.iter().all(|x| (x - middle).abs() <= ALIKE * middle.abs());
        let ratio = value / middle;
        let another = is_turned(ratio) || !(1.0 / TIMES..TIMES).contains(&ratio.abs());
        let sure = sd < SURE * (value - middle).abs();
        (others.len() >= FEWEST && alike && another && sure).then(|| Apart {
            flight,
            parameter: ones[0].parameter,
            value,
            others: middle,
            count: others.len(),
        })
    });
    let first = found.next()?;
    found.next().is_none().then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ones(values: &[(&'static str, f64, f64)]) -> Vec<One<'static>> {
        let one = |&(flight, value, sd): &(&'static str, f64, f64)| One {
            parameter: "M_de",
            unit: "1/s2",
            segment: "",
            value,
            sd,
            trim: None,
            flight: Some(flight),
            input: None,
            kind: None,
        };
        values.iter().map(one).collect()
    }

    #[test]
    fn a_flight_in_other_units_stands_apart() {
        let found =
            ones(&[("a", -9.0, 0.1), ("a", -9.1, 0.1), ("b", -516.0, 0.8), ("c", -8.8, 0.1)]);
        let found = apart(&found).expect("b");
        assert_eq!((found.flight, found.count), ("b", 2));
        assert!(found.is_of_degrees(), "{}", found.ratio());
        let found = apart(&ones(&[("a", -9.0, 0.1), ("b", 9.1, 0.1), ("c", -8.8, 0.1)]));
        assert!(!found.expect("a sign").is_of_degrees());
    }

    #[test]
    fn what_differs_a_little_or_is_not_known_does_not() {
        for values in [
            [("a", -9.0, 0.1), ("b", -19.0, 0.1), ("c", -8.8, 0.1)],
            [("a", 0.1, 0.1), ("b", -5.0, 0.1), ("c", -0.1, 0.1)],
            [("a", -9.0, 0.1), ("b", -200.0, 60.0), ("c", -8.8, 0.1)],
        ] {
            assert_eq!(apart(&ones(&values)), None, "{values:?}");
        }
        assert_eq!(apart(&ones(&[("a", -9.0, 0.1), ("b", -400.0, 0.1)])), None);
        assert_eq!(apart(&ones(&[("a", -9.0, 2.0), ("b", -516.0, 0.1)])), None);
    }

    #[test]
    fn two_flights_are_told_where_the_ratio_names_its_cause() {
        let found = ones(&[("a", -9.0, 0.1), ("b", -516.0, 0.8)]);
        let found = apart(&found).expect("degrees");
        assert_eq!((found.flight, found.count), ("b", 1));
        assert!(found.is_of_degrees());
        assert!(apart(&ones(&[("a", -9.0, 0.1), ("b", 9.2, 0.1)])).is_some());
    }
}
