//! Two output folders come in; what the results that their records name differ in beyond their standard
//! deviations goes out: values, lines, curves, verdicts, and what only one of them has.

use super::recorded::Recorded;
use super::store::Store;
use crate::error::{Errors, Result};
use crate::estimate::Line;
use crate::math::digits;
use crate::table::{Table, read_dataset_of};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A value has moved where it has by more than so many of the larger of its two standard deviations.
const MOVED: f64 = 2.0;

/// What kind of result differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    Estimate,
    Line,
    Curve,
    /// What a diagnosis says is to be used.
    Recommended,
    Verdict,
}

/// What one run says; a quantity without a value was asked for and not found.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Side {
    Quantity {
        value: Option<f64>,
        sd: Option<f64>,
        unit: String,
    },
    Words(String),
    /// So many values, none of which the other run has.
    All {
        values: usize,
    },
}

/// A difference of two runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    pub kind: Kind,
    /// Names from the estimate, fit, validation or diagnosis on.
    pub of: Vec<String>,
    /// None where the first run does not have it.
    pub first: Option<Side>,
    pub second: Option<Side>,
    /// How far it moved, in the larger of both standard deviations; none without one.
    pub sds: Option<f64>,
}

/// What came of comparing two runs.
#[derive(Debug, Default, Serialize)]
pub struct Compared {
    /// How many values and verdicts both have.
    pub both: usize,
    pub differences: Vec<Difference>,
    /// Files of these tables that no record of a run names, and that were left out.
    #[serde(skip)]
    pub left_out: BTreeSet<String>,
}

/// An output folder, and what of it is a result.
struct Run<'a> {
    folder: &'a Path,
    recorded: Recorded,
    left_out: BTreeSet<String>,
}

impl Run<'_> {
    fn of(folder: &Path) -> Result<Run<'_>> {
        let recorded = Recorded::of(&Store::look(folder)?);
        Ok(Run { folder, recorded, left_out: BTreeSet::new() })
    }

    /// A table, of the files that a record names.
    fn table(&mut self, name: &str) -> std::result::Result<Table, Errors> {
        read_dataset_of(self.folder, name, &mut |path| {
            let is_result = self.recorded.has(path);
            if !is_result {
                self.left_out.insert(self.folder.join(path).to_string_lossy().into_owned());
            }
            is_result
        })
    }
}

/// A table whose rows are compared: the columns that name a row, and what is taken of it.
struct Wanted {
    kind: Kind,
    table: &'static str,
    names: &'static [&'static str],
    /// Value, standard deviation and what it is per; the name of the value is told where there are
    /// several.
    values: &'static [(&'static str, &'static str, Per)],
    words: &'static [&'static str],
}

/// The unit of a value.
#[derive(Clone, Copy, PartialEq)]
enum Per {
    /// That of its row.
    One,
    /// That of its row over that of the abscissa.
    X,
}

const WANTED: [Wanted; 7] = [
    Wanted {
        kind: Kind::Estimate,
        table: "estimates",
        names: &["model", "group", "segment", "of", "parameter"],
        values: &[("value", "sd", Per::One)],
        words: &[],
    },
    Wanted {
        kind: Kind::Recommended,
        table: "recommended",
        names: &["diagnosis", "candidate", "parameter"],
        values: &[("value", "sd", Per::One)],
        words: &[],
    },
    Wanted {
        kind: Kind::Line,
        table: "fits",
        names: &["model", "parameter", "against"],
        values: &[("slope", "slope_sd", Per::X), ("intercept", "intercept_sd", Per::One)],
        words: &[],
    },
    Wanted {
        kind: Kind::Verdict,
        table: "estimates",
        names: &["model", "group"],
        values: &[],
        words: &["stop"],
    },
    Wanted {
        kind: Kind::Verdict,
        table: "validation",
        names: &["validation", "flight", "segment", "output"],
        values: &[],
        words: &["verdict", "noise_verdict"],
    },
    Wanted {
        kind: Kind::Verdict,
        table: "tolerances",
        names: &["validation", "flight", "segment", "test", "group", "output", "of"],
        values: &[],
        words: &["verdict"],
    },
    Wanted {
        kind: Kind::Verdict,
        table: "findings",
        names: &["diagnosis", "candidate", "role"],
        values: &[],
        words: &["verdict"],
    },
];

/// What one run has of a table, by names.
type Sides = BTreeMap<Vec<String>, Side>;

/// Compares the results of two runs.
///
/// # Errors
/// A table cannot be read.
pub fn diff(first: &Path, second: &Path) -> std::result::Result<Compared, Errors> {
    let mut compared = Compared::default();
    let [mut first, mut second] = [Run::of(first)?, Run::of(second)?];
    for wanted in &WANTED {
        let [a, b] = [sides(&mut first, wanted)?, sides(&mut second, wanted)?];
        compared.both += a.keys().filter(|names| b.contains_key(*names)).count();
        compared.differences.extend(differences(wanted.kind, &a, &b));
    }
    let [a, b] = [curves(&mut first)?, curves(&mut second)?];
    for (of, first) in &a {
        let Some(second) = b.get(of) else { continue };
        compared.both += 1;
        compared.differences.extend(furthest(of, first, second));
    }
    compared.differences.sort_by_key(|d| d.kind);
    compared.left_out.extend(first.left_out.into_iter().chain(second.left_out));
    Ok(compared)
}

fn sides(run: &mut Run, wanted: &Wanted) -> std::result::Result<Sides, Errors> {
    let table = run.table(wanted.table)?;
    let rows = names(&table, wanted.names)?;
    let named = |row: &[String], what: &str, several: bool| -> Vec<String> {
        row.iter().cloned().chain(several.then(|| what.to_string())).collect()
    };
    let mut sides = Sides::new();
    for (value, sd, per) in wanted.values {
        let each = table.f64(value)?.iter().zip(table.f64(sd)?).zip(units(&table, *per)?);
        let each = each.map(|((&value, &sd), unit)| quantity(value, sd, unit));
        let several = wanted.values.len() > 1;
        sides.extend(rows.iter().map(|row| named(row, value, several)).zip(each));
    }
    for column in wanted.words {
        let each = rows.iter().zip(table.opt_strings(column)?);
        let several = wanted.words.len() > 1;
        sides.extend(each.filter_map(|(row, words)| {
            Some((named(row, column, several), Side::Words(words?.to_string())))
        }));
    }
    Ok(sides)
}

fn quantity(value: f64, sd: f64, unit: String) -> Side {
    let known = |x: f64| x.is_finite().then_some(x);
    Side::Quantity { value: known(value), sd: known(sd), unit }
}

/// The unit of every row.
fn units(table: &Table, per: Per) -> Result<Vec<String>> {
    let own = table.strings("unit")?.into_iter();
    if per == Per::One {
        return Ok(own.map(ToString::to_string).collect());
    }
    let over = |(unit, x): (&str, &str)| {
        Line { against: String::new(), unit: x.to_string(), centre: 0.0 }.slope_unit(unit)
    };
    Ok(own.zip(table.strings("unit_x")?).map(over).collect())
}

/// The points of a curve: abscissa with its name and unit, value and standard deviation.
type Points = Vec<(f64, String, Side)>;

/// All curves of a run.
fn curves(run: &mut Run) -> std::result::Result<BTreeMap<Vec<String>, Points>, Errors> {
    let table = run.table("curves")?;
    let rows = names(&table, &["curve", "group", "equation", "at"])?;
    let (input, unit_x, x) = (table.strings("input")?, table.strings("unit_x")?, table.f64("x")?);
    let (value, sd, units) = (table.f64("value")?, table.f64("sd")?, units(&table, Per::One)?);
    let mut curves: BTreeMap<Vec<String>, Points> = BTreeMap::new();
    for (k, (names, unit)) in rows.into_iter().zip(units).enumerate() {
        let at = format!("{} = {} {}", input[k], digits(x[k]), unit_x[k]);
        curves.entry(names).or_default().push((x[k], at, quantity(value[k], sd[k], unit)));
    }
    Ok(curves)
}

/// The point at which two curves are furthest apart, where they are: of the abscissas that both have.
fn furthest(of: &[String], a: &Points, b: &Points) -> Option<Difference> {
    let pairs = a.iter().filter_map(|(x, at, first)| {
        let (.., second) = b.iter().find(|(other, ..)| other == x)?;
        Some((moved(first, second)?, at, first, second))
    });
    let by = |sds: Option<f64>| sds.unwrap_or(f64::INFINITY);
    let (sds, at, first, second) = pairs.max_by(|a, b| by(a.0).total_cmp(&by(b.0)))?;
    let of = of.iter().chain([at]).cloned().collect();
    let (first, second) = (Some(first.clone()), Some(second.clone()));
    Some(Difference { kind: Kind::Curve, of, first, second, sds })
}

/// What every row is called: each name once, and none that is not said.
fn names(table: &Table, columns: &[&str]) -> Result<Vec<Vec<String>>> {
    let mut rows: Vec<Vec<String>> = vec![Vec::new(); table.rows()];
    for column in columns {
        for (row, name) in rows.iter_mut().zip(table.opt_strings(column)?) {
            let name = name.unwrap_or_default();
            if !name.is_empty() && row.last().is_none_or(|last| last != name) {
                row.push(name.to_string());
            }
        }
    }
    Ok(rows)
}

fn differences(kind: Kind, a: &Sides, b: &Sides) -> Vec<Difference> {
    let mut all = Vec::new();
    for (of, first) in a {
        if let Some(second) = b.get(of)
            && let Some(sds) = moved(first, second)
        {
            let (first, second) = (Some(first.clone()), Some(second.clone()));
            all.push(Difference { kind, of: of.clone(), first, second, sds });
        }
    }
    let alone = |of, side| Difference { kind, of, first: Some(side), second: None, sds: None };
    all.extend(only(a, b).into_iter().map(|(of, side)| alone(of, side)));
    let alone = |of, side| Difference { kind, of, first: None, second: Some(side), sds: None };
    all.extend(only(b, a).into_iter().map(|(of, side)| alone(of, side)));
    all
}

/// Whether two sides differ, and by how many standard deviations where there are some.
fn moved(a: &Side, b: &Side) -> Option<Option<f64>> {
    match (a, b) {
        (
            Side::Quantity { value: Some(a), sd: sd_a, .. },
            Side::Quantity { value: Some(b), sd: sd_b, .. },
        ) => {
            let sd = sd_a.unwrap_or(0.0).max(sd_b.unwrap_or(0.0));
            let sds = (sd > 0.0).then(|| (b - a).abs() / sd);
            // A value that is held has no sd: any change of it is one.
            let is_moved = sds.map_or(a != b, |sds| sds > MOVED);
            is_moved.then_some(sds)
        }
        (Side::Quantity { value: None, .. }, Side::Quantity { value: None, .. }) => None,
        (a, b) => (a != b).then_some(None),
    }
}

/// What one run alone has: an estimate, fit, validation or diagnosis of which the other has nothing
/// is one of these.
fn only(a: &Sides, b: &Sides) -> Vec<(Vec<String>, Side)> {
    let mut all: Vec<(Vec<String>, Side)> = Vec::new();
    for (of, side) in a.iter().filter(|(of, _)| !b.contains_key(*of)) {
        let whole = of.get(..1).unwrap_or_default();
        if b.keys().any(|other| other.starts_with(whole)) {
            all.push((of.clone(), side.clone()));
        } else if let Some((known, Side::All { values })) = all.last_mut()
            && known == whole
        {
            *values += 1;
        } else {
            all.push((whole.to_vec(), Side::All { values: 1 }));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quantity(value: f64, sd: f64) -> Side {
        super::quantity(value, sd, "rad".into())
    }

    #[test]
    fn curves_differ_where_they_are_furthest_apart() {
        let of = ["lift".to_string()];
        let points = |ys: [f64; 3]| -> Points {
            let x = [0.0, 0.1, 0.2];
            x.iter()
                .zip(ys)
                .map(|(x, y)| (*x, format!("eta = {x} rad"), quantity(y, 0.1)))
                .collect()
        };
        let first = points([1.0, 2.0, 3.0]);
        assert_eq!(furthest(&of, &first, &points([1.1, 2.1, 3.1])), None);
        let found = furthest(&of, &first, &points([1.3, 2.6, 3.4])).expect("apart");
        assert_eq!(found.of, ["lift", "eta = 0.1 rad"]);
        assert!((found.sds.expect("sd") - 6.0).abs() < 1e-9);
    }

    #[test]
    fn a_value_moves_by_more_than_twice_the_larger_sd() {
        let none = f64::NAN;
        assert_eq!(moved(&quantity(1.0, 0.1), &quantity(1.3, 0.2)), None);
        let sds = moved(&quantity(1.0, 0.1), &quantity(1.3, 0.1)).flatten().expect("moved");
        assert!((sds - 3.0).abs() < 1e-9, "{sds}");
        assert_eq!(moved(&quantity(1.0, none), &quantity(1.0, none)), None);
        assert_eq!(moved(&quantity(1.0, none), &quantity(1.1, none)), Some(None));
        assert_eq!(moved(&quantity(1.0, 0.1), &quantity(none, none)), Some(None));
        assert_eq!(moved(&quantity(none, none), &quantity(none, none)), None);
    }

    #[test]
    fn what_the_other_run_has_nothing_of_is_told_once() {
        let of = |names: &[&str]| names.iter().map(ToString::to_string).collect::<Vec<_>>();
        let side = || quantity(1.0, 0.1);
        let a = Sides::from([
            (of(&["all", "K"]), side()),
            (of(&["all", "T"]), side()),
            (of(&["lag", "K"]), side()),
            (of(&["lag", "T"]), side()),
        ]);
        let b = Sides::from([(of(&["lag", "K"]), side())]);
        let expected = [(of(&["all"]), Side::All { values: 2 }), (of(&["lag", "T"]), side())];
        assert_eq!(only(&a, &b), expected);
        assert!(only(&b, &a).is_empty());
    }
}
