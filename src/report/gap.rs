//! `gaps`, `driven`, `relations` and `equation_errors` in; the figures and the table of where
//! models and flights disagree out.

use super::columns::Columns;
use super::format::{bracketed, display_unit, number, short};
use super::grid::{Cell, Grid, Level};
use serde::Serialize;

/// The figures of one diagnosis (JSON): rows are outputs, in units of the measured noise.
#[derive(Debug, Serialize)]
pub struct Where {
    pub name: String,
    pub maneuvers: Split,
    pub bands: Split,
    pub times: Split,
    pub regimes: Vec<Split>,
    pub driven: Map,
    pub relations: Map,
}

/// The gap split by something, before and after what was added; `after` is empty where nothing was.
#[derive(Debug, Default, Serialize)]
pub struct Split {
    pub by: String,
    pub before: Map,
    pub after: Map,
}

/// A matrix `[row][column]` with words for the pointer.
#[derive(Debug, Default, Serialize)]
pub struct Map {
    pub rows: Vec<String>,
    pub columns: Vec<String>,
    pub values: Vec<Vec<Option<f64>>>,
    pub words: Vec<Vec<String>>,
}

impl Split {
    /// The same with at most so many columns: those with the largest values before.
    fn widest(mut self, most: usize) -> Split {
        let largest = |j: usize| {
            let column = self.before.values.iter().filter_map(|row| row[j]);
            column.fold(f64::NEG_INFINITY, f64::max)
        };
        let mut order: Vec<usize> = (0..self.before.columns.len()).collect();
        order.sort_by(|&a, &b| largest(b).total_cmp(&largest(a)));
        order.truncate(most);
        let names: Vec<String> = order.iter().map(|&j| self.before.columns[j].clone()).collect();
        if names.len() < self.before.columns.len() {
            self.by += &format!(" ({most} with the largest gaps)");
        }
        self.before.keep(&names);
        self.after.keep(&names);
        self
    }
}

impl Map {
    /// Takes the columns of other names away.
    fn keep(&mut self, names: &[String]) {
        let kept: Vec<bool> = self.columns.iter().map(|name| names.contains(name)).collect();
        let of = |k: &mut dyn Iterator<Item = &bool>| k.next().copied().unwrap_or(false);
        let mut k = kept.iter();
        self.columns.retain(|_| of(&mut k));
        self.values.iter_mut().for_each(|row| {
            let mut k = kept.iter();
            row.retain(|_| of(&mut k));
        });
        self.words.iter_mut().for_each(|row| {
            let mut k = kept.iter();
            row.retain(|_| of(&mut k));
        });
    }

    /// Rows and columns in order of first appearance; `of` gives row, column, value and words of a
    /// table's row.
    fn of(rows: &[usize], of: impl Fn(usize) -> (String, String, f64, String)) -> Map {
        let mut map = Map::default();
        let all: Vec<_> = rows.iter().map(|&row| of(row)).collect();
        let place = |list: &mut Vec<String>, name: &String| {
            if !list.contains(name) {
                list.push(name.clone());
            }
        };
        for (row, column, ..) in &all {
            place(&mut map.rows, row);
            place(&mut map.columns, column);
        }
        map.values = vec![vec![None; map.columns.len()]; map.rows.len()];
        map.words = vec![vec![String::new(); map.columns.len()]; map.rows.len()];
        for (row, column, value, words) in all {
            let at = |list: &[String], name: &str| {
                list.iter().position(|n| n == name).unwrap_or_default()
            };
            let (i, j) = (at(&map.rows, &row), at(&map.columns, &column));
            (map.values[i][j], map.words[i][j]) = (short(value), words);
        }
        map
    }
}

/// The figures, one set per diagnosis.
pub fn figures<'a>(get: impl Fn(&str) -> Option<&'a Columns>, most: usize) -> Vec<Where> {
    let Some(gaps) = get("gaps") else { return Vec::new() };
    let one = |([name], rows): ([String; 1], Vec<usize>)| {
        let split = |by: &str| split(gaps, &rows, by, &get);
        let mut all: Vec<String> = Vec::new();
        for by in rows.iter().map(|&r| gaps.text("by", r)) {
            if !["all", "band", "time since input"].contains(&by.as_str()) && !all.contains(&by) {
                all.push(by);
            }
        }
        // A quantity that hardly moved has one range only.
        let regimes =
            all.iter().map(|by| split(by)).filter(|s| s.before.columns.len() > 1).collect();
        let [driven, relations] = [("driven", driven as fn(_, _) -> _), ("relations", related)]
            .map(|(table, map)| get(table).map_or_else(Map::default, |t| map(t, &name)));
        Where {
            maneuvers: split("all").widest(most),
            bands: split("band"),
            times: split("time since input"),
            regimes,
            driven,
            relations,
            name,
        }
    };
    gaps.groups(["diagnosis"]).into_iter().map(one).collect()
}

/// SI unit of an output, or of a column of the samples; "SI" where neither says.
fn unit_of<'a>(name: &str, get: &impl Fn(&str) -> Option<&'a Columns>) -> String {
    let output = |table: &str| {
        let t = get(table)?;
        (0..t.rows()).find(|&r| t.text("output", r) == name).map(|r| t.text("unit", r))
    };
    let column =
        || get("samples").map(|s| s.unit(name).to_string()).filter(|unit| !unit.is_empty());
    output("closures").or_else(|| output("driven")).or_else(column).unwrap_or_else(|| "SI".into())
}

/// What a gap is split by, as a heading, and the factor from its SI unit to the unit of the
/// heading.
fn heading<'a>(by: &str, get: &impl Fn(&str) -> Option<&'a Columns>) -> (String, f64) {
    match by {
        "all" => ("maneuver".to_string(), 1.0),
        "band" => ("frequency [Hz]".to_string(), 1.0),
        "time since input" => ("since input [s]".to_string(), 1.0),
        other => {
            let unit = unit_of(other.strip_prefix("modelled ").unwrap_or(other), get);
            let (factor, unit) = display_unit(&unit);
            (format!("{other}{}", bracketed(if unit == "-" { "" } else { &unit })), factor)
        }
    }
}

/// Where a row of `gaps` looks, in words: `modelled alpha [deg]: 1.2 to 3.4`.
pub fn place<'a>(gaps: &Columns, row: usize, get: &impl Fn(&str) -> Option<&'a Columns>) -> String {
    let by = gaps.text("by", row);
    let (heading, factor) = heading(&by, get);
    let range = range(factor * gaps.number("from", row), factor * gaps.number("to", row), &by);
    if by == "all" { by } else { format!("{heading}: {range}") }
}

/// The gap by maneuver ("all") or by ranges of a quantity.
fn split<'a>(
    gaps: &Columns,
    rows: &[usize],
    by: &str,
    get: &impl Fn(&str) -> Option<&'a Columns>,
) -> Split {
    let whole = by == "all";
    let (heading, factor) = heading(by, get);
    let of = |when: &str| {
        let wanted = |r: &usize| gaps.text("when", *r) == when && gaps.text("by", *r) == by;
        let these: Vec<usize> = rows
            .iter()
            .copied()
            .filter(wanted)
            .filter(|&r| gaps.text("segment", r).is_empty() != whole)
            .collect();
        Map::of(&these, |r| {
            let span = || range(factor * gaps.number("from", r), factor * gaps.number("to", r), by);
            let column = if whole { gaps.text("segment", r) } else { span() };
            let (output, ratio) = (gaps.text("output", r), gaps.number("ratio", r));
            let words = format!("{output}, {column}: {} times the noise", number(ratio, 3));
            (output, column, ratio, words)
        })
    };
    let (before, after) = (of("before"), of("after"));
    Split { by: heading, before, after }
}

fn range(from: f64, to: f64, by: &str) -> String {
    let low = from.is_finite() && !(by == "band" && from == 0.0);
    match (low, to.is_finite()) {
        (true, true) => format!("{} to {}", number(from, 2), number(to, 2)),
        (true, false) => format!("> {}", number(from, 2)),
        (false, true) => format!("< {}", number(to, 2)),
        (false, false) => "all".to_string(),
    }
}

/// The share of an output's gap that is left with observer feedback on a state.
fn driven(table: &Columns, diagnosis: &str) -> Map {
    let rows: Vec<usize> = (0..table.rows())
        .filter(|&r| table.text("diagnosis", r) == diagnosis && !table.text("state", r).is_empty())
        .collect();
    Map::of(&rows, |r| {
        let (state, output, share) =
            (table.text("state", r), table.text("output", r), table.number("share", r));
        let noise = table.number("rms", r) / table.number("noise", r);
        let words = format!(
            "{output} with observer feedback on {state}: {}% of its gap is left, {} times the noise",
            number(100.0 * share, 3),
            number(noise, 3)
        );
        (output, state, share, words)
    })
}

/// Correlations, over the limit of series without relation.
fn related(table: &Columns, diagnosis: &str) -> Map {
    let rows: Vec<usize> =
        (0..table.rows()).filter(|&r| table.text("diagnosis", r) == diagnosis).collect();
    Map::of(&rows, |r| {
        let of = |column: &str, digits: usize| number(table.number(column, r), digits);
        let (output, source) = (table.text("output", r), table.text("source", r));
        let words = format!(
            "{output} and {source}: correlation {} (limit {}) at {} s; coherence {} (limit {}) from {} to {} Hz",
            of("correlation", 2),
            of("limit", 2),
            of("lag", 2),
            of("coherence", 2),
            of("coherence_limit", 2),
            of("from", 2),
            of("to", 2)
        );
        (output, source, table.number("correlation", r).abs() / table.number("limit", r), words)
    })
}

/// What equations lack: all maneuvers together, the one where it is most, and what it goes with.
pub fn equations(table: Option<&Columns>, relations: Option<&Columns>) -> Grid {
    let Some(table) = table else { return Grid::missing("No equation was looked at.") };
    let mut grid = Grid::new([
        "diagnosis",
        "equation",
        "#lacks|r.m.s.",
        "#noise|sd",
        "#r.m.s. / noise",
        "most in",
        "~goes with (lag)",
    ]);
    for ([name, equation], rows) in table.groups(["diagnosis", "equation"]) {
        let ratio = |r: usize| table.number("ratio", r);
        let (whole, mut each): (Vec<usize>, Vec<usize>) =
            rows.iter().partition(|&&r| table.text("segment", r).is_empty());
        let Some(&row) = whole.first() else { continue };
        each.sort_by(|&a, &b| ratio(b).total_cmp(&ratio(a)));
        let most = each
            .first()
            .map(|&r| format!("{} ({})", table.text("segment", r), number(ratio(r), 2)));
        grid.push(vec![
            Cell::new(&name),
            Cell::new(&equation).under(table.unit_in("unit", row)),
            Cell::new(number(table.number("rms", row), 3)),
            Cell::new(number(table.number("noise", row), 2)),
            Cell::new(number(ratio(row), 3)).level_if(ratio(row) > 2.0, Level::Warn),
            Cell::new(most.unwrap_or_default()),
            Cell::new(relations.map(|r| partners(r, &name, &equation)).unwrap_or_default()),
        ]);
    }
    grid.note = Some(
        "A coefficient lacks the increment along the maneuvers that makes the model agree with all sensors, all coefficients at once; a rate \
         what observer feedback takes to keep its state at the measurement. The noise is what white noise of the sensors alone makes of it."
            .into(),
    );
    grid.or_missing("No equation was looked at.")
}

/// Up to three sources whose correlation is above its limit, the strongest first.
fn partners(relations: &Columns, diagnosis: &str, equation: &str) -> String {
    let over = |r: usize| relations.number("correlation", r).abs() / relations.number("limit", r);
    let ours = |r: &usize| {
        relations.text("diagnosis", *r) == diagnosis && relations.text("output", *r) == equation
    };
    let mut all: Vec<usize> =
        (0..relations.rows()).filter(ours).filter(|&r| over(r) > 1.0).collect();
    all.sort_by(|&a, &b| over(b).total_cmp(&over(a)));
    let word = |&r: &usize| {
        let of = |column: &str| number(relations.number(column, r), 2);
        format!("{} {} ({} s)", relations.text("source", r), of("correlation"), of("lag"))
    };
    all.iter().take(3).map(word).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    /// What it is by, maneuver, output, from, to, ratio.
    type Row = (&'static str, Option<&'static str>, &'static str, f64, f64, f64);

    /// Two outputs in two maneuvers, and one output in two bands; nothing was added.
    fn gaps() -> Columns {
        let rows: [Row; 6] = [
            ("all", Some("a"), "q", f64::NAN, f64::NAN, 2.0),
            ("all", Some("b"), "q", f64::NAN, f64::NAN, 3.0),
            ("all", Some("b"), "V", f64::NAN, f64::NAN, 1.0),
            ("all", None, "q", f64::NAN, f64::NAN, 2.5),
            ("band", None, "q", 0.0, 0.3, 5.0),
            ("band", None, "q", 8.0, f64::NAN, 0.5),
        ];
        let number = |of: fn(&Row) -> f64| rows.iter().map(of).collect::<Vec<f64>>();
        let table = Table::build("gaps")
            .repeat("diagnosis", "d")
            .repeat("when", "before")
            .opt_strings("segment", rows.iter().map(|r| r.1))
            .strings("output", rows.iter().map(|r| r.2))
            .strings("by", rows.iter().map(|r| r.0))
            .f64("from", number(|r| r.3))
            .f64("to", number(|r| r.4))
            .i64("n", vec![10; rows.len()])
            .f64("mean", vec![0.0; rows.len()])
            .f64("rms", number(|r| r.5))
            .f64("noise", vec![1.0; rows.len()])
            .f64("ratio", number(|r| r.5))
            .finish();
        Columns::of(&table.expect("gaps"))
    }

    #[test]
    fn figures_have_outputs_down_and_maneuvers_or_ranges_across() {
        let gaps = gaps();
        let all = figures(|name| (name == "gaps").then_some(&gaps), 9);
        let of = &all[0].maneuvers.before;
        assert_eq!((of.rows.join(" "), of.columns.join(" ")), ("q V".into(), "a b".into()));
        assert_eq!(of.values, [[Some(2.0), Some(3.0)], [None, Some(1.0)]]);
        let bands = &all[0].bands;
        assert_eq!(
            (bands.before.columns.join(" "), bands.after.columns.len()),
            ("< 0.30 > 8.0".into(), 0)
        );
        assert!(all[0].regimes.is_empty());
    }
}
