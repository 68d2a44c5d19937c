//! The table of correlations of an estimate in; what estimates of single maneuvers have in common out.
//!
//! The table lists a maneuver's parameters among each other and with the common parameters of its
//! group (the friction of a flight); those of two maneuvers are left out, for they follow: the
//! normal equations have an arrow's form, so `R_ij = r_i' R_cc^-1 r_j` with the correlations `r` of
//! each with the common ones and `R_cc` of these among each other. With `R_cc = L L'` the vector
//! `L^-1 r_i` says how far each of as many independent sources moves an estimate.

use crate::error::Result;
use crate::fit::Shared;
use crate::math::dense::{cholesky, forward};
use crate::table::Table;
use std::collections::BTreeMap;

/// Parameter, and the segment or group of segments that it is of: of what a group has in common there
/// may be one for every flight.
type Key = (String, String);

/// Correlations of the estimates of one model.
#[derive(Debug, Default)]
pub struct Correlations {
    /// Of those that the table lists, each pair both ways.
    pairs: BTreeMap<(Key, Key), f64>,
    /// Number of the group, and the part that each of its sources has in an estimate's sd.
    effects: BTreeMap<Key, (usize, Vec<f64>)>,
}

/// What the estimates of one group share: its common parameters with each other, and those of its
/// maneuvers with them.
#[derive(Default)]
struct Group<'a> {
    common: BTreeMap<(Of<'a>, Of<'a>), f64>,
    single: BTreeMap<Of<'a>, BTreeMap<Of<'a>, f64>>,
}

/// As [`Key`].
type Of<'a> = (&'a str, &'a str);

impl Correlations {
    pub fn read(table: &Table) -> Result<Correlations> {
        let (groups, value) = (table.strings("group")?, table.f64("value")?);
        let (names, segments) = (table.strings("parameter")?, table.opt_strings("segment")?);
        let (others, other_segments) =
            (table.strings("other")?, table.opt_strings("other_segment")?);
        let (of, other_of) = (table.opt_strings("of")?, table.opt_strings("other_of")?);
        let mut known = Correlations::default();
        let mut all: BTreeMap<&str, Group> = BTreeMap::new();
        for (k, &value) in value.iter().enumerate() {
            let one = (names[k], segments[k].or(of[k]).unwrap_or(groups[k]));
            let other = (others[k], other_segments[k].or(other_of[k]).unwrap_or(groups[k]));
            known.pairs.insert((key(one), key(other)), value);
            known.pairs.insert((key(other), key(one)), value);
            let group = all.entry(groups[k]).or_default();
            match (segments[k], other_segments[k]) {
                (None, None) => _ = group.common.insert((one, other), value),
                (Some(_), None) => _ = group.single.entry(one).or_default().insert(other, value),
                (None, Some(_)) => _ = group.single.entry(other).or_default().insert(one, value),
                (Some(_), Some(_)) => {}
            }
        }
        all.values().enumerate().for_each(|(k, group)| group.add(k, &mut known.effects));
        Ok(known)
    }

    /// What the estimates of one parameter from these segments have in common, with the standard
    /// deviation of each.
    pub fn shared(&self, parameter: &str, segments: &[&str], sd: &[f64]) -> Vec<Shared> {
        let mut groups: BTreeMap<usize, Shared> = BTreeMap::new();
        for (point, segment) in segments.iter().enumerate() {
            let effects = self.effects.get(&(parameter.to_string(), segment.to_string()));
            let Some((group, parts)) = effects else { continue };
            let shared = groups.entry(*group).or_insert_with(|| Shared {
                group: *group,
                sources: parts.len(),
                points: Vec::new(),
                effects: Vec::new(),
            });
            shared.points.push(point);
            shared.effects.extend(parts.iter().map(|part| part * sd[point]));
        }
        groups.into_values().collect()
    }

    /// Places of two points of two parameters whose correlation the table lists, and the covariance
    /// that they have besides the shared sources.
    pub fn pairs(
        &self,
        (one, points): (&str, &Table),
        (other, others): (&str, &Table),
    ) -> Result<Vec<(usize, usize, f64)>> {
        let segments = others.strings("segment")?.into_iter().enumerate();
        let places: BTreeMap<&str, usize> = segments.map(|(i, segment)| (segment, i)).collect();
        let (sd, other_sd) = (points.f64("sd")?, others.f64("sd")?);
        let mut out = Vec::new();
        for (i, segment) in points.strings("segment")?.iter().enumerate() {
            let key = (one.to_string(), segment.to_string());
            let first = (key.clone(), (other.to_string(), String::new()));
            let mine =
                self.pairs.range(first..).take_while(|((a, (b, _)), _)| *a == key && b == other);
            for ((_, partner), value) in mine {
                let own = value - self.through_sources(&key, partner);
                out.extend(places.get(&*partner.1).map(|&j| (i, j, own * sd[i] * other_sd[j])));
            }
        }
        Ok(out)
    }

    /// The correlation that comes from the shared sources.
    fn through_sources(&self, one: &Key, other: &Key) -> f64 {
        let (Some((_, a)), Some((_, b))) = (self.effects.get(one), self.effects.get(other)) else {
            return 0.0;
        };
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }
}

fn key((name, of): Of) -> Key {
    (name.to_string(), of.to_string())
}

impl Group<'_> {
    /// Adds the effects of the sources of this group, the one of this number.
    fn add(&self, number: usize, effects: &mut BTreeMap<Key, (usize, Vec<f64>)>) {
        let mut sources: Vec<Of> = self.single.values().flat_map(|r| r.keys().copied()).collect();
        sources.sort_unstable();
        sources.dedup();
        let n = sources.len();
        let l = self.factor(&sources);
        for (&one, r) in &self.single {
            let mut parts: Vec<f64> =
                sources.iter().map(|source| r.get(source).copied().unwrap_or(0.0)).collect();
            forward(&l, n, &mut parts);
            effects.insert(key(one), (number, parts));
        }
    }

    /// Cholesky factor of the correlations of the common parameters.
    fn factor(&self, sources: &[Of]) -> Vec<f64> {
        let n = sources.len();
        let of = |a: Of, b: Of| {
            let found = self.common.get(&(a, b)).or_else(|| self.common.get(&(b, a)));
            found.copied().unwrap_or(0.0)
        };
        let matrix = |less: f64| -> Vec<f64> {
            let entry = |k: usize| {
                if k / n == k % n { 1.0 } else { (1.0 - less) * of(sources[k / n], sources[k % n]) }
            };
            (0..n * n).map(entry).collect()
        };
        // Rounding may leave fully correlated parameters just short of a correlation matrix.
        let tries =
            [0.0, 1e-9, 1e-3, 1.0].into_iter().find_map(|less| cholesky(&matrix(less), n).ok());
        tries.unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two flights estimated together, each with an `F` of its own: what they share with their flight is
    /// nothing that they share with the other one.
    #[test]
    fn common_parameters_of_one_name_are_those_of_their_flight() {
        let rows = [
            ("F", None, "1", "F", None::<&str>, "2", 0.0),
            ("a", Some("1.1"), "1.1", "F", None, "1", 0.9),
            ("a", Some("1.1"), "1.1", "F", None, "2", 0.0),
            ("a", Some("1.2"), "1.2", "F", None, "1", 0.8),
            ("a", Some("1.2"), "1.2", "F", None, "2", 0.0),
            ("a", Some("2.1"), "2.1", "F", None, "1", 0.0),
            ("a", Some("2.1"), "2.1", "F", None, "2", 0.7),
        ];
        let table = Table::build("correlations")
            .repeat("model", "m")
            .repeat("group", "all")
            .strings("parameter", rows.map(|r| r.0))
            .opt_strings("segment", rows.map(|r| r.1))
            .opt_strings("of", rows.map(|r| Some(r.2)))
            .strings("other", rows.map(|r| r.3))
            .opt_strings("other_segment", rows.map(|r| r.4))
            .opt_strings("other_of", rows.map(|r| Some(r.5)))
            .f64("value", rows.map(|r| r.6))
            .f64("value_crlb", [0.0; 7])
            .finish()
            .expect("a table");
        let known = Correlations::read(&table).expect("correlations");
        let key = |segment: &str| ("a".to_string(), segment.to_string());
        let r = |a: &str, b: &str| known.through_sources(&key(a), &key(b));
        assert!((r("1.1", "1.2") - 0.72).abs() < 1e-12);
        assert_eq!((r("1.1", "2.1"), r("1.2", "2.1")), (0.0, 0.0));
    }

    /// A flight with two common parameters and two maneuvers of two parameters each.
    #[test]
    fn estimates_of_two_maneuvers_are_correlated_through_what_they_share() {
        type Side = (&'static str, Option<&'static str>);
        let rows: [(Side, Side, f64); 12] = [
            (("F", None), ("k", None), 0.6),
            (("a", Some("1")), ("F", None), 0.5),
            (("a", Some("1")), ("k", None), 0.1),
            (("b", Some("1")), ("F", None), -0.3),
            (("b", Some("1")), ("k", None), 0.2),
            (("a", Some("1")), ("b", Some("1")), 0.4),
            (("a", Some("2")), ("F", None), 0.7),
            (("a", Some("2")), ("k", None), 0.3),
            (("b", Some("2")), ("F", None), 0.0),
            (("b", Some("2")), ("k", None), -0.2),
            (("a", Some("2")), ("b", Some("2")), 0.1),
            (("z", Some("2")), ("b", Some("2")), 0.1),
        ];
        let table = Table::build("correlations")
            .strings("group", rows.iter().map(|_| "flight"))
            .strings("parameter", rows.iter().map(|r| r.0.0))
            .opt_strings("segment", rows.iter().map(|r| r.0.1))
            .strings("other", rows.iter().map(|r| r.1.0))
            .opt_strings("other_segment", rows.iter().map(|r| r.1.1))
            .f64("value", rows.iter().map(|r| r.2).collect::<Vec<_>>())
            .f64("value_crlb", vec![0.0; rows.len()])
            .repeat("model", "m")
            .opt_strings("of", rows.iter().map(|_| None::<&str>))
            .opt_strings("other_of", rows.iter().map(|_| None::<&str>))
            .finish()
            .expect("a table");
        let known = Correlations::read(&table).expect("correlations");
        // R_cc^-1 of [1 0.6; 0.6 1] is [1 -0.6; -0.6 1]/0.64.
        let through = |a: [f64; 2], b: [f64; 2]| {
            (a[0] * b[0] - 0.6 * (a[0] * b[1] + a[1] * b[0]) + a[1] * b[1]) / 0.64
        };
        let key = |name: &str, segment: &str| (name.to_string(), segment.to_string());
        let found = known.through_sources(&key("a", "1"), &key("a", "2"));
        assert!((found - through([0.5, 0.1], [0.7, 0.3])).abs() < 1e-12, "{found}");
        let points = |name: &str| {
            Table::build("points")
                .repeat("model", "m")
                .repeat("parameter", name)
                .repeat("against", "alpha")
                .repeat("fit", "m-alpha")
                .repeat("unit", "1")
                .repeat("unit_x", "rad")
                .repeat("flight", "flight")
                .strings("segment", ["1", "2"])
                .f64("x", vec![0.0, 1.0])
                .f64("value", vec![0.0, 1.0])
                .f64("sd", vec![2.0, 3.0])
                .finish()
                .unwrap_or_else(|e| panic!("{name}: {e}"))
        };
        let shared = known.shared("a", &["1", "2"], &[2.0, 3.0]);
        let effects = &shared[0].effects;
        let covariance = effects[0] * effects[2] + effects[1] * effects[3];
        assert_eq!((shared.len(), shared[0].points.as_slice()), (1, [0, 1].as_slice()));
        assert!((covariance - 6.0 * found).abs() < 1e-12);
        let pairs = known.pairs(("a", &points("a")), ("b", &points("b"))).expect("pairs");
        let own = 0.4 - through([0.5, 0.1], [-0.3, 0.2]);
        assert_eq!((pairs[0].0, pairs[0].1, pairs.len()), (0, 0, 2));
        assert!((pairs[0].2 - 4.0 * own).abs() < 1e-12);
        assert!(known.shared("z", &["1", "2"], &[2.0, 3.0]).is_empty());
    }
}
