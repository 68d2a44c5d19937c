//! `correlations` and `estimates` in, one heat map per estimation of how its parameters go together
//! out.

use super::columns::Columns;
use super::format::short;
use super::maneuvers::name;
use super::place::On;
use super::room::Room;
use super::section::{Body, Given, Section};
use crate::error::Result;
use serde::Serialize;
use std::collections::BTreeMap;

pub const SECTION: Section = Section {
    id: "correlations",
    heading: "Which parameters go together",
    on: On::Both,
    tables: &["correlations"],
    build,
};

/// The text around the plot (template).
#[derive(Debug, Default, Serialize)]
struct Shown {
    missing: Option<String>,
    shown: String,
}

/// What one heat map is drawn from (JSON): `values[row][column]`, both in the order of `names`.
#[derive(Debug, PartialEq, Serialize)]
pub struct Map {
    pub label: String,
    pub names: Vec<String>,
    pub values: Vec<Vec<Option<f64>>>,
}

/// A pair is hardly separable above this.
pub const CLOSE: f64 = 0.95;
/// Parameters drawn per estimation, those that are correlated most.
const LIMIT: usize = 40;

fn build(given: &Given) -> Result<Option<Body>> {
    let (maps, left) = closest(maps(given.get("correlations")), given.room());
    let missing = maps
        .is_empty()
        .then(|| "No correlation: no estimation has two parameters and a covariance.".to_string());
    let shown = format!(
        "Initial values of states are left out unless they are correlated above {CLOSE} with a parameter; of more than {LIMIT} parameters \
         those with the largest correlations are drawn.{left}"
    );
    Body::new(include_str!("html/correlations.html"), Shown { missing, shown })
        .plot("correlations", &maps)
        .map(Some)
}

/// The maps that a page has room for, those with the largest correlations, in their order; and a
/// sentence about the others.
fn closest(mut maps: Vec<Map>, room: Room) -> (Vec<Map>, String) {
    let all = maps.len();
    let largest = |map: &Map| {
        let off = |(i, row): (usize, &Vec<Option<f64>>)| {
            let others = row.iter().enumerate().filter(|(j, _)| i != *j);
            others.filter_map(|(_, v)| v.map(f64::abs)).fold(0.0, f64::max)
        };
        map.values.iter().enumerate().map(off).fold(0.0, f64::max)
    };
    let mut order: Vec<usize> = (0..all).collect();
    order.sort_by(|&a, &b| largest(&maps[b]).total_cmp(&largest(&maps[a])));
    let mut left = room.count(1, 1);
    order.retain(|&i| {
        let numbers = maps[i].names.len().pow(2);
        let fits = numbers <= left;
        left -= if fits { numbers } else { 0 };
        fits
    });
    let mut k = 0..;
    maps.retain(|_| k.next().is_some_and(|k| order.contains(&k)));
    let told = match all - maps.len() {
        0 => String::new(),
        n => format!(
            " Of {all} estimations {n} are not drawn, whose largest correlations are smaller."
        ),
    };
    (maps, told)
}

fn is_initial(name: &str) -> bool {
    name.split(' ').next().unwrap_or_default().ends_with("(0)")
}

/// A parameter, with the segment or the group of segments that it belongs to.
fn parameter(table: &Columns, row: usize, [name, segment, of]: [&str; 3]) -> String {
    let place = Some(table.text(segment, row))
        .filter(|s| !s.is_empty())
        .unwrap_or_else(|| table.text(of, row));
    if place.is_empty() {
        table.text(name, row)
    } else {
        format!("{} of {place}", table.text(name, row))
    }
}

/// One map per model and group, in the order of the table.
fn maps(table: Option<&Columns>) -> Vec<Map> {
    let Some(table) = table else { return Vec::new() };
    table
        .groups(["model", "group"])
        .into_iter()
        .filter_map(|([model, group], rows)| map(table, &model, &group, &rows))
        .collect()
}

fn map(table: &Columns, model: &str, group: &str, rows: &[usize]) -> Option<Map> {
    let mut names: Vec<String> = Vec::new();
    let mut known: BTreeMap<(String, String), f64> = BTreeMap::new();
    // The largest correlation of each with any other that is no initial value.
    let mut most: BTreeMap<String, f64> = BTreeMap::new();
    let alone = single(table, rows);
    for &row in rows {
        let read = |columns| {
            let full = parameter(table, row, columns);
            // Where all belongs to one segment its name says nothing.
            if alone { full.split(" of ").next().unwrap_or_default().to_string() } else { full }
        };
        let (a, b) =
            (read(["parameter", "segment", "of"]), read(["other", "other_segment", "other_of"]));
        let value = table.number("value", row);
        for (one, other) in [(&a, &b), (&b, &a)] {
            if !names.contains(one) {
                names.push(one.clone());
            }
            if !is_initial(other) {
                let so_far = most.entry(one.clone()).or_insert(0.0);
                *so_far = so_far.max(value.abs());
            }
            known.insert((one.clone(), other.clone()), value);
        }
    }
    let size = |name: &String| most.get(name).copied().unwrap_or(0.0);
    names.retain(|name| !is_initial(name) || size(name) > CLOSE);
    let mut sizes: Vec<f64> = names.iter().map(size).collect();
    sizes.sort_by(|a, b| b.total_cmp(a));
    let least = sizes.get(LIMIT - 1).copied().unwrap_or(0.0);
    names.retain(|name| size(name) >= least);
    names.truncate(LIMIT);
    let value = |a: &String, b: &String| {
        if a == b { Some(1.0) } else { known.get(&(a.clone(), b.clone())).and_then(|v| short(*v)) }
    };
    let values = names.iter().map(|a| names.iter().map(|b| value(a, b)).collect()).collect();
    let label =
        if group.is_empty() { model.to_string() } else { format!("{model} / {}", name(group, "")) };
    (names.len() > 1).then_some(Map { label, names, values })
}

/// Whether everything belongs to one and the same segment, or to all.
fn single(table: &Columns, rows: &[usize]) -> bool {
    let mut places: Vec<String> = Vec::new();
    for &row in rows {
        for column in ["segment", "of", "other_segment", "other_of"] {
            let place = table.text(column, row);
            if !place.is_empty() && !places.contains(&place) {
                places.push(place);
            }
        }
    }
    places.len() < 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    #[test]
    fn a_map_is_symmetric_and_leaves_out_initial_values_that_matter_to_none() {
        let pairs = [
            ("a", "b", -0.97),
            ("a", "x(0)", 0.2),
            ("b", "x(0)", 0.1),
            ("a", "y(0)", 0.3),
            ("b", "y(0)", 0.99),
        ];
        let table = Table::build("correlations")
            .repeat("model", "m")
            .strings("group", pairs.map(|_| "s1"))
            .strings("parameter", pairs.map(|p| p.0))
            .opt_strings("segment", [None::<&str>; 5])
            .opt_strings("of", [None::<&str>; 5])
            .strings("other", pairs.map(|p| p.1))
            .opt_strings("other_segment", [None::<&str>; 5])
            .opt_strings("other_of", [None::<&str>; 5])
            .f64("value", pairs.map(|p| p.2))
            .f64("value_crlb", pairs.map(|p| p.2))
            .finish()
            .expect("correlations");
        let maps = maps(Some(&Columns::of(&table)));
        let want = [
            [Some(1.0), Some(-0.97), Some(0.3)],
            [Some(-0.97), Some(1.0), Some(0.99)],
            [Some(0.3), Some(0.99), Some(1.0)],
        ];
        assert_eq!((maps.len(), maps[0].names.join(" ")), (1, "a b y(0)".to_string()));
        assert_eq!(maps[0].values, want);
    }
}
